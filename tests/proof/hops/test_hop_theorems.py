"""Fixed points of return maps with injection, hops of longer periods, and period doublings, that are proved: against
the closed form of the linear hopper in 60 digits, and against the map's own numbers; what is not so is not proved."""

from dataclasses import replace
from decimal import Decimal
from functools import cache

import mpmath as mp
import numpy as np
import pytest

from orbits import InputError, ReturnMap, find, prove_doubling, prove_fixed_point
from orbits.returns import Bifurcation, ReturningHops
from orbits.returns.proofs import guess_at
from orbits.running import default_limit
from problems import Hopper, Juggler, hopper_in_si, inerter_hopper

# Of the linear hopper with equal masses: launch speeds of fixed points, and the times of their flights.
FIXED = {"0.03": {4.4876: (8.589, 1.129), 4.5188: (9.68,)}, "0.071587384137": {4.4813: (8.46, 1.35), 4.5418: (9.86,)}}
FLIP = Bifurcation("flip", 0.071587384137, (4.541763272853,), -1.0, 0)


@pytest.fixture(autouse=True)
def digits():
    with mp.workdps(60):
        yield


def root(f, slope, x):
    """The zero of a function by Newton's method, to 50 digits."""
    for _ in range(60):
        step = f(x) / slope(x)
        x -= step
        if abs(step) < mp.mpf(10) ** -50:
            return x
    raise AssertionError("Newton's method does not converge")


def next_speed(alpha, flights):
    """The launch speed of the linear hopper with equal masses after alpha, in closed form, for about these flights."""
    place, rate = mp.mpf(1), mp.mpf(alpha)  # of the body; the foot is at rest on the ground
    for guess in flights:
        c, s = place, rate
        extension = lambda t: c * mp.cos(t) + s * mp.sin(t)  # noqa: B023, E731
        change = lambda t: -c * mp.sin(t) + s * mp.cos(t)  # noqa: B023, E731
        gap = lambda t: (c + s * t - t**2 / 2 - extension(t)) / 2  # noqa: B023, E731
        speed = lambda t: (s - t - change(t)) / 2  # noqa: B023, E731
        t = root(gap, speed, mp.mpf(guess))
        place, rate = extension(t), change(t) + speed(t)
    return mp.sqrt(rate**2 + (place**2 - 1) / 2 + place - 1)


def slope(alpha, flights, order=1):
    return mp.diff(lambda a: next_speed(a, flights), alpha, order, h=mp.mpf(10) ** -12)


def fixed_point(guess, flights, inject):
    def excess(alpha):
        return next_speed(alpha, flights) + mp.mpf(inject) - alpha

    return root(excess, lambda alpha: slope(alpha, flights) - 1, mp.mpf(guess))


def holds(enclosure, value):
    return mp.mpf(enclosure.low) <= value <= mp.mpf(enclosure.high)


@pytest.mark.slow
def test_the_pair_of_fixed_points_in_closed_form():
    inject = "0.03"
    for guess, flights in FIXED[inject].items():
        alpha = fixed_point(guess, flights, inject)
        proof = prove_fixed_point(Hopper(), guess, inject)
        assert proof.proved
        assert holds(proof.alpha, alpha)
        assert proof.alpha.width < 1e-17
        assert holds(proof.enclosures["multiplier"], slope(alpha, flights))
        assert proof.enclosures["multiplier"].width < 1e-12
        assert proof.kind == "fixed point"
        assert f"With inject = {inject}: The equations of a hop of {len(flights)} impact" in proof.statement
        assert proof.document()["machine"]["injection"] == [inject, inject]
        assert ("asymptotically stable" in proof.statement) == (abs(slope(alpha, flights)) < 1)
        assert ("unstable" in proof.statement) == (abs(slope(alpha, flights)) > 1)


# A launch of hops of the linear hopper, to be followed by the next ones, with the injection and the impacts of each.
PERIODIC = [("0.12", 4.492930343, (2, 1)), ("0.135", 4.489169990, (2, 1, 1, 1))]


@cache
def cycle_near(alpha, inject, period):
    found = ReturnMap(Hopper(), inject=float(inject)).periodic_hops(period, 4.2, 5.0)
    return min(found, key=lambda each: abs(each.alpha - alpha))


