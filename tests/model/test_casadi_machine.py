"""Machines as CasADi functions, against equations written by hand, their flows, found orbits and CVODES."""

from functools import cache
from itertools import pairwise
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from checked_machines import MACHINES
from conftest import slow_after
from runners import energy_by_hand, fast_runner, rates_by_hand

from orbits import InputError, find, find_all, simulate
from orbits.flow import flow_of
from orbits.mechanics import Mass, Mechanism, Spring
from problems import (
    Chain,
    HeavyHand,
    Hopper,
    Juggler,
    chain_hand,
    hopper_in_si,
    inerter_hopper,
    juggler_in_si,
    knee_hopper,
    plate_hopper,
    rimless_wheel,
    rocking_block,
    runner,
    shuttle,
)
from problems.laws import springs
from studies.exact_orbits.reader import Case

REFUSED = {"lossy": "hysteresis", "actuated in SI": "have no units"}
MEASURED = springs.table(springs.SAMPLE, in_si=True)
STATED = {name: machine for name, machine in MACHINES.items() if name not in REFUSED}
STATED |= {
    "heavy hand": HeavyHand("r + 0.1*r**3"),
    "table": hopper_in_si(3.0, 1.5, force=MEASURED, rest_length=0.3, surface_gravity=9.8),
    "odd power": Juggler("r + 0.2*r*abs(r)"),
}


@cache
def functions_of(name: str):
    return STATED[name].casadi()


def states_of(name: str, count: int = 2):
    """Random flight states (count, n) about rest, on both sides of it, in the machine's units."""
    machine, found = STATED[name], functions_of(name)
    model, rng = machine.model, np.random.default_rng(58)
    rest = np.array(model.rest(machine.values) if model.rest else np.zeros(len(found.states)), dtype=float)
    sizes = np.ones(len(rest)) if machine.units is None else machine.units.of_states(found.states)
    return rest * sizes + 0.4 * sizes * rng.normal(size=(count, len(rest)))


def column(function, *arguments) -> np.ndarray:
    """The value of a function as an array (k,)."""
    return function(*arguments).full().ravel()


def standing(found, x: np.ndarray) -> np.ndarray:
    """A flight state (n,) with the same contact state whose gap is closed, and what sticks in its place."""
    return column(found.onto_flight, found.onto_contact(x))


@pytest.mark.parametrize("name", STATED)
def test_fields_are_those_that_motions_are_integrated_with(name):
    """In SI in which states and times have their sizes; on the pieces on which the states are."""
    machine, found = STATED[name], functions_of(name)
    units, names = machine.units, tuple(machine.values)
    time = 1.0 if units is None else units.time
    p = np.array([machine.values[each] for each in names])
    for x in states_of(name):
        for phase, field in ((machine.model.flight, found.flight), (machine.model.contact, found.contact)):
            state = x if phase.name == "flight" else column(found.onto_contact, x)
            sizes = np.ones(len(state)) if units is None else units.of_states(phase.states)
            rates = flow_of(phase, names).field((state / sizes)[None], p)[0][0] * sizes / time
            assert column(field, state, found.values) == pytest.approx(
                rates, rel=1e-12, abs=1e-12 * np.abs(rates).max()
            )


@pytest.mark.parametrize("name", STATED)
def test_energy_has_its_gradient_and_is_conserved_without_losses(name):
    """The gradient of the quadrature is the stated one; along the fields it vanishes, or is below 0 with dampers."""
    machine, found = STATED[name], functions_of(name)
    state, p = ca.SX.sym("x", len(found.states)), ca.SX.sym("p", len(found.parameters))
    slope = ca.Function("slope", [state, p], [ca.gradient(found.energy(state, p), state)])
    for x in states_of(name):
        gradient, y = column(found.energy_gradient, x, found.values), column(found.onto_contact, x)
        assert column(slope, x, found.values) == pytest.approx(gradient, rel=1e-9, abs=1e-9 * np.abs(gradient).max())
        held = standing(found, x)
        assert float(found.contact_energy(y, found.values)) == float(found.energy(held, found.values))
        by_contact = column(found.energy_gradient, held, found.values)
        moved = column(found.onto_flight, found.contact(y, found.values))
        for at, rates in ((gradient, column(found.flight, x, found.values)), (by_contact, moved)):
            power, size = at @ rates, np.abs(at * rates).max() + 1e-300
            if machine.model.conservative or name == "actuated" or name == "actuated juggler":
                assert abs(power) <= 1e-12 * size
            else:
                assert power < 0


