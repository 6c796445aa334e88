"""The parts of a family: its points, the events between them, and its end; and their lines in a file."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from operator import attrgetter
from typing import Any, TypedDict

import numpy as np

from ..curves import End, Event
from ..io import fields_in_line, to_json
from ..periodic import CERTIFIED, OF_CERTIFICATE, PLANAR, QUANTITIES, Certificate, certificate_in_units
from ..records import Records, numbers_or_nan
from ..units import Units

# Unknowns and tangents whose largest component is smaller than this, or larger than its inverse, are invalid.
SMALLEST_SIZE = 1e-100


class OfCertificate:
    """The numbers of a `certificate`, as numbers of what has it."""

    family: int
    residual: float
    error: float
    energy_drift: float
    clearance: float | None
    smallest_separation: float | None
    smallest_contact_force: float | None
    largest_contact_force: float | None
    landing_jerk: float
    loss_coefficient: float | None
    stable_side: str | None
    violations: tuple[str, ...]
    unfolding: float | None
    loss_error: float | None
    alpha_noise: float | None
    alpha_per_noise: float | None
    bounce_side: str | None
    bounce_factor: float | None
    friction_needed: float | None
    friction_error: float | None
    friction_time: float | None
    smallest_stance_force: float | None
    stance_judged: bool | None
    robustness: float | None


for name in Certificate.__dataclass_fields__:
    setattr(OfCertificate, name, property(attrgetter(f"certificate.{name}")))


@dataclass(frozen=True)
class Point(OfCertificate):
    """One orbit of a family, without its motion; in SI for a machine in SI, except `u` and `tangent`.

    value : of the parameter
    u : (n,), the unknowns of the equations, dimensionless
    tangent : (n + 1,), direction of the curve in (u, value)
    flight_time, contact_time : durations; contact_time None when the contact never ends
    also : values of further parameters that vary along the curve, by name
    """

    value: float
    u: tuple[float, ...]
    tangent: tuple[float, ...]
    alpha: float
    liftoff_extension: float
    flight_time: float
    contact_time: float | None
    certificate: Certificate
    also: Mapping[str, float] = field(default_factory=dict)

    @property
    def admissible(self) -> bool:
        """Whether the orbit is a motion, not merely a root of the equations."""
        return not self.certificate.violations

    @property
    def period(self) -> float | None:
        """The time of a whole cycle; None when the contact never ends."""
        return None if self.contact_time is None else self.flight_time + self.contact_time

    @property
    def frequency(self) -> float | None:
        """One over the `period`; None when the contact never ends."""
        return None if self.period is None else 1 / self.period

    @property
    def of_plane(self) -> tuple[str, ...]:
        """The additional columns of a machine whose masses have horizontal places, and of its stance if a foot stands
        in flight."""
        if self.certificate.smallest_stance_force is not None:
            return PLANAR_NUMBERS
        return () if self.certificate.friction_needed is None else ("friction_needed",)

    @property
    def numbers(self) -> tuple[str, ...]:
        """The names of the numbers of a table, after the parameter's own."""
        return *self.also, *KNOWN, *self.of_plane

    def __repr__(self) -> str:
        return fields_in_line(self, "value", "alpha", "admissible")

    def row(self) -> dict[str, Any]:
        """The columns of a table at this point, ready for JSON."""
        names = *COLUMNS, *self.of_plane
        return {**self.also, **{name: getattr(self, name) for name in names}, "violations": list(self.violations)}


# Columns of a table of points, after the parameter's own: numbers of the motion, of the certificate, and words.
MOTION_COLUMNS = (*(each.name for each in fields(Point) if each.name in QUANTITIES), "admissible")
NUMBERS = (
    *MOTION_COLUMNS,
    *(name for name in CERTIFIED if name not in ("loss_error", "alpha_noise", "alpha_per_noise")),
)
SIDES = ("stable_side", "bounce_side")
COLUMNS = (*NUMBERS, *SIDES)
KNOWN = (*NUMBERS, "period", "frequency")  # at every point; further quantities of its motion are in `table`
PLANAR_NUMBERS = tuple(name for name in OF_CERTIFICATE if name in PLANAR)
# Names that no parameter can have, since a table or a document has columns of these names.
RESERVED_NAMES = (*COLUMNS, *PLANAR_NUMBERS, "value", "kind", "after", "violations", "point", "event")


def numbers_at(points: Sequence[Point], name: str) -> np.ndarray:
    """A number (m,) of points by its name, NaN where an orbit does not have it."""
    if isinstance(points, Records) and not points.columns["also"][0]:
        if name == "admissible":
            return np.array([0.0 if violations else 1.0 for violations in points.column("violations")])
        if name == "frequency":
            return 1 / numbers_at(points, "period")
        names = ("flight_time", "contact_time") if name == "period" else (name,)
        return numbers_or_nan(sum(points.column(each) for each in names))
    found = (point.also[name] if name in point.also else getattr(point, name) for point in points)
    return np.array([np.nan if value is None else float(value) for value in found])


def point_in_units(point: Point, units: Units | None) -> Point:
    """A dimensionless point in these units; the point itself for None."""
    if units is None:
        return point
    return replace(units.convert(point), certificate=certificate_in_units(point.certificate, units))


class EventLine(TypedDict):
    """An event in a file."""

    kind: str
    after: int
    point: Point


def stated(item: Point | Event | End) -> dict[str, Any]:
    """What a point, an event or an end of a family states in files."""
    whole = asdict(item)
    if isinstance(item, Event):
        return {name: whole[name] for name in EventLine.__annotations__}
    return {name: value for name, value in whole.items() if name != "lane"}


def json_line(item: Point | Event | End) -> str:
    """The line of a saved family for one of its points, its events or its end."""
    document = stated(item)
    if isinstance(item, End) and item.period_growth is None:
        del document["period_growth"]
    return to_json({type(item).__name__.lower(): document})


def check_points(points: Sequence[Point], events: Sequence[Event]) -> None:
    """Raise `ValueError` where a point has a wrong number of unknowns or invalid numbers, or an event no place."""
    for point in (*points, *(event.point for event in events)):
        if not point.u or len(point.u) != len((points or [point])[0].u) or len(point.tangent) != len(point.u) + 1:
            counts = f"{len(point.u)} unknowns u, and a tangent of {len(point.tangent)}"
            raise ValueError(
                f"the point at {point.value:g} has {counts}: all points need the same number, and the tangent one more"
            )
        if point.also.keys() != (points or [point])[0].also.keys():
            raise ValueError(f"the point at {point.value:g} has other additional parameters than the first")
        for name in ("u", "tangent"):
            if not SMALLEST_SIZE < max(map(abs, getattr(point, name))) < 1 / SMALLEST_SIZE:
                raise ValueError(f"the point at {point.value:g} has an invalid {name} = {getattr(point, name)}")
        if not point.alpha > SMALLEST_SIZE:
            raise ValueError(
                f"the point at {point.value:g} has alpha = {point.alpha:g}; a launch speed must be above 0"
            )
        if point.error < 0 or point.family < 0:  # 0 where the extension that counts does not turn in flight
            raise ValueError(f"the point at {point.value:g} has error {point.error:g} and family {point.family}")
    if wrong := [event for event in events if not -1 <= event.after < max(len(points), 1)]:
        raise ValueError(f"an event is placed after point {wrong[0].after}, but there are {len(points)} points")
