"""A machine whose inertia depends on its configuration: `problems.knee_hopper`, against equations written by hand.

Coordinates are the foot's height h and the knee's angle theta. Two links of length l join the foot to the hip, which
stays above it, at the height h + L with L(theta) = 2 l sin(theta / 2); a torsional spring of torque tau(theta) bends
the knee. With the kinetic energy (m1 (h' + L' theta')^2 + m2 h'^2) / 2 of body and foot, Lagrange's equations are

    (m1 + m2) h'' + m1 L' theta'' = -m1 L'' theta'^2 - (m1 + m2) g + lambda
    m1 L' h'' + m1 L'^2 theta''   = -m1 L' L'' theta'^2 - tau - m1 g L'

with the ground force lambda, 0 in flight and m2 g - tau / L' in contact, where h = 0. The determinant of the inertia
matrix is m1 m2 L'^2, and its inverse times the gradient (1, 0) of the gap h is (1, -1 / L') / m2: an impact changes
(h', theta') along (1, -1 / L'), which leaves the body's speed as it is, and its mass is m2.

The machine is stated in SI, and its launch speed is theta' at lift-off, in rad/s. The model by hand, `WRITTEN`, is what
the derived one is held against, field by field; Lagrange's equations are solved by SciPy.
"""

import json
import pickle
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from orbits import (
    InputError,
    NoOrbit,
    Orbit,
    ReturnMap,
    check,
    existence,
    find,
    find_all,
    follow,
    multiplier,
    optimize,
    sensitivities,
    simulate,
)
from orbits.mechanics import Inerter
from orbits.model import Affine, Phase, StateFormula
from orbits.sweeps import sweep
from orbits.symbolic import parse
from orbits.units import Units
from problems import hopper_in_si, knee_hopper, springs
from studies.oracle import by_another_integrator

SI = Units(1.0, 1.0, 1.0, 1.0, ("knee", "liftoff"))
LEG, BODY = "2*link*sin(knee/2)", "foot + 2*link*sin(knee/2)"
STATES = ("foot", "foot'", "knee", "knee'")
COSINE_AND_SINE = parse("cos(half)"), parse("sin(half)")  # of numbers, arrays and expressions alike


def torque(theta, p):
    """tau(theta)."""
    return p["stiffness"] * (theta - p["rest_angle"])


def slopes(theta, p):
    """L' and L''."""
    cosine, sine = (function(half=theta / 2) for function in COSINE_AND_SINE)
    return p["link"] * cosine, -p["link"] / 2 * sine


def tension(theta, p):
    """The force with which the knee pulls body and foot together."""
    return torque(theta, p) / slopes(theta, p)[0]


def flight_rates(x, p, q):
    along, bend = slopes(x[2], p)
    pull = tension(x[2], p)
    foot, body = pull / p["foot_mass"] - p["surface_gravity"], -pull / p["body_mass"] - p["surface_gravity"]
    return [x[1], foot, x[3], (body - foot - bend * x[3] ** 2) / along]


def contact_rates(x, p, q):
    along, bend = slopes(x[0], p)
    body = -tension(x[0], p) / p["body_mass"] - p["surface_gravity"]
    return [x[1], (body - bend * x[1] ** 2) / along]


def flight_gradient(x, p, q):
    m1, m2, g = p["body_mass"], p["foot_mass"], p["surface_gravity"]
    along, bend = slopes(x[2], p)
    body = x[1] + along * x[3]
    by_theta = m1 * body * bend * x[3] + torque(x[2], p) + m1 * g * along
    return [(m1 + m2) * g, m1 * body + m2 * x[1], by_theta, m1 * body * along]


def contact_gradient(x, p, q):
    return flight_gradient([0.0, 0.0, *x], p, q)[2:]


def release(alpha, p):
    """The knee's angle where the tension is the foot's weight."""
    weight = p["foot_mass"] * p["surface_gravity"]
    angle = brentq(lambda a: tension(a, p) - weight, p["rest_angle"], 3.1, xtol=1e-300, rtol=1e-15)
    return np.full(np.shape(alpha), angle)


def heights(p):
    return {"body": StateFormula(BODY, STATES, p), "foot": Affine((1.0, 0.0, 0.0, 0.0))}


