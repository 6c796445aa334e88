"""Do the two programs that prove orbits agree? The second verifies 200 proofs of the first, of different machines.
Each theorem is then falsified in one place, and both have to refuse it. The second one also has to refuse a true file
whose statement has another digit, and one with a number of JSON, which readers take as the nearest double.

The machines are hoppers with springs of all laws, in SI and under gravity that varies, jugglers, hoppers with an
inerter or with a knee, and chains; some proofs are of higher families, of intervals of parameters, of many digits, or
of existence alone. The first program meets the falsehood in the numbers of the orbit, the second in the saved file.
Run: python studies/checked_proofs.py [--count N] [--first N] [--quick]
"""

import argparse
import json
import time
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import replace
from decimal import Decimal
from typing import Any

import numpy as np

from orbits import NoOrbit, Orbit, OrbitsError, find, find_all, prove
from orbits.check_proof import check
from orbits.check_statement import statement_of
from problems import Chain, Hopper, Juggler, hopper_in_si, inerter_hopper, knee_hopper
from problems.laws import springs

# Seconds that no proof here comes to, also on a busy machine.
LIMIT = 600.0
# Laws of springs with the range of their parameter.
LAWS = {
    "r + p*r**3": (0.02, 0.8),
    "r + p*r**5": (0.005, 0.1),
    "r + p*r**2": (0.005, 0.05),
    "tanh(p*r)/p": (0.05, 0.2),
    "sinh(p*r)/p": (0.1, 0.7),
    "atan(p*r)/p": (0.05, 0.15),
    "asinh(p*r)/p": (0.05, 0.3),
    "r/sqrt(1 + p*r**2)": (0.002, 0.01),
    "(1 - exp(-p*r))/p": (0.05, 0.2),
    "log1p(p*r)/p": (0.01, 0.05),
    "sin(p*r)/p": (0.02, 0.08),
    "r*(1 + p*r**2)**1.5": (0.01, 0.1),
}
GRAVITIES = {"1/(1 + z/q)**2": (40.0, 200.0), "exp(-z/q)": (80.0, 300.0), "1 - z/q": (100.0, 400.0)}


