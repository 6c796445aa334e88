"""Laws that jump: breakpoints found from their comparisons, held against integration with events at the jumps."""

import casadi as ca
import numpy as np
import pytest
from conftest import slow_after
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from orbits import InputError, ReturnMap, find, follow
from problems import Hopper
from problems.laws import gravity, springs


def _end_speed(alpha: float, size: float, place: float, liftoff: float) -> float:
    """The rate of the extension at the time alpha under r + size*(r > place), which vanishes on an orbit."""
    time, state, above = 0.0, np.array([liftoff, alpha]), liftoff > place
    while True:
        crossed = lambda t, x: x[0] - place  # noqa: E731
        crossed.terminal, crossed.direction = True, -1.0 if above else 1.0  # type: ignore[attr-defined]
        rates = lambda t, x, force=size * above: [x[1], -x[0] - force]  # noqa: E731
        motion = solve_ivp(rates, (time, alpha), state, method="DOP853", rtol=1e-12, atol=1e-13, events=crossed)
        if motion.status == 0:
            return motion.y[1, -1]
        time, state, above = motion.t[-1], np.array([place, motion.y[1, -1]]), not above


@pytest.mark.parametrize(("size", "place"), [(0.195, 0.8), (-0.1, -2.0), (0.0006, 1.001)])
def test_motions_are_those_with_events_at_the_jump(size, place):
    orbit = find(Hopper("r + d*(1 + sign(r - a))/2", parameters={"d": size, "a": place}))
    liftoff = 1.0 - size * (place < 1)
    true = brentq(lambda x: _end_speed(x, size, place, liftoff), orbit.alpha - 1e-6, orbit.alpha + 1e-6, xtol=1e-13)
    assert orbit.alpha == pytest.approx(true, abs=2e-12)
    assert orbit.certificate.violations == ()
    assert orbit.certificate.clearance is None
    # Beyond the jump the force is that of a straight line, so that both are largest in mid-contact alone.
    assert orbit.certificate.smallest_contact_force is None


def test_the_loss_beside_an_orbit_is_that_of_the_map():
    hopper = Hopper(lambda r, d: r + d * (r > -2), parameters={"d": 0.195})
    orbit, small = find(hopper), 1e-6
    loss = (orbit.alpha + small - ReturnMap(hopper)([orbit.alpha + small]).next[0]) / small ** (4 / 3)
    assert orbit.certificate.loss_coefficient == pytest.approx(loss, rel=0.01)


@pytest.mark.parametrize(
    "force",
    slow_after(
        2,
        [
            lambda r, a: r + 0.1 * (r > a),
            lambda r, a: r + np.where(r > a, 0.1, 0.0),
            lambda r, a: ca.if_else(r > a, r + 0.1, r),
            lambda r, a: r + 0.1 * ca.logic_not(r <= a),
            lambda r, a: r + 0.05 * ca.fabs(1 + ca.sign(r - a)),
            lambda r, a: r + 0.1 * ca.logic_and(r > a, ca.fmax(r, 3 * a) > a),
        ],
    ),
)
def test_one_law_with_many_comparisons(force):
    law = springs.function(force, a=-2.0)
    assert law.corners() == pytest.approx([-2.0])
    assert law([-2.1, -1.9]) == pytest.approx([-2.1, -1.8])
    assert law.with_parameters(a=-3.0).corners() == pytest.approx([-3.0])
    assert find(Hopper(law)).alpha == pytest.approx(4.472755326068112, abs=1e-13)


def test_what_bends_is_in_pieces_unless_a_derivative_has_no_value():
    for text in ("r + 0.1*sign(r)*r**2", "r*abs(r)", "potential:r**2/2 + 0.1*abs(r)**3"):
        assert not springs.as_spring(text).pieces.jumps
    bent = springs.function(lambda r, d: ca.if_else(r > 0.5, r + d * (r - 0.5), r), d=0.2)
    assert not bent.pieces.jumps
    assert springs.as_spring("sign(r)*abs(r)**1.5").pieces is None


def test_a_triangle_of_straight_lines():
    """Half the flight by integrals over the extension in 40 digits, as `studies/narrow_features.py` has them."""
    triangle = "r + h*(abs((r - c)/w + 1) - 2*abs((r - c)/w) + abs((r - c)/w - 1))/2"
    parameters = {"h": -0.6756632197251745, "c": -4.578358109922923, "w": 0.009005904308464588}
    orbit = find(Hopper(triangle, mass_ratio=0.8, rest_length=40, parameters=parameters))
    assert orbit.alpha == pytest.approx(4.490231345909859, abs=orbit.error)


def test_a_pulse_narrower_than_1e_8():
    parameters = {"h": 0.35499186621720946, "c": 4.602999995079417, "w": 1.7671601978403145e-09}
    pulse = Hopper(
        "r + h*(sign((r - c)/w + 1) - sign((r - c)/w - 1))/2", mass_ratio=0.8, rest_length=40, parameters=parameters
    )
    orbit = find(pulse)
    assert orbit.alpha == pytest.approx(4.4934094476667003, abs=orbit.error)


def test_a_breakpoint_moves_with_a_parameter():
    family = follow(Hopper("r + 0.2*sign(r - a)", parameters={"a": -2.0}), "a", stop=-3.0, start=-2.0)
    point = family.points[-1]
    assert point.alpha == pytest.approx(find(Hopper("r + 0.2*sign(r + 3)")).alpha, abs=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: springs.formula("r + 0.1*sign(sin(2*r) - 0.1)"), r"jumps at r = 0.0500.*, from -0.0499\d* to 0.0500"),
        (lambda: springs.function(lambda r: r + np.floor(r)), r"jumps at r = 0, from -1 to 0.*breakpoints=\(0,\)"),
        (lambda: springs.function(lambda r: r - 0.1 * (r**2 > 1)), "no comparison of straight lines"),
        (lambda: springs.function(lambda r: r + ca.fmod(r, 2)), "jumps at r = -?2"),
        (lambda: springs.function(lambda r: ca.if_else(r > -2, r, r - 1 - ca.sqrt(-2 - r))), "round the law there"),
        (lambda: springs.function(lambda r: ca.if_else(r > -2, ca.sqrt(r + 3), r)), r"has no value .*\(-2,\)"),
        (lambda: gravity.formula("1 + 0.1*(sign(z - 3) + 1)"), "gravity .* jumps; write it as one smooth formula of z"),
    ],
)
def test_jumps_that_cannot_be_located_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize(
    ("law", "jumps"),
    [
        ("2e4*r + 5e3*abs(r)", False),
        ("8000*r + 1e6*((abs(r) + r)/2)**1.5", None),
        ("r + 0.5*((r - 0.5 + abs(r - 0.5))/2)**0.5", None),
        ("r*abs(r)**(-0.9)", None),
        ("8000*r + 0.1*sign(r - 2)", True),
    ],
)
def test_a_steep_law_does_not_jump(law, jumps):
    pieces = springs.as_spring(law).pieces
    assert (pieces and pieces.jumps) == jumps