WRITTEN = SimpleNamespace(
    name="knee hopper",
    flight=Phase("flight", STATES, flight_rates),
    contact=Phase(
        "contact",
        STATES[2:],
        contact_rates,
        {"contact force": lambda x, p, q: p["foot_mass"] * p["surface_gravity"] - tension(x[0], p)},
    ),
    launch=lambda u, p: [0.0, 0.0, u["liftoff"], u["alpha"]],
    liftoff=lambda u, p, q: [p["foot_mass"] * p["surface_gravity"] - tension(u["liftoff"], p)],
    landing=lambda u, x, p: [x[0], x[1], x[2] - u["liftoff"]],
    reversor=(1, -1, 1, -1),
    release=release,
    touchdown=lambda u, p: [u["liftoff"], -u["alpha"]],
    embed=np.eye(4)[:, 2:],
    flight_gradient=flight_gradient,
    contact_gradient=contact_gradient,
    extension=Affine((0.0, 0.0, 1.0, 0.0)),
    gap=lambda p: Affine((1.0, 0.0, 0.0, 0.0)),
    separation=lambda p: StateFormula(LEG, STATES, p),
    heights=heights,
    impact_mass=lambda x, p: p["foot_mass"],
    impact=lambda x, p: [0.0, 1.0, 0.0, -1.0 / slopes(x[2], p)[0]],
    contact_speed=Affine((0.0, 1.0)),
    violations={
        "none": "a knee carries its body where its torque, folded, is above body_mass * surface_gravity * link",
        "gap": "foot below ground",
        "pull": "the ground would have to pull",
        "separation": "the knee folds through",
        "end": "contact: the knee folds, the body never lifts off again",
    },
    springs=(),
    knees=lambda p: [("foot", "body", p["link"])],
    rest=lambda p: [0.0, 0.0, p["rest_angle"], 0.0],
    units=lambda p: SI,
)


MACHINE = knee_hopper(body_mass=6.0, foot_mass=1.0, link=0.25, stiffness=20.0, rest_angle=1.8)
OTHER = knee_hopper(body_mass=4.0, foot_mass=2.0, link=0.4, stiffness=70.0, rest_angle=2.0)
LINK = MACHINE.values["link"]


def lagrange_in_flight(t, x, p):
    """Lagrange's equations of the flight, solved for the accelerations."""
    m1, m2, g = p["body_mass"], p["foot_mass"], p["surface_gravity"]
    _, dh, theta, rate = x
    along, bend = p["link"] * np.cos(theta / 2), -p["link"] / 2 * np.sin(theta / 2)
    moment = p["stiffness"] * (theta - p["rest_angle"])
    inertia = np.array([[m1 + m2, m1 * along], [m1 * along, m1 * along**2]])
    forces = [-m1 * bend * rate**2 - (m1 + m2) * g, -m1 * along * bend * rate**2 - moment - m1 * g * along]
    foot, knee = np.linalg.solve(inertia, forces)
    return [dh, foot, rate, knee]


def lagrange_in_contact(t, x, p):
    """The second of Lagrange's equations with the foot at rest on the ground."""
    m1, g = p["body_mass"], p["surface_gravity"]
    theta, rate = x
    along, bend = p["link"] * np.cos(theta / 2), -p["link"] / 2 * np.sin(theta / 2)
    moment = p["stiffness"] * (theta - p["rest_angle"])
    return [rate, (-m1 * along * bend * rate**2 - moment - m1 * g * along) / (m1 * along**2)]


def energy(x, p):
    """Relative to rest on the ground with the knee at its rest angle."""
    m1, m2, g = p["body_mass"], p["foot_mass"], p["surface_gravity"]
    h, dh, theta, rate = np.moveaxis(x, -1, 0)
    leg, along = 2 * p["link"] * np.sin(theta / 2), p["link"] * np.cos(theta / 2)
    rest = 2 * p["link"] * np.sin(p["rest_angle"] / 2)
    kinetic = 0.5 * m1 * (dh + along * rate) ** 2 + 0.5 * m2 * dh**2
    return kinetic + 0.5 * p["stiffness"] * (theta - p["rest_angle"]) ** 2 + m1 * g * (h + leg - rest) + m2 * g * h


def travelled(rates, start, duration, p, **options):
    """The motion by SciPy."""
    return solve_ivp(
        rates, (0.0, duration), start, "DOP853", args=(p,), rtol=1e-13, atol=1e-15, dense_output=True, **options
    )


