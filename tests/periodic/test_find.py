"""Orbits against the references, closed forms, other ways of finding them, and 300 random laws."""

import dataclasses
import time
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
from conftest import PROVED, REFERENCES, machine_of, middle, slow_after

import orbits.periodic.certificate
from orbits import InputError, NoOrbit, find, find_all, follow, sweep, time_limit
from orbits.shooting.formulations import METHODS, half_orbit, whole_flight
from problems import Hopper, Juggler
from problems.laws import gravity, springs
from studies.stress import random_laws


def assert_close(value, expected, tolerance):
    """Equal to a relative tolerance, or both None."""
    assert (value is None) == (expected is None)
    if expected is not None:
        assert value == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize("method", [None, "shooting"])
def test_reference_orbits(reference, method):
    orbit = find(machine_of(reference), reference["family"], method=method)
    assert orbit.alpha == pytest.approx(float(reference["alpha"]), rel=1e-12)
    assert orbit.flight_time == pytest.approx(float(reference["flight_time"]), rel=1e-12)
    assert orbit.liftoff_extension == pytest.approx(float(reference["liftoff_extension"]), rel=1e-12)
    mid = [float(reference["y1_mid"]), float(reference["y2_mid"])]
    assert orbit.state_mid_flight[::2] == pytest.approx(mid, rel=1e-11)
    assert orbit.family == reference["family"]
    assert orbit.admissible == reference["admissible"]
    assert_close(orbit.contact_time, reference["contact_time"], 1e-9)
    assert_close(orbit.certificate.smallest_separation, reference["smallest_separation"], 1e-9)
    # The minimum of the reference was sampled, to about 1e-8 of its value.
    assert_close(orbit.certificate.clearance, reference["lowest_interior_minimum"], 3e-8)
    if reference["violation"]:
        assert orbit.violations == (reference["violation"],)


@pytest.mark.parametrize("reference", [r for r in REFERENCES if r["gravity"] == "1"])
def test_every_method_leads_to_the_same_orbit(reference):
    found = {}
    for method in METHODS[1 if "**" in reference["spring"] else 0 :]:
        found[method] = find(machine_of(reference), reference["family"], method=method)
        assert found[method].method == method
    for orbit in found.values():
        assert orbit.alpha == pytest.approx(float(reference["alpha"]), rel=1e-12)
        t = np.linspace(0, orbit.flight_time, 101)
        assert orbit(t) == pytest.approx(found["relative"](t), abs=2e-12 * orbit.alpha**2)


@pytest.mark.parametrize("mass_ratio", [0.01, 1.0, 50.0])
@pytest.mark.parametrize("family", [1, 2, 7])
def test_linear_orbit_is_the_closed_form(mass_ratio, family):
    """Eqs. (7), (8) and (12) of the paper."""
    orbit = find(Hopper(mass_ratio=mass_ratio), family)
    alpha = float(mpmath.findroot(lambda a: mpmath.sin(a) - a * mpmath.cos(a), (family + 0.5) * np.pi - 0.01))
    assert orbit.alpha == pytest.approx(alpha, rel=1e-15)
    t, M = np.linspace(0, orbit.flight_time, 200), mass_ratio
    y2 = (1 + alpha * t - t**2 / 2 - alpha * np.sin(t) - np.cos(t)) / (1 + M)
    y1 = (1 + alpha * t - t**2 / 2 + M * (alpha * np.sin(t) + np.cos(t))) / (1 + M)
    assert orbit(t)[:, [0, 2]] == pytest.approx(np.stack([y1, y2], axis=1), abs=1e-13 * alpha**2)


def test_alpha_does_not_depend_on_the_masses_under_constant_gravity():
    alphas = [find(Hopper("cubic", mass_ratio=M)).alpha for M in (1e-3, 1.0, 1e3)]
    assert alphas == pytest.approx([alphas[0]] * 3, rel=1e-14)


def test_a_stiffer_line_scales():
    """r'' = -k r: time scales with 1/sqrt(k), so does alpha; lift-off at 1/k."""
    orbit = find(Hopper("k*r", parameters={"k": 4.0}))
    assert orbit.method == "closed form"
    assert orbit.alpha == pytest.approx(4.493409457909064 / 2, rel=1e-15)
    assert orbit.liftoff_extension == pytest.approx(0.25)


