"""False claims of ten kinds for the prover, which `theorems` runs. Each is known to be false without the prover: by
its construction, or by integrating with SciPy the one equation of a hop of two masses under constant gravity.

With the force F of the extension r, masses m1 and m2 and gravity g, the foot leaves where F(r) = m2 g, while the body
rises with the launch speed alpha. Then r'' = -F(r) (1/m1 + 1/m2), r' = alpha at first, and the masses' centre comes to
its top at T = m1 alpha/((m1 + m2) g): the hop is lossless where r' = 0 at T."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from orbits import InputError, Mechanism, NoOrbit, Orbit, Proof, find, prove
from orbits.exact import Claim
from orbits.io import write_json
from orbits.laws import Law, Written
from orbits.mechanics import Mass, Spring
from orbits.proof import prove_claims
from problems import Hopper, hopper_in_si
from problems.laws import springs

Force = Callable[[np.ndarray], np.ndarray]
# By the integration here a hop counts as lossless where the last rate is below this share of the first one.
LOSSLESS = 1e-8
# The digits of proofs that distinguish two numerals, and a limit in seconds that is meant to suffice for each proof.
DIGITS, SECONDS = 30, 600.0
# The verdicts. A claim whose proof runs out of time counts neither as proved nor as refused.
PROVED, REFUSED, OUT_OF_TIME = "proved", "refused", "out of time"
KINDS = (
    "hostile numerals", "cancelling sums", "exponents near whole numbers", "dropped terms", "domains", "pieces", "SI",
    "moved", "edited files", "tables",
)  # fmt: skip


@dataclass(frozen=True)
class FalseClaim:
    """A false claim in words, and the attempt to prove it, whose verdict should be `REFUSED`."""

    kind: str
    what: str
    verdict: Callable[[], str]


@dataclass(frozen=True)
class TwoMasses:
    """The force, the two masses and the gravity of the equation above."""

    force: Force
    upper: float = 1.0
    lower: float = 1.0
    gravity: float = 1.0

    @classmethod
    def hopper(cls, force: Force) -> "TwoMasses":
        """The numbers of a dimensionless `Hopper`, whose equation does not depend on the ratio of its masses."""
        return cls(force, 2.0, 2.0, 0.5)

    def flight(self, alpha: float, liftoff: float) -> np.ndarray:
        """The extension and its rate (2, n) at the steps of half a flight."""
        end = self.upper * alpha / ((self.upper + self.lower) * self.gravity)
        mobility = 1 / self.upper + 1 / self.lower

        def rates(t: float, x: np.ndarray) -> list[float]:
            return [x[1], -float(self.force(x[0])) * mobility]

        with np.errstate(all="ignore"):
            return solve_ivp(rates, (0, end), [liftoff, alpha], "DOP853", rtol=1e-12, atol=1e-13 * alpha).y

    def liftoff(self, near: float) -> float:
        """The extension at which the force is the lower mass's weight, near a positive one."""
        off = lambda r: float(self.force(r)) - self.lower * self.gravity  # noqa: E731
        return brentq(off, near / 8, 8 * near, xtol=1e-15, rtol=1e-14)

    def loss(self, alpha: float, near: float) -> float:
        """The last rate over the first one: 0 for a lossless hop; infinite where there is no lift-off or no flight."""
        try:
            flown = self.flight(alpha, self.liftoff(near))
        except ValueError:
            return np.inf
        return abs(flown[1, -1]) / alpha if np.isfinite(flown).all() else np.inf


def false_claims(count: int, seed: int = 20) -> Iterator[FalseClaim]:
    """False claims, the kinds in turn."""
    rng = np.random.default_rng(seed)
    for index in range(count):
        kind = KINDS[index % len(KINDS)]
        while (found := _MAKERS[kind](rng)) is None:
            continue
        yield found


def bare(orbit: Orbit, machine: object) -> Claim:
    """The numbers of an orbit as a claim about another machine, without the description that would give it away."""
    model = orbit.source.model
    unknowns = model.launch_at(orbit.flight(0.0)[: len(model.flight.states)].tolist())
    unknowns |= {"alpha": orbit.alpha, "duration": orbit.flight_time / 2}
    if orbit.contact_time is not None:
        unknowns["contact_duration"] = orbit.contact_time / 2
    return Claim(machine, orbit.alpha, orbit.error, orbit.family, orbit.violations, unknowns)


