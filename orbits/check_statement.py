"""The form of a saved proof, and the statement that follows from its data, for the program that verifies it.

A number is text of decimal digits, never a number of JSON, which readers take as the nearest double. `check_form`
checks that a file has the verified fields, each of its type, and no more. `statement_of` writes the theorem in words
from the data alone. This text is verified, and the file's `statement` must equal it.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain, count
from math import inf
from time import process_time
from typing import Any, NamedTuple

# Seconds of processor time in which a file is verified, or refused, unless another limit is stated.
LIMIT = 600.0


# Why a saved theorem of a kind that earlier versions proved is neither loaded nor verified.
ALL_HOPS = (
    "the file has a theorem about all hops of a period, by prove_all_hops, which was removed: take the version that "
    "wrote it, or prove the hops one by one by prove_fixed_point"
)


class Unverified(Exception):
    """What cannot be verified, in words."""


class OutOfTime(Exception):
    """The limit of processor time is reached before a file is verified or refused."""


_until: ContextVar[float] = ContextVar("until", default=inf)


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Limit the processor time in the block, in which `heed` raises `OutOfTime` from then on."""
    token = _until.set(process_time() + seconds)
    try:
        yield
    finally:
        _until.reset(token)


def heed() -> None:
    """Raise `OutOfTime` where the limit of processor time is reached."""
    if process_time() > _until.get():
        raise OutOfTime("the limit of processor time is reached before the file is verified or refused")


class CheckOptions(NamedTuple):
    """The orders, steps and precision with which a saved theorem is verified, and the sizes up to which it is."""

    decimal_length: int = 4000  # characters of a number
    exponent: int = 2000  # of a number
    formula_length: int = 2000  # characters
    name_length: int = 80  # characters of a name in a statement
    order_per_bit: float = 0.3  # of Taylor polynomials
    derived_order: int = 14  # of Taylor polynomials for derivatives
    splits: int = 3  # halvings of intervals of parameters
    first: Fraction = Fraction(1, 8)  # step as a share of half a phase
    shortest: Fraction = Fraction(1, 2**14)  # step as a share of half a phase
    power: int = 2**16  # largest whole exponent
    guard_bits: int = 40  # beyond those of the enclosures, since motions amplify roundings
    bits_of_uniqueness: int = 90  # with which uniqueness is shown, at least
    bits: int = 2000  # of the enclosures, at most
    bits_of_numbers: int = 10**5  # of a number in a formula, at most
    names: int = 60  # in polynomials that are compared
    terms: int = 3000  # of polynomials that are compared
    images: int = 4  # of Krawczyk's operator on the box of uniqueness
    # Degrees in time of the motions' derivatives in images after that of `derived_order`: those of the map need more.
    higher_degrees: tuple[int, ...] = (28, 42, 56)


CHECKS = CheckOptions()
DECIMAL = re.compile(r"-?(?:\d+\.?\d*|\.\d+)(?:[eE]([+-]?\d+))?", re.ASCII)


def decimal(text: object) -> Fraction:
    """The exact value of a decimal; raises `Unverified` for anything else, and for one that is too long."""
    match = DECIMAL.fullmatch(text) if isinstance(text, str) and len(text) <= CHECKS.decimal_length else None
    if match is None or abs(int(match[1] or 0)) > CHECKS.exponent:
        raise Unverified(f"{text!r:.50} is not a text of decimal digits, or of too many")
    return Fraction(match[0])


