"""A family: a curve of lossless orbits along a parameter, with its events and how it ends."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal, NotRequired, TypedDict, overload

import numpy as np

from ..errors import InputError, finite_number
from ..io import (
    DIGEST,
    MEGABYTE,
    Document,
    conform,
    has_digest,
    named_file,
    parse_json,
    sealed,
    to_json,
    unsealed,
    writing,
)
from ..model import STEP_LENGTH, Machine, check_parameters, title_of_machine
from ..periodic import OF_STEPS, PRESCRIBED, Orbit, SavedLaws, orbit_from, with_note
from ..result import ENDINGS, Axes, Progress, Result, Row, is_of, reported, shown
from ..units import saved_units, unit_text
from .motion_columns import numbers_of_motions
from .point import (
    KNOWN,
    SIDES,
    End,
    Event,
    EventLine,
    Point,
    check_points,
    json_line,
    numbers_at,
    point_in_units,
    stated,
)

if TYPE_CHECKING:
    from ..exact import Claim
    from ..proof import BranchClaim, Proof

# The reason why a family from an unfinished file has no end.
UNFINISHED = "its file is incomplete: resume it to continue"
# The setting of a family that says how it ends at its first point, where it was followed both ways.
BEGINNING = "beginning"
# Kinds of events in files of earlier versions, with their names of today.
OLD_KINDS = {"asked": "value"}
# Endings of the files that a family is saved to; the first is lines of JSON, which grow point by point.
FAMILY_ENDINGS = (".jsonl", *ENDINGS)
# The largest file and line of a saved family that are read: some 100,000 points, and far longer lines than are written.
LARGEST_FILE, LONGEST_LINE = 128 * MEGABYTE, 4 * MEGABYTE


class Sealing:
    """The lines of a family's file, each with a digest of itself and of all lines before it."""

    def __init__(self) -> None:
        self.before: str | None = ""

    def line(self, record: str) -> str:
        """The next line of the file, for a record."""
        document = sealed(json.loads(record), self.before or "")
        self.before = document[DIGEST]
        return to_json(document) + "\n"

    def opened(self, document: object, number: int) -> Any:
        """The record of the next line; raises `ValueError` where this line, or one before it, was changed. The lines
        of version 0.1.0 have no digests."""
        stated = document.get(DIGEST) if isinstance(document, Mapping) else None
        if (stated is None) != (self.before is None) and number > 1:
            raise ValueError(f"line {number} was changed after it was written, or lines before it are missing")
        try:
            content = document if stated is None else unsealed(document, self.before or "")
        except ValueError as error:
            raise ValueError(f"line {number}, or a line before it: {error}") from None
        self.before = stated
        return content


class _Machine(SavedLaws):
    """The required data of the machine in a family's heading."""

    machine: str
    parameters: Mapping[str, float]
    units: NotRequired[Mapping[str, str]]


class _Settings(TypedDict):
    """The settings required of a family that is resumed."""

    start: float
    family: int
    method: str


class Heading(TypedDict):
    """The first line of a saved family, and the lines after it."""

    format: str
    along: str
    machine: _Machine
    settings: _Settings
    versions: Mapping[str, str]
    items: tuple[Any, ...]


