"""Consistency of a hand-written model, checked at a few random states and parameters, without integration.

Each relation names the fields of the model that it joins. Where one does not hold, one of its fields is wrong; the
other relations show which: a wrong field breaks those that it is in, and the fields that are right are in relations
that hold.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from weakref import WeakSet

import numpy as np

from ..errors import InconsistentModel, OrbitsError
from ..model.model import Model
from .draws import SEED, Graphs
from .relations import MECHANICS, Relation
from .shapes import malformed
from .shortcuts import SHORT_CUTS

# How far, as a share, parameters are drawn around the machine's own.
PARAMETER_SPREAD = 0.02
SHORT_CUT = 0.1  # the evidence of a relation that holds for a short cut, compared with that for other fields
MOST_SUSPECTS = 3  # where more fields are wrong, all that do not fit are named


def suspects(relations: list[Relation]) -> tuple[str, ...]:
    """The fewest fields that explain all relations that do not hold; of several such sets that with the least evidence
    for its fields: a relation that holds is evidence for its fields, the more the fewer they are, and little for short
    cuts, which are doubted before what they shorten."""
    broken = [{*each.fields} for each in relations if not each.holds]
    if not broken:
        return ()
    names, evidence = sorted(set[str]().union(*broken)), defaultdict[str, float](float)
    for each in (each for each in relations if each.holds):
        # A relation between the fields of one phase holds with the data of any piece, so it is no evidence for pieces.
        for name in each.fields if "release" in each.fields else [n for n in each.fields if ".pieces" not in n]:
            evidence[name] += (SHORT_CUT if "closed_form" in name or "reduction" in name else 1.0) / len(each.fields)
    for count in range(1, MOST_SUSPECTS + 1):
        sets = [each for each in combinations(names, count) if all(fields & {*each} for fields in broken)]
        if sets:
            return min(sets, key=lambda each: (sum(evidence[name] for name in each), each))
    return tuple(names)


def inconsistent(name: str, relations: list[Relation]) -> InconsistentModel:
    """The error about a model whose relations do not all hold."""
    fields, broken = suspects(relations), [each for each in relations if not each.holds]
    text = "; ".join(f"{each.words}: off by {each.deviation:.2g} ({', '.join(each.fields)})" for each in broken)
    return InconsistentModel(f"the model '{name}' contradicts itself, by its {' and '.join(fields)}: {text}", fields)


_consistent: WeakSet[Model] = WeakSet()


def check_consistency(model: Model, values: Mapping[str, float]) -> None:
    """Raise `InconsistentModel` for a model whose fields contradict each other; each model is checked once."""
    if model.derived or model in _consistent:
        return
    relations = algebraic_relations(model, values)
    if not all(each.holds for each in relations):
        raise inconsistent(model.name, relations)
    _consistent.add(model)


def algebraic_relations(model: Model, values: Mapping[str, float]) -> list[Relation]:
    """The relations among a model's fields, each with its largest deviation over all draws; none where its laws give no
    numbers near a launch.

    Raises `InconsistentModel` where a field has not the form that `Model` says.
    """
    if wrong := malformed(model, values):
        parts = "; ".join(f"{name}: {text}" for name, text in wrong.items())
        raise InconsistentModel(f"the model '{model.name}' is malformed: {parts}", tuple(wrong))
    graphs, found = Graphs(model, tuple(values)), dict[str, Relation]()
    draws = [_relations_at(model, graphs, p) for p in _parameters(model, values)]
    if not any(draws):
        draws = [_relations_at(model, graphs, values)]
    for each in (relation for draw in draws for relation in draw):
        if each.words not in found or not each.deviation <= found[each.words].deviation:
            found[each.words] = each
    return list(found.values())


def _with_pieces(model: Model, relation: Relation) -> Relation:
    """The relation with the pieces of the phases on which its fields are evaluated."""
    names, found = {*relation.fields}, relation.fields
    in_contact = bool({"contact.field", "contact.watch"} & names)
    in_flight = bool({"flight.field", "tension"} & names or ("flight_gradient" in names and not in_contact))
    for phase, used, name in (
        (model.flight, in_flight, "flight.pieces"),
        (model.contact, in_contact, "contact.pieces"),
    ):
        found += (name,) if phase.pieces and used and name not in names else ()
    return replace(relation, fields=found)


def _parameters(model: Model, values: Mapping[str, float]) -> Iterator[dict[str, float]]:
    """Parameters near the machine's own, no two of them equal by chance; the same in the scene of the guess."""
    moved = 1 + PARAMETER_SPREAD * np.random.default_rng(SEED).uniform(-1, 1, len(values))
    near = zip(values.items(), moved.tolist(), strict=True)
    p = {name: value * factor for (name, value), factor in near}
    yield p
    if model.homotopy:
        yield {**p, model.homotopy: 0.0}


def _relations_at(model: Model, graphs: Graphs, p: Mapping[str, float]) -> list[Relation]:
    """The relations at one draw of the parameters; none where the machine cannot have them, nor its laws."""
    try:
        with np.errstate(all="ignore"):  # a deviation that is no number counts as unbounded
            draw = graphs.draw(p)
            return [_with_pieces(model, each) for kind in (*MECHANICS, *SHORT_CUTS) for each in kind(model, draw)]
    except OrbitsError:
        return []
