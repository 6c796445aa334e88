"""The theorem on a proved curve, in words and as a `Proof`."""

from collections.abc import Sequence
from dataclasses import dataclass

from flint import arb, ctx

from ..balls import FIRST_BITS, ball_of_fraction
from ..exact import (
    Enclosure,
    StatedMachine,
    bounds_of_fractions,
    decimal_text,
    enclosure_of,
    lower_decimal,
    upper_decimal,
)
from ..model import machine_in_words
from .branch_claim import BranchClaim
from .branch_motion import MotionStretch
from .branch_piece import CurvePiece, parts_between
from .branch_way import Link
from .proved_existence import ProvedExistence
from .proved_motion import PROVED, REFUTED, UNDECIDED
from .theorem import CurvePart, Proof
from .wording import enclosed_words, words_of_conditions

# The name of each condition where it is violated or not decided.
LOST_CONDITIONS = {
    "clearance": "clearance",
    "separation": "separation",
    "contact_force": "contact force",
    "contact_end": "end of the contact",
}


@dataclass(frozen=True)
class ProvedCurve:
    """A proved curve: its ends, its pieces, and the verdicts on the motions along it."""

    ends: tuple[ProvedExistence, ProvedExistence]
    links: list[Link]
    stretches: list[MotionStretch]


def branch_proof(
    claim: BranchClaim, stated: StatedMachine, found: ProvedCurve | None, motion: bool, reasons: Sequence[str],
    digits: int | None, seconds: float,
) -> Proof:  # fmt: skip
    """The theorem about a curve, or the report that nothing is proved of one."""
    along = claim.along
    document = stated.document()
    document["parameters"] = document["parameters"] | {along: None}
    others = {name: bounds_of_fractions(each) for name, each in stated.parameters.items() if name != along}
    first, last = (repr(float(row[-1])) for row in (claim.points[0], claim.points[-1]))
    if found is None:
        words = f"Nothing is proved of a curve of orbits from {along} = {first} to {along} = {last}."
        return Proof(
            proved=False, statement=f"{stated.words(free=along)} {words}", machine=machine_in_words(claim.machine),
            kind="branch", stated=document, parameters=others, reasons=tuple(reasons), digits=digits, seconds=seconds,
        )  # fmt: skip
    with ctx.workprec(FIRST_BITS):
        folds = [fold for link in found.links for fold in link.folds]
        folded = [{name: enclosure_of(fold.balls[name], digits) for name in (along, "alpha")} for fold in folds]
        parts = tuple(_part(link) for link in found.links)
        sentences = [
            stated.words(free=along),
            _curve_sentence(found, parts, along, (first, last)),
            _fold_sentence(along, folded, [fold.largest for fold in folds]),
            _motion_sentence(found.stretches, along) if motion else "",
        ]
    enclosures = dict[str, Enclosure]()
    for number, each in enumerate(folded, start=1):
        name = "fold" if len(folded) == 1 else f"fold_{number}"
        enclosures |= {f"{name}_{key}": value for key, value in each.items()}
    for name, end in zip(("first", "last"), found.ends, strict=True):
        enclosures |= {f"{name}_{key}": end.unknowns[key] for key in ("alpha", "flight_time")}
    verdicts = _verdicts_along(found.stretches)
    families = {each.family for each in found.stretches}
    reasons = (*reasons, *_reasons(found.stretches, along))
    return Proof(
        proved=not reasons,
        statement=" ".join(filter(None, sentences)),
        machine=machine_in_words(claim.machine),
        kind="branch",
        stated=document,
        parameters=others,
        family=families.pop() if len(families) == 1 else None,
        enclosures=enclosures,
        parts=parts,
        conditions=verdicts,
        reasons=reasons,
        digits=digits,
        seconds=seconds,
    )


def _part(link: Link) -> CurvePart:
    """The data of a piece, in the units of the machine."""
    piece, equations = link.piece, link.piece.equations
    units = [*map(ball_of_fraction, equations.units)]
    hulls = dict(zip(equations.names, _hulls(piece), strict=True))
    solved = [(equations.names[i], i) for i in piece.tube.solved]
    alone = {name: lower_decimal(piece.tube.widths[i] * units[i]) for name, i in solved}
    along = equations.along
    return CurvePart(
        parameters={along: hulls.pop(along)},
        unknowns=hulls,
        uniqueness_radius=min(alone.values(), key=float),
        coordinate=equations.names[piece.coordinate],
        start=decimal_text(piece.start),
        stop=decimal_text(piece.stop),
        polynomials={name: tuple(map(decimal_text, piece.coefficients[i])) for name, i in solved},
        within={name: upper_decimal(piece.tube.radii[i] * units[i]) for name, i in solved},
        alone_within=alone,
    )


def _hulls(piece: CurvePiece) -> list[Enclosure]:
    """Enclosures of all coordinates on the whole piece."""
    whole = list[arb]()
    for low, high in parts_between(-1.0, 1.0):
        here = piece.at(arb(low).union(arb(high)))
        whole = [a.union(b) for a, b in zip(whole, here, strict=True)] if whole else here
    return [enclosure_of(value * ball_of_fraction(unit))
            for value, unit in zip(whole, piece.equations.units, strict=True)]  # fmt: skip


