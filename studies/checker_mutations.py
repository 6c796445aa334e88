"""Does each of the two programs that prove orbits see a fault of the other? 40 faults chosen by hand, 20 in each.

In a copy of the sources one place of the first program (`orbits.proof`) or of the second (`orbits.check_proof`) is made
wrong or unsound: a sign, a dropped term, a remainder or a widening left out, a condition that is not looked at. A fault
of the first is caught where it proves what the second does not verify. A fault of the second is caught where its
verdict on a saved theorem is another one than before: it refuses what is proved, or verifies what is false. Where a
fault is right by luck in usual cases, guesses are made coarser besides, under which a sound program stays sound.
Run: python studies/checker_mutations.py [--only first|second] [--quick]
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
FIRST, SECOND = "orbits/proof", "orbits/check_proof.py"


# A module, a text in it, and what stands there instead.
Change = tuple[str, str, str]


@dataclass(frozen=True)
class Fault:
    """A place that is made wrong.

    cases : names of `proof_of` for the first program, and of `theorems` for the second, on which it is looked at
    coarser : a change that leaves the program sound, made with and without the fault
    """

    change: Change
    cases: Sequence[str]
    coarser: tuple[Change, ...] = ()


STEP, SET, ROOTS, SIGNS, FORMULAS, EQUATIONS, INTERVALS, CASE = (
    f"{FIRST}/{name}.py"
    for name in ("step", "enclosure", "root", "motion", "formulas", "equations", "intervals", "case")
)
# Longer steps, whose defects are what the enclosures are wide by.
LESS_EXACT = (SET, "order_for(bits), 2.0**-bits)", "order_for(bits), 2.0 ** (16 - bits))")
LONG = (
    (SET, "order_for(bits), 2.0**-bits)", "order_for(bits), 2.0 ** (30 - bits))"),
    (SET, "ORDER_PER_BIT = 0.36", "ORDER_PER_BIT = 0.2"),
    (STEP, "STIFFEST = 0.6", "STIFFEST = 2.0"),
)
# Boxes that are too small for the solutions of an interval are tried first.
SMALL = ((ROOTS, "ROOM = (1.5, ", "ROOM = (0.3, 1.5, "),)
# Polynomials of low order, whose remainders count.
LOW = ((SECOND, "MOST_SPLITS = 0.3, 14,", "MOST_SPLITS = 0.1, 8,"),)
OF_FIRST = [
    (STEP, "added = [(start + each).abs_upper()", "added = [start.abs_upper()", ["existence"], LONG),
    (STEP, "scale = h ** (order + 1) / (", "scale = h ** (order + 5) / (", ["existence"], LONG),
    (STEP, "return value + arb(0, radius.abs_upper())", "return value", ["existence"], LONG),
    (SET, "error + inverse * fresh", "error", ["inerter"], (LESS_EXACT,)),
    (SET, "_moved(end, whole * radii)", "list(end)", ["interval"]),
    (ROOTS, "return image if inside else None", "return image", ["interval"], SMALL),
    (ROOTS, "- rest) * unit)", "- rest) * unit * 2**19)", ["inerter"]),
    (ROOTS, "change -= by_parameters", "change -= 0 * by_parameters", ["interval"]),
    (EQUATIONS, "return [arb(1)] * len(self)", "return [arb(0.5)] * len(self)", ["interval"]),
    (SIGNS, "laws[-1:], self.passage.finish)", "laws[-1:], self.passage.end)", ["interval"]),
    (SIGNS, "laws[:1], self.passage.start)", "laws[:1], [x.mid() for x in self.passage.start])", ["interval"]),
    (SIGNS, "if self.value(each, 0, piece, times) > 0:", "if True:", ["overlap"]),
    (SIGNS, "turns, before, slope = 0,", "turns, before, slope = 1,", ["family"]),
    (FORMULAS, 'domains.need(f"a quotient in {shown}", right, positive=False)', "pass", ["quotient"]),
    (FORMULAS, '"sqrt": lambda x: (x,),', "", ["root"]),
    (FORMULAS, 'exact_fraction("a numeral", node[2])', "Fraction(float(node[2]))", ["decimal"]),
    (INTERVALS, "low = min((each.low", "low = max((each.low", ["parts"]),
    (INTERVALS, "found += deeper\n    return found", "found += deeper\n    return found[:1]", ["parts"]),
    (CASE, "contact.check_positive(force, zero_at_start=1)", "pass", ["pulling"]),
    (CASE, "balls.pop(CONTACT_DURATION, None)", "balls.pop(CONTACT_DURATION, None) * (1 + arb(2) ** -60)", ["inerter"]),
]
OF_SECOND = [
    ("arb_poly([*each, rest[order]])", "arb_poly(each)", ["inerter"], LOW),
    ("return new\n", "return rows\n", ["inerter"], LOW),
    ('check_positive("that the gap stays open in flight", flight, machine.gap, at_start=3)', "pass", ["digging"]),
    ('check_positive("that the contact pushes", contact, None, at_start=1)', "pass", ["pulling"]),
    ("coefficient(rate, k) / (k + 1)", "coefficient(rate, k) / (k + 2)", ["inerter"]),
    ("centre = rounded * (one + error) * seeds, ends", "centre = rounded * seeds, ends", ["unique"]),
    ("(transition * before) * (one + error) - one", "(transition * before) - one", ["inerter", "unique"]),
    ("box = moved(centre, slopes, reach)\n            self", "box = list(centre)\n            self", ["unique"]),
    ("1) - inverse * by_all", "1) + inverse * by_all", ["inerter"]),
    ("[-value for value, _ in equations]", "[arb(0) for _ in equations]", ["alpha"]),
    ("self.inside = all(", "self.inside = any(", ["unique"]),
    ("- more).union(ball(claims[name][1] + more))", ").union(ball(claims[name][1]))", ["unique"]),
    ("< solution.common[name] < ball(claims[name][1])", "< solution.common[name]", ["alpha"]),
    (" and all(at[each].is_finite() for each in self.needed)", "", ["quotient"]),
    ("if each > 0 or each < 0)", "if each.mid() != 0)", ["inerter", "overlap"]),
    ("sum(a != b for a, b in pairwise(rates))", "sum(a != b for a, b in pairwise(rates)) + 1", ["family"]),
    ('.replace("_", "?")))', "and repr(node.value)))", ["exponent"]),
    ("turning = [rate(p) - slope(energy, y)", "turning = [rate(p)", ["knee"]),
    ('"cos": "-sin(x)"', '"cos": "sin(x)"', ["knee"]),
    (
        "if not any(within(dict(zip(whole, edges, strict=True)), box) for box, *_ in parts)",
        "if not parts",
        ["uncovered"],
    ),
]
TRUE = ("inerter", "knee", "gravity", "interval")
FAULTS_OF_FIRST = [Fault(each[:3], *each[3:]) for each in OF_FIRST]
FAULTS_OF_SECOND = [Fault((SECOND, *each[:2]), *each[2:]) for each in OF_SECOND]


def proof_of(name: str) -> dict[str, Any]:
    """The document of what the first program says of a case."""
    from orbits import find, prove
    from problems import Hopper, inerter_hopper, knee_hopper

    def told(machine: Any, family: int = 1, said: int | None = None, **how: Any) -> Any:
        orbit = find(machine, family)
        certificate = replace(orbit.certificate, violations=(), family=said or family)
        return prove(replace(orbit, certificate=certificate), **how)

    proofs: dict[str, Callable[[], Any]] = {
        "inerter": lambda: told(inerter_hopper()),
        "knee": lambda: told(knee_hopper()),
        "gravity": lambda: told(Hopper("sinh(r)", "1/(1 + z/R)**2", rest_length=8.0, parameters={"R": 50.0})),
        "decimal": lambda: told(Hopper("r + 0.3*r**3", rest_length=8.0)),
        "interval": lambda: told(inerter_hopper(), parameters={"inertance": ("0.1999", "0.2001")}),
        "parts": lambda: told(inerter_hopper(), parameters={"inertance": ("0.198", "0.202")}),
        "existence": lambda: told(inerter_hopper(), motion=False),
        "digging": lambda: told(Hopper("r + 1.8*sin(5.7*r)", mass_ratio=2.0, rest_length=40.0)),
        "pulling": lambda: told(Hopper("r + 4.5*sin(2.2*r)", rest_length=40.0), 2),
        "fold": lambda: told(Hopper("r - 0.0106951*r**3", rest_length=30.0), motion=False),
        "overlap": lambda: told(Hopper("r", rest_length=4.603)),
        "family": lambda: told(inerter_hopper(), said=2),
        "quotient": lambda: told(Hopper("r + 0/(r - 0.5)", rest_length=20.0)),
        "root": lambda: told(Hopper("r + 0*sqrt(r + 1)", rest_length=20.0)),
    }
    return json.loads(json.dumps(proofs[name]().document()))


def repeated(document: dict[str, Any]) -> dict[str, Any]:
    """A changed document that says the same where it repeats itself."""
    parameters, parts = document["machine"]["parameters"], document["parts"]
    ranges = {name: {"low": low, "high": high} for name, (low, high) in document["enclosures"].items()}
    document |= {**ranges, "parameters": {name: {"low": low, "high": high} for name, (low, high) in parameters.items()}}
    return document | {"uniqueness_radius": parts[0]["uniqueness_radius"] if len(parts) == 1 else None, "reasons": []}


def theorems() -> dict[str, dict[str, Any]]:
    """Saved theorems by name; but for those in `TRUE` they are false. The unique one has another solution beside it."""
    found = {name: proof_of(name) for name in (*TRUE, "overlap", "digging", "pulling", "fold")}
    for name in ("overlap", "digging", "pulling"):
        assert "refuted" in found[name]["conditions"].values()
        found[name] |= {"proved": True, "conditions": dict.fromkeys(found[name]["conditions"], "proved")}
    found["unique"] = found.pop("fold")
    found["unique"]["parts"][0]["uniqueness_radius"] = "0.05"

    def falsified(name: str, change: Callable[[dict[str, Any]], Any]) -> None:
        found[name] = deepcopy(found["inerter"])
        change(found[name])

    def unknown(document: dict[str, Any]) -> None:
        low, high = (Decimal(each) for each in document["parts"][0]["unknowns"]["alpha"])
        pair = [str(low - 2 * (high - low)), str(low)]
        document["parts"][0]["unknowns"]["alpha"] = document["enclosures"]["alpha"] = pair
        document["radius"] = str(high - low)

    falsified("alpha", unknown)
    falsified("family", lambda document: document.update(family=2))
    for name, law in (("quotient", "r + 0/(r - 0.5)"), ("exponent", "r**1.0000000000000000000001")):
        falsified(name, lambda document, law=law: document["machine"]["springs"][0].update(force=[law]))
    found["uncovered"] = deepcopy(found["interval"])
    found["uncovered"]["machine"]["parameters"]["inertance"] = ["0.1998", "0.2001"]
    return {name: repeated(document) for name, document in found.items()}


class Copies:
    """A copy of the sources in which one place at a time is wrong."""

    def __init__(self, folder: Path):
        self.root = folder
        for name in ("orbits", "problems", "studies"):
            shutil.copytree(
                ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__", "pictures", "docs")
            )

    def answer(self, task: Mapping[str, Any], changes: Sequence[Change]) -> Any:
        """What a fresh interpreter answers to a task, with changes of the sources; None where it fails."""
        before = {module: (self.root / module).read_text(encoding="utf-8") for module, *_ in changes}
        own = {"PYTHONPATH": str(self.root), "PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "studies.checker_mutations", "--task", json.dumps(task)]
        try:
            for module, text, wrong in changes:
                now = (self.root / module).read_text(encoding="utf-8")
                assert now.count(text) == 1, f"{module}: {now.count(text)} times '{text}'"
                (self.root / module).write_text(now.replace(text, wrong), encoding="utf-8")
            run = subprocess.run(command, cwd=self.root, env={**os.environ, **own}, capture_output=True, text=True)
        finally:
            for module, text in before.items():
                (self.root / module).write_text(text, encoding="utf-8")
        return json.loads(run.stdout.splitlines()[-1]) if run.returncode == 0 else None


def answered(task: Mapping[str, Any]) -> Any:
    """The answer to a task: documents of cases, or the reasons why saved theorems are not verified."""
    if "prove" in task:
        return {name: proof_of(name) for name in task["prove"]}
    from orbits.check_proof import check

    documents = json.loads(Path(task["file"]).read_text(encoding="utf-8"))
    return {name: check(documents[name]) for name in task["check"]}


def of_first(copies: Copies, fault: Fault) -> str:
    """How a fault of the first program is caught by the second."""
    from orbits.check_proof import check

    if fault.coarser:
        sound = copies.answer({"prove": fault.cases}, fault.coarser)
        assert not any(check(document) for document in sound.values()), f"not proved and verified before {fault.change}"
    documents = copies.answer({"prove": fault.cases}, [*fault.coarser, fault.change])
    if documents is None:
        return "not caught: the first program fails by itself"
    for name, document in documents.items():
        if not document["proved"]:
            return f"not caught: the first program refuses {name} by itself: {document['reasons']}"
        if reasons := check(document):
            return f"caught: the second does not verify {name}: {reasons[0]}"
    return "not caught: what it proves is verified"


def of_second(copies: Copies, fault: Fault, file: Path) -> str:
    """How a fault of the second program is caught by theorems of which the first one knows whether they are true."""
    task = {"check": fault.cases, "file": str(file)}
    before, after = copies.answer(task, fault.coarser), copies.answer(task, [*fault.coarser, fault.change])
    if after is None:
        return "caught: the second program fails by itself"
    assert before is not None
    for name in fault.cases:
        if name in TRUE and after[name] and not before[name]:
            return f"caught: it refuses the true {name}: {after[name][0]}"
        if name not in TRUE and before[name] and not after[name]:
            return f"caught: it verifies the false {name}"
    return "not caught: its verdicts are the same"


def main(quick: bool = False, only: str | None = None) -> dict[str, int]:
    """How many faults of each program were tried and caught."""
    numbers = {}
    with tempfile.TemporaryDirectory() as folder:
        copies, file = Copies(Path(folder)), Path(folder) / "theorems.json"
        file.write_text(json.dumps(theorems()), encoding="utf-8")
        tried: dict[str, Sequence[Fault]] = {"first": FAULTS_OF_FIRST, "second": FAULTS_OF_SECOND}
        for program, faults in tried.items():
            if only in (None, program):
                faults = faults[7:8] if quick else faults
                found = []
                for fault in faults:
                    words = of_first(copies, fault) if program == "first" else of_second(copies, fault, file)
                    found.append(words.startswith("caught"))
                    module, text, wrong = fault.change
                    print(f"{module}: {text!r} -> {wrong!r}\n    {words}", flush=True)
                numbers |= {f"{program}_tried": len(found), f"{program}_caught": sum(found)}
    print(numbers)
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("first", "second"))
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--task", type=json.loads, help=argparse.SUPPRESS)
    options = vars(parser.parse_args())
    task = options.pop("task")
    if task:
        print(json.dumps(answered(task)))
    else:
        main(**options)