# Shapes of values. A type stands for its values, `decimal` for decimals, and `object` for anything; a list for lists of
# its one shape, a tuple for lists of these, or with None first for None too; a mapping with the key `str` for mappings
# of names, and another one for its own names, where "?" marks names that may be missing.
PAIR, SIZED = (decimal, decimal), (str, str)
SPRING = {"extension": str, "force": [str], "breaks": [str], "potential": bool, "rows?": [(decimal,) * 4]}
MACHINE = {
    **dict.fromkeys(("name", "units", "surface_gravity", "gravity", "gap", "launch", "counts", "eliminated"), str),
    "coordinates": [str], "parameters": {str: PAIR}, "masses": [SIZED], "weights": [SIZED], "inerters": [SIZED],
    "inertia": [[str]], "springs": [SPRING], "potentials": [str], "separation": (None, str),
}  # fmt: skip
MAPS, PHASES = ("reversor", "symmetry", "gaps"), ("flight_time", "contact_time")
Bounds = Mapping[str, tuple[Fraction, Fraction]]
OF_ORBIT = {
    **MACHINE, **{f"{name}?": [SIZED] for name in (*MAPS, "heights", "places")}, "sticks?": [str], "tuned?": [str],
    "prescribed?": [(str, decimal)], "centre?": str, "friction?": str, "restitution?": decimal, "grazes?": bool,
}  # fmt: skip
OF_RETURNS = {**{name: each for name, each in MACHINE.items() if name != "eliminated"}, "injection": (None, PAIR)}
RETURNS = "fixed point", "periodic hops", "period doubling"  # the kinds of theorems about hops that come back
PART = {"parameters": {str: PAIR}, "unknowns": {str: PAIR}, "uniqueness_radius": decimal}
DOCUMENT = {
    **dict.fromkeys(("format", "kind", "statement"), str), "proved": bool, "motion": bool, "parts": [PART],
    "enclosures": {str: PAIR}, "conditions": {str: str}, "family": (None, int), "radius": (None, decimal),
    **dict.fromkeys(("about", "digits", "seconds", "digest?", "alpha", "flight_time", "contact_time"), object),
    **dict.fromkeys(("units", "parameters", "uniqueness_radius", "bounce_side", "attraction_radius"), object),
    "reasons": object,
}  # fmt: skip


def check_document(document: Any) -> None:
    """See that a document has the fields that are verified, and no more; raises `Unverified`."""
    kind, said = (document.get(name) if isinstance(document, dict) else None for name in ("kind", "enclosures"))
    if kind == "all hops":
        raise Unverified(ALL_HOPS)
    again = {f"{name}?": object for name in said} if isinstance(said, dict) else {}
    check_form(document, again | DOCUMENT | {"machine": OF_RETURNS if kind in RETURNS else OF_ORBIT}, "the file")
    names = {name.rstrip("?") for name in DOCUMENT}
    if more := [name for name in document["machine"].get("tuned", ()) if name in document and name not in names]:
        raise Unverified(f"the file says more than this program verifies, or less: '{more[0]:.40}' of the file")


def check_form(value: Any, shape: Any, name: str) -> None:
    """See that a value, which has this name, has a shape; raises `Unverified`."""
    if shape is decimal:
        decimal(value)
    elif isinstance(shape, tuple) and shape[0] is None:
        if value is not None:
            check_form(value, shape[1], name)
    elif isinstance(shape, list | tuple) and isinstance(value, list):
        shapes = shape * len(value) if isinstance(shape, list) else shape
        if len(shapes) != len(value):
            raise Unverified(f"{name} has {len(value)} entries instead of {len(shapes)}")
        for i, pair in enumerate(zip(value, shapes, strict=True)):
            check_form(*pair, f"{name}, {i + 1}")
    elif isinstance(shape, dict) and isinstance(value, dict):
        known = dict.fromkeys(value, shape[str]) if str in shape else {n.rstrip("?"): each for n, each in shape.items()}
        missing = [each for each in shape if each is not str and each.rstrip("?") == each and each not in value]
        if beside := [*missing, *(each for each in value if each not in known)]:
            raise Unverified(f"the file says more than this program verifies, or less: '{beside[0]!s:.40}' of {name}")
        for each in value:
            check_form(value[each], known[each], f"{each!s:.40} of {name}")
    elif not (shape is object or type(value) is shape):
        raise Unverified(f"{name} is not of the type that this program reads: {value!r:.40}")


