"""A hand-written model held against what follows from it: at a few random states and parameters, without integration.

Each relation names the fields of the model that it joins. Where one does not hold, one of its fields is wrong; which of
them, the other relations tell: a wrong field breaks those that it is in, and the fields that are right are in relations
that hold.
"""

from collections.abc import Iterator, Mapping
from weakref import WeakSet

import numpy as np

from ..errors import InconsistentModel, OrbitsError
from .draws import SEED, Graphs
from .model import NOISE, Model
from .relations import KINDS, Relation
from .shapes import malformed

# Draws of the parameters, and how far, as a share, those of the second and the third lie from the machine's own.
DRAWS, PARAMETER_SPREAD = 3, 0.02


def suspects(relations: list[Relation]) -> tuple[str, ...]:
    """The fewest fields that explain the relations that do not hold: those that are in most of them, and of these the
    ones that are in the fewest relations that hold."""
    broken, found = [each for each in relations if not each.holds], list[str]()
    while broken:
        names = {name for each in broken for name in each.fields}
        hits = {name: sum(name in each.fields for each in broken) for name in names}
        holds = {name: sum(name in each.fields for each in relations if each.holds) for name in names}
        most = min(names, key=lambda name: (-hits[name], holds[name], name))
        found.append(most)
        broken = [each for each in broken if most not in each.fields]
    return tuple(found)


def inconsistent(name: str, relations: list[Relation]) -> InconsistentModel:
    """The error about a model of which some relations do not hold."""
    fields, broken = suspects(relations), [each for each in relations if not each.holds]
    told = "; ".join(f"{each.words}: off by {each.deviation:.2g} ({', '.join(each.fields)})" for each in broken)
    return InconsistentModel(f"the model '{name}' contradicts itself, by its {' and '.join(fields)}: {told}", fields)


_consistent: WeakSet[Model] = WeakSet()


def check_consistency(model: Model, values: Mapping[str, float]) -> None:
    """Raise `InconsistentModel` for a model whose fields contradict each other; each model is looked at once."""
    if model.derived or model in _consistent:
        return
    relations = algebraic_relations(model, values)
    if not all(each.holds for each in relations):
        raise inconsistent(model.name, relations)
    _consistent.add(model)


def algebraic_relations(model: Model, values: Mapping[str, float]) -> list[Relation]:
    """The relations among a model's fields, each with its largest deviation over all draws.

    Raises `InconsistentModel` where a field has not the form that `Model` says.
    """
    if wrong := malformed(model, values):
        told = "; ".join(f"{name}: {text}" for name, text in wrong.items())
        raise InconsistentModel(f"the model '{model.name}' is malformed: {told}", tuple(wrong))
    graphs, found = Graphs(model, tuple(values)), dict[str, Relation]()
    for p in _parameters(model, values):
        try:
            draw = graphs.draw(p)
        except OrbitsError:
            continue  # parameters that the machine cannot have, nor its laws
        for each in (relation for kind in KINDS for relation in kind(model, draw)):
            if each.words not in found or not each.deviation <= found[each.words].deviation:
                found[each.words] = each
    if not found:
        text = "nothing is a number near a launch at the machine's own parameters"
        raise InconsistentModel(f"the model '{model.name}' is malformed: flight.field: {text}", ("flight.field",))
    return list(found.values())


def _parameters(model: Model, values: Mapping[str, float]) -> Iterator[dict[str, float]]:
    """The machine's own parameters, then others nearby; the last in the scene of the guess."""
    rng = np.random.default_rng(SEED)
    yield dict(values)
    for i in range(1, DRAWS):
        moved = 1 + PARAMETER_SPREAD * rng.uniform(-1, 1, len(values))
        p = {
            name: value if name.startswith(NOISE) else value * factor
            for (name, value), factor in zip(values.items(), moved.tolist(), strict=True)
        }
        yield {**p, model.homotopy: 0.0} if model.homotopy and i == DRAWS - 1 else p
