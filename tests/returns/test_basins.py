"""Basins and intervals of launches as results: what comes to a hop, in the units of the machine."""

import numpy as np
import pytest
from legibility import faults

from orbits import InputError, ReturnMap, find
from orbits.returns.basins import Basins, LaunchIntervals
from orbits.returns.destinations import Destination
from problems import HeavyHand, Hopper, hopper_in_si

LEG = hopper_in_si(60.0, 3.0, stiffness=8000.0, rest_length=0.8)


@pytest.fixture(scope="module")
def of_leg():
    star = find(LEG).alpha
    return star, ReturnMap(LEG).basins(0.99 * star, 1.02 * star, samples=200)


def test_launches_of_a_basin_come_to_its_hop(of_leg):
    star, basins = of_leg
    (alpha,) = basins
    assert alpha == pytest.approx(star, rel=1e-12)
    step, launches = ReturnMap(LEG), np.array([0.3 * a + 0.7 * b for a, b in basins[alpha]])
    for _ in range(150):
        launches = step(launches).next
    assert launches == pytest.approx(star, rel=1e-3)
    assert (launches >= star * (1 - 1e-12)).all()


def test_the_table_and_the_share(of_leg, tmp_path):
    star, basins = of_leg
    table = basins.table()
    own = [i for i, kind in enumerate(table["destination"]) if kind == "lossless"]
    length = sum(table["to"][i] - table["from"][i] for i in own)
    assert basins.share == pytest.approx(length / (0.03 * star))
    assert basins.heading("from") == "from (m/s)"
    assert Basins.load(basins.save(tmp_path / "basins.json")) == basins
    axes = basins.plot()
    row = axes.collections[[each.kind for each in basins.destinations].index("lossless")]
    assert sum(path.get_extents().width for path in row.get_paths()) == pytest.approx(length)
    assert not faults(axes.figure)
    assert sum(basins.share_of(kind) for kind in ("slower", "rests", "undecided")) + basins.share == pytest.approx(1)
    with pytest.raises(InputError, match="not a launch speed of attracting hops"):
        basins.share_of(1.0)
    with pytest.raises(InputError, match=r"'undecidd' is not where launches come to; here they come to .*lossless"):
        basins.share_of("undecidd")
    assert basins.share_of("chaotic") == 0.0


def test_a_share_is_a_lower_bound_where_launches_are_undecided():
    ends = {"lossless": (4.0, 4.5), "undecided": (4.5, 5.0), "rests": (4.5, 5.0)}
    parts = {kind: Destination(kind, (pair,), (4.0,) if kind == "lossless" else ()) for kind, pair in ends.items()}
    some, all_known = (
        Basins({}, 4.0, 5.0, 0.0, (parts["lossless"], parts[other]), 3) for other in ("undecided", "rests")
    )
    assert some.title().endswith(": at least 50.000% come to a lossless hop")
    assert all_known.title().endswith(": 50.000% come to a lossless hop")
    assert some.plot().get_title() == "at least 50.000% of the launches come to a lossless hop"


def test_where_nothing_comes_to_a_lossless_hop():
    basins = ReturnMap(Hopper()).basins(1.0, 1.2, samples=50)
    assert (dict(basins), basins.share) == ({}, 0.0)
    assert "0.000% come" in str(basins)
    basins.plot()


def test_intervals_are_a_sequence_with_a_short_table(tmp_path):
    """However many there are, and of preimages too."""
    step = ReturnMap(Hopper())
    found = step.basin(4.5, 8.0)
    assert len(found) > 10
    assert len(str(found).splitlines()) < 10
    assert len(repr(found)) < 100
    assert np.reshape(found, (-1, 2)).shape == (len(found), 2)
    assert found[0] == found.intervals[0]
    assert f"... and {len(found) - 6} more" in str(found)
    assert LaunchIntervals.load(found.save(tmp_path / "basin.json")).intervals == found.intervals
    assert found.share == pytest.approx(np.diff(found).sum() / 3.5)
    before = step.preimages([(4.4, 4.5)], 3.0, 8.0)
    assert before.table() == {"from": [a for a, _ in before], "to": [b for _, b in before]}
    found.plot()


@pytest.mark.parametrize(
    ("restitution", "inject"),
    [(0.0, 0.0), pytest.param(1.0, 0.0, marks=pytest.mark.slow), pytest.param(1.0, 0.1, marks=pytest.mark.slow)],
)
def test_no_hop_attracts_where_all_lose_or_none_does(restitution, inject):
    """A damper without injection lets all launches rest; impacts that lose nothing take no launch to a hop."""
    machine = Hopper(damping=0.0 if restitution else 0.1, restitution=restitution)
    basins = ReturnMap(machine, inject=inject).basins(3.0, 5.0, samples=100)
    assert (len(basins), basins.share, basins.hops) == (0, 0.0, 0)  # hops to rest do not count
    assert basins.share_of("undecided" if restitution else "rests") == 1.0
    assert "narrower range" not in str(basins)


@pytest.mark.parametrize(("inject", "kind"), [(0.0, "itself"), (0.1, "faster"), (-0.1, "slower")])
def test_impacts_on_an_infinite_mass_lose_nothing(inject, kind):
    step = ReturnMap(HeavyHand(), inject=inject)
    assert step.only_gains
    basins = step.basins(3.0, 5.0)
    assert (len(basins), basins.share_of(kind)) == (0, 1.0)
    assert float(step(4.0).next) == pytest.approx(4.0 + inject, rel=1e-12)
    assert "undecided" not in str(basins)


def test_very_many_intervals_are_drawn_as_shares():
    """A third of each bin, and one interval as it is: together they have the area of the share."""
    edges = np.linspace(0.0, 3.0, 12001)
    many = tuple(zip(edges[:6000:3].tolist(), edges[1:6000:3].tolist(), strict=True))
    rows = Destination("stable", many, (1.0,), 0.5), Destination("undecided", ((1.5, 3.0),))
    basins = Basins({"machine": "hopper"}, 0.0, 3.0, 0.1, rows, 7)
    first, last = basins.plot().collections
    for row, length in ((first, 0.5), (last, 1.5)):
        x, y = row.get_paths()[0].vertices.T
        assert 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) == pytest.approx(0.7 * length, rel=1e-6)
    assert "undecided: the longest interval is 1.5 to 3" in str(basins)