def value_at(function, *given):
    """The numbers (k,) of a function of expressions, (lists or mappings of them) -> a list or one, at numbers."""
    flat = [list(part.values()) if isinstance(part, dict) else list(part) for part in given]
    symbols = [ca.SX.sym("x", len(part)) for part in flat]
    named = [
        dict(zip(part, ca.vertsplit(symbol), strict=True)) if isinstance(part, dict) else ca.vertsplit(symbol)
        for part, symbol in zip(given, symbols, strict=True)
    ]
    found = function(*named)
    return ca.Function("f", symbols, [ca.vertcat(*found) if isinstance(found, list) else found])(*flat).full().ravel()


PLACED = {
    "flight field": lambda m, x, p: value_at(lambda x, p: m.flight.field(x, p, []), x, p),
    "contact field": lambda m, x, p: value_at(lambda x, p: m.contact.field(x, p, []), x[2:], p),
    "contact force": lambda m, x, p: value_at(lambda x, p: m.contact.watch["contact force"](x, p, []), x[2:], p),
    "flight gradient": lambda m, x, p: value_at(lambda x, p: m.flight_gradient(x, p, []), x, p),
    "contact gradient": lambda m, x, p: value_at(lambda x, p: m.contact_gradient(x, p, []), x[2:], p),
    "impact": lambda m, x, p: value_at(m.impact, x, p),
    "impact mass": lambda m, x, p: value_at(lambda x, p: ca.SX(m.impact_mass(x, p)), x, p),
    "launch": lambda m, x, p: value_at(m.launch, {"liftoff": x[2], "alpha": x[3]}, p),
    "lift-off": lambda m, x, p: value_at(lambda u, p: m.liftoff(u, p, []), {"liftoff": x[2], "alpha": x[3]}, p),
    "landing": lambda m, x, p: value_at(m.landing, {"liftoff": x[2], "alpha": x[3]}, [*x[:2], x[2] + 0.1, x[3]], p),
    "touchdown": lambda m, x, p: value_at(m.touchdown, {"liftoff": x[2], "alpha": x[3]}, p),
    "release": lambda m, x, p: m.release(x[3:], p),
    "extension's rate": lambda m, x, p: m.extension(x),
    "gap": lambda m, x, p: m.gap(p)(x),
    "separation": lambda m, x, p: m.separation(p)(x),
    "heights": lambda m, x, p: [height(x) for height in m.heights(p).values()],
    "contact speed": lambda m, x, p: m.contact_speed(x[2:]),
    "rest": lambda m, x, p: m.rest(p),
    "links": lambda m, x, p: [length for *_, length in m.knees(p)],
    "embedding": lambda m, x, p: m.embed @ x[2:],
    "reversor": lambda m, x, p: m.reversor,
}


@pytest.mark.parametrize("name", PLACED)
def test_what_is_derived_is_what_is_written_by_hand(name):
    """Every part of the model, at random states and parameters."""
    random = np.random.default_rng(7)
    for _ in range(20):
        x = random.uniform([-0.5, -3.0, 0.4, -9.0], [2.0, 3.0, 2.9, 9.0])
        p = {each: value * random.uniform(0.7, 1.4) for each, value in MACHINE.values.items()}
        derived, by_hand = (np.ravel(PLACED[name](model, x, p)) for model in (MACHINE.model, WRITTEN))
        assert derived == pytest.approx(by_hand, rel=1e-12, abs=1e-12 * (1 + np.abs(by_hand).max()))
    assert MACHINE.model.violations == WRITTEN.violations


@pytest.fixture(scope="module")
def orbit():
    return find(MACHINE)


@pytest.mark.slow
def test_the_orbit_solves_lagranges_equations(orbit):
    p, t = MACHINE.values, np.linspace(0.0, 1.0, 41)
    flight = travelled(lagrange_in_flight, [0.0, 0.0, orbit.liftoff_extension, orbit.alpha], orbit.flight_time, p)
    assert np.abs(orbit(orbit.flight_time * t) - flight.sol(orbit.flight_time * t).T).max() < 1e-10
    contact = travelled(lagrange_in_contact, [orbit.liftoff_extension, -orbit.alpha], orbit.contact_time, p)
    standing = orbit(orbit.flight_time + orbit.contact_time * t[1:-1])
    assert np.abs(standing[:, 2:] - contact.sol(orbit.contact_time * t[1:-1]).T).max() < 1e-10
    assert not standing[:, :2].any()
    assert contact.y[:, -1] == pytest.approx([orbit.liftoff_extension, orbit.alpha], abs=1e-10)
    leg = 2 * p["link"] * np.sin(contact.sol(orbit.contact_time * t)[0] / 2)
    assert orbit.certificate.smallest_separation == pytest.approx(leg.min(), abs=1e-3)
    assert orbit.certificate.smallest_separation <= leg.min() + 1e-12