@dataclass(frozen=True, repr=False)
class Family(
    Result, what="family", endings=FAMILY_ENDINGS, printed_digits=15, dimension="point", largest_file=LARGEST_FILE
):
    """A curve of orbits, traced by `follow`; `len`, indexing and iteration go over its points.

    name : of the parameter
    points : the orbits, in order along the curve
    events : the events, in order along the curve: where something happens (`kind`), after which point (`after`, its
        index; for "value" the index of the point itself), and the orbit there (`point`). The kinds are "fold", "branch
        point", "corner", "grazing", "masses touch", "contact pulls", "landing jerk", "collapse", "law ends", "foot
        lifts", "foot slides", "family", "multiplier 1", "flip", "Neimark-Sacker", "value" (of the parameter, in `at`),
        and the names of the functions of `watch`
    end : how the curve ends: "reached" (a bound of the parameter), "escaped", "homoclinic" (the orbit stays longer and
        longer near an unstable equilibrium), "closed", "degenerate", "stopped", "stuck", or "interrupted" by a time
        limit or in an unfinished file, with the reason in words, and the limit of the parameter where it tends to one
    machine : the machine in words and numbers, at the first point
    settings : the arguments of `follow`
    versions : of the packages that computed the family
    source : the machine that was followed; None for a family from a file

    >>> from orbits import follow
    >>> from problems import Hopper
    >>> family = follow(Hopper("cubic", rest_length=9.0), "beta", 0.3, start=0.2, at=[0.25])
    >>> [round(point.alpha, 4) for point in family.at(0.25)]
    [3.0148]
    """

    name: str
    machine: Mapping
    points: Sequence[Point]
    events: tuple[Event, ...]
    end: End
    settings: Mapping
    versions: Mapping = field(default_factory=dict)
    source: Machine | None = field(default=None, repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, index: int) -> Point:
        return self.points[index]

    def __iter__(self) -> Iterator[Point]:
        return iter(self.points)

    def column(self, name: str) -> np.ndarray:
        """One quantity at every point, NaN where the orbit does not have it; the parameter goes by its own name."""
        return self.values_at(self.points, name)

    def quantity(self, point: Point, name: str) -> float:
        """A quantity at a point, NaN where the orbit does not have it; raises `InputError` for an unknown name."""
        return float(self.values_at([point], name)[0])

    def values_at(self, points: Sequence[Point], name: str) -> np.ndarray:
        """A quantity (m,) at points of the curve, or a formula as in `optimize`, NaN where an orbit does not have it.

        Quantities of the motion, such as "stroke", and formulas are computed when they are needed; this works for a
        family that has its machine. Raises `InputError` for an unknown name, and for anything that is not a point of a
        family.
        """
        if strange := [each for each in points if not hasattr(each, "numbers")]:
            raise InputError(f"points: {strange[0]!r} is not a point of a family")
        numbers = names_of_numbers(self, points)
        if name in (*numbers, "value"):
            return numbers_at(points, "value" if name == self.name else name)
        if self.source is None:
            known = f"they have {', '.join(numbers)}; quantities of motions need Family.load(path, machine)"
            raise InputError(f"the family does not know its machine and has no quantity '{name}': {known}")
        from .formula_columns import formula_along

        varied = [varied_at(self, point) for point in points]
        return formula_along(self.source, self.settings["method"], varied, points, name)

    @property
    def beginning(self) -> End | None:
        """How the curve ends at its first point, if it goes both ways; None if it begins there."""
        return End(**self.settings[BEGINNING]) if BEGINNING in self.settings else None

    @property
    def units(self) -> Mapping[str, str]:
        own, along = super().units, {**PRESCRIBED, **OF_STEPS}.get(self.name)
        return (
            {self.name: unit_text(along.dimension), **own}
            if own and along and not isinstance(along.dimension, str)
            else own
        )

    @property
    def _along(self) -> tuple[str, ...]:
        """The parameter along which the family goes; none where it goes along a quantity of its orbits."""
        return () if is_quantity_along(self, self.name) else (self.name,)

    def _of_motions(self, machine: Machine | None, points: Sequence[Point]) -> dict[str, np.ndarray]:
        """The quantities of the motions at points of the curve, by name; empty without the machine."""
        if machine is None or not points:
            return {}
        check_parameters(machine, *self._along)
        varied = [varied_at(self, point) for point in points]
        return numbers_of_motions(machine, self.settings["method"], varied, points)

    def table(self, machine: Machine | None = None, *, events: bool = False) -> dict[str, Any]:
        """The quantities of the points as columns: the parameters, the numbers and the sides of the certificate, and
        "violations", the reasons why an orbit is not a motion.

        machine : the machine with which the family was followed; with it, the columns include the quantities of the
            motions, such as the stroke and the rises of the heights
        events : whether the points of the events are among the rows, in order along the curve; "event" is then the kind
            of each, "" at other points
        """
        rows = list[tuple[Point, str]]()
        for point, event in self.in_order() if events else ((point, None) for point in self.points):
            if event and event.kind == "value" and rows:  # its point is the previous row
                rows.pop()
            rows.append((point, event.kind if event else ""))
        points = [point for point, _ in rows]
        data: dict[str, Any] = {name: self.values_at(points, name) for name in names_of_numbers(self, points)}
        data |= {"admissible": data["admissible"] == 1, "family": data["family"].astype(int)}
        data |= {name: values for name, values in self._of_motions(machine, points).items() if name not in data}
        data |= {name: [getattr(point, name) for point in points] for name in SIDES}
        data |= {"event": [kind for _, kind in rows]} if events else {}
        return data | {"violations": ["; ".join(point.violations) for point in points]}

    def dataframe(self, machine: Machine | None = None) -> Any:
        """The `table` with its events, and with the quantities of the motions where the machine is known, as a
        `pandas.DataFrame`; otherwise as in `Result.dataframe`."""
        return super().dataframe(self.source if machine is None else machine, events=True)

    def at(self, value: float) -> list[Point]:
        """The points whose parameter has exactly this value."""
        value = finite_number("value", value)
        everywhere = {(point.value, point.u): point for point in (*self.points, *(e.point for e in self.events))}
        return [point for point in everywhere.values() if point.value == value]

    def in_order(self) -> list[tuple[Point, Event | None]]:
        """The points of the family and of its events, each with its event, in order along the curve."""
        items: list[tuple[Point, Event | None]] = [(point, None) for point in self.points]
        for event in reversed(self.events):
            items.insert(event.after + 1, (event.point, event))
        return items

    @overload
    def prove(
        self, machine: Machine, digits: int | None = None, *, motion: bool = True, workers: int = 1,
        continuous: Literal[False] = False, limit: float | None = None,
    ) -> "tuple[Proof, ...]": ...  # fmt: skip

    @overload
    def prove(
        self, machine: Machine, digits: int | None = None, *, motion: bool = True, workers: int = 1,
        continuous: Literal[True], limit: float | None = None,
    ) -> "Proof": ...  # fmt: skip

    def prove(
        self, machine: Machine, digits: int | None = None, *, motion: bool = True, workers: int = 1,
        continuous: bool = False, limit: float | None = None,
    ) -> "tuple[Proof, ...] | Proof":  # fmt: skip
        """Prove each point's orbit, on `workers` processes, without any claim between points. Or, with `continuous`,
        prove that the family is one continuous curve of orbits from its first point to its last, with its folds.

        machine : the machine with which the family was followed digits, motion : as in `orbits.prove`; for a curve,
            `digits` apply to its ends and folds
        workers : number of processes, for points only
        continuous : whether to prove the curve; the theorem is in `orbits.proof.branch`. The machine must be
            dimensionless, with smooth springs
        limit : time limit in seconds for each point, or for the whole curve; None for 30 s and 600 s of processor time

        Returns one `Proof` for each point, or one for the curve. Raises `InputError` without python-flint, for another
        machine, for a family that was not followed by the simplest method, and for one that cannot be a curve.
        """
        from ..proof import prove_branch, prove_claims

        if self.settings.get("tune"):
            raise InputError(
                "a family with tuned parameters is proved orbit by orbit: prove(orbit_at(...), tune=..., at=...)"
            )
        check_parameters(machine, *self._along)
        if continuous:
            return prove_branch(self._branch_claim(machine), digits, motion, limit)
        claims = [self._claim(machine, point) for point in self.points]
        return prove_claims(claims, digits, motion, workers, limit)

    def _branch_claim(self, machine: Machine) -> "BranchClaim":
        """The claim of the family that its orbits form a curve from its first point to its last."""
        from .proved_curve import branch_claim

        if not self.points:
            raise InputError("this family has no points from which a curve could be proved")
        ends = self._claim(machine, self.points[0]), self._claim(machine, self.points[-1])
        names = machine.model.reduction.statement.unknowns if machine.model.reduction else machine.model.half_unknowns
        return branch_claim(machine, self.name, self.settings["method"], tuple(names), self.points, ends)

    def _claim(self, machine: Machine, point: Point) -> "Claim":
        """The claim of a point about the machine there."""
        from ..exact import CONTACT_DURATION, Claim

        here = machine.with_values(**varied_at(self, point))
        model = here.model
        names = model.reduction.statement.unknowns if model.reduction else model.half_unknowns
        if len(names) != len(point.u):
            raise InputError("this family was not followed by its machine's simplest method")
        sizes = [1.0 if here.units is None else here.units.of(name) for name in names]
        own = {name: each * size for name, each, size in zip(names, point.u, sizes, strict=True)}
        unknowns = {"duration": point.flight_time / 2, **own}
        if point.contact_time is not None:
            unknowns.setdefault(CONTACT_DURATION, point.contact_time / 2)
        return Claim(here, point.alpha, point.error, point.family, tuple(point.violations), unknowns)

    def document(self) -> Document:
        points = [{self.name: point.value, **point.row()} for point in self.points]
        places = [{"kind": e.kind, "after": e.after, self.name: e.point.value, **e.point.row()} for e in self.events]
        end = {key: value for key, value in stated(self.end).items() if value is not None}
        whole = {"machine": self.machine, "along": self.name, "points": points, "events": places, "end": end}
        whole |= {"units": self.units} if self.units else {}
        return {**whole, "settings": self.settings, "versions": self.versions}

    def _line(self) -> dict[str, object]:
        ends = {"start": self.points[0].value, "stop": self.points[-1].value} if self.points else {}
        return {"along": self.name, "orbits": len(self), **ends, "end": self.end.kind}

    def title(self) -> str:
        if not self.points:
            return f"a family along {self.name} without orbits: {self.end.kind}, {self.end.reason}"
        event = f"{self.settings['event']} of " if "event" in self.settings else ""
        head = f"{event}family {self.points[0].family} of {title_of_machine(self.machine)}"
        return f"{head}, along {self.name}: {len(self)} orbits"

    def _rows(self) -> Iterator[Row]:
        """The start and stop of the curve, the errors, each event, the end."""
        if not self.points:
            return
        unit, speed = (f" {self.unit_of(name)}".rstrip() for name in (self.name, "alpha"))
        c, values = self.column("alpha").tolist(), (self.points[0].value, self.points[-1].value)
        way = dict(zip(("start", "stop", "alpha at start", "alpha at stop"), (*values, c[0], c[-1]), strict=True))
        within = {"alpha at start": self.points[0].error, "alpha at stop": self.points[-1].error}
        yield Row(self.name, way, (f"{{}} to {{}}{unit}, alpha {{}} to {{}}{speed}",), within)
        yield Row("largest error", {"largest_error": max(point.error for point in self)}, ("{:.1e}",))
        count = {"admissible": sum(point.admissible for point in self), "orbits": len(self)}
        yield Row("admissible", count, ("{} of {}",))
        if self.beginning:
            yield self._row_of_end("beginning", self.beginning)
        for event in self.events:
            place = {event.kind: event.point.value, f"alpha at {event.kind}": event.point.alpha}
            within = {f"alpha at {event.kind}": event.point.error}
            yield Row(event.kind, place, (f"{self.name} = {{}}{unit}, alpha = {{}}{speed}",), within)
        yield self._row_of_end("end", self.end)

    def _row_of_end(self, name: str, end: End) -> Row:
        """The row of the end, or of the beginning."""
        of = "" if name == "end" else f" of {name}"
        limits = {} if end.limit is None else {f"limit{of}": end.limit, f"limit_error{of}": end.limit_error}
        tends = f", {self.name} tends to {{:.8g}} (about {{:.0e}} off)" if limits else ""
        return Row(name, {name: end.kind, f"reason{of}": end.reason, **limits}, (f"{{}}, {{}}{tends}",))

    def plot(self, quantity: str = "alpha", axes: Axes | None = None, label: str | None = None) -> Axes:
        """Plot a quantity against the parameter; returns the axes. See `orbits.show.plot.plot_family`."""
        return shown("plot").plot_family(self, axes, quantity, label)

    def page(
        self, path: str | Path, quantity: str = "alpha", machine: Machine | None = None, *, progress: Progress = None
    ) -> Path:
        """Write a page of the family in one file (.html) that needs no network; returns its path.

        quantity : the quantity shown along the family
        machine : that the family was followed with; a family from a file does not have it, and without it the page
            has no hops to choose from
        progress : called with the share of these hops that are solved

        Raises `InputError` for a bad path, an unknown quantity, and without Bokeh.
        """
        still = shown("pages.saved_page")
        hops: Iterator[tuple[Point, Orbit]] = iter(())
        if (whole := self.source if machine is None else machine) is not None and self.points:
            check_parameters(whole, *self._along)
            points = shown("plot").spread(self, still.MOST_HOPS)
            hops = ((point, self._orbit(whole, point)) for point in reported(points, progress))
        return still.family_page(self, path, quantity, hops)

    def _orbit(self, machine: Machine, point: Point) -> Orbit:
        """The whole orbit at a point."""
        here = machine.with_values(**varied_at(self, point))
        bare = point_in_units(point, here.units and here.units.inverse())
        return orbit_from(here, self.settings["method"], point.u, bare.error)

    def save(self, path: str | Path) -> Path:
        """Write the family to .jsonl, a line for each point and event, as a run writes it; other endings as in
        `Result.save`. Both .jsonl and .json can be loaded and resumed."""
        if (path := named_file(path)).suffix.lower() != ".jsonl":
            return super().save(path)
        with writing(self.what, path) as target:
            target.write_text("".join(map(Sealing().line, self.records())), encoding="utf-8")
        return path

    def saved(self) -> Document:
        head, *lines = map(json.loads, self.records())
        return {**head, "items": lines}

    def records(self) -> Iterator[str]:
        """The lines of a saved family: its heading, its points and events in order, its end."""
        head = {"format": self.form(), "along": self.name, "machine": self.machine}
        head |= {"units": self.units} if self.units else {}
        yield to_json({**head, "settings": self.settings, "versions": self.versions})
        yield from (json_line(event or point) for point, event in self.in_order())
        yield json_line(self.end)

    @classmethod
    def _read(cls, machine: Machine | None, file: BinaryIO) -> "Family":
        """The family in an open file, of lines or of one document; a truncated last line is left out."""
        if str(file.name).lower().endswith(".json"):
            with suppress(json.JSONDecodeError):  # version 0.1.0 wrote lines to .json too
                if "items" in (document := parse_json(file.read())):
                    return cls.of_saved(unsealed(document), machine)
            file.seek(0)
        sealing, items = Sealing(), list[Any]()
        for number, line in enumerate(_lines(file), start=1):
            try:
                item = parse_json(line)
            except json.JSONDecodeError:
                if number > 1 and next(file, None) is None:
                    break
                raise
            if number == 1:
                has_digest(item, file.name)
            items.append(sealing.opened(item, number))
        head, *lines = items or [{}]
        return cls.of_saved({**head, "items": lines}, machine)

    @classmethod
    def of_saved(cls, document: object, machine: Machine | None = None) -> "Family":
        head = cls._conform(document, Heading)
        points, events, end = list[Point](), list[Event](), End("interrupted", UNFINISHED)
        for number, item in enumerate(head["items"], start=2):
            where = f"line {number}"
            if "point" in item:
                points.append(conform(item["point"], Point, where))
            elif "event" in item:
                event = conform(item["event"], EventLine, where)
                events.append(Event(OLD_KINDS.get(event["kind"], event["kind"]), event["after"], event["point"]))
            else:
                end = conform(item["end"], End, where)
        check_points(points, events)
        found = tuple(points), tuple(events), end
        family = cls(head["along"], head["machine"], *found, head["settings"], head["versions"])
        if machine is not None:  # with the values that its description has of the parameters that vary
            words, settings = {**family.machine, **family.machine["parameters"]}, family.settings
            varied = family.name, settings.get("along"), *settings.get("tune", ())
            own = {each: words[each] for each in varied if each in words}
            family = replace(family, source=is_of(machine, family.machine, own))
        return _modernised(family) if family.machine.get("laws_in") == "SI" else family

    @property
    def dataset(self) -> Any:
        """The table along "point", with the parameter as a coordinate and the rest of the family as attributes."""
        settings = {name: to_json(getattr(self, name)) for name in ("settings", "versions")}
        settings |= {"events": to_json([stated(event) for event in self.events]), "end": to_json(stated(self.end))}
        return super().dataset.assign_attrs(settings).set_coords(self.name)


