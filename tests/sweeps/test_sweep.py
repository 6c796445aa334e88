"""Sweeps against `find`, one member after the other, and stores that are gone on with."""

from importlib import import_module

import numpy as np
import pytest
from conftest import slow_after

from orbits import InputError, NoOrbit, Sweep, find, find_all, quantities, sweep
from orbits.sweeps.question import CHUNK
from problems import Chain, HeavyHand, Hopper, Juggler
from tests.sweeps.swept import CASES


@pytest.mark.parametrize("case", slow_after(4, CASES))
def test_every_member_is_what_find_finds(case):
    machine, over, family = CASES[case]
    names = ["loss_coefficient", "smallest_separation", "contact_time/flight_time"]
    asked = names if machine.rest_length else [names[0], names[2]]
    found = sweep(machine, over, 40, sampling="sobol", family=family, quantities=asked)
    assert len(found) == 40
    for i in range(0, 40, 5):
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
    with pytest.raises(InputError, match=r"has no column \[1\]"):
        found[[1]]
    with pytest.raises(InputError, match=r"member = \[1\]; it must be a whole number, at least 0"):
        found.orbit([1])


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


def test_members_may_be_found_by_another_method(tmp_path):
    """By multiple shooting as by the simplest method, and by the same method from a store."""
    machine, over = Hopper("cubic", rest_length=30.0), {"beta": (0.1, 0.3), "mass_ratio": (0.5, 1.0)}
    found = sweep(machine, over, 8, seed=1, family=[1, 2])
    shot = sweep(machine, over, 8, seed=1, family=[1, 2], method="shooting", store=tmp_path / "shot.db")
    assert (np.abs(found["alpha"] - shot["alpha"]) <= found["error"] + shot["error"]).all()
    assert set(shot["status"]) == {"certified"}
    for each in (shot, Sweep.load(tmp_path / "shot.db", machine)):
        orbit = each.orbit(3)
        assert orbit.method == "shooting"
        assert orbit.alpha == shot["alpha"][3]
    with pytest.raises(InputError, match="method"):
        sweep(machine, over, 8, seed=1, family=[1, 2], store=tmp_path / "shot.db")


@pytest.mark.parametrize("case", ["cubic", "family 3", "softening", "SI"])
def test_orbits_continued_from_a_start_are_those_of_the_family(case):
    machine, over, family = CASES[case]
    by_family = sweep(machine, over, 40, sampling="sobol", family=family, quantities="stroke")
    by_start = sweep(machine, over, 40, sampling="sobol", start=find(machine, family), quantities="stroke")
    lost = by_family["status"] == "no orbit"
    assert by_start["status"][~lost].tolist() == by_family["status"][~lost].tolist()
    assert set(by_start["status"][lost]) <= {"ends"}
    for name in ("alpha", "flight_time", "stroke", "family"):
        np.testing.assert_allclose(by_start[name], by_family[name], rtol=1e-10, err_msg=name)


CHAIN = Chain(springs="r + b*r**3", parameters={"b": 0.01})
OVER_CHAIN = {"m1": (0.85, 1.2), "b": (0.005, 0.03)}


@pytest.fixture(scope="module")
def chain_hop():
    return find(CHAIN, start=find_all(Chain(), Chain().starts(5, 5))[0])


@pytest.mark.slow
def test_a_chain_is_swept_from_one_of_its_hops(chain_hop, tmp_path):
    """Every member is an orbit that `find` finds near it; what a store and a file have comes back."""
    found = sweep(CHAIN, OVER_CHAIN, 24, start=chain_hop, quantities=["stroke", "alpha/flight_time"])
    assert set(found["status"]) == {"certified", "ends"}
    for i in range(0, 24, 8):
        if found["status"][i] == "ends":
            continue
        orbit = found.orbit(i)
        assert orbit.admissible
        assert abs(orbit.alpha - found["alpha"][i]) <= orbit.error + found["error"][i]
        assert found["stroke"][i] == pytest.approx(quantities(orbit.source, orbit, "stroke")["stroke"], rel=1e-11)
        again = find(orbit.source, start=orbit, method="shooting")
        assert abs(orbit.alpha - again.alpha) <= orbit.error + again.error
    stored = sweep(
        CHAIN, OVER_CHAIN, 24, start=chain_hop, quantities=["stroke", "alpha/flight_time"], store=tmp_path / "a.db"
    )
    np.testing.assert_array_equal(stored["alpha"], found["alpha"])
    found.save(tmp_path / "a.json")
    for path in ("a.db", "a.json"):
        assert Sweep.load(tmp_path / path, CHAIN).orbit(0).alpha == found.orbit(0).alpha
    one = {name: found[name][:1] for name in OVER_CHAIN}
    alone = sweep(CHAIN, None, one, start=chain_hop)
    assert alone["alpha"][0] == found["alpha"][0]


