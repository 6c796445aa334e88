"""A lossless orbit: a frozen result that evaluates, prints, plots, saves and loads itself."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, OrbitsError, finite_times
from ..flow import Trajectory, is_motion_of, spring_forces, units_of_springs
from ..io import DIGEST, Changed, Document, has_digest, parse_json, read_file, to_json, unsealed
from ..model import (
    CONTACT_FORCE,
    LANDED_FORCE,
    STEP_LENGTH,
    Affine,
    Machine,
    dimensionless,
    machine_in_words,
    title_of_machine,
)
from ..numerics import lowest
from ..result import TABLE_ROWS, Axes, Progress, Result, Row, is_of, shown
from ..units import Units, in_units, saved_units
from .certificate import Certificate
from .cycle_shape import Shape, mirrored
from .orbit_table import rows_of_orbit
from .quantities import OF_RUNS, QUANTITIES, dimension_of
from .saved_orbit import (
    DOCUMENT_FIELDS,
    FIELDS_OF_LIMBS,
    FIELDS_OF_RUNS,
    FIELDS_OF_STEPS,
    SavedOrbit,
    check_consistent,
    machine_in_document,
    saved_tuned_errors,
    stated_fields,
    with_note,
)

# The quantities that follow from others of an orbit.
DERIVED = (*("admissible", "frequency", "duty_factor", "stroke", "loop_energy", "rises", "apexes"),)
# The message about an orbit that is not a motion of a machine with the same name and parameters.
OTHER_EQUATIONS = "its motion does not satisfy these equations; a table or a function may have changed"


@dataclass(frozen=True, eq=False, repr=False)
class Orbit(
    Result, what="orbit", printed_digits=15,
    internal=(
        *("bare", "contact", "flight", "method", "scales", "shape", "si", "skipped", "with_tuned"), *FIELDS_OF_LIMBS,
    ),
):  # fmt: skip
    """A lossless periodic motion: flight from time 0 to `flight_time`, then contact to `period`.

    For a machine that steps, the motion is periodic up to the relabelling after each landing. The states are in the
    labels of the present stance, so they jump at the landing; see `unrolled`.

    alpha : launch speed
    liftoff_extension : of the spring, at lift-off and landing
    flight_time, contact_time : durations; contact_time None when the contact never ends
    flight, contact : the first halves, as piecewise polynomials, whose mirror images in time are the second halves;
        whole motions if the model has no reversor
    machine : the machine in words and numbers
    shape : how the whole cycle is built from the halves
    method, skipped : the method that found it, and the steps that were not needed for this machine
    seconds : wall time of the search and the certificate
    scales : the units of the dimensionless numbers; None for a machine stated without units. The numbers of an orbit
        with scales are in SI, except `residual`, `energy_drift` and `unfolding`, which are dimensionless
    bare : the same orbit without units; None for a machine without units
    known_in_family : the number of orbits of its family, this one included, in the searched range of launch speeds;
        None without a search, or if the search may have missed some
    peak_force_in_weights : the largest contact force over the weight that the contact carries; None where that weight
        is not known
    step, speed : for a machine that moves along the ground, its step from landing to landing, and the speed along the
        ground of its centre of mass in flight; None for other machines
    source : the machine for which it was found; None for an orbit from a file
    tuned_errors : bounds on the errors of the tuned parameters, by name; `tuned` has their values
    prescribed : the prescribed values of quantities, by name

    >>> from orbits import find
    >>> from problems import Hopper
    >>> orbit = find(Hopper())
    >>> round(orbit.flight_time - 2 * orbit.alpha, 9)
    0.0
    >>> orbit([0.0, 1.0]).shape  # y1, y1', y2, y2' at two times
    (2, 4)
    """

    machine: Mapping[str, Any]
    alpha: float
    liftoff_extension: float
    flight_time: float
    contact_time: float | None
    flight: Trajectory
    contact: Trajectory | None
    shape: Shape
    certificate: Certificate
    method: str
    skipped: tuple[str, ...] = ()
    seconds: float = 0.0
    scales: Units | None = None
    bare: "Orbit | None" = field(default=None, repr=False)
    known_in_family: int | None = None
    peak_force_in_weights: float | None = None
    step: float | None = None
    speed: float | None = None
    source: Machine | None = field(default=None, repr=False)
    tuned_errors: Mapping[str, float] = field(default_factory=dict)
    prescribed: Mapping[str, float] = field(default_factory=dict)

    def __eq__(self, other: object) -> bool:
        """Whether the files of both orbits would be the same, except for the time of the search."""
        if not isinstance(other, Orbit):
            return NotImplemented
        return self is other or self._without_time() == other._without_time()

    def __hash__(self) -> int:
        return hash((self.alpha, self.flight_time, self.contact_time))

    def _without_time(self) -> str:
        """The content of a file of the orbit, without the time of the search."""
        document = self.saved()
        for each in (document, document.get("bare", {})):
            each.pop("seconds", None)
        return to_json(document)

    def with_tuned(self, errors: Mapping[str, float], prescribed: Mapping[str, float]) -> "Orbit":
        """This orbit with the names of its tuned parameters, bounds on their errors, and the prescribed values; without
        units, parameters that the dimensionless machine does not have are left out.
        """
        tuned: dict[str, Any] = {"tuned_errors": dict(errors), "prescribed": dict(prescribed)}
        if not (self.bare and self.scales):
            return replace(self, **tuned)
        own = {name: x / self.scales.of(dimension_of(name)) for name, x in prescribed.items()}
        numbers = {name: (self.bare._number(name), self._number(name)) for name in errors}
        shares = {name: each / x if x else 1.0 for name, (each, x) in numbers.items() if None not in (each, x)}
        bare = replace(self.bare, tuned_errors={name: errors[name] * x for name, x in shares.items()}, prescribed=own)
        return replace(self, **tuned, bare=bare)

    @property
    def tuned(self) -> dict[str, float]:
        """The values of the tuned parameters, by name."""
        values = {name: self._number(name) for name in self.tuned_errors}
        return {name: value for name, value in values.items() if value is not None}

    def _number(self, name: str) -> Any:
        """The number of its machine of this name, None where there is none; the step is one of the orbit."""
        known = {STEP_LENGTH: self.step, **self.machine, **self.machine["parameters"]}
        return known.get(name)

    def dimensionless(self) -> "Orbit":
        """The orbit in its machine's dimensionless units; the orbit itself if it has no units."""
        return self.bare or self

    @property
    def admissible(self) -> bool:
        """Whether it is a motion, not merely a root of the equations."""
        return not self.certificate.violations

    @property
    def violations(self) -> tuple[str, ...]:
        """The violated conditions of a motion, in words; empty for an admissible orbit."""
        return self.certificate.violations

    @property
    def family(self) -> int:
        """The number of its family, counted on the orbit; see `Certificate`."""
        return self.certificate.family

    @property
    def error(self) -> float:
        """The bound on the error of alpha; see `Certificate`."""
        return self.certificate.error

    @property
    def period(self) -> float:
        """Time of a whole cycle; raises `InputError` when the contact never ends."""
        if self.contact_time is None:
            raise InputError("this orbit has no period: " + "; ".join(self.violations))
        return self.flight_time + self.contact_time

    @property
    def frequency(self) -> float | None:
        """Hops or steps per time; None when the contact never ends."""
        return None if self.contact_time is None else 1 / self.period

    @property
    def duty_factor(self) -> float | None:
        """The share of the period that is contact; None when the contact never ends, and where two points take turns,
        as on a wheel."""
        if self.contact is None or self.contact_time is None or LANDED_FORCE in self.contact.names:
            return None
        return self.contact_time / self.period

    @property
    def restitution(self) -> float:
        """The coefficient of restitution of the machine's impacts."""
        return float(self.machine.get("restitution") or 0.0)

    @property
    def loop_energy(self) -> float | None:
        """The energy that a hop with this launch speed loses on the measured loop of the machine's spring; None for a
        spring without a loop, for a hop without a next launch, and without the machine."""
        try:
            return self.upkeep_on_loop and self.upkeep_on_loop.energy
        except OrbitsError:
            return None

    @cached_property
    def upkeep_on_loop(self) -> Any:
        """What keeps the machine hopping on the measured loop of its spring, an `Upkeep`; None for a spring without a
        loop, and without the machine. Raises `NoOrbit` where the hop has no next launch there."""
        return getattr(self.source, "on_loop", lambda alpha: None)(self.alpha)

    @property
    def mean_speed(self) -> float | None:
        """The step over the period; None for a machine that does not move along the ground, and without a period."""
        return None if self.step is None or self.contact_time is None else self.step / self.period

    @property
    def half_stance(self) -> float | None:
        """Half the time for which a machine with limbs stands on one foot; None for others."""
        stands = self.shape.segments and self.certificate.smallest_stance_force is not None
        return self.flight_time / 2 if stands else None

    @property
    def half_double_stance(self) -> float | None:
        """Half the time for which a machine with limbs stands on both; None for others, and where that never ends."""
        return self.contact_time / 2 if self.half_stance and self.contact_time else None

    @property
    def rates(self) -> list[float] | None:
        """The rates of the limbs' angles in mid-flight, in the order of `Mechanism(segments=)`; None without limbs."""
        rates = self.state_mid_flight[1::2]
        return [float(rates @ np.array(each[::2])) for each in self.shape.segments.values()] or None

    @property
    def cost_of_transport(self) -> float | None:
        """The lost energy over the weight and the distance, which is 0; None for a machine that does not move along the
        ground."""
        return None if self.step is None else 0.0

    @cached_property
    def rises(self) -> dict[str, float]:
        """The largest rise of each height in flight, above its value at lift-off, by name."""
        found = dict[str, float]()
        for name, height in self.shape.heights.items():
            each = [height.series(c) for c in self._halves(self.flight)]
            found[name] = float(max(-lowest(-c, self.flight.steps)[0] for c in each) - each[0][0, 0])
        return found

    def _halves(self, path: Trajectory) -> list[np.ndarray]:
        """The coefficients of one of the motions, and of its image where that has other places."""
        image = self.shape.images(path.coefficients, path is self.contact)
        return [path.coefficients] if image is None else [path.coefficients, image]

    @cached_property
    def stroke(self) -> float | None:
        """The range of the extension over the cycle; None where the contact never ends, and in older files."""
        if self.shape.extension is None or self.contact is None or self.contact_time is None:
            return None
        weights, ends = np.array(self.shape.extension), list[float]()
        for path, own in ((self.flight, weights), (self.contact, weights @ self.shape.embed)):
            series = [Affine(tuple(own.tolist())).series(c) for c in self._halves(path)]
            ends += [sign * lowest(sign * c, path.steps)[0] for c in series for sign in (1, -1)]
        return max(ends) - min(ends)

    @property
    def apexes(self) -> dict[str, float]:
        """The largest height of each of these in flight, above the ground, by name. None without a separation, since
        heights need the lengths of the machine."""
        if self.certificate.smallest_separation is None:
            return {}
        first = self.flight.coefficients[:1]
        heights = self.shape.heights.items()
        return {name: self.rises[name] + float(height.series(first)[0, 0]) for name, height in heights}

    @property
    def numbers(self) -> dict[str, Any]:
        """The fields and the quantities of the orbit by name; None for a quantity that it does not have."""
        known = vars(self.certificate) | vars(self) | {"period": self.contact_time and self.period}
        return known | {
            name: getattr(self, name) for name in (*DERIVED, *(FIELDS_OF_RUNS if self.step is not None else ()))
        }

    @property
    def state_mid_flight(self) -> np.ndarray:
        """Flight state (n,) at the middle of the flight."""
        return self(self.flight_time / 2)

    def __call__(self, t: ArrayLike) -> np.ndarray:
        """Flight states (..., n) at times `t` (...): any time, or 0 <= t <= flight_time where there is no period.

        For a machine that steps they are in the labels of the present stance. Raises `InputError` for other times, and
        for anything but numbers.
        """
        times, shape = finite_times(t), self.shape
        back, there = (shape.steps.reversor_shift, shape.steps.contact_shift) if shape.steps else (None, None)
        if self.contact is None or self.contact_time is None:
            # The end of the flight may be requested by a rounded time.
            if times.size and not (times.min() >= 0 and times.max() <= self.flight_time * (1 + 1e-12)):
                unit = " s" if self.scales else ""
                raise InputError(f"the contact never ends: times lie between 0 and {self.flight_time:g}{unit}")
            return mirrored(self.flight, times, self.flight_time, shape.reversor, back)
        times = np.mod(times, self.period)
        flying = mirrored(self.flight, times, self.flight_time, shape.reversor, back)
        since = times - self.flight_time
        standing = mirrored(self.contact, since, self.contact_time, shape.contact_reversor, there)
        standing = standing[..., : shape.embed.shape[1]] @ shape.embed.T
        return np.where((times <= self.flight_time)[..., None], flying, standing)

    def unrolled(self, t: ArrayLike) -> np.ndarray:
        """Flight states (..., n) at times `t` (...) in the labels of the first flight: for a machine that steps they
        continue smoothly from step to step. Raises `InputError` as a call does."""
        states, times = self(t), np.asarray(t, dtype=float)
        if self.contact_time is None:
            return states
        cycles, since = np.divmod(times, self.period)
        return self.shape.unrolled(states, cycles + (since > self.flight_time))

    def contact_force(self, t: ArrayLike, *, landed: bool = False) -> np.ndarray:
        """The contact force (...) at times `t` (...), positive where it presses; 0 in flight.

        landed : for a machine that steps, whether to return the force on the point that has landed, instead of the
            force on the point that opens next

        Raises `InputError` for times at which the orbit has no states, and for a motion that was saved without its
        force.
        """
        self(t)  # refuses times
        if self.contact is None or self.contact_time is None:
            return np.zeros(np.shape(t))
        row, image = (LANDED_FORCE, CONTACT_FORCE) if landed else (CONTACT_FORCE, LANDED_FORCE)
        image = image if LANDED_FORCE in self.contact.names else row
        if row not in self.contact.names:
            raise InputError(f"this orbit has no contact force of this name; it has {', '.join(self.contact.names)}")
        since = np.mod(np.asarray(t, dtype=float), self.period) - self.flight_time
        later = (since > self.contact.times[-1]) & (self.shape.contact_reversor is not None)
        inside = np.clip(np.where(later, self.contact_time - since, since), 0, self.contact.times[-1])
        first, second = (self.contact(inside)[..., self.contact.names.index(name)] for name in (row, image))
        return np.where(since > 0, np.where(later, second, first), 0.0)

    def spring_forces(self, t: ArrayLike) -> dict[str, np.ndarray]:
        """The force (...) of each spring at times `t` (...), tension positive, by name: "spring force", or for several
        springs "spring force of y1 - y2" with their extensions. A spring along an angle has a torque.

        Raises `InputError` for times at which the orbit has no states, and for an orbit without its machine, such as
        one from a file that was read without it.
        """
        if self.source is None:
            raise InputError("the springs' forces need the machine: pass it, Orbit.load(path, machine)")
        return spring_forces(self.source, self(t))

    def document(self) -> Document:
        mid = self.state_mid_flight
        if self.shape.reversor:  # the states with the other sign vanish there
            mid = mid[np.array(self.shape.reversor) > 0]  # or are those of its centre
        figures = self.numbers | {"violations": list(self.violations), "skipped": list(self.skipped)}
        figures["state_mid_flight"] = mid.tolist()
        document = {**self.machine, **{name: figures[name] for name in DOCUMENT_FIELDS}}
        document |= {name: figures[name] for name in FIELDS_OF_STEPS} if self.shape.steps else {}
        document |= {name: getattr(self, name) for name in FIELDS_OF_LIMBS} if self.shape.segments else {}
        document |= {} if self.step is None else {name: figures[name] for name in FIELDS_OF_RUNS}
        tuned = {"tuned": self.tuned, "tuned_errors": dict(self.tuned_errors), "prescribed": dict(self.prescribed)}
        document |= tuned if self.tuned_errors else {}
        if not self.scales:
            return document
        units = {name: unit for name, unit in self.scales.texts().items() if name in document}
        signs = self.shape.reversor or [-1 if name.endswith("'") else 1 for name in self._states]
        own = dict.fromkeys(self.scales.text(name) for name, sign in zip(self._states, signs, strict=True) if sign > 0)
        units |= {"rises": "m", "apexes": "m", "state_mid_flight": ", ".join(own)}
        return document | {"units": {**self.machine.get("units", {}), **units}, "si": self.si()}

    def si(self) -> dict[str, float | None]:
        """The main results in SI units, by names that end in their units; raises `InputError` for a machine without SI
        units."""
        if self.scales is None:
            raise InputError("this machine was stated in dimensionless units; state it in SI for results in SI")
        figures, units = self.numbers, self.scales.texts()
        main = [name for name, each in (QUANTITIES | OF_RUNS).items() if each.in_si and name in figures]
        after = {name: f"_{units[name].replace('/', '_per_')}" if name in units else "" for name in main}
        return {
            **{f"{name}{after[name]}": figures[name] for name in main},
            **{f"{name.replace(' ', '_')}_rise_m": rise for name, rise in self.rises.items()},
            **{f"{name.replace(' ', '_')}_apex_m": apex for name, apex in self.apexes.items()},
            "unit_length_m": self.scales.length,
            "unit_time_s": self.scales.time,
            "unit_force_N": self.scales.force,
        }

    @property
    def units(self) -> dict[str, str]:
        """The units of the quantities, states and parameters by name; empty for a dimensionless machine."""
        if self.scales is None:
            return {}
        known = {name: self.scales.text(name) for name in self._states} | {
            "time": "s", "contact force": self.scales.text("largest_contact_force")
        }  # fmt: skip
        known |= units_of_springs(self.source) if self.source else {}
        heights = dict.fromkeys(("rises", "apexes"), "m")
        return {**self.scales.texts(), **known, **heights, **self.machine.get("units", {})}

    @property
    def _states(self) -> tuple[str, ...]:
        return self.flight.names[: len(self.shape.embed)]

    def table(self, t: ArrayLike | None = None) -> dict[str, np.ndarray]:
        """Columns (k,) by name at times (k,), evenly spaced over a cycle by default: "time", "phase", the flight
        states, the `spring_forces` where the orbit has its machine, and the "contact force" where the motion has it."""
        end = self.flight_time if self.contact_time is None else self.period
        t = np.linspace(0.0, end, TABLE_ROWS) if t is None else np.ravel(finite_times(t))
        flying = t <= self.flight_time if self.contact_time is None else np.mod(t, self.period) <= self.flight_time
        columns = {"time": t, "phase": np.where(flying, "flight", "contact")}
        columns |= dict(zip(self._states, self(t).T, strict=True))
        columns |= self.spring_forces(t) if self.source else {}
        if self.contact is None or CONTACT_FORCE in self.contact.names:
            columns["contact force"] = self.contact_force(t)
        return columns

    def _line(self) -> dict[str, object]:
        shown = {name: getattr(self, name) for name in ("family", "alpha", "admissible", "error")}
        shown |= {name: self.machine[name] for name in ("spring", "gravity")} | self.machine["parameters"]
        return {"machine": self.machine["machine"], **shown}

    def title(self) -> str:
        return f"lossless orbit of family {self.family}: {title_of_machine(self.machine)}"

    def _rows(self) -> Iterator[Row]:
        return rows_of_orbit(self)

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot heights against time, as in Fig. 3 of the paper, or, for a machine with a drawing in the plane, pictures
        at several instants; returns the axes."""
        if getattr(self.source, "drawing", None) is not None:
            return shown("plane").plot_in_plane(self, axes)
        return shown("plot").plot_orbit(self, axes)

    def plot_phase_portrait(self, axes: Axes | None = None) -> Axes:
        """Plot speed against height over a cycle; returns the axes."""
        return shown("plot").plot_phase_portrait(self, axes)

    def animate(self, path: str | Path, frames: int = 80, *, progress: Progress = None) -> Path:
        """Write an animation of one cycle (.gif or .mp4); returns its path."""
        return shown("animation").animate_orbit(self, path, frames, progress)

    def export(self, folder: str | Path, t: ArrayLike | None = None) -> Path:
        """Write the motion to a folder for robot simulators; makes the folder if it is missing, and returns its path.

        "motion.csv" has the places and then the speeds of the joints at times `t`, by default over a cycle, or some of
        a machine that moves on; "model.xml" is the machine's model for MuJoCo, whose joints have the same order, and
        "springs_for_drake.py" adds its springs to a plant in Drake. The model has no ground that touches; it names what
        is left out, and the error of springs that are not cubics.

        Raises `InputError` for a machine that is not a column of masses and states no `bodies`, for an orbit without
        its machine, and where the folder cannot be written to.
        """
        return shown("simulators").export_orbit(self, folder, t)

    def page(self, path: str | Path) -> Path:
        """Write a page in one file (.html) that needs no network, with the animated machine, the certificate, heights,
        phase portrait, contact force and, if the orbit has its machine, the spring's law; returns its path.

        Raises `InputError` for a bad path, and without Bokeh.
        """
        return shown("pages.saved_page").orbit_page(self, path)

    def saved(self) -> Document:
        """The content of a file of the orbit, from which `of_saved` restores it."""
        bare = self.dimensionless()
        flight, contact = (path and path.saved() for path in (bare.flight, bare.contact))
        units = self.scales and self.scales.saved()
        motion = {"shape": bare.shape.saved(), "flight": flight, "contact": contact, "units": units}
        document = self.document() | ({"bare": bare.document()} if self.scales else {})
        return {"format": self.form(), **document, "motion": motion}

    @classmethod
    def _read(cls, machine: Machine | None, file: BinaryIO) -> "Orbit":
        """The orbit in an open file. A changed file is refused, but is still a start for `find`, which solves again."""
        try:
            document = parse_json(file.read())
            document = unsealed(document) if has_digest(document, file.name) else document
        except Changed as error:
            raise ValueError(f"{error}; find(machine, start=FILE) does so") from None
        orbit = cls.of_saved(document)
        check_consistent(orbit.document(), document)
        if machine is None:
            return orbit
        machine = is_of(machine, orbit.machine)
        if not is_orbit_of(orbit, machine):
            raise ValueError(f"it belongs to another machine: {OTHER_EQUATIONS}")
        return replace(orbit, source=machine)

    @classmethod
    def of_saved(cls, document: object, machine: Machine | None = None) -> "Orbit":
        """The orbit from what `saved` returned; raises `ValueError` where its parts contradict each other."""
        data = cls._conform(document, SavedOrbit)
        units = data["motion"]["units"] and saved_units(data["motion"]["units"])
        if units is None:
            return cls(**stated_fields(data))
        if "units" not in data:  # Version 0.1.0 had no results in SI: the numbers are dimensionless.
            orbit = cls(**stated_fields(data))
            orbit = replace(orbit, certificate=with_note(orbit.certificate))
            return orbit_in_units(orbit, units, orbit.machine)
        # The motion is that of the dimensionless orbit.
        bare = cls._conform({**data["bare"], "format": cls.form(), "motion": data["motion"]}, SavedOrbit)
        orbit = orbit_in_units(cls(**stated_fields(bare)), units, machine_in_document(data))
        if len(data["violations"]) != len(orbit.violations):
            raise ValueError("its violations in SI and without units differ in number")
        own = {"tuned_errors": saved_tuned_errors(data), "prescribed": data.get("prescribed", {})}
        return replace(orbit, certificate=replace(orbit.certificate, violations=tuple(data["violations"])), **own)


def start_in_file(path: str | Path) -> Orbit:
    """The orbit in a file, also if the file was changed after it was written: it is to be used as a start for `find`
    only, since none of its numbers are reliable."""

    def parsed(file: BinaryIO) -> Orbit:
        document = parse_json(file.read())
        return Orbit.of_saved({name: value for name, value in document.items() if name != DIGEST})

    return read_file(path, f"{path} is not a saved orbit", parsed)


def is_orbit_of(orbit: Orbit, machine: Machine) -> bool:
    """Whether an orbit's motion is one of a machine: a table, say, may have changed under the same name."""
    bare, own = orbit.dimensionless(), dimensionless(machine)
    parts = ((bare.flight, own.model.flight), (bare.contact, own.model.contact))
    return all(is_motion_of(path, phase, own.values) for path, phase in parts if path)