def is_quantity_along(family: Family, name: str) -> bool:
    """Whether a name that varies along a family is a quantity of its orbits, and no number of its machine."""
    numbers = {*family.machine, *family.machine["parameters"], STEP_LENGTH}
    return bool(family.settings.get("tune")) and name not in numbers


def varied_at(family: Family, point: Point) -> dict[str, float]:
    """The values of the parameters that vary along a family, at a point of it."""
    also = {name: value for name, value in point.also.items() if not is_quantity_along(family, name)}
    return {**also, **dict.fromkeys(family._along, point.value)}


def names_of_numbers(family: Family, points: Sequence[Point]) -> list[str]:
    """The names of the numbers that points of a family have."""
    return list(dict.fromkeys((family.name, *(points[0].numbers if points else KNOWN))))


def _modernised(family: Family) -> Family:
    """A family of a machine in SI, with the numbers of its points in SI: in files of version 0.1.0, which state no
    units of their parameters, these numbers are dimensionless."""
    if "units" in family.machine:
        return family
    units = saved_units({name: family.machine[f"unit_{name}"] for name in ("length", "time", "force")})

    def converted(point: Point) -> Point:
        return point_in_units(replace(point, certificate=with_note(point.certificate)), units)

    events = tuple(replace(event, point=converted(event.point)) for event in family.events)
    points = tuple(converted(point) for point in family.points)
    return replace(family, machine={**family.machine, "units": {}}, points=points, events=events)


def _lines(file: BinaryIO) -> Iterator[str]:
    """The lines of a file; the last one may be cut within a character. Raises `ValueError` for too long a line."""
    while line := file.readline(LONGEST_LINE + 1):
        if len(line) > LONGEST_LINE:
            raise ValueError(f"a line has more than {LONGEST_LINE} bytes")
        yield line.decode(errors="replace")