def verdict_of(proof: Proof) -> str:
    """The verdict of a proof on its claim."""
    late = any("raise the limit" in reason for reason in proof.reasons)
    return PROVED if proof.proved else OUT_OF_TIME if late else REFUSED


def _of_machine(orbit: Orbit, machine: object) -> str:
    """The verdict on the numbers of an orbit as a claim about another machine."""
    try:
        return verdict_of(prove_claims([bare(orbit, machine)], motion=False, limit=SECONDS)[0])
    except InputError:
        return REFUSED


def _of_other(kind: str, rng: np.random.Generator, own: object, other: object, truth: TwoMasses) -> FalseClaim | None:
    """The claim that the hop of a machine is one of another, whose equation is `truth`; None where that is so."""
    try:
        orbit = find(own, int(rng.integers(1, 3)))
    except NoOrbit:
        return None
    if truth.loss(orbit.alpha, orbit.liftoff_extension) < LOSSLESS:
        return None
    return FalseClaim(kind, f"{own!r} said of {other!r}", partial(_of_machine, orbit, other))


def _two_masses(body: str, foot: str, force: str, gravity: str = "1", **parameters: float) -> Mechanism:
    elements = [Mass("body", body), Mass("foot", foot), Spring("body - foot", force)]
    return Mechanism(("body", "foot"), elements, "foot", parameters, gravity="1", surface_gravity=gravity)


def _cubic(b: float, k: float = 1.0) -> Force:
    return lambda r: k * r + b * r**3


@lru_cache(maxsize=256)
def _enclosed(machine: str, text: str) -> tuple:
    """The proved digits of the machine of a text."""
    return prove(find(_LONG[machine](text)), DIGITS, motion=False, limit=SECONDS).alpha


@lru_cache(maxsize=256)
def _slope(machine: str, text: str) -> float:
    """The derivative of alpha by the number of a text, from the equation: minus that of the last rate by the number
    over that by alpha."""
    value, orbit, h = float(text), find(_LONG[machine](text)), 1e-4

    def last(x: float, alpha: float) -> float:
        truth = _LONG_TRUTHS[machine](x)
        return truth.flight(alpha, truth.liftoff(orbit.liftoff_extension))[1, -1]

    by_number = last(value + h, orbit.alpha) - last(value - h, orbit.alpha)
    return by_number / (last(value, orbit.alpha - h) - last(value, orbit.alpha + h))


def _as_rounded(machine: str, text: str, rounded: str) -> str:
    """The verdict on the claim that a numeral may be rounded: refused where the enclosures of alpha are disjoint."""
    proof = prove(find(_LONG[machine](text)), DIGITS, motion=False, limit=SECONDS)
    if proof.alpha is None or not proof.proved:
        return verdict_of(proof)
    other = _enclosed(machine, rounded)
    ways = (proof.alpha, other), (other, proof.alpha)
    return REFUSED if any(Decimal(a.high) < Decimal(b.low) for a, b in ways) else PROVED


# Machines of one numeral, and their equations.
_LONG: dict[str, Callable[[str], object]] = {
    "cubic": lambda x: Hopper(f"r + {x}*r**3"),
    "stiffness": lambda x: Hopper(f"{x}*r + 0.3*r**3"),
    "argument": lambda x: Hopper(f"sinh(0.5*r)/{x}"),
    "foot": lambda x: _two_masses("1", x, "r + 0.2*r**3"),
    "gravity": lambda x: _two_masses("1", "1", "r + 0.2*r**3", x),
    "extension": lambda x: Mechanism(
        ("body", "foot"), [Mass("body", 1), Mass("foot", 1), Spring(f"{x}*(body - foot)", "r + 0.3*r**3")], "foot"
    ),
    "exponent": lambda x: Hopper(f"((1 + r/9)**{x} - 1)*4.5 + 0.3*r**3"),
}
_LONG_TRUTHS: dict[str, Callable[[float], TwoMasses]] = {
    "cubic": lambda x: TwoMasses.hopper(_cubic(x)),
    "stiffness": lambda x: TwoMasses.hopper(_cubic(0.3, x)),
    "argument": lambda x: TwoMasses.hopper(lambda r: np.sinh(0.5 * r) / x),
    "foot": lambda x: TwoMasses(_cubic(0.2), 1.0, x),
    "gravity": lambda x: TwoMasses(_cubic(0.2), gravity=x),
    "extension": lambda x: TwoMasses(lambda r: x * _cubic(0.3)(x * r)),
    "exponent": lambda x: TwoMasses.hopper(lambda r: ((1 + r / 9) ** x - 1) * 4.5 + 0.3 * r**3),
}


