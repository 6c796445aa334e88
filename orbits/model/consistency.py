"""A hand-written model held against what follows from it: at a few random states and parameters, without integration.

Each relation names the fields of the model that it joins. Where one does not hold, one of its fields is wrong; which of
them, the other relations tell: a wrong field breaks those that it is in, and the fields that are right are in relations
that hold.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from itertools import combinations
from weakref import WeakSet

import numpy as np

from ..errors import InconsistentModel, OrbitsError
from .draws import SEED, Graphs
from .model import NOISE, Model
from .relations import MECHANICS, Relation
from .shapes import malformed
from .shortcuts import SHORT_CUTS

# How far, as a share, the parameters of the second draw lie from the machine's own.
PARAMETER_SPREAD = 0.02
SHORT_CUT = 0.1  # what a relation that holds speaks for a short cut, compared with what it speaks for other fields
# What is evaluated with the data of a piece.
IN_FLIGHT = ("flight.field", "flight_gradient", "liftoff", "tension")
IN_CONTACT = ("contact.field", "contact_gradient", "contact.watch")


def suspects(relations: list[Relation]) -> tuple[str, ...]:
    """The fewest fields that explain all relations that do not hold; of several such sets the one for which the least
    speaks: a relation that holds speaks for its fields, the more the fewer they are, and little for short cuts, which
    are doubted before what they shorten."""
    broken = [{*each.fields} for each in relations if not each.holds]
    names, speaks = sorted(set[str]().union(*broken)), defaultdict[str, float](float)
    for each in (each for each in relations if each.holds):
        for name in each.fields:
            speaks[name] += (SHORT_CUT if "closed_form" in name or "reduction" in name else 1.0) / len(each.fields)
    for count in range(1, len(broken) + 1):
        sets = [each for each in combinations(names, count) if all(fields & {*each} for fields in broken)]
        if sets:
            return min(sets, key=lambda each: (sum(speaks[name] for name in each), each))
    return ()


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
        for each in (_with_pieces(model, one) for kind in (*MECHANICS, *SHORT_CUTS) for one in kind(model, draw)):
            if each.words not in found or not each.deviation <= found[each.words].deviation:
                found[each.words] = each
    if not found:
        text = "nothing is a number near a launch at the machine's own parameters"
        raise InconsistentModel(f"the model '{model.name}' is malformed: flight.field: {text}", ("flight.field",))
    return list(found.values())


def _with_pieces(model: Model, relation: Relation) -> Relation:
    """The relation with the pieces of the phases on which its fields are evaluated."""
    fields = relation.fields
    for phase, own in ((model.flight, IN_FLIGHT), (model.contact, IN_CONTACT)):
        name = f"{phase.name}.pieces"
        fields += (name,) if phase.pieces and {*own} & {*fields} and name not in fields else ()
    return relation._replace(fields=fields)


def _parameters(model: Model, values: Mapping[str, float]) -> Iterator[dict[str, float]]:
    """The machine's own parameters, then others nearby, in the scene of the guess."""
    rng = np.random.default_rng(SEED)
    yield dict(values)
    moved = 1 + PARAMETER_SPREAD * rng.uniform(-1, 1, len(values))
    p = {
        name: value if name.startswith(NOISE) else value * factor
        for (name, value), factor in zip(values.items(), moved.tolist(), strict=True)
    }
    yield {**p, model.homotopy: 0.0} if model.homotopy else p