def check_printed(document: Mapping[str, Any]) -> None:
    """See that the statement that is printed in a file is that of its data; raises `Unverified`."""
    said, true = document["statement"], statement_of(document)
    if said != true:
        pairs = enumerate(zip(said, true, strict=False))
        k = next((k for k, (a, b) in pairs if a != b), min(len(said), len(true)))
        here = [f"'{text[max(k - 30, 0) : k + 40]}'" for text in (said, true)]
        raise Unverified(f"the printed statement has {here[0]}, where the data of the file say {here[1]}")


def statement_of(document: Mapping[str, Any]) -> str:
    """The theorem of a saved proof in words, as its data say it."""
    words = _returns(document) if document["kind"] in RETURNS else _orbit(document)
    return f"{_machine(document['machine'])} {words}"


def bounds_of(pairs: Mapping[str, Any]) -> Bounds:
    """The exact bounds of intervals by name."""
    found = {name: (decimal(low), decimal(high)) for name, (low, high) in pairs.items()}
    if any(low > high for low, high in found.values()):
        raise Unverified("an interval has its bounds in the wrong order")
    return found


def within(inner: Bounds, outer: Bounds) -> bool:
    """Whether intervals lie in others of the same names."""
    return all(outer[name][0] <= low and high <= outer[name][1] for name, (low, high) in inner.items())


def _label(name: str) -> str:
    """A name in a statement that nothing depends on; raises `Unverified` for one that might be read as a sentence."""
    if not re.fullmatch(rf"[\w '()#/.+-]{{1,{CHECKS.name_length}}}", name) or ". " in name:
        raise Unverified(f"the name {name!r:.50} might be read as a part of the statement")
    return name


def _words(name: str) -> str:
    return name.replace("_", " ")


def _interval(low: str, high: str) -> str:
    return f"[{low}, {high}]"


def _spring(spring: Mapping[str, Any]) -> str:
    if len(spring["force"]) != len(spring["breaks"]) + 1 or (spring.get("rows") and spring["breaks"]):
        raise Unverified("a spring's force has more or fewer formulas than pieces")
    along, (force, *others), breaks = f"along r = {spring['extension']}", spring["force"], spring["breaks"]
    if rows := spring.get("rows"):
        scale = "f" if force == "1" else f"({force})*f"
        each = "; ".join(f"({', '.join(row)})" for row in rows)
        between = "where f is, from each of these extensions r to the next, the polynomial of degree 5 with the value"
        return f"a spring with the force {scale} {along}, {between}, slope and curvature in (r, f, f', f''): {each}"
    if spring["potential"]:
        return f"a spring with the energy {force} {along}"
    if not breaks:
        return f"a spring with the force {force} {along}"
    pieces = [f"{force} below {breaks[0]}", *(f"{f} from r = {low} on" for f, low in zip(others, breaks, strict=True))]
    return f"a spring with the force {', '.join(pieces)}, {along}"


def _names(m: Mapping[str, Any]) -> set[str]:
    """The names in the formulas of a machine."""
    texts = [*m["potentials"], *(m[name] for name in ("surface_gravity", "gravity", "gap", "counts"))]
    texts += [m["separation"] or "", m.get("friction", ""), *chain(*m["masses"], *m["weights"], *m["inerters"])]
    kinds = *MAPS, "heights", "places"
    texts += [*chain(*m["inertia"]), *(formula for kind in kinds for _, formula in m.get(kind, ()))]
    texts += [text for spring in m["springs"] for text in (spring["extension"], *spring["force"], *spring["breaks"])]
    return {*re.findall(r"(?<![\w.])[A-Za-z_]\w*", " ".join(texts), re.ASCII)}


