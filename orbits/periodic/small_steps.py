"""Small steps of a machine that stands on two points: where families of walks begin, at the machine at rest.

A walk whose steps are small obeys the linear equations near rest. With the launch E w, of the places and speeds w in
contact, it has to satisfy

    H A E w = 0,    P e^(A T) E w = 0,    Q e^(B D) R w = 0,

with the matrices A and B of flight and contact, the accelerations H of what is held, the contact's reversor R, and the
places P and Q that the reversors turn over, which vanish in mid-flight and in mid-contact. These are more conditions
than the ratios of w and the times T and D satisfy. At a design where two tuned numbers satisfy the rest there are walks
of all small sizes, to first order: there a family begins.
"""

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import casadi as ca
import numpy as np
from scipy.linalg import expm
from scipy.optimize import approx_fprime, root

from ..model import Model
from ..numerics import Array
from ..symbolic import cached


class SmallStepOptions(NamedTuple):
    """Where the search for small steps begins, and when one is found."""

    longest: float = 6.0  # times of the phases, in units of the inverse of the least rate of growth or oscillation
    times: int = 400  # at which the conditions are compared
    size: float = 0.02  # of what sticks, where a walk begins
    tiny: float = 1e-7  # of it, where all is linear
    rounding: float = 1e-13  # of the unknowns
    residual: float = 1e-10  # of conditions that hold
    near: float = 0.1  # change of a tuned number to a walk that is near, as a share
    certain: float = 0.05  # to one that needs no comparison with others
    attempts: int = 20  # that may fail on the way from small steps to a walk
    seconds: float = 8.0  # of processor time for it
    steady: float = 1e-9  # share of the largest rate below which one is 0
    factors: tuple[float, ...] = (1.0, 0.5, 2.0, 0.1)  # of the first tuned number, where small steps are searched
    same: float = 1e-6  # share by which the times of two families differ
    designs: tuple[int, int] = (8, 3)  # values of two parameters from which branch points are searched
    slower: float = 0.1  # change of a tuned number for which a slower walk is tried before a faster one


SMALL_STEPS = SmallStepOptions()


class SmallStep(NamedTuple):
    """A small step.

    flight, contact : half the times
    launch : (k,), in contact states, in which what sticks is at -1
    tuned : the tuned numbers by name
    misfit : how well the conditions hold
    sizes : the singular values of the conditions of the launch
    errors : estimates of the errors of the tuned numbers, by name
    """

    flight: float
    contact: float
    launch: Array
    tuned: dict[str, float]
    misfit: float
    sizes: tuple[float, ...] = ()
    errors: Mapping[str, float] = MappingProxyType({})