@pytest.mark.slow
@pytest.mark.parametrize(("inject", "first", "impacts"), PERIODIC)
def test_hops_of_a_longer_period_in_closed_form(inject, first, impacts):
    cycle = cycle_near(first, inject, len(impacts))
    flights = guess_at(Hopper(), cycle.alphas, float(inject)).flights

    def launches(alpha):
        found = [alpha]
        for own in flights:
            found.append(next_speed(found[-1], own) + mp.mpf(inject))
        return found

    def rate(alpha):
        return mp.fprod(slope(each, own) for each, own in zip(launches(alpha), flights, strict=False))

    alpha = root(lambda a: launches(a)[-1] - a, lambda a: rate(a) - 1, mp.mpf(first))
    with default_limit(300):  # of processor time
        proof = prove_fixed_point(Hopper(), cycle, inject)
    assert proof.proved
    assert proof.kind == "periodic hops"
    for name, value in zip(("alpha", "alpha_2", "alpha_3", "alpha_4"), launches(alpha)[:-1], strict=False):
        assert holds(proof.enclosures[name], value)
        assert proof.enclosures[name].width < 1e-17
    assert holds(proof.enclosures["multiplier"], rate(alpha))
    assert proof.enclosures["multiplier"].width < 1e-11
    assert f"hops that come back, of {', '.join(map(str, impacts))} impacts" in proof.statement
    assert f"of the least period {len(impacts)}" in proof.statement
    assert ("asymptotically stable" in proof.statement) == (abs(rate(alpha)) < 1)
    assert ("unstable" in proof.statement) == (abs(rate(alpha)) > 1)


@pytest.mark.slow
def test_hops_that_are_said_otherwise_are_not_proved():
    cycle = cycle_near(PERIODIC[0][1], "0.12", 2)
    moved = ReturningHops.of_speeds(np.add(cycle.alphas, [0, 1e-10]), -7.6, impacts=(1, 1), error=cycle.error)
    proof = prove_fixed_point(Hopper(), moved, "0.12")
    assert not proof.proved
    assert [each.partition(":")[0] for each in proof.reasons] == ["alpha_2", "multiplier", "impacts"]


@pytest.mark.slow
def test_hops_that_come_back_earlier_than_is_said():
    cycle = cycle_near(PERIODIC[0][1], "0.12", 2)
    rate, impacts = cycle.multiplier**2, 2 * cycle.impacts
    twice = ReturningHops.of_speeds([*cycle.alphas] * 2, rate, impacts=impacts, error=cycle.error)
    proof = prove_fixed_point(Hopper(), twice, "0.12")
    assert not proof.proved
    assert proof.conditions["least_period"] == "undecided"
    assert proof.reasons == ("least_period: the launch speed after 2 hops is not proved to differ from the first",)
    assert "least period" not in proof.statement


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "inject"),
    [
        (Hopper("r + 0.3*r**3", mass_ratio=0.5, rest_length=8.0), 0.04),
        (Hopper("bilinear"), 0.1692),
        (hopper_in_si(30.0, 30.0, force="k*r", parameters={"k": 8000.0}, rest_length=2.0), 0.1019),
    ],
    ids=["cubic", "bilinear", "SI"],
)
def test_hops_of_period_two_of_other_machines(machine, inject):
    alpha, step = find(machine).alpha, ReturnMap(machine, inject)
    found = step.periodic_hops(2, 0.9 * alpha, 1.1 * alpha)
    assert found
    for cycle in found:
        with default_limit(300):  # of processor time
            proof = prove_fixed_point(machine, step.periodic_hop(cycle.alpha, 2), str(inject))
        assert proof.proved
        assert [float(proof.enclosures[name].low) for name in ("alpha", "alpha_2")] == pytest.approx(cycle.alphas)
        multiplier = proof.enclosures["multiplier"]
        assert float(multiplier.low) - 1e-8 <= cycle.multiplier <= float(multiplier.high) + 1e-8


@pytest.mark.slow
def test_the_period_doubling_in_closed_form():
    """Curve (d) of the paper's Fig. 8."""
    flights = FIXED["0.071587384137"][4.5418]
    alpha = mp.findroot(lambda a: slope(a, flights) + 1, (4.541, 4.542), tol=1e-35)
    first, second, third = (slope(alpha, flights, order) for order in (1, 2, 3))
    assert abs(first + 1) < mp.mpf(10) ** -30
    with default_limit(300):  # of processor time
        proof = prove_doubling(Hopper(), FLIP)
    assert proof.proved
    assert holds(proof.alpha, alpha)
    assert holds(proof.enclosures["inject"], alpha - next_speed(alpha, flights))
    assert max(proof.alpha.width, proof.enclosures["inject"].width) < 1e-17
    assert holds(proof.enclosures["multiplier_rate"], second / 2)
    assert holds(proof.enclosures["cubic_coefficient"], second**2 / 2 + third / 3)
    assert "for injections just above it is stable" in proof.statement
    assert proof.document()["machine"]["injection"] is None
    for name, value in (("alpha", "4.541763272853"), ("inject", "0.071587384137")):
        enclosure = proof.enclosures[name]
        assert round(Decimal(enclosure.low), 12) == round(Decimal(enclosure.high), 12) == Decimal(value)


