"""Disturbed launches of a machine with a feedback, simulated with its limits, delay and noise: which come back, and at
what cost."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, NoOrbit, finite_number, whole_number
from ..hops import Impacts, LaunchSection, Simulation, simulate
from ..model import machine_in_words
from ..numerics import GAUSS_PLACES, GAUSS_WEIGHTS
from ..result import Axes, Progress, Result, Row, reported, shown
from ..running import interrupts
from ..units import LIFTOFF_SPEED
from .held_cycle import Launches
from .held_limits import Demand

if TYPE_CHECKING:
    from .holding import Hold


@dataclass(frozen=True, eq=False, repr=False)
class HeldLaunches(Result, what="held launches", dimension="launch", in_line=("share", "when")):
    """Launches of a machine that a feedback holds; in SI for a machine in SI.

    source : the machine
    when : the decisions of the feedback
    delay, noise : of its measurements; the noise is the deviation of each state as a share of its range
    within : the relative error of the launch speed below which a launch has come back
    errors : (m,), the relative errors of the launch speeds at first
    statuses : how the simulations ended
    speeds : (m, hops + 1), the launch speeds, NaN after the end
    off : (m, hops + 1), the largest change of a launch, as a share of the launch speed in the sizes of the cycle
    work : (m,), the positive work of the actuator per hop
    force, power : (m,), the largest ones
    exceeded : the limits that were exceeded, "" for none
    moduli, held_moduli : (d,), of the multipliers without and with the feedback
    """

    source: Any
    when: str
    delay: float
    noise: float
    within: float
    errors: np.ndarray
    statuses: tuple[str, ...]
    speeds: np.ndarray
    off: np.ndarray
    work: np.ndarray
    force: np.ndarray
    power: np.ndarray
    exceeded: tuple[str, ...]
    moduli: np.ndarray
    held_moduli: np.ndarray

    machine = property(lambda self: machine_in_words(self.source))

    @cached_property
    def units(self) -> Mapping[str, str]:
        """The units of the columns by name; empty for a dimensionless machine."""
        if self.source.units is None:
            return {}
        return {"work per hop": "J", "largest force": "N", "largest power": "W", "speeds": "m/s"}

    @property
    def returned(self) -> np.ndarray:
        """Whether (m,) each launch has come back at the end of the last hop, without ever exceeding the limits."""
        done = np.array([status == "done" for status in self.statuses])
        obeyed = np.array([not names for names in self.exceeded])
        return done & obeyed & (self.off[:, -1] <= self.within)

    @property
    def share(self) -> float:
        """The share that comes back."""
        return float(self.returned.mean())

    @property
    def hops(self) -> np.ndarray:
        """The number of hops (m,) after which each has come back; NaN where it does not."""
        away = ~(self.off <= self.within)
        last = np.where(away.any(1), away.shape[1] - np.argmax(away[:, ::-1], axis=1), 0)
        return np.where(self.returned, last, np.nan)

    def title(self) -> str:
        return f"{int(self.returned.sum())} of {len(self.errors)} launches come back, inputs decided {self.when}"

    def table(self) -> dict[str, Any]:
        """A row for each launch."""
        return {
            "launch error": self.errors, "returned": self.returned, "hops": self.hops, "last error": self.off[:, -1],
            "work per hop": self.work, "largest force": self.force, "largest power": self.power,
        }  # fmt: skip

    def heads(self) -> list[str]:
        return ["launch error", "hops", *map(self.heading, ("work per hop", "largest force", "largest power"))]

    def _rows(self) -> Iterator[Row]:
        for i, error in enumerate(self.errors.tolist()):
            hops = f"{self.hops[i]:.0f}" if self.returned[i] else self.exceeded[i] or self.statuses[i]
            hops = "not back" if hops == "done" else hops
            numbers = {"work": self.work, "force": self.force, "power": self.power}
            values = {f"hops {i}": hops, **{f"{name} {i}": float(column[i]) for name, column in numbers.items()}}
            yield Row(f"{error:+.4g}", values, ("{}", "{:.4g}", "{:.4g}", "{:.4g}"))

    def _notes(self) -> list[str]:
        held = ", ".join(f"{modulus:.4g}" for modulus in self.held_moduli)
        notes = [f"multipliers with the feedback: modulus {held}"]
        if self.noise:
            notes.append(f"with noise of {self.noise:.3g} of the range of each state")
        return notes

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the error of each launch, hop after hop; returns the axes."""
        return shown("launch_figures").plot_held_launches(self, axes)


