"""The answers of this toolkit to the cases, to compare with those in their files, and its proofs."""

from collections.abc import Iterator
from pathlib import Path

from studies.exact_orbits import hoppers, machines
from studies.exact_orbits.closed_forms import CLOSED_FORMS
from studies.exact_orbits.comparison import Comparison
from studies.exact_orbits.reader import Case

COMPARED = hoppers.HOPPERS | machines.MACHINES | CLOSED_FORMS
PROOFS = hoppers.PROOFS | machines.PROOFS


def compared(path: Path) -> Iterator[Comparison]:
    """Compare the numbers of a case with the toolkit's, or where it cannot state the machine with `closed_forms`."""
    yield from COMPARED[path.stem](Case(path))


def proved(name: str) -> list[dict[str, str]] | None:
    """What the toolkit proves of the motion of a case, in its words; None for a case that is not proved here.

    Raises ArithmeticError if it finds the proof no longer.
    """
    if name not in PROOFS:
        return None
    proof = PROOFS[name]()
    if not proof.proved:
        raise ArithmeticError(
            f"{name}: the proof is not found any more ({'; '.join(proof.reasons)}): "
            "find out which change of the toolkit lost it; the file keeps what it states"
        )
    return [{"statement": proof.statement, "method": "interval arithmetic, by persistent-orbits"}]