def _long_numeral(kind: str, rng: np.random.Generator, machine: str, rounded: str) -> FalseClaim | None:
    """The claim that a numeral of many digits may be rounded."""
    off = Decimal(int(rng.integers(1, 10))) * Decimal(10) ** -int(rng.integers(18, 25))
    text = f"{Decimal(rounded) + int(rng.choice([-1, 1])) * off:f}"
    width = Decimal(_enclosed(machine, rounded).width)
    if abs(Decimal(_slope(machine, rounded))) * off < 100 * width:
        return None
    return FalseClaim(kind, f"{machine} {text} as {rounded}", partial(_as_rounded, machine, text, rounded))


def _numerals(rng: np.random.Generator) -> FalseClaim | None:
    machine = str(rng.choice([name for name in _LONG if name != "exponent"]))
    return _long_numeral(KINDS[0], rng, machine, str(rng.choice(["0.25", "0.3", "0.4", "0.5"] if machine == "cubic"
                                                                else ["0.5", "0.8", "1", "1.2"])))  # fmt: skip


def _sums(rng: np.random.Generator) -> FalseClaim | None:
    """Sums that cancel to another number in doubles than in exact arithmetic."""
    large, small = 10 ** int(rng.integers(16, 26)), Decimal(int(rng.integers(1, 1000))) / 100
    rounded = float(large) + float(small) - float(large)
    text = f"({float(large):.0e} + {small} - {float(large):.0e})".replace("e+", "e")
    if rng.random() < 0.3:
        scale = Decimal(int(rng.integers(1, 9))) * 10**16
        text, small, rounded = f"(0.1 + 0.2 - 0.3)*{scale}", Decimal(0), (0.1 + 0.2 - 0.3) * float(scale)
    exact, place = float(small), int(rng.integers(3))
    if place == 0:
        return _of_other(KINDS[1], rng, Hopper(f"r + {rounded!r}*r**3"), Hopper(f"r + {text}*r**3"),
                         TwoMasses.hopper(_cubic(exact)))  # fmt: skip
    if place == 1:
        own, other = (_two_masses("1", f"1 + {x}", "r") for x in (repr(rounded), text))
        return _of_other(KINDS[1], rng, own, other, TwoMasses(_cubic(0.0), 1.0, 1 + exact))
    own, other = (_two_masses("1", "1", "r + 0.1*r**3", f"1 + {x}") for x in (repr(rounded), text))
    return _of_other(KINDS[1], rng, own, other, TwoMasses(_cubic(0.1), gravity=1 + exact))


def _exponents(rng: np.random.Generator) -> FalseClaim | None:
    """Powers whose exponent is near a whole number, which have no value below 0."""
    if rng.random() < 0.4:
        return _long_numeral(KINDS[2], rng, "exponent", str(rng.choice(["2", "3"])))
    b, whole = round(rng.uniform(0.05, 0.5), 3), int(rng.choice([3, 5]))
    off = f"{whole}.{'0' * int(rng.integers(14, 24))}{rng.integers(1, 10)}"
    orbit = find(Hopper(f"r + {b}*r**{whole}"))
    flown = TwoMasses.hopper(lambda r: r + b * r**whole).flight(orbit.alpha, orbit.liftoff_extension)
    assert flown[0].min() < -0.1
    other = Hopper(f"r + {b}*r**{off}")
    return FalseClaim(KINDS[2], f"a hop with r**{off} below r = 0", partial(_of_machine, orbit, other))