class _Noisy:
    """A feedback whose measurements have noise of these deviations (n,)."""

    def __init__(self, held: "Hold", deviations: np.ndarray, rng: np.random.Generator):
        self.name, self.times, self.input = held.name, held.times, held.input
        self.deviations, self.rng = deviations, rng

    def measured(self, state: np.ndarray) -> np.ndarray:
        """The flight state (n,) with noise."""
        return state + self.deviations * self.rng.standard_normal(len(state))


def held_launches(
    held: "Hold", errors: ArrayLike, hops: int, noise: float, seed: int, within: float, progress: Progress
) -> HeldLaunches:  # fmt: skip
    """The launches of `Hold.launches`, see there."""
    wanted, hops = np.atleast_1d(np.array(errors, dtype=float)), whole_number("hops", hops, "hops")
    if not (wanted.ndim == 1 and np.isfinite(wanted).all() and (wanted > -1).all()):
        raise InputError(f"errors = {errors!r}; they must be shares of the launch speed above -1, as [-0.05, 0.05]")
    if not (finite_number("noise", noise) >= 0 and finite_number("within", within) > 0):
        raise InputError(f"noise = {noise:g}, within = {within:g}: noise must be at least 0, and within above 0")
    rng, deviations = np.random.default_rng(seed), noise * np.ptp(held.states, axis=0)
    if held.cycle.kind != "force":
        deviations[-1] = 0.0  # the actuator knows its own state
    section = LaunchSection(Impacts(held.cycle.machine), held.cycle.units)
    own = section.impacts.onto_contact @ held.cycle.start
    units, rows = held.machine.units, list[dict[str, Any]]()
    for error in reported(wanted.tolist(), progress):
        interrupts.heed()
        launch = section.free(own).copy()
        launch[section.names.index("alpha")] *= 1 + error
        y = section.states(launch[None], own[[section.places[section.dependent]]])[0]
        if not np.isfinite(y).all():
            raise NoOrbit(f"no launch has its speed changed by {error:g}; choose a smaller error")
        motion = simulate(held.cycle.machine, section.unknowns_of(y), hops=hops, feedback=_Noisy(held, deviations, rng))
        rows.append(_measured(held, section, own, y, motion, hops))
    speed, force, energy, power = _sizes(held, units)
    column = lambda name: np.array([row[name] for row in rows])  # noqa: E731
    second = units.time if units else 1.0
    return HeldLaunches(
        held.machine, held.when, held.delay * second, noise, within, wanted, tuple(row["status"] for row in rows),
        speed * column("speeds"), column("off"), energy * column("work"), force * column("force"),
        power * column("power"), tuple(row["exceeded"] for row in rows), np.abs(held.multipliers),
        np.abs(held.held_multipliers),
    )  # fmt: skip


def simulated_multipliers(held: "Hold", step: float) -> np.ndarray:
    """The multipliers of `Hold.simulated_multipliers`, see there."""
    impacts = Impacts(held.cycle.machine, {**held.cycle.machine.values, held.name: held.cycle.input_after(0.0)})
    launches = Launches.of(impacts, held.cycle.units)
    own = impacts.onto_contact @ held.cycle.start

    def after(change: np.ndarray) -> np.ndarray:
        interrupts.heed()
        start = impacts.model.embed @ launches.moved(impacts, own, change)
        motion = simulate(held.cycle.machine, state=start, hops=1, feedback=held)
        if motion.status != "done":
            raise NoOrbit(f"the simulation of a launch near the cycle ends with '{motion.status}'")
        return (impacts.onto_contact @ motion.events[-1].after)[launches.free] / launches.unit

    def slopes(h: float) -> np.ndarray:
        return np.array([(after(row) - after(-row)) / (2 * h) for row in h * np.eye(len(launches.free))]).T

    coarse, middle, fine = (slopes(step / 8**i) for i in range(3))
    return by_modulus((4 * (2 * fine - middle) - (2 * middle - coarse)) / 3)