def test_a_hop_with_an_impact_solves_lagranges_equations():
    """The foot is stopped and the body keeps its speed, so that the knee bends faster; then it stands to lift-off."""
    p, alpha = MACHINE.values, 11.3
    run = simulate(MACHINE, alpha, hops=1)
    landing, liftoff = run.events
    closes = lambda t, x, p: x[0]  # noqa: E731
    closes.terminal, closes.direction = True, -1
    liftoff_angle = float(release(alpha, p))
    flight = travelled(lagrange_in_flight, [0.0, 0.0, liftoff_angle, alpha], 1.0, p, events=closes, first_step=1e-2)
    assert landing.time == pytest.approx(flight.t[-1], abs=1e-10)
    assert landing.before == pytest.approx(flight.y[:, -1], abs=1e-10)
    _, fall, theta, rate = flight.y[:, -1]
    along = p["link"] * np.cos(theta / 2)
    after = np.array([0.0, 0.0, theta, (fall + along * rate) / along])
    assert landing.after == pytest.approx(after, abs=1e-10)
    assert landing.loss == pytest.approx(0.5 * p["foot_mass"] * fall**2, rel=1e-10)
    assert energy(landing.before, p) - energy(landing.after, p) == pytest.approx(landing.loss, rel=1e-10)
    assert landing.energy == pytest.approx(energy(landing.before, p), rel=1e-12)
    opens = lambda t, x, p: p["foot_mass"] * p["surface_gravity"] - tension(x[0], p)  # noqa: E731
    opens.terminal, opens.direction = True, -1
    contact = travelled(lagrange_in_contact, after[2:], 2.0, p, events=opens)
    assert liftoff.time == pytest.approx(flight.t[-1] + contact.t[-1], abs=1e-10)
    assert run.launches[-1] == pytest.approx(contact.y[1, -1], abs=1e-10)
    assert float(ReturnMap(MACHINE)(alpha).next) == pytest.approx(contact.y[1, -1], abs=1e-10)


def test_bounces_lose_what_the_impact_mass_says():
    p = MACHINE.values
    run = simulate(replace(MACHINE, restitution=0.6), 11.3, hops=2)
    assert sum(event.kind == "impact" for event in run.events) > 3
    for event in run.events:
        lost = energy(event.before, p) - energy(event.after, p)
        assert event.loss == pytest.approx(lost, abs=1e-12)
        if event.kind == "impact":
            speeds = [float(x[1] + p["link"] * np.cos(x[2] / 2) * x[3]) for x in (event.before, event.after)]
            assert speeds[0] == pytest.approx(speeds[1], rel=1e-12)  # of the body
            assert event.after[1] == pytest.approx(-0.6 * event.before[1], rel=1e-12)


def hopper_with_the_same_leg(machine):
    """The plain hopper whose spring is phi(r) = tau(theta) dtheta/dr, with the leg's length L + r."""
    angle, slope = "2*asin((leg + r)/(2*link))", "sqrt(link**2 - (leg + r)**2/4)"
    p = machine.values
    leg = 2 * p["link"] * np.sin(p["rest_angle"] / 2)
    return hopper_in_si(
        body_mass=p["body_mass"],
        foot_mass=p["foot_mass"],
        surface_gravity=p["surface_gravity"],
        rest_length=leg,
        force=f"torque*({angle} - rest_angle)/{slope}",
        parameters={
            "torque": p["stiffness"],
            "rest_angle": p["rest_angle"],
            "leg": leg,
            "link": p["link"],
        },
    )


