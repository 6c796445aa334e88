"""Hops by their words, and the one statement of a hop as equations.

A word is a sequence of hops, each a sequence of arcs: a flight up to each impact, where the machine leaves at once
after all impacts but the last, and a contact. So the numbers of impacts of the hops are the word.

The gap of a flight has a zero at its start, by which it is divided: (gap(T) - gap(0))/T**order, with the order 3 after
a lift-off and 2 after a plastic impact that leaves at once. So hops that have a flight of no duration, where an impact
more begins, are regular solutions, and so is a lossless hop, which is one of these.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..hops import LIFTOFF_ORDER
from ..laws import Algebraic, Parameters, Scalars
from ..model import CONTACT_FORCE, Arc, Model, Phase, Statement, weighted_sum
from ..numerics import solve
from ..periodic import fold_statement
from ..shooting import Shooting, shooting_equations
from ..symbolic import ElementwiseFunction

Array = np.ndarray
Word = tuple[int, ...]
ORDER_OF_IMPACT = 2  # of the zero of the gap after a plastic impact
# What has to be positive in a hop of a word, by its kind: the force after an impact, in its direction; the speed of a
# landing; the gap in a flight; the force in contact; and the speed at lift-off.
FORCE, SPEED, GAP, CONTACT, REST = KINDS_OF_SLACKS = "force", "speed", "gap", "contact", "rest"
ROWS_OF_FLIGHT = 3  # the gap, its speed, and the force after the impact


class Slack(NamedTuple):
    """What has to be positive in a hop of a word: its kind, the hop, and the impact, or its flight, in the hop."""

    kind: str
    hop: int
    impact: int = 0


def slacks_of(word: Word) -> list[Slack]:
    """The slacks of a word: with a row in the statement first, those sampled along arcs last."""
    impacts = [(hop, i) for hop, count in enumerate(word) for i in range(count)]
    exact = [Slack(FORCE, *place) for place in impacts]
    # The last landing has no speed only where it has no force either, at a lossless hop.
    exact += [Slack(SPEED, hop, i) for hop, i in impacts if i + 1 < word[hop]]
    exact += [Slack(REST, hop) for hop in range(len(word))]
    return exact + [Slack(GAP, *place) for place in impacts] + [Slack(CONTACT, hop) for hop in range(len(word))]


def contact_state(model: Model, x: Scalars) -> list[Algebraic]:
    """The contact state that a flight state with closed gap is: some of its entries."""
    units, rows = np.eye(model.embed.shape[1]).tolist(), model.embed.tolist()
    return [x[rows.index(unit)] for unit in units]


def force_in_contact(model: Model, x: Scalars, p: Parameters) -> Algebraic:
    """The contact force in the contact state x."""
    return model.contact.watch[CONTACT_FORCE](x, p, model.contact.data(x, p))


def pressing(model: Model, x: Scalars, p: Parameters) -> Algebraic:
    """The contact force after a plastic impact in the flight state x."""
    return force_in_contact(model, contact_state(model, model.landed(x, p)), p)


def gap_speed(model: Model, x: Scalars, p: Parameters) -> Algebraic:
    """The speed of the gap in the flight state x."""
    return model.speeds_of_landing(x, p)[0]


@lru_cache(maxsize=64)
def forces_in_contact(model: Model, names: tuple[str, ...]) -> ElementwiseFunction:
    """(contact states, parameters of these names) -> the contact forces, at several states."""
    x, p = ca.SX.sym("x", len(model.contact.states)), ca.SX.sym("p", len(names))
    force = force_in_contact(model, ca.vertsplit(x), dict(zip(names, ca.vertsplit(p), strict=True)))
    return ElementwiseFunction(ca.Function("force", [x, p], [ca.densify(ca.SX(force))]))


class HopEquations(NamedTuple):
    """The equations of one hop with a number of impacts, of launches of d numbers.

    equations : of the unknowns, which are those of the launch, the times of the flights and that of the contact
    free : places (d,) of the free numbers of a launch among the unknowns, as those of `next` are
    inner : rows (n - d,) that vanish: lift-off at launch, the divided gaps, and the force at the end of the contact
    next : rows (d,), the next launch without injection
    speeds, forces : rows (count,), the speed of the gap at each impact and the contact force after it
    slope : the row of the derivative of the next launch by the launch, where the equations are those of the hop and its
        variation; else None
    """

    equations: Shooting
    free: Array
    inner: Array
    next: Array
    speeds: Array
    forces: Array
    slope: int | None = None

    @property
    def rows(self) -> Array:
        """The rows that determine the unknowns, the next launch last."""
        return np.append(self.inner, self.next)

    @property
    def bound(self) -> Array:
        """The places of the unknowns that the inner rows determine."""
        return np.delete(np.arange(self.equations.size), self.free)

    def moved(self, jacobian: Array) -> Array:
        """The derivatives (k, n - d, d) of the bound unknowns by the launch, from those (k, rows, n) of all rows."""
        rows = jacobian[:, self.inner]
        return solve(rows[:, :, self.bound], -rows[:, :, self.free])

    def derivatives(self, jacobian: Array) -> Array:
        """The derivatives (k, d, d) of the next launch by the launch, from the derivatives (k, rows, n) of all rows."""
        last = jacobian[:, self.next]
        return last[:, :, self.free] + last[:, :, self.bound] @ self.moved(jacobian)


@lru_cache(maxsize=256)
def hop_equations(model: Model, count: int, names: tuple[str, ...], free: tuple[str, ...] = ("alpha",)) -> HopEquations:
    """The equations of a hop with `count` impacts with parameters of these names; `free` are the free numbers of a
    launch."""
    rows = 1 + ROWS_OF_FLIGHT * np.arange(count)
    last = 1 + ROWS_OF_FLIGHT * count
    statement = hop_statement(model, count, free)
    places = np.array([statement.unknowns.index(name) for name in free])
    inner, following = np.array([0, *rows, last]), last + 1 + np.arange(len(free))
    return HopEquations(shooting_equations(statement, names), places, inner, following, rows + 1, rows + 2)


@lru_cache(maxsize=256)
def varied_hop_equations(model: Model, count: int, names: tuple[str, ...], along: str) -> HopEquations:
    """The equations of a hop with `count` impacts and of its variation, of a launch that is a speed. The unknowns are
    those of the hop, their derivatives by the launch speed, and the parameter `along`. Raises `InputError` where the
    pieces of a law move with that."""
    statement = fold_statement(hop_statement(model, count), along)
    rows = 2 + 2 * ROWS_OF_FLIGHT * np.arange(count)
    last = 2 + 2 * ROWS_OF_FLIGHT * count
    inner = np.array([0, *rows, last, 1, *(rows + ROWS_OF_FLIGHT), last + 2])
    places = np.array([statement.unknowns.index("alpha")])
    equations = shooting_equations(statement, names)
    return HopEquations(equations, places, inner, np.array([last + 1]), rows + 1, rows + 2, slope=last + 3)


@lru_cache(maxsize=64)
def hop_statement(model: Model, count: int, free: tuple[str, ...] = ("alpha",)) -> Statement:
    """The statement of a hop with `count` impacts; see `HopEquations` for its rows."""
    times = tuple(f"flight_{i + 1}" for i in range(count))
    arcs = [_flight(model, i, time) for i, time in enumerate(times)]
    arcs.append(_contact(model, [model.launch_places[name] for name in free]))
    durations = (*times, "contact")
    return Statement("hop", (*model.launch_unknowns, *durations), tuple(arcs), durations)


def _flight(model: Model, impact: int, time: str) -> Arc:
    """The flight up to an impact, from a launch or from the impact before."""
    order = LIFTOFF_ORDER if impact == 0 else ORDER_OF_IMPACT

    def start(u: Parameters, before: Scalars, p: Parameters) -> list[Algebraic]:
        return model.launch(u, p) if impact == 0 else _closed(model, before, p)

    def conditions(u: Parameters, x: Scalars, p: Parameters) -> list[Algebraic]:
        return [model.gap(p).at(x) / u[time] ** order, gap_speed(model, x, p), pressing(model, x, p)]

    guard: Callable = lambda u, x, p, q: model.liftoff(u, p, q) if impact == 0 else []  # noqa: E731
    return Arc(_without_closed_form(model.flight), start, lambda u, p: u[time], conditions, guard)


def _closed(model: Model, x: Scalars, p: Parameters) -> list[Algebraic]:
    """The flight state after a plastic impact in the flight state x, with the gap closed and at rest exactly."""
    standing = contact_state(model, model.landed(x, p))
    return [weighted_sum(row, standing) for row in model.embed.tolist()]


def _contact(model: Model, places: Sequence[int]) -> Arc:
    """The contact after an impact, up to a launch whose free numbers are contact states with these places."""

    def start(u: Parameters, before: Scalars, p: Parameters) -> list[Algebraic]:
        return contact_state(model, model.landed(before, p))

    def conditions(u: Parameters, x: Scalars, p: Parameters) -> list[Algebraic]:
        return [force_in_contact(model, x, p), *(x[place] for place in places)]

    return Arc(_without_closed_form(model.contact), start, lambda u, p: u["contact"], conditions)


@lru_cache(maxsize=64)
def _without_closed_form(phase: Phase) -> Phase:
    """A phase without its closed form: many motions are integrated together, and with derivatives by parameters."""
    return replace(phase, closed_form=None) if phase.closed_form else phase
