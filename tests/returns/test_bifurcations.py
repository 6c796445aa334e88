"""Bifurcation diagrams: against maps in closed form, the local law, brute force on both sides, and simulation."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import slow_after
from return_maps import KnownMaps, of_the_paper

from orbits import InputError, ReturnMap, bifurcations, find, simulate
from orbits.continuation import End
from orbits.curves import Event
from orbits.numerics import bracketed_root
from orbits.returns.bifurcations import _Search, _with_events_at_points
from orbits.returns.periodic_hops import slope_at
from orbits.returns.periodic_launch import PeriodicLaunch
from problems import Chain, HeavyHand, Hopper, hopper_in_si

ALPHA = 4.493409457909064  # tan(alpha) = alpha
C = 3.61694  # of the local law: alpha* + d comes back as alpha* + d - C d^(4/3), below with ten times that


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
    search.periodic(1)
    search.doubled(1)
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
    search.periodic(1)
    search.doubled(1)
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
        return [x.kind for x in _with_events_at_points([end, *points, end]) if isinstance(x, Event)]

    assert kinds([0, 1, 2], [-0.9, -1.0, -0.9]) == kinds([0, 1, 2], [-1.1, -1.0, -1.1]) == []
    assert kinds([0, 1], [-1.0, -1.1]) == kinds([0, 1, 2, 3], [1.0, 1.0, 1.0, 1.0]) == []
    assert kinds([0, 1, 2], [-0.9, -1.0, -1.1]) == ["flip"]
    assert kinds([0, 1, 0], [1.1, 1.0, 0.9]) == ["fold"]
    assert kinds([0, 1, 2], [1.1, 1.0, 0.9]) == ["branch point"]


def fixed_points_along_the_injection(machine, low, high, samples=1001):
    """Injections and slopes by differences of the map without injection, where a launch is a fixed point if the
    injection is what it loses: launch speeds (samples,), injections, multipliers."""
    alpha = np.linspace(low, high, samples)
    step = 1e-6 * alpha
    below, here, above = (ReturnMap(machine)(alpha + side * step).next for side in (-1, 0, 1))
    return alpha, alpha - here, (above - below) / (2 * step)


@pytest.mark.parametrize(
    ("machine", "high", "between"),
    slow_after(
        1, [(Hopper(), 0.05, (4.2, 4.8)), (Hopper("r+r**3"), 0.05, (2.2, 2.8)), (Hopper("r+0.3*r**3"), 0.1, (4.0, 5.0))]
    ),
)
def test_the_fixed_points_beside_a_lossless_hop_are_one_branch(machine, high, between):
    """Brute force: the injection with which a launch comes back is what it loses. The curve of these is one branch that
    turns round at the lossless hop; nothing is listed twice."""
    diagram = bifurcations(machine, "inject", (0.0, high), between, attractor=0)
    (branch,) = (each for each in diagram.branches if each.period == 1)
    alpha, loss, slope = fixed_points_along_the_injection(machine, *between)
    inside = (loss > 1e-4 * high) & (loss < high)
    assert branch.alphas[:, 0].min() < alpha[inside].min() + 1e-3
    assert branch.alphas[:, 0].max() > alpha[inside].max() - 1e-3
    order = np.argsort(branch.alphas[:, 0])
    assert (np.diff(branch.alphas[order, 0]) > 0).all()
    assert branch.values == pytest.approx(branch.alphas[:, 0] - ReturnMap(machine)(branch.alphas[:, 0]).next, abs=1e-12)
    found = np.interp(alpha[inside], branch.alphas[order, 0], branch.multipliers[order])
    assert found == pytest.approx(slope[inside], abs=0.05)
    lossless = find(machine, 2 if between[0] == 4.0 else 1).alpha
    (fold,) = (event for event in diagram.events if event.kind == "fold")
    assert (fold.value, fold.alpha) == (0.0, pytest.approx(lossless, abs=1e-12))
    flips = [event.value for event in diagram.events if event.kind == "flip" and len(event.alphas) == 1]
    passes = np.flatnonzero(inside[1:] & (slope[1:] < -1) & (slope[:-1] >= -1))
    assert flips == pytest.approx([np.interp(1, -slope[[i, i + 1]], loss[[i, i + 1]]) for i in passes], abs=3e-5)
    assert not [event for event in diagram.events if event.border and event.value < 1e-4]


@pytest.mark.slow
def test_a_heavy_foot_bounces_from_throws_of_pi_on():
    """Section 9 of the paper: with a heavy foot the map falls off at pi, where bouncing begins; a branch ends there."""
    asked = {"sections": 2, "attractor": 0, "samples": 60, "cap": 2000}
    diagram = bifurcations(Hopper(mass_ratio=50.0), "inject", (0.1225, 0.124), (3.1, 3.2), **asked)
    (end,) = {end.reason: end for branch in diagram.branches for end in branch.ends if end.kind == "jump"}.values()
    assert "the map jumps" in end.reason
    launches = np.concatenate([branch.alphas.ravel() for branch in diagram.branches])
    assert np.abs(launches - np.pi).min() < 1e-6


@pytest.mark.slow
def test_the_flip_of_the_paper():
    """Curve (d) of Fig. 8, and where hops of period two lose their stability (studies/figure_8.py)."""
    fold, first, second, border = of_the_paper().events
    assert (border.kind, border.border) == ("border collision", "lossless")
    assert (fold.kind, fold.value, fold.note) == ("fold", 0.0, "the lossless hop")
    assert fold.alpha == pytest.approx(ALPHA, abs=1e-14)
    assert (first.kind, first.value) == ("flip", pytest.approx(0.071587384137, abs=2e-12))
    assert first.alpha == pytest.approx(4.541763272853, abs=1e-11)
    assert "begin here, stable, toward greater inject" in first.note
    assert (second.kind, second.value) == ("flip", pytest.approx(0.113429246523, abs=2e-11))
    assert [branch.period for branch in of_the_paper().branches] == [1, 2]
    assert [stable for *_, stable in of_the_paper().branches[0].stretches()] in ([0, 1, 0], [0, 1, 0][::-1])


@pytest.mark.slow
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
    inject = np.array([flip - 4e-3, flip + 4e-3, 0.1])
    alpha = np.full(3, 4.53)
    for _ in range(1200):
        alpha = PLAIN(alpha).next + inject
    following = PLAIN(alpha).next + inject
    for eps, period, *hops in zip(inject, (1, 2, 2), alpha, following, strict=True):
        visited = sorted({round(float(launch), 6) for launch in hops})
        assert len(visited) == period
        known = [launch for kind, launch, slope in diagram.periodic(eps) if kind == period and abs(slope) < 1]
        assert known == pytest.approx(visited, abs=2e-4)
    at_end = diagram.visits[np.isclose(diagram.visits[:, 0], 0.096), 1]
    assert {round(float(alpha), 3) for alpha in at_end} == {
        round(alpha, 3) for period, alpha, _ in diagram.periodic(0.096) if period == 2
    }


@pytest.mark.slow
def test_along_the_damping():
    """Two fixed points beyond the fold and none before it, by the search over all launches, and on either side of the
    border another number of impacts; the hops of period two that begin at the flip are those of a simulation."""
    diagram = bifurcations(Hopper(), "damping", (0.0, 0.01), (4.4, 4.7), inject=0.1, sections=3)
    flip, border, fold = diagram.events
    assert (border.kind, border.border) == ("border collision", "bounce")
    assert (flip.kind, fold.kind) == ("flip", "fold")
    for side, count in ((-1, 2), (1, 0)):
        machine = Hopper(damping=fold.value * (1 + side * 1e-6))
        assert len(ReturnMap(machine, inject=0.1).fixed_points(4.4, 4.7)) == count
    impacts = []
    for side in (-1, 1):
        step = ReturnMap(Hopper(damping=border.value + side * 1e-9), inject=0.1)
        impacts.append(int(step(step.fixed_points(border.alpha - 1e-4, border.alpha + 1e-4, 20)[0].alpha).impacts))
    assert impacts[0] != impacts[1]
    for side in (-1, 1):
        machine = Hopper(damping=flip.value * (1 + side * 1e-4))
        upper = ReturnMap(machine, inject=0.1).fixed_points(4.4, 4.7)[-1]
        assert (upper.multiplier + 1) * side > 0
    doubled = diagram.branches[1]
    i = len(doubled) // 2
    run = simulate(Hopper(damping=float(doubled.values[i])), float(doubled.alphas[i, 0]), hops=2, inject=0.1)
    first, second = doubled.alphas[i]
    assert run.launches == pytest.approx([first, second, first], abs=1e-8)


def test_a_fold_just_beside_a_border():
    """Both lie on one step, at launches 1e-6 apart: two fixed points before the fold and none behind it."""
    machine, options = Hopper(mass_ratio=2.378), {"inject": 0.023, "sections": 2, "samples": 60}
    border, fold = bifurcations(machine, "damping", (0.0, 0.01), (4.053, 4.776), **options).events
    assert (border.kind, fold.kind) == ("border collision", "fold")
    assert fold.alpha - border.alpha == pytest.approx(-1.087569e-6, rel=1e-3)
    counts = []
    for side in (-1, 1):
        step = ReturnMap(Hopper(mass_ratio=2.378, damping=fold.value * (1 + side * 1e-4)), inject=0.023)
        counts.append(len(step.fixed_points(4.4, 4.6, 200)))
    assert counts == [2, 0]


@pytest.mark.slow
def test_in_si_as_without_units():
    """Events in units of the launch speed, of a machine whose numbers are in SI."""
    leg = hopper_in_si(60.0, 60.0, force="k*r", parameters={"k": 8000.0}, rest_length=0.8)
    speed = find(leg).alpha / ALPHA
    asked = {"sections": 2, "attractor": 0}
    diagram = bifurcations(leg, "inject", (0.0, 0.1 * speed), (4.4 * speed, 4.7 * speed), **asked)
    assert [event.value / speed for event in diagram.events] == pytest.approx([0.0, 0.071587384137], abs=1e-10)
    assert diagram.heading("inject") == "inject (m/s)"
    assert "m/s" in str(diagram)
    reasons = {end.reason for branch in diagram.branches for end in branch.ends if end.kind == "reached"}
    assert reasons == {f"inject = {0.1 * speed:g} m/s is reached"}
    assert diagram.plot().get_ylabel() == "launch speed α (m/s)"


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        (("speed", (0, 1), (4, 5)), {}, "no parameter 'speed'; it has inject, restitution, damping"),
        (("inject", (1, 0), (4, 5)), {}, "low must be below high"),
        (("inject", 3, (4, 5)), {}, "it must be a pair"),
        (("inject", (0, 1), (-1, 5)), {}, "launch speeds must be above 0"),
        (("inject", (0, 1), (4, 5)), {"inject": 0.1}, "already states inject: leave it out"),
        (("inject", (0, 1), (4, 5)), {"sections": 1}, "sections = 1"),
        (("inject", (0, 1), (4, 5)), {"periods": 3}, "a list of numbers of hops"),
        (("inject", (0, 1), (4, 5)), {"samples": 1}, "samples = 1"),
        (("mass_ratio", (1, 2), (4, 5)), {}, "every fixed point here is a lossless hop"),
        (("restitution", (0, 0.5), (4, 5)), {}, "every fixed point here is a lossless hop"),
        (("restitution", (0, 1.5), (4, 5)), {"inject": 0.1}, "restitution = 1.5"),
        (("damping", (-1, 0.5), (4, 5)), {"inject": 0.1}, "damping"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant(arguments, options, words):
    with pytest.raises(InputError, match=words):
        bifurcations(Hopper(), *arguments, **options)


def test_nothing_comes_back_with_damping_alone():
    """Curve (a) of Fig. 8: without injection the map loses its contact with the identity line."""
    diagram = bifurcations(Hopper(damping=0.01), "damping", (0.01, 0.02), (4.4, 4.6), sections=2, samples=50)
    assert diagram.branches == ()
    assert "no launch of period one comes back" in str(diagram)
    with pytest.raises(InputError, match="nothing to draw"):
        diagram.plot()


@pytest.mark.parametrize("restitution", slow_after(1, [0.0, 0.3]))
def test_impacts_that_lose_nothing_have_no_attractor_with_injection(restitution):
    """Launches from a heavy hand become faster for ever; without an injection all that end in contact come back."""
    diagram = bifurcations(HeavyHand(restitution=restitution), "inject", (0.0, 0.15), (3.8, 4.9), samples=20)
    assert diagram.branches == ()
    assert set(diagram.visits[:, 0]) <= {0.0}
    hops = ReturnMap(HeavyHand(restitution=restitution))(np.linspace(3.8, 4.9, 6)[1:-1])
    stay = hops.alpha[hops.status == "lifts_off"]
    assert np.unique(diagram.visits[:, 1]) == pytest.approx(stay, rel=1e-14)


PLAIN = ReturnMap(Hopper())


def after(alpha, inject, hops):
    """The launch speed after hops of the map."""
    for _ in range(hops):
        alpha = float(PLAIN(alpha).next) + inject
    return alpha


def slope_of(alpha, inject, hops):
    """The multiplier of the hops that come back near a launch speed, by Newton's method on the map."""
    for _ in range(3):
        slope, launch = 1.0, alpha
        for _ in range(hops):
            slope, launch = slope * slope_at(PLAIN, launch), after(launch, inject, 1)
        alpha -= (launch - alpha) / (slope - 1)
    return slope