@pytest.mark.slow
@pytest.mark.parametrize(("machine", "family"), [(MACHINE, 1), (MACHINE, 2), (OTHER, 1)])
def test_it_is_a_hopper_with_a_nonlinear_spring(machine, family):
    knee, plain = find(machine, family), find(hopper_with_the_same_leg(machine), family)
    along = machine.values["link"] * np.cos(knee.liftoff_extension / 2)
    assert knee.alpha * along == pytest.approx(plain.alpha, rel=1e-12)
    assert knee.flight_time == pytest.approx(plain.flight_time, rel=1e-12)
    assert knee.contact_time == pytest.approx(plain.contact_time, rel=1e-12)
    for name in ("body", "foot"):
        assert knee.rises[name] == pytest.approx(plain.rises[name], rel=1e-11)
    c, other = knee.certificate, plain.certificate
    assert c.loss_coefficient * along ** (-1 / 3) == pytest.approx(other.loss_coefficient, rel=1e-6)
    assert c.landing_jerk == pytest.approx(other.landing_jerk, rel=1e-11)
    assert c.smallest_separation == pytest.approx(other.smallest_separation, abs=1e-11)
    assert c.largest_contact_force == pytest.approx(other.largest_contact_force, rel=1e-11)
    assert len(knee.violations) == len(plain.violations)


@pytest.mark.parametrize(("rest_angle", "family"), [(1.2, 2), (2.0, 1)])
def test_stiff_knees_are_linear_springs(rest_angle, family):
    """Their launch speed in rad/s, x (1 + M) g (mu/kappa)^(1/2) with tan x = x, depends neither on the links nor on
    the angle; it is approached with the square of the compliance."""
    x = float(mp.findroot(lambda x: mp.sin(x) - x * mp.cos(x), (family + 0.5) * np.pi - 0.1))
    off = []
    for stiffness in (4e3, 16e3, 64e3):
        leg = knee_hopper(stiffness=stiffness, rest_angle=rest_angle)
        m1, m2, g = (leg.values[name] for name in ("body_mass", "foot_mass", "surface_gravity"))
        off.append(find(leg, family).alpha / (x * (1 + m2 / m1) * g * np.sqrt(m1 * m2 / (m1 + m2) / stiffness)) - 1)
    assert np.divide(off[:-1], off[1:]) == pytest.approx([16, 16], rel=0.02)
    assert abs(off[-1]) < 2e-7


def test_an_angle_of_rest_that_is_none():
    with pytest.raises(InputError, match=r"rest_angle = 3\.2 rad: a knee rests between folded \(0\) and straight"):
        knee_hopper(rest_angle=3.2)


@pytest.mark.parametrize("stiffness", [1.0, 10.0])
def test_a_knee_that_does_not_carry_the_body_says_so(stiffness):
    """60 kg at 9.80665 m/s^2 on links of 0.45 m that rest at 2.6 rad need 102 N m/rad at least."""
    with pytest.raises(
        NoOrbit, match=r"finds none.*a knee carries its body where its torque, folded, is above body_mass"
    ):
        find(knee_hopper(stiffness=stiffness))


SMALL = {"body_mass": 0.9, "foot_mass": 0.045, "link": 0.05}


@pytest.mark.slow
def test_a_measured_torque_is_that_of_its_formula():
    r = np.linspace(-2.7, 2.7, 41)
    formula = find(knee_hopper("r + b*r**3", parameters={"b": 0.2}, **SMALL))
    table = find(knee_hopper(springs.table((r, r + 0.2 * r**3), noise=0), **SMALL))
    numbers = ("alpha", "flight_time", "contact_time", "liftoff_extension")
    assert [getattr(table, name) for name in numbers] == pytest.approx([getattr(formula, name) for name in numbers])


@pytest.mark.slow
def test_a_torque_with_a_corner_that_the_knee_passes():
    """The corner lies at an angle from rest; derivatives by the angle of rest, which moves it, are differences."""
    machine = knee_hopper(springs.bilinear(k=1.0, ratio=2.0, gap=0.003), **SMALL)
    orbit = find(machine)
    assert by_another_integrator(machine, 1)(orbit) is None
    assert check(machine)
    slopes, step = sensitivities(machine, orbit, "rest_angle", ["alpha", "contact_time"]), 1e-4
    low, high = (find(machine.with_values(rest_angle=machine.values["rest_angle"] + s)) for s in (-step, step))
    for quantity in ("alpha", "contact_time"):
        difference = (getattr(high, quantity) - getattr(low, quantity)) / (2 * step)
        assert slopes[quantity]["rest_angle"] == pytest.approx(difference, rel=1e-5)


