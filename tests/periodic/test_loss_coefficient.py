"""The loss beside a lossless hop, against closed forms, the map and 20 digits."""

import mpmath
import numpy as np
import pytest
from plane import linear, rocker, wheel
from scipy.optimize import brentq
from thirty_digits import exact_alpha, series

from orbits import (
    Mechanism,
    NoOrbit,
    ReturnMap,
    find,
    find_all,
    follow,
    multiplier,
    multipliers,
    orbit_at,
    simulate,
    starts,
)
from orbits.mechanics import Mass, Spring
from orbits.periodic import bounce_factors, hand_over_factors
from problems import HeavyHand, Hopper, springs

mpmath.mp.dps = 30


class TestLossCoefficient:
    def test_published_value(self):
        """M = 1, linear spring, first family: C = 3.61694; the same for M and 1/M."""
        assert find(Hopper()).certificate.loss_coefficient == pytest.approx(3.61694, abs=1e-5)
        light, heavy = (find(Hopper(mass_ratio=M)).certificate.loss_coefficient for M in (0.2, 5.0))
        assert light == pytest.approx(heavy, rel=1e-13)

    def test_none_at_a_corner_of_the_law(self):
        """A spring k times as stiff from the lift-off extension on: with the jerk J beyond it and k J on this side, the
        second landing below alpha is at the root x of x**3 = 3 k x + 2 k, and not at 2, so that 10 C is wrong."""
        k = 3.0
        machine = Hopper(springs.bilinear(ratio=k, gap=1.0))
        orbit = find(machine)
        assert (orbit.certificate.loss_coefficient, orbit.certificate.stable_side) == (None, None)
        above, below = ReturnMap(machine)([orbit.alpha + 1e-9, orbit.alpha - 1e-9]).loss
        x = max(np.roots([1.0, 0.0, -3 * k, -2 * k]).real)
        assert below / above == pytest.approx((k**2 + (x**2 - k) ** 2) * k ** (-4 / 3), rel=1e-2)
        with pytest.raises(NoOrbit, match="a corner at lift-off"):
            multiplier(machine, orbit.alpha)

    def test_no_attraction_without_a_motion(self):
        """The contact of this hop never ends, so that no launch beside it returns."""
        orbit = find(Hopper("cubic", parameters={"beta": -0.009}))
        assert not orbit.admissible
        assert orbit.certificate.loss_coefficient
        assert "attracts" not in str(orbit)

    def test_how_far_it_attracts(self):
        """Beside a linear hop, whose landing is in closed form, the next launch comes back to alpha at the width."""
        shares = []
        for family, expected in ((1, 0.0159187), (2, 0.0033230), (3, 0.0011999581)):
            orbit = find(Hopper(), family)
            alpha, c = orbit.alpha, orbit.certificate

            def excess(launch, alpha=alpha):
                """The square of the next launch speed less that of alpha: the landing takes v^2 of it."""
                gap = lambda t: 0.5 * (1 + launch * t - t * t / 2 - np.cos(t) - launch * np.sin(t))  # noqa: E731
                t = brentq(gap, 2 * alpha - 0.5, 2 * alpha + 1.0, xtol=1e-14)
                return launch**2 - alpha**2 - 0.25 * (launch - t + np.sin(t) - launch * np.cos(t)) ** 2

            leading = c.loss_coefficient**-3
            width = brentq(lambda d, alpha=alpha, excess=excess: excess(alpha + d), 1e-4, 1.1 * leading, xtol=1e-14)
            assert width == pytest.approx(expected, rel=1e-3)
            ((_, end), *_) = ReturnMap(Hopper()).basin(0.99 * alpha, 1.02 * alpha, hops=0)
            assert end - alpha == pytest.approx(width, rel=1e-6)
            assert c.attraction_width() == pytest.approx(c.loss_coefficient**-3, rel=1e-14)
            assert f"up to {c.attraction_width():.2g} above alpha, to leading order" in str(orbit)
            shares.append(width / c.attraction_width())
        assert 0.75 < shares[0] < shares[1] < shares[2] < 1
        light = find(Hopper(mass_ratio=0.01))
        assert light.certificate.attraction_width() > 100
        assert dict(light.rows())["launch range"] == "above alpha, beyond the range of the leading order"
        assert dict(light.rows())["loss coefficient C"].endswith("   (10 C below)")
        assert find(HeavyHand()).certificate.attraction_width() is None

    def test_impacts_that_rebound(self):
        """With a restitution all bounces count: what hops of the map lose beside the orbit, late and early."""
        machine = Hopper(restitution=0.5)
        orbit = find(machine)
        lost = ReturnMap(machine)([orbit.alpha + 1e-8, orbit.alpha - 1e-8]).loss / (2 * orbit.alpha * 1e-8 ** (4 / 3))
        late, early = np.array(bounce_factors(0.5)) * orbit.certificate.loss_coefficient
        assert lost == pytest.approx([late, early], rel=2e-3)
        assert "with restitution 0.5, 1.075 C above and 21.6 C below" in dict(orbit.rows())["loss coefficient C"]
        assert "launch range" not in str(find(Hopper(restitution=1.0)))
        with pytest.raises(NoOrbit, match=f"loses {late:.4g} .* {early:.4g} "):
            multiplier(machine, orbit.alpha)


