"""The certificate's claims against 30-digit arithmetic and real hops, and on orbits that are no motion."""

from dataclasses import asdict, replace

import casadi as ca
import mpmath
import numpy as np
import pytest
from conftest import REFERENCES, machine_of, name_of, slow_after
from scipy.integrate import solve_ivp

from orbits import NoOrbit, find, follow, orbit_at
from orbits.continuation.corrector import correct_all
from orbits.continuation.curve import Curve
from orbits.flow.flow import flow_of
from orbits.model.model import as_derived
from orbits.numerics.roots import solve
from orbits.periodic.local_law import by_launch_speed, launch_power
from orbits.shooting import error_bound
from orbits.shooting.formulations import METHODS, landing_gap_slope
from problems import HeavyHand, Hopper, Juggler
from problems.laws import springs

mpmath.mp.dps = 30


@pytest.mark.parametrize("method", [None, *METHODS])
@pytest.mark.parametrize("reference", REFERENCES, ids=name_of)
def test_error_bound_on_the_references(reference, method):
    """Never smaller than the true error, never more than 100 times larger unless below 1e-14; a longer way than the
    scene needs rounds more, and may have 3e-14."""
    simplest = method is None
    if method in ("closed form", "relative") and reference["gravity"] != "1":
        method = "half orbit"
    if method == "closed form" and reference["spring"] != "r":
        method = "relative"
    orbit = find(machine_of(reference), reference["family"], method=method)
    true = abs(float(mpmath.mpf(reference["alpha"]) - mpmath.mpf(orbit.alpha)))
    assert true <= orbit.error
    assert orbit.error <= max(100 * true, 1e-14 if simplest else 3e-14)


def series(start, b, R, M, length, h, order=36):
    """One 30-digit Taylor step of the hopper, force r + b r**3, gravity 1/(1 + z/R)**2 or, with R None, 1."""
    y1, v1, y2, v2 = ([value] for value in start)
    cube, square, r = [], [], []
    base, inverse, gravity = ([], []), ([], []), ([], [])

    def product(a, c, k):
        return mpmath.fsum(a[j] * c[k - j] for j in range(k + 1))

    for k in range(order):
        r.append(y1[k] - y2[k])
        square.append(product(r, r, k))
        cube.append(product(square, r, k))
        pull = []
        for i, height in enumerate((y1, y2)):
            if R is None:
                pull.append(mpmath.mpf(k == 0))
                continue
            base[i].append(height[k] / R + (k == 0) * (1 + (length / R if i == 0 else 0)))
            known = mpmath.fsum(base[i][j] * inverse[i][k - j] for j in range(1, k + 1))
            inverse[i].append(((k == 0) - known) / base[i][0])
            gravity[i].append(product(inverse[i], inverse[i], k))
            pull.append(gravity[i][k])
        force = r[k] + b * cube[k]
        y1.append(v1[k] / (k + 1))
        y2.append(v2[k] / (k + 1))
        v1.append(-(M * force + pull[0]) / (1 + M) / (k + 1))
        v2.append((force - pull[1]) / (1 + M) / (k + 1))
    return [mpmath.fsum(c * h**k for k, c in enumerate(row)) for row in (y1, v1, y2, v2)]


def exact_alpha(orbit, b, R, M, length):
    """The launch speed to 25 digits, by Newton's method on the half orbit from the double-precision answer."""
    b, M, length = mpmath.mpf(b), mpmath.mpf(M), mpmath.mpf(length)
    R = R and mpmath.mpf(R)
    rho = mpmath.findroot(lambda r: r + b * r**3 - 1, orbit.liftoff_extension)

    def middle(alpha, duration):
        state = [rho, alpha, mpmath.mpf(0), mpmath.mpf(0)]
        count = max(4, 2 * len(orbit.flight.times))
        for _ in range(count):
            state = series(state, b, R, M, length, duration / count)
        return mpmath.matrix([state[1], state[3]])

    u = mpmath.matrix([orbit.alpha, orbit.flight_time / 2])
    step = mpmath.mpf("1e-12")
    for _ in range(2):
        value = middle(*u)
        slopes = [(middle(u[0] + step, u[1]) - value) / step, (middle(u[0], u[1] + step) - value) / step]
        jacobian = mpmath.matrix(2, 2)
        for j in range(2):
            jacobian[0, j], jacobian[1, j] = slopes[j][0], slopes[j][1]
        u = u - mpmath.lu_solve(jacobian, value)
    return u[0]


