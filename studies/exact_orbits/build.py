"""Fill in the answers of the cases: python studies/exact_orbits/build.py [NAME ...] [--prove]

A case's file states its equations, written by hand. This program adds the unknowns, the events, twenty states and the
numbers, computed with 56 digits. It also writes the motion as CSV, and the table of the page. Errors are bounds: the
difference from a computation with 66 digits plus the rounding of what is written. `check.py` checks the result by
another method, to the digits of doubles.
"""

import argparse
import csv
import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from decimal import ROUND_DOWN, Context, Decimal
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from flint import arb

from studies.exact_orbits.motion import Motion, Problem
from studies.exact_orbits.series import CaseError, Number, Options, State, read
from studies.exact_orbits.toolkit import proved

CASES = Path(__file__).parent / "cases"
PAGE = Path(__file__).parent / "README.md"
DIGITS = (56, 66)  # of the two computations
SAMPLES, LONG, SHORT = 20, 40, 20  # samples, digits of the unknowns, digits of all else
WIDEST = 180  # characters of a line that has a whole sample
ORDER = (
    *("format", "name", "title", "subject", "text", "license", "source", "units", "parameters", "formulas", "modes"),
    *(
        "orbit",
        "start",
        "end",
        "conserved",
        "closed_form",
        "proved",
        "unknowns",
        "numbers",
        "events",
        "samples",
        "error",
    ),
)


def solved(document: Mapping[str, Any], options: Options) -> tuple[Problem, Motion]:
    """A case with its unknowns, and its motion."""
    problem = Problem(document, options)
    problem.solve()
    return problem, problem.motion()


def sample_times(start: str, end: float) -> list[str]:
    """Twenty evenly spaced times after the start, in few decimals, the last at or just before the end."""
    step = Context(prec=4, rounding=ROUND_DOWN).divide(Decimal(repr(end)) - Decimal(start), SAMPLES)
    return [f"{(Decimal(start) + i * step).normalize():f}" for i in range(1, SAMPLES + 1)]


def digits(x: arb, count: int = SHORT) -> Number:
    """A number of a file, with some digits; far below the last of them it is 0."""
    text = "0" if abs(float(x)) < 10.0 ** (-10 - count) else x.mid().str(count, radius=False)
    mantissa, *exponent = text.split("e")
    mantissa = mantissa.rstrip("0") if "." in mantissa else f"{mantissa}."
    return Number("e".join([f"{mantissa}0" if mantissa.endswith(".") else mantissa, *exponent]))


def bound(pairs: Iterable[tuple[arb, arb]], count: int = SHORT) -> Number:
    """A bound on the errors of numbers that were computed twice and are written with some digits, rounded up."""
    error = max((float(abs(a - b)) + 10.0 ** (1 - count) * float(abs(a)) for a, b in pairs), default=0.0)
    return Number(f"{1.1 * error + 10.0 ** (-10 - count):.1e}")


def together(a: State, b: State) -> Iterator[tuple[arb, arb]]:
    """The numbers of two dictionaries in pairs."""
    return ((a[name], b[name]) for name in a)


def written(state: State) -> dict[str, Number]:
    """States as a file has them."""
    return {name: digits(x) for name, x in state.items()}


def filled(document: dict[str, Any]) -> dict[str, Any]:
    """The document of a case with its answers."""
    document = {name: each for name, each in document.items() if name != "unknowns"}
    (problem, motion), (finer, fine) = (solved(document, Options(digits=n)) for n in DIGITS)
    if [(e.name, e.mode) for e in motion.events] != [(e.name, e.mode) for e in fine.events]:
        raise CaseError(f"{document['name']}: the events differ between {DIGITS[0]} and {DIGITS[1]} digits")
    unknowns = {
        name: {"value": digits(x, LONG), "error": bound([(x, finer.unknowns[name])], LONG)}
        for name, x in problem.unknowns.items()
    }
    events = [
        {
            **{"event": a.name, "time": digits(a.time), "time_error": bound([(a.time, b.time)]), "mode": a.mode},
            **{"before": written(a.before), "after": written(a.after)},
            "error": bound([*together(a.before, b.before), *together(a.after, b.after)]),
        }
        for a, b in zip(motion.events, fine.events, strict=True)
    ]
    times = sample_times(document["start"]["time"], float(problem.value(document["end"])))
    both = [(time, motion.at(arb(time)), fine.at(arb(time))) for time in times]
    values, finer_values = problem.numbers(motion), finer.numbers(fine)
    numbers = {
        name: stated | {"value": digits(values[name]), "error": bound([(values[name], finer_values[name])])}
        for name, stated in document.get("numbers", {}).items()
    }
    answers = {
        **{"unknowns": unknowns, "numbers": numbers, "events": events},
        "samples": [{"time": Number(time), "mode": mode, "state": written(state)} for time, (mode, state), _ in both],
        "error": bound([pair for _, (_, a), (_, b) in both for pair in together(a, b)]),
    }
    found = document | answers
    return {name: found[name] for name in ORDER if name in found}