@pytest.mark.slow
def test_energy_over_many_hops(orbit):
    run = simulate(MACHINE, orbit.alpha, hops=50)
    assert run.status == "done"
    assert len(run.launches) == 51
    start, p = energy(orbit(0.0), MACHINE.values), MACHINE.values
    drift = energy(np.array([event.before for event in run.events]), p) / start - 1
    assert np.abs(drift).max() <= 1e-10


@pytest.mark.slow
def test_its_map_and_multiplier():
    step, alpha, change = ReturnMap(MACHINE), 11.0, 1e-5
    assert step(np.linspace(8.0, 14.0, 5)).units == {"alpha": "rad/s", "next": "rad/s", "loss": "rad^2/s^2"}
    slope = float(step(alpha + change).next - step(alpha - change).next) / (2 * change)
    assert multiplier(MACHINE, alpha) == pytest.approx(slope, rel=1e-6)
    (point,) = step.fixed_points(9.0, 13.0)
    assert (point.kind, point.alpha) == ("lossless", pytest.approx(find(MACHINE).alpha, rel=1e-12))


@pytest.mark.parametrize("restitution", [0.0, 0.3])
def test_launches_together_go_as_each_alone(restitution):
    machine, alphas = replace(MACHINE, restitution=restitution), np.array([9.7, 10.8, 11.3, 13.0])
    hops = ReturnMap(machine)(alphas)
    runs = [simulate(machine, alpha, hops=1) for alpha in alphas]
    assert hops.next == pytest.approx([run.launches[-1] for run in runs], rel=1e-11)
    assert hops.impacts.tolist() == [len(run.events) - 1 for run in runs]
    starts = np.column_stack([alphas, hops.next])
    states = np.stack([np.zeros((4, 2)), np.zeros((4, 2)), release(starts, machine.values), starts], axis=-1)
    lost = -np.diff(energy(states, machine.values))[:, 0]
    assert [sum(event.loss for event in run.events) for run in runs] == pytest.approx(lost.tolist(), rel=1e-9)


def test_the_multiplier_of_bounces():
    """Each impact changes the state along a direction that depends on the knee's angle there."""
    machine, alpha, change = replace(MACHINE, restitution=0.3), 11.0, 1e-6
    step = ReturnMap(machine)
    slope = float(step(alpha + change).next - step(alpha - change).next) / (2 * change)
    assert step(alpha).impacts > 1
    assert multiplier(machine, alpha) == pytest.approx(slope, rel=1e-5)


def test_beside_the_orbit_there_is_no_multiplier_but_a_power_law(orbit):
    c, step, change = orbit.certificate.loss_coefficient, ReturnMap(MACHINE), 1e-4
    with pytest.raises(NoOrbit, match=rf"alpha [+] d loses {c:.4g} s\^\(1/3\)/rad\^\(1/3\) d\*\*\(4/3\)"):
        multiplier(MACHINE, orbit.alpha)
    lost = orbit.alpha + change - float(step(orbit.alpha + change).next)
    assert lost == pytest.approx(c * change ** (4 / 3), rel=0.05)


@pytest.mark.slow
def test_the_loss_beside_the_orbit_where_the_impact_depends_on_the_bend():
    """With an inertia against bending the mass that an impact stops depends on the knee's angle; the losses of nearby
    hops, extrapolated to the orbit, where they follow the power 4/3, have the certificate's coefficient."""
    parameters = {**MACHINE.values, "rotor": 0.02}
    machine = replace(MACHINE, elements=(*MACHINE.elements, Inerter("knee", "rotor")), parameters=parameters)
    orbit, changes = find(machine), np.array([1e-4, 1e-5])
    losses = (orbit.alpha + changes - ReturnMap(machine)(orbit.alpha + changes).next) / changes ** (4 / 3)
    ratio = 10 ** (-1 / 3)
    limit = (losses[1] - ratio * losses[0]) / (1 - ratio)
    assert orbit.certificate.loss_coefficient == pytest.approx(limit, rel=1e-3)


@pytest.mark.parametrize("method", ["half orbit", "shooting"])
def test_each_method_comes_to_the_same_orbit(orbit, method):
    near = {"liftoff": orbit.liftoff_extension, "alpha": 1.01 * orbit.alpha, "duration": 0.5 * orbit.flight_time}
    found = find(MACHINE, start=near, method=method)
    assert found.alpha == pytest.approx(orbit.alpha, rel=1e-12)
    assert find(MACHINE, method=method).alpha == pytest.approx(orbit.alpha, rel=1e-12)