@pytest.mark.parametrize("name", STATED)
def test_a_landing_stops_the_gap_by_an_impulse_along_it(name):
    """The speed of the gap is -e times that before, what sticks rests, the momenta along all else stay, and a plastic
    landing loses the stated energy. Momenta are the derivatives of the energy by the speeds."""
    found, model = functions_of(name), STATED[name].model
    if name == "heavy hand":
        return  # of which the momentum is infinite
    speeds = [i for i, each in enumerate(found.states) if each.endswith("'")]
    held = [i for i, each in enumerate(found.states) if each.removesuffix("'") in model.sticks]
    for x in states_of(name):
        x[[i - 1 for i in speeds]] = standing(found, x)[[i - 1 for i in speeds]]
        back = x if found.relabelling is None else np.array(model.relabelling.inverse(x, STATED[name].values))
        gap = np.array(model.gap(STATED[name].values).weights)[[i - 1 for i in speeds]]
        for e in (0.0, 0.6):
            after = column(found.resets["landing"], back, found.values, e)
            assert gap @ after[speeds] == pytest.approx(-e * (gap @ x[speeds]), rel=1e-12, abs=1e-13)
            assert after[held] == pytest.approx(0.0, abs=1e-13)
            assert np.delete(after, [*speeds, *held]) == pytest.approx(
                np.delete(x, [*speeds, *held]), rel=1e-12, abs=1e-14
            )
            placed = np.where(np.isin(np.arange(len(x)), [i for i in held if i not in speeds]), 0.0, x)
            kick = column(found.energy_gradient, after, found.values) - column(
                found.energy_gradient, placed, found.values
            )
            free = np.linalg.svd(
                np.vstack([gap, *(np.eye(len(speeds))[speeds.index(i)] for i in held if i in speeds)])
            )[2]
            free = free[1 + len(model.sticks) :]
            assert free @ kick[speeds] == pytest.approx(0.0, abs=1e-11 * (1 + np.abs(kick).max()))
        lost = float(found.landing_loss(back, found.values))
        plastic = column(found.resets["landing"], back, found.values, 0.0)
        before, left = (float(found.energy(each, found.values)) for each in (placed, plastic))
        assert lost == pytest.approx(before - left, rel=1e-9, abs=1e-11 * (abs(before) + abs(left)))
        assert lost >= 0


def two_masses_by_hand(kind, phi, gravity, m1, m2, damping=0.0):
    """Flight and contact of a hopper or a juggler of masses in any units."""

    def hopper(x):
        force, (y1, v1, y2, v2) = phi(x[0] - x[2]) + damping * (x[1] - x[3]), x
        return [v1, -force / m1 - gravity(y1), v2, force / m2 - gravity(y2)]

    def juggler(x):
        w1, v1, w2, v2 = x
        return [v1, -gravity(w1), v2, -(phi(w2) + damping * v2) / m2 - gravity(w2)]

    def standing(y):
        if kind == "hopper":
            return hopper([*y, 0.0, 0.0])[:2]
        return [y[1], -(phi(y[0]) + damping * y[1]) / (m1 + m2) - gravity(y[0])]

    return (hopper if kind == "hopper" else juggler), standing


HAND_WRITTEN = ("leg in SI", "damped, far from a planet", "juggler in SI", "chain", "runner")


