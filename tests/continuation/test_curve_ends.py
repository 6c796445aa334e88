"""How curves of orbits end: at a bound, closed, lost, or escaped to a limit that is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import slow_after
from families import FOLD, FOLD_ALPHA, events

from orbits import InputError, NoOrbit, follow
from orbits.continuation import Options, StepControl
from orbits.continuation.curve_ends import Endings, limit
from orbits.curves import Points
from orbits.errors import BreaksDown, NoStep
from problems import Hopper


def test_no_first_orbit_is_said_and_a_lost_curve_keeps_what_it_has():
    with pytest.raises(NoOrbit, match="does not come back"):
        follow(Hopper("cubic"), "beta", 0.0, -0.1)
    family = follow(Hopper("r"), "mass_ratio", -1.0)
    assert family.end.kind == "degenerate"
    assert family.end.reason.startswith("the machine ceases to exist at mass_ratio = ")
    assert len(family.end.reason) <= 300
    assert len(family) > 10


@pytest.mark.slow
def test_an_isola_closes():
    """With b = fold + d - q**2 the two sheets are joined at both ends of q**2 = d: fold, fold, and the start again. The
    start is among the values to come to, which is none; the others are on both sheets."""
    machine = Hopper("r + (b - q**2)*r**3", rest_length=30.0, parameters={"b": FOLD + 4e-4, "q": 0.0})
    family = follow(machine, "q", (-0.1, 0.1), at=[0.0, 0.01, -0.01], most=600)
    assert family.end.kind == "closed"
    assert sorted(point.value for point in events(family, "value")) == [-0.01, -0.01, 0.0, 0.01, 0.01]
    assert [fold.value for fold in events(family, "fold")] == pytest.approx([0.02, -0.02], abs=1e-9)
    assert [fold.alpha for fold in events(family, "fold")] == pytest.approx([FOLD_ALPHA] * 2, abs=1e-6)
    assert family[-1].u == pytest.approx(family[0].u, rel=1e-9)
    assert follow(machine, "q", 0.1).end.reason == "q = 0 again, on another sheet"
    for start, bounds in ((0.0, (0.05, 0.1)), (0.5, (-1.0, -0.2)), (0.5, (-0.2, -1.0)), (-0.5, (0.2, 1.0))):
        with pytest.raises(InputError, match="is not between"):
            follow(machine, "q", bounds, start=start)


@pytest.mark.slow
@pytest.mark.parametrize(("before", "longest"), [(1e-7, 0.011), (1e-9, 0.02)])
def test_a_stop_beside_a_fold_is_not_passed_over(before, longest):
    stop = FOLD + before * abs(FOLD)
    family = follow(Hopper("cubic"), "beta", stop, 0.0, longest=longest)
    assert family.end.kind == "reached"
    assert family[-1].value == stop
    assert family[-1].alpha < FOLD_ALPHA
    assert not events(family, "fold")


@pytest.mark.parametrize(
    ("machine", "along", "stop", "limit"),
    slow_after(
        2,
        [  # the tide's frequencies as 3 to 1; the barrier of r + c r^2 at -1/c
            (Hopper("r", "1 + a*z", rest_length=2.0, parameters={"a": 0.0}), "a", 3.0, 0.25),
            (Hopper("r + c*r**2", parameters={"c": 0.0}), "c", 1.0, 0.0),
            (Hopper("toda", parameters={"b": 0.01}), "b", 0.9, 0.5),
        ],
    ),
)
def test_a_limit_is_as_good_as_it_says(machine, along, stop, limit):
    family = follow(machine, along, stop)
    end = family.end
    assert end.kind == "escaped"
    assert abs(end.limit - limit) <= 2 * end.limit_error
    assert end.limit_error < 2e-3
    # Rounding moves mid-flight, and no stationary point of the extension appears beside it.
    assert "family" not in [event.kind for event in family.events]


@pytest.mark.slow
def test_a_flight_near_a_barrier_is_followed_on():
    """Of a quadratic spring, up to 1e14-fold growth of small changes: the launch speeds are those of elliptic integrals
    in 60 digits. With E the energy at lift-off and e1 < e2 < e3 the zeros of 2 (E - V), (2 K(m) - F(phi, m)) times the
    pace is alpha, with m = (e2 - e1)/(e3 - e1), sin(phi)**2 = (rho - e1)/(e2 - e1)."""
    speeds = {-0.022: 26.223545859854905214, -0.018: 32.059032473094379769, -0.016: 36.070225915888099609}
    family = follow(Hopper("r + c*r**2", parameters={"c": 0.0}), "c", -1.0, at=speeds)
    for value, speed in speeds.items():
        beyond = family.at(value)[-1]
        assert abs(beyond.alpha - speed) <= beyond.error < 1e-11
    assert {point.family for point in family} == {1}
    assert family.end.kind == "escaped"
    assert abs(family.end.limit) <= family.end.limit_error < 1e-5
    assert np.isfinite(family.column("stroke")).all()


@pytest.mark.parametrize("beside", [1e-4, 1e-6, 1e-8, 1e-9])
def test_a_start_beside_a_fold_comes_back_on_the_other_sheet(beside):
    family = follow(Hopper("cubic", rest_length=30.0), "beta", -0.02, FOLD + beside)
    assert family[0].alpha < FOLD_ALPHA < family[-1].alpha
    assert family[-1].value == FOLD + beside
    assert [event.kind for event in family.events] == ["fold"]
    assert family.end.reason.endswith("on another sheet")


def test_a_stop_at_the_edge_of_a_law_is_reached():
    family = follow(Hopper("r + c**1.5*r**3", parameters={"c": 1.0}), "c", 0.0)
    assert family.end.kind == "reached"
    assert family[-1].alpha == pytest.approx(4.493409457909064, rel=1e-13)


def history(value, alpha, power=-1):
    """Launch speeds, and a function of their powers."""
    return [(float(a), float(value(a**power))) for a in alpha]


EVERYWHERE = (-np.inf, np.inf)


@pytest.mark.parametrize("power", [-1, 1])
@pytest.mark.parametrize(
    "value",
    [
        lambda s: 0.25 + 0.3 * s - 0.2 * s**2 + 0.05 * s**4,
        lambda s: -2.0 + 0.7 * s**2 + 0.1 * s**5,
        lambda s: 1.0 - np.sin(0.5 * s),
        lambda s: np.cosh(s) / (1 + s**2),
    ],
    ids=["with the first power", "without it", "sine", "even"],
)
def test_a_limit_is_extrapolated_by_a_series(value, power):
    """Its error is stated, and small beside the way that is left."""
    alpha = np.geomspace(1.0, 20.0, 200) ** -power
    points, end = history(value, alpha, power), value(0.0)
    found, error = limit(points, EVERYWHERE, power)
    left = abs(points[-1][1] - end)
    assert abs(found - end) <= error + 1e-13
    assert error < 2e-3 * left
    mirrored = [(-a, v) for a, v in points]
    assert limit(mirrored, EVERYWHERE, power) == (found, error)
    # Before a launch speed's change of sign the curve is another one.
    other = [(-a, 5.0 + k) for k, (a, _) in enumerate(points)]
    assert limit([*other, *points], EVERYWHERE, power) == (found, error)
    assert limit([*other, (0.0, 3.0), *points], EVERYWHERE, power) == (found, error)
    low, high = sorted((points[-1][1], end))
    assert limit(points, (low - 0.1, high + 0.1), power) == (found, error)
    assert limit(points, (end + 2 * error + 1e-9, np.inf), power) is None
    assert limit(points, (-np.inf, end - 2 * error - 1e-9), power) is None


def test_what_tends_to_no_clear_limit_has_none():
    alpha = np.geomspace(1.0, 50.0, 300)
    assert limit(history(lambda s: 1 / (1 - np.log(s)), alpha), EVERYWHERE, -1) is None
    assert limit(history(lambda s: np.sin(2 * np.log(s)), alpha), EVERYWHERE, -1) is None
    turned = history(lambda s: s * (s - 1.2 / 50), alpha)  # it would come back to where it was before
    assert limit(turned, EVERYWHERE, -1) is None
    assert limit([(a, v) for a, v in turned if v > 0.001], EVERYWHERE, -1)[0] == pytest.approx(0.0, abs=1e-6)


def endings(one_speed=True, start=0.5, **control):
    """The endings of a curve along b from an orbit with the launch speed 4, the flight time 8 and lift-off at 1."""
    machine = SimpleNamespace(model=SimpleNamespace(one_speed=one_speed, reversor=None))
    growths = lambda points: points.growths  # noqa: E731
    curve = SimpleNamespace(
        along="b", span=2.0, machine=machine, units_at=lambda value, also: None,
        growths=growths, largest_growths=growths,
        equations_of_orbits=SimpleNamespace(statement=SimpleNamespace(unknowns=("alpha", "duration"), durations=())),
    )  # fmt: skip
    origin = SimpleNamespace(alpha=4.0, flight_time=8.0, liftoff_extension=1.0)
    return Endings(curve, origin, start, (0.0, 2.0), Options(step_control=StepControl(**control)))


def last_point(alpha, time, extension=1.0, amplification=1.0, value=0.75):
    """The last point of a curve."""
    point = SimpleNamespace(alpha=alpha, flight_time=time, liftoff_extension=extension, also={})
    x = np.array([[alpha, time, value]])
    nothing, one = np.zeros((1, 3)), np.zeros(1, int)
    return Points(one, x, nothing, np.array([amplification]), None, one, own=[point])


def passed(points):
    """Points with these launch speeds and values of the parameter."""
    alphas, values = np.array(points).T
    nothing = np.zeros((len(alphas), 2))
    own = SimpleNamespace(column={"alpha": alphas, "value": values, "u": nothing, "tangent": nothing}.get)
    return [SimpleNamespace(own=own, lengths=np.ones(len(alphas)))]


FAR = history(lambda s: 0.8 - s, np.geomspace(4.0, 4000.0, 300))


NEAR = history(lambda s: 0.8 - s, np.geomspace(4.0, 0.004, 300), 1)


@pytest.mark.parametrize(
    ("point", "points", "one_speed", "reason"),
    [
        (last_point(4000.0, 8000.0), FAR, True, "the launch speed grows without bound"),
        (last_point(-4000.0, 8000.0), FAR, True, "the launch speed grows without bound"),
        (last_point(4000.0, 8e8), FAR, True, "gravity no longer returns the machine near b = 0.75"),
        (last_point(5.0, 8e8), FAR, True, "gravity no longer returns the machine near b = 0.75"),
        (last_point(4000.0, 8000.0, -1e6), FAR, True, "the spring no longer lifts the foot near b = 0.75"),
        (last_point(4000.0, 8000.0, 60.0), FAR, True, "the launch speed grows without bound"),
        (last_point(0.004, 0.01), NEAR, True, "the flight shrinks to zero near b = 0.75"),
        (last_point(0.004, 0.01), NEAR, False, "the flight shrinks to zero near b = 0.75"),
        (last_point(-0.004, 4.0), NEAR, True, "the launch speed falls to zero near b = 0.75"),
        (last_point(0.004, 4.0), NEAR, False, None),
        (last_point(4000.0, 8000.0), FAR[:2], True, None),
        (last_point(0.004, 0.01), NEAR[:2], True, None),
        (last_point(40.0, 80.0), FAR, True, None),
        (last_point(0.4, 0.8), NEAR, True, None),
    ],
)
def test_what_a_curve_that_goes_far_ends_in(point, points, one_speed, reason):
    end = endings(one_speed, escape_ratio=50.0).far(point, passed(points))
    assert (end and end.reason) == reason
    if reason:
        assert end.kind == ("escaped" if "grows" in reason else "degenerate")
        assert abs(end.limit - 0.8) <= end.limit_error + 1e-12


def test_what_a_lost_curve_ends_in():
    """Where it escapes the limit says more than the reason; an error of the machine is one."""
    lost, reason = endings(running_ratio=4.0).lost, NoOrbit("no root")
    end = lost(reason, last_point(4000.0, 8000.0), passed(FAR))
    assert (end.kind, end.limit) == ("escaped", pytest.approx(0.8))
    assert end.reason.endswith("was followed to b = 0.75, alpha = 4000")
    for point, points in ((last_point(12.0, 8000.0), FAR), (last_point(-4000.0, 8000.0), FAR[:2])):
        end = lost(reason, point, passed(points))
        assert (end.kind, end.reason) == ("stuck", f"at b = 0.75, alpha = {point.own[0].alpha:g}: no root")
    for error, what in (
        (BreaksDown("it breaks down"), "does not come back (it"),
        (NoStep("none"), "found near it (none"),
    ):
        for growth, remedy in ((1.0, "allow steps shorter than 1e-05"), (1e6, "Follow another parameter")):
            end = lost(error, last_point(12.0, 8000.0, amplification=growth), passed(FAR))
            assert end.kind == "stuck"
            assert what in end.reason
            assert remedy in end.reason
    end = lost(InputError("no mass"), last_point(12.0, 8000.0), passed(FAR))
    assert (end.kind, end.reason) == (
        "degenerate",
        "the machine ceases to exist at b = 0.75, alpha = 12: no mass",
    )
    beside = last_point(12.0, 8000.0, value=0.5 + 1e-9)
    remedy = "; over several decades, follow the inverse or the logarithm of the parameter"
    assert lost(reason, beside, passed(FAR)).reason.endswith("no root" + remedy)
    end = endings(running_ratio=4.0, largest_amplification=1e3).far(
        last_point(5.0, 8.0, amplification=1e4), passed(FAR)
    )
    assert (end.kind, "grow 1e+04-fold" in end.reason) == ("stuck", True)


def test_a_lift_off_that_grows_without_bound_ends_a_family():
    """A spring loses its stiffness: in fewer steps than its launch speed says so, and at a stiffness of 0."""
    family = follow(Hopper("K*r + 0.1*K*r**3", parameters={"K": 1.0}), "K", stop=-1.0)
    assert family.end.kind == "degenerate"
    assert "the extension at lift-off grows without bound" in family.end.reason
    assert abs(family.end.limit) <= family.end.limit_error < 1e-9
