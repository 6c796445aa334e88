"""A fold of a family, proved: a regular zero of the statement of folds (G. Moore, A. Spence, SIAM Journal on Numerical
Analysis 17, 1980), which is regular only where the family turns quadratically."""

import time
from collections.abc import Sequence

from flint import ctx

from ..model.machine import Machine, machine_in_words
from ..model.phase import Statement
from ..periodic.fold import fold_statement
from .case import bits_of_digits, exact_numbers, parameter_bounds
from .decimals import enclosure_of, lower_decimal, upper_decimal
from .exact import Decimals, Equations
from .refusal import Unproved
from .root import FIRST_BITS, ProvedRoot, prove_root
from .theorem import Proof
from .wording import machine_sentence, parameter_texts


def proof_of_fold(
    machine: Machine, statement: Statement, guess: Sequence[float], along: str, parameters: dict[str, Decimals],
    digits: int | None,
) -> Proof:  # fmt: skip
    """The proof of a fold near a guess of the unknowns of `fold_statement`; see `prove_fold`."""
    began, root, reasons = time.perf_counter(), None, list[str]()
    numbers, folded = exact_numbers(machine, parameters), fold_statement(statement, along)
    try:
        with ctx.workprec(FIRST_BITS):
            root = prove_root(Equations(folded, numbers), guess, bits_of_digits(digits))
    except Unproved as error:
        reasons.append(f"the fold: {error}")
    balls = dict(zip(folded.unknowns, root.box, strict=True)) if root else {}
    named = {name: ball for name, ball in balls.items() if name in (along, "alpha")}
    enclosures = {name: enclosure_of(ball, digits) for name, ball in named.items()}
    texts = parameter_texts(numbers)
    texts.pop(along)
    words = machine_sentence(machine_in_words(machine), texts)
    each = "For each value of the parameters in their intervals, " if numbers.wide else ""
    found = each + _fold_told(folded, root, along, enclosures) if root else f"Nothing is proved of a fold in {along}."
    return Proof(
        proved=root is not None,
        statement=f"{words} {found}",
        machine=machine_in_words(machine),
        parameters={name: each for name, each in parameter_bounds(numbers).items() if name != along},
        enclosures=enclosures,
        radius=upper_decimal(named["alpha"].rad()) if root else None,
        uniqueness_radius=lower_decimal(root.unique_within()) if root else None,
        reasons=tuple(reasons),
        digits=digits,
        seconds=time.perf_counter() - began,
    )


def _fold_told(folded: Statement, root: ProvedRoot, along: str, enclosures: dict) -> str:
    names, radius = ", ".join(folded.unknowns), lower_decimal(root.unique_within())
    where = f"at {along} in {enclosures[along]}, alpha in {enclosures['alpha']}"
    place = f"The equations of its lossless orbits have a fold in {along}, {where}"
    regular = "It is nondegenerate: the equations of the fold are regular there, so that the family turns quadratically"
    return f"{place}. {regular}. No other zero of these has all unknowns ({names}) within {radius} of these enclosures."
