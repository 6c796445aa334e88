"""Does each of the two programs that prove orbits see a fault of the other? 40 faults chosen by hand, 20 in each.

In a copy of the sources one place of the first program (`orbits.proof`) or of the second (`orbits.check_proof`) is made
wrong: a sign, a dropped term, a remainder or a widening left out, a condition that is not looked at. A fault of the
first is caught where it proves what the second does not verify. A fault of the second is caught where its verdict on
a saved theorem changes: it refuses what is true, or verifies what is false. Many a fault does not show at the usual
precision. Then a setting is changed besides, such as the order of polynomials or the length of steps: the program
without the fault is sound with any such setting, and its verdict is right, which the study sees first.
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
from functools import cache
from pathlib import Path
from typing import Any

from orbits.check_statement import statement_of

ROOT = Path(__file__).parent.parent
SECOND, STATEMENT, THEOREMS = "orbits/check_proof.py", "orbits/check_statement.py", "theorems.json"
TREES = "orbits/check_formulas.py"
# A limit that no proof here comes to, also on a busy machine.
SECONDS = 600.0

# A module, a text in it, and what stands there instead.
Change = tuple[str, str, str]


@dataclass(frozen=True)
class Fault:
    """A place that is made wrong.

    cases : on which it is tried, names of `proof_of` for the first program, and of `theorem` for the second
    settings : changes that leave the program sound, made with and without the fault
    """

    change: Change
    cases: Sequence[str]
    settings: tuple[Change, ...] = ()


STEP, SET, ROOTS, SIGNS, EQUATIONS, FORMULAS, INTERVALS, CONDITIONS, EXISTENCE = (
    *(f"orbits/balls/{name}.py" for name in ("rigorous_step", "enclosure", "root", "motion", "equations")),
    "orbits/exact/formulas.py",
    *(f"orbits/proof/{name}.py" for name in ("intervals", "proved_motion", "proved_existence")),
)
# Longer steps, whose defects make up the width of the enclosures.
LESS_EXACT = (SET, "order_for(bits), 2.0**-bits)", "order_for(bits), 2.0 ** (16 - bits))")
LONG = (
    (SET, "order_for(bits), 2.0**-bits)", "order_for(bits), 2.0 ** (30 - bits))"),
    (STEP, "order_per_bit: float = 0.36", "order_per_bit: float = 0.2"),
    (STEP, "stiffest: float = 0.6", "stiffest: float = 2.0"),
)
# Polynomials of low order, whose remainders count.
LOW = (
    (STATEMENT, "order_per_bit: float = 0.3", "order_per_bit: float = 0.1"),
    (STATEMENT, "derived_order: int = 14", "derived_order: int = 8"),
)
# Equal steps and a very short last one, which adds hardly any error to those of the steps before.
SHORT_LAST = ((STATEMENT, "first: Fraction = Fraction(1, 8)", "first: Fraction = Fraction(9999, 320000)"),
              (SECOND, "length * Fraction(5, 4)", "length"))  # fmt: skip
OF_FIRST = [
    (STEP, "added = [(start + each).abs_upper()", "added = [start.abs_upper()", ["existence"], LONG),
    (STEP, "scale = h ** (order + 1) / (", "scale = h ** (order + 5) / (", ["existence"], LONG),
    (STEP, "return value + arb(0, radius.abs_upper())", "return value", ["existence"], LONG),
    (SET, "error + inverse * fresh", "error", ["inerter"], (LESS_EXACT,)),
    (SET, "_moved(end, whole * radii)", "list(end)", ["interval"]),
    (ROOTS, "if root.unique_within([arb(1)] * len(centre)) > 0:", "if True:", ["parts"]),
    (ROOTS, "((radius - abs(", "((2 * radius - abs(", ["fold"]),
    (ROOTS, "change -= by_parameters", "change -= 0 * by_parameters", ["interval"]),
    (EQUATIONS, "return [arb(1)] * len(self)", "return [arb(0.5)] * len(self)", ["interval"]),
    (SIGNS, "laws[-1:], self.passage.finish)", "laws[-1:], self.passage.end)", ["interval"]),
    (SIGNS, "laws, self.passage.start)", "laws, [x.mid() for x in self.passage.start])", ["interval"]),
    (SIGNS, "if self.value(each, 0, piece, times) > 0:", "if True:", ["overlap"]),
    (SIGNS, "turns, before, slope = 0,", "turns, before, slope = 1,", ["family"]),
    (FORMULAS, 'domains.need(f"a quotient in {shown}", operands[1], positive=False)', "pass", ["quotient"]),
    (FORMULAS, '"sqrt": lambda x: (x,),', "", ["root"]),
    (
        FORMULAS,
        'partial(exact_fraction, "a numeral")',
        'lambda text: __import__("fractions").Fraction(float(text))',
        ["decimal"],
    ),
    (INTERVALS, "low = min((each.low", "low = max((each.low", ["parts"]),
    (INTERVALS, "    return found\n", "    return found[:1]\n", ["parts"]),
    (CONDITIONS, "contact.check_positive(force, zero_at_start=1)", "pass", ["pulling"]),
    (EXISTENCE, "= 2 * half_contact", "= arb(2 * float(half_contact))", ["inerter"]),
]
OF_SECOND = [
    ("arb_poly([*each, rest[order]])", "arb_poly(each)", ["above"], LOW),
    ("return new\n", "return rows\n", ["above"], LOW),
    (
        'check_positive("that the gap stays open in flight", flight, machine.gap, at_start=3, '
        "at_end=2 * machine.grazes)",
        "pass",
        ["digging"],
    ),
    ('check_positive("that the contact pushes", contact, force, at_start=1)', "pass", ["pulling"]),
    ("coefficient(rate, k) / (k + 1)", "coefficient(rate, k) / (k + 2)", ["inerter"]),
    ("rounded * seeds + frame * (error * seeds)", "rounded * seeds", ["unique"]),
    ("(whole - rounded) + (back * turned) * error", "(whole - rounded)", ["unique"], SHORT_LAST),
    (
        "error * seeds), reach)\n            left",
        "error * seeds), [arb(0)] * len(reach))\n            left",
        ["unique"],
    ),
    ("1) - inverse * by_all", "1) + inverse * by_all", ["inerter"]),
    ("[-value for value, _ in equations]", "[arb(0) for _ in equations]", ["above"]),
    ("self.inside = all(", "self.inside = any(", ["unique"]),
    ("- more).union(ball(claims[name][1] + more))", ").union(ball(claims[name][1]))", ["unique"]),
    ("ball(claims[name][0]) < solution.common[name]", "solution.common[name]", ["above"]),
    (" and all(at[each].is_finite() for each in field.needed)", "", ["quotient"]),
    ("if each > 0 or each < 0)", "if each.mid() != 0)", ["inerter", "overlap"]),
    ("sum(a != b for a, b in pairwise(rates))", "sum(a != b for a, b in pairwise(rates)) + 1", ["family"]),
    ("for y in names], rate(rate(place)))", "for y in names], ZERO)", ["knee"]),
    ("box in (whole, *(box for box, *_ in parts))", "box, *_ in parts", ["uncovered"]),
]
OF_TREES = [
    ("number(decimal(token))", "number(Fraction(float(token)))", ["exponent"]),
    ('"cos": "-sin(x)"', '"cos": "sin(x)"', ["knee"]),
]
FAULTS = {
    "first": [Fault(each[:3], *each[3:]) for each in OF_FIRST],
    "second": [
        Fault((path, *each[:2]), *each[2:]) for path, own in ((SECOND, OF_SECOND), (TREES, OF_TREES)) for each in own
    ],
}
TRUE = ("inerter", "knee", "interval")
# The false theorems that are a true one with a change, and the laws that are written into theirs.
FROM = dict.fromkeys(("above", "family", "quotient", "exponent"), "inerter") | {"uncovered": "interval"}
LAWS = {"quotient": "r + 0/(r - 0.5)", "exponent": "r**1.0000000000000000000001"}


@cache
def proof_of(name: str) -> dict[str, Any]:
    """The saved form of the first program's proof of a case."""
    from orbits import find, prove
    from problems import Hopper, inerter_hopper, knee_hopper

    def proof(machine: Any, family: int = 1, stated: int | None = None, **how: Any) -> Any:
        orbit = find(machine, family, limit=SECONDS)
        certificate = replace(orbit.certificate, violations=(), family=stated or family)
        return prove(replace(orbit, certificate=certificate), limit=SECONDS, **how)

    proofs: dict[str, Callable[[], Any]] = {
        "inerter": lambda: proof(inerter_hopper()),
        "knee": lambda: proof(knee_hopper()),
        "decimal": lambda: proof(Hopper("r + 0.3*r**3", rest_length=8.0)),
        "interval": lambda: proof(inerter_hopper(), parameters={"inertance": ("0.1999", "0.2001")}),
        "parts": lambda: proof(inerter_hopper(), parameters={"inertance": ("0.198", "0.202")}),
        "existence": lambda: proof(inerter_hopper(), motion=False),
        "digging": lambda: proof(Hopper("r + 1.8*sin(5.7*r)", mass_ratio=2.0, rest_length=40.0)),
        "pulling": lambda: proof(Hopper("r + 4.5*sin(2.2*r)", rest_length=40.0), 2),
        "fold": lambda: proof(Hopper("r - 0.010695212*r**3", rest_length=30.0), motion=False),
        "overlap": lambda: proof(Hopper("r", rest_length=4.603)),
        "family": lambda: proof(inerter_hopper(), stated=2),
        "quotient": lambda: proof(Hopper("r + 0/(r - 0.5)", rest_length=20.0)),
        "root": lambda: proof(Hopper("r + 0*sqrt(r + 1)", rest_length=20.0)),
    }
    return json.loads(json.dumps(proofs[name]().document()))