@pytest.fixture(scope="module")
def of_period_three():
    return bifurcations(Hopper(), "inject", (0.1332, 0.1402), (4.4, 4.75), periods=(3,), sections=3, attractor=0)


@pytest.mark.slow
def test_flips_folds_and_borders_equal_those_of_bisection_on_the_map(of_period_three):
    fold, flip, *_ = [event for event in of_period_three.events if len(event.alphas) == 3]
    (border,) = (event for event in of_period_three.events if len(event.alphas) == 3 and event.border)
    star = find(Hopper()).alpha
    assert (fold.kind, flip.kind, border.kind) == ("fold", "flip", "border collision")
    at = lambda inject: after(star, inject, 3) - star  # noqa: E731
    assert at(border.value - 1e-12) * at(border.value + 1e-12) < 0
    assert border.border == "lossless"
    assert border.sides[0] == pytest.approx(border.sides[1], abs=1e-9)
    at = lambda inject: slope_of(flip.alpha, inject, 3) + 1  # noqa: E731
    assert at(flip.value - 1e-11) * at(flip.value + 1e-11) < 0
    # The least injection at which a launch near that of the fold comes back.
    comes_back = lambda alpha: lambda inject: after(alpha, inject, 3) - alpha  # noqa: E731
    least = []
    for alpha in fold.alpha + 1e-7 * np.array([-1.0, 0.0, 1.0]):
        function, ends = comes_back(alpha), (fold.value - 1e-9, fold.value + 1e-9)
        least.append(bracketed_root(function, *ends, *map(function, ends)))
    low, middle, high = least
    parabola = middle - (high - low) ** 2 / (8 * (high - 2 * middle + low))
    assert parabola == pytest.approx(fold.value, abs=1e-11)


