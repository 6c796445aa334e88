"""Curves of flips, folds and border collisions against bisection on the map at values of the second parameter."""

import pickle

import numpy as np
import pytest
from conftest import slow_after

from orbits import Bifurcation, BifurcationCurve, BifurcationDiagram, InputError, NoOrbit, ReturnMap, find, multiplier
from orbits.model import machine_in_words
from orbits.numerics import bracketed_root
from orbits.returns.followed_events import follow_bifurcation, located
from problems import Chain, Hopper, rimless_wheel

FLIP = Bifurcation("flip", 0.07158738413734, (4.54176327285,))  # design fact 6: M = 1, family 1
WITH_DAMPER = Bifurcation("flip", 0.00144694441776, (4.54542056184,))
FOLD = Bifurcation("fold", 0.00573688777873, (4.4962210425,))


def by_bisection(test, low: float, high: float) -> float:
    return bracketed_root(test, low, high, test(low), test(high), width=1e-14)


def fixed_point(machine: Hopper, eps: float, low: float, high: float) -> float:
    """The fixed point between two launch speeds, where the map crosses the identity line."""
    return by_bisection(lambda alpha: float(ReturnMap(machine, inject=eps)(alpha).next) - alpha, low, high)


@pytest.mark.slow
def test_flips_along_the_mass_ratio():
    curve = follow_bifurcation(Hopper(), "inject", FLIP, "mass_ratio", 2.0, at=[1.25], longest=0.5)
    for mass_ratio, low, high in ((1.25, 0.0742, 0.0743), (2.0, 0.102, 0.1021)):
        machine = Hopper(mass_ratio=mass_ratio)
        excess = lambda eps, machine=machine: multiplier(machine, fixed_point(machine, eps, 4.54, 4.57)) + 1  # noqa: E731
        assert curve.at(mass_ratio)[0] == pytest.approx(by_bisection(excess, low, high), abs=1e-11)
    assert curve.end.kind == "reached"
    assert curve.impacts == (1,)


