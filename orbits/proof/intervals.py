"""Proofs for parameters that are known within intervals: at once where these are narrow, else in parts."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from typing import Any

from ..model.machine import machine_in_words
from .case import REFUTED, exact_numbers, parameter_bounds, scene_texts, whole_proof
from .claim import Claim
from .exact import Decimals
from .theorem import Enclosure, Proof
from .wording import machine_sentence, motion_sentence, units_sentence

# Intervals are halved so often where they are too wide for one proof.
HALVINGS_OF_INTERVALS = 4


def proof_of(claim: Claim, digits: int | None, parameters: Mapping[str, Decimals], motion: bool, loss: bool) -> Proof:
    """The proof of what is said of an orbit, see `prove`."""
    began = time.perf_counter()
    whole, numbers = whole_proof(claim, digits, parameters, motion, loss), exact_numbers(claim.machine, parameters)
    if whole.proved or not numbers.wide or REFUTED in whole.conditions.values():
        return whole
    options = {"digits": digits, "motion": motion, "loss": loss}
    parts = _parts(claim, dict(parameters), options, HALVINGS_OF_INTERVALS)
    if parts is None or not any(claim.alpha in part.enclosures["alpha"] for part in parts):
        return whole
    joined = _joined(parts, machine_sentence(machine_in_words(claim.machine), scene_texts(claim, parameters)))
    statement = " ".join(filter(None, (joined.statement, units_sentence(claim.machine.units))))
    seconds = time.perf_counter() - began
    return replace(joined, statement=statement, parameters=parameter_bounds(numbers), seconds=seconds)


def _parts(claim: Claim, parameters: dict[str, Any], options: dict[str, Any], left: int) -> list[Proof] | None:
    """Proofs of halves of the widest interval, and of their halves where they are needed; None where one fails."""
    numbers, found = exact_numbers(claim.machine, parameters), list[Proof]()
    widest = max(numbers.wide, key=numbers.relative_width)
    low, high = numbers.values[widest]
    middle = (low + high) / 2
    for ends in ((low, middle), (middle, high)):
        half = {**parameters, widest: ends}
        proof = whole_proof(claim, parameters=half, **options, about_alpha=False)
        if proof.proved:
            found.append(proof)
            continue
        if left == 1 or REFUTED in proof.conditions.values():
            return None
        deeper = _parts(claim, half, options, left - 1)
        if deeper is None:
            return None
        found += deeper
    return found


def _joined(parts: Sequence[Proof], machine: str) -> Proof:
    """One proof of those of parts of the intervals, each of which is proved; `machine` is the sentence about the whole.
    No single radius of uniqueness is told: the statement has the one of the parts."""
    first = parts[0]
    enclosures = {name: _union([part.enclosures[name] for part in parts]) for name in first.enclosures}
    told = "; ".join(f"{name.replace('_', ' ')} in {value}" for name, value in enclosures.items())
    radius = min((part.uniqueness_radius or "0" for part in parts), key=Decimal)
    each = "For each value of the parameters in their intervals"
    solved = f"{each} the equations of a lossless orbit have a solution with {told}"
    alone = f"no other solution has all unknowns within {radius} of the enclosures that hold in that part"
    unique = f"In each of {len(parts)} parts of the intervals {alone}"
    same = {part.family for part in parts}
    family = first.family if len(same) == 1 else None
    conditions = first.conditions if family is not None else {}
    statement = " ".join(filter(None, (machine, f"{solved}. {unique}.", motion_sentence(family, conditions))))
    half = (Decimal(enclosures["alpha"].high) - Decimal(enclosures["alpha"].low)) * Decimal("0.501")
    reasons = () if family is not None or not first.conditions else ("family: the parts are of several families",)
    return replace(
        first, proved=not reasons, statement=statement, family=family, enclosures=enclosures, conditions=conditions,
        radius=f"{half:.3E}", uniqueness_radius=None, reasons=reasons,
    )  # fmt: skip


def _union(enclosures: Sequence[Enclosure]) -> Enclosure:
    low = min((each.low for each in enclosures), key=Decimal)
    return Enclosure(low, max((each.high for each in enclosures), key=Decimal))