@pytest.mark.slow
def test_the_doubling_of_a_cubic_spring():
    """How fast the multiplier passes through -1, by differences along the fixed points."""
    machine, d = Hopper("r + 0.3*r**3", mass_ratio=0.5, rest_length=8.0), 1e-6
    with default_limit(300):  # of processor time
        proof = prove_doubling(machine, Bifurcation("flip", 0.0329952471, (2.962045693,), -1.0, 0))
    assert proof.proved
    inject, rate = (float(proof.enclosures[name].low) for name in ("inject", "multiplier_rate"))
    ends = [ReturnMap(machine, inject + side).fixed_points(2.95, 2.97)[-1].multiplier for side in (-d, d)]
    assert (ends[1] - ends[0]) / (2 * d) == pytest.approx(rate, rel=1e-4)
    assert sum(ends) / 2 == pytest.approx(-1, abs=1e-7)


@pytest.mark.slow
def test_a_doubling_that_is_said_elsewhere_or_of_other_laws():
    moved = replace(FLIP, value=FLIP.value + 1e-8)
    with default_limit(300):  # of processor time
        proof = prove_doubling(Hopper(), moved)
    assert not proof.proved
    assert proof.reasons[0].startswith("inject: the flip says")
    with pytest.raises(InputError, match="across the breakpoints of a law in pieces"):
        prove_doubling(Hopper("bilinear"), Bifurcation("flip", 0.05, (3.44,), -1.0, 0))
    with pytest.raises(InputError, match='"flip" event'):
        prove_doubling(Hopper(), replace(FLIP, kind="fold"))
    with pytest.raises(InputError, match='"flip" event'):
        prove_doubling(Hopper(), replace(FLIP, alphas=(4.5, 4.6)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "which"),
    [
        (Hopper("r + 0.3*r**3", mass_ratio=0.5, rest_length=8.0), 0),
        (Juggler("tanh", parameters={"b": 0.1}), 1),
        (Hopper("r + 0.3*r**3", gravity="1/(1 + z/40)**2", rest_length=8.0), 0),
        (Hopper("bilinear"), 1),
        (inerter_hopper(), 0),
        (hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 2e6}, rest_length=0.8), 1),
    ],
    ids=["cubic", "tanh", "gravity", "bilinear", "inerter", "SI"],
)
def test_one_of_the_pairs_of_other_machines(machine, which):
    """The lower fixed point, whose hop bounces once, and the upper one, in turn."""
    alpha = find(machine).alpha
    inject, d = round(0.01 * alpha, 6), 1e-6 * alpha
    points = ReturnMap(machine, inject).fixed_points(0.9 * alpha, 1.1 * alpha)
    assert len(points) == 2
    point = points[which]
    with default_limit(300):  # of processor time
        proof = prove_fixed_point(machine, point, inject)
    assert proof.proved
    low, high = proof.alpha.low, proof.alpha.high
    assert float(low) - 1e-13 * alpha <= point.alpha <= float(high) + 1e-13 * alpha
    before, after = ReturnMap(machine)(point.alpha + np.array([-d, d])).next
    for slope_there, error in (((after - before) / (2 * d), 1e-5), (point.multiplier, 1e-8)):
        enclosure = proof.enclosures["multiplier"]
        assert float(enclosure.low) - error <= slope_there <= float(enclosure.high) + error


@pytest.mark.slow
def test_a_narrow_interval_of_injections():
    proof = prove_fixed_point(Hopper(), 4.52, ("0.0299999", "0.0300001"))
    assert proof.proved
    assert "For each value in these intervals" in proof.statement
    assert prove_fixed_point(Hopper(), 4.52, "0.0300001").alpha.low in proof.alpha


@pytest.mark.slow
def test_what_is_said_otherwise_is_not_proved():
    low, high = ReturnMap(Hopper(), inject=0.03).fixed_points(4.4, 4.6)
    proved = prove_fixed_point(Hopper(), high, "0.03")
    assert proved.proved
    other = prove_fixed_point(Hopper(), high, "0.030000000001")
    assert not other.proved
    assert Decimal(other.alpha.low) > Decimal(proved.alpha.high)
    assert other.reasons[0].startswith("alpha: the fixed point says 4.51882885947")
    crossed = prove_fixed_point(Hopper(), replace(low, multipliers=high.multipliers), "0.03")
    assert crossed.reasons[0].startswith("multiplier: the fixed point says -0.5976")