@pytest.mark.parametrize(
    ("b", "R", "M", "length", "family"),
    slow_after(
        4,
        [
            (0.01, None, 1.0, 20.0, 1),
            (3.0, None, 0.2, 20.0, 2),
            (-0.008, None, 1.0, 40.0, 1),
            (0.1, 40.0, 1.0, 15.0, 1),
            (0.3, None, 1.0, 20.0, 5),
            (1.0, 25.0, 3.0, 9.0, 2),
            (0.05, 500.0, 0.1, 40.0, 3),
        ],
    ),
)
@pytest.mark.parametrize("method", [None, pytest.param("shooting", marks=pytest.mark.slow)])
def test_error_bound_against_30_digits(b, R, M, length, family, method):
    law = "1/(1 + z/R)**2" if R else "1"
    parameters = {"b": b, "R": R} if R else {"b": b}
    orbit = find(Hopper("r + b*r**3", law, M, length, parameters=parameters), family, method=method)
    true = abs(exact_alpha(orbit, b, R, M, length) - mpmath.mpf(orbit.alpha))
    assert float(true) <= orbit.error
    assert orbit.error < 1e-12


def duffing_alpha(b, family, start):
    """The launch speed of r + b r**3 under constant gravity to 25 digits, by quadrature of its half oscillations."""
    b = mpmath.mpf(b)
    rho = mpmath.findroot(lambda r: r + b * r**3 - 1, 0.8)

    def excess(alpha):
        energy = alpha**2 / 2 + rho**2 / 2 + b * rho**4 / 4
        square = (mpmath.sqrt(1 + 4 * b * energy) - 1) / b
        rate = lambda s: 1 / mpmath.sqrt(1 + b * square * (1 + mpmath.sin(s) ** 2) / 2)  # noqa: E731
        first = mpmath.quad(rate, [mpmath.asin(rho / mpmath.sqrt(square)), mpmath.pi / 2])
        return first + 2 * family * mpmath.quad(rate, [0, mpmath.pi / 2]) - alpha

    return mpmath.findroot(excess, start, tol=1e-25)


@pytest.mark.parametrize("method", ["relative", "half orbit"])
@pytest.mark.parametrize(
    ("b", "family"), [(0.1, 10), (0.1, 100), (3.0, 40), (50.0, 1), (50.0, 10), (1e4, 3), (0.1, 300)]
)
def test_error_bound_of_stiff_springs_and_high_families(b, family, method):
    orbit = find(Hopper("cubic", parameters={"beta": b}, rest_length=3000.0), family, method=method)
    true = abs(float(duffing_alpha(b, family, orbit.alpha) - mpmath.mpf(orbit.alpha)))
    assert true <= orbit.error
    assert orbit.error < 1e-10 * orbit.alpha


class TestLossCoefficient:
    def test_published_value(self):
        """M = 1, linear spring, first family: C = 3.61694; the same for M and 1/M."""
        assert find(Hopper()).certificate.loss_coefficient == pytest.approx(3.61694, abs=1e-5)
        light, heavy = (find(Hopper(mass_ratio=M)).certificate.loss_coefficient for M in (0.2, 5.0))
        assert light == pytest.approx(heavy, rel=1e-13)

    @pytest.mark.parametrize("method", ["closed form", "relative", "half orbit", "shooting"])
    def test_closed_form(self, method):
        """C = M J**2 (6 q/J)**(4/3)/(8 alpha (1 + M)**2) with J = alpha and q = 2 alpha**3/(1 + alpha**2)."""
        M = 0.3
        orbit = find(Hopper(mass_ratio=M), 2, method=method)
        a = orbit.alpha
        expected = M * a**2 * (6 * 2 * a**2 / (1 + a**2)) ** (4 / 3) / (8 * a * (1 + M) ** 2)
        assert orbit.certificate.loss_coefficient == pytest.approx(expected, rel=1e-11)
        assert (orbit.certificate.stable_side, orbit.certificate.bounce_side) == ("above", "below")

    @pytest.mark.parametrize(
        "machine",
        [
            Hopper("cubic", mass_ratio=0.7),
            Hopper("sinh", "1/(1 + z/R)**2", 0.7, 20.0, parameters={"R": 60.0}),
            Juggler("toda", "exp(-z/H)", 2.0, 20.0, parameters={"H": 80.0}),
        ],
        ids=["cubic", "sinh and inverse square", "juggler"],
    )
    def test_loss_of_a_real_hop(self, machine):
        """Launch at alpha + d, fly to the gap's next zero with scipy, and compare the energy lost with C d**(4/3)."""
        from scipy.integrate import solve_ivp

        orbit = find(machine)
        p, model = machine.values, machine.model
        flow = flow_of(model.flight, tuple(p))
        values = np.array(list(p.values()))
        gap = model.gap(p)
        d = 1e-5
        start = np.array(model.launch({"liftoff": orbit.liftoff_extension, "alpha": orbit.alpha + d}, p))
        landing = lambda t, x: gap(x)  # noqa: E731
        landing.terminal, landing.direction = True, -1
        answer = solve_ivp(
            lambda t, x: flow.rates(x, values), (0, 2 * orbit.flight_time), start, "DOP853", rtol=1e-13, atol=1e-15,
            events=landing, first_step=1e-3,
        )  # fmt: skip
        end = answer.y_events[0][-1]
        speed = end @ np.array([0, gap.weights[0] or 0, 0, 0]) + end[3] * gap.weights[2]
        lost = 0.5 * model.impact_mass(end, p) * speed**2
        drop = lost / ((1 + p["mass_ratio"]) * orbit.alpha)
        assert drop / d ** (4 / 3) == pytest.approx(orbit.certificate.loss_coefficient, rel=0.05)