def hand_written():
    """Machines with their fields, energies and contact forces by hand."""
    k, b, g, big, small = 9e3, 2e6, 9.81, 60.0, 3.0
    leg = hopper_in_si(big, small, force="k*r + b*r**3", parameters={"k": k, "b": b}, surface_gravity=g)
    cube, constant = (lambda r: k * r + b * r**3), (lambda z: g)
    yield leg, *two_masses_by_hand("hopper", cube, constant, big, small), lambda x: (
        big * x[1] ** 2 / 2 + small * x[3] ** 2 / 2 + k * (x[0] - x[2]) ** 2 / 2 + b * (x[0] - x[2]) ** 4 / 4
        + g * (big * x[0] + small * x[2])
    ), lambda y: small * g - cube(y[0])  # fmt: skip
    away = hopper_in_si(2.0, 0.5, stiffness=5.0, damping=0.3, rest_length=0.6, surface_gravity=0.01, body_radius=250.0)
    falls = lambda z: 0.01 / (1 + z / 250.0) ** 2  # noqa: E731
    flight, contact = two_masses_by_hand("hopper", lambda r: 5.0 * r, falls, 2.0, 0.5, damping=0.3)

    def lifted(rates):
        """The body is a rest length above its coordinate."""
        return lambda x: (lambda found: [found[0], found[1] + falls(x[0]) - falls(0.6 + x[0]), *found[2:]])(rates(x))

    yield away, lifted(flight), lifted(contact), lambda x: (
        2.0 * x[1] ** 2 / 2 + 0.5 * x[3] ** 2 / 2 + 5.0 * (x[0] - x[2]) ** 2 / 2
        + 0.01 * (2.0 * x[0] / (1 + (0.6 + x[0]) / 250.0) / (1 + 0.6 / 250.0) + 0.5 * x[2] / (1 + x[2] / 250.0))
    ), lambda y: 0.5 * 0.01 - 5.0 * y[0] - 0.3 * y[1]  # fmt: skip
    hand = juggler_in_si(0.3, 0.9, force="k*r*sqrt(1 + r**2)", parameters={"k": 8.0}, surface_gravity=g)
    root = lambda r: 8.0 * r * np.sqrt(1 + r**2)  # noqa: E731
    yield hand, *two_masses_by_hand("juggler", root, constant, 0.3, 0.9), lambda x: (
        0.3 * (x[1] ** 2 / 2 + g * x[0]) + 0.9 * (x[3] ** 2 / 2 + g * x[2]) + 8.0 * ((1 + x[2] ** 2) ** 1.5 - 1) / 3
    ), lambda y: -0.3 / 1.2 * root(y[0])  # fmt: skip
    m = 1.0, 2.0, 0.7

    def chain(x):
        top, low = x[0] - x[2], x[2] - x[4] + 0.1 * (x[2] - x[4]) ** 3
        return [x[1], -1 - top / m[0], x[3], -1 + (top - low) / m[1], x[5], -1 + low / m[2]]

    yield MACHINES["chain of 3"], chain, lambda y: chain([*y, 0.0, 0.0])[:4], lambda x: (
        sum(mass * (rate**2 / 2 + place) for mass, place, rate in zip(m, x[::2], x[1::2], strict=True))
        + (x[0] - x[2]) ** 2 / 2 + (x[2] - x[4]) ** 2 / 2 + 0.1 * (x[2] - x[4]) ** 4 / 4
    ), lambda y: m[2] - y[2] - 0.1 * y[2] ** 3  # fmt: skip
    fast = fast_runner()
    p = fast.values
    yield (
        fast,
        lambda x: rates_by_hand(x, p, False)[0],
        lambda y: rates_by_hand(y, p, True)[0],
        lambda x: energy_by_hand(x, p) - p["body_mass"] * p["surface_gravity"] * p["rest_length"],
        lambda y: rates_by_hand(y, p, True)[1][0],
    )


@pytest.mark.parametrize(("machine", "flight", "contact", "energy", "force"), [*hand_written()], ids=HAND_WRITTEN)
def test_functions_are_the_equations_of_a_textbook(machine, flight, contact, energy, force):
    found, rng = machine.casadi(), np.random.default_rng(3)
    for _ in range(3):
        x = 0.3 * rng.normal(size=len(found.states))
        if "l" in found.states:
            x[found.states.index("l")] += 3.0
        y, p = column(found.onto_contact, x), found.values
        pairs = [
            (column(found.flight, x, p), flight(x)),
            (column(found.contact, y, p), contact(y)),
            (float(found.energy(x, p)), energy(x)),
            (float(found.contact_energy(y, p)), energy(standing(found, x))),
            (float(found.contact_guards["lift-off"](y, p)), force(y)),
        ]
        for value, known in pairs:
            assert value == pytest.approx(known, rel=1e-12, abs=1e-11 * np.abs(known).max())


EXACT = Path(__file__).parents[2] / "studies" / "exact_orbits" / "cases"
WRITTEN = {
    "linear_hop": Hopper(), "juggler_cubic": Juggler("r + 0.1*r**3", mass_ratio=0.5), "heavy_hand": HeavyHand(),
    "chain_three": Chain(), "chain_hand": chain_hand(), "inerter": inerter_hopper(), "knee": knee_hopper(),
    "plate": plate_hopper(parameters={"plate_stiffness": 10.0}), "wheel_small": rimless_wheel(),
    "wheel": rimless_wheel(angle=0.3), "rocker": rocking_block(angle=0.3), "shuttle": shuttle(angle=0.3),
}  # fmt: skip


