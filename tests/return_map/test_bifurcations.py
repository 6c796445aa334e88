"""Bifurcation diagrams: against maps in closed form, the local law, brute force on both sides, and simulation."""

import json
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from orbits import InputError, ReturnMap, bifurcations, find, multiplier, simulate
from orbits.continuation.point import End
from orbits.return_map.bifurcations import _Search, _with_events_at_points
from orbits.return_map.branches import BranchTracer, FoundEvent, PeriodicLaunch
from orbits.return_map.cycles import MapsAlong
from orbits.return_map.diagram import BifurcationDiagram, Branch
from problems import Hopper, hopper_in_si

ALPHA = 4.493409457909064  # tan(alpha) = alpha
C = 3.61694  # of the local law: alpha* + d comes back as alpha* + d - C d^(4/3), below with ten times that


class KnownMaps(MapsAlong):
    """Maps in closed form in place of a machine's: next(a, value), slope(a, value), impacts(a), where they jump."""

    def __init__(self, low, high, following, slope, impacts=lambda a: np.ones(len(a), int), jump=None):
        self.name, self.low, self.high = "value", low, high
        self.following, self.slope, self.count, self.jump = following, slope, impacts, jump

    def hops(self, alpha, value):
        return SimpleNamespace(next=self.following(np.asarray(alpha), value), impacts=self.count(np.asarray(alpha)))

    def multiplier(self, launches, value):
        return float(np.prod([self.slope(a, value) for a in launches]))

    def jumps_between(self, alphas, value, samples=33):
        return self.jump is not None and alphas[0] < self.jump < alphas[1]

    def status(self, alpha, value):
        return "lifts_off" if np.isfinite(self.following(np.array([alpha]), value)[0]) else "rests"


def traced(maps, between, alpha, value, side=1, period=1):
    """The points, events and the end of a branch from a periodic launch; the side is that of growing parameters."""
    tracer = BranchTracer(maps, between, period, (), 0.02)
    start = tracer.start(alpha, value)
    items = list(tracer.trace(start, side * (1 if start.tangent[1] > 0 else -1)))
    points = [item for item in items if isinstance(item, PeriodicLaunch)]
    return points, [item for item in items if isinstance(item, FoundEvent)], items[-1]


LOGISTIC = KnownMaps(2.5, 3.6, lambda a, r: r * a * (1 - a), lambda a, r: r * (1 - 2 * a))


def test_the_logistic_map_doubles_its_period():
    """Fixed points 1 - 1/r up to the flip at r = 3; hops of period two up to r = 1 + sqrt(6), with 4 + 2 r - r^2."""
    points, (flip,), end = traced(LOGISTIC, (0.1, 0.99), 0.6, 2.5)
    assert end.kind == "reached"
    assert points[-1].value == 3.6
    for point in points:
        assert point.alphas[0] == pytest.approx(1 - 1 / point.value, abs=1e-12)
    assert (flip.kind, flip.point.value) == ("flip", pytest.approx(3.0, abs=1e-11))
    tracer = BranchTracer(LOGISTIC, (0.1, 0.99), 2, (), 0.02)
    items = list(tracer.trace(tracer.start_beside_flip(flip.point), 1))
    for point in (item for item in items if isinstance(item, PeriodicLaunch)):
        r, root = point.value, np.sqrt((point.value - 3) * (point.value + 1))
        assert sorted(point.alphas) == pytest.approx([(r + 1 - root) / (2 * r), (r + 1 + root) / (2 * r)], abs=1e-10)
        assert point.multiplier == pytest.approx(4 + 2 * r - r**2, abs=1e-8)
    (second,) = (item for item in items if isinstance(item, FoundEvent))
    assert (second.kind, second.point.value) == ("flip", pytest.approx(1 + np.sqrt(6), abs=1e-10))


class BackAndForth(KnownMaps):
    """The logistic map with r = 3.2 - v^2, which comes to its flip at r = 3 twice."""

    def __init__(self):
        super().__init__(-1.0, 1.0, lambda a, v: (3.2 - v**2) * a * (1 - a), lambda a, v: (3.2 - v**2) * (1 - 2 * a))

    def at(self, value):
        return SimpleNamespace(fixed_points=lambda *_: [SimpleNamespace(alpha=1 - 1 / (3.2 - value**2))])

    def lossless(self, value):
        return False