def test_the_family_is_measured():
    assert find(Hopper("r + 40*r**3")).alpha == pytest.approx(1.34798859, rel=1e-8)
    assert find(Hopper("r + 40*r**3"), 2).alpha == pytest.approx(2.00809902, rel=1e-8)


@pytest.mark.parametrize(("beta", "family"), [(0.3, 1), (0.3, 2), (0.3, 5), (-0.005, 1)])
def test_families_count_stationary_points(beta, family):
    orbit = find(Hopper("cubic", parameters={"beta": beta}), family)
    t = np.linspace(0, orbit.flight_time / 2, 20001)[1:]
    speed = orbit(t)[:, 1] - orbit(t)[:, 3]
    turns = np.count_nonzero(np.sign(speed[1:-1]) != np.sign(speed[:-2]))
    assert turns + 1 == family + 1


def test_large_families():
    linear = find(Hopper(), 60)
    assert linear.alpha == pytest.approx(190.06109412465196, rel=1e-14)
    cubic = find(Hopper("cubic", parameters={"beta": 0.1}), 60)
    shot = find(Hopper("cubic", parameters={"beta": 0.1}), 60, method="shooting")
    assert (cubic.family, shot.family) == (60, 60)
    assert shot.alpha == pytest.approx(cubic.alpha, rel=1e-12)


def test_softening_spring_before_and_past_its_fold():
    """Fact: family 1 of r + b r**3 folds at b = -0.0106952149164040; the orbit before the fold is the lower one."""
    assert find(Hopper("cubic", parameters={"beta": -0.005})).alpha == pytest.approx(4.7432, abs=1e-4)
    near = find(Hopper("cubic", parameters={"beta": -0.010695214}))
    assert near.alpha == pytest.approx(5.83222, abs=2e-3)
    with pytest.raises(NoOrbit, match="does not come back"):
        find(Hopper("cubic", parameters={"beta": -0.0108}))


@pytest.mark.parametrize(("b", "family"), [(0.2, 1), (0.32, 1), (0.15, 2)])
def test_saturating_spring_has_a_family_below_its_limit(b, family):
    assert b < 1 / (2 * family + 1)
    assert find(Hopper("tanh", parameters={"b": b}), family).family == family


def test_saturating_spring_has_none_above_its_limit():
    with pytest.raises(NoOrbit, match="none up to launch speed"):
        find(Hopper("tanh", parameters={"b": 0.34}))


GOLDEN = {
    float(beta): (middle(hop["alpha"]), middle(hop["mid_flight_extension"])) for beta, hop in PROVED["cubic"].items()
}


@pytest.mark.parametrize("beta", GOLDEN)
def test_golden_cubic_values(beta):
    orbit = find(Hopper("cubic", parameters={"beta": beta}))
    body, foot = orbit.state_mid_flight[::2]
    assert (orbit.alpha, body - foot) == pytest.approx(GOLDEN[beta], rel=1e-13)


class TestJuggler:
    @pytest.mark.parametrize("mass_ratio", [0.4, 1.0, 6.0])
    @pytest.mark.parametrize(("force", "beta"), [("r", 0.0), ("r + beta*r**3", 0.3)])
    def test_is_the_hopper_under_equation_6(self, mass_ratio, force, beta):
        """w1 = (y1 - rho) + M y2, w2 = (y1 - rho) - y2, one clock; the hand's force is phi(w2 + rho) - 1.

        Contact too is one motion up to the clock of its own: eq. (6) with y2 = 0.
        """
        M = mass_ratio
        hopper = find(Hopper(force, mass_ratio=M, parameters={"beta": beta} if beta else {}), 2)
        rho = hopper.liftoff_extension
        shifted = f"(r + rho) + {beta}*(r + rho)**3 - 1" if beta else "r"
        juggler = find(Juggler(shifted, mass_ratio=M, parameters={"rho": rho} if beta else {}), 2)
        assert juggler.alpha == pytest.approx(hopper.alpha, rel=1e-12)
        t = np.linspace(0, hopper.flight_time, 301)
        y1, v1, y2, v2 = hopper(t).T
        expected = [y1 - rho + M * y2, v1 + M * v2, y1 - rho - y2, v1 - v2]
        assert juggler(t) == pytest.approx(np.stack(expected, axis=1), abs=1e-11 * hopper.alpha**2)
        assert juggler.contact_time == pytest.approx(hopper.contact_time, rel=1e-12)
        t = hopper.flight_time + np.linspace(0, hopper.contact_time, 101)
        assert juggler(t)[:, 0] == pytest.approx(hopper(t)[:, 0] - rho, abs=1e-11 * hopper.alpha**2)
        assert juggler.certificate.loss_coefficient == pytest.approx(hopper.certificate.loss_coefficient, rel=1e-9)

    def test_the_printed_clock_scaling_is_wrong(self):
        """Section 7 scales the clocks by sqrt(M/(1 + M)); the flight times agree only without it."""
        hopper, juggler = find(Hopper(mass_ratio=0.5)), find(Juggler(mass_ratio=0.5))
        assert juggler.flight_time == pytest.approx(hopper.flight_time, rel=1e-14)
        assert juggler.flight_time != pytest.approx(np.sqrt(0.5 / 1.5) * hopper.flight_time, rel=0.1)

    def test_they_are_two_machines_when_gravity_varies(self):
        law = gravity.inverse_square(R=60.0)
        hopper = find(Hopper("r", law, rest_length=10.0))
        juggler = find(Juggler("r", law, rest_length=10.0))
        assert juggler.alpha != pytest.approx(hopper.alpha, rel=1e-3)
        assert juggler.alpha == pytest.approx(
            find(Juggler("r", law, rest_length=10.0), method="shooting").alpha, rel=1e-12
        )