def test_hops_of_a_period_are_those_of_the_search(of_period_three):
    found = of_period_three.periodic(0.1376)
    known = ReturnMap(Hopper(), inject=0.1376).periodic_hops(3, 4.4, 4.75)
    launches = sorted(alpha for period, alpha, _ in found if period == 3)
    assert launches == pytest.approx(sorted(np.ravel([each.launches for each in known])), abs=1e-4)
    assert {branch.period for branch in of_period_three.branches} == {3, 6}
    table = of_period_three.table()
    assert len(table["alpha 3"]) == len(table["alpha"])
    assert "hops of period six begin here, stable, toward greater inject" in " ".join(str(of_period_three).split())


@pytest.mark.slow
def test_a_cascade_of_flips_has_feigenbaums_ratio():
    diagram = bifurcations(
        Hopper(), "inject", (0.1342, 0.13457), (4.474, 4.631), periods=(3,), doublings=4, sections=2, attractor=0
    )
    flips = [event.value for event in diagram.events if event.kind == "flip"]
    assert [len(event.alphas) for event in diagram.events] == [3, 6, 12, 24, 48]
    ratios = [(b - a) / (c - b) for a, b, c in zip(flips, flips[1:], flips[2:], strict=False)]
    assert ratios == pytest.approx([4.3126, 4.5789, 4.6511], abs=1e-3)
    assert ratios[-1] == pytest.approx(4.6692016, rel=5e-3)


def test_periods_of_launches_of_several_numbers_come_from_starts():
    with pytest.raises(InputError, match="give starts="):
        bifurcations(Chain((1, 1, 1)), "inject", (0.001, 0.01), (6.0, 6.7), periods=(2,))