def text_of(value: Any, indent: int = 0) -> str:
    """A document as JSON: what fits into a line is on one, and numbers have all their digits."""
    if isinstance(value, Mapping):
        ends, parts = "{}", [f"{json.dumps(key)}: {text_of(each, indent + 2)}" for key, each in value.items()]
    elif isinstance(value, list):
        ends, parts = "[]", [text_of(each, indent + 2) for each in value]
    elif isinstance(value, Number):
        return value
    else:
        return json.dumps(value, ensure_ascii=False)
    line = f"{ends[0]}{', '.join(parts)}{ends[1]}"
    if len(line) + indent <= WIDEST and "\n" not in line and indent:
        return line
    space = " " * (indent + 2)
    return ends[0] + ",".join(f"\n{space}{part}" for part in parts) + f"\n{' ' * indent}{ends[1]}"


def write_table(path: Path, document: Mapping[str, Any]) -> None:
    """The motion as CSV: the start, the samples, and both sides of each event, in the order of time."""
    names = list(dict.fromkeys(name for mode in document["modes"].values() for name in mode["states"]))
    start = Problem(document).start()
    rows = [(document["start"]["time"], start.mode, "", written(start.state))]
    rows += [(each["time"], each["mode"], "", each["state"]) for each in document["samples"]]
    mode = document["start"]["mode"]
    for each in document["events"]:
        rows += [(each["time"], mode, f"before {each['event']}", each["before"])]
        mode = each["mode"]
        rows += [(each["time"], mode, f"after {each['event']}", each["after"])]
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["time", "mode", "event", *names])
        for time, mode, event, state in sorted(rows, key=lambda row: Decimal(row[0])):
            table.writerow([time, mode, event, *(state.get(name, "") for name in names)])


def with_table(page: str) -> str:
    """The text of the page with a row for each case, between its two marks."""
    rows = ["| case | subject | what moves | events | known |", "|---|---|---|---:|---|"]
    documents = [json.loads(path.read_text(encoding="utf-8")) for path in CASES.glob("*.json")]
    for case in sorted(documents, key=lambda case: (case["subject"], case["name"])):
        known = ", ".join(
            word for word, has in (("proof", case["proved"]), ("closed form", case["closed_form"])) if has
        )
        link = f"[{case['name']}](cases/{case['name']}.json)"
        rows.append(f"| {link} | {case['subject']} | {case['title']} | {len(case['events'])} | {known} |")
    head, begin, rest = page.partition("<!-- the cases -->\n")
    _, end, tail = rest.partition("\n<!-- their end -->")
    return "".join([head, begin, "\n", *(f"{row}\n" for row in rows), end, tail])


def main(names: list[str], prove: bool) -> None:
    """Fill in the named cases, or all; or only what is proved of them, where a proof that is not found is an error."""
    for path in [CASES / f"{name}.json" for name in names] or sorted(CASES.glob("*.json")):
        document = read(path)
        if prove and (statements := proved(path.stem)) is not None:
            document["proved"] = statements
        if not prove:
            document = filled(document)
        path.write_text(f"{text_of(document)}\n", encoding="utf-8")
        write_table(path.with_suffix(".csv"), document)
        print(f"{document['name']}: {len(document['events'])} events, error {document['error']}")
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", help="of cases; all by default")
    parser.add_argument("--prove", action="store_true", help="fill in only what the toolkit proves of cases")
    arguments = parser.parse_args()
    main(arguments.names, arguments.prove)
