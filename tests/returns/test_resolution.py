"""Fixed points, preimages and basins of the map: none missed, each told apart from a jump."""

import numpy as np
import pytest

from orbits import InputError, ReturnMap
from orbits.hops import STATUS
from orbits.numerics import enclosed_sign_changes
from orbits.returns import Hops
from orbits.returns.itineraries import MonotoneBranches
from orbits.returns.limited_hops import RESOLUTION, PlainMap
from orbits.returns.periodic_hops import cycles_of
from orbits.returns.preimages import Passages
from orbits.returns.resolution import Resolving, _Cell, _Refused, map_pieces
from problems import Hopper


def crossings(step, low, high, launches):
    """The fixed points that so many launches show: where the map crosses the identity line and does not jump."""
    over = lambda a, _=None: np.nan_to_num(step(a).next) - a  # noqa: E731
    x = np.linspace(low, high, launches)
    y = over(x)
    i = np.flatnonzero((y[1:] >= 0) != (y[:-1] >= 0))
    a, b, fa, fb = enclosed_sign_changes(over, x[i], x[i + 1], y[i], y[i + 1])
    return np.where(np.abs(fa) <= np.abs(fb), a, b)[np.maximum(np.abs(fa), np.abs(fb)) < 1e-6]


@pytest.mark.parametrize(
    ("machine", "inject", "low", "high", "count"),
    [
        pytest.param(Hopper(mass_ratio=1000.0), 0.05, 7.285, 7.295, 6, marks=pytest.mark.slow),
        (Hopper("r + 0.3*r**3"), 0.1, 2.0, 8.0, 10),
        pytest.param(Hopper(restitution=0.6, mass_ratio=3.0), 0.1, 2.0, 9.0, 4, marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_fixed_points_are_those_of_many_launches(machine, inject, low, high, count):
    """Where all bounces are short, and where borders accumulate: below some launch speed they are dust."""
    step = ReturnMap(machine, inject=inject)
    found = step.fixed_points(low, high)
    assert [point.alpha for point in found] == pytest.approx(crossings(step, low, high, 4001), rel=1e-12)
    assert len(found) == count
    hops = step.periodic_hops(1, low, high, 2000)
    assert [hop.alpha for hop in hops] == [point.alpha for point in found]
    assert hops.unresolved == found.unresolved


def test_preimages_are_all_there():
    """Both flanks of all three peaks, however narrow the interval; their ends map onto its ends."""
    step = ReturnMap(Hopper())
    found = np.array(step.preimages([(4.4, 4.4001)], 3.0, 12.0))
    assert found.shape == (6, 2)
    assert np.sort(step(found).next, axis=1) == pytest.approx(np.tile([4.4, 4.4001], (6, 1)), abs=1e-12)
    alpha = np.linspace(3.0, 12.0, 20001)
    wide = step.preimages([(1.0, 2.0), (4.0, 4.2)], 3.0, 12.0)
    following = step(alpha).next
    inside = ((following >= 1) & (following <= 2)) | ((following >= 4) & (following <= 4.2))
    np.testing.assert_array_equal(within(alpha, wide), inside)


@pytest.mark.slow
@pytest.mark.parametrize("machine", [Hopper(), Hopper(mass_ratio=2.0)])
def test_the_basin_is_what_comes_to_a_lossless_hop(machine):
    step, high = ReturnMap(machine), 5.6
    shares: list[float] = []
    basin = step.basin(4.5, high, progress=shares.append)
    assert shares == sorted(shares)
    stars = [point.alpha for point in step.fixed_points(1.0, high)]
    start = np.random.default_rng(3).uniform(4.5, high, 100)
    alpha = start.copy()
    for _ in range(200):
        alpha = np.where(np.isfinite(alpha), alpha, 1e-3)
        alpha = step(alpha).next
    # launches come down to a lossless one like (3/(C n))^3; all others rest
    comes = np.array([np.abs(np.array(stars) - a).min() < 1e-3 if np.isfinite(a) else False for a in alpha])
    np.testing.assert_array_equal(comes, within(start, basin))
    inside = np.concatenate([np.linspace(a, b, 5)[1:-1] for a, b in basin[:20]])
    for _ in range(200):
        inside = step(inside).next
        assert np.isfinite(inside).all()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda step: step.fixed_points("a", 3), "low = 'a' is not a finite number"),
        (lambda step: step.fixed_points(3, 2), "0 < low < high must hold"),
        (lambda step: ReturnMap(Hopper(), inject=0.1).fixed_points(2, 3, samples=0), "samples = 0; it must be a"),
        (lambda step: step.preimages([(4.0, 4.1)], 12, 3), "0 < low < high must hold"),
        (lambda step: step.preimages([(4.0, 4.1)], 3, 1e308), "a launch speed must be at most 1e\\+15"),
        (lambda step: step.preimages([(4.1, 4.0)], 3, 12), "the launch speeds of an interval"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant(call, words):
    with pytest.raises(InputError, match=words):
        call(ReturnMap(Hopper()))


@pytest.mark.parametrize(("low", "width", "has"), [(1.0, 2.0**-51, True), (1.0, 2.0**-50, False), (0.0, 0.1, False)])
def test_cells_without_numbers_between_their_launches(low, width, has):
    """Also of a cell from 0, where the width in smallest numbers is beyond the largest one."""
    launches = low + np.spacing(low) * np.arange(3)
    refused = _Refused(_Cell(low, width, 1), launches, np.ones(3), np.ones(3))
    assert refused.has_all_numbers == has


class TestMapsInClosedForm:
    """Of functions whose preimages and fixed points are known."""

    @staticmethod
    def step(function, borders):
        """The hops of a function with another number of impacts beyond each border."""

        def hops(x, cap=0):
            following = function(x)
            loss, impacts = (x - following) * (x + following), 1 + np.digitize(x, borders)
            return Hops(x, following, loss, impacts, np.full(x.shape, "lifts_off", STATUS))

        hops.inject = 0.0
        return hops

    def resolved(self, function, lossless, low, high):
        step = self.step(function, [])
        return Passages(step, Resolving(PlainMap(step, lossless), low, high, 41, None, RESOLUTION))

    def fixed_launches(self, function, borders, low, high):
        step = self.step(function, borders)
        pieces = map_pieces(PlainMap(step), low, high, 41, 0.0)
        assert not pieces.unresolved
        return [float(each[0][0]) for each in cycles_of(MonotoneBranches.of(pieces, 0.0), step, 1)[0]]

    def test_crossings_of_the_identity_line_but_no_jumps_over_it(self):
        """Three crossings, a touching pair closer than the grid, and jumps up and down."""
        curve = lambda a: a + 0.1 * (a - 1.5) * (a - 2.25) * (a - 3.75)  # noqa: E731
        assert self.fixed_launches(curve, [], 1.0, 5.0) == pytest.approx([1.5, 2.25, 3.75], rel=1e-13)
        pair = lambda a: a + (a - 2.51) ** 2 - 1e-6  # noqa: E731
        assert self.fixed_launches(pair, [], 1.0, 5.0) == pytest.approx([2.509, 2.511], rel=1e-12)
        jumps = lambda a: a + np.where((a < 2) | (a > 3), 0.1, -0.1)  # noqa: E731
        assert self.fixed_launches(jumps, [2.0, 3.0], 1.0, 5.0) == []

    def test_preimages_of_a_tent(self):
        """4 - 2 |a - 2|: each interval has one on either side, and two that touch are one."""
        tent = self.resolved(lambda a: 4 - 2 * np.abs(a - 2), [], 0.1, 3.9)
        assert np.ravel(tent.preimages([(1.0, 2.0), (3.0, 3.5)])) == pytest.approx(
            [0.5, 1.0, 1.5, 1.75, 2.25, 2.5, 3.0, 3.5], rel=1e-13
        )
        assert np.ravel(tent.preimages([(3.0, 4.5)])) == pytest.approx([1.5, 2.5], rel=1e-13)
        assert np.ravel(tent.preimages([(0.0, 1.0)])) == pytest.approx([0.1, 0.5, 3.5, 3.9], rel=1e-13)
        assert tent.preimages([(5.0, 6.0)]) == []


def within(values, edges):
    """Whether values (m,) lie in one of several ascending, disjoint intervals."""
    return np.any([(a <= values) & (values <= b) for a, b in edges], axis=0)