def _machine(m: Mapping[str, Any]) -> str:
    """The machine in words; raises `Unverified` for a parameter that is in no formula, about which nothing is
    proved."""
    if unused := [name for name in m["parameters"] if name not in _names(m)]:
        raise Unverified(f"no formula has the parameter '{unused[0]:.40}'")
    steps, sticks, prescribed = any(m.get(kind) for kind in MAPS), m.get("sticks", ()), m.get("prescribed", ())
    points = [_label(name) for name, _ in m.get("gaps", ())]
    parts = [f"the coordinates {', '.join(m['coordinates'])}"]
    parts += [f"a mass {mass} at the height {height}" for height, mass in m["masses"]]
    parts += [f"the weight of a mass {mass} at the height {height}" for height, mass in m["weights"]]
    parts += [f"an inerter {mass} along {extension}" for extension, mass in m["inerters"]]
    parts += [f"the inertia [{'; '.join(', '.join(row) for row in m['inertia'])}]"] if m["inertia"] else []
    parts += [*map(_spring, m["springs"]), *(f"the potential energy {each}" for each in m["potentials"])]
    parts += [f"the acceleration of gravity ({m['surface_gravity']})*({m['gravity']}) at the height z"]
    e = m.get("restitution", "0")
    how = "lands plastically" if decimal(e) == 0 else f"lands with the restitution {e}: its rate v becomes -{e}*v"
    lands = [f"the gap {gap} of the {name}" for (_, gap), name in zip(m.get("gaps", ())[1:], points[1:], strict=True)]
    opens = f" of the {(points or ['point that opens'])[0]}, which opens" if steps else f", which {how}"
    parts += [f"the gap {m['gap']}{opens}"]
    parts += [f"{(lands or ['its image under R'])[0]}, which {how}"] if steps else []
    at = {x: f"rests in contact, held by a force of the ground on the point that opens, at the place {place}"
          for x, place in m.get("places", ())}  # fmt: skip
    parts += [f"the coordinate {x}, which sticks: it {at.get(x, 'is 0 in contact, held by a force of the ground')}"
              for x in sticks]  # fmt: skip
    parts += [f"the height {height} of the {_label(name)}" for name, height in m.get("heights", ())]
    parts += [f"the coefficient of friction {m['friction']}"] if "friction" in m else []
    parts += [f"the place {m['centre']} of the centre of the masses along the ground"] if at and "centre" in m else []
    parts += [f"the separation {m['separation']}"] if m["separation"] is not None else []
    numbers = [f"{name} = {low}" if low == high else f"{name} in {_interval(low, high)}"
               for name, (low, high) in sorted(m["parameters"].items())]  # fmt: skip
    numbers += [f"{name} to be found" for name in m.get("tuned", ())]
    units = {"SI": "in SI", "dimensionless": "dimensionless"}.get(m["units"])
    if units is None:
        raise Unverified("the units are neither SI nor dimensionless")
    given = f", with {', '.join(numbers)}" if numbers else ""
    called = f"{m['launch']} and its rate at lift-off are called liftoff and alpha"
    turns = f"{m['counts']} is stationary between lift-off and mid-flight as often as the number of its family says"
    return (
        f"Let the {_label(m['name'])} have {'; '.join(parts)}{given}; all is {units}. "
        f"{_maps(m, sticks) if steps else ''}{called}; {turns}{_defined(m, prescribed)}."
    )


def _defined(m: Mapping[str, Any], prescribed: Sequence[tuple[str, str]]) -> str:
    """The definitions of the quantities that are prescribed, except for alpha, the step and the times."""
    cycle = "the sum of the flight time and the contact time"
    meanings = {
        "speed": f"the rate of {m.get('centre')} at lift-off", "liftoff_extension": f"{m['counts']} at lift-off",
        "period": cycle, "frequency": f"1 over {cycle}", "mean_speed": f"step over {cycle}",
    }  # fmt: skip
    return "".join(f"; {_words(name)} is {meanings[name]}" for name, _ in prescribed if name in meanings)