@pytest.mark.parametrize("name", WRITTEN)
def test_functions_are_the_equations_of_the_exact_orbits(name):
    """Derivatives, guards, resets and energies of a case in plain text; guards and energies may have other units."""
    case, machine, found = Case(EXACT / f"{name}.json"), WRITTEN[name], WRITTEN[name].casadi()
    events = {each["event"]: (mode, each) for mode, own in case["modes"].items() for each in own["events"]}
    (contact, lifts), (flight, lands) = events["lift-off"], events["landing"]
    in_flight, in_contact = (case["modes"][mode]["states"] for mode in (flight, contact))
    energy = next(iter(case["conserved"].values()))["text"]
    sample, rng, p = (
        next(each for each in case["samples"] if each["mode"] == flight),
        np.random.default_rng(5),
        found.values,
    )
    values = []
    for _ in range(3):
        x = np.array([sample["state"][each] for each in in_flight]) + 0.2 * rng.normal(size=len(in_flight))
        y = column(found.onto_contact, x)
        flies = dict(zip(in_flight, x, strict=True))
        stands = dict.fromkeys(in_contact, 0.0) | dict(zip(in_contact, y, strict=False))  # some cases have the foot too
        for mode, state, field, at in ((flight, flies, found.flight, x), (contact, stands, found.contact, y)):
            rates = dict.fromkeys(state, 0.0) | case.at(case["modes"][mode]["derivatives"], 0.0, state)
            assert column(field, at, p) == pytest.approx([*rates.values()][: len(at)], rel=1e-12, abs=1e-12)
        opened = stands | case.at(lifts["reset"], 0.0, stands)
        assert column(found.resets["lift-off"], y, p) == pytest.approx([opened[each] for each in in_flight], abs=1e-13)
        closed = np.where([each.endswith("'") for each in found.states], x, standing(found, x))
        closed = np.array(machine.model.relabelling.inverse(closed, machine.values))
        state = dict(zip(in_flight, closed, strict=True))
        landed = state | case.at(lands["reset"], 0.0, state)
        after = column(found.onto_contact, found.resets["landing"](closed, p, 0.0))
        assert after == pytest.approx([landed[each] for each in in_contact][: len(after)], rel=1e-12, abs=1e-12)
        pairs = [
            (found.contact_guards["lift-off"](y, p), case.at(lifts["guard"], 0.0, stands)),
            (found.flight_guards["landing"](x, p), case.at(lands["guard"], 0.0, flies)),
            (found.energy(x, p), case.at(energy if isinstance(energy, str) else energy[flight], 0.0, flies)),
        ]
        values.append([tuple(map(float, pair)) for pair in pairs])
    ours, theirs = np.moveaxis(np.array(values), -1, 0)
    ours[:, 2], theirs[:, 2] = (each - each.mean() for each in (ours[:, 2], theirs[:, 2]))  # from another rest
    assert (ours[0] / theirs[0] > 0).all()
    assert ours == pytest.approx(theirs * ours[0] / theirs[0], rel=1e-10, abs=1e-12)


def test_bounces_and_hand_overs_are_those_of_simulations():
    bouncing = Hopper(restitution=0.3)
    found = bouncing.casadi()
    for event in simulate(bouncing, 4.6, hops=2).events:
        if event.kind == "impact":
            after = column(found.resets["landing"], event.before, found.values, found.restitution)
            assert after == pytest.approx(event.after, rel=1e-12, abs=1e-12)
    wheel = MACHINES["wheel on a slope"]
    found, run = wheel.casadi(), simulate(wheel, state=[0.0, 0.0, 0.0, 4.0], time=3.0)
    assert run.impacts >= 3
    for event in run.events:
        if event.kind == "impact":
            after = column(found.resets["hand-over"], event.before, found.values)
            assert after == pytest.approx(event.after, rel=1e-12, abs=1e-12)


def test_a_block_that_rocks_keeps_the_share_of_its_rate_that_housner_has():
    """1 - 1.5 sin(a)^2 for a solid block, which turns the other way in the labels after the landing."""
    b = np.tan(0.3)
    block = Mechanism(
        ("phi", "theta"),
        [Spring("phi"), Mass("cos(theta) + b*sin(theta)", 1.0, across="sin(theta) - b*cos(theta)")],
        inertia={"phi": 1.0, "theta": "(1 + b**2)/3"}, gravity=1.0, angles=("phi", "theta"), parameters={"b": b},
        symmetry={"theta": "-theta", "phi": "-phi"}, gaps={"foot": "theta"},
    ).casadi()  # fmt: skip
    after = column(block.resets["hand-over"], [0.2, 0.1, 0.0, -0.4], block.values)
    assert after == pytest.approx([-0.2, -0.1, 0.0, 0.4 * (1 - 1.5 * np.sin(0.3) ** 2)], abs=1e-14)