def test_hops_of_period_two_between_two_flips_are_one_branch():
    search = _Search(BackAndForth(), (0.1, 0.99), [-1.0, -0.5, 1.0], 100, None)
    search.fixed_points()
    search.doubled()
    first, second = search.located()
    assert (first.value, second.value) == pytest.approx((-np.sqrt(0.2), np.sqrt(0.2)), abs=1e-11)
    assert "begin here, stable, toward greater value" in first.note
    assert second.note == "the hops of period two end here"
    single, double = search.branches
    assert (single.period, double.period) == (1, 2)
    assert double.values[[0, -1]] == pytest.approx([first.value, second.value], abs=1e-11)
    assert double.alphas[[0, -1]] == pytest.approx(2 / 3, abs=1e-11)
    assert [end.kind for end in double.ends] == ["flip", "flip"]
    assert [stable for *_, stable in double.stretches()] == [True]


class AlwaysAtOne(KnownMaps):
    """1 - (1 + v) d + d^3 with d = a - 1: fixed points 1, a flip at v = 0 exactly, and hops of period two with
    d^2 = v, whose multiplier is (1 - 2 v)^2."""

    def __init__(self):
        super().__init__(
            -0.5, 0.5, lambda a, v: 1 - (1 + v) * (a - 1) + (a - 1) ** 3, lambda a, v: -(1 + v) + 3 * (a - 1) ** 2
        )

    def at(self, value):
        return SimpleNamespace(fixed_points=lambda *_: [SimpleNamespace(alpha=1.0)])

    def lossless(self, value):
        return False


@pytest.mark.parametrize("section", [0.0, -1e-3, -0.3])
def test_a_flip_at_a_point_of_its_branch(section):
    """The branch begins at the flip, or comes to it by a first step of 1/1000 of the range, or passes it."""
    search = _Search(AlwaysAtOne(), (0.5, 1.9), [section], 100, None)
    search.fixed_points()
    search.doubled()
    (flip,) = (event for event in search.located() if event.branch == 0)
    assert (flip.kind, flip.value, flip.multiplier) == ("flip", pytest.approx(0.0, abs=1e-12), -1.0)
    single, double = search.branches
    assert (single.values[[0, -1]], double.period) == (pytest.approx(sorted([-0.5, 0.5]), abs=1e-12), 2)
    assert len(np.unique(single.values)) == len(single)
    assert (double.alphas - 1) ** 2 == pytest.approx(np.column_stack([double.values] * 2), abs=1e-10)
    inner = double.values > 1e-6
    assert double.multipliers[inner] == pytest.approx((1 - 2 * double.values[inner]) ** 2, abs=1e-7)


def test_a_multiplier_that_touches_a_level_is_no_bifurcation():
    end, place = End("reached", ""), np.zeros(2)

    def kinds(values, slopes):
        points = [PeriodicLaunch(v, (1.0,), s, (1,), place, place) for v, s in zip(values, slopes, strict=True)]
        return [x.kind for x in _with_events_at_points([end, *points, end]) if isinstance(x, FoundEvent)]

    assert kinds([0, 1, 2], [-0.9, -1.0, -0.9]) == kinds([0, 1, 2], [-1.1, -1.0, -1.1]) == []
    assert kinds([0, 1], [-1.0, -1.1]) == kinds([0, 1, 2, 3], [1.0, 1.0, 1.0, 1.0]) == []
    assert kinds([0, 1, 2], [-0.9, -1.0, -1.1]) == ["flip"]
    assert kinds([0, 1, 0], [1.1, 1.0, 0.9]) == ["fold"]
    assert kinds([0, 1, 2], [1.1, 1.0, 0.9]) == ["branch point"]


