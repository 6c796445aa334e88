"""What was proved, as a frozen result that prints and saves itself."""

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..exact.bounds import Enclosure
from ..io import one_line, write_json
from ..result import cell

# The width of the lines of a statement.
LINE_WIDTH = 110
PROOF_FORMAT = "persistent-orbits proof 2"


@dataclass(frozen=True)
class Part:
    """A box of parameters with what is proved there of the unknowns of the equations.

    parameters, unknowns : enclosures by name
    uniqueness_radius : no other solution has all unknowns within it of their enclosures
    """

    parameters: Mapping[str, Enclosure]
    unknowns: Mapping[str, Enclosure]
    uniqueness_radius: str

    def document(self) -> dict[str, Any]:
        """The part for JSON."""
        boxes = {"parameters": self.parameters, "unknowns": self.unknowns}
        named = {name: {key: [each.low, each.high] for key, each in box.items()} for name, box in boxes.items()}
        return {**named, "uniqueness_radius": self.uniqueness_radius}


@dataclass(frozen=True)
class CurvePart(Part):
    """A piece of a curve: for each value of one coordinate, which is an unknown or the parameter and runs through an
    interval, the others lie near polynomials in its place s there, from -1 to 1.

    parameters, unknowns : enclosures on the whole piece
    coordinate, start, stop : the coordinate that runs, and the decimals from and to which
    polynomials : decimals, the coefficients of 1, s, s**2, ..., by name
    within : how far from them the others are at most, by name
    alone_within : how far from them there is no other solution, by name; the least is `uniqueness_radius`
    """

    coordinate: str = ""
    start: str = ""
    stop: str = ""
    polynomials: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    within: Mapping[str, str] = field(default_factory=dict)
    alone_within: Mapping[str, str] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """The piece for JSON."""
        ends = {"coordinate": self.coordinate, "start": self.start, "stop": self.stop}
        curves = {name: list(each) for name, each in self.polynomials.items()}
        tubes = {"within": dict(self.within), "alone_within": dict(self.alone_within)}
        return {**super().document(), **ends, "polynomials": curves, **tubes}


@dataclass(frozen=True)
class Proof:
    """A theorem about a machine, or the reasons why there is none.

    proved : whether all claims that were to be proved are proved
    statement : the theorem in words; where not all is proved, the part that is. It suffices to rebuild the machine.
    machine : the machine in words and numbers
    kind : what the theorem is about: "orbit", "fold", "absence", "branch", "fixed point", "period doubling"
    stated : the machine as the theorem states it, in formulas and decimals, see `orbits.exact.stated`
    parameters : exact decimals, the bounds of each parameter by name; equal for a single value
    family : the number of the family, counted from enclosures; None where that is not proved
    enclosures : of alpha, flight_time, contact_time and other quantities by name, in the machine's units
    radius : no less than half the width of the enclosure of alpha
    uniqueness_radius : no other solution of the equations has all unknowns within this distance of their enclosures;
        None where intervals were proved in parts
    parts : the boxes of parameters that were proved one by one, usually one
    conditions : of a motion, by name: "proved", "refuted" or "undecided"
    bounce_side : "above" or "below", the side of alpha on which hops land with a bounce; None where that is not proved
    attraction_radius : each launch that is faster than alpha by at most this decimal comes to alpha by hopping; None
        where that is not proved
    reasons : what is not proved, and why, in words
    digits : number of digits requested; None for the default
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
        """The enclosure of the time of a whole contact; None where that was not requested or not proved."""
        return self.enclosures.get("contact_time")

    def document(self) -> dict[str, Any]:
        """The proof as a JSON document; proved bounds are decimals, as text."""
        missing = dict.fromkeys(("alpha", "flight_time", "contact_time"))
        return {
            "format": PROOF_FORMAT,
            "kind": self.kind,
            "proved": self.proved,
            "statement": self.statement,
            "machine": dict(self.stated),
            "motion": bool(self.conditions),
            "parts": [part.document() for part in self.parts],
            "enclosures": {name: [each.low, each.high] for name, each in self.enclosures.items()},
            **missing,
            **{name: each.document() for name, each in self.enclosures.items()},
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

    def save(self, path: str | Path) -> Path:
        """Write the document to a JSON file; returns the path. Raises `InputError` when it cannot be written."""
        return write_json(self.document(), path, "proof")

    def __repr__(self) -> str:
        return one_line(self, {"proved": self.proved, "family": self.family, "alpha": str(self.alpha)})

    def rows(self) -> list[tuple[str, str]]:
        """The proof as rows of a table, (name, text): what is enclosed, and the conditions with their verdicts."""
        rows = [(name.replace("_", " "), str(each)) for name, each in self.enclosures.items()]
        if self.attraction_radius is not None:
            rows.append(("attraction radius", self.attraction_radius))
        return rows + [(name.replace("_", " "), verdict) for name, verdict in self.conditions.items()]

    def __str__(self) -> str:
        lines = ["proved" if self.proved else "NOT PROVED", *_wrapped(self.statement)]
        lines += [f"  {name:<24}{text}" for name, text in self.rows()]
        lines += [line for reason in self.reasons for line in _wrapped(f"not proved: {reason}")]
        return "\n".join([*lines, f"  {'time':<24}{1e3 * self.seconds:.0f} ms"])

    def _repr_html_(self) -> str:
        notes = [self.statement, *(f"not proved: {reason}" for reason in self.reasons)]
        return cell("proved" if self.proved else "NOT PROVED", self.rows(), notes=notes)


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, LINE_WIDTH, initial_indent="  ", subsequent_indent="  ", break_long_words=False)