def test_parameters_are_those_that_a_user_states():
    assert functions_of("chain of 3").parameters == ("m1", "m2", "m3")
    in_space = functions_of("varying")
    assert in_space.parameters == ("mass_ratio", "rest_length")  # not the share of the gravity that varies
    assert functions_of("in SI").parameters == ("body_mass", "foot_mass", "surface_gravity", "rest_length", "stiffness")
    cubed = functions_of("juggler in SI")  # not the stiffness that sets its units
    assert cubed.parameters == ("ball_mass", "hand_mass", "surface_gravity", "b", "k")


def test_numbers_are_in_the_units_that_are_stated():
    leg = functions_of("in SI")
    assert {leg.units[name] for name in leg.states} == {"m", "m/s"}
    named = ("foot_mass", "contact force", "spring force", "time", "energy", "body")
    assert [leg.units[name] for name in named] == ["kg", "N", "N", "s", "J", "m"]
    assert float(leg.heights["body"]([0.1, 0.0, 0.2, 0.0], leg.values)) == pytest.approx(0.6, rel=1e-14)
    assert float(leg.flight_guards["separation"]([0.1, 0.0, 0.2, 0.0], leg.values)) == pytest.approx(0.4, rel=1e-14)
    assert float(leg.flight_forces["spring force"]([0.1, 0.0, 0.2, 0.0], leg.values)) == pytest.approx(-1e3, rel=1e-14)
    wheel = functions_of("wheel in SI")
    assert [wheel.units[name] for name in ("phi'", "contact force", "contact force across the ground")] == [
        "rad/s", "N m", "N",
    ]  # fmt: skip
    assert functions_of("hopper").units == {}


def test_the_functions_cannot_be_changed():
    found = functions_of("hopper")
    with pytest.raises(AttributeError):
        found.values = found.values
    with pytest.raises(ValueError, match="read-only"):
        found.values[0] = 2.0
    with pytest.raises(TypeError):
        found.resets["landing"] = None
    assert repr(found).startswith("CasadiMachine(name='hopper'")


@pytest.mark.parametrize("name", REFUSED)
def test_what_no_vector_field_states_is_refused(name):
    with pytest.raises(InputError, match=REFUSED[name]):
        MACHINES[name].casadi()


def test_a_law_with_hysteresis_is_stated_by_its_branches():
    law = MACHINES["lossy"].spring
    growing, shrinking = (Hopper(each).casadi() for each in (law.extending, law.shortening))
    x = [0.5, 0.0, 0.0, 0.0]
    wide = [float(each.flight_forces["spring force"](x, each.values)) for each in (growing, shrinking)]
    assert wide[0] > 0.5 + 0.1 * 0.5**3 > wide[1]


@pytest.mark.parametrize(
    ("law", "smoothness", "breaks"),
    [
        (springs.bilinear(ratio=2.0), 0, [0.5]),
        ("r + 0.2*r*abs(r)", 1, [0.0]),
        ("r + 0.2*abs(r)**3", 2, [0.0]),
        (springs.table((np.arange(-3.0, 3.5), np.sinh(np.arange(-3.0, 3.5))), noise=0), 2, None),
        ("r + 0.1*tanh(5*r)", None, None),
    ],
)
def test_smoothness_of_laws_in_pieces(law, smoothness, breaks):
    """|r| has no slope at 0, r |r| no second and |r|^3 no third derivative; a table is a quintic spline."""
    found = Hopper(law).casadi()
    assert found.smoothness == smoothness
    if smoothness is None:
        assert found.breakpoints is None
    elif breaks:
        assert column(found.breakpoints, [0.7, 0.0, 0.2, 0.0], found.values) == pytest.approx(0.5 - np.array(breaks))


def test_a_force_that_jumps_is_not_continuous():
    law = springs.function(lambda r: r + 0.1 * (r > 0.5), breakpoints=(0.5,))
    found = Hopper(law).casadi()
    assert found.smoothness == -1
    values = [float(found.flight_forces["spring force"]([r, 0.0, 0.0, 0.0], found.values)) for r in (0.4, 0.6)]
    assert values == pytest.approx([0.4, 0.7], rel=1e-14)
    energy = 0.8**2 / 2 + 0.1 * 0.3 + 0.8  # of the spring and of the body's weight
    assert float(found.energy([0.8, 0.0, 0.0, 0.0], found.values)) == pytest.approx(energy, rel=1e-14)


