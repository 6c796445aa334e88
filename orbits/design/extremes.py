"""Where the extremes of a design lie on many orbits: bracketed by samples, then found exactly."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..flow import Trajectories, flow_of
from ..model import Machine, Model
from ..numerics import Array, enclosed_sign_changes, evaluate, powers
from ..periodic import STATIONARY, Orbit
from ..shooting import vector
from ..symbolic import ElementwiseFunction, cached
from .design_quantities import LOCAL, extreme_of

# An extreme whose largest sample is less than another's by this share may be larger between its samples.
NEARLY_LARGEST = 1e-3
SAMPLES_PER_STEP = 24  # samples per step of a trajectory by which an extreme is bracketed before it is found exactly


class Kind(NamedTuple):
    """The kind of the place of an extreme: its name, the index of its function with the largest value, and "start",
    "middle" or "inside" of half the phase."""

    extreme: str
    function: int
    where: str


class Place(NamedTuple):
    """The place of an extreme, and its time from the start of the phase."""

    kind: Kind
    time: float


def places_of(
    machines: Sequence[Machine], orbits: Sequence[Orbit], extremes: Iterable[str]
) -> list[dict[str, Place | None]]:
    """By extreme its places on dimensionless orbits (m,), whose contacts end, of machines (m,) of one model, None where
    there is none."""
    model, found = machines[0].model, [dict[str, Place | None]() for _ in orbits]
    halves = {phase: Trajectories.of([getattr(orbit, phase) for orbit in orbits]) for phase in ("flight", "contact")}
    for extreme in extremes:
        for own in found:
            own[extreme] = None
        # A foot that lifts needs no number of friction, however large.
        lifts = [extreme == "slip" and orbit.certificate.friction_needed is None for orbit in orbits]
        largest = np.where(lifts, np.inf, -np.inf)
        for index, (phase, _) in enumerate(extreme_of(model, extreme)):
            sampled = _Sampled(halves[phase], machines, extreme, index)
            values = np.where(sampled.peaks if extreme in LOCAL else ~sampled.goes_on, sampled.values, -np.inf)
            highest, sample = values.max(1), values.argmax(1)
            known = np.isfinite(largest)
            near = np.where(known, NEARLY_LARGEST * np.abs(np.where(known, largest, 0.0)), 0.0)
            likely = (highest > largest - near).nonzero()[0]
            places, exact = sampled.places(likely, sample[likely])
            for i, place, value in zip(likely.tolist(), places, exact.tolist(), strict=True):
                if value > largest[i]:
                    found[i][extreme], largest[i] = place, value
    return found


def place_near(machine: Machine, orbit: Orbit, place: Place) -> Place:
    """The place of a local extreme on a machine's orbit that is nearest to a place of its function."""
    extreme, index, where = place.kind
    phase, _ = extreme_of(machine.model, extreme)[index]
    sampled = _Sampled(Trajectories.of([getattr(orbit, phase)]), [machine], extreme, index)
    peaks = sampled.peaks[0].nonzero()[0]
    near = sampled.places(0 * peaks, peaks)[0] if where == "inside" else ()
    return min(near, key=lambda each: abs(each.time - place.time), default=place)


def peaks_of(machine: Machine, orbit: Orbit, extreme: str) -> list[tuple[float, Place]]:
    """All places of a machine's dimensionless orbit at which one of the functions of an extreme has a local maximum,
    with the values there, the largest first; a place may occur in several functions."""
    found = list[tuple[float, Place]]()
    for index, (phase, _) in enumerate(extreme_of(machine.model, extreme)):
        sampled = _Sampled(Trajectories.of([getattr(orbit, phase)]), [machine], extreme, index)
        peaks, ends = sampled.peaks[0].copy(), [0, int(sampled.counts[0])]
        if extreme not in LOCAL:
            beside = sampled.values[0, [1, ends[1] - 1]]
            peaks[ends] |= (sampled.values[0, ends] >= beside) & ~sampled.goes_on[0, ends]
        samples = np.flatnonzero(peaks & np.isfinite(sampled.values[0]))
        places, values = sampled.places(0 * samples, samples)
        found += zip(values.tolist(), places, strict=True)
    return sorted(found, key=lambda each: -each[0])