def _dropped(rng: np.random.Generator) -> FalseClaim | None:
    """Terms with a tiny factor, which may not be dropped because their parameter is large."""
    share, large = round(rng.uniform(0.01, 2), 3), 10.0 ** int(rng.integers(12, 22))
    term, c, place = f"c/{large:.0e}".replace("e+", "e"), share * large, int(rng.integers(4))
    texts = ["1", "1", "r + 0.1*r**3", "1"]
    texts[place] = {2: f"(1 + {term})*r + 0.1*r**3"}.get(place, f"1 + {term}")
    if rng.random() < 0.2:
        texts[place], share = texts[place].replace(term, f"{term}*(2 - 1)"), share
    force = _cubic(0.1, 1 + share) if place == 2 else _cubic(0.1)
    upper, lower, gravity = (1 + share if place == i else 1.0 for i in (0, 1, 3))
    own = _two_masses("1", "1", "r + 0.1*r**3")
    return _of_other(KINDS[3], rng, own, _two_masses(*texts, c=c), TwoMasses(force, upper, lower, gravity))


# Laws with a place a that equal r wherever they have a value, and whether they have none at an extension.
_HOLES: tuple[tuple[str, Callable[[np.ndarray, float], np.ndarray]], ...] = (
    ("r*((r - {a})/(r - {a}))", lambda r, a: np.diff(np.sign(r - a)) != 0),
    ("r + 0/(r - {a})", lambda r, a: np.diff(np.sign(r - a)) != 0),
    ("(r - {a})**2*(r - {a})**(-1) + {a}", lambda r, a: np.diff(np.sign(r - a)) != 0),
    ("sqrt(r - {a})**2 + {a}", lambda r, a: r < a),
    ("sqrt(r - {a})*sqrt(r - {a}) + {a}", lambda r, a: r < a),
    ("(r - {a})**0.5*(r - {a})**0.5 + {a}", lambda r, a: r < a),
    ("exp(log(r - {a})) + {a}", lambda r, a: r < a),
    ("r*log(r - {a})**0", lambda r, a: r < a),
    ("r + 0*log1p(r - {a} - 1)", lambda r, a: r < a),
    ("r + 0*acosh(r - {a} + 1)", lambda r, a: r < a),
    ("r + 0*asin({a}/2 - r + 1)", lambda r, a: r < a / 2),
    ("r*(r - {a})**(1e-30 - 1e-30 + 0.5 - 0.5)*(r - {a})**0.5/(r - {a})**0.5", lambda r, a: r < a),
)


def _domains(rng: np.random.Generator) -> FalseClaim | None:
    """Laws that simplify to one with values everywhere, but have none at some places of the hop."""
    b, (text, missing) = round(rng.uniform(0.0, 0.4), 3), _HOLES[rng.integers(len(_HOLES))]
    orbit = find(Hopper(f"r + {b}*r**3"))
    r = TwoMasses.hopper(_cubic(b)).flight(orbit.alpha, orbit.liftoff_extension)[0]
    place = round(float(rng.uniform(0.9 * r.min(), 0.9 * r.max())), 3)
    if not missing(r, place).any():
        return None
    law = f"{text.format(a=f'({place})')} + {b}*r**3"
    return FalseClaim(KINDS[4], f"a hop of {law}", partial(_with_hole, orbit, law))


def _with_hole(orbit: Orbit, law: str) -> str:
    try:
        return _of_machine(orbit, Hopper(law))
    except InputError:
        return REFUSED


def _written(pieces: tuple[str, ...], gap: float) -> Law:
    """A law in two pieces, of which the engine computes only the first."""
    table = (1, lambda p: ([-9e9, p["gap"], 9e9], [[0.0], [0.0]]))
    return Law("two pieces", "r", lambda x, p, q: x, {"gap": gap}, table, Written(pieces, ("gap",)))


