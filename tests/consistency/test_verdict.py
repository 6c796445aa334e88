"""The verdict on a model: no false alarms, a wrong field is named and never certified, each model is checked once."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from conftest import slow_after

from orbits import ReturnMap, check, find
from orbits.consistency.verdict import algebraic_relations, suspects
from orbits.model import Affine
from problems import Chain, Hopper, Juggler, hopper_in_si
from tests.consistency.by_hand import by_hand
from tests.consistency.checked_machines import BROKEN, at, named, with_model


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


@pytest.mark.slow
def test_no_false_alarms():
    found = [(machine, algebraic_relations(machine.model, machine.values)) for machine in random_machines(40)]
    alarms = [(machine, suspects(relations)) for machine, relations in found if suspects(relations)]
    assert not alarms
    # Rounding stays far from the bound, and an error of one per cent is far above it.
    assert max(each.deviation for _, relations in found for each in relations) < 1e-10


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


@pytest.mark.parametrize("kind", slow_after(2, ("hopper", "chain", "juggler")))
@pytest.mark.parametrize("part", [of_phases, of_launches, of_symmetry, of_geometry], ids=lambda part: part.__name__)
@pytest.mark.slow
def test_wrong_fields_are_named_and_never_certified(kind, part):
    machine = BROKEN[kind]
    model = by_hand(machine)
    assert not suspects(algebraic_relations(model, machine.values))
    wrong = list(part(model, machine.values) if part is of_geometry else part(model))
    assert len(wrong) >= 15
    for i, (field, changes) in enumerate(wrong):
        assert named(machine, replace(model, **changes)) == (field,), i


def test_fields_are_named_whatever_the_phases_are_called():
    machine = Hopper("r + 0.3*r**3", rest_length=20.0)
    model = replace(machine.model, reduction=None)
    flight, contact = replace(model.flight, name="air"), replace(model.contact, name="stance")
    assert check(with_model(machine, replace(model, flight=flight, contact=contact))).largest < 0.1
    wrong = replace(model, flight=flight, contact=replace(contact, field=at(contact.field, 1, 1.01)))
    assert named(machine, wrong) == ("contact.field",)


def test_a_model_is_looked_at_once():
    """At its first use, which calls a function of the model more often than any later one; a map makes no use of it."""
    calls = list[str]()

    @dataclass(frozen=True, repr=False)
    class Own(Hopper):
        def build(self, *laws):
            return replace(super().build(*laws), name="own", knees=lambda p: calls.append("knees") or [])

    def calls_of(use) -> int:
        calls.clear()
        use()
        return len(calls)

    machine = Own()
    assert not machine.model.derived
    assert Hopper().model.derived
    first, map_of_it, second, third = map(
        calls_of, (lambda: find(machine), lambda: ReturnMap(machine)(4.0), *(lambda: find(machine),) * 2)
    )
    assert map_of_it == 0 < second == third < first
    assert calls_of(lambda: ReturnMap(Own(mass_ratio=2.0, spring="cubic"))(4.0)) == first - second