@pytest.mark.slow
def test_its_families_follow_the_link():
    family = follow(MACHINE, "link", 0.22, 0.3)
    assert family.heading("alpha") == "alpha (rad/s)"
    assert family.heading("liftoff_extension") == "liftoff_extension (rad)"
    assert "rad/s" in str(family)
    touch = next(event.point for event in family.events if event.kind == "masses touch")
    assert abs(touch.certificate.smallest_separation) < 1e-12
    for point in (family[0], family[-1]):
        alone = find(MACHINE.with_values(link=point.value))
        assert point.alpha == pytest.approx(alone.alpha, rel=1e-12)
        assert point.certificate.smallest_separation == pytest.approx(alone.certificate.smallest_separation, rel=1e-10)
    # The best design within the bounds is where the knee just does not fold.
    best = optimize(MACHINE, maximise="body_rise", over={"link": (0.22, 0.3)})
    assert best.parameters["link"] == pytest.approx(touch.value, rel=1e-6)
    assert best.unit_of("alpha") == "rad/s"


@pytest.mark.slow
def test_sensitivities_of_heights_that_are_no_straight_lines(orbit):
    step, slopes_found = 1e-4, sensitivities(MACHINE, orbit, ["link"])
    low, high = (find(MACHINE.with_values(link=LINK + change)) for change in (-step, step))
    for name, values in {
        "body_rise": [one.rises["body"] for one in (low, high)],
        "smallest_separation": [one.certificate.smallest_separation for one in (low, high)],
        "alpha": [low.alpha, high.alpha],
    }.items():
        assert slopes_found[name]["link"] == pytest.approx((values[1] - values[0]) / (2 * step), rel=1e-5)


@pytest.mark.slow
def test_a_sweep_finds_what_find_finds():
    links = np.linspace(0.2, 0.3, 12)
    found = sweep(MACHINE, over={"link": links.tolist()}, quantities=["body_rise", "stroke", "smallest_separation"])
    assert found.heading("alpha") == "alpha (rad/s)"
    assert found.heading("stroke") == "stroke (rad)"
    assert found.heading("body_rise") == "body_rise (m)"
    for i in (0, 5, 11):
        one = find(MACHINE.with_values(link=links[i]))
        assert found["alpha"][i] == pytest.approx(one.alpha, rel=1e-12)
        assert found["body_rise"][i] == pytest.approx(one.rises["body"], rel=1e-10)
        assert found["smallest_separation"][i] == pytest.approx(one.certificate.smallest_separation, abs=1e-11)
        assert found["status"][i] == ("certified" if one.admissible else "inadmissible")


@pytest.mark.slow
def test_where_it_hops_at_all():
    """The edge of a diagram is where the knee folds, which a family meets as an event."""
    stiffness = [15.0, 20.0]
    diagram = existence(MACHINE, "link", (0.22, 0.32), "stiffness", stiffness, samples=4)
    family = follow(MACHINE, "link", 0.22, 0.3)
    touch = next(event.point.value for event in family.events if event.kind == "masses touch")
    assert [stretch.status for stretch in diagram.row(1)] == ["certified", "inadmissible"]
    assert diagram.row(1)[0].high == pytest.approx(touch, rel=1e-5)


def test_a_file_and_a_pickle_bring_its_heights_back(orbit, tmp_path):
    again = Orbit.load(orbit.save(tmp_path / "knee.json"))
    for other in (again, pickle.loads(pickle.dumps(orbit))):
        assert other.document() == orbit.document()
        assert str(other) == str(orbit)
        assert other.rises == orbit.rises
        assert other.shape.knees == (("foot", "body", LINK),)
        assert dict(other.machine) == dict(orbit.machine)
        x = orbit(0.3 * orbit.flight_time)
        body = x[0] + 2 * LINK * np.sin(x[2] / 2)
        assert float(other.shape.heights["body"](x)) == pytest.approx(body, rel=1e-14)


