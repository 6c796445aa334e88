"""A family: a curve of lossless orbits along a parameter, with its events and how it ends."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO, Literal, NotRequired, TypedDict, overload

import numpy as np

from ..consistency.accepted import check_parameters
from ..errors import InputError
from ..exact.claim import CONTACT_DURATION, Claim
from ..io import (
    DIGEST,
    MEGABYTE,
    check_ending,
    conform,
    extra_package,
    one_line,
    read_file,
    sealed,
    to_json,
    unsealed,
    warn_of_no_digest,
    write_table,
    writing,
)
from ..model.machine import Machine
from ..periodic.certified import orbit_from
from ..periodic.orbit import Orbit, SavedLaws, with_note
from ..proof.branch_claim import BranchClaim
from ..proof.prove import prove_branch, prove_claims
from ..proof.theorem import Proof
from ..result import cell, shown
from ..running.time_limit import LIMIT
from ..tables import DIGITS
from ..units import UNIT_TEXTS, saved_units
from .point import COLUMNS, KNOWN, NUMBERS, SIDES, End, Event, Point, check_points, json_line, point_in_units
from .proved_curve import branch_claim
from .table import names_of_motions, numbers_of_motions

FAMILY_FORMAT = "persistent-orbits family 1"
# Why a family that is read has no end.
UNFINISHED = "its file ends before it does: resume it to go on"
# Seconds that the proof of a curve may take unless more are allowed.
LIMIT_OF_BRANCH = 600.0
# What is read of a saved family at most: some 100,000 points, and lines far longer than any that is written.
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

    def opened(self, document: Any, number: int) -> Any:
        """The record of the next line; raises `ValueError` where it, or one before it, was changed. The files of
        earlier versions have no digests."""
        stated = document.get(DIGEST) if isinstance(document, Mapping) else None
        if (stated is None) != (self.before is None) and number > 1:
            raise ValueError(f"line {number} was changed after it was written, or lines before it are missing")
        try:
            content = unsealed(document, self.before or "")
        except ValueError as error:
            raise ValueError(f"line {number}, or a line before it: {error}") from None
        self.before = stated
        return content


class _Machine(SavedLaws):
    """What a family's heading must say of its machine."""

    machine: str
    parameters: Mapping[str, float]
    units: NotRequired[Mapping[str, str]]


class _Settings(TypedDict):
    """What a family that is resumed must say of how it was followed."""

    start: float
    family: int
    method: str


class Heading(TypedDict):
    """The first line of a saved family."""

    format: str
    along: str
    machine: _Machine
    settings: _Settings
    versions: Mapping[str, str]