def _maps(m: Mapping[str, Any], sticks: Sequence[str]) -> str:
    """What the maps of a machine that steps are, and how its orbits follow from them."""
    back, anew = (", ".join(f"{name} to {image}" for name, image in m.get(kind, ())) or "each coordinate to itself"
                  for kind in MAPS[:2])  # fmt: skip
    letters = chain(("x", "q", "X", "Q", "state"), map("state_{}".format, count()))
    x = next(each for each in letters if each not in {*m["coordinates"], *m["parameters"], *m.get("tuned", ())})
    forces = "the forces of the ground on the point that opens" if m.get("places") else "all forces of the ground"
    vanish = f", in which {forces} vanish," if sticks else ""
    return (
        f"Let R reverse time and take {back}, and let S take {anew}; coordinates without a formula stay. A lossless "
        f"orbit is launched in a state {x}{vanish} and lands in R {x}; its contact, whose coordinates are counted anew "
        f"by S, leads from S R {x} to {x}. "
    )


CONDITIONS = {
    "clearance": "the contact point is above what it lands on throughout the open flight",
    "separation": "the separation stays positive over the whole cycle",
    "contact_force": "the contact pushes throughout the open contact",
    "contact_end": "the contact comes to rest, and ends in a lift-off that is the mirror image of the landing",
    "heights": "each height, but for that of the contact point, stays positive over the whole cycle",
    "friction": "the force on what sticks is below the coefficient of friction times the contact force throughout the "
    "open contact, and so are their derivatives where both vanish, at its two ends",
}
CONDITIONS_OF_STEPS = CONDITIONS | {
    "clearance": "both gaps are open throughout the open flight, and the one that lands, if it is not the one that "
    "opens, throughout the contact",
    "contact_force": "each point that stands in contact pushes throughout the open contact",
    "contact_end": "the contact comes to its middle, and ends in a lift-off that is the image of the landing",
}
CONDITIONS_OF_STANCES = CONDITIONS_OF_STEPS | {
    "friction": "on each point the force along the ground is below the coefficient of friction times that across it "
    "throughout the open contact, and so are their derivatives where both vanish",
    "stance": "in flight the force of the ground across it, the sum of the weights and of the masses times the "
    "accelerations of their heights, is positive, and times the coefficient of friction above the size of that along "
    "it, the sum of the masses times the acceleration of their centre",
}
GRAZES = {
    "clearance": "the gap is open throughout the open flight except for its middle, where it vanishes to second order: "
    "there the point passes the ground tangentially and without a force",
}


def _orbit(document: Mapping[str, Any]) -> str:
    """What is said of an orbit: it exists, no other is nearby, and it is a motion."""
    m, parts, said = document["machine"], document["parts"], document["enclosures"]
    places = [each for name in m["coordinates"] for each in (name, f"{name}'")]
    order = ["liftoff", "alpha", *places, *m.get("tuned", ()), "flight_time", "contact_time"]
    if not parts or any(part["unknowns"].keys() != parts[0]["unknowns"].keys() for part in parts):
        raise Unverified("there is no part, or parts have different unknowns")
    if other := [name for name in parts[0]["unknowns"] if order.count(name) != 1]:
        raise Unverified(f"'{other[0]:.40}' is not an unknown of the equations of an orbit")
    unknowns = [(name, _hull([part["unknowns"][name] for part in parts]))
                for name in order if name in parts[0]["unknowns"]]  # fmt: skip
    enclosed = "; ".join(f"{_words(name)} in {pair}" for name, pair in unknowns)
    each = "each value of the parameters in their intervals"
    wide = any(decimal(low) != decimal(high) for low, high in m["parameters"].values())
    names = ", ".join(_words(name) for name, _ in unknowns)
    equations = f"equations of {'' if 'contact_time' in dict(unknowns) else 'the flight of '}a lossless orbit"
    first = f"For {each} the" if wide else "The"
    if tuned := [*map(_words, m.get("tuned", ()))]:
        exact = " and ".join(f"{_words(name)} = {value}" for name, value in m.get("prescribed", ()))
        there = f"are numbers {', '.join(tuned)}" if len(tuned) > 1 else f"is a number {tuned[0]}"
        first = f"{f'For {each} there' if wide else 'There'} {there} for which the"
        equations += f" with {exact}, exactly," if exact else ""
    radius = min((part["uniqueness_radius"] for part in parts), key=decimal)
    alone = f"No other solution has all of these ({names}) within {radius} of these enclosures"
    if len(parts) > 1:
        alone = (
            f"In each of {len(parts)} parts of the intervals no other solution has all unknowns within {radius} of the "
            f"enclosures that hold in that part"
        )
    motion = ""
    if document["motion"]:
        conditions = CONDITIONS_OF_STEPS if any(m.get(kind) for kind in MAPS) else CONDITIONS
        conditions = (CONDITIONS_OF_STANCES if m.get("places") else conditions) | (GRAZES if m.get("grazes") else {})
        words = [f"it is of family {document['family']}"]
        ends = [name for name in ("liftoff_extension", "mid_flight_extension") if name in said]
        words += [f"{_words(name)} in {_interval(*said[name])}" for name in ends]
        words += [text for name, text in conditions.items() if name in document["conditions"]]
        motion = f" It is a motion: {'; '.join(words)}."
    return f"{first} {equations} have a solution with {enclosed}. {alone}.{motion}"