def test_a_branch_without_multipliers_is_not_called_unstable(tmp_path):
    end = End("reached", "")
    values, slopes = np.arange(6.0), np.array([0.5, np.nan, 0.6, np.nan, np.nan, 2.0])
    branch = Branch(1, values, values[:, None] + 5, slopes, (end, end))
    assert branch.stable == [True, None, True, None, None, False]
    assert branch.stretches() == [(0.0, 3.0, True), (3.0, 4.0, None), (4.0, 5.0, False)]
    machine = {"machine": "known", "spring": "r", "gravity": "1"}
    diagram = BifurcationDiagram("v", (0.0, 5.0), (4.0, 11.0), machine, (branch,), ())
    document = json.loads(diagram.save(tmp_path / "diagram.json").read_text())
    assert document["branches"][0]["stable"] == [True, None, True, None, None, False]
    table = diagram.save(tmp_path / "diagram.csv").read_text().splitlines()
    assert table[2] == "0,1,1,6,,,"
    assert "v = 3 to 4: stability unknown" in str(diagram)
    labels = diagram.plot().get_legend_handles_labels()[1]
    assert labels == [f"fixed points, {each}" for each in ("stable", "stability unknown", "unstable")]


def test_a_stable_stretch_between_bifurcations_that_follow_each_other():
    """No point lies between the fold and the flip, nor between the flip and the border collision."""
    end = End("reached", "")
    values, slopes = np.array([1.0, 0.0, 2.0, 3.0, 4.0]), np.array([1.4, 1.0, -1.0, np.nan, 0.3])
    branch = Branch(1, values, np.ones((5, 1)), slopes, (end, end))
    assert branch.stretches() == [(1.0, 0.0, False), (0.0, 2.0, True), (2.0, 3.0, False), (3.0, 4.0, True)]


def test_periodic_launches_at_the_ends_and_at_points_of_a_branch():
    end = End("reached", "")
    values = np.array([0.0, 1.0, 2.0])
    branch = Branch(1, values, values[:, None] + 5, values / 2, (end, end))
    back = Branch(1, values[::-1], values[::-1, None] + 8, values[::-1] / 2, (end, end))
    diagram = BifurcationDiagram("v", (0.0, 2.0), (4.0, 11.0), {}, (branch, back), ())
    for value in (0.0, 0.25, 1.0, 2.0):
        assert diagram.periodic(value) == [(1, value + 5, value / 2), (1, value + 8, value / 2)]
    assert diagram.periodic(2.1) == []
    around, closed = np.array([0.0, 1.0, 0.0]), End("closed", "")
    branch = Branch(1, around, np.array([[5.0], [6.0], [5.0]]), around, (closed, closed))
    assert BifurcationDiagram("v", (0.0, 1.0), (4.0, 7.0), {}, (branch,), ()).periodic(0.0) == [(1, 5.0, 0.0)]


def test_a_fold_and_what_lies_on_both_sides_of_it():
    """a + v - (a - 1)^2 has the fixed points 1 +- sqrt(v), a fold at 0 and a flip at (2, 1)."""
    maps = KnownMaps(-0.5, 1.44, lambda a, v: a + v - (a - 1) ** 2, lambda a, v: 1 - 2 * (a - 1))
    points, events, end = traced(maps, (0.1, 3.0), 2.1, 1.21, side=-1)
    assert [event.kind for event in events] == ["flip", "fold"]
    assert (events[0].point.value, events[0].point.alphas[0]) == pytest.approx((1.0, 2.0), abs=1e-10)
    assert (events[1].point.value, events[1].point.alphas[0]) == pytest.approx((0.0, 1.0), abs=1e-10)
    assert (points[-1].alphas[0] - 1) ** 2 == pytest.approx(points[-1].value, abs=1e-11)
    assert end.kind == "left"
    assert points[-1].alphas[0] == pytest.approx(0.1, abs=1e-15)


@pytest.mark.parametrize("side", [1, -1])
def test_a_closed_curve_of_fixed_points_ends_where_it_began(side):
    """The fixed points of a + 0.3 ((a - 1)^2 + v^2 - 0.04) are the circle of radius 0.2 round (1, 0)."""
    maps = KnownMaps(-0.5, 0.5, lambda a, v: a + 0.3 * ((a - 1) ** 2 + v**2 - 0.04), lambda a, v: 1 + 0.6 * (a - 1))
    points, events, end = traced(maps, (0.1, 3.0), 1.2, 0.0, side=side)
    assert end.kind == "closed"
    assert [(event.kind, event.point.value) for event in events] == [
        ("fold", pytest.approx(side * 0.2, abs=1e-12)), ("fold", pytest.approx(-side * 0.2, abs=1e-12)),
    ]  # fmt: skip
    assert max(abs((point.alpha - 1) ** 2 + point.value**2 - 0.04) for point in points) < 1e-14


