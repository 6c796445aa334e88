"""Proofs for parameters that are known within intervals: whole where these are narrow, else in parts."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

from ..exact import Bounds, Claim, Decimals, Enclosure, StatedMachine, Unproved, bounds_of_fractions, radius_of
from ..running import time_limit
from .orbit_case import check_mirrored, not_stated, whole_proof
from .proved_motion import CONDITIONS, REFUTED, UNDECIDED
from .theorem import Proof
from .wording import loss_sentence, motion_sentence, solved_words

# Intervals are halved at most this many times where they are too wide for one proof.
HALVINGS_OF_INTERVALS = 4


def proof_of(
    claim: Claim, digits: int | None, parameters: Mapping[str, Decimals], motion: bool, loss: bool, limit: float | None,
    attraction: bool = False,
) -> Proof:  # fmt: skip
    """The proof of a claim about an orbit; see `prove`."""
    check_mirrored(claim.machine.model)
    with time_limit(limit):
        return _proof_of(claim, digits, parameters, motion, loss, attraction)


def _proof_of(
    claim: Claim, digits: int | None, parameters: Mapping[str, Decimals], motion: bool, loss: bool, attraction: bool
) -> Proof:
    began = time.perf_counter()
    try:
        stated = claim.stated(parameters)
    except Unproved as error:
        return not_stated(claim.machine, error, dict.fromkeys(CONDITIONS if motion else (), UNDECIDED))
    whole = whole_proof(claim, stated, digits, motion, loss, attraction)
    if whole.proved or not stated.wide or attraction or REFUTED in whole.conditions.values() or claim.contradictions:
        return whole
    own = claim.stated({}).parameters
    if not _contain(stated, own):
        return whole
    parts = _parts(claim, stated, own, (digits, motion, loss), HALVINGS_OF_INTERVALS)
    if not parts[-1].proved:  # its reason may be another one, such as the time limit
        others = (each for each in parts[-1].reasons if not _is_among(each, whole.reasons))
        reasons = *whole.reasons, *(f"in a part of the intervals: {each}" for each in others)
        if box := _smaller_box(claim, stated, own, (digits, motion, loss)):
            words = " and ".join(f"{name} in {bounds_of_fractions(box[name])}" for name in stated.wide)
            reasons = *reasons, f"the intervals as a whole, but smaller ones are: {words}"
        return replace(whole, reasons=reasons, seconds=time.perf_counter() - began)
    seconds = time.perf_counter() - began
    parameters_stated = {name: bounds_of_fractions(bounds) for name, bounds in stated.parameters.items()}
    return replace(_joined(parts, stated), parameters=parameters_stated, seconds=seconds)


def _is_among(reason: str, reasons: Sequence[str]) -> bool:
    """Whether one of the reasons is about the same condition and ends in the same words."""
    condition, _, words = reason.partition(": ")
    return any(each.startswith(condition) and each.endswith(words) for each in reasons)


def _contain(stated: StatedMachine, own: Mapping[str, Bounds]) -> bool:
    """Whether the intervals contain a machine's own values."""
    return all(stated.parameters[name][0] <= own[name][0] <= stated.parameters[name][1] for name in stated.wide)


def _parts(
    claim: Claim, stated: StatedMachine, own: Mapping[str, Bounds], options: tuple[int | None, bool, bool], depth: int
) -> list[Proof]:
    """Proofs of halves of the widest interval, and of their halves where needed, up to the first part that is not
    proved. The orbit's numbers are compared with the parts that contain its machine's own values."""
    found = list[Proof]()
    widest = max(stated.wide, key=lambda name: _relative_width(stated.parameters[name]))
    low, high = stated.parameters[widest]
    middle = (low + high) / 2
    for ends in ((low, middle), (middle, high)):
        half = replace(stated, parameters={**stated.parameters, widest: ends})
        proof = whole_proof(claim, half, *options, about_claim=_contain(half, own))
        last = proof.proved or depth == 1 or REFUTED in proof.conditions.values()
        found += [proof] if last else _parts(claim, half, own, options, depth - 1)
        if not found[-1].proved:
            break
    return found


def _smaller_box(
    claim: Claim, stated: StatedMachine, own: Mapping[str, Bounds], options: tuple[int | None, bool, bool]
) -> dict[str, Bounds]:
    """The largest one that is proved of boxes about a machine's own values, each half as wide as the one before, by
    bisection; empty where none is that is tried."""
    found, least, most = dict[str, Bounds](), 1, 4 * HALVINGS_OF_INTERVALS
    while least <= most:
        middle = (least + most) // 2
        bounds = {name: _about(own[name][0], stated.parameters[name], Fraction(1, 2**middle)) for name in stated.wide}
        box = replace(stated, parameters={**stated.parameters, **bounds})
        if whole_proof(claim, box, *options).proved:
            found, most = bounds, middle - 1
        else:
            least = middle + 1
    return found


def _about(value: Fraction, bounds: Bounds, share: Fraction) -> Bounds:
    """This share of an interval about a value in it, with ends of two digits of the width."""
    low, high = (value + share * (end - value) for end in bounds)
    unit = Fraction(10) ** (math.floor(math.log10(high - low)) - 1)
    return min(math.ceil(low / unit) * unit, value), max(math.floor(high / unit) * unit, value)


def _relative_width(bounds: Bounds) -> float:
    low, high = bounds
    return float((high - low) / max(abs(low), abs(high)))


def _joined(parts: Sequence[Proof], stated: StatedMachine) -> Proof:
    """One proof from those of parts of the intervals, all of them proved. No single radius of uniqueness is stated:
    each part has its own."""
    first = parts[0]
    enclosures = {name: _union([part.enclosures[name] for part in parts]) for name in first.enclosures}
    unknowns = {name: _union([part.parts[0].unknowns[name] for part in parts]) for name in first.parts[0].unknowns}
    radius = min((part.uniqueness_radius or "0" for part in parts), key=Decimal)
    solved = solved_words(unknowns, True, stated)
    alone = f"no other solution has all unknowns within {radius} of the enclosures that hold in that part"
    unique = f"In each of {len(parts)} parts of the intervals {alone}"
    same = {part.family for part in parts}
    family = first.family if len(same) == 1 else None
    conditions = first.conditions if family is not None else {}
    motion = motion_sentence(family, conditions, enclosures, stated)
    reasons = ["family: the parts are of several families"] if family is None and first.conditions else []
    side = first.bounce_side if len({part.bounce_side for part in parts}) == 1 else None
    if side is None and "loss_coefficient" in enclosures:
        reasons.append("the loss coefficient: landings have a bounce above alpha in some parts, and below it in others")
    loss = loss_sentence(enclosures["loss_coefficient"], side) if side else ""
    statement = " ".join(filter(None, (stated.words(), f"{solved}. {unique}.", motion, loss)))
    return replace(
        first, proved=not reasons, statement=statement, stated={**first.stated, **stated.document()}, family=family,
        bounce_side=side,
        enclosures=enclosures, conditions=conditions, radius=radius_of(enclosures["alpha"]), uniqueness_radius=None,
        parts=tuple(each for part in parts for each in part.parts), reasons=tuple(reasons),
    )  # fmt: skip


def _union(enclosures: Sequence[Enclosure]) -> Enclosure:
    low = min((each.low for each in enclosures), key=Decimal)
    return Enclosure(low, max((each.high for each in enclosures), key=Decimal))