class _Sampled:
    """A function of an extreme on motions of machines (m,) of one model.

    values, rates : (m, samples) at equal shares of the steps, -inf beyond the end of each motion
    counts : (m,), the last sample of each motion
    still : (m,), whether the function is stationary in the middle, as functions of positions are that have the same
        values in both halves
    goes_on : (m, samples), whether a sample is the middle, and the function rises beyond it
    """

    def __init__(self, paths: Trajectories, machines: Sequence[Machine], extreme: str, index: int):
        ps = np.array([vector(machine.values) for machine in machines])
        self.function = _elementwise(machines[0].model, tuple(machines[0].values), extreme, index)
        self.paths, self.ps, self.kind, self.size = paths, ps, (extreme, index), self.function.function.numel_in(0)
        phase = getattr(machines[0].model, extreme_of(machines[0].model, extreme)[index][0])
        self.flow = flow_of(phase, tuple(machines[0].values))
        self.counts = SAMPLES_PER_STEP * paths.counts
        times = paths.steps[:, None] * (np.arange(SAMPLES_PER_STEP) / SAMPLES_PER_STEP)
        c = paths.coefficients[:, : self.size]
        states = np.einsum("nrk,nsk->nsr", c, powers(times, c.shape[2])).reshape(-1, self.size)
        of_samples = np.concatenate([ps[paths.owner].repeat(SAMPLES_PER_STEP, axis=0), ps])
        columns = self._at(np.concatenate([states, paths.finals[:, : self.size]]), of_samples)
        inside, count = np.arange(self.counts.max()) < self.counts[:, None], len(ps)
        self.values, self.rates = tables = np.full((2, count, self.counts.max() + 1), -np.inf)
        for table, column in zip(tables, columns, strict=False):
            table[:, :-1][inside] = column[:-count, 0]
            table[np.arange(count), self.counts] = column[-count:, 0]
        if extreme == "slip" and vanishes_at_start(machines[0].model, index):
            begun = c[paths.first, :, 0]
            start = ElementwiseFunction(start_function(machines[0].model, tuple(machines[0].values), extreme, index))
            self.values[:, 0] = start(begun, ps, self.flow.data_of_pieces(begun, ps))[0][:, 0]
        rates, known = self.rates[np.arange(count), self.counts], np.isfinite(self.values)
        sizes = np.abs(self.values, out=np.zeros_like(self.values), where=known).max(1)
        self.still = machines[0].model.plain | (np.abs(rates) * paths.ends <= STATIONARY * sizes)
        self.goes_on = (np.arange(tables.shape[2]) == self.counts[:, None]) & ~(self.still | (rates <= 0))[:, None]

    def _at(self, states: Array, ps: Array) -> list[Array]:
        """The results of the function at states (k, size) of machines with parameters (k, np)."""
        return self.function(states, ps, self.flow.data_of_pieces(states, ps))

    @property
    def peaks(self) -> Array:
        """Whether each value (m, samples) is larger than the one before and no less than the next."""
        with np.errstate(invalid="ignore"):
            rises = np.diff(self.values, axis=1) > 0
        return np.pad(rises & ~np.pad(rises[:, 1:], ((0, 0), (0, 1))), ((0, 0), (1, 0))) & ~self.goes_on

    def places(self, which: Array, place: Array) -> tuple[list[Place], Array]:
        """The places at which the function on motions (k,) is stationary near samples (k,), unless these are the first
        or in the middle where it is stationary; and its values there."""
        middle = (place >= self.counts[which] - 1) & self.still[which]
        where, times = np.where(middle, "middle", np.where(place > 0, "inside", "start")), np.zeros(len(place))
        inside, values = (where == "inside").nonzero()[0], self.values[which, place]
        which, place = which[inside], place[inside]
        place = place - (self.rates[which, place] < 0)
        step, share = self.paths.first[which] + place // SAMPLES_PER_STEP, place % SAMPLES_PER_STEP
        low, high = (self.paths.steps[step] * ((share + k) / SAMPLES_PER_STEP) for k in (0, 1))
        rates = self.rates[which, place], self.rates[which, place + 1]
        found = np.where(np.abs(rates[0]) <= np.abs(rates[1]), low, high)
        turns = np.flatnonzero((rates[0] >= 0) != (rates[1] >= 0))  # elsewhere rounding hides the turn at the sample
        c, p = self.paths.coefficients[step, : self.size][turns], self.ps[which][turns]
        rate = lambda t, i: self._at(evaluate(c[i], t[:, None]), p[i])[1][:, 0]  # noqa: E731
        ends = (each[turns] for each in (low, high, *rates))
        found[turns] = enclosed_sign_changes(rate, *ends)[0] if len(turns) else 0.0
        if len(turns):
            values[inside[turns]] = self._at(evaluate(c, found[turns, None]), p)[0][:, 0]
        times[inside] = self.paths.starts[step] + found
        return [Place(Kind(*self.kind, w), t) for w, t in zip(where.tolist(), times.tolist(), strict=True)], values


@cached
def extreme_function(model: Model, names: tuple[str, ...], extreme: str, index: int) -> ca.Function:
    """(x, p, data of the piece) -> the value of a function of an extreme, its rate of change along the motion, and the
    rate of that."""
    name, function = extreme_of(model, extreme)[index]
    phase = getattr(model, name)
    x, p = ca.SX.sym("x", len(phase.states)), ca.SX.sym("p", len(names))
    q = ca.SX.sym("q", phase.pieces.size if phase.pieces else 0)
    arguments = ca.vertsplit(x), dict(zip(names, ca.vertsplit(p), strict=True)), ca.vertsplit(q)
    field, value = ca.vertcat(*phase.field(*arguments)), ca.SX(function(*arguments))
    rate = ca.jacobian(value, x) @ field
    return ca.Function("extreme", [x, p, q], [value, rate, ca.jacobian(rate, x) @ field])


def vanishes_at_start(model: Model, index: int) -> bool:
    """Whether the forces of a slip of this number vanish where their phase begins."""
    return model.standing_points[index % len(model.standing_points)][-1]


@cached
def start_function(model: Model, names: tuple[str, ...], extreme: str, index: int) -> ca.Function:
    """(x, p, data of the piece) -> the value of a function of an extreme where its phase begins: of a share of two
    forces that vanish there the ratio of their rates."""
    whole = extreme_function(model, names, extreme, index)
    x, p, q = whole.sx_in()
    if extreme == "slip" and vanishes_at_start(model, index):
        _, *forces, _ = model.standing_points[index % len(model.standing_points)]
        on, sign = model.contact.watch, 1.0 if index < len(model.standing_points) else -1.0
        arguments = ca.vertsplit(x), dict(zip(names, ca.vertsplit(p), strict=True)), ca.vertsplit(q)
        field = ca.vertcat(*model.contact.field(*arguments))
        across, along = (ca.jtimes(ca.SX(on[name](*arguments)), x, field) for name in forces)
        return ca.Function("start", [x, p, q], [sign * along / across])
    return ca.Function("start", [x, p, q], [whole(x, p, q)[0]])


@cached
def _elementwise(model: Model, names: tuple[str, ...], extreme: str, index: int) -> ElementwiseFunction:
    """`extreme_function` at several points."""
    return ElementwiseFunction(extreme_function(model, names, extreme, index))