class SmallSteps:
    """The conditions of small steps of a machine that sticks, whose parameters are `p`."""

    def __init__(self, model: Model, p: Mapping[str, float]):
        self.model, self.p = model, dict(p)
        self.matrices = _matrices(model, tuple(p))
        names = model.flight.states
        gap = names[int(np.argmax(model.gap(p).weights))]
        self.held = [names.index(f"{name}'") for name in (gap, *model.sticks)]
        self.middles = [np.flatnonzero(np.array(each.signs) < 0) for each in (model.reversal, model.contact_reversal)]
        self.stuck = model.contact.states.index(model.sticks[0])

    def conditions(self, flight: Array, time: float) -> Array:
        """The conditions (r, k) on the launch and in mid-flight."""
        return np.vstack([flight[self.held], expm(flight * time)[self.middles[0]]]) @ self.model.embed

    def middle(self, contact: Array, time: float) -> Array:
        """The conditions (r, k) in mid-contact."""
        return expm(contact * time)[self.middles[1]] * np.array(self.model.contact_reversal.signs)

    def guesses(self) -> list[SmallStep]:
        """The small steps that satisfy all conditions but one best, the best first, of the numbers as they are."""
        flight, contact = self._at({})
        times = np.linspace(0, _longest(flight), SMALL_STEPS.times)[1:]
        rows = (self.conditions(flight, time) for time in times)
        decompositions = [np.linalg.svd(each / np.linalg.norm(each, axis=1)[:, None]) for each in rows]
        misfits, found = np.array([sizes[-1] / sizes[-2] for _, sizes, _ in decompositions]), list[SmallStep]()
        middles = [self.middle(contact, time)[0] for time in times]
        for i in np.flatnonzero((misfits[1:-1] < misfits[:-2]) & (misfits[1:-1] < misfits[2:])) + 1:
            w = decompositions[i][2][-1]
            signs = np.sign([row @ w for row in middles])
            if len(changes := np.flatnonzero(signs[1:] != signs[:-1])):
                found.append(SmallStep(times[i], times[changes[0]], -w / w[self.stuck], {}, misfits[i]))
        return sorted(found, key=lambda each: each.misfit)

    def solved(self, near: SmallStep, tuned: Sequence[str]) -> SmallStep | None:
        """The small step near one, with the numbers that are tuned; None without convergence."""
        free = [i for i in range(len(near.launch)) if i != self.stuck]

        def step(z: Array) -> SmallStep:
            launch = near.launch.copy()
            launch[free] = z[2 : 2 + len(free)]
            return near._replace(
                flight=z[0],
                contact=z[1],
                launch=launch,
                tuned=dict(zip(tuned, z[2 + len(free) :].tolist(), strict=True)),
            )

        def residual(z: Array) -> Array:
            each = step(z)
            flight, contact = self._at(each.tuned)
            rows = self.conditions(flight, each.flight), self.middle(contact, each.contact)
            return np.vstack(rows) @ each.launch

        start = [near.flight, near.contact, *near.launch[free], *(self.p[name] for name in tuned)]
        with np.errstate(all="ignore"):
            try:
                found = root(residual, start, options={"xtol": SMALL_STEPS.rounding})
            except ValueError:  # numbers beyond all bounds
                return None
        here = step(found.x)
        holds = np.abs(found.fun).max() < SMALL_STEPS.residual and min(here.flight, here.contact) > 0
        flight, contact = self._at(here.tuned)
        if not holds or here.flight > _longest(flight):
            return None
        if (first := self._first_middle(contact, here)) < here.contact:
            again = abs(near.contact - first) > SMALL_STEPS.near * first
            return self.solved(here._replace(contact=first), tuned) if again else None
        rows = np.vstack([self.conditions(flight, here.flight), self.middle(contact, here.contact)])
        rounded = np.finfo(float).eps * (np.abs(rows) @ np.abs(here.launch)) + np.abs(found.fun)
        try:
            inverse = np.linalg.inv(approx_fprime(found.x, residual))[2 + len(free) :]
        except np.linalg.LinAlgError:
            return None
        sizes = np.linalg.svd(rows / np.linalg.norm(rows, axis=1)[:, None])[1]
        errors = dict(zip(tuned, (np.abs(inverse) @ rounded).tolist(), strict=True))
        return here._replace(misfit=float(np.abs(found.fun).max()), sizes=tuple(sizes.tolist()), errors=errors)

    def _first_middle(self, contact: Array, step: SmallStep) -> float:
        """The time at which a step first comes to mid-contact, or its own where it does so then."""
        times = step.contact * np.linspace(0, 1, SMALL_STEPS.times // 4)[1:-1]
        signs = np.sign([self.middle(contact, time)[0] @ step.launch for time in times])
        changes = np.flatnonzero(signs[1:] != signs[:-1])
        return float(times[changes[0]]) if len(changes) else step.contact

    def _at(self, tuned: Mapping[str, float]) -> tuple[Array, Array]:
        """The matrices of flight and contact with tuned numbers."""
        flight, contact = self.matrices([*{**self.p, **tuned}.values()])
        return flight.full(), contact.full()


def _longest(flight: Array) -> float:
    """The longest half time of a flight with this matrix that is searched."""
    rates = np.abs(np.linalg.eigvals(flight))
    return SMALL_STEPS.longest / float(rates[rates > SMALL_STEPS.steady * rates.max()].min())


def change(value: float, before: float) -> float:
    """The change of a number, as a share of both."""
    return 2 * abs(value - before) / (abs(value) + abs(before)) if value != before else 0.0


@cached
def _matrices(model: Model, names: tuple[str, ...]) -> ca.Function:
    """The matrices of flight and contact at the state at rest, functions of the parameters."""
    p, found = ca.SX.sym("p", len(names)), []
    for phase in (model.flight, model.contact):
        x = ca.SX.sym("x", len(phase.states))
        rates = ca.vertcat(*phase.field(ca.vertsplit(x), dict(zip(names, ca.vertsplit(p), strict=True)), []))
        found.append(ca.densify(ca.substitute(ca.jacobian(rates, x), x, 0)))
    return ca.Function("small_steps", [p], found)


def small_steps_near(model: Model, p: Mapping[str, float], tuned: Sequence[str]) -> list[SmallStep]:
    """The small steps with two tuned numbers to which those lead that satisfy the conditions best at numbers `p`, by
    their times."""
    steps = SmallSteps(model, p)
    found = (steps.solved(near, tuned) for near in steps.guesses())
    return sorted((each for each in found if each), key=lambda each: each.flight)


def small_steps(model: Model, p: Mapping[str, float], tuned: Sequence[str]) -> Iterator[list[dict[str, float]]]:
    """The unknowns of half orbits by name, with tuned numbers, where families of walks begin: first the ones near the
    numbers `p`, in the order of their distance, then others. Without any, or where less than two numbers are tuned, the
    steps satisfy the conditions nearly."""
    places, known = model.launch_places, list[SmallStep]()
    for factor in SMALL_STEPS.factors if len(tuned) > 1 else ():
        solved = small_steps_near(model, {**p, tuned[0]: factor * p[tuned[0]]}, tuned[:2])
        ways = [max(change(x, p[name]) for name, x in each.tuned.items()) for each in solved]
        new = list[SmallStep]()
        for i in sorted(range(len(solved)), key=lambda i: ways[i] + SMALL_STEPS.slower * i):
            if not any(np.isclose(solved[i].flight, other.flight, rtol=SMALL_STEPS.same) for other in (*known, *new)):
                new.append(solved[i])
        known += new
        yield [_start(each, places) for each in new]
    if not known:
        yield [_start(each, places) for each in SmallSteps(model, p).guesses()]


def _start(step: SmallStep, places: Mapping[str, int]) -> dict[str, float]:
    """The unknowns of half an orbit by name, and the tuned numbers, of a small step."""
    launch = {name: SMALL_STEPS.size * float(step.launch[place]) for name, place in places.items()}
    return {**launch, "duration": float(step.flight), "contact_duration": float(step.contact), **step.tuned}