def repeated(document: dict[str, Any]) -> dict[str, Any]:
    """A changed document that is consistent where it repeats itself."""
    parameters, parts = document["machine"]["parameters"], document["parts"]
    ranges = {name: {"low": low, "high": high} for name, (low, high) in document["enclosures"].items()}
    document |= {**ranges, "parameters": {name: {"low": low, "high": high} for name, (low, high) in parameters.items()}}
    low, high = map(Decimal, document["enclosures"]["alpha"])
    unique = parts[0]["uniqueness_radius"] if len(parts) == 1 else None
    document |= {"radius": str(high - low), "uniqueness_radius": unique, "reasons": []}
    return document | {"statement": statement_of(document)}


def widened(document: Mapping[str, Any], by: Decimal) -> dict[str, Any]:
    """A saved theorem with wider enclosures, which are true of the same orbit."""
    wider = deepcopy(dict(document))
    for enclosures in (wider["parts"][0]["unknowns"], wider["enclosures"]):
        for name, (low, high) in enclosures.items():
            enclosures[name] = [str(Decimal(low) - by), str(Decimal(high) + by)]
    return wider


def not_unique() -> dict[str, Any]:
    """The false theorem that a hop near a fold is the only one within a radius, in which there is another one."""
    from orbits import find_all, prove
    from problems import Hopper

    orbit, other = find_all(Hopper("r - 0.0106952*r**3", rest_length=30.0), fastest=5.9, limit=SECONDS)
    proof, another = (prove(each, motion=False, limit=SECONDS) for each in (orbit, other))
    assert all((proof.proved, another.proved))
    document = widened(json.loads(json.dumps(proof.document())), Decimal("1e-12"))
    document["parts"][0]["uniqueness_radius"] = str(1.01 * (other.flight_time - orbit.flight_time))
    return document