def _pieces(rng: np.random.Generator) -> FalseClaim | None:
    """Laws whose pieces do not meet, and other stiffnesses and gaps than a hop's."""
    gap, ratio = round(rng.uniform(0.2, 1.5), 3), round(rng.uniform(1.5, 6), 3)
    share = 1 + float(rng.choice([-1, 1])) * 10 ** rng.uniform(-6, -1)
    if rng.random() < 0.4:
        jump = float(f"{rng.choice([-1, 1]) * 10 ** rng.uniform(-6, -1):.3e}")
        law = _written(("r", f"r + ({jump!r})"), gap)
        truth = TwoMasses.hopper(lambda r: np.where(r < gap, r, r + jump))
        return _of_other(KINDS[5], rng, Hopper("r"), Hopper(law), truth)
    stops, moved = bool(rng.random() < 0.5), bool(rng.random() < 0.5)
    own = {"gap": gap, "stop" if stops else "ratio": ratio}
    name = "gap" if moved else "stop" if stops else "ratio"
    other = {**own, name: own[name] * share}
    g, k = other.values()
    beyond = (lambda r: r + (k - 1) * (np.maximum(r - g, 0) + np.minimum(r + g, 0))) if stops else (
        lambda r: r + (k - 1) * np.maximum(r - g, 0)
    )  # fmt: skip
    kind = "end_stops" if stops else "bilinear"
    return _of_other(KINDS[5], rng, Hopper(kind, parameters=own), Hopper(kind, parameters=other),
                     TwoMasses.hopper(beyond))  # fmt: skip


def _in_si(rng: np.random.Generator) -> FalseClaim | None:
    """Hops in SI with units, masses or gravity mistaken."""
    ranges = {"m1": (1, 80), "m2": (0.1, 5), "k": (1e3, 1e4), "b": (0, 1e6), "g": (9.80665, 9.80665)}
    numbers = {name: round(rng.uniform(*ends), 5) for name, ends in ranges.items()}
    wrong = dict(numbers)
    match int(rng.integers(5)):
        case 0:
            wrong["g"] = float(rng.choice([9.81, 9.8, 9.80665 / 6, 32.174]))
        case 1:
            wrong["m1"], wrong["m2"] = numbers["m2"], numbers["m1"]
        case 2:
            wrong["k"] *= float(rng.choice([1e-3, 9.80665, 0.4535924, 1 / 0.0254]))
        case 3:
            wrong["b"] *= float(rng.choice([1e-3, 1e-6, 1.1]))
        case _:
            name = str(rng.choice(list(numbers)))
            wrong[name] *= 1 + float(rng.choice([-1, 1])) * 10 ** rng.uniform(-6, -2)
    own, other = (
        hopper_in_si(x["m1"], x["m2"], force="k*r + b*r**3", parameters={"k": x["k"], "b": x["b"]},
                     surface_gravity=x["g"])
        for x in (wrong, numbers)
    )  # fmt: skip
    truth = TwoMasses(_cubic(numbers["b"], numbers["k"]), numbers["m1"], numbers["m2"], numbers["g"])
    return _of_other(KINDS[6], rng, own, other, truth)


def _hop(rng: np.random.Generator) -> Orbit:
    """A hop to move or edit, of a hopper or in SI."""
    b = round(rng.uniform(0.05, 0.5), 3)
    if rng.random() < 0.2:
        return find(hopper_in_si(3.0, 2.0, force="k*r + b*r**3", parameters={"k": 500.0, "b": 1e4 * b}))
    ratio = float(rng.choice([0.5, 1.0, 3.0]))
    return find(Hopper("r + beta*r**3", mass_ratio=ratio, rest_length=9.0, parameters={"beta": b}))


def _of_orbit(orbit: Orbit, machine: object) -> str:
    try:
        return verdict_of(prove(orbit, machine=machine, limit=SECONDS))
    except InputError:
        return REFUSED


def _moved(rng: np.random.Generator) -> FalseClaim:
    """Launch speeds, times, extensions and families changed by a small share, or by a whole number."""
    orbit = _hop(rng)
    share = 1 + float(rng.choice([-1, 1])) * 10 ** rng.uniform(-9, -2)
    name = str(rng.choice(["alpha", "flight_time", "contact_time", "liftoff_extension", "family"]))
    if name == "family":
        certificate = replace(orbit.certificate, family=orbit.family + int(rng.choice([-1, 1, 2])))
        other = replace(orbit, certificate=certificate)
    else:
        other = replace(orbit, **{name: getattr(orbit, name) * share})
    return FalseClaim(KINDS[7], f"{name} moved by {share - 1:.1e}", partial(_of_orbit, other, orbit.source))