@dataclass(frozen=True)
class Family:
    """A curve of orbits, traced by `follow`; `len`, indexing and iteration go over its points.

    name : of the parameter
    points : the orbits, in order along the curve
    events : the events, in order along the curve
    end : how the curve ends
    machine : the machine in words and numbers, at the first point
    settings : the arguments of `follow`
    versions : of the packages that computed the family
    source : the machine that was followed; None for a family from a file or another process

    >>> from orbits import follow
    >>> from problems import Hopper
    >>> family = follow(Hopper("cubic", rest_length=9.0), "beta", 0.3, start=0.2, at=[0.25])
    >>> [round(point.alpha, 4) for point in family.at(0.25)]
    [3.0148]
    """

    name: str
    machine: Mapping
    points: tuple[Point, ...]
    events: tuple[Event, ...]
    end: End
    settings: Mapping
    versions: Mapping = field(default_factory=dict)
    source: Machine | None = field(default=None, repr=False, compare=False)

    def __getstate__(self) -> dict[str, Any]:
        """The fields without the machine, which another process may not be able to read."""
        return vars(self) | {"source": None}

    @property
    def units(self) -> dict[str, str]:
        """The units of the parameters and the results by name; empty for a dimensionless machine."""
        own = self.machine.get("units")
        results = {name: unit for name, unit in UNIT_TEXTS.items() if name in COLUMNS}
        return {} if own is None else {**own, **results, **own}

    def unit_of(self, name: str) -> str:
        """The unit of a parameter or quantity, "" where it has none."""
        if not self.units:
            return ""
        rise = "m" if name.endswith("_rise") else ""
        return self.units.get(name, UNIT_TEXTS.get(name, rise))

    def heading(self, name: str) -> str:
        """A name with its unit, if it has one: "alpha (m/s)"."""
        return f"{name} ({self.unit_of(name)})" if self.unit_of(name) else name

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
        """A quantity (m,) at points of the curve, NaN where an orbit does not have it.

        Quantities of the motion, such as "stroke", are computed when they are needed; this works for a family that
        `follow` has returned. Raises `InputError` for an unknown name.
        """
        numbers = [self.name, *(points[0].also if points else ()), *KNOWN]
        if name in (*numbers, "value"):
            stored = "value" if name == self.name else name
            found = (point.also[name] if name in point.also else getattr(point, stored) for point in points)
            return np.array([np.nan if value is None else float(value) for value in found])
        further = names_of_motions(self.source) if self.source else ()
        if name not in further:
            raise InputError(
                f"a family's orbits have no quantity '{name}'; they have {', '.join([*numbers, *further])}"
            )
        return self._of_motions(self.source, points)[name] if points else np.zeros(0)

    def _of_motions(self, machine: Machine | None, points: Sequence[Point]) -> dict[str, np.ndarray]:
        """What the motions at points of the curve tell, by name; nothing without the machine."""
        if machine is None or not points:
            return {}
        check_parameters(machine, self.name)
        varied = [{**point.also, self.name: point.value} for point in points]
        return numbers_of_motions(machine, self.settings["method"], varied, points)

    def dataframe(self, machine: Machine | None = None) -> Any:
        """The family as a `pandas.DataFrame`: every quantity at the points and events in order along the curve.

        machine : that the family was followed with; a family from a file does not have it, and without it there are no
            columns for the quantities of the motions: the stroke and the rises of the heights

        The column "event" has the kind of an event, "" at other points, and "violations" the violated conditions of a
        motion; `dataframe.attrs["units"]` has the units by column. Raises `InputError` without pandas.
        """
        pandas = extra_package("pandas", "for a data frame")
        rows = list[tuple[Point, str]]()
        for point, event in self.in_order():
            if event and event.kind == "asked" and rows:  # its point is the one before
                rows.pop()
            rows.append((point, event.kind if event else ""))
        points = [point for point, _ in rows]
        names = dict.fromkeys((self.name, *(points[0].also if points else ()), *KNOWN))
        data: dict[str, Any] = {name: self.values_at(points, name) for name in names}
        motions = self._of_motions(machine or self.source, points)
        data |= {name: values for name, values in motions.items() if name not in data}
        data |= {"admissible": data["admissible"] == 1, "family": data["family"].astype(int)}
        data |= {name: [getattr(point, name) for point in points] for name in SIDES}
        data["event"] = [kind for _, kind in rows]
        frame = pandas.DataFrame(data | {"violations": ["; ".join(point.violations) for point in points]})
        frame.attrs["units"] = {name: self.unit_of(name) for name in data if self.unit_of(name)}
        return frame

    def at(self, value: float) -> list[Point]:
        """The points whose parameter has exactly this value."""
        everywhere = {(point.value, point.u): point for point in (*self.points, *(e.point for e in self.events))}
        return [point for point in everywhere.values() if point.value == value]

    def in_order(self) -> list[tuple[Point, Event | None]]:
        """The points and those of the events, each with its event, in order along the curve."""
        items: list[tuple[Point, Event | None]] = [(point, None) for point in self.points]
        for event in reversed(self.events):
            items.insert(event.after + 1, (event.point, event))
        return items

    @overload
    def prove(
        self, machine: Machine, digits: int | None = None, *, motion: bool = True, workers: int = 1,
        continuous: Literal[False] = False, limit: float | None = None,
    ) -> tuple[Proof, ...]: ...  # fmt: skip

    @overload
    def prove(
        self, machine: Machine, digits: int | None = None, *, motion: bool = True, workers: int = 1,
        continuous: Literal[True], limit: float | None = None,
    ) -> Proof: ...  # fmt: skip

    def prove(
        self, machine: Machine, digits: int | None = None, *, motion: bool = True, workers: int = 1,
        continuous: bool = False, limit: float | None = None,
    ) -> tuple[Proof, ...] | Proof:  # fmt: skip
        """Prove each point's orbit, on `workers` processes; nothing is claimed between points. Or, where `continuous`,
        prove that the family is one continuous curve of orbits from its first point to its last, with its folds.

        machine : that the family was followed with
        digits, motion : as in `orbits.prove`; for a curve, `digits` are those of its ends and folds
        workers : number of processes, for points only
        continuous : whether to prove the curve; the theorem is in `orbits.proof.branch`. The machine must be
            dimensionless, with smooth springs
        limit : time limit in seconds for each point, or for the whole curve; None for 30 and 600

        Returns one `Proof` for each point, or that of the curve. Raises `InputError` without python-flint, for another
        machine, for a family of another method than the simplest, and for one that cannot be a curve.
        """
        check_parameters(machine, self.name)
        if continuous:
            seconds = LIMIT_OF_BRANCH if limit is None else limit
            return prove_branch(self._branch_claim(machine), digits, motion, seconds)
        claims = [self._claim(machine, point) for point in self.points]
        return prove_claims(claims, digits, motion, workers, LIMIT if limit is None else limit)

    def _branch_claim(self, machine: Machine) -> BranchClaim:
        """What the family says of a curve from its first point to its last."""
        if not self.points:
            raise InputError("this family has no points of which a curve could be proved")
        ends = self._claim(machine, self.points[0]), self._claim(machine, self.points[-1])
        names = machine.model.reduction.statement.unknowns if machine.model.reduction else machine.model.half_unknowns
        return branch_claim(machine, self.name, self.settings["method"], tuple(names), self.points, ends)

    def _claim(self, machine: Machine, point: Point) -> Claim:
        """What a point says of the machine there."""
        here = machine.with_values(**{**point.also, self.name: point.value})
        model = here.model
        names = model.reduction.statement.unknowns if model.reduction else model.half_unknowns
        if len(names) != len(point.u):
            raise InputError("this family was followed by another method than its machine's simplest one")
        sizes = [1.0 if here.units is None else here.units.of(name) for name in names]
        own = {name: each * size for name, each, size in zip(names, point.u, sizes, strict=True)}
        unknowns = {"duration": point.flight_time / 2, **own}
        if point.contact_time is not None:
            unknowns.setdefault(CONTACT_DURATION, point.contact_time / 2)
        return Claim(here, point.alpha, point.error, point.family, tuple(point.violations), unknowns)

    def document(self) -> dict[str, Any]:
        """The family as the JSON document of the command line."""
        points = [{self.name: point.value, **point.row()} for point in self.points]
        places = [{"kind": e.kind, "after": e.after, self.name: e.point.value, **e.point.row()} for e in self.events]
        end = {key: value for key, value in asdict(self.end).items() if value is not None}
        whole = {"machine": self.machine, "along": self.name, "points": points, "events": places, "end": end}
        whole |= {"units": self.units} if self.units else {}
        return {**whole, "settings": self.settings, "versions": self.versions}

    def __repr__(self) -> str:
        ends = {"start": self.points[0].value, "stop": self.points[-1].value} if self.points else {}
        return one_line(self, {"along": self.name, "orbits": len(self), **ends, "end": self.end.kind})

    def summary(self) -> str:
        """The family in one line."""
        if not self.points:
            return f"a family along {self.name} without orbits: {self.end.kind}, {self.end.reason}"
        m = self.machine
        head = f"family {self.points[0].family} of {m['machine']}, spring {m['spring']}, gravity {m['gravity']}"
        return f"{head}, along {self.name}: {len(self)} orbits"

    def rows(self, digits: int) -> list[tuple[str, str]]:
        """The family as rows of a table, (name, text): the range of the curve, the errors, each event, the end."""
        if not self.points:
            return []
        unit, speed = (f" {self.unit_of(name)}".rstrip() for name in (self.name, "alpha"))
        c, first, last = self.column("alpha"), self.points[0].value, self.points[-1].value
        way = f"{first:.{digits}g} to {last:.{digits}g}{unit}, alpha {c[0]:.{digits}g} to {c[-1]:.{digits}g}{speed}"
        error, admissible = max(point.error for point in self), sum(point.admissible for point in self)
        end = f"{self.end.kind}, {self.end.reason}"
        if self.end.limit is not None:
            end += f", {self.name} tends to {self.end.limit:.8g} (about {self.end.limit_error:.0e} off)"
        rows = [(self.name, way), ("largest error", f"{error:.1e}"), ("admissible", f"{admissible} of {len(self)}")]
        for event in self.events:
            value, alpha = (f"{each:.{digits}g}" for each in (event.point.value, event.point.alpha))
            rows.append((event.kind, f"{self.name} = {value}{unit}, alpha = {alpha}{speed}"))
        return [*rows, ("end", end)]

    def __str__(self) -> str:
        return "\n".join([self.summary(), *(f"  {name:<13} {text}" for name, text in self.rows(digits=15))])

    def _repr_html_(self) -> str:
        return cell(self.summary(), self.rows(DIGITS), self.plot)

    def plot(self, quantity: str = "alpha", axes: Any = None, label: str | None = None) -> Any:
        """Plot a quantity against the parameter; returns the axes. See `orbits.show.plot.plot_family`."""
        return shown("plot").plot_family(self, axes, quantity, label)

    def page(self, path: str | Path, quantity: str = "alpha", machine: Machine | None = None) -> Path:
        """Write a page of the family in one file (.html) that needs no network; returns its path.

        quantity : that is shown along the family
        machine : that the family was followed with; a family from a file does not have it, and without it the page
            has no hops to choose from

        Raises `InputError` for a bad path, an unknown quantity, and without Bokeh.
        """
        still = shown("pages.still")
        hops: Iterator[tuple[Point, Orbit]] = iter(())
        if (whole := machine or self.source) is not None and self.points:
            check_parameters(whole, self.name)
            hops = ((point, self._orbit(whole, point)) for point in shown("plot").spread(self, still.MOST_HOPS))
        return still.family_page(self, path, quantity, hops)

    def _orbit(self, machine: Machine, point: Point) -> Orbit:
        """The whole orbit at a point."""
        here = machine.with_values(**{**point.also, self.name: point.value})
        bare = point_in_units(point, here.units and here.units.inverse())
        return orbit_from(here, self.settings["method"], point.u, bare.error)

    def save(self, path: str | Path) -> Path:
        """Write the family to .json (to load and resume), .csv (a table) or .nc (NetCDF, by the extra `data`), and
        return the path. Raises `InputError` for another ending, and when the file cannot be written."""
        path, ending = Path(path), check_ending(path, "family")
        if ending == ".csv":
            columns = [self.name, *(self.points[0].also if self.points else ()), *COLUMNS]
            rows = ((p.value, *p.also.values(), *(getattr(p, name) for name in COLUMNS)) for p in self.points)
            return write_table([self.heading(name) for name in columns], rows, path, "family")
        with writing("family", path) as target:
            if ending == ".nc":
                self._dataset().to_netcdf(target)
            else:
                target.write_text("".join(map(Sealing().line, self.records())), encoding="utf-8")
        return path

    def records(self) -> Iterator[str]:
        """The lines of a saved family: its header, its points and events in order, its end."""
        head = {"format": FAMILY_FORMAT, "along": self.name, "machine": self.machine}
        head |= {"units": self.units} if self.units else {}
        yield to_json({**head, "settings": self.settings, "versions": self.versions})
        yield from (json_line(event or point) for point, event in self.in_order())
        yield json_line(self.end)

    @classmethod
    def load(cls, path: str | Path) -> "Family":
        """Read a family that `save` or an interrupted `follow` wrote; an incomplete last line is left out.

        Raises `InputError` when the file does not have a family, or was changed since.
        """
        return read_file(path, f"{path} is not a saved family", cls._parsed, LARGEST_FILE)

    @classmethod
    def _parsed(cls, file: BinaryIO) -> "Family":
        sealing = Sealing()
        head = conform(sealing.opened(json.loads(next(_lines(file), "")), 1), Heading)
        if sealing.before is None:
            warn_of_no_digest(file.name)
        if head["format"] != FAMILY_FORMAT:
            raise ValueError(f"format {head['format']!r}, expected {FAMILY_FORMAT!r}")
        points, events, end = list[Point](), list[Event](), End("interrupted", UNFINISHED)
        for number, line in enumerate(_lines(file), start=2):
            try:
                item = json.loads(line)
            except ValueError:
                if next(file, None) is None:
                    break
                raise
            where, item = f"line {number}", sealing.opened(item, number)
            if "point" in item:
                points.append(conform(item["point"], Point, where))
            elif "event" in item:
                events.append(conform(item["event"], Event, where))
            else:
                end = conform(item["end"], End, where)
        check_points(points, events)
        found = tuple(points), tuple(events), end
        family = cls(head["along"], head["machine"], *found, head["settings"], head["versions"])
        return _modernised(family) if family.machine.get("laws_in") == "SI" else family

    def _dataset(self):
        xarray = extra_package("xarray", "to save a family as NetCDF and not as .json or .csv")
        also = self.points[0].also if self.points else ()
        attached = {name: {"units": unit} for name, unit in self.units.items() if unit}
        data = {name: ("point", self.column(name), attached.get(name, {})) for name in (*also, *NUMBERS)}
        attributes = {name: to_json(getattr(self, name)) for name in ("machine", "settings", "versions")}
        attributes |= {"events": to_json([asdict(event) for event in self.events]), "end": to_json(asdict(self.end))}
        return xarray.Dataset(
            data, {self.name: ("point", self.column("value"), attached.get(self.name, {}))}, attributes
        )


def _modernised(family: Family) -> Family:
    """A family of a machine in SI, with the numbers of its points in SI: in old files, which state no units of their
    parameters, they are without dimensions."""
    if "units" in family.machine:
        return family
    units = saved_units({name: family.machine[f"unit_{name}"] for name in ("length", "time", "force")})

    def converted(point: Point) -> Point:
        return point_in_units(replace(point, certificate=with_note(point.certificate)), units)

    events = tuple(replace(event, point=converted(event.point)) for event in family.events)
    points = tuple(converted(point) for point in family.points)
    return replace(family, machine={**family.machine, "units": {}}, points=points, events=events)


def _lines(file: BinaryIO) -> Iterator[str]:
    """The lines of a file; the last one may be cut within a character, and none is longer than a point can be."""
    while line := file.readline(LONGEST_LINE + 1):
        if len(line) > LONGEST_LINE:
            raise ValueError(f"a line has more than {LONGEST_LINE} bytes")
        yield line.decode(errors="replace")
