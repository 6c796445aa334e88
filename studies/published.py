"""Published cases: numbers from papers, books, course notes and issues, each compared with that of the toolkit.

Each case states where its number is printed, or which closed form it is, and computes it anew. The cases are in
`published_cases`, by subject; what the toolkit cannot state is listed with the missing idea.
Run: python studies/published.py [--quick] [--write]
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script too it finds the cases

from studies.published_cases import bounces, cannot, control, hops, oscillators, rocking, walkers
from studies.published_cases.case import Case, Computed, Missing, computed, our_text, published_text

SUBJECTS: Mapping[str, Sequence[Case]] = {
    "Bouncing": bounces.CASES,
    "Rocking": rocking.CASES,
    "Walking": walkers.CASES,
    "Hopping": hops.CASES,
    "Oscillating": oscillators.CASES,
    "Optimal control": control.CASES,
}
CANNOT: Sequence[Missing] = cannot.MISSING
PAGE = Path(__file__).parent / "docs" / "published.md"
HEADS = ("case", "published", "ours", "within", "source")


def cells(found: Computed, number: int) -> tuple[str, ...]:
    """The cells of a case in the table of the page, with its first number and the number of its source."""
    case = found.case
    published, ours = published_text(case.published[0]), our_text(found.ours[0], case.published[0])
    count = f" ({len(case.published)} numbers)" if len(case.published) > 1 else ""
    within = f"{case.allowed[0]:.0e}".replace("e-0", "e-")
    return f"**{case.name}**: {case.quantity}", published + count, ours, within, f"[{number}] {case.place}"


def page(found: Mapping[str, Sequence[Computed]]) -> str:
    """The page: what stands above its tables, the tables, and the sources in the order of their first case."""
    cases = [each.case for own in found.values() for each in own]
    sources = list(dict.fromkeys(each.source for each in (*cases, *CANNOT)))
    lines = [PAGE.read_text(encoding="utf-8").partition("\n## ")[0].rstrip()]
    for subject, own in found.items():
        rows = [HEADS, ("---",) * len(HEADS), *(cells(each, 1 + sources.index(each.case.source)) for each in own)]
        lines += [f"\n## {subject}\n", *(f"| {' | '.join(row)} |" for row in rows)]
    lines += ["\n## What cannot be stated\n", "| case | missing idea | source |", "| --- | --- | --- |"]
    lines += [f"| {each.name} | {each.idea} | [{1 + sources.index(each.source)}] |" for each in CANNOT]
    lines += ["\n## Sources\n", *(f"{number}. {source}" for number, source in enumerate(sources, start=1))]
    return "\n".join(lines) + "\n"


def print_case(found: Computed) -> None:
    """Print the number of a case that is farthest off."""
    case, at = found.case, found.worst
    published, ours = published_text(case.published[at]), our_text(found.ours[at], case.published[at])
    count = f", worst of {len(case.published)}" if len(case.published) > 1 else ""
    print(f"{'  ok ' if found.right else 'WRONG'} {case.name}: {case.quantity}")
    print(f"        published {published}, ours {ours}{count}; off by {found.differences[at]:.1e} of", end=" ")
    print(f"{case.allowed[at]:.0e}\n        {case.source}\n        {case.place}")


def main(quick: bool = False, write: bool = False) -> list[Computed]:
    """Compute and print all cases, or those of the quick mode; returns them."""
    found: dict[str, list[Computed]] = {}
    for subject, cases in SUBJECTS.items():
        print(f"\n{subject}\n")
        found[subject] = []
        for case in cases:
            if not (quick and case.slow):
                found[subject].append(computed(case))
                print_case(found[subject][-1])
    print("\nCannot be stated\n")
    for missing in CANNOT:
        print(f"        {missing.name}: {missing.idea}\n        {missing.source}")
    every = [each for own in found.values() for each in own]
    print(f"\n{sum(each.right for each in every)} of {len(every)} cases are right")
    if write:
        PAGE.write_text(page(found), encoding="utf-8")
    return every


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="without the cases that take seconds")
    parser.add_argument("--write", action="store_true", help="write the tables of the page; not in the quick mode")
    arguments = parser.parse_args()
    if arguments.quick and arguments.write:
        parser.error("--write needs all cases: leave out --quick")
    sys.exit(0 if all(each.right for each in main(arguments.quick, arguments.write)) else 1)