@pytest.mark.parametrize("mass_ratio", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("family", [1, 2])
def test_the_loss_coefficient_of_the_linear_spring_in_closed_form(mass_ratio, family):
    """r = cos t + alpha sin t and tan alpha = alpha; the flight lasts 2 alpha, J = alpha, q = 2 alpha - sin 2 alpha."""
    alpha = mpmath.findroot(lambda a: mpmath.sin(a) - a * mpmath.cos(a), find(Hopper(), family).alpha)
    m, q = mpmath.mpf(mass_ratio), 2 * alpha - mpmath.sin(2 * alpha)
    c = m * alpha**2 * (6 * q / alpha) ** (mpmath.mpf(4) / 3) / (8 * alpha * (1 + m) ** 2)
    for method in (None, "relative", "half orbit"):
        found = find(Hopper(mass_ratio=mass_ratio), family, method=method).certificate
        assert abs(found.loss_coefficient - c) <= min(found.loss_error, 1e-13 * c)
        assert found.loss_error <= 1e-9 * c


def _loss_of_cubic(b, orbit):
    """The loss coefficient with M = 1 in 20 digits, the gap's slope at landing by a central difference."""
    alpha, one = exact_alpha(orbit, b, None, 1.0, 0.0), mpmath.mpf(1)
    rho = mpmath.findroot(lambda r: r + b * r**3 - 1, orbit.liftoff_extension)

    def gap(launch, count=24):
        state = [rho, launch, 0 * one, 0 * one]
        for _ in range(count):
            state = series(state, b, None, one, 0 * one, 2 * alpha / count)
        return state[2]

    step = mpmath.mpf("1e-10")
    q, jerk = (gap(alpha + step) - gap(alpha - step)) / step, (1 + 3 * b * rho**2) * alpha
    return jerk**2 * (6 * q / jerk) ** (mpmath.mpf(4) / 3) / (32 * alpha)


@pytest.mark.slow
def test_the_loss_coefficient_of_the_cubic_spring_has_all_its_digits():
    """In an orbit; in a family the derivatives are those before the last corrector step, and the figure says so."""
    machine = Hopper("r + b*r**3", parameters={"b": 0.0})
    family, worst = follow(machine, "b", 1.0, at=[0.25]), 0.0
    (point,) = family.at(0.25)
    orbit = find(machine.with_values(b=0.25))
    c = _loss_of_cubic(0.25, orbit)
    for found in (orbit.certificate, orbit_at(machine, point, "b").certificate):
        assert abs(found.loss_coefficient - c) <= min(found.loss_error, 1e-13 * c)
        assert found.loss_error <= 1e-9 * c
    for point in family.points[::16]:
        exact = find(machine.with_values(b=point.value)).certificate.loss_coefficient
        assert abs(point.certificate.loss_coefficient - exact) <= point.certificate.loss_error <= 1e-6 * exact
        worst = max(worst, abs(point.certificate.loss_coefficient / exact - 1))
    assert worst < 1e-7


@pytest.mark.slow
def test_where_the_launched_mass_moves_down_at_lift_off():
    """A launch of three numbers, an unstable one: its speed alone is changed, and the energy falls by the local law."""
    masses = [Mass(name, 1.0) for name in ("a", "b", "c")]
    column = Mechanism(
        ("a", "b", "c"), [*masses, Spring("a - b", "r + 0.02*r**3"), Spring("b - c", "1.2*r")], gap="c", launch="a"
    )
    orbit = min(find_all(column, starts(column, 4.0, 4.0)), key=lambda hop: hop.alpha)
    assert orbit.alpha == pytest.approx(-2.1357131, abs=1e-7)
    certificate, energy = orbit.certificate, -orbit.alpha  # its derivative by the speed downwards
    assert certificate.loss_coefficient < 0 < certificate.loss_error < 1e-9
    assert certificate.stable_side is None
    assert multipliers(column, orbit).stability == "unstable"
    once = 1 if certificate.bounce_side == "below" else -1
    launch = column.model.launch_at(orbit(0.0))
    for side, factor, impacts in ((once, 1, 1), (-once, 10, 2)):
        run = simulate(column, {**launch, "alpha": orbit.alpha + side * 1e-7}, hops=1)
        assert sum(event.kind in ("impact", "landing") for event in run.events) == impacts
        law = -factor * certificate.loss_coefficient * energy * 1e-7 ** (4 / 3)
        assert sum(event.loss for event in run.events) == pytest.approx(law, rel=0.03)


class TestHandOverFactors:
    def test_without_a_share_they_are_one_and_ten(self):
        assert hand_over_factors(0.0) == pytest.approx((1.0, 10.0), rel=1e-15)

    @pytest.mark.parametrize("rho", [0.3, 0.6, 0.825])
    def test_series_of_bounces_in_thirty_digits(self, rho):
        """Bounces of a height with the acceleration -t, with the restitution rho^2, from t = 1 or -1 on."""
        e, x = mpmath.mpf(rho) ** 2, mpmath.mpf
        for start, found in zip((1, -1), hand_over_factors(rho), strict=True):
            t, height_speed, lost = x(start), -x(1) / 2, x(0)
            for _ in range(200):
                lost += (1 - e**2) * height_speed**2
                up = -e * height_speed
                # 0 = up s - t s^2/2 - s^3/6 for the time s until the next impact
                s = (-t / 2 + mpmath.sqrt(t**2 / 4 + 2 * up / 3)) * 3
                t, height_speed = t + s, up - t * s - s**2 / 2
            assert found == pytest.approx(float(4 * lost), rel=1e-12)

    @pytest.mark.slow
    def test_certificates_have_them(self):
        rho = float(np.cos(0.6))
        late, early = hand_over_factors(rho)
        c = find(wheel(share=1.0, a=0.3)).certificate
        assert (c.loss_coefficient, c.bounce_factor) == pytest.approx(
            (14.158298218435913 * late, early / late), rel=1e-9
        )
        orbit = find(wheel())
        reach = (early * 14.158298218435913) ** -3
        assert f"up to {reach:.2g} above alpha, to leading order" in str(orbit)
        beside = ReturnMap(orbit.source)(orbit.alpha + reach * np.array([0.7, 1.5]))
        assert (beside.next > orbit.alpha).tolist() == [True, False]
        assert orbit.document()["bounce_factor"] == c.bounce_factor
        assert find(rocker()).certificate.bounce_side == "below"
        lossless = find(linear("wheel", 1.0, 0.5)).certificate
        assert (lossless.loss_coefficient, lossless.bounce_factor, lossless.stable_side) == (None, None, None)
        assert find(Hopper()).certificate.bounce_factor is None