def orbit_of(machine: Machine, orbit: Orbit) -> Orbit:
    """A dimensionless orbit of a machine in the machine's own units: in SI for a machine in SI."""
    if machine.units is None:
        return orbit
    return replace(orbit_in_units(orbit, machine.units, machine_in_words(machine)), source=machine)


def orbit_in_units(orbit: Orbit, units: Units, machine: Mapping[str, object]) -> Orbit:
    """A dimensionless orbit in SI, of the machine in words and numbers."""
    states = orbit.flight.names[: len(orbit.shape.embed)]
    heights = {name: units.convert_height(height, states) for name, height in orbit.shape.heights.items()}
    knees = tuple((lower, upper, length * units.length) for lower, upper, length in orbit.shape.knees)
    shape = orbit.shape.in_units(units.of_states(states))
    return replace(
        units.convert(orbit),
        machine=machine,
        flight=units.convert_motion(orbit.flight),
        contact=orbit.contact and units.convert_motion(orbit.contact),
        shape=replace(shape, heights=heights, knees=knees),
        certificate=certificate_in_units(orbit.certificate, units),
        scales=units,
        bare=orbit,
        source=None,
    )


def certificate_in_units(certificate: Certificate, units: Units) -> Certificate:
    """A dimensionless certificate in these units."""
    violations = tuple(in_units(violation, units) for violation in certificate.violations)
    return replace(units.convert(certificate), violations=violations)