def _hull(pairs: Sequence[Sequence[str]]) -> str:
    """The least interval that holds intervals."""
    lows, highs = zip(*pairs, strict=True)
    return _interval(min(lows, key=decimal), max(highs, key=decimal))


@dataclass(frozen=True)
class Word:
    """The arcs of hops that come back, by the names of their unknowns.

    hops : for each the launch speed, the times of the flights, each up to an impact, and the time of the contact
    """

    hops: tuple[tuple[str, tuple[str, ...], str], ...]

    @classmethod
    def of(cls, impacts: Sequence[int]) -> "Word":
        """The word of hops with these numbers of impacts."""
        hops = list[tuple[str, tuple[str, ...], str]]()
        for i, impact in enumerate(impacts, 1):
            hop = f"_{i}" if len(impacts) > 1 else ""
            times = tuple(f"flight_time{hop}_{j + 1}" for j in range(impact)) if impact > 1 else (f"flight_time{hop}",)
            hops.append((f"alpha_{i}" if i > 1 else "alpha", times, f"contact_time{hop}"))
        return cls(tuple(hops))

    @classmethod
    def of_names(cls, names: Sequence[str]) -> "Word":
        """The word that has these unknowns; raises `Unverified` where there is none."""
        period = sum(name.startswith("contact_time") for name in names)
        marks = [f"_{i + 1}" for i in range(period)] if period > 1 else [""]
        impacts = [sum(bool(re.fullmatch(rf"flight_time{mark}(_[0-9]+)?", name)) for name in names) for mark in marks]
        found = cls.of(impacts)
        if {*found.unknowns} != {*names} or len(names) < 4:
            raise Unverified(f"these are not the unknowns of hops that come back: {', '.join(names):.200}")
        return found

    @property
    def unknowns(self) -> list[str]:
        """The names of the unknowns in the order of the arcs."""
        return ["liftoff", *chain(*([launch, *times, stay] for launch, times, stay in self.hops))]


CONDITIONS_OF_RETURNS = {
    "clearance": "the gap is open throughout each open flight, and closes with a speed",
    "bounces": "after each landing but the last the contact would have to pull",
    "contact_force": "after the last landing the contact pushes until it lifts off",
    "liftoff": "the speed of the lift-off is positive",
    "least_period": "the first launch speed comes back after no smaller number of hops",
    "separation": "the separation stays positive throughout",
}


def word_of(document: Mapping[str, Any]) -> Word:
    """The word of the hops of a saved theorem; raises `Unverified` where its unknowns have none."""
    names = [*document["parts"][0]["unknowns"]] if len(document["parts"]) == 1 else []
    if document["kind"] != "period doubling":
        return Word.of_names(names)
    word = Word.of_names([name for name in names if name[0] != "d" and name != "inject"])
    if len(word.hops) > 1 or {*names} != {*unknowns_of_doubling(word)}:
        raise Unverified(f"these are not the unknowns of a period doubling: {', '.join(names):.200}")
    return word