def test_a_chain_needs_a_start_and_no_family(chain_hop):
    with pytest.raises(InputError, match="families of a chain of 3 masses is known: give an orbit"):
        sweep(CHAIN, {"b": [0.02]})
    with pytest.raises(InputError, match="start already determines the family and outcome"):
        sweep(CHAIN, {"b": [0.02]}, family=2, start=chain_hop)
    with pytest.raises(InputError, match="derivative by the launch speed"):
        sweep(CHAIN, {"b": [0.02]}, start=chain_hop, quantities="loss_coefficient")
    with pytest.raises(InputError, match="no parameter 'mass_ratio' to sweep over"):
        sweep(HeavyHand("cubic"), {"mass_ratio": (1.0, 2.0)})


def test_progress_is_reported_within_a_chunk(chain_hop, monkeypatch):
    monkeypatch.setattr(import_module("orbits.sweeps.sweep"), "SILENT", 0.0)
    states = []
    sweep(CHAIN, OVER_CHAIN, 20, start=chain_hop, progress=states.append)
    done = [state.done for state in states]
    assert done == sorted(done)
    assert done[0] < 20 == done[-1]


def test_a_member_that_is_not_certified_alone_lacks_the_numbers_that_need_it(monkeypatch):
    machine = Hopper("cubic", rest_length=9.0)

    def refused(machine, unknowns):
        raise NoOrbit("it cannot be certified")

    over, options = {"beta": [0.1, 0.2]}, {"start": find(machine), "quantities": ["largest_spring_force", "stroke"]}
    whole = sweep(machine, over, **options)
    monkeypatch.setattr("orbits.design.designs_at_once.orbit_from_unknowns", refused)
    found = sweep(machine, over, **options)
    assert np.isfinite(whole["largest_spring_force"]).all()
    assert np.isnan(found["largest_spring_force"]).all()
    np.testing.assert_array_equal(found["stroke"], whole["stroke"])


class TestTuned:
    """Sweeps with tuned parameters."""

    @pytest.mark.slow
    def test_members_have_the_frequency(self, tmp_path):
        """Of a linear spring the period is that of stiffness 1 over the root of the stiffness."""
        machine, ratios, path = Hopper("k*r", parameters={"k": 1.0}), [0.3, 1.0, 4.0], tmp_path / "study.db"
        own = {"over": {"mass_ratio": ratios}, "family": [1, 2], "tune": "k", "at": {"frequency": 0.1}}
        found = sweep(machine, **own, quantities=["loss_coefficient", "k*alpha"], store=path)
        assert found["status"].tolist() == ["certified"] * 6
        for i, (ratio, family) in enumerate((ratio, family) for ratio in ratios for family in (1, 2)):
            stiffness = (0.1 * find(machine.with_values(mass_ratio=ratio), family).period) ** 2
            assert abs(found["k"][i] - stiffness) <= found["k_error"][i] + 1e-14 * stiffness
            assert found["k_error"][i] < 1e-11
            assert found["k*alpha"][i] == pytest.approx(found["k"][i] * found["alpha"][i], rel=1e-14)
            orbit = found.orbit(i)
            assert orbit.certificate.loss_coefficient == pytest.approx(found["loss_coefficient"][i], rel=1e-9)
            assert orbit.source.values["k"] == pytest.approx(found["k"][i], rel=1e-12)
            assert orbit.family == family
        assert found["admissible"].tolist() == [1.0] * 6
        again, stored = sweep(machine, **own, quantities=["loss_coefficient", "k*alpha"], store=path), Sweep.load(path)
        for name, column in found.columns.items():
            assert column.tolist() == again[name].tolist() == stored[name].tolist()

    def test_members_that_have_none_say_why(self):
        """A parameter without effect, of the machine itself too."""
        machine = Hopper("k*r + 0*c*r**3", parameters={"k": 1.0, "c": 1.0})
        found = sweep(machine, {"mass_ratio": [0.5, 1.0]}, tune="c", at={"frequency": 0.2})
        assert found["status"].tolist() == ["no orbit"] * 2
        assert all(reason.startswith("frequency does not depend on c") for reason in found["reason"])
        assert np.isnan(found["c"]).all()
        assert not found.found
        with pytest.raises(NoOrbit, match="frequency does not depend on c"):
            found.orbit(1)

    def test_bad_arguments_are_named(self):
        machine = Hopper("k*r", parameters={"k": 1.0})
        wrong = [
            ({"tune": "k"}, r"tune = \['k'\] names 1 of the parameters of the hopper, and 0 are needed"),
            ({"tune": "k", "at": {"clearance": 1.0}}, "at 'clearance': it depends on the whole motion"),
            ({"tune": "mass_ratio", "at": {"period": 9.0}}, "'mass_ratio' is varied"),
            ({"tune": "k", "at": {"period": 9.0}, "outcome": "fixed_points", "between": (1, 2)}, "apply to orbits"),
        ]
        for options, words in wrong:
            with pytest.raises(InputError, match=words):
                sweep(machine, {"mass_ratio": [0.5, 1.0]}, **options)