def by_modulus(matrix: np.ndarray) -> np.ndarray:
    """The eigenvalues of a matrix by falling modulus."""
    values = np.linalg.eigvals(matrix)
    return values[np.lexsort((-values.imag, -np.abs(values).round(12)))]


def _sizes(held: "Hold", units: Any) -> tuple[float, float, float, float]:
    """The units of a launch speed, of the force, of its work and of its power."""
    if units is None:
        return 1.0, 1.0, 1.0, 1.0
    kind = held.machine.dimensions["actuator force"] if hasattr(held.machine, "dimensions") else None
    force = units.force if kind is None else float(units.of(kind))
    energy = units.force * units.length
    return float(units.of(LIFTOFF_SPEED)), force, energy, energy / units.time


def _measured(
    held: "Hold", section: LaunchSection, own: np.ndarray, first: np.ndarray, motion: Simulation, hops: int
) -> dict[str, Any]:
    """The numbers of one simulation."""
    lifted = [section.impacts.onto_contact @ event.after for event in motion.events if event.kind == "lift-off"]
    launches = np.array([first, *lifted])
    sizes = section.unit * section.free(own)[section.names.index("alpha")] / section.unit[section.names.index("alpha")]
    far = np.abs((section.free(launches) - section.free(own)) / sizes).max(axis=1)
    speeds, off = np.full((2, hops + 1), np.nan)
    off[: len(far)], speeds[: len(launches)] = far, launches[:, section.places["alpha"]]
    force, speed, weights = effects_along(held, motion)
    power, (times, inputs) = force * speed, _schedule(held, motion)
    asked = Demand.of(held.cycle.kind, force, speed, inputs, motion(np.clip(times, 0.0, motion.end)))
    return {
        "status": motion.status, "speeds": speeds, "off": off, "force": np.abs(force).max(),
        "power": np.abs(power).max(), "work": float(weights @ np.maximum(power, 0.0)) / max(len(lifted), 1),
        "exceeded": ", ".join(held.bare_limits.exceeded(asked)),
    }  # fmt: skip


def _schedule(held: "Hold", motion: Simulation) -> tuple[np.ndarray, np.ndarray]:
    """The times (k + 1,) between which the inputs (k,) of a motion are constant."""
    times, inputs = motion.schedule or (np.array([0.0, motion.end]), {held.name: np.zeros(1)})
    return times, inputs[held.name]


def effects_along(held: "Hold", motion: Simulation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The force and the speed (k,) of the actuator along a motion, with the weights (k,) of a quadrature in time, which
    are 0 at the ends of its intervals."""
    times, inputs = _schedule(held, motion)
    starts = [leg.start for leg in motion.legs]
    marks = np.unique(np.concatenate([times, starts, np.linspace(0.0, motion.end, 20 * len(starts) + 1)]))
    marks = marks[(marks >= 0) & (marks <= motion.end)]
    widths = np.diff(marks)
    t = np.minimum(marks[:-1, None] + widths[:, None] * np.array([0.0, *GAUSS_PLACES, 1.0]), motion.end)
    within = np.clip(np.searchsorted(times, marks[:-1] + 0.5 * widths, side="right") - 1, 0, len(times) - 2)
    acting = np.repeat(inputs[within], t.shape[1])
    force, speed = held.cycle.effects(motion(t.ravel()), acting)
    return force, speed, (widths[:, None] * np.array([0.0, *GAUSS_WEIGHTS, 0.0])).ravel()