def test_a_branch_ends_where_the_map_jumps():
    """The fixed points of the logistic map come to a = 0.7 at r = 1/0.3; those behind belong to another curve."""
    for size in (0.05, 1e-3):
        maps = KnownMaps(
            2.6, 3.6,
            lambda a, r, size=size: r * a * (1 - a) + np.where(a > 0.7, size, 0.0), LOGISTIC.slope,
            lambda a: np.where(a > 0.7, 2, 1), 0.7,
        )  # fmt: skip
        points, _, end = traced(maps, (0.1, 0.99), 1 - 1 / 3.1, 3.1)
        assert end.kind == "jump"
        assert "the map jumps" in end.reason
        assert points[-1].alphas[0] <= 0.7
        assert points[-1].value <= 1 / 0.3 + 1e-9


def test_a_number_of_impacts_that_changes_without_a_jump_is_no_end():
    maps = KnownMaps(2.6, 3.6, LOGISTIC.following, LOGISTIC.slope, lambda a: np.where(a > 0.7, 2, 1), 0.7)
    assert traced(maps, (0.1, 0.99), 1 - 1 / 3.1, 3.1)[2].kind == "reached"


@pytest.mark.parametrize(("below", "behind"), [(0.5, -1.5), (2.0, 0.5), (0.5, 3.0)])
def test_corners_of_the_map(below, behind):
    """Slopes that jump at a = 1, where the fixed point is at v = 0: one that goes on, and two that meet there."""

    def slope(a, v):
        return below if a < 1 else behind

    maps = KnownMaps(-0.5, 0.5, lambda a, v: 1 + v + np.where(a < 1, below, behind) * (a - 1), slope)
    value = 0.2 if below > 1 else -0.2
    points, events, _ = traced(maps, (0.1, 3.0), 1 + value / (1 - below), value, side=-np.sign(value))
    assert {event.kind for event in events} == {"border collision"}
    assert events[0].point.value == pytest.approx(0.0, abs=1e-5)
    assert points[-1].alphas[0] > 1
    assert points[-1].alphas[0] - 1 == pytest.approx(points[-1].value / (1 - behind), abs=1e-9)


def test_a_branch_ends_where_hops_have_no_next():
    maps = KnownMaps(2.6, 3.6, lambda a, r: np.where(a > 0.7, np.nan, r * a * (1 - a)), LOGISTIC.slope)
    points, _, end = traced(maps, (0.1, 0.99), 1 - 1 / 3.1, 3.1)
    assert end.kind == "no launch"
    assert "the contact never ends" in end.reason
    assert points[-1].value == pytest.approx(1 / 0.3, abs=1e-5)


def test_a_heavy_foot_bounces_from_throws_of_pi_on():
    """Section 9 of the paper: with a heavy foot the map falls off at pi, where bouncing begins; a branch ends there."""
    asked = {"sections": 2, "attractor": 0, "samples": 60, "cap": 2000}
    diagram = bifurcations(Hopper(mass_ratio=50.0), "inject", (0.1225, 0.124), (3.1, 3.2), **asked)
    (end,) = {end.reason: end for branch in diagram.branches for end in branch.ends if end.kind == "jump"}.values()
    assert "the map jumps" in end.reason
    launches = np.concatenate([branch.alphas.ravel() for branch in diagram.branches])
    assert np.abs(launches - np.pi).min() < 1e-6


@cache
def of_the_paper():
    return bifurcations(Hopper(), "inject", (0.0, 0.12), (4.4, 4.7), sections=3, attractor=6)


def test_the_flip_of_the_paper():
    """Curve (d) of Fig. 8, and where hops of period two lose their stability (studies/figure_8.py)."""
    fold, first, second = of_the_paper().events
    assert (fold.kind, fold.value, fold.note) == ("fold", 0.0, "the lossless hop")
    assert fold.alpha == pytest.approx(ALPHA, abs=1e-14)
    assert (first.kind, first.value) == ("flip", pytest.approx(0.071587384137, abs=2e-12))
    assert first.alpha == pytest.approx(4.541763272853, abs=1e-11)
    assert "begin here, stable, toward greater inject" in first.note
    assert (second.kind, second.value) == ("flip", pytest.approx(0.113429246523, abs=2e-11))
    assert [branch.period for branch in of_the_paper().branches] == [1, 2]
    assert [stable for *_, stable in of_the_paper().branches[0].stretches()] in ([0, 1, 0], [0, 1, 0][::-1])