def test_the_local_law_takes_numbers_arrays_and_symbols():
    model, p = Hopper("cubic", mass_ratio=0.7).model, Hopper("cubic", mass_ratio=0.7).values
    launch = lambda u: model.launch(u, p)  # noqa: E731
    alpha = ca.SX.sym("alpha")
    direction = by_launch_speed(launch, {"liftoff": 0.9, "alpha": 2.0})
    arrays = by_launch_speed(launch, {"liftoff": np.array([0.9]), "alpha": np.array([2.0])})
    symbols = by_launch_speed(launch, {"liftoff": ca.SX(0.9), "alpha": alpha})
    assert [float(np.squeeze(d)) for d in arrays] == direction == [float(d) for d in symbols] == [0, 1, 0, 0]
    gradient = model.flight_gradient(launch({"liftoff": 0.9, "alpha": alpha}), p, [])
    power = ca.Function("power", [alpha], [launch_power(gradient, symbols)])
    assert float(power(2.0)) == pytest.approx((1 + 0.7) * 2.0, rel=1e-15)
    assert landing_gap_slope(model, [0.0, 0.0, 3.0, 0.0], p) == 3.0


class TestNoMotion:
    def test_foot_below_ground(self):
        orbit = find(Hopper("r + a*sin(b*r)", mass_ratio=2.0, parameters={"a": 1.8, "b": 5.7}, rest_length=40))
        assert not orbit.admissible
        (violation,) = [v for v in orbit.violations if v.startswith("foot below ground")]
        when = float(violation.split("t = ")[1].split(" ")[0])
        t = np.linspace(0, orbit.flight_time / 2, 20001)
        foot = orbit(t)[:, 2]
        assert foot.min() < 0
        assert t[foot.argmin()] == pytest.approx(when, abs=1e-3)
        assert orbit.certificate.clearance == pytest.approx(foot.min(), rel=1e-5)

    def test_ground_pulls_in_contact(self):
        orbit = find(Hopper("r + a*sin(b*r)", parameters={"a": 4.5, "b": 2.2}, rest_length=40), 2)
        assert any("ground would have to pull" in v for v in orbit.violations)
        t = orbit.flight_time + np.linspace(0, orbit.contact_time, 5001)
        r = orbit(t)[:, 0]
        force = 1 - (r + 4.5 * np.sin(2.2 * r))
        assert force.min() == pytest.approx(orbit.certificate.smallest_contact_force, abs=1e-4)
        assert force.max() == pytest.approx(orbit.certificate.largest_contact_force, abs=1e-4)

    def test_masses_pass_through_each_other(self):
        orbit = find(Hopper("r", rest_length=5.0))
        (violation,) = orbit.violations
        assert "masses pass through each other" in violation
        assert orbit.certificate.smallest_separation == pytest.approx(12.338059058 - 15, rel=1e-9)

    def test_collapse_has_no_contact_time_and_no_period(self):
        orbit = find(machine_of(next(r for r in REFERENCES if not r["admissible"])), 2)
        assert orbit.contact_time is None
        assert orbit.certificate.smallest_separation is None
        with pytest.raises(Exception, match="no period"):
            _ = orbit.period
        assert orbit(0.0)[0] == pytest.approx(orbit.liftoff_extension, rel=1e-15)
        with pytest.raises(Exception, match="never ends"):
            orbit(2 * orbit.flight_time)