def theorem(name: str) -> dict[str, Any]:
    """A saved theorem, which is false but for those of `TRUE`."""
    if name == "unique":
        return repeated(not_unique())
    found = deepcopy(proof_of(FROM.get(name, name)))
    if name in ("overlap", "digging", "pulling"):
        assert "refuted" in found["conditions"].values()
        found |= {"proved": True, "conditions": dict.fromkeys(found["conditions"], "proved")}
    elif name == "above":
        ends = found["enclosures"]["alpha"][1]
        found = widened(found, Decimal("1e-6"))
        for enclosures in (found["parts"][0]["unknowns"], found["enclosures"]):
            enclosures["alpha"][0] = ends  # where the true one ends
    elif name == "family":
        found["family"] = 2
    elif name in LAWS:
        found["machine"]["springs"][0]["force"] = [LAWS[name]]
    elif name == "uncovered":
        found["machine"]["parameters"]["inertance"] = ["0.1998", "0.2001"]
    return repeated(found)


def result(root: Path, task: Mapping[str, Any], changes: Sequence[Change]) -> Any:
    """The result of a task in a fresh interpreter, with changes of a copy of the sources; None where it fails."""
    before = {module: (root / module).read_text(encoding="utf-8") for module, *_ in changes}
    own = {"PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "studies.checker_mutations", "--task", json.dumps(task)]
    try:
        for module, text, wrong in changes:
            now = (root / module).read_text(encoding="utf-8")
            assert now.count(text) == 1, f"{module}: {now.count(text)} times '{text}'"
            (root / module).write_text(now.replace(text, wrong), encoding="utf-8")
        ended = subprocess.run(command, cwd=root, env={**os.environ, **own}, capture_output=True, text=True)
    finally:
        for module, text in before.items():
            (root / module).write_text(text, encoding="utf-8")
    return json.loads(ended.stdout.splitlines()[-1]) if ended.returncode == 0 else None


def run(task: Mapping[str, Any]) -> Any:
    """Proofs of cases in their saved form, or the reasons why saved theorems are not verified, by name."""
    if "prove" in task:
        return {name: proof_of(name) for name in task["prove"]}
    from orbits.check_proof import check

    documents = json.loads(Path(THEOREMS).read_text(encoding="utf-8"))
    return {name: check(documents[name]) for name in task["check"]}


def of_first(root: Path, fault: Fault) -> str:
    """How a fault of the first program is caught by the second."""
    from orbits.check_proof import check

    task = {"prove": fault.cases}
    before, after = result(root, task, fault.settings), result(root, task, [*fault.settings, fault.change])
    assert not any(each["proved"] and check(each) for each in before.values()), f"not verified before {fault.change}"
    if after is None:
        return "not caught: the first program fails"
    for name, document in after.items():
        if not document["proved"]:
            return f"not caught: the first program refuses {name}: {document['reasons']}"
        if reasons := check(document):
            return f"caught: the second does not verify {name}: {reasons[0]}"
    return "not caught: what it proves is verified"


def of_second(root: Path, fault: Fault) -> str:
    """How a fault of the second program is caught by saved theorems, whose truth the first one knows."""
    task = {"check": fault.cases}
    before, after = result(root, task, fault.settings), result(root, task, [*fault.settings, fault.change])
    assert all((not before[name]) == (name in TRUE) for name in fault.cases), f"a wrong verdict before {fault.change}"
    if after is None:
        return "not caught: the second program fails"
    for name in fault.cases:
        if name in TRUE and after[name]:
            return f"caught: it refuses the true {name}: {after[name][0]}"
        if name not in TRUE and not after[name]:
            return f"caught: it verifies the false {name}"
    return "not caught: its verdicts are the same"


def main(quick: bool = False, only: str | None = None) -> dict[str, int]:
    """How many faults of each program were tried and caught."""
    numbers = {}
    with tempfile.TemporaryDirectory() as folder:
        root, left_out = Path(folder), shutil.ignore_patterns("__pycache__", "pictures", "docs")
        for name in ("orbits", "problems", "studies"):
            shutil.copytree(ROOT / name, root / name, ignore=left_out)
        faults = {only: FAULTS[only]} if only else dict(FAULTS)
        if quick:
            faults = {program: each[15:16] for program, each in faults.items()}
        needed = {name for fault in faults.get("second", ()) for name in fault.cases}
        (root / THEOREMS).write_text(json.dumps({name: theorem(name) for name in sorted(needed)}), encoding="utf-8")
        for program, each in faults.items():
            found = []
            for fault in each:
                words = (of_first if program == "first" else of_second)(root, fault)
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
    print(json.dumps(run(task))) if task else main(**options)