def test_every_point_comes_back():
    for branch in of_the_paper().branches:
        for value, alphas, slope in zip(branch.values, branch.alphas, branch.multipliers, strict=True):
            hops = ReturnMap(Hopper(), inject=float(value))(alphas)
            np.testing.assert_allclose(np.roll(hops.next, 1), alphas, rtol=0, atol=3e-11)
            if branch.period == 1 and abs(alphas[0] - ALPHA) > 1e-3:
                assert multiplier(Hopper(), float(alphas[0])) == pytest.approx(slope, rel=1e-9)


def test_the_local_law_beside_the_lossless_hop():
    """eps = C d^(4/3) above and 10 C |d|^(4/3) below, to a relative error that vanishes like d^(1/3)."""
    branch = of_the_paper().branches[0]
    d, eps = branch.alphas[:, 0] - ALPHA, branch.values
    for side, coefficient in ((1, C), (-1, 10 * C)):
        near = (side * d > 1e-8) & (side * d < 1e-3)
        size = np.abs(d[near])
        error = np.abs(eps[near] / size ** (4 / 3) / coefficient - 1)
        assert near.sum() > 3
        assert (error < 6 * size ** (1 / 3)).all()
        assert error[np.argmin(size)] < 0.05


@pytest.mark.slow
def test_brute_force_on_both_sides_of_a_flip():
    """Hops that have settled repeat every time before the flip, every second time behind it, and as the branches say;
    what the attractor of the diagram visits is the same."""
    diagram, flip = of_the_paper(), of_the_paper().events[1].value
    for eps, period in ((flip - 4e-3, 1), (flip + 4e-3, 2), (0.1, 2)):
        step, alpha = ReturnMap(Hopper(), inject=eps), np.array([4.53])
        for _ in range(1200):
            alpha = step(alpha).next
        visited = sorted({round(float(alpha[0]), 6), round(float(step(alpha).next[0]), 6)})
        assert len(visited) == period
        known = [launch for kind, launch, slope in diagram.periodic(eps) if kind == period and abs(slope) < 1]
        assert known == pytest.approx(visited, abs=2e-4)
    at_end = diagram.visits[np.isclose(diagram.visits[:, 0], 0.096), 1]
    assert {round(float(alpha), 3) for alpha in at_end} == {
        round(alpha, 3) for period, alpha, _ in diagram.periodic(0.096) if period == 2
    }


def test_the_diagram_as_document_table_and_figure(tmp_path):
    diagram = of_the_paper()
    document = json.loads(diagram.save(tmp_path / "diagram.json").read_text())
    assert [event["kind"] for event in document["events"]] == ["fold", "flip", "flip"]
    assert len(document["branches"][1]["alpha"][0]) == 2
    table = diagram.save(tmp_path / "diagram.csv").read_text().splitlines()
    assert table[0] == "branch,period,inject,alpha,other alpha,multiplier,stable"
    assert len(table) == 1 + sum(map(len, diagram.branches))
    axes = diagram.plot()
    labels = axes.get_legend_handles_labels()[1]
    assert {"fixed points, stable", "fixed points, unstable", "period two, stable", "fold", "flip"} <= set(labels)
    assert len(labels) == len(set(labels))
    assert f"{'flip':<24}inject = 0.0715873841" in str(diagram)
    assert "\n" not in repr(diagram)
    with pytest.raises(InputError, match="needs an ending"):
        diagram.save(tmp_path / "diagram.txt")