def test_energy_drift_is_that_of_the_motion():
    """The potential of the cubic spring is known: energy along flight and contact, to the certificate's figure."""
    M, b = 0.5, 0.3
    orbit = find(Hopper("cubic", mass_ratio=M, parameters={"beta": b}))
    y1, v1, y2, v2 = orbit(np.linspace(0, orbit.period, 2000)).T
    r = y1 - y2
    energy = (1 + M) / 2 * (v1**2 + M * v2**2) + M * (r**2 / 2 + b * r**4 / 4) + y1 + M * y2
    kinetic = (1 + M) / 2 * orbit.alpha**2
    assert np.ptp(energy) < 2e-14 * kinetic
    assert orbit.certificate.energy_drift < 1e-14


def test_a_piecewise_law_is_certified_too():
    orbit = find(Hopper(springs.end_stops(gap=2.0, stop=30.0), mass_ratio=0.6, rest_length=20.0), 2)
    assert orbit.admissible
    assert orbit.error < 1e-13
    r = orbit(np.linspace(0, orbit.period, 100001))
    assert orbit.certificate.smallest_separation == pytest.approx(20 + (r[:, 0] - r[:, 2]).min(), abs=1e-7)


def test_whole_flights_certified_together():
    """Of models without a reversor, two parts of each flight in turn: against half of each by time reversal."""
    machine = Hopper("cubic", rest_length=4.0, parameters={"beta": 0.3})
    object.__setattr__(machine, "model", replace(machine.model, reversor=None, reduction=None))
    ratios = [0.7, 1.0, 3.0, 8.0]  # of the first the masses meet
    mirrored = [find(Hopper("cubic", mass_ratio=M, rest_length=4.0, parameters={"beta": 0.3}), 2) for M in ratios]
    curve, row = Curve(machine, "mass_ratio", "shooting", 10.0), np.eye(5)[4]
    xs = np.array(
        [[o.liftoff_extension, o.alpha, o.flight_time, 0.0, M] for o, M in zip(mirrored, ratios, strict=True)]
    )
    ats, error = curve.certify_all(correct_all(curve, xs, np.tile(row, (4, 1)), xs[:, 4], np.tile(row, (4, 1))))
    assert error is None
    for at, orbit in zip(ats, mirrored, strict=True):
        assert at.point.alpha == pytest.approx(orbit.alpha, rel=1e-12)
        assert at.point.flight_time == pytest.approx(orbit.flight_time, rel=1e-12)
        assert at.point.contact_time == pytest.approx(orbit.contact_time, rel=1e-12)
        mine, theirs = asdict(at.point.certificate), asdict(orbit.certificate)
        for name in ("family", "stable_side", "bounce_side", "violations"):
            assert mine[name] == theirs[name], name
        for name in ("clearance", "smallest_separation", "largest_contact_force", "landing_jerk", "loss_coefficient"):
            assert mine[name] == pytest.approx(theirs[name], rel=1e-7, abs=1e-10), name


def test_an_infinitely_heavy_hand_loses_nothing_on_either_side():
    certificate = find(HeavyHand("cubic")).certificate
    assert certificate.loss_coefficient == 0
    assert certificate.stable_side is certificate.bounce_side is None


def test_a_loss_beyond_all_numbers_is_refused():
    machine = Hopper("cubic")
    object.__setattr__(machine, "model", as_derived(replace(machine.model, impact_mass=lambda x, p: np.inf)))
    with pytest.raises(NoOrbit, match="its numbers overflow"):
        find(machine)


def test_one_singular_system_of_several():
    square = np.array([np.eye(2), [[1.0, 2.0], [2.0, 4.0]], 2 * np.eye(2)])
    found = solve(square, np.array([[[1.0], [3.0]]]))
    assert found[[0, 2], :, 0] == pytest.approx(np.array([[1.0, 3.0], [0.5, 1.5]]))
    assert np.isnan(found[1]).all()


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


