"""A proof as a frozen result that prints and saves itself."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..check_statement import ALL_HOPS
from ..errors import InputError
from ..exact import Enclosure
from ..io import Document
from ..result import Result, Row
from ..tables import text_table, wrapped


@dataclass(frozen=True)
class Part:
    """A box of parameters with the enclosures of the unknowns of the equations there.

    parameters, unknowns : enclosures by name
    uniqueness_radius : no other solution has all unknowns within it of their enclosures
    """

    parameters: Mapping[str, Enclosure]
    unknowns: Mapping[str, Enclosure]
    uniqueness_radius: str

    def document(self) -> Document:
        """The part for JSON."""
        boxes = {"parameters": self.parameters, "unknowns": self.unknowns}
        named = {name: {key: [each.low, each.high] for key, each in box.items()} for name, box in boxes.items()}
        return {**named, "uniqueness_radius": self.uniqueness_radius}


@dataclass(frozen=True)
class CurvePart(Part):
    """A piece of a curve: for each value of one coordinate, which is an unknown or the parameter and runs through an
    interval, the others lie near polynomials in its place s there, from -1 to 1.

    parameters, unknowns : enclosures on the whole piece
    coordinate, start, stop : that coordinate, and the decimals at which its interval begins and ends
    polynomials : decimals, the coefficients of 1, s, s**2, ..., by name
    within : the largest distance of the others from them, by name
    alone_within : the distance from them with no other solution within, by name; the least is `uniqueness_radius`
    """

    coordinate: str = ""
    start: str = ""
    stop: str = ""
    polynomials: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    within: Mapping[str, str] = field(default_factory=dict)
    alone_within: Mapping[str, str] = field(default_factory=dict)

    def document(self) -> Document:
        """The piece for JSON."""
        ends = {"coordinate": self.coordinate, "start": self.start, "stop": self.stop}
        curves = {name: list(each) for name, each in self.polynomials.items()}
        tubes = {"within": dict(self.within), "alone_within": dict(self.alone_within)}
        return {**super().document(), **ends, "polynomials": curves, **tubes}


@dataclass(frozen=True, repr=False)
class Proof(Result, what="proof", document_is_whole=True, undrawn="a theorem cannot be drawn: print it"):
    """A theorem about a machine, or the reasons why it is not proved.

    proved : whether all requested claims are proved
    statement : the theorem in words, or its proved part. It suffices to rebuild the machine.
    machine : the machine in words and numbers
    kind : what the theorem is about: "orbit", "fold", "absence", "branch", "fixed point", "periodic hops",
        "period doubling"
    stated : the machine as the theorem states it, in formulas and decimals; see `orbits.exact.stated`
    parameters : exact decimals, the bounds of each parameter by name; equal for a single value
    family : the number of the family, counted from enclosures; None where that is not proved
    enclosures : of alpha, flight_time, contact_time and other quantities by name, in the machine's units
    radius : at least half the width of the enclosure of alpha
    uniqueness_radius : no other solution of the equations has all unknowns within this distance of their enclosures;
        None where intervals were proved in parts
    parts : the boxes of parameters that were proved one by one; usually one box
    conditions : of a motion, by name: "proved", "refuted" or "undecided"
    bounce_side : "above" or "below", the side of alpha on which hops land with a bounce; None where that is not proved
    attraction_radius : a launch faster than alpha by at most this decimal converges to alpha, hop after hop; None if
        not proved
    reasons : for each statement that is not proved, the reason in words
    digits : number of requested digits, or more where these left a condition undecided; None for the default
    seconds : wall time
    """

    proved: bool
    statement: str
    machine: Mapping[str, Any]
    kind: str = "orbit"
    stated: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, Enclosure] = field(default_factory=dict)
    family: int | None = None
    enclosures: Mapping[str, Enclosure] = field(default_factory=dict)
    radius: str | None = None
    uniqueness_radius: str | None = None
    parts: tuple[Part, ...] = ()
    conditions: Mapping[str, str] = field(default_factory=dict)
    bounce_side: str | None = None
    attraction_radius: str | None = None
    reasons: tuple[str, ...] = ()
    digits: int | None = None
    seconds: float = 0.0

    @property
    def alpha(self) -> Enclosure | None:
        """The enclosure of the launch speed."""
        return self.enclosures.get("alpha")

    @property
    def flight_time(self) -> Enclosure | None:
        """The enclosure of the time of a whole flight."""
        return self.enclosures.get("flight_time")

    @property
    def contact_time(self) -> Enclosure | None:
        """The enclosure of the time of a whole contact; None if not requested or not proved."""
        return self.enclosures.get("contact_time")

    def document(self) -> Document:
        """The proof as a JSON document; proved bounds are decimals, as text."""
        missing, tuned = dict.fromkeys(("alpha", "flight_time", "contact_time")), self.stated.get("tuned", ())
        return {
            "format": self.form(),
            "kind": self.kind,
            "proved": self.proved,
            "statement": self.statement,
            "machine": dict(self.stated),
            "motion": bool(self.conditions),
            "parts": [part.document() for part in self.parts],
            "enclosures": {name: [each.low, each.high] for name, each in self.enclosures.items()},
            **missing,
            **{name: each.document() for name, each in self.enclosures.items() if name not in tuned},
            "radius": self.radius,
            "uniqueness_radius": self.uniqueness_radius,
            "family": self.family,
            "conditions": dict(self.conditions),
            "bounce_side": self.bounce_side,
            "attraction_radius": self.attraction_radius,
            "reasons": list(self.reasons),
            "digits": self.digits,
            "seconds": self.seconds,
            "units": self.stated.get("units"),
            "parameters": {name: each.document() for name, each in self.parameters.items()},
            "about": dict(self.machine),
        }

    @classmethod
    def form(cls) -> str:
        """The name of the saved form, see `Result`; the second one states the machine in formulas."""
        return "persistent-orbits proof 2"

    @classmethod
    def of_saved(cls, document: object, machine: object = None) -> "Proof":
        """The proof in a saved document, without verifying it; `orbits check-proof` does that."""
        data = cls._conform(document, Mapping[str, Any])
        if data.get("kind") == "all hops":
            raise InputError(ALL_HOPS)
        numbers = "family", "radius", "uniqueness_radius", "bounce_side", "attraction_radius", "digits", "seconds"
        return cls(
            **{name: data[name] for name in ("proved", "statement", "kind", "conditions", *numbers)},
            machine=data["about"],
            stated=data["machine"],
            parameters={name: Enclosure(**each) for name, each in data["parameters"].items()},
            enclosures=_enclosures(data["enclosures"]),
            parts=tuple(map(_part_of, data["parts"])),
            reasons=tuple(data["reasons"]),
        )

    @property
    def units(self) -> dict[str, str]:
        """The units of the quantities and parameters by name; empty for a dimensionless machine."""
        known = dict(super().units)
        return known | ({"mid_flight_extension": known["liftoff_extension"]} if known else {})

    def table(self) -> dict[str, list[str]]:
        """The enclosures as columns: the quantities, and the bounds as decimals."""
        bounds = {side: [getattr(each, side) for each in self.enclosures.values()] for side in ("low", "high")}
        return {"quantity": list(self.enclosures), "unit": [*map(self.unit_of, self.enclosures)], **bounds}

    def _line(self) -> dict[str, object]:
        return {"proved": self.proved, "family": self.family, "alpha": str(self.alpha)}

    def title(self) -> str:
        return "proved" if self.proved else "NOT PROVED"

    def _rows(self) -> Iterator[Row]:
        """The enclosures, the conditions with their verdicts, and the time."""
        for name, each in self.enclosures.items():
            yield Row(name.replace("_", " "), {name: str(each)})
        if self.attraction_radius is not None:
            yield Row.of("attraction_radius", self.attraction_radius)
        yield from (Row.of(name, verdict) for name, verdict in self.conditions.items())
        if self.digits is not None:
            yield Row.of("digits", self.digits)
        yield Row("time", {"seconds": self.seconds}, (f"{1e3 * self.seconds:.0f} ms",))

    def _notes(self) -> list[str]:
        return [self.statement, *(f"not proved: {reason}" for reason in self.reasons)]

    def __str__(self) -> str:
        """The statement stands before the table."""
        notes = [line for text in self._notes() for line in wrapped(text, indent="  ")]
        return "\n".join([self.title(), *notes, *text_table(self.rows(self.printed_digits))])


def _enclosures(data: Mapping[str, Any]) -> dict[str, Enclosure]:
    """The enclosures of pairs of decimals by name."""
    return {name: Enclosure(*pair) for name, pair in data.items()}


def _part_of(data: Mapping[str, Any]) -> Part:
    """The part of its `document`."""
    boxes = {name: _enclosures(data[name]) for name in ("parameters", "unknowns")}
    if "coordinate" not in data:
        return Part(**{**data, **boxes})
    polynomials = {name: tuple(each) for name, each in data["polynomials"].items()}
    return CurvePart(**{**data, **boxes, "polynomials": polynomials})