def _curve_sentence(found: ProvedCurve, parts: Sequence[CurvePart], along: str, ends: tuple[str, str]) -> str:
    first, last = (f"{along} = {value} with {enclosed_words(end.unknowns)}"
                   for value, end in zip(ends, found.ends, strict=True))  # fmt: skip
    names = ", ".join(name.replace("_", " ") for name in (*found.links[0].piece.equations.names,))
    curve = f"The equations of a lossless orbit have a continuous curve of solutions in ({names})"
    widest = max((each for part in parts for each in part.within.values()), key=float)
    alone = min((part.uniqueness_radius for part in parts), key=float)
    runs = sorted({part.coordinate for part in parts})
    many = "s, each of which begins where the one before ends" if len(parts) > 1 else ""
    tubes = (
        f"It is made of {len(parts)} piece{many}; on each {' or '.join(runs)} runs one way, and for each of its values "
        f"there is exactly one solution in a tube about polynomials, which are saved with the proof: the tube reaches "
        f"{alone} or more to either side of them, and the solution is at most {widest} from them"
    )
    return f"{curve} from {first} to {last}. {tubes}."


def _fold_sentence(along: str, folds: Sequence[dict[str, Enclosure]], largest: Sequence[bool]) -> str:
    if not folds:
        return f"It has no fold: {along} runs one way on all of it."
    count = "exactly one fold" if len(folds) == 1 else f"exactly {len(folds)} folds"
    each = [f"one with {enclosed_words(fold)}, where {along} is {'largest' if top else 'least'}"
            for fold, top in zip(folds, largest, strict=True)]  # fmt: skip
    return f"It has {count} in {along}, nondegenerate: {'; '.join(each)}. Elsewhere {along} runs one way."


def _ends_of(stretch: MotionStretch) -> list[dict[str, arb]]:
    equations = stretch.piece.equations
    return [equations.in_machine(stretch.piece.at(arb(place))) for place in (stretch.low, stretch.high)]


def _runs(stretches: Sequence[MotionStretch]) -> list[list[MotionStretch]]:
    """The stretches in order, grouped into runs for which the same is proved."""
    runs = list[list[MotionStretch]]()
    for each in stretches:
        if runs and runs[-1][-1].like(each):
            runs[-1].append(each)
        else:
            runs.append([each])
    return runs


def _range_in_words(run: Sequence[MotionStretch], along: str) -> str:
    (first, _), (_, last) = _ends_of(run[0]), _ends_of(run[-1])
    begin, end = (
        f"{along} in {enclosure_of(each[along])} and alpha in {enclosure_of(each['alpha'])}" for each in (first, last)
    )
    return f"from {begin} to {end}"


def _motion_sentence(stretches: Sequence[MotionStretch], along: str) -> str:
    """The sentences on what is proved of the motions, part after part."""
    runs = _runs(stretches)
    places = ["all along the curve"] if len(runs) == 1 else [_range_in_words(run, along) for run in runs]
    return " ".join(_run_in_words(run, place) for run, place in zip(runs, places, strict=True))


def _run_in_words(run: Sequence[MotionStretch], where: str) -> str:
    family, conditions = run[0].family, run[0].conditions
    words = words_of_conditions(run[0].piece.equations.stated)
    proved = [words[name] for name, verdict in conditions.items() if verdict == PROVED]
    counted = [] if family is None else [f"the orbits are of family {family}"]
    if run[0].admissible:
        return f"They are motions {where}: {'; '.join([*counted, *proved])}."
    lost = [name for name, verdict in conditions.items() if verdict == REFUTED]
    left = [name for name, verdict in conditions.items() if verdict == UNDECIDED]
    violated = (
        [f"they are no motions, as the {' and '.join(LOST_CONDITIONS[name] for name in lost)} is violated"]
        if lost
        else []
    )
    undecided = [f"undecided is the {' and '.join(LOST_CONDITIONS[name] for name in left)}"] if left else []
    return f"Of the part {where}: {'; '.join([*counted, *violated, *proved, *undecided])}."


def _verdicts_along(stretches: Sequence[MotionStretch]) -> dict[str, str]:
    """The verdict on each condition along the whole curve: refuted where it is refuted on some part."""
    names = stretches[0].conditions if stretches else {}
    found = {name: {each.conditions[name] for each in stretches} for name in names}
    order = (REFUTED, UNDECIDED, PROVED)
    return {name: next(each for each in order if each in verdicts) for name, verdicts in found.items()}


def _reasons(stretches: Sequence[MotionStretch], along: str) -> list[str]:
    """The reasons why motions are not proved, part after part."""
    runs = [run for run in _runs(stretches) if not run[0].admissible]
    reasons = [f"{_range_in_words(run, along)}: {'; '.join(dict.fromkeys(run[0].reasons))}" for run in runs]
    if len({each.family for each in stretches}) > 1:
        reasons.append("family: the parts of the curve are of several families, or it is not counted")
    return reasons