@pytest.mark.slow
def test_along_the_damping():
    """Two fixed points beyond the fold and none before it, by the search over all launches; the hops of period two
    that begin at the flip are those of a simulation."""
    diagram = bifurcations(Hopper(), "damping", (0.0, 0.01), (4.4, 4.7), inject=0.1, sections=3)
    flip, fold = diagram.events
    assert (flip.kind, fold.kind) == ("flip", "fold")
    for side, count in ((-1, 2), (1, 0)):
        machine = Hopper(damping=fold.value * (1 + side * 1e-6))
        assert len(ReturnMap(machine, inject=0.1).fixed_points(4.4, 4.7)) == count
    for side in (-1, 1):
        machine = Hopper(damping=flip.value * (1 + side * 1e-4))
        upper = ReturnMap(machine, inject=0.1).fixed_points(4.4, 4.7)[-1]
        assert (upper.multiplier + 1) * side > 0
    doubled = diagram.branches[1]
    i = len(doubled) // 2
    run = simulate(Hopper(damping=float(doubled.values[i])), float(doubled.alphas[i, 0]), hops=2, inject=0.1)
    first, second = doubled.alphas[i]
    assert run.launches == pytest.approx([first, second, first], abs=1e-8)


@pytest.mark.slow
def test_in_si_as_without_units():
    """The same events in units of the launch speed's, of a machine whose numbers are in SI."""
    leg = hopper_in_si(60.0, 60.0, force="k*r", parameters={"k": 8000.0}, rest_length=0.8)
    speed = find(leg).alpha / ALPHA
    asked = {"sections": 2, "attractor": 0}
    diagram = bifurcations(leg, "inject", (0.0, 0.1 * speed), (4.4 * speed, 4.7 * speed), **asked)
    assert [event.value / speed for event in diagram.events] == pytest.approx([0.0, 0.071587384137], abs=1e-10)
    assert diagram.heading("inject") == "inject (m/s)"
    assert "m/s" in str(diagram)
    reasons = {end.reason for branch in diagram.branches for end in branch.ends if end.kind == "reached"}
    assert reasons == {f"inject = {0.1 * speed:g} m/s is reached"}
    assert diagram.plot().get_ylabel() == "launch speed (m/s)"


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        (("speed", (0, 1), (4, 5)), {}, "no parameter 'speed'; it has inject, restitution, damping"),
        (("inject", (1, 0), (4, 5)), {}, "a range goes up"),
        (("inject", 3, (4, 5)), {}, "it is a pair"),
        (("inject", (0, 1), (-1, 5)), {}, "launch speeds are above 0"),
        (("inject", (0, 1), (4, 5)), {"inject": 0.1}, "the range says it all"),
        (("inject", (0, 1), (4, 5)), {"sections": 1}, "sections = 1"),
        (("inject", (0, 1), (4, 5)), {"samples": 1}, "samples = 1"),
        (("mass_ratio", (1, 2), (4, 5)), {}, "every fixed point is a lossless hop"),
        (("restitution", (0, 0.5), (4, 5)), {}, "every fixed point is a lossless hop"),
        (("restitution", (0, 1.5), (4, 5)), {"inject": 0.1}, "restitution = 1.5"),
        (("damping", (-1, 0.5), (4, 5)), {"inject": 0.1}, "damping"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant(arguments, options, words):
    with pytest.raises(InputError, match=words):
        bifurcations(Hopper(), *arguments, **options)


@pytest.mark.parametrize("name", ["period", "multiplier", "kind"])
def test_a_parameter_that_a_document_could_not_tell(name):
    machine = Hopper(f"r + {name}*r**3", parameters={name: 0.1}, damping=0.01)
    with pytest.raises(InputError, match="give it another name"):
        bifurcations(machine, name, (0.0, 0.2), (4, 5), inject=0.05)


def test_nothing_comes_back_with_damping_alone():
    """Curve (a) of Fig. 8: without injection the map loses its contact with the identity line."""
    diagram = bifurcations(Hopper(damping=0.01), "damping", (0.01, 0.02), (4.4, 4.6), sections=2, samples=50)
    assert diagram.branches == ()
    assert "no launch of period one comes back" in str(diagram)
    with pytest.raises(InputError, match="nothing to draw"):
        diagram.plot()


def test_ends_are_told_in_words():
    assert End("jump", "the map jumps") == End("jump", "the map jumps")
    assert all(end.kind == "reached" for end in of_the_paper().branches[0].ends)
    assert of_the_paper().branches[1].ends[0].kind == "flip"