def unknowns_of_doubling(word: Word) -> list[str]:
    """The unknowns of a hop, their derivatives by alpha, and the injection."""
    return [*word.unknowns, *(f"d{name}" for name in word.unknowns if name != "alpha"), "inject"]


MAP = (
    "A hop flies from a lift-off, with the launch speed alpha, until the gap closes, and lands plastically; where the "
    "contact would have to pull it leaves at once and flies on, else it stays until the contact force vanishes, and "
    "lifts off. The return map takes alpha to the speed there, with inject added to it."
)


def _returns(document: Mapping[str, Any]) -> str:
    """What is said of hops that come back: they exist, no others are nearby, they are hops, and whether they are
    stable; and of a period doubling."""
    word, m, said = word_of(document), document["machine"], document["enclosures"]
    part, doubled, period = document["parts"][0], document["kind"] == "period doubling", len(word.hops)
    if doubled != (m["injection"] is None) or (period > 1) != (document["kind"] == "periodic hops"):
        raise Unverified("the theorem is of another kind than its unknowns")
    low, high = m["injection"] or ("", "")
    inject = (
        "an unknown inject" if doubled else f"inject = {low}" if low == high else f"inject in {_interval(low, high)}"
    )
    pairs = [*m["parameters"].values(), *([m["injection"]] if m["injection"] else [])]
    wide = any(decimal(low) != decimal(high) for low, high in pairs)
    first, *more = (len(times) for _, times, _ in word.hops)
    hops, are = f"a hop of {first} impact{'s' * (first > 1)} that comes back", "It is a fixed point of the return map"
    if more:
        hops = f"{period} hops that come back, of {', '.join(map(str, (first, *more)))} impacts,"
        are = f"They are hops of the return map of the least period {period}"
    names = unknowns_of_doubling(word) if doubled else word.unknowns
    enclosed = "; ".join(f"{_words(name)} in {_interval(*part['unknowns'][name])}" for name in names)
    if doubled:
        hops, enclosed = f"{hops} with the multiplier -1", f"{enclosed}; a d before a name is the derivative by alpha"
    conditions = "; ".join(text for name, text in CONDITIONS_OF_RETURNS.items() if name in document["conditions"])
    return (
        f"{MAP} With {inject}: {'For each value in these intervals the' if wide else 'The'} equations of {hops} have a "
        f"solution with {enclosed}. No other solution has all of these ({', '.join(map(_words, names))}) within "
        f"{part['uniqueness_radius']} of these enclosures. {are}: {conditions}. "
        f"{_of_doubling(said) if doubled else _of_multiplier(said, period)}"
    )


def _of_multiplier(said: Mapping[str, Any], period: int) -> str:
    (low, high), of, are = said["multiplier"], "map", "fixed point is"
    if period > 1:
        of, are = f"map's iterate of {period} hops", "hops are"
    if not (stable := max(abs(decimal(low)), abs(decimal(high))) < 1) and decimal(low) <= 1 and decimal(high) >= -1:
        raise Unverified("the multiplier may be 1 or -1")
    how = "asymptotically stable" if stable else "unstable"
    return f"The multiplier, which is the derivative of the {of} there, is in {_interval(low, high)}: the {are} {how}."


def _of_doubling(said: Mapping[str, Any]) -> str:
    (rate, _), (cubic, _) = pairs = [said[name] for name in ("multiplier_rate", "cubic_coefficient")]
    if any(decimal(low) <= 0 <= decimal(high) for low, high in pairs):
        raise Unverified("the rate of the multiplier, or the coefficient of the cycles, may be 0")
    stable = decimal(cubic) > 0
    side = "above" if (decimal(rate) < 0) == stable else "below"
    return (
        f"Its multiplier is -1, and changes with inject at a rate in {_interval(*pairs[0])}. So it passes through -1 "
        f"there, and a cycle of two hops begins: for injections just {side} it is "
        f"{'stable' if stable else 'unstable'}, as half the square of the map's second derivative and a third of its "
        f"third derivative are together in {_interval(*pairs[1])}."
    )