def _scaled_number(value: float | None, rng: np.random.Generator) -> float | None:
    return None if value is None else value * (1 + float(rng.choice([-1, 1])) * 10 ** rng.uniform(-5, 0))


# The entries that are edited in a file, and their new values.
_EDITED: dict[str, Callable] = {
    **dict.fromkeys(("alpha", "flight_time", "contact_time", "liftoff_extension", "loss_coefficient"), _scaled_number),
    **dict.fromkeys(("largest_contact_force", "landing_jerk", "smallest_separation"), _scaled_number),
    **dict.fromkeys(("mass_ratio", "rest_length", "body_mass", "surface_gravity", "unit_time"), _scaled_number),
    "family": lambda value, rng: value + int(rng.choice([-1, 1])),
    "spring": lambda value, rng: str(rng.choice(["r", "r + beta*r**5", "sinh(r)"])),
    "gravity": lambda value, rng: "1 + z",
    "admissible": lambda value, rng: not value,
    "violations": lambda value, rng: ["foot below ground"],
    "stable_side": lambda value, rng: "below",
    "bounce_side": lambda value, rng: "above" if value == "below" else "below",
    "clearance": lambda value, rng: 0.5,
    "parameters": lambda value, rng: {name: number * 1.001 for name, number in value.items()},
    "rises": lambda value, rng: {name: number * 1.01 for name, number in value.items()},
    "state_mid_flight": lambda value, rng: [number * 1.001 for number in value],
}


def _edited(rng: np.random.Generator) -> FalseClaim | None:
    """Files of orbits with one entry changed, whose digest is that of the changed content."""
    orbit, name = _hop(rng), str(rng.choice(list(_EDITED)))
    document = orbit.saved()
    new = _EDITED[name](document[name], rng) if name in document else None
    if new is None or new == document[name]:
        return None
    return FalseClaim(KINDS[8], f"a file with {name} = {new}", partial(_of_file, document | {name: new}, orbit))


def _of_file(document: dict, orbit: Orbit) -> str:
    with TemporaryDirectory() as folder:
        path = write_json(document, Path(folder) / "orbit.json", "orbit")
        try:
            return _of_orbit(Orbit.load(path), orbit.source)
        except InputError:
            return REFUSED


def _tables(rng: np.random.Generator) -> FalseClaim | None:
    """Hops of a table as those of one with another row, another scale, or rows that do not reach as far."""
    r = np.sort(np.r_[-7.0, 7.0, rng.uniform(-6.9, 6.9, int(rng.integers(3, 9)))]).round(3)
    force = (r + rng.uniform(0, 0.2) * r**3).round(4)
    share, row, way = 1 + float(rng.choice([-1, 1])) * 10 ** rng.uniform(-6, -1), rng.integers(len(r)), rng.random()
    if np.diff(r).min() < 0.05:
        return None
    moved, changed, scale = r.copy(), force.copy(), None
    if way < 0.2:
        scale = "s"
    elif way < 0.5:
        moved[row] *= share
    elif way < 0.8:
        changed[row] *= share
    else:
        reach = rng.uniform(0.3, 1.0, 2)
        near = (r >= -7 * reach[0]) & (r <= 7 * reach[1])
        moved, changed = r[near], force[near]
    if len(moved) < 4 or not (np.diff(moved) > 0).all():
        return None
    own, other = (springs.table(rows, noise=0, scale=s) for rows, s in (((r, force), None), ((moved, changed), scale)))
    other = other.with_parameters(s=share) if scale else other
    low, high = other.range()
    truth = TwoMasses.hopper(lambda x: other(x) if low <= x <= high else np.nan)
    return _of_other(KINDS[9], rng, Hopper(own), Hopper(other), truth)


_MAKERS: dict[str, Callable[[np.random.Generator], FalseClaim | None]] = dict(
    zip(
        KINDS,
        (_numerals, _sums, _exponents, _dropped, _domains, _pieces, _in_si, _moved, _edited, _tables),
        strict=True,
    )
)