@pytest.mark.parametrize(
    "machine",
    [
        Hopper("r", rest_length=20.0),
        machine_of(REFERENCES[4]),
        Hopper(springs.bilinear(ratio=2.0), rest_length=20.0),
    ],
    ids=["linear", "varying", "in pieces"],
)
def test_a_model_without_a_reversor_is_unfolded(machine):
    """The whole flight with the energy's gradient added to the field, against half of it by time reversal."""
    mirrored = find(machine)
    object.__setattr__(machine, "model", dataclasses.replace(machine.model, reversor=None, reduction=None))
    whole = find(machine, method="shooting")
    assert whole.alpha == pytest.approx(mirrored.alpha, rel=1e-12)
    assert whole.flight_time == pytest.approx(mirrored.flight_time, rel=1e-12)
    assert whole.family == 1
    assert whole.certificate.clearance == mirrored.certificate.clearance
    assert abs(whole.certificate.unfolding) < 1e-12
    assert whole.certificate.loss_coefficient == pytest.approx(mirrored.certificate.loss_coefficient, rel=1e-8)
    assert whole.contact_time == pytest.approx(mirrored.contact_time, rel=1e-12)
    assert whole.certificate.largest_contact_force == pytest.approx(mirrored.certificate.largest_contact_force)
    assert whole.certificate.smallest_contact_force == mirrored.certificate.smallest_contact_force
    t = np.linspace(0, whole.period, 101)
    assert whole(t) == pytest.approx(mirrored(t), abs=1e-10)
    with pytest.raises(InputError, match="needs a reversor"):
        find(machine, method="half orbit")
    with pytest.raises(InputError, match="needs a model with a reversor"):
        half_orbit(machine.model)


def test_the_direct_statement_is_degenerate_and_the_unfolded_one_is_not():
    """Height and speed of the foot at landing depend on the launch speed alone, so they cannot fix the flight time."""
    from orbits.shooting.single_shooting import shooting_equations

    machine = Hopper("r", rest_length=20.0)
    orbit = find(machine)
    values = machine.values
    equations = shooting_equations(whole_flight(machine.model), tuple(values))
    evaluation = equations.evaluate([1.0, orbit.alpha, orbit.flight_time, 0.0], np.array(list(values.values())))
    singular = np.linalg.svd(evaluation.jacobian[1:3, 1:3], compute_uv=False)
    assert singular[-1] < 1e-12 * singular[0]
    assert np.linalg.cond(evaluation.jacobian) < 1e6


def test_contact_and_flight_are_one_periodic_motion():
    orbit = find(machine_of(REFERENCES[4]))
    t = np.linspace(0, orbit.period, 77)
    assert orbit(t + 3 * orbit.period) == pytest.approx(orbit(t), abs=1e-11)
    for joint in (orbit.flight_time, orbit.period):
        assert orbit(joint - 1e-9) == pytest.approx(orbit(joint + 1e-9), abs=1e-7)
    assert orbit(orbit.period - t[:40])[:, [0, 2]].shape == (40, 2)


