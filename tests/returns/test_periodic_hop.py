"""Hops that come back, by Newton's method: fixed points and hops of two."""

import numpy as np
import pytest
from columns import CUBIC, column, hop_of
from conftest import slow_after

from orbits import InputError, NoOrbit, ReturnMap, multipliers
from problems import Hopper


@pytest.mark.parametrize("kind", slow_after(2, ["column", "chain_hand", "cubic column"]))
def test_fixed_points_beside_a_lossless_hop(kind):
    """One has more energy, and one less; hops lose there what the injection adds."""
    machine, orbit = hop_of(kind)
    step = ReturnMap(machine, inject=1e-3)
    above, below = step.fixed_points(starts=[orbit])
    section, (lossless,) = step.section, [step.section.launch(orbit)]
    energy = lambda launch: step.impacts.energy(step.impacts.model.embed @ section.states(launch[None])[0])  # noqa: E731
    for hop, side in ((above, 1), (below, -1)):
        (launch,) = hop.launches
        assert step(launch).next == pytest.approx(launch, rel=1e-10)
        assert hop.kind == "crossing"
        assert side * (energy(launch) - energy(section.free(lossless))) > 0
        # The launch before the injection has lost what the injection adds.
        before = launch - [1e-3, 0, 0]
        assert energy(launch) - energy(before) == pytest.approx(step(launch).loss, rel=1e-8)
        assert hop.multipliers.values == pytest.approx(multipliers(machine, launch).values)
    assert below.stability == "unstable"
    assert step.fixed_points(starts=[above, above, orbit.alpha * np.ones(3)])[0].launches == pytest.approx(
        above.launches
    )


def test_one_orbit_alone_or_its_file_is_a_start_and_none_is_not(tmp_path):
    machine, orbit = hop_of("chain_hand")
    step = ReturnMap(machine, inject=1e-3)
    alone, listed = step.fixed_points(starts=orbit), step.fixed_points(starts=[orbit])
    assert [hop.launches.tolist() for hop in alone] == [hop.launches.tolist() for hop in listed]
    file = orbit.save(tmp_path / "hop.json")
    assert [hop.launches.tolist() for hop in step.fixed_points(starts=file)] == [hop.launches.tolist() for hop in alone]
    assert multipliers(machine, str(file)).values.tolist() == multipliers(machine, orbit).values.tolist()
    for none in ([], np.float64(np.nan), 4.6):
        with pytest.raises(InputError, match=r"starts = .*; it must be a list of launches"):
            step.fixed_points(starts=none)


def test_a_damped_column_that_is_driven():
    step = ReturnMap(column("r", 0.002), inject=0.2)
    hop = step.periodic_hop(hop_of()[1])
    assert step(hop).next == pytest.approx(hop.launches[0], rel=1e-11)


def test_fixed_points_and_hops_of_two_of_one_speed():
    machine = Hopper()
    step = ReturnMap(machine, inject=0.08)
    low, high = step.fixed_points(4, 5)
    found = step.fixed_points(starts=[4.46, 4.55])
    assert [hop.launches[0, 0] for hop in found] == pytest.approx([low.alpha, high.alpha], rel=1e-9)
    assert [hop.multipliers.values[0] for hop in found] == pytest.approx([low.multiplier, high.multiplier], rel=1e-7)
    hop = step.periodic_hop(4.6, 2)
    assert hop.period == 2
    assert step(hop.launches[:, 0]).next == pytest.approx(hop.launches[::-1, 0], rel=1e-10)
    with pytest.raises(NoOrbit, match="reaches hops of period 1"):
        step.periodic_hop(high.alpha, 2)


def test_lossless_hops():
    machine, orbit = hop_of()
    hop = ReturnMap(machine).periodic_hop(orbit)
    assert (hop.kind, hop.stability, hop.period) == ("lossless", "neutral", 1)
    with pytest.raises(InputError, match="find them with `find`"):
        ReturnMap(machine).periodic_hop((6.4, -1.2, 1.1))
    with pytest.raises(NoOrbit, match="removes energy"):
        ReturnMap(machine, inject=-1e-3).periodic_hop(orbit)


def test_separations_and_units():
    machine = column(CUBIC, separation="12 + y1 - y2", in_si=True)
    orbit = hop_of("cubic column")[1]
    start = {"alpha": orbit.alpha, "y1": orbit(0.0)[0], "y1'": orbit(0.0)[1]}
    hop = ReturnMap(machine).periodic_hop(start)
    assert 0 < hop.smallest_separation < 12
    assert hop.units == {"alpha": "m/s", "y1": "m", "y1'": "m/s"}
    assert "alpha                   6.2939" in str(hop)


def test_starts_from_which_nothing_is_found():
    step = ReturnMap(column("r", 0.5), inject=1e-3)
    assert step.fixed_points(starts=[(3.0, 0.0, 0.0)]) == ()
    with pytest.raises(NoOrbit, match=r"rests|has not ended|start elsewhere|start nearer"):
        step.periodic_hop((3.0, 0.0, 0.0))
    with pytest.raises(InputError, match="low and high, between which to search fixed points, or starts"):
        ReturnMap(Hopper()).fixed_points()
