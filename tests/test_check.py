"""Machines are held against mechanics: those of the library hold, and a wrong field is named and never certified."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import slow_after

import orbits.consistency.verdict as consistency
from orbits import (
    Affine,
    InconsistentModel,
    InputError,
    Mass,
    Mechanism,
    Model,
    NoOrbit,
    Phase,
    ReturnMap,
    Spring,
    check,
    find,
    follow,
    simulate,
    starts,
)
from orbits.consistency.verdict import algebraic_relations, suspects
from problems import (
    Actuated,
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
)
from problems.laws import springs
from tests.consistency.by_hand import by_hand, written

INVERSE_SQUARE = "1/(1 + z/90)**2"
MACHINES = {
    "hopper": Hopper(),
    "cubic": Hopper("r + 0.3*r**3", mass_ratio=2.0, rest_length=20.0, restitution=0.3),
    "varying": Hopper("tanh(r) + r", INVERSE_SQUARE, 0.7, 20.0),
    "in pieces": Hopper(springs.bilinear(ratio=2.0), rest_length=20.0),
    "damped": Hopper("r + 0.1*r**3", damping=0.1, drag=0.03),
    "juggler": Juggler(mass_ratio=3.0, rest_length=9.0),
    "varying juggler": Juggler("r + 0.2*r**3", INVERSE_SQUARE, 2.0, 20.0),
    "damped juggler": Juggler("r", mass_ratio=3.0, damping=0.1, drag=0.05),
    "heavy hand": HeavyHand("cubic"),
    "chain of 2": Chain([1.0, 2.0], "r + r**3"),
    "actuated": Actuated(Hopper("r + 0.1*r**3", mass_ratio=2.0)),
    "actuated juggler": Actuated(Juggler("r", INVERSE_SQUARE, 1.0, 20.0)),
    "in SI": hopper_in_si(10.0, 1.0, stiffness=1e4, rest_length=0.5),
    "varying heavy hand": HeavyHand("cubic", INVERSE_SQUARE, rest_length=20.0),
    "juggler in SI": juggler_in_si(1.0, 0.2, force="k*r + b*r**3", parameters={"k": 900.0, "b": 4e4}),
    "inerter": inerter_hopper("r + 0.1*r**3", body_mass=1.3, rest_length=20.0),
    "inerter in SI": inerter_hopper(
        "k*r", body_mass=60.0, foot_mass=3.0, inertance=20.0, surface_gravity=9.81, parameters={"k": 5e3}, in_si=True
    ),
    "knee": knee_hopper(link=0.5),  # its inertia depends on the angle
}


@pytest.mark.parametrize("name", MACHINES)
def test_machines_hold(name):
    checked = check(MACHINES[name])
    assert len(checked.relations) >= 25
    assert checked.largest < 0.1
    table = str(checked).splitlines()
    assert table[0].endswith(f"{len(checked.relations)} relations hold")
    assert len(table) == 2 + len(checked.relations) + len(checked.left_out)


@pytest.mark.parametrize("machine", [plate_hopper(), chain_hand()], ids=lambda machine: machine.name)
def test_machines_of_three_masses_hold_along_their_own_hops(machine):
    checked = check(machine, start=starts(machine, 4.0, 4.0)[0])
    assert any("orbit's flight" in each.words for each in checked.relations)
    assert checked.largest < 0.1


def test_a_table_of_measurements_holds():
    x = np.linspace(-5, 5, 41)
    assert check(Hopper(springs.table((x, x + 0.05 * x**3)), rest_length=20.0)).largest < 0.1


def test_a_chain_holds_along_its_own_hop():
    chain = Chain([1.0, 2.0, 0.7], ["r", "r + 0.1*r**3"])
    checked = check(chain, start=chain.starts(4.0, 4.0)[0])
    assert any("orbit's flight" in each.words for each in checked.relations)
    assert checked.largest < 0.1


DERIVED = {
    **{name: MACHINES[name] for name in ("cubic", "damped", "juggler", "varying juggler", "damped juggler")},
    "varying": Hopper("tanh(r) + r", INVERSE_SQUARE, 0.7, 20.0),
    "linear": Hopper(),
    "chain of 2": MACHINES["chain of 2"],
    "chain of 4": Chain([1.0, 2.0, 0.7, 1.4], ["r", "r + 0.1*r**3", "sinh(r)"]),
}


@pytest.mark.parametrize("name", DERIVED)
def test_what_follows_from_mechanics_is_what_one_writes_by_hand(name):
    machine, rng = DERIVED[name], np.random.default_rng(3)
    derived, hand = machine.model, written(machine)
    plain = (
        "reversor",
        "embed",
        "extension",
        "contact_speed",
        "launch_unknowns",
        "springs",
        "homotopy",
        "conservative",
    )
    for field in plain:
        assert np.array_equal(getattr(derived, field), getattr(hand, field)), field
    for _ in range(20):
        p = {name: value * rng.uniform(0.5, 1.5) for name, value in machine.values.items()}
        x, y = rng.normal(size=len(hand.flight.states)), rng.normal(size=len(hand.contact.states))
        u = dict(zip(hand.launch_unknowns, np.abs(rng.normal(size=len(hand.launch_unknowns))), strict=True))
        closed = hand.embed @ y

        def values(model, x=x, y=y, u=u, p=p, closed=closed):
            """What each function of a model gives at one state; landings where the gap is closed."""
            apart = model.separation(p)
            yield "flight", model.flight.field(x, p, [])
            yield "contact", [*model.contact.field(y, p, []), model.contact.watch["contact force"](y, p, [])]
            yield "gradient", [*model.flight_gradient(x, p, []), *model.contact_gradient(y, p, [])]
            yield "launch", [*model.launch(u, p), *model.touchdown(u, p), model.liftoff(u, p, [])]
            yield "landing", model.landing(u, closed, p)
            yield "impact", [*model.impact(x, p), model.impact_mass(x, p)]
            yield "heights", [height(x) for height in model.heights(p).values()]
            yield "distances", [model.gap(p)(x), *([apart(x)] if apart else [])]
            if model.one_speed:
                yield "release", model.release(np.array([0.5, 2.0]), machine.values)

        for (field, found), (_, known) in zip(values(derived), values(hand), strict=True):
            assert np.array(found, float) == pytest.approx(np.array(known, float), rel=1e-13, abs=1e-13), field
        assert derived.heights(p).keys() == hand.heights(p).keys()


def random_machines(count: int):
    """Machines of every kind with random laws and numbers."""
    rng = np.random.default_rng(7)
    laws = ("r", "r + b*r**3", "tanh(r) + b*r", "sinh(r)", "r + b*r**2 + 0.4*r**3", "r*exp(b*r/20)", "atan(r) + 0.2*r")
    gravity = ("1", "1", "1/(1 + z/H)**2", "exp(-z/H)")
    for i in range(count):
        law, pull = rng.choice(laws), str(rng.choice(gravity))
        parameters = {"b": float(rng.uniform(0.05, 0.6))} if "b*" in law else {}
        parameters |= {"H": float(rng.uniform(30, 300))} if "H" in pull else {}
        numbers = {"mass_ratio": float(10 ** rng.uniform(-2, 2)), "rest_length": float(rng.uniform(2, 40))}
        losses = {"damping": float(rng.uniform(0, 0.3)), "drag": float(rng.uniform(0, 0.1))} if i % 3 == 0 else {}
        match i % 5:
            case 0 | 1:
                yield Hopper(str(law), pull, **numbers, **losses, parameters=parameters)
            case 2:
                yield Juggler(str(law), pull, **numbers, **losses, parameters=parameters)
            case 3:
                masses = rng.uniform(0.2, 3, rng.integers(2, 6)).tolist()
                yield Chain(masses, str(law), parameters={k: v for k, v in parameters.items() if k == "b"})
            case 4:
                stiffness = float(10 ** rng.uniform(2, 6))
                yield hopper_in_si(
                    *10 ** rng.uniform(-1, 2, 2), stiffness=stiffness, rest_length=numbers["rest_length"]
                )


def test_no_false_alarms():
    found = [(machine, algebraic_relations(machine.model, machine.values)) for machine in random_machines(80)]
    alarms = [(machine, suspects(relations)) for machine, relations in found if suspects(relations)]
    assert not alarms
    # Rounding stays far from the bound, and an error of one per cent is far above it.
    assert max(each.deviation for _, relations in found for each in relations) < 1e-10


def at(function, place, factor=1.0, add=0.0):
    """A function that gives a list, of which one entry is changed."""

    def changed(*arguments):
        values = list(function(*arguments))
        values[place] = values[place] * factor + add
        return values

    return changed


def without(function, place=0):
    """A function that gives a list, of which one entry is left out."""
    return lambda *arguments: [each for i, each in enumerate(function(*arguments)) if i != place]


def turned(affine, factor=1.0, add=0.0, shift=0):
    """An affine function with its weights multiplied or in other places, and another offset."""
    weights = np.roll(factor * np.array(affine.weights), shift).tolist()
    return Affine(tuple(weights), factor * affine.offset + add)


def of_phases(model):
    """(field, name of the breakage, the changed parts) of the two phases and what belongs to them."""
    gradient = model.flight_gradient
    for which in ("flight", "contact"):
        phase = getattr(model, which)
        for i in range(len(phase.states)):
            for factor in (-1.0, 1.01):
                yield f"{which}.field", {which: replace(phase, field=at(phase.field, i, factor))}
        yield f"{which}.field", {which: replace(phase, field=without(phase.field))}
    for i in range(len(model.flight.states)):
        for factor in (-1.0, 1.01):
            yield "flight_gradient", {"flight_gradient": at(gradient, i, factor)}
    yield "flight_gradient", {"flight_gradient": without(gradient)}
    yield "flight_gradient", {"flight_gradient": lambda x, p, q: [-each for each in gradient(x, p, q)]}
    force = model.contact.watch["contact force"]
    watches = [
        {},
        {"contact force": lambda x, p, q: -force(x, p, q)},
        {"contact force": lambda x, p, q: force(x, p, q) + 0.01},
    ]
    yield from (("contact.watch", {"contact": replace(model.contact, watch=watch)}) for watch in watches)


def of_launches(model):
    """The same of the launch set."""
    for i in range(len(model.contact.states)):
        for factor in (-1.0, 1.01):
            yield "embed", {"embed": model.embed * np.where(np.arange(len(model.contact.states)) == i, factor, 1.0)}
    yield from (("embed", {"embed": matrix}) for matrix in (1.01 * model.embed, model.embed.T, model.embed[:-1]))
    watch = model.contact.watch["contact force"]
    higher = lambda x, p, q: watch([*x[:-2], 1.01 * x[-2] + 0.01, x[-1]], p, q)  # noqa: E731
    for wrong in (higher, lambda x, p, q: [watch(x, p, q)] * 2):
        yield "contact.watch", {"contact": replace(model.contact, watch={"contact force": wrong})}
    if model.one_speed:
        for moved in (lambda r: 1.01 * r + 0.01, lambda r: 0.5 - r, lambda r: r[0]):
            yield "release", {"release": lambda alpha, p, moved=moved: moved(model.release(alpha, p))}
    for wrong in (("liftoff", "speed"), ("alpha", "liftoff"), (*model.launch_unknowns, "height")):
        yield "launch_unknowns", {"launch_unknowns": wrong}
    yield "launch_unknowns", {"launch_unknowns": (*model.launch_unknowns, *model.contact.states)}


def of_symmetry(model):
    """The same of the reversor and of impacts."""
    signs, count = model.reversor, len(model.flight.states)
    for wrong in ((1,) * count, (*signs[:-1], 1), tuple(-s for s in signs), signs[:-1], (2, *signs[1:])):
        yield "reversor", {"reversor": wrong}
    for factor in (1.01, -1.0, 0.0):
        yield "impact_mass", {"impact_mass": lambda x, p, factor=factor: factor * model.impact_mass(x, p)}
        yield "impact", {"impact": lambda x, p, factor=factor: [factor * each for each in model.impact(x, p)]}
    yield "impact_mass", {"impact_mass": lambda x, p: [model.impact_mass(x, p)] * 2}
    yield "impact_mass", {"impact_mass": lambda x, p: model.impact_mass(x, p) * (1 + 0.01 * x[0])}
    for shift in (1, 2):
        yield "impact", {"impact": lambda x, p, shift=shift: [*(i := model.impact(x, p))[-shift:], *i[:-shift]]}
    yield "impact", {"impact": lambda x, p: model.impact(x, p)[:-1]}


def of_geometry(model, p):
    """The same of positions and distances."""
    places = {"factor": {"factor": 1.01}, "other state": {"shift": 1}, "other mass": {"shift": 2}}
    for change in (*places.values(), {"factor": -1.0}):
        yield "extension", {"extension": turned(model.extension, **change)}
        yield "gap", {"gap": lambda p, change=change: turned(model.gap(p), **change)}
        if model.separation(p) and not (model.name == "juggler" and change == places["other mass"]):
            yield "separation", {"separation": lambda p, change=change: turned(model.separation(p), **change)}
        for name in model.heights(p):
            heights = lambda p, name=name, change=change: {  # noqa: E731
                **model.heights(p), name: turned(model.heights(p)[name], **change),
            }  # fmt: skip
            yield "heights", {"heights": heights}
    yield "extension", {"extension": Affine((1.0,) + (0.0,) * (len(model.flight.states) - 1))}
    yield "extension", {"extension": Affine((1.0,))}
    yield "gap", {"gap": lambda p: turned(model.gap(p), add=0.01)}
    yield "gap", {"gap": lambda p: None}
    yield "heights", {"heights": lambda p: {}}
    yield "springs", {"springs": (("nobody", None),)}
    yield "springs", {"springs": ((None, next(iter(model.heights(p)))),)}
    yield "violations", {"violations": {"gap": "below ground"}}
    yield from ((name, {name: "share"}) for name in ("homotopy", "gauge"))
    yield "guess", {"guess": 1.0}
    yield "rest", {"rest": lambda p: [0.0]}
    yield "rest", {"rest": lambda p: np.ones(len(model.flight.states))}
    yield "guess", {"guess": model.name}
    upper, lower, *_ = model.heights(p)
    for pair, length in (((lower, "nobody"), 1.0), ((lower, upper), -1.0), ((lower, upper), 1e-3)):
        yield "knees", {"knees": lambda p, pair=pair, length=length: [(*pair, length)]}
    yield "search", {"search": 1.0}
    if model.tension:
        yield "tension", {"tension": lambda x, p, q: -model.tension(x, p, q)}
        yield "tension", {"tension": lambda x, p, q: model.tension([x[0], x[1], 0.9 * x[2] + 0.1 * x[0], x[3]], p, q)}


BROKEN = {
    "hopper": Hopper("r + 0.3*r**3", mass_ratio=2.0, rest_length=20.0),
    "juggler": Juggler("r + 0.2*r**3", INVERSE_SQUARE, 3.0, 20.0),
    "chain": Chain([1.0, 2.0, 0.7], ["r", "r + r**3"]),
}


def with_model(machine, model):
    """A machine of the same numbers and parts with another model."""
    names = ("values", "units", "describe", "with_values", "restitution", "rest_length")
    stranger = SimpleNamespace(**{name: getattr(machine, name) for name in names}, model=model)
    stranger.with_values = lambda **values: stranger
    return stranger


def named(machine, model, start=None) -> tuple[str, ...]:
    """The fields that the error names, which `check` and `find` raise alike."""
    wrong = with_model(machine, model)
    with pytest.raises(InconsistentModel) as by_check:
        check(wrong, start=start)
    with pytest.raises(InconsistentModel) as by_find:
        find(wrong, start=start)
    assert by_find.value.fields == by_check.value.fields
    assert all(name in str(by_find.value) for name in by_find.value.fields)
    return by_find.value.fields


@pytest.mark.parametrize("kind", slow_after(2, ("hopper", "chain", "juggler")))
@pytest.mark.parametrize("part", [of_phases, of_launches, of_symmetry, of_geometry], ids=lambda part: part.__name__)
def test_wrong_fields_are_named_and_never_certified(kind, part):
    machine = BROKEN[kind]
    model = by_hand(machine)
    assert not suspects(algebraic_relations(model, machine.values))
    wrong = list(part(model, machine.values) if part is of_geometry else part(model))
    assert len(wrong) >= 15
    for i, (field, changes) in enumerate(wrong):
        assert named(machine, replace(model, **changes)) == (field,), i


def test_a_factor_of_one_force_is_told_where_another_has_its_unit():
    """Of two forces in different units nothing tells which is wrong: both are named, by the relation of the two."""
    machine = Hopper("r + 0.3*r**3", rest_length=20.0)
    model, force = machine.model, machine.model.contact.watch["contact force"]
    phase = replace(model.contact, watch={"contact force": lambda x, p, q: 1.01 * force(x, p, q)})
    for changes in ({"contact": phase}, {"tension": lambda x, p, q: 1.01 * model.tension(x, p, q)}):
        with pytest.raises(InconsistentModel, match=r"one unit: off by 0\.0\d+ \(tension, .*contact\.watch"):
            find(with_model(machine, replace(model, **changes)))
    si = MACHINES["in SI"].model
    for name in ("length", "force", "energy"):
        units = lambda p, name=name: replace(si.units(p), **{name: 1.01 * getattr(si.units(p), name)})  # noqa: E731
        relations = algebraic_relations(replace(si, units=units), MACHINES["in SI"].values)
        assert suspects(relations) == ("units",)


def test_a_factor_of_the_energy_or_of_all_impacts_is_told():
    """Which of the two is wrong nothing says: one of them is named."""
    model = by_hand(BROKEN["hopper"])
    for field in ("flight_gradient", "impact_mass"):
        whole = getattr(model, field)
        scaled = {
            "flight_gradient": lambda x, p, q, whole=whole: [1.01 * each for each in whole(x, p, q)],
            "impact_mass": lambda x, p, whole=whole: 1.01 * whole(x, p),
        }
        assert named(BROKEN["hopper"], replace(model, **{field: scaled[field]})) == ("impact_mass",)


def of_reduction(reduction):
    """What may be wrong of a reduction, one part of it in each case."""
    (arc,) = reduction.statement.arcs
    yield {"complete": lambda *given: 1.01 * reduction.complete(*given)}
    yield {"complete": lambda times, c, u, p: reduction.complete(1.01 * times, c, u, p)}
    yield {"gap_slope": lambda times, dz, p: -reduction.gap_slope(times, dz, p)}
    yield {"gap_slope": lambda times, dz, p: 1.01 * reduction.gap_slope(times, dz, p)}
    yield {"reversor": (1, 1)}
    arcs = [
        {"start": lambda u, before, p: [1.01 * u["liftoff"], u["alpha"]]},
        {"duration": lambda u, p: 1.01 * u["alpha"]},
        {"conditions": lambda u, x, p: [x[1] - 0.01]},
        {"guard": lambda u, x, p, q: [arc.guard(u, x, p, q)[0] + 0.01]},
        {"phase": replace(arc.phase, field=at(arc.phase.field, 1, 1.01))},
    ]
    for changes in arcs:
        yield {"statement": replace(reduction.statement, arcs=(replace(arc, **changes),))}
    if reduction.exact:
        yield {"exact": lambda family, p: ({**reduction.exact(family, p)[0], "alpha": 4.5}, 1e-15)}
        yield {"exact": lambda family, p: (reduction.exact(family, p)[0], -1.0)}


@pytest.mark.parametrize("kind", ["hopper", "cubic", "juggler"])
def test_wrong_short_cuts_are_named(kind):
    machine = MACHINES[kind]
    model = machine.model
    for i, changes in enumerate(of_reduction(model.reduction)):
        (part,) = changes
        if part == "statement" and changes["statement"].arcs[0].phase is not model.reduction.statement.arcs[0].phase:
            part = "phase"
        wrong = replace(model, reduction=replace(model.reduction, **changes))
        assert named(machine, wrong) == (f"reduction.{part}",), i
    if model.flight.closed_form is None:
        return
    form = model.flight.closed_form
    faster = lambda p: replace(form(p), squares=1.01 * form(p).squares)  # noqa: E731
    wrong = replace(model, flight=replace(model.flight, closed_form=faster))
    assert named(machine, wrong) == ("flight.closed_form",)
    stood = model.contact.closed_form
    wrong_parts = {"squares": np.array([1.01]), "loads": np.ones(1), "watch": {"contact force": ((1.0, 0.0), 0.0)}}
    for name, part in wrong_parts.items():
        form = lambda p, name=name, part=part: replace(stood(p), **{name: part})  # noqa: E731
        contact = replace(model.contact, closed_form=form)
        assert named(machine, replace(model, contact=contact)) == ("contact.closed_form",)


def test_pieces_in_the_wrong_place_are_named():
    machine = MACHINES["in pieces"]
    model = replace(machine.model, reduction=None)
    for which, coordinate in (("contact", (-1.0, 0.0)), ("flight", (0.0, 0.0, 1.0, 0.0)), ("flight", (1.0, 0.0))):
        phase = getattr(model, which)
        wrong = replace(phase, pieces=replace(phase.pieces, coordinate=coordinate))
        assert named(machine, replace(model, **{which: wrong})) == (f"{which}.pieces",)
    phase = replace(model.flight, pieces=replace(model.flight.pieces, coordinate=(1.0, 0.0, 0.0, 0.0)))
    with pytest.raises(InconsistentModel, match=r"by its flight\.pieces: .*continuous where its pieces meet"):
        check(with_model(machine, replace(model, flight=phase)))


def inerter_by_hand(**changes) -> SimpleNamespace:
    """A hopper of masses m1 and m2 with a spring k and an inerter b between, gravity 1, written by hand; the inerter's
    force is b times the acceleration of the extension."""

    def flight(x, p, q):
        spring = p["k"] * (x[0] - x[2])
        relative = -spring / (p["m1"] * p["m2"] / (p["m1"] + p["m2"]) + p["b"])
        share = p["m2"] / (p["m1"] + p["m2"])
        return [x[1], -1 + share * relative, x[3], -1 - (1 - share) * relative]

    def contact(x, p, q):
        return [x[1], -(p["k"] * x[0] + p["m1"]) / (p["m1"] + p["b"])]

    def rho(p):
        return (p["m1"] * p["m2"] + p["b"] * (p["m1"] + p["m2"])) / (p["k"] * p["m1"])

    def gradient(x, p, q):
        spring, moved = p["k"] * (x[0] - x[2]), p["b"] * (x[1] - x[3])
        return [spring + p["m1"], p["m1"] * x[1] + moved, p["m2"] - spring, p["m2"] * x[3] - moved]

    def guess(family, p):
        mu = p["m1"] * p["m2"] / (p["m1"] + p["m2"])
        half = 4.4934 * np.sqrt((mu + p["b"]) / p["k"])
        return {"liftoff": rho(p), "alpha": (1 + p["m2"] / p["m1"]) * half, "duration": half}

    p = {"m1": 1.3, "m2": 0.7, "k": 2.0, "b": 0.4}
    fields = {
        "name": "hopper with an inerter",
        "flight": Phase("flight", ("y1", "y1'", "y2", "y2'"), flight),
        "contact": Phase("contact", ("y1", "y1'"), contact, {"contact force": lambda x, p, q: (
            p["m2"] - p["k"] * x[0] + p["b"] * (p["k"] * x[0] + p["m1"]) / (p["m1"] + p["b"])
        )}),
        "launch": lambda u, p: [u["liftoff"], u["alpha"], 0.0, 0.0],
        "liftoff": lambda u, p, q: u["liftoff"] - rho(p),
        "landing": lambda u, x, p: [x[2], x[3], x[0] - u["liftoff"]],
        "reversor": (1, -1, 1, -1),
        "release": lambda alpha, p: np.full(np.shape(alpha), rho(p)),
        "touchdown": lambda u, p: [u["liftoff"], -u["alpha"]],
        "embed": np.eye(4, 2),
        "flight_gradient": gradient,
        "contact_gradient": lambda x, p, q: [p["k"] * x[0] + p["m1"], (p["m1"] + p["b"]) * x[1]],
        "extension": Affine((1.0, 0.0, -1.0, 0.0)),
        "gap": lambda p: Affine((0.0, 0.0, 1.0, 0.0)),
        "separation": lambda p: None,
        "heights": lambda p: {"body": Affine((1.0, 0.0, 0.0, 0.0)), "foot": Affine((0.0, 0.0, 1.0, 0.0))},
        "impact_mass": lambda x, p: p["m2"] + p["b"] * p["m1"] / (p["m1"] + p["b"]),
        "impact": lambda x, p: [0.0, p["b"] / (p["m1"] + p["b"]), 0.0, 1.0],
        "contact_speed": Affine((0.0, 1.0)),
        "violations": dict.fromkeys(("gap", "pull", "separation", "end"), "it is no motion"),
        "springs": (("foot", "body"),),
        "tension": lambda x, p, q: p["k"] * (x[0] - x[2]),
        "guess": guess,
    }  # fmt: skip
    told = {"machine": "hopper with an inerter", "spring": "k*r", "gravity": "1", "mass_ratio": 1.0, "parameters": p}
    told |= {"rest_length": None, "restitution": 0.0, "laws_in": "units of the machine"}
    machine = SimpleNamespace(model=Model(**{**fields, **changes}), values=p, units=None, restitution=0.0)
    machine.describe, machine.with_values, machine.rest_length = lambda: told, lambda **values: machine, None
    return machine


def test_a_machine_written_by_hand_with_coupled_inertia():
    """With an inerter the half flight obeys tan x = x, x = omega T/2 with omega**2 = k/(mu + b)."""
    machine = inerter_by_hand()
    assert check(machine).largest < 0.1
    p, orbit = machine.values, find(machine)
    omega = np.sqrt(p["k"] / (p["m1"] * p["m2"] / (p["m1"] + p["m2"]) + p["b"]))
    assert omega * orbit.flight_time / 2 == pytest.approx(4.493409457909064, rel=1e-13)
    # What a hopper without an inerter would have.
    plain = {
        "impact": lambda x, p: [0.0, 0.0, 0.0, 1.0],
        "impact_mass": lambda x, p: p["m2"],
        "contact": replace(machine.model.contact, watch={"contact force": lambda x, p, q: p["m2"] - p["k"] * x[0]}),
        "release": lambda alpha, p: np.full(np.shape(alpha), p["m2"] / p["k"]),
    }
    for field, wrong in plain.items():
        with pytest.raises(InconsistentModel) as error:
            find(inerter_by_hand(**{field: wrong}))
        assert error.value.fields == ("contact.watch" if field == "contact" else field,)
    with pytest.raises(InconsistentModel) as error:
        find(inerter_by_hand(**plain))
    assert len(error.value.fields) > 1


def test_a_machine_that_is_damped_and_says_it_is_not():
    machine = MACHINES["damped"]
    assert named(machine, replace(machine.model, conservative=True)) == ("conservative",)


def test_wrong_guesses_are_told():
    machine = Hopper("r + 0.3*r**3", rest_length=20.0)
    model = by_hand(machine)
    half = lambda family, p: {name: 0.5 * value for name, value in model.guess(family, p).items()}  # noqa: E731
    none = lambda family, p: {"liftoff": 1.0}  # noqa: E731
    faster = replace(machine.model.relative, rate=lambda p: 2.0)
    scale = lambda p: model.search(p)._replace(scale=-1.0)  # noqa: E731
    for field, wrong in (("guess", half), ("guess", none), ("guess", faster), ("search", scale)):
        with pytest.raises(InconsistentModel) as error:
            check(with_model(machine, replace(model, **{field: wrong})))
        assert error.value.fields == (field,)
    with pytest.raises(InconsistentModel, match="its guess has no 'duration'"):
        find(with_model(machine, replace(model, guess=none)), method="half orbit")


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("model", "hopper", "it is a str, not a Model"),
        ("values", [1.0], "it is a list, not a mapping"),
        ("values", {"mass_ratio": np.nan}, "is no finite number"),
        ("units", 3.0, "neither Units nor None"),
        ("describe", None, "describe"),
        ("describe", lambda: {}, "it says no 'machine'"),
        ("with_values", None, "with_values"),
        ("with_values", lambda **values: Hopper("cubic"), "does not give the same machine"),
        ("restitution", 1.5, "does not lie between 0 and 1"),
        ("rest_length", "long", "neither a length nor None"),
    ],
)
def test_a_malformed_part_of_a_machine_is_named(name, value, text):
    machine = with_model(Hopper(), Hopper().model)
    setattr(machine, name, value)
    with pytest.raises(InputError, match=text) as error:
        check(machine)
    assert name in str(error.value)


def test_every_missing_part_of_a_machine_is_named():
    machine = SimpleNamespace(model=replace(Hopper().model), values=Hopper().values)
    with pytest.raises(InputError) as error:
        check(machine)
    for name in ("with_values", "describe", "units", "restitution", "rest_length"):
        assert f"{name}" in str(error.value)


def test_fields_are_named_whatever_the_phases_are_called():
    machine = Hopper("r + 0.3*r**3", rest_length=20.0)
    model = replace(machine.model, reduction=None)
    flight, contact = replace(model.flight, name="air"), replace(model.contact, name="stance")
    assert check(with_model(machine, replace(model, flight=flight, contact=contact))).largest < 0.1
    wrong = replace(model, flight=flight, contact=replace(contact, field=at(contact.field, 1, 1.01)))
    assert named(machine, wrong) == ("contact.field",)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_no_number_is_named(value):
    machine = Hopper("r + 0.3*r**3", rest_length=20.0)
    model = replace(machine.model, reduction=None)
    wrong = {
        "impact_mass": lambda x, p: value,
        "impact": lambda x, p: [0.0, 0.0, 0.0, value],
        "embed": np.where(model.embed, value, 0.0),
        "flight_gradient": at(model.flight_gradient, 3, value),
    }
    for field, change in wrong.items():
        assert named(machine, replace(model, **{field: change})) == (field,)
    nowhere = replace(model.flight, field=at(model.flight.field, 3, value))
    with pytest.raises(InconsistentModel, match=r"its flight\.field gives no numbers"):
        check(with_model(machine, replace(model, flight=nowhere)))
    with pytest.raises(NoOrbit):
        find(with_model(machine, replace(model, flight=nowhere)))


def test_every_use_of_a_wrong_model_is_refused():
    machine = Hopper("r + 0.3*r**3", rest_length=20.0)
    model = replace(machine.model, impact_mass=lambda x, p: -machine.model.impact_mass(x, p))
    wrong = with_model(machine, model)
    for use in (
        lambda: ReturnMap(wrong),
        lambda: simulate(wrong, 3.0, hops=1),
        lambda: follow(wrong, "mass_ratio", 2.0),
    ):
        with pytest.raises(InconsistentModel, match="impact_mass"):
            use()


def test_a_model_is_looked_at_once(monkeypatch):
    looked = list[str]()
    real = consistency.algebraic_relations
    monkeypatch.setattr(consistency, "algebraic_relations", lambda m, p: looked.append(m.name) or real(m, p))

    @dataclass(frozen=True, repr=False)
    class Own(Hopper):
        def build(self, *laws):
            return replace(super().build(*laws), name="own")

    machine = Own()
    assert not machine.model.derived
    assert Hopper().model.derived
    for _ in range(2):
        find(machine)
        ReturnMap(machine)(4.0)
    find(Hopper("cubic"))
    assert looked == ["own"]


def test_a_separation_with_a_length_beside_it_is_consistent():
    """Coordinates are counted from the unloaded spring, whose length is in the separation alone."""
    machine = Mechanism(
        ("body", "foot"),
        [Mass("body", "m1"), Mass("foot", "m2"), Spring("body - foot", "k*r")],
        gap="foot",
        parameters={"m1": 1.0, "m2": 1.0, "k": 1.0},
        separation="body - foot + 8",
    )
    assert check(machine)