def test_all_rows_of_a_table_are_there():
    """The force of all pieces is that of the law, which the toolkit evaluates row by row, and the energy its integral
    between neighbouring rows, with the weight of the body."""
    found, (low, high), zero = functions_of("table"), MEASURED.range(), np.zeros(3)
    places = np.linspace(low, high, 100)[1:-1]
    force, rows = found.flight_forces["spring force"], np.array(MEASURED.pieces.table(MEASURED.parameters)[0])
    values = [float(force([r, *zero], found.values)) for r in places]
    assert values == pytest.approx(MEASURED(places), rel=1e-11, abs=1e-11 * np.abs(values).max())
    gauss, weights = np.polynomial.legendre.leggauss(4)
    for end in (0.9 * low, 0.8 * high):
        edges = np.unique([0.0, end, *rows[(rows - end) * rows < 0]])[:: 1 if end > 0 else -1]
        inside = [0.5 * (b - a) * (weights @ MEASURED(0.5 * (a + b + (b - a) * gauss))) for a, b in pairwise(edges)]
        known = sum(inside) + 3.0 * 9.8 * end
        assert float(found.energy([end, *zero], found.values)) == pytest.approx(known, rel=1e-11)


def through_a_hop(found, orbit, digits):
    """Integrate flight and contact of an orbit by CVODES through its reset, and compare with its states and guards."""
    p, tolerances = found.values, {"abstol": 1e-13, "reltol": 1e-13, "max_num_steps": 100_000}

    def to_end(field, start, grid):
        x, parameters = ca.MX.sym("x", len(start)), ca.MX.sym("p", len(p))
        problem = {"x": x, "p": parameters, "ode": field(x, parameters)}
        return ca.integrator("motion", "cvodes", problem, 0.0, grid, tolerances)(x0=start, p=p)["xf"].full().T

    times = np.linspace(0.0, 1.0, 6)[1:]
    size = np.abs(orbit(0.0)).max()
    flown = to_end(found.flight, orbit(0.0), (times * orbit.flight_time).tolist())
    assert flown == pytest.approx(orbit(times * orbit.flight_time * (1 - 1e-15)), abs=digits * size)
    assert float(found.flight_guards["landing"](flown[-1], p)) == pytest.approx(0.0, abs=digits * size)
    stood = column(found.onto_contact, found.resets["landing"](flown[-1], p, 0.0))
    contact = to_end(found.contact, stood, (times * orbit.contact_time).tolist())
    end = column(found.resets["lift-off"], contact[-1], p)
    assert end == pytest.approx(orbit(0.0), abs=digits * size)
    force = float(found.contact_guards["lift-off"](contact[-1], p))
    assert force == pytest.approx(
        0.0, abs=digits * max(abs(float(found.contact_guards["lift-off"](y, p))) for y in contact)
    )
    inside = float(found.contact_guards["lift-off"](contact[2], p))
    assert inside > 0
    assert inside == pytest.approx(
        float(orbit.contact_force(orbit.flight_time + times[2] * orbit.contact_time)), rel=1e-9
    )


HOPS = {
    "hopper": lambda: find(Hopper("r + 0.3*r**3", mass_ratio=0.5, rest_length=8.0)),
    "leg in SI": lambda: find(
        hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8e3, "b": 2e6}, rest_length=0.8)
    ),
    "juggler": lambda: find(Juggler("tanh", mass_ratio=0.9)),
    "varying": lambda: find(Hopper("cubic", gravity="1/(1 + z/R)**2", rest_length=10, parameters={"R": 60.0})),
    "wheel": lambda: find(rimless_wheel(mass=2.0, length=0.4, spokes=8, inertia=0.4, body_inertia=0.4, stiffness=20.0)),
    "chain": lambda: (lambda chain: find_all(chain, chain.starts(5, 5))[0])(Chain((1, 1, 1))),
    "run": lambda: find(runner(foot_mass=0.1, rest_length=3.7), tune=("inertia", "hip_stiffness"), at={"speed": 0.4}),
}


@pytest.mark.parametrize("name", slow_after(1, HOPS))
def test_another_integrator_goes_through_a_found_orbit(name):
    orbit = HOPS[name]()
    through_a_hop(orbit.source.casadi(), orbit, digits=1e-8)
