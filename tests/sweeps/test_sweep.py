"""Sweeps against `find`, one member after the other, and stores that are gone on with."""

import numpy as np
import pytest

from orbits import InputError, NoOrbit, Sweep, find, sweep
from orbits.sweeps.question import CHUNK
from problems import Hopper, Juggler
from tests.sweeps.swept import CASES


@pytest.mark.parametrize("case", CASES)
def test_every_member_is_what_find_finds(case):
    machine, over, family = CASES[case]
    names = ["loss_coefficient", "smallest_separation", "contact_time/flight_time"]
    asked = names if machine.rest_length else [names[0], names[2]]
    found = sweep(machine, over, 40, sampling="sobol", family=family, quantities=asked)
    assert len(found) == 40
    for i in range(0, 40, 2):
        member = machine.with_values(**{name: float(found[name][i]) for name in over})
        if found["status"][i] == "no orbit":
            with pytest.raises(NoOrbit) as error:
                find(member, family)
            assert found["reason"][i] == str(error.value)
            assert np.isnan(found["alpha"][i])
            continue
        orbit = find(member, family)
        assert abs(found["alpha"][i] - orbit.alpha) <= found["error"][i] + orbit.error
        assert found["flight_time"][i] == pytest.approx(orbit.flight_time, rel=1e-11)
        assert found["status"][i] == ("certified" if orbit.admissible else "inadmissible")
        assert (found["reason"][i] == "") == orbit.admissible
        assert found["family"][i] == family
        assert found["loss_coefficient"][i] == pytest.approx(orbit.certificate.loss_coefficient, rel=1e-8)
        if orbit.contact_time:
            assert found[names[2]][i] == pytest.approx(orbit.contact_time / orbit.flight_time, rel=1e-11)
        if "smallest_separation" in found.columns and orbit.certificate.smallest_separation is not None:
            assert found["smallest_separation"][i] == pytest.approx(orbit.certificate.smallest_separation, rel=1e-10)


def test_several_families_are_members_of_their_own():
    found = sweep(Hopper("cubic"), {"beta": [0.0, 0.1]}, family=[1, 2])
    assert found["family"].tolist() == [1, 2, 1, 2]
    assert found["beta"].tolist() == [0, 0, 0.1, 0.1]
    assert found.count == 4
    assert found.orbit(3).family == 2


def test_a_store_is_gone_on_with_and_read(tmp_path):
    path, over = tmp_path / "study.db", {"beta": (0.0, 0.5)}
    machine, states = Hopper("cubic"), []

    def stop(state):
        states.append(state)
        if len(states) == 2:
            raise KeyboardInterrupt

    count = 2 * CHUNK + 100
    with pytest.raises(KeyboardInterrupt, match=rf"{2 * CHUNK} of {count} members are in .*study\.db"):
        sweep(machine, over, count, store=path, progress=stop)
    assert len(Sweep.load(path)) == 2 * CHUNK
    later = []
    found = sweep(machine, over, count, store=path, progress=later.append)
    assert [state.done for state in later] == [count]
    expected = sweep(machine, over, count)
    for name, column in expected.columns.items():
        np.testing.assert_array_equal(found.columns[name], column, err_msg=name)
    loaded = Sweep.load(path, machine)
    assert loaded.orbit(3).alpha == pytest.approx(found["alpha"][3], rel=1e-13)
    with pytest.raises(InputError, match="machine="):
        Sweep.load(path).orbit(3)
    with pytest.raises(InputError, match="another machine"):
        Sweep.load(path, Juggler())