def test_a_machine_with_other_values_shares_its_model():
    machine = machine_of(REFERENCES[2])
    other = machine.with_values(beta=1.0, mass_ratio=3.0)
    assert other.model is machine.model
    assert find(other).alpha == pytest.approx(GOLDEN[1][0], rel=1e-13)
    assert machine.values["beta"] == 0.3
    with pytest.raises(InputError, match="has a parameter 'gamma'"):
        machine.with_values(gamma=1.0)


@pytest.mark.parametrize("block", slow_after(4, range(10)))
def test_random_laws_give_a_certified_orbit_or_a_named_failure(block):
    """300 laws, families 1 to 3. The family and the equation are checked by scipy, not by the toolkit."""
    found, refusals = 0, []
    for index, (text, parameters) in list(enumerate(random_laws(300, 20)))[30 * block : 30 * block + 30]:
        family = index % 3 + 1
        try:
            orbit = find(Hopper(text, parameters=parameters, mass_ratio=0.3 + index % 5, rest_length=500), family)
        except (NoOrbit, InputError) as error:
            refusals.append(str(error))
            continue
        found += 1
        assert orbit.error <= 1e-12 * (1 + orbit.alpha)
        assert orbit.certificate.energy_drift < 1e-12
        assert orbit.family == family
        if index % 6 == 0:
            check_with_scipy(orbit, springs.formula(text, **parameters), family)
    assert found >= 10
    assert all(len(refusal) > 20 for refusal in refusals)


def check_with_scipy(orbit, law, family):
    from scipy.integrate import solve_ivp

    turn = lambda t, x: x[1]  # noqa: E731
    answer = solve_ivp(
        lambda t, x: [x[1], -float(law(x[0]))],
        (0, orbit.alpha),
        [orbit.liftoff_extension, orbit.alpha],
        "DOP853",
        rtol=1e-11,
        atol=1e-12,
        events=turn,
    )
    assert answer.y[1, -1] == pytest.approx(0, abs=1e-7 * orbit.alpha**2)
    assert sum(t < orbit.alpha * (1 - 1e-6) for t in answer.t_events[0]) == family


@pytest.mark.parametrize("family", [0, -1, 1.5, "one", True, 10**7])
def test_bad_families(family):
    with pytest.raises(InputError, match="a family is a whole number"):
        find(Hopper(), family)


def test_bad_methods():
    with pytest.raises(InputError, match="unknown method 'newton'"):
        find(Hopper(), method="newton")
    with pytest.raises(InputError, match="'closed form' needs a straight-line spring"):
        find(Hopper("cubic"), method="closed form")
    with pytest.raises(InputError, match="'relative' needs two masses and constant gravity"):
        find(Hopper("r", "exp(-z/50)", rest_length=10), method="relative")


def test_a_solve_that_lands_on_another_family_has_failed(monkeypatch):
    monkeypatch.setattr(orbits.periodic.certificate, "_families", lambda extension, parts: [2])
    with pytest.raises(NoOrbit, match="ended on an orbit of family 2"):
        find(Hopper())


def test_gravity_that_does_not_bring_it_back_is_a_named_failure():
    with pytest.raises(NoOrbit, match=r"no lossless orbit of family 1: with .*% of gravity's variation"):
        find(Hopper("r", gravity.linear(kappa=0.2), rest_length=20.0))


def test_a_table_too_short_names_its_range():
    with pytest.raises(NoOrbit, match=r"leaves the law's range, \[-2, 2\]"):
        find(Hopper(springs.table((np.linspace(-2, 2, 9), np.linspace(-2, 2, 9)))))


@pytest.mark.parametrize("reach", [4.65, 5.0, 6.5, 8.0])
def test_a_straight_table_is_the_linear_spring_as_far_as_it_reaches(reach):
    """The extension of the linear orbit lies between -4.603 and 1 in flight."""
    r = np.linspace(-reach, reach, 9)
    orbit = find(Hopper(springs.table((r, r))))
    assert orbit.alpha == pytest.approx(4.493409457909064, rel=1e-12)
    if not orbit.admissible:
        assert "contact: the extension leaves" in orbit.violations[0]
        assert f"leaves the law's range, [-{reach:g}" in orbit.violations[0]


@pytest.mark.parametrize("stiffness", [1e-6, 1e-2, 1e4, 1e9])
def test_units_do_not_matter(stiffness):
    """K r + c K^3 r^3 is the spring r + c r^3 in other units."""
    scaled = find(Hopper("K*r + c*r**3", parameters={"K": stiffness, "c": -0.0106 * stiffness**3}))
    plain = find(Hopper("cubic", parameters={"beta": -0.0106}))
    assert scaled.alpha * np.sqrt(stiffness) == pytest.approx(plain.alpha, rel=1e-12)