@pytest.mark.usefixtures("any_digest")
def test_damaged_files_are_refused(orbit, tmp_path):
    data = json.loads(orbit.save(tmp_path / "knee.json").read_text())
    for damage, message in {
        "foot + sqrt(link": "no closing parenthesis",
        "__import__(foot)": "unknown function",
        "foot + height": "needs a value for 'height'",
        "abs(foot)": "has a corner",
    }.items():
        data["motion"]["shape"]["heights"]["body"]["formula"] = damage
        (tmp_path / "damaged.json").write_text(json.dumps(data))
        with pytest.raises(InputError, match=message):
            Orbit.load(tmp_path / "damaged.json")
    data["motion"]["shape"]["heights"]["body"] = {"formula": "foot", "values": {"link": "long"}}
    (tmp_path / "damaged.json").write_text(json.dumps(data))
    with pytest.raises(InputError, match="'long'; it is a finite number"):
        Orbit.load(tmp_path / "damaged.json")


def test_results_have_their_units(orbit):
    units = orbit.document()["units"]
    assert (units["link"], units["stiffness"], units["surface_gravity"]) == ("m", "N m/rad", "m/s^2")
    assert MACHINE.rest_length == pytest.approx(2 * LINK * np.sin(0.9), rel=1e-15)
    assert "rest_length = 0.391663 m, body_mass = 6 kg" in str(orbit)
    assert {units[name] for name in ("alpha", "error")} == {"rad/s"}
    assert units["liftoff_extension"] == "rad"
    assert units["loss_coefficient"] == "s^(1/3)/rad^(1/3)"
    assert units["landing_jerk"] == "m/s^3"
    assert units["state_mid_flight"] == "m, rad"
    assert orbit.si()["launch_speed_rad_per_s"] == orbit.alpha
    assert orbit.si()["liftoff_extension_rad"] == orbit.liftoff_extension
    assert "rad/s" in str(orbit)
    run = simulate(MACHINE, 11.3, hops=1)
    assert run.document()["units"]["launches"] == "rad/s"
    assert " rad/s\n" in str(run)
    with pytest.raises(InputError, match=r"knee = 1\.8 rad, knee' = 0 rad/s"):
        simulate(MACHINE, state=[-1.0, 0.0, 1.8, 0.0], time=1.0)
    with pytest.raises(InputError, match=r"most 1e\+15 rad/s"):
        simulate(MACHINE, 1e16, hops=1)


def test_units_of_another_system_convert_angles_to_themselves():
    feet = Units(0.3048, 1.0, 1.0, 1.0, ("knee", "liftoff"))
    assert feet.of_states(STATES).tolist() == [0.3048, 0.3048, 1.0, 1.0]
    assert feet.dimensionless("alpha", {"alpha": 3.0, "liftoff": 1.5}) == {"alpha": 3.0, "liftoff": 1.5}
    body = feet.convert_height(StateFormula(BODY, STATES, {"link": 1.0}), STATES)
    assert float(body(np.array([0.3048, 0.0, 1.0, 0.0]))) == pytest.approx(0.3048 * (1 + 2 * np.sin(0.5)), rel=1e-15)
    aside = replace(feet, angles=("theta",))
    assert [aside.text(name) for name in ("h", "theta", "theta'", "alpha", "liftoff")] == [
        "m",
        "rad",
        "rad/s",
        "m/s",
        "m",
    ]
    assert aside.unusual_texts() == {}
    assert feet.inverse().inverse() == feet
    lean = feet.convert_height(Affine((1.0, 0.0, 2.0, 0.0), 3.0), STATES)
    assert float(lean(np.array([0.3048, 0.0, 1.0, 0.0]))) == pytest.approx(0.3048 * 6.0, rel=1e-15)


def test_all_orbits_and_those_that_are_not(orbit):
    (only,) = find_all(MACHINE)
    assert only.alpha == orbit.alpha
    with pytest.raises(NoOrbit, match="to 5 rad/s finds none"):
        find_all(MACHINE, fastest=5.0)
    near = find(MACHINE, start=orbit)
    assert near.alpha == pytest.approx(orbit.alpha, rel=1e-13)


def test_its_pictures(orbit, tmp_path):
    axes = orbit.plot()
    body = next(line for line in axes.lines if line.get_label() == "body")
    t, height = body.get_data()
    x = orbit(t)
    assert height == pytest.approx(x[:, 0] + 2 * LINK * np.sin(x[:, 2] / 2), rel=1e-12)
    axes = orbit.plot_phase_portrait()
    height, speed = axes.lines[0].get_data()
    along = LINK * np.cos(x[:, 2] / 2)
    assert speed == pytest.approx(x[:, 1] + along * x[:, 3], abs=1e-6)
    assert orbit.animate(tmp_path / "knee.gif", frames=3).stat().st_size > 1000
