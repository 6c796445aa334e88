"""A lossless orbit and its certificate: frozen results that print, evaluate, plot, save and load themselves."""

import json
from collections.abc import Mapping
from dataclasses import asdict, astuple, dataclass, field
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..flow.trajectory import Trajectory
from ..io import to_json
from ..model.model import Units
from ..model.phase import Affine
from ..numerics.bernstein import lowest
from .certificate import Certificate

ORBIT_FORMAT = "persistent-orbits orbit 1"
# What describes a machine in a document.
MACHINE_FIELDS = ("machine", "spring", "gravity", "mass_ratio", "rest_length", "restitution", "parameters", "laws_in")


@dataclass(frozen=True)
class Shape:
    """How the stored half motions make a whole cycle, and what of it to show.

    reversor, contact_reversor : signs of the states under time reversal, None where whole motions are stored
    embed : (n, m) matrix from contact to flight states
    heights : names and functions of the flight state, the masses first
    springs : names of the heights, lower and upper, that springs join, None for the ground
    """

    reversor: tuple[int, ...] | None
    contact_reversor: tuple[int, ...] | None
    embed: np.ndarray
    heights: Mapping[str, Affine]
    springs: tuple[tuple[str | None, str], ...]


@dataclass(frozen=True, eq=False)
class Orbit:
    """A lossless periodic motion: flight from time 0 to `flight_time`, then contact to `period`.

    alpha : launch speed
    liftoff_extension : of the spring, at lift-off and landing
    flight_time, contact_time : durations; contact_time None when the contact never ends
    flight, contact : the first halves, as piecewise polynomials, of which the second are mirror images in time; the
        whole where the model has no reversor
    machine : the machine in words and numbers
    method, skipped : the way taken and what this machine did not need
    seconds : wall time of the search and the certificate
    """

    machine: Mapping
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
    units: Units | None = field(default=None)

    @property
    def admissible(self) -> bool:
        """Whether it is a motion, not merely a root of the equations."""
        return not self.certificate.violations

    @property
    def violations(self) -> tuple[str, ...]:
        return self.certificate.violations

    @property
    def family(self) -> int:
        return self.certificate.family

    @property
    def error(self) -> float:
        return self.certificate.error

    @property
    def period(self) -> float:
        """Time of a whole cycle; raises `InputError` when the contact never ends."""
        if self.contact_time is None:
            raise InputError("this orbit has no period: " + "; ".join(self.violations))
        return self.flight_time + self.contact_time

    @property
    def rises(self) -> dict[str, float]:
        """How far each of the shape's heights gets above its value at lift-off, by name."""
        found = {}
        for name, height in self.shape.heights.items():
            series = height.series(self.flight.coefficients)
            found[name] = float(-lowest(-series, self.flight.steps)[0] - series[0, 0])
        return found

    @property
    def state_mid_flight(self) -> np.ndarray:
        """Flight state (n,) at the middle of the flight."""
        return self(self.flight_time / 2)

    def __call__(self, t) -> np.ndarray:
        """Flight states (..., n) at times `t` (...): any time, or 0 <= t <= flight_time where there is no period."""
        try:
            t = np.asarray(t, dtype=float)
        except (TypeError, ValueError):
            t = np.array(np.nan)
        if not np.isfinite(t).all():
            raise InputError("times must be finite numbers")
        if self.contact_time is None:
            if t.size and not (t.min() >= 0 and t.max() <= self.flight_time * (1 + 1e-12)):
                raise InputError(f"the contact never ends: times lie between 0 and {self.flight_time:g}")
            return _rows_at(self.flight, np.minimum(t, self.flight_time), self.flight_time, self.shape.reversor)
        t = np.mod(t, self.period)
        flying = _rows_at(self.flight, np.minimum(t, self.flight_time), self.flight_time, self.shape.reversor)
        standing = _rows_at(
            self.contact,
            np.clip(t - self.flight_time, 0, self.contact_time),
            self.contact_time,
            self.shape.contact_reversor,
        )
        standing = standing[..., : self.shape.embed.shape[1]] @ self.shape.embed.T
        return np.where((t <= self.flight_time)[..., None], flying, standing)

    def document(self) -> dict:
        """The orbit as the JSON document of the command line."""
        c = self.certificate
        mid = self.state_mid_flight
        if self.shape.reversor:  # the others vanish
            mid = mid[np.array(self.shape.reversor) > 0]
        document = {
            **self.machine,
            "family": c.family,
            "alpha": self.alpha,
            "flight_time": self.flight_time,
            "contact_time": self.contact_time,
            "admissible": self.admissible,
            "violations": list(c.violations),
            "residual": c.residual,
            "error": c.error,
            "energy_drift": c.energy_drift,
            "clearance": c.clearance,
            "smallest_separation": c.smallest_separation,
            "smallest_contact_force": c.smallest_contact_force,
            "largest_contact_force": c.largest_contact_force,
            "rises": self.rises,
            "landing_jerk": c.landing_jerk,
            "loss_coefficient": c.loss_coefficient,
            "stable_side": c.stable_side,
            "unfolding": c.unfolding,
            "liftoff_extension": self.liftoff_extension,
            "state_mid_flight": [float(value) for value in mid],
            "method": self.method,
            "skipped": list(self.skipped),
            "seconds": self.seconds,
        }
        if self.units:
            document["si"] = self.si()
        return document

    def si(self) -> dict[str, float | None]:
        """The main results in SI units; raises `InputError` for a machine that was stated without."""
        if self.units is None:
            raise InputError("this machine was stated in dimensionless units; state it in SI for results in SI")
        length, time, force = self.units.length, self.units.time, self.units.force
        c = self.certificate
        return {
            "launch_speed_m_per_s": self.alpha * length / time,
            "flight_time_s": self.flight_time * time,
            "contact_time_s": self.contact_time and self.contact_time * time,
            "liftoff_extension_m": self.liftoff_extension * length,
            "clearance_m": c.clearance and c.clearance * length,
            "smallest_separation_m": c.smallest_separation and c.smallest_separation * length,
            "largest_contact_force_N": c.largest_contact_force and c.largest_contact_force * force,
            **{f"{name.replace(' ', '_')}_rise_m": rise * length for name, rise in self.rises.items()},
            "unit_length_m": length,
            "unit_time_s": time,
            "unit_force_N": force,
        }

    def __str__(self) -> str:
        c, machine = self.certificate, self.machine
        length, time, force = astuple(self.units) if self.units else (None, None, None)

        def row(name, value, scale=None, unit=""):
            text = "-" if value is None else f"{value:.15g}" if isinstance(value, float) else str(value)
            extra = f"   ({value * scale:.6g} {unit})" if scale and value is not None else ""
            return f"  {name:<24}{text}{extra}"

        what = f"{machine['machine']}, spring {machine['spring']}, gravity {machine['gravity']}"
        numbers = {"mass ratio": machine["mass_ratio"], "rest length": machine["rest_length"], **machine["parameters"]}
        values = ", ".join(f"{name} = {value:g}" for name, value in numbers.items() if value is not None)
        lines = [
            f"lossless orbit of family {c.family}: {what}",
            f"  {values}",
            row("alpha", self.alpha, length and length / time, "m/s") + f"   +- {c.error:.1e}",
            row("flight time", self.flight_time, time, "s"),
            row("contact time", self.contact_time, time, "s"),
            row("lift-off extension", self.liftoff_extension, length, "m"),
            row("clearance", c.clearance, length, "m"),
            row("smallest separation", c.smallest_separation, length, "m"),
            *(row(f"rise of {name}", value, length, "m") for name, value in self.rises.items()),
            row("smallest contact force", c.smallest_contact_force, force, "N"),
            row("largest contact force", c.largest_contact_force, force, "N"),
            row("landing jerk", c.landing_jerk),
            row("loss coefficient C", c.loss_coefficient)
            + (f"   (attracts from {c.stable_side})" if c.stable_side else ""),
            f"  {'residual':<24}{c.residual:.1e}",
            f"  {'energy drift':<24}{c.energy_drift:.1e}",
            f"  {'found by':<24}{self.method}, {1e3 * self.seconds:.1f} ms",
            f"  {'admissible':<24}{'yes' if self.admissible else 'NO'}",
            *(f"      {violation}" for violation in c.violations),
        ]
        return "\n".join(lines)

    def plot(self, axes=None):
        """Plot heights against time as in Fig. 3 of the paper; returns the axes. See `orbits.plot.plot_orbit`."""
        from ..plot import plot_orbit

        return plot_orbit(self, axes)

    def plot_phase_portrait(self, axes=None):
        """Plot speed against height over a cycle; returns the axes."""
        from ..plot import plot_phase_portrait

        return plot_phase_portrait(self, axes)

    def animate(self, path, frames: int = 80) -> Path:
        """Write an animation of one cycle (GIF); returns its path."""
        from ..plot import animate_orbit

        return animate_orbit(self, path, frames)

    def save(self, path) -> Path:
        """Write the orbit to a JSON file, every float with 17 significant digits; returns the path."""
        shape = {
            "reversor": self.shape.reversor,
            "contact_reversor": self.shape.contact_reversor,
            "embed": self.shape.embed.tolist(),
            "heights": {name: [h.weights, h.offset] for name, h in self.shape.heights.items()},
            "springs": self.shape.springs,
        }
        motion = {
            "shape": shape,
            "flight": _path_document(self.flight),
            "contact": self.contact and _path_document(self.contact),
            "units": self.units and asdict(self.units),
        }
        path = Path(path)
        try:
            path.write_text(
                to_json({"format": ORBIT_FORMAT, **self.document(), "motion": motion}) + "\n", encoding="utf-8"
            )
        except (OSError, ValueError) as error:
            raise InputError(f"the orbit cannot be saved to {path}: {error}") from None
        return path

    @classmethod
    def load(cls, path) -> "Orbit":
        """Read an orbit that `save` wrote; raises `InputError` when the file is not one."""
        try:
            data = json.loads(Path(path).read_text(encoding="utf-8"))
            if data["format"] != ORBIT_FORMAT:
                raise ValueError(f"format {data['format']!r}, expected {ORBIT_FORMAT!r}")
            motion = data["motion"]
            shape = motion["shape"]
            names = {name: data[name] for name in Certificate.__dataclass_fields__ if name != "violations"}
            return cls(
                machine={name: data[name] for name in MACHINE_FIELDS},
                **{name: _float_of(data[name]) for name in ("alpha", "liftoff_extension", "flight_time")},
                contact_time=data["contact_time"] and _float_of(data["contact_time"]),
                flight=_path_of(motion["flight"]),
                contact=motion["contact"] and _path_of(motion["contact"]),
                shape=Shape(
                    shape["reversor"] and tuple(shape["reversor"]),
                    shape["contact_reversor"] and tuple(shape["contact_reversor"]),
                    np.array(shape["embed"]),
                    {name: Affine(tuple(weights), offset) for name, (weights, offset) in shape["heights"].items()},
                    tuple(map(tuple, shape["springs"])),
                ),
                certificate=Certificate(**names, violations=tuple(data["violations"])),
                method=data["method"],
                skipped=tuple(data["skipped"]),
                seconds=data["seconds"],
                units=motion["units"] and Units(**motion["units"]),
            )
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(f"{path} is not a saved orbit: {error}") from None


def _rows_at(path: Trajectory, t, duration: float, signs) -> np.ndarray:
    """Rows at times `t` of a motion whose first half is `path` and whose second is its image under `signs`, if any."""
    if signs is None:
        return path(t)
    later = t > path.times[-1]
    states = path(np.where(later, duration - t, t))[..., : len(signs)]
    return np.where(later[..., None], states * np.array(signs), states)


def _path_document(path: Trajectory) -> dict:
    return {"names": path.names, "times": path.times, "coefficients": path.coefficients}


def _path_of(data: dict) -> Trajectory:
    path = Trajectory(np.array(data["times"]), np.array(data["coefficients"]), tuple(data["names"]))
    steps, rows, _ = path.coefficients.shape
    if len(path.times) != steps + 1 or rows != len(path.names) or not (path.steps > 0).all():
        raise ValueError("its motion is damaged")
    return path


def _float_of(value) -> float:
    if not isinstance(value, float):
        raise ValueError(f"{value!r} is not a number")
    return value