@pytest.mark.slow
def test_with_a_damper():
    """Landings then change all rates: a flip and a fold, in the damping and the injection."""
    machine = Hopper(damping=0.001)
    for event, slope in ((WITH_DAMPER, -1.0), (FOLD, 1.0)):
        curve = follow_bifurcation(machine, "damping", event, "inject", 0.102, inject=0.1, longest=0.5)
        assert curve.values[0] == pytest.approx([event.value, 0.1], abs=1e-11)
        (damping, eps), alpha = curve.values[-1], float(curve.alphas[-1, 0])
        last = Hopper(damping=damping)
        assert float(ReturnMap(last, inject=eps)(alpha).next) == pytest.approx(alpha, abs=1e-12)
        assert multiplier(last, alpha) == pytest.approx(slope, abs=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(("second", "stop"), slow_after(1, [("mass_ratio", 1.1), ("gap", 0.55)]))
def test_flips_of_a_law_in_pieces(second, stop):
    """Motions pass the corner of a bilinear spring, which moves with the gap."""
    flip = Bifurcation("flip", 0.117402577457623, (3.462843548966,))
    curve = follow_bifurcation(Hopper("bilinear"), "inject", flip, second, stop, longest=0.5)
    assert curve.values[0, 0] == pytest.approx(flip.value, abs=1e-11)
    machine, value, alpha = Hopper("bilinear", parameters={second: stop}) if second == "gap" else Hopper(
        "bilinear", mass_ratio=stop), *curve.values[-1, :1], curve.alphas[-1, 0]  # fmt: skip
    excess = lambda eps: multiplier(machine, fixed_point(machine, eps, alpha - 1e-3, alpha + 1e-3)) + 1  # noqa: E731
    assert by_bisection(excess, value - 1e-5, value + 1e-5) == pytest.approx(value, abs=1e-10)


def graze(mass_ratio: float, low: float, high: float) -> float:
    """The launch speed between two at which the number of impacts changes, by bisection."""
    step = ReturnMap(Hopper(mass_ratio=mass_ratio))
    first = int(step(low).impacts)
    return by_bisection(lambda alpha: 1.0 if int(step(alpha).impacts) == first else -1.0, low, high)


@pytest.mark.parametrize(("low", "high"), slow_after(1, [(7.07615, 7.0761), (6.93, 6.9315), (6.9315, 6.93)]))
def test_borders_where_the_foot_grazes_the_ground(low, high):
    """From either side of the border: with the impact that vanishes, and without it."""
    alpha = graze(10.0, low, high)
    eps = alpha - float(ReturnMap(Hopper(mass_ratio=10.0))(alpha).next)
    event = Bifurcation("border collision", eps, (alpha,))
    curve = follow_bifurcation(Hopper(mass_ratio=10.0), "inject", event, "mass_ratio", 10.01, longest=0.5)
    assert "grazes the ground" in curve.border
    known = graze(10.01, *(each + float(curve.alphas[-1, 0]) - alpha for each in (low, high)))
    assert curve.alphas[-1, 0] == pytest.approx(known, abs=1e-10)


def through_lossless(mass_ratio: float) -> tuple[float, float]:
    """The injection at which hops of period two go through the lossless launch, and that launch."""
    machine = Hopper(mass_ratio=mass_ratio)
    star, step = find(machine).alpha, ReturnMap(machine)
    return by_bisection(lambda eps: float(step(star + eps).next) + eps - star, 0.1, 0.14), star


def test_borders_at_a_lossless_hop():
    eps, star = through_lossless(1.0)
    event = Bifurcation("border collision", eps, (star + eps, star))
    curve = follow_bifurcation(Hopper(), "inject", event, "mass_ratio", 1.1, longest=0.5)
    assert curve.border == "hop 2 is lossless"
    assert curve.at(1.1)[0] == pytest.approx(through_lossless(1.1)[0], abs=1e-12)


def test_a_bifurcation_is_located_from_a_guess():
    found = located(Hopper(), "inject", Bifurcation("flip", 0.07, (4.54,)))
    assert found.value == pytest.approx(0.071587384137, abs=1e-12)
    assert found.alphas == pytest.approx([4.541763272853], abs=1e-12)


def test_a_diagram_follows_its_events(tmp_path):
    span, launches, words = (0.06, 0.08), (4.5, 4.6), machine_in_words(Hopper())
    diagram = BifurcationDiagram("inject", span, launches, words, (), (FLIP,), source=Hopper())
    curve = diagram.follow_event(FLIP, "mass_ratio", 1.2, longest=0.5)
    assert curve.at(1.2)[0] == pytest.approx(0.0733692312971, abs=1e-12)
    again = BifurcationDiagram.load(diagram.save(tmp_path / "flips.json"))
    assert again.source is None
    assert pickle.loads(pickle.dumps(diagram)).source == diagram.source
    with pytest.raises(InputError, match="machine="):
        again.follow_event(again.events[0], "mass_ratio", 1.2)
    with pytest.raises(InputError, match="no fold; its events are flip"):
        diagram.follow_event("fold", "mass_ratio", 1.2)
    path = tmp_path / "curve.json"
    again.follow_event("flip", "mass_ratio", 1.2, machine=Hopper(), longest=0.5, output=path)
    other = BifurcationCurve.load(path)
    assert np.array_equal(other.values, curve.values)


def test_the_turn_and_the_end_of_a_curve():
    """An injection is marginal where 1/M is the mass ratio; and the curve ends where hops have other impacts."""
    curve = follow_bifurcation(Hopper(), "inject", FLIP, "mass_ratio", 10.0, longest=0.5)
    turn, alpha = curve.events[0], curve.events[0].alphas[0]
    assert turn.kind == "turn"
    assert turn.values == pytest.approx((0.8308760227, 4.84519126431), abs=1e-7)
    for mass_ratio in (turn.values[1], 1 / turn.values[1]):
        machine = Hopper(mass_ratio=mass_ratio)
        assert multiplier(machine, alpha) == pytest.approx(-1.0, abs=1e-9)
        assert float(ReturnMap(machine, inject=turn.values[0])(alpha).next) == pytest.approx(alpha, abs=1e-11)
    assert curve.end.kind == "border"
    assert "other impacts" in curve.end.reason


def test_a_curve_ends_where_a_hop_ends_at_rest():
    """Towards light feet all of the launch comes to be injected, and beyond that nothing is left of the hop."""
    curve = follow_bifurcation(Hopper(), "inject", FLIP, "mass_ratio", 0.1, longest=0.5)
    assert curve.end.kind == "border"
    assert "ends at rest" in curve.end.reason
    assert curve.alphas[-1] == pytest.approx(curve.values[-1, :1], abs=1e-10)
    before = ReturnMap(Hopper(mass_ratio=curve.values[-2][1]), inject=curve.values[-2][0])
    assert float(before(curve.alphas[-2][0]).next) == pytest.approx(curve.alphas[-2][0], abs=1e-10)


def test_what_is_refused():
    follow = follow_bifurcation
    with pytest.raises(InputError, match="mass_ratio = -1 is out of bounds"):
        follow(Hopper(), "inject", FLIP, "mass_ratio", -1.0)
    with pytest.raises(InputError, match="lossless hop"):
        follow(Hopper(), "inject", Bifurcation("fold", 0.0, (4.493409457909064,)), "mass_ratio", 2.0)
    with pytest.raises(NoOrbit, match=r"is not a flip: the nearest one is at 0\."):
        follow(Hopper(), "inject", Bifurcation("flip", 0.07, (4.54,)), "mass_ratio", 2.0)
    with pytest.raises(InputError, match="followed along damping, drag, mass_ratio"):
        follow(Hopper(), "inject", FLIP, "inject", 2.0)
    with pytest.raises(InputError, match="infinitely many impacts"):
        follow(Hopper(restitution=0.3), "inject", FLIP, "mass_ratio", 2.0)
    with pytest.raises(InputError, match="its value in the machine is 0"):
        follow(Hopper(), "inject", FLIP, "damping", 0.1)
    with pytest.raises(InputError, match="has no curve in two parameters"):
        follow(Hopper(), "inject", Bifurcation("branch point", 0.07, (4.54,)), "mass_ratio", 2.0)
    with pytest.raises(InputError, match="several numbers"):
        follow(Chain((1.0, 1.0, 1.0), ("r", "r")), "inject", FLIP, "mass_ratio", 2.0)
    with pytest.raises(InputError, match="steps"):
        follow(rimless_wheel(mass=2.0, length=0.4, spokes=8, inertia=0.4, body_inertia=0.4, stiffness=20.0), "inject",
               FLIP, "mass", 2.0)  # fmt: skip
    with pytest.raises(InputError, match="one of the `events`"):
        follow(Hopper(), "inject", 0.07, "mass_ratio", 2.0)
    springy = Hopper("bilinear")
    alpha = 1.02 * find(springy).alpha
    with pytest.raises(InputError, match="breakpoints of a law move with ratio"):
        follow(springy, "ratio", Bifurcation("flip", 3.0, (alpha,)), "mass_ratio", 2.0)
    with pytest.raises(NoOrbit, match="no impact is about to vanish"):
        follow(Hopper(), "inject", Bifurcation("border collision", FLIP.value, FLIP.alphas), "mass_ratio", 2.0)
    with pytest.raises(NoOrbit, match="not found again"):
        follow(Hopper(), "inject", Bifurcation("flip", 0.1, (2.0,)), "mass_ratio", 2.0)
