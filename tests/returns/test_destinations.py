"""What launches come to, against hops in closed form, maps in closed form, and simulations."""

import numpy as np
import pytest
from linear_hops import next_launches

from orbits import ReturnMap, simulate
from orbits.hops import STATUS
from orbits.returns import Hops, destinations as module
from orbits.returns.destinations import CHAOS, FASTER, SLOWER, UNDECIDED, SettledMap, destinations, length_of
from orbits.returns.itineraries import MonotoneBranches
from orbits.returns.limited_hops import PlainMap
from orbits.returns.map_pieces import within
from orbits.returns.resolution import map_pieces
from problems import Hopper, hopper_in_si, springs

MOST = 400  # hops


@pytest.mark.parametrize(
    ("mass_ratio", "inject", "low", "high", "launches"),
    [
        (5.0, 0.05, 3.0, 6.0, 4000),
        pytest.param(1.0, 0.03, 3.0, 8.0, 8_000, marks=pytest.mark.slow),
        pytest.param(2.0, 0.05, 3.0, 6.0, 10_000, marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_shares_are_those_of_launches_in_closed_form(mass_ratio, inject, low, high, launches):
    """Each launch is followed until it is beside a hop or rests; none beside a hop that is not in its basin."""
    basins = ReturnMap(Hopper(mass_ratio=mass_ratio), inject=inject).basins(low, high)
    start = low + (high - low) * (np.arange(launches) + 0.5) / launches
    alpha, ends, going = start.copy(), np.full(launches, -1), np.arange(launches)
    for _ in range(MOST):
        alpha[going] = next_launches(alpha[going], mass_ratio, inject)
        for i, each in enumerate(basins.attracting):
            near = np.abs(alpha[going, None] - np.array(each.launches)).min(1) < 1e-3 * alpha[going]
            ends[going[near]] = i
        going = going[(alpha[going] > 0) & (ends[going] < 0)]
    assert not len(going)
    assert len(basins) > 1
    for i, (first, intervals) in enumerate(basins.items()):
        assert np.mean(ends == i) == pytest.approx(basins.share_of(first), abs=2e-3)
        assert (ends[within(start, intervals)] == i).all()
    rest = next(each for each in basins.destinations if each.kind == "rests") if basins.share < 0.99 else None
    assert rest is None or (ends[within(start, rest.intervals)] == -1).all()
    assert basins.share_of(UNDECIDED) < 4e-3
    assert sum(b - a for each in basins.destinations for a, b in each.intervals) == pytest.approx(high - low, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "inject", "low", "high"),
    [
        (hopper_in_si(12.0, 2.0, stiffness=8000.0, rest_length=0.8), 0.005, 0.5, 1.5),
        (hopper_in_si(3.0, 1.5, force=springs.table(springs.SAMPLE, in_si=True), rest_length=0.3), 0.02, 0.5, 1.0),
        (Hopper("r + 0.3*r**3"), 0.02, 2.0, 4.5),
        (Hopper(restitution=0.3, damping=0.01), 0.2, 2.0, 8.0),
        (Hopper(springs.lossy("r", loss_factor=0.02)), 0.5, 2.0, 8.0),
    ],
)  # fmt: skip
def test_simulated_launches_end_as_their_interval_says(machine, inject, low, high):
    """Random launches of each destination, simulated hop after hop."""
    basins = ReturnMap(machine, inject=inject).basins(low, high)
    assert basins.share > 0
    for each in basins.destinations:
        starts = np.random.default_rng(5).permutation([0.4 * a + 0.6 * b for a, b in each.intervals])[:1]
        for start in starts.tolist() if each.is_hop or each.kind == "rests" else []:
            run = simulate(machine, start, hops=120, inject=inject)
            assert (run.status == "done") == each.is_hop
            if each.is_hop:
                assert np.abs(run.launches[-1] / np.array(each.launches) - 1).min() < 1e-3


class TestMapsInClosedForm:
    """Functions on [1, 4] without injection, whose basins are known."""

    @staticmethod
    def settled(function, low=1.0, high=4.0, rests=lambda x: np.zeros(x.shape, bool)):
        def hops(x, cap=0):
            status = np.where(rests(x), "rests", "lifts_off").astype(STATUS)
            following = np.where(rests(x), np.nan, function(x))
            impacts = np.ones(x.shape, int)
            return Hops(x, following, np.nan_to_num((x - following) * (x + following)), impacts, status)

        pieces = map_pieces(PlainMap(hops), low, high, 41)
        assert not pieces.unresolved
        return SettledMap(MonotoneBranches.of(pieces, 0.0), hops)

    def of(self, settled, low, high, hops=200, lossless=()):
        found, needed = destinations(settled, (low, high), lossless, hops)
        return {each.kind: each for each in found}, needed

    def test_two_attracting_points_and_what_divides_them(self):
        """x + (x - 1.5)(x - 2)(3 - x)/2: from 2 on launches come to 3, and slower ones to 1.5 alone from 1.5 down."""
        found, _ = destinations(self.settled(lambda x: x - 0.5 * (x - 1.5) * (x - 2) * (x - 3)), (1.2, 3.5), (), 200)
        stable = [each for each in found if each.kind == "stable"]
        assert [each.launches[0] for each in stable] == pytest.approx([1.5, 3.0], rel=1e-12)
        assert [each.multiplier for each in stable] == pytest.approx([1 - 0.375, 1 - 0.75], rel=1e-9)
        assert np.ravel([each.intervals for each in stable]) == pytest.approx([1.2, 2.0, 2.0, 3.5], rel=1e-6)

    def test_a_cycle_of_two_and_its_basin(self):
        """The logistic map with the parameter 3.2, moved to [1, 2]: only its fixed points do not come to the cycle."""
        found, _ = self.of(self.settled(lambda x: 1 + 3.2 * (x - 1) * (2 - x), 1.0, 2.0), 1.01, 1.99)
        root = np.sqrt(4.2 * 0.2)
        expected = [1 + (4.2 - root) / 6.4, 1 + (4.2 + root) / 6.4]
        assert found["stable"].launches == pytest.approx(expected, rel=1e-9)
        assert found["stable"].multiplier == pytest.approx(4 + 2 * 3.2 - 3.2**2, rel=1e-7)
        length = sum(b - a for a, b in found["stable"].intervals)
        assert length == pytest.approx(0.98, rel=1e-4)

    def test_chaos_is_no_hop(self):
        """The logistic map with the parameter 3.9 has an interval of chaos; a hole in it lets launches out."""
        chaotic = lambda x: 1 + 3.9 * (x - 1) * (2 - x)  # noqa: E731
        found, _ = self.of(self.settled(chaotic, 1.0, 2.0), 1.01, 1.99)
        assert CHAOS in found
        assert "stable" not in found
        top = 1 + 3.9 / 4
        assert found[CHAOS].launches == pytest.approx((chaotic(top), top), abs=2e-3)
        found, _ = self.of(self.settled(chaotic, 1.0, 2.0, lambda x: (x > 1.5) & (x < 1.6)), 1.01, 1.99, 8)
        assert found.keys() == {"rests", UNDECIDED}
        lengths = [sum(b - a for a, b in found[kind].intervals) for kind in ("rests", UNDECIDED)]
        assert sum(lengths) == pytest.approx(0.98, rel=1e-9)
        assert lengths[0] > 0.3

    def test_a_cycle_beside_intervals_too_short_to_be_followed(self, monkeypatch):
        """The hop is kept with the part of its trap that is long enough."""
        settled = self.settled(lambda x: 2.5 - 0.5 * np.tanh(6 * (x - 2.5)) / np.tanh(3))
        found, _ = self.of(settled, 1.0, 4.0)
        assert found["stable"].launches == pytest.approx((2.0, 3.0), rel=1e-12)
        assert length_of(found["stable"].intervals) == pytest.approx(3.0, rel=1e-4)  # all but the fixed point 2.5
        monkeypatch.setattr(module, "DESTINATIONS", module.DESTINATIONS._replace(shortest=0.5))
        found, _ = self.of(settled, 1.0, 4.0)
        assert found["stable"].launches == pytest.approx((2.0, 3.0), rel=1e-12)
        ((low, high),) = found["stable"].intervals
        assert 1.0 <= low < 2.0 < high < 2.5

    def test_launches_that_leave_the_range(self):
        """Launches above 3 rise beyond all bounds, those below fall."""
        found, needed = self.of(self.settled(lambda x: x + 0.5 * (x - 3)), 1.5, 3.8, 60)
        assert np.ravel(found[FASTER].intervals) == pytest.approx([3.0, 3.8], abs=3e-5)
        assert np.ravel(found[SLOWER].intervals) == pytest.approx([1.5, 3.0], abs=3e-5)
        few, _ = self.of(self.settled(lambda x: x + 0.5 * (x - 3)), 1.5, 3.8, 2)
        # After n hops a distance from 3 has grown by 1.5^n: 1 above, and 2 below.
        edges = [1.5, 3 - 2 / 1.5**2, 3 + 1 / 1.5**2, 3.8]
        assert [few[SLOWER].intervals[0][1], few[FASTER].intervals[0][0]] == pytest.approx(edges[1:3], rel=1e-9)
        assert np.ravel(few[UNDECIDED].intervals) == pytest.approx(edges[1:3], rel=1e-9)
        assert needed == 0  # no hop, so that no launch needs hops to one

    def test_a_basin_grows_backward_until_it_is_complete(self):
        """From 1 to 2 a launch comes down to 1, from 2 to 3 to nothing, and a faster one loses 2 in each hop."""

        def function(a):
            return np.where(a < 2, 0.5 * (1 + a), a - 2)

        settled = self.settled(function, 1.0, 20.0, lambda a: (a >= 2) & (a < 3))
        for hops in range(4):
            ends = [(2 * k + 1.0, 2 * k + 2.0) for k in range(hops + 1)]
            found, needed = self.of(settled, 1.0, 20.0, hops, [1.0])
            assert np.ravel(found["lossless"].intervals) == pytest.approx(np.ravel(ends), rel=1e-12)
            assert needed == hops
        found, _ = self.of(settled, 1.0, 20.0, 100, [1.0])
        assert len(found["lossless"].intervals) == 10
        assert UNDECIDED not in found
