"""All hops of a period, against brute force on the map and Newton's method."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from legibility import faults

from orbits import InputError, ReturnMap, find, multiplier
from orbits.returns import resolution, return_map
from orbits.returns.limited_hops import Resolution
from orbits.returns.periodic_hops import PeriodicHops
from problems import Hopper, hopper_in_si

LEG = hopper_in_si(60.0, 3.0, stiffness=8000.0, rest_length=0.8)
LOW, HIGH = 4.3, 5.3


def sign_changes(step, period, count):
    """The cells of a grid in which f^n(x) - x changes its sign and does not jump."""
    x = np.linspace(LOW, HIGH, count)
    y = x.copy()
    for _ in range(period):
        inside = (y >= LOW) & (y <= HIGH)
        y[inside], y[~inside] = step(y[inside]).next, np.nan
    excess = y - x
    i = np.flatnonzero((excess[1:] >= 0) != (excess[:-1] >= 0))
    i = i[np.isfinite(excess[i]) & np.isfinite(excess[i + 1])]
    return x[i], x[i + 1]


@pytest.mark.parametrize("inject", [0.0987, 0.1189, 0.135])
def test_brute_force_finds_no_others(inject):
    step = ReturnMap(Hopper(), inject=inject)
    found = {n: step.periodic_hops(n, LOW, HIGH) for n in (1, 2, 3, 4)}
    for period in found:
        known = np.sort(np.concatenate([np.ravel([c.alphas for c in found[d]]) for d in found if period % d == 0]))
        a, b = sign_changes(step, period, 4000)
        assert len(a)
        assert (np.searchsorted(known, b + 1e-12) > np.searchsorted(known, a - 1e-12)).all()


def test_the_hops_come_back_and_have_exact_multipliers():
    step = ReturnMap(Hopper(), inject=0.135)
    for each in step.periodic_hops(6, LOW, HIGH):
        launches = each.alphas
        assert step(launches).next == pytest.approx(np.roll(launches, -1), abs=1e-13)
        assert each.multiplier == pytest.approx(np.prod([multiplier(Hopper(), a) for a in launches]), rel=1e-12)
        assert each.impacts == tuple(step(launches).impacts)
        assert 0 < each.error < 1e-12
        newton = step.periodic_hop(each.alpha, 6)
        assert newton.launches[:, 0] == pytest.approx(launches, abs=1e-9)


@pytest.mark.slow
def test_a_damped_machine_in_si():
    star = find(LEG).alpha
    step, ends = ReturnMap(replace(LEG, damping=0.5), inject=0.02 * star), (0.95 * star, 1.1 * star)
    points, hops = step.fixed_points(*ends), step.periodic_hops(1, *ends)
    assert len(points) > 0
    assert [each.alpha for each in hops] == pytest.approx([point.alpha for point in points], rel=1e-11)
    assert [each.multiplier for each in hops] == pytest.approx([point.multiplier for point in points], rel=1e-9)
    apart = [point.smallest_separation for point in points]
    assert [each.smallest_separation for each in hops] == pytest.approx(apart)
    assert hops.heading("alpha") == "alpha (m/s)"


def test_the_result_says_what_it_rests_on(tmp_path):
    hops = ReturnMap(Hopper(), inject=0.135).periodic_hops(3, LOW, HIGH)
    assert "all 15 itineraries through its 3 monotone branches were searched" in " ".join(str(hops).split())
    assert PeriodicHops.load(hops.save(tmp_path / "hops.json")).cycles == hops.cycles
    assert hops.table()["branch"][:3] == list(hops[0].branches)
    axes = hops.plot()
    assert len(axes.get_legend().get_texts()) == 2
    assert not faults(axes.figure)
    with pytest.raises(InputError, match="0 < low < high must hold"):
        ReturnMap(Hopper()).periodic_hops(2, 3.0, 2.0)


def test_a_map_that_is_not_resolved_is_not_complete(monkeypatch):
    short = partial(resolution.map_pieces, options=Resolution(effort=0.0))
    monkeypatch.setattr(return_map, "map_pieces", short)
    hops = ReturnMap(Hopper(), inject=0.1).periodic_hops(2, LOW, HIGH)
    assert (len(hops), hops.unresolved) == (0, ((LOW, HIGH),))
    assert "not complete" in str(hops)
    assert "no launch there has a next launch" not in str(hops)
    points = ReturnMap(Hopper(), inject=0.1).fixed_points(LOW, HIGH, samples=400)
    assert points == ()
    known = 4.4773, 4.5553
    assert all(any(a < alpha < b for a, b in points.unresolved) for alpha in known)
    assert "maybe others in 2 intervals" in repr(points)