def _turn(powers, rho, alpha):
    """r' and its derivative by alpha at the time alpha in 30 digits, r'' = -(r + c2 r**2 + ...), by Taylor steps."""
    r, v, s, w, left = rho, alpha, mpmath.mpf(0), mpmath.mpf(1), alpha

    def product(a, b):
        return mpmath.fsum(x * y for x, y in zip(a, reversed(b), strict=True))

    while left > 0:
        rs, vs, ss, ws, force, slope = [r], [v], [s], [w], [], []
        chain = [[] for _ in powers]  # the powers of r, from 0
        for k in range(30):
            for i, row in enumerate(chain):
                row.append(mpmath.mpf(k == 0) if i == 0 else product(chain[i - 1], rs))
            force.append(mpmath.fsum(c * product(row, rs) for c, row in zip(powers, chain, strict=True)))
            slope.append(
                mpmath.fsum((i + 1) * c * row[k] for i, (c, row) in enumerate(zip(powers, chain, strict=True)))
            )
            for row, rate in ((rs, vs[k]), (ss, ws[k]), (vs, -force[k]), (ws, -product(slope, ss[: k + 1]))):
                row.append(rate / (k + 1))
        step = min(left, (mpmath.mpf("1e-28") / max(map(abs, (rs[-1], vs[-1], ws[-1])))) ** (mpmath.mpf(1) / 30))
        r, v, s, w = (mpmath.fsum(c * step**k for k, c in enumerate(row)) for row in (rs, vs, ss, ws))
        left -= step
    return v, w - mpmath.fsum(c * r ** (i + 1) for i, c in enumerate(powers))


@pytest.mark.parametrize(
    ("powers", "family"),
    [
        ((0.7643693446449379, 0.09008323639847042), 3),
        ((0.8187501117012889, 0.1658202845056341, -0.005792147986670724), 2),
        ((-0.14861987010119804, 0.018246038018433646, 0.016564753433755047, 0.0006058321236262336), 2),
        ((0.30201729459173826, 0.24400462310693716), 3),
    ],
)
@pytest.mark.slow
def test_the_error_figure_covers_what_the_flow_makes_of_rounding(powers, family):
    """Of some hundred random polynomial springs these come nearest to their figures, or were beyond half of them."""
    names = {f"c{i}": c for i, c in enumerate(powers, start=2)}
    orbit = find(
        Hopper("r + " + " + ".join(f"c{i}*r**{i}" for i in range(2, 2 + len(powers))), parameters=names), family
    )
    exact = [mpmath.mpf(1), *map(mpmath.mpf, powers)]
    force = lambda r: mpmath.fsum(c * r ** (i + 1) for i, c in enumerate(exact)) - 1  # noqa: E731
    rho, alpha = mpmath.findroot(force, orbit.liftoff_extension), mpmath.mpf(orbit.alpha)
    for _ in range(2):
        value, slope = _turn(exact, rho, alpha)
        alpha -= value / slope
    assert abs(alpha - orbit.alpha) <= orbit.error


@pytest.mark.parametrize("shift", [1e-12, 1e-4])
def test_two_integrations_that_disagree(monkeypatch, shift):
    """The error is twice the change of alpha that takes the shift of the speed in mid-flight back; a large one is
    refused. The slope of that speed over alpha, at half the time of flight, alpha, is scipy's."""
    machine = Hopper("cubic", parameters={"beta": 0.1})
    orbit, step = find(machine), 1e-4

    def middle(alpha):
        field = lambda _, x: [x[1], -x[0] - 0.1 * x[0] ** 3]  # noqa: E731
        start = [orbit.liftoff_extension, alpha]
        return solve_ivp(field, (0.0, alpha), start, method="DOP853", rtol=1e-12, atol=1e-12).y[1, -1]

    slope = (middle(orbit.alpha + step) - middle(orbit.alpha - step)) / (2 * step)
    by_another_method = error_bound._end_by_another_method
    monkeypatch.setattr(error_bound, "_end_by_another_method", lambda *motion: by_another_method(*motion) + shift)
    error = 2 * shift / abs(slope)
    if shift < 1e-9:
        assert find(machine).error == pytest.approx(error, rel=1e-2)
        return
    with pytest.raises(NoOrbit, match=rf"launch speed 3.41\d* may be off by {error:.1e}"):
        find(machine)