@pytest.mark.parametrize(
    ("spring", "gravity"),
    [
        ("r + 0.5*exp(-50*(r + 3)**2)", "1"),
        ("r + 5*exp(-50*(r + 3)**2)", "1"),
        ("r + 20*exp(-200*(r + 6)**2)", "1"),  # passed in contact alone
        pytest.param("r + 0.5*exp(-5000*(r + 3)**2)", "1", marks=pytest.mark.slow),
        pytest.param("r", "1 + 0.5*exp(-200*(z - 5)**2)", marks=pytest.mark.slow),
    ],
)
def test_what_is_narrower_than_a_step_is_not_missed_silently(spring, gravity):
    machine = Hopper(spring, gravity, rest_length=20.0)
    for family in (1, 2):
        refusal = ""
        try:
            drift = find(machine, family).certificate.energy_drift
        except NoOrbit as error:
            refusal = str(error)
        assert "certified" in refusal or "did not converge" in refusal if refusal else drift < 1e-12


@pytest.mark.slow
def test_a_force_that_jumps_at_a_breakpoint_is_the_limit_of_a_steep_one():
    """r + 0.2 sgn r against r + 0.2 tanh(w r): the difference falls with 1/w^2, in the derivatives too."""
    jump = find(Hopper(springs.function(lambda r: r + 0.2 * np.sign(r), breakpoints=(0,))))
    for steepness in (200.0, 2000.0):
        steep = find(Hopper("r + 0.2*tanh(w*r)", parameters={"w": steepness}))
        difference = 10 / steepness**2
        assert steep.alpha == pytest.approx(jump.alpha, abs=difference)
        coefficients = (steep.certificate.loss_coefficient, jump.certificate.loss_coefficient)
        assert coefficients[0] == pytest.approx(coefficients[1], abs=40 * difference)


def test_an_exponent_may_be_a_parameter():
    orbit = find(Hopper("r + beta*r**n", parameters={"beta": 0.3, "n": 3.0}))
    assert orbit.alpha == pytest.approx(float(REFERENCES[2]["alpha"]), rel=1e-12)


def test_threads_do_not_disturb_each_other():
    from concurrent.futures import ThreadPoolExecutor

    machines = [Hopper("cubic", parameters={"beta": 0.1 + 0.01 * i}) for i in range(40)]
    with ThreadPoolExecutor(4) as pool:
        together = [(orbit.alpha, orbit.error) for orbit in pool.map(find, machines)]
    assert together == [(orbit.alpha, orbit.error) for orbit in map(find, machines)]


@pytest.mark.parametrize("spring", ["r*sqrt(abs(r))", "r*abs(r)**0.5", "sign(r)*abs(r)**1.5"])
def test_a_spring_without_slope_at_rest(spring):
    """One law in three spellings: homogeneous, so its half period at amplitude A goes with A^-0.25."""
    assert find(Hopper(spring)).alpha == pytest.approx(3.459326351441497, rel=1e-9)


@pytest.mark.parametrize(
    ("centre", "width", "shift"), [(-0.5, 3e-3, 1.4e-5), (1.3, 1e-3, -2.6e-5)], ids=["wide", "narrow"]
)
def test_bumps_that_the_steps_leap_over_are_noticed(centre, width, shift):
    """A bump of height 0.5 shifts alpha a little: found right, or refused."""
    law = f"r + 0.5*exp(-((r - ({centre}))/{width})**2)"
    try:
        alpha = find(Hopper(law)).alpha
    except NoOrbit:
        return
    assert alpha - 4.493409457909064 == pytest.approx(shift, rel=0.1)


def test_rounding_near_a_singularity_is_no_leap():
    orbit = find(Hopper(springs.rubber(length=0.5)), 60)
    assert orbit.alpha == pytest.approx(165.944491364, rel=1e-10)


@pytest.mark.parametrize("mass_ratio", [1e-4, 1e-8, 1e-11])
def test_a_light_foot_stays_long_on_the_ground(mass_ratio):
    """Contact is an oscillation at the frequency sqrt(M/(1+M)) about -1/M."""
    orbit = find(Hopper("r", mass_ratio=mass_ratio))
    w = np.sqrt(mass_ratio / (1 + mass_ratio))
    half = (np.pi - np.arctan2(orbit.alpha / w, 1 + 1 / mass_ratio)) / w
    assert orbit.contact_time == pytest.approx(2 * half, rel=1e-9)