def machines(rng: np.random.Generator) -> Iterator[tuple[Any, int, dict[str, Any]]]:
    """Machines without end, each with the number of a family and the options of its proof."""
    between = rng.uniform
    number = 0
    while True:
        number += 1
        law = list(LAWS)[number % len(LAWS)]
        p = round(between(*LAWS[law]), 4)
        mass = round(between(0.4, 3.0), 3)
        plain = Hopper(law, mass_ratio=mass, rest_length=20.0, parameters={"p": p})
        match number % 10:
            case 0:
                yield Hopper("r", mass_ratio=mass, rest_length=40.0), 1 + number // 10 % 3, {}
            case 1 | 2:
                yield plain, 1, {"motion": number % 4 != 1}
            case 3:
                gravity = list(GRAVITIES)[number // 10 % len(GRAVITIES)]
                parameters = {"p": p, "q": round(between(*GRAVITIES[gravity]), 1)}
                yield Hopper(law, gravity, mass, 20.0, parameters=parameters), 1, {}
            case 4:
                yield Juggler(law, mass_ratio=mass, parameters={"p": p}), 1, {}
            case 5:
                k, body, foot = (round(between(*ends), 2) for ends in ((4000, 12000), (40, 90), (2, 6)))
                cubed = round(between(0, 3e6))
                yield hopper_in_si(body, foot, force=f"{k}*r + {cubed}*r**3", rest_length=1.0), 1, {}
            case 6:
                yield inerter_hopper(inertance=round(between(0.05, 0.6), 3), foot_mass=mass), 1, {}
            case 7:
                wide = {"p": (f"{p}", f"{p + 1e-6:.7f}")}
                yield plain, 1, {"parameters": wide}
            case 8:
                yield plain, 1, {"digits": int(between(20, 40))}
            case _:
                yield special(number // 10, rng), 1, {}


def special(number: int, rng: np.random.Generator) -> Any:
    """A machine of three masses, of curved coordinates, with a potential, or with an inerter."""
    a, b = (round(rng.uniform(0.9, 1.1), 3) for _ in range(2))
    match number % 4:
        case 0:
            return Chain([1, a, b])
        case 1:
            return knee_hopper(stiffness=round(float(rng.uniform(550.0, 650.0)), 1))
        case 2:
            return Hopper(
                springs.potential("r**2/2 + p*r**4", p=round(float(rng.uniform(0.0, 0.1)), 3)), rest_length=20.0
            )
        case _:
            return inerter_hopper(f"r + {round(rng.uniform(0.0, 0.3), 3)}*r**3", inertance=a / 5)


def orbit_of(machine: Any, family: int) -> Orbit:
    """An orbit of a machine; of the orbits of a chain the slowest that is a motion."""
    if not isinstance(machine, Chain):
        return find(machine, family)
    motions = [orbit for orbit in find_all(machine, machine.starts(5, 5)) if orbit.admissible]
    if not motions:
        raise NoOrbit("none of its orbits is a motion")
    return motions[0]


def changed(document: dict[str, Any], path: tuple, change: Callable[[Any], Any]) -> None:
    """Change one entry of a document."""
    for key in path[:-1]:
        document = document[key]
    document[path[-1]] = change(document[path[-1]])


def shifted(by: str) -> Callable[[list[str]], list[str]]:
    """The change that moves an interval by a multiple of the sum of its bounds' sizes."""
    return lambda pair: [
        str(Decimal(each) + Decimal(by) * (abs(Decimal(pair[0])) + abs(Decimal(pair[1])))) for each in pair
    ]


def falsehoods(orbit: Orbit, document: dict[str, Any]) -> list[tuple[str, Orbit, tuple[tuple, ...], Callable]]:
    """False theorems: the quantity, an orbit with a false one, the entries of the file to change, and their change."""
    alphas, certificate = (("parts", 0, "unknowns", "alpha"), ("enclosures", "alpha")), orbit.certificate
    found = [("alpha", replace(orbit, alpha=orbit.alpha * (1 + 1e-3)), alphas, shifted("5e-4"))]
    if not document["motion"]:
        return found
    family = replace(orbit, certificate=replace(certificate, family=certificate.family + 1))
    found.append(("family", family, (("family",),), lambda family: family + 1))
    longer = replace(orbit, contact_time=orbit.contact_time * (1 + 1e-2))
    times = ("parts", 0, "unknowns", "contact_time"), ("enclosures", "contact_time")
    found.append(("contact time", longer, times, shifted("5e-3")))
    if orbit.liftoff_extension:  # a juggler's is 0
        extended = replace(orbit, liftoff_extension=orbit.liftoff_extension * (1 + 1e-2))
        found.append(("extension", extended, (("enclosures", "liftoff_extension"),), shifted("5e-3")))
    return found


def miswritten(document: dict[str, Any], number: int) -> list[dict[str, Any]]:
    """The file of a theorem with another digit in its statement, and with the double nearest to a decimal of it."""
    statement, as_double = document["statement"], deepcopy(document)
    places = [place for place, letter in enumerate(statement) if letter.isdigit()]
    place = places[7 * number % len(places)]
    digit = str((int(statement[place]) + 1) % 10)
    changed(as_double, ("parts", 0, "unknowns", "alpha"), lambda pair: [float(pair[0]), pair[1]])
    return [document | {"statement": statement[:place] + digit + statement[place + 1 :]}, as_double]


def verdicts(machine: Any, family: int, how: dict[str, Any], number: int) -> dict[str, Any]:
    """Whether the proof of a machine's orbit is verified, and whether each program refuses a false theorem of it."""
    orbit = orbit_of(machine, family)
    began = time.process_time()
    proof = prove(orbit, **how, limit=LIMIT)
    proved = time.process_time()
    document = json.loads(json.dumps(proof.document()))
    reasons = [*proof.reasons, *(check(document) if proof.proved else [])]
    done = time.process_time()
    choices = falsehoods(orbit, document)
    what, liar, paths, change = choices[(number + number // 10) % len(choices)]
    false = deepcopy(document)
    for path in paths:
        changed(false, path, change)
    false |= {"statement": statement_of(false)}
    return {
        "machine": repr(machine),
        "verified": not reasons,
        "reasons": reasons,
        "false": what,
        "first_refuses": not prove(liar, **how, limit=LIMIT).proved,
        "second_refuses": bool(check(false)),
        "miswritten_refused": all(map(check, miswritten(document, number))),
        "seconds": (proved - began, done - proved),
    }


def main(quick: bool = False, count: int = 200, first: int = 0) -> dict[str, int]:
    """How many proofs are verified, how many false theorems both programs refuse, and how many miswritten files."""
    drawn, found, number = machines(np.random.default_rng(0)), list[dict[str, Any]](), 0
    while len(found) < (2 if quick else count):
        machine, family, how = next(drawn)
        number += 1
        if number <= first:
            continue
        try:
            each = verdicts(machine, family, how, number)
        except OrbitsError as error:
            print(f"{number}: {machine!r} has no orbit to prove: {error}", flush=True)
            continue
        found.append(each)
        words = "verified" if each["verified"] else f"NOT VERIFIED: {each['reasons']}"
        refused = [f"{program} refuses" for program in ("first", "second") if each[f"{program}_refuses"]]
        seconds = ", ".join(f"{each:.1f}" for each in each["seconds"])
        print(f"{number}: {words} ({seconds} s); false {each['false']}: {', '.join(refused)}; {machine!r}", flush=True)
    names = "verified", "first_refuses", "second_refuses", "miswritten_refused"
    totals = {name: sum(each[name] for each in found) for name in names}
    print(f"of {len(found)} proofs {totals}")
    return {"count": len(found), **totals}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of machines to skip")
    parser.add_argument("--quick", action="store_true")
    main(**vars(parser.parse_args()))