def test_a_fold_is_searched_once(monkeypatch):
    """Beyond the fold of cubic springs the lateness has a minimum above zero before the barrier."""
    from orbits.periodic import guess as launch

    runs, count = launch.half_oscillations, []
    monkeypatch.setattr(launch, "half_oscillations", lambda *a: (count.append(1), runs(*a))[1])
    with pytest.raises(NoOrbit, match="does not come back"):
        find(Hopper("r + beta*r**3 + delta*r**5", parameters={"beta": -0.0126, "delta": -1e-5}))
    assert len(count) < 30


@pytest.mark.parametrize("spring", ["r**2", "exp(r)/2"])
def test_a_spring_that_never_pushes_is_soon_refused(spring, monkeypatch):
    from orbits.periodic import guess as launch

    runs, count = launch.half_oscillations, []
    monkeypatch.setattr(launch, "half_oscillations", lambda *a: (count.append(1), runs(*a))[1])
    with pytest.raises(NoOrbit, match=r"does not come back|none up to"):
        find(Hopper(spring))
    assert len(count) < 200


def test_an_orbit_that_all_but_escapes():
    """With delta -> 0 the extension goes ever further before it comes back, and amplifies a change of the launch speed
    until no digit is left; what is found keeps within its error of the parabola through better determined orbits."""
    spring = Hopper("r + beta*r**3 + delta*r**5", parameters={"beta": -0.02, "delta": 1e-5})
    known = (3e-6, 1e-6, 3e-7)
    orbits = [find(spring.with_values(delta=delta)) for delta in known]
    parabola = np.polynomial.Polynomial.fit(known, [orbit.alpha for orbit in orbits], 2)
    orbit = find(spring.with_values(delta=1e-7))
    assert orbit.family == 1
    assert orbit.error < 2e-6
    assert abs(orbit.alpha - parabola(1e-7)) < orbit.error
    with pytest.raises(NoOrbit, match="no step reduces the residual"):
        find(spring.with_values(delta=1e-10))


class TestTimeLimit:
    """A force that bends where it vanishes is followed step by step, for minutes."""

    SLOW = Hopper("abs(r)")

    @pytest.mark.parametrize("search", [find, find_all])
    def test_what_takes_longer_is_ended(self, search):
        began = time.monotonic()
        with pytest.raises(NoOrbit, match=r"it takes more than 0.5 s: allow it more by its limit"):
            search(self.SLOW, limit=0.5)
        assert time.monotonic() - began < 20

    def test_a_block_limits_all_that_is_computed_in_it(self, monkeypatch):
        """Beyond the 30 s that a search has without one, too; a family is handed back as far as it was followed."""
        with pytest.raises(NoOrbit, match=r"it takes more than 0.3 s.*nothing is kept"), time_limit(0.3):
            sweep(Hopper("abs(r) + b*r", parameters={"b": 0.1}), {"b": [0.1, 0.2]}, progress=False)
        late = SimpleNamespace(monotonic=lambda: np.inf)
        with time_limit(60.0):
            family = follow(
                Hopper("cubic", rest_length=9.0), "beta", 0.4,
                progress=lambda share: share > 0.3 and monkeypatch.setattr("orbits.running.time_limit.time", late),
            )  # fmt: skip
        assert family.end.kind == "interrupted"
        assert "it takes more than 60 s" in family.end.reason
        assert 0.33 < family[-1].value < 0.36
        monkeypatch.undo()
        whole = follow(Hopper("cubic", rest_length=9.0), "beta", 0.4, resume=family)
        assert whole.end.kind == "reached"
        with pytest.raises(InputError, match="limit = -1"), time_limit(-1):
            pass

    def test_the_next_search_has_its_own(self):
        with pytest.raises(NoOrbit, match="it takes more than"):
            find(self.SLOW, limit=0.1)
        assert find(Hopper(), limit=20).admissible

    def test_an_inner_limit_gives_no_time_beyond_the_outer_one(self):
        with pytest.raises(NoOrbit, match=r"more than 0.1 s"), time_limit(0.1):
            find(self.SLOW, limit=100)

    @pytest.mark.parametrize("limit", [0, -1.0, True, "1", float("nan")])
    def test_no_time(self, limit):
        with pytest.raises(InputError, match="it is a number of seconds above 0"):
            find(self.SLOW, limit=limit)
