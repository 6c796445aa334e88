"""Curves of the flips, folds and border collisions of hops in two parameters, by continuation.

The equations are those of `bifurcation_statement`, with exact derivatives. A point of a curve has the unknowns of the
cycle, at flips and folds a direction in which it bifurcates, the first parameter, and the second one, along which the
curve is followed. The curve ends where the hops have other numbers of impacts from there on.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from ..continuation.follow import bounds_of
from ..continuation.step_control import Options, StepControl, checked_options
from ..curves import ASKS, CHANGES, FOLD, End, Event, Points, Problem, Run, Steps, Test, started
from ..errors import InputError, NoOrbit, OrbitsError
from ..flow.trajectory import Trajectories
from ..hops.hand_over import landed
from ..hops.impacts import LIFTOFF_ORDER, Impacts
from ..model.machine import Machine, machine_in_words
from ..model.phase import Affine
from ..numerics.polynomial_roots import Crossings
from ..shooting.single_shooting import shooting_equations
from ..units import LIFTOFF_SPEED
from .bifurcation import Bifurcation
from .bifurcation_curve import BifurcationCurve, PlaceOnCurve
from .cycle_statement import (
    GRAZES,
    INJECT,
    LEAVES_OR_STAYS,
    LOSSLESS,
    MULTIPLIER_AT,
    Border,
    bifurcation_statement,
    cycle_statement,
    force_in_contact,
    gap_speed,
    pressing,
)
from .cycles import RESTITUTION, parameters_of_maps
from .flown_hops import flown_hops
from .hop_curve import rows_within

# Shares of the time of a flight or contact at which the gap and the contact force are tested; the places nearer to its
# ends, where they vanish, belong to the events there.
SHARES_OF_ARC = np.linspace(0.03, 0.97, 48)
# A solved bifurcation may lie this far from where the diagram has it, as a share of the parameter, which is located to
# some 1e-11, and a turn so far from the end of a curve is another place; and a border condition is the one that
# vanishes to this share of the largest launch speed.
SAME_EVENT, NEAR_BORDER = 1e-6, 1e-3
# At a cusp the share of the first parameter in the tangent vanishes beside that of the second one.
CUSP = 1e-5
BORDERS = (
    "border collision",
    "non-smooth fold",
)  # the kinds of events at which a hop is about to have another number of impacts
SLOW_LANDING = 1e-6  # the first landing of a lossless hop is slower than this share of the launch speed, by rounding
SMALL_FORCE = 0.05  # a contact force below this, where 1 lifts the foot, vanishes near a lossless hop


class EventEquations(Problem):
    """The equations of one kind of bifurcation of cycles in two parameters, the last components of its points: the
    first one is the last unknown of the statement, and the curve is followed along the second one, whose whole range
    `span` is its unit. `own` of points are the test functions by what happens where they vanish."""

    def __init__(
        self, machine: Machine, along: str, second: str, event: str | Border, impacts: tuple[int, ...], inject: float,
        span: float,
    ):  # fmt: skip
        self.machine, self.second, self.span, self.event, self.impacts = machine, second, span, event, impacts
        self.names, self.parameters = (*machine.values, INJECT), np.array([*machine.values.values(), inject])
        self.places = [self.names.index(along), self.names.index(second)]
        self.equations = shooting_equations(bifurcation_statement(machine.model, impacts, event, along), self.names)
        self.cycle = cycle_statement(machine.model, impacts, event if isinstance(event, Border) else None)
        # The unit of a parameter that passes zero is its first value, or 1 when that is zero.
        self.least = 0.1 * abs(self.parameters[self.places[0]]) or 1.0
        self.tests = (
            replace(FOLD, kind="turn", confirmed=_kind_of_turn),
            Test("border", lambda problem, points: np.array([[*each.values()] for each in points.own]), CHANGES),
            Test("border", lambda problem, points: np.array([min(each.values()) for each in points.own]), ASKS),
        )

    def parameters_at(self, xs: np.ndarray) -> np.ndarray:
        """The parameters (m, np) at points (m, n + 1)."""
        values = np.tile(self.parameters, (len(xs), 1))
        values[:, self.places] = xs[:, -2:]
        return values

    def alphas_at(self, xs: np.ndarray) -> np.ndarray:
        """The launch speeds (m, period) at points (m, n + 1), in the machine's units."""
        p, units = dict(zip(self.names, self.parameters_at(xs).T, strict=True)), self.machine.model.units
        speeds = xs[:, [i for i, name in enumerate(self.cycle.unknowns) if name.startswith("alpha")]]
        return speeds * np.reshape(units(p).of(LIFTOFF_SPEED), (-1, 1)) if units else speeds

    def evaluate(self, lanes: np.ndarray, xs: np.ndarray, known: Any = None, moved: Any = None) -> Any:
        return self.equations.evaluate_lanes(xs[:, :-1], self.parameters_at(xs), (self.second,))

    def size(self, lanes: np.ndarray, xs: np.ndarray) -> np.ndarray:
        size = np.abs(xs)
        size[:, :-2] = np.maximum(size[:, :-2], 0.1 * size[:, :-2].max(1, keepdims=True))
        size[:, -2], size[:, -1] = np.maximum(size[:, -2], self.least), self.span
        return size

    def certify(self, points: Points) -> tuple[Points, dict[int, Exception]]:
        """The points with their test functions; there are no machines where some are refused."""
        ps, errors = self.parameters_at(points.xs), dict[int, Exception]()
        for i, p in enumerate(ps):
            values = dict(zip(self.names, p.tolist(), strict=True))
            try:
                self.machine.with_values(**{name: values[name] for name in self.machine.values})
            except OrbitsError as error:
                errors[i] = error
        found = self._tests(points.evaluation[points.places].trajectories, dict(zip(self.names, ps.T, strict=True)))
        rows = zip(*(values.tolist() for values in found.values()), strict=True)
        own = np.array([dict(zip(found, row, strict=True)) for row in rows])
        return points.having(own=own, evaluation=None), errors  # without the motions, which are long

    def changed(self, event: Event, passed: Sequence[Points]) -> End:
        (tests,) = event.point.own
        return End("border", f"{min(tests, key=tests.get)}: the hops have other impacts from there on")

    def lost(self, lane: int, passed: Sequence[Points], error: object) -> End:
        where = f"at {self.second} = {passed[-1].values[-1]:.10g}"
        if isinstance(error, InputError):
            return End("degenerate", f"there is no such machine any more {where}: {error}")
        return End("stuck", f"{where}: {error}")

    def _tests(self, arcs: Sequence[Trajectories], p: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The test functions (m,) of points with parameters (m,), by what happens where they vanish."""
        model, tests = self.machine.model, dict[str, np.ndarray]()
        border: str | Border | None = self.event
        many = {name: np.repeat(values, len(SHARES_OF_ARC)) for name, values in p.items()}
        hop, impact = 0, 0
        for arc, motions in zip(self.cycle.arcs, arcs, strict=True):
            size = len(arc.phase.states)
            rows, end = [*rows_within(motions, SHARES_OF_ARC, size).T], [*motions.finals[:, :size].T]
            least = lambda values: np.reshape(values, (-1, len(SHARES_OF_ARC))).min(1)  # noqa: E731
            if arc.phase.name == model.contact.name:
                force = np.broadcast_to(force_in_contact(model, rows, many), rows[0].shape)
                tests[f"the contact of hop {hop + 1} opens earlier"] = least(force)
                tests[f"hop {hop + 1} ends at rest"] = np.broadcast_to(model.contact_speed.at(end), end[0].shape)
                hop, impact = hop + 1, 0
                continue
            here = Border(hop, impact)
            tests[replace(here, kind=GRAZES).in_words()] = least(model.gap(many).at(rows))
            if (
                isinstance(border, Border)
                and (hop, impact) == (border.hop, border.impact)
                and border.kind != LEAVES_OR_STAYS
            ):
                hop += border.kind == LOSSLESS  # a flight up to a graze is followed by that up to the impact
                border = None
                continue
            tests[f"impact {impact + 1} of hop {hop + 1} becomes tangential"] = -gap_speed(model, end, p)
            if here != border:
                last = impact + 1 == self.impacts[hop]
                tests[here.in_words()] = (1.0 if last else -1.0) * np.broadcast_to(
                    pressing(model, end, p), end[0].shape
                )
            impact += 1
        return tests


def _kind_of_turn(problem: Any, point: Points, _: int) -> str | None:
    """A turn, or a cusp of folds, where the curve turns round in both parameters; None for that at the end of a
    curve."""
    if min(point.own[0].values()) < SAME_EVENT:
        return None
    share = abs(point.tangents / problem.size(point.lanes, point.xs))[0, -2]
    return "cusp" if problem.event == "fold" and share < CUSP else "turn"


def _bifurcation_near(curve: EventEquations, x: np.ndarray, way: float, options: Steps) -> Points:
    """The point of a curve near x (n + 1,), with this value of the second parameter; raises `NoOrbit`."""
    if not len(points := started(curve, x[None], options, way)):
        raise NoOrbit(f"Newton's method finds no bifurcation near {curve.second} = {x[-1]:g}")
    return points


def follow_bifurcation(
    machine: Machine, along: str, event: Bifurcation, second: str, stop: float | tuple[float, float], *,
    inject: float = 0.0, at: Sequence[float] = Options.at, longest: float = Options.longest, most: int = Options.most,
    step_control: StepControl = Options.step_control,
) -> BifurcationCurve:  # fmt: skip
    """The curve of a bifurcation of hops along `along` as a second parameter goes to `stop`, from an event of a
    diagram of a machine with an injection; the other arguments as in `BifurcationDiagram.follow_event`."""
    options = checked_options(at=at, longest=longest, most=most, step_control=step_control)
    machine, curve, x = _event_equations(machine, along, event, second, inject)
    start = float(x[-1])
    behind, stop = bounds_of(second, start, stop, options.at)
    if second != INJECT:
        for bound in (behind, stop):
            machine.with_values(**{second: bound})  # an impossible machine is refused before the search
    curve.span, steps = abs(stop - behind), options.steps(options.step_control.largest_batch)
    first = _bifurcation_near(curve, x, stop - start, steps)
    if abs(first.xs[0, -2] - event.value) > SAME_EVENT * max(abs(event.value), curve.least):
        nearest = f"the nearest one is at {first.xs[0, -2]:.9g}"
        raise NoOrbit(f"{along} = {event.value:.9g} is no {event.kind}: {nearest}")
    blocks, events, end = list[np.ndarray](), list[PlaceOnCurve](), End("stopped")
    for item in Run(curve, first, stop, behind=behind, at=options.at, options=steps):
        if isinstance(item, Points):
            blocks.append(item.xs)
        elif isinstance(item, End):
            end = item
        elif item.kind != "border":
            first_value, value = item.point.xs[0, -2:].tolist()
            alphas = tuple(curve.alphas_at(item.point.xs)[0].tolist())
            events.append(PlaceOnCurve(item.kind, (first_value, value), alphas))
    reason, xs = end.reason, np.concatenate(blocks)
    if end.kind == "reached":
        reason = f"{second} = {reason}{' again, on another sheet' if xs[-1, -1] == start else ''}"
    words, units, kind = machine_in_words(machine), machine.units, curve.event
    texts = {**words.get("units", {}), **dict.fromkeys(("alpha", INJECT), units.text(LIFTOFF_SPEED))} if units else {}
    name, border = (event.kind, kind.in_words()) if isinstance(kind, Border) else (kind, "")
    about, places = (name, along, second, words, curve.impacts), (xs[:, -2:], curve.alphas_at(xs))
    return BifurcationCurve(*about, *places, tuple(events), replace(end, reason=reason), border, texts)


def located(machine: Machine, along: str, event: Bifurcation, inject: float = 0.0) -> Bifurcation:
    """A flip, fold or border collision of hops by Newton's method on its equations, from a guess of it: with the exact
    value of the parameter and launch speeds. Raises `NoOrbit` where the method does not converge."""
    _, curve, x = _event_equations(machine, along, event, "", inject)
    (x,) = _bifurcation_near(curve, x, 1.0, Steps()).xs
    alphas = tuple(curve.alphas_at(x[None])[0].tolist())
    return replace(event, value=float(x[-2]), alphas=alphas, multiplier=MULTIPLIER_AT.get(event.kind, np.nan))


def _event_equations(
    machine: Machine, along: str, event: Bifurcation, second: str, inject: float
) -> tuple[Machine, EventEquations, np.ndarray]:
    """The machine at a bifurcation, the equations of its curve along a second parameter, for "" along any other one,
    and a guess of the point there."""
    _check_event(machine, along, event, second)
    if along == INJECT:
        inject = event.value
    else:
        machine = machine.with_values(**{along: event.value})
    second = second or _other_than(along, machine)
    speed = machine.units.of(LIFTOFF_SPEED) if machine.units else 1.0
    cycle = _Cycle(Impacts(machine), [alpha / speed for alpha in event.alphas])
    if cycle.lossless(SLOW_LANDING) is not None and (event.kind == "fold" or len(event.alphas) == 1):
        raise InputError("this fold is a lossless hop: `follow` follows it along a parameter, without an injection")
    kind: str | Border = event.kind if event.kind in MULTIPLIER_AT else cycle.border()
    impacts, u = cycle.unknowns(kind)
    start = inject if second == INJECT else machine.values[second]
    curve = EventEquations(machine, along, second, kind, impacts, inject, max(abs(start), 1.0))
    if not isinstance(kind, Border):
        equations = shooting_equations(cycle_statement(machine.model, impacts), curve.names)
        jacobian = equations.evaluate(u, curve.parameters).jacobian.copy()
        place = equations.statement.unknowns.index("alpha")
        jacobian[-1, place] += 1.0 - MULTIPLIER_AT[kind]
        direction = np.linalg.svd(jacobian)[2][-1]
        u = [*u, *np.delete(direction / direction[place], place)]
    return machine, curve, np.array([*u, event.value, start])


def _other_than(along: str, machine: Machine) -> str:
    """A parameter of hops other than one."""
    return next(name for name in (*machine.values, INJECT) if name != along)


def _check_event(machine: Machine, along: str, event: Bifurcation, second: str) -> None:
    """Raise `InputError` where a bifurcation cannot be followed along a second parameter."""
    model = machine.model
    if not isinstance(event, Bifurcation):
        raise InputError(f"event = {event!r}; it is one of the `events` of a diagram")
    if not model.one_speed or not model.plain or model.hysteretic:
        other = "steps" if model.one_speed else "has a launch of several numbers"
        what = "has hysteresis" if model.hysteretic else other
        raise InputError(f"a {model.name} {what}: bifurcations are followed where a launch is a speed alone")
    if event.kind not in (*MULTIPLIER_AT, *BORDERS):
        have = ", ".join((*MULTIPLIER_AT, *BORDERS))
        raise InputError(f"a {event.kind} has no curve in two parameters here: {have} have")
    known = [name for name in parameters_of_maps(machine) if name not in (along, RESTITUTION)]
    if second and second not in known:
        raise InputError(f"second = '{second}'; {event.kind}s in {along} are followed along {', '.join(known)}")
    if along == RESTITUTION or cast(Any, machine).restitution > 0:
        raise InputError(
            "with a restitution a hop has infinitely many impacts: bifurcations are followed where it is 0"
        )
    if second and second not in (INJECT, *machine.values):
        raise InputError(f"second = '{second}': the machine has none to begin with; give it a small one")


class _Cycle:
    """The hops of a cycle from launch speeds (period,), impact by impact."""

    def __init__(self, impacts: Impacts, alphas: Sequence[float]):
        self.impacts, self.hops = impacts, flown_hops(impacts, np.array(alphas))
        if not self.hops.counts.all():
            raise NoOrbit("the hops of this bifurcation are not found again at its launch speeds")

    def lossless(self, slow: float) -> int | None:
        """The index of a hop that is lossless: its first landing is slower than a share of the launch speed, without a
        force."""
        for hop, alpha in enumerate(self.hops.alphas.tolist()):
            speed, force = self._at(self.hops.landings[hop, 0])
            if speed <= slow * alpha and force <= SMALL_FORCE:
                return hop
        return None

    def border(self) -> Border:
        """The border that the cycle is at; raises `NoOrbit` where there is none."""
        if (hop := self.lossless(NEAR_BORDER)) is not None:
            return Border(hop, 0, LOSSLESS)
        found = list[tuple[float, Border]]()
        for hop, (alpha, count) in enumerate(zip(self.hops.alphas, self.hops.counts.tolist(), strict=True)):
            for impact, x in enumerate(self.hops.landings[hop, :count]):
                speed, force = self._at(x)
                found.append((force, Border(hop, impact)))
                if impact + 1 < count:
                    found.append((speed / alpha, Border(hop, impact, GRAZES)))
                found += [(size / alpha, Border(hop, impact, GRAZES)) for size, _ in self._near_grazes(hop, impact)]
        size, border = min(found, key=lambda each: each[0])
        if not size <= NEAR_BORDER:
            raise NoOrbit(
                "at these launch speeds no impact is about to vanish: the map's slope jumps for another reason"
            )
        return border

    def _at(self, x: np.ndarray) -> tuple[float, float]:
        """The size of the gap's speed at an impact, and that of the contact force after it."""
        model, p = self.impacts.model, self.impacts.values
        return abs(float(self.impacts.gap_speed @ x)), abs(float(pressing(model, x.tolist(), p)))

    def _near_grazes(self, hop: int, impact: int) -> list[tuple[float, float]]:
        """Where the gap is least in the flight up to an impact: the speed with which it would land there if it were
        lower by that, and the time."""
        impacts, time = self.impacts, float(self.hops.times[hop, impact])
        if impact:
            x = landed(impacts, self.hops.landings[hop, impact - 1][None], np.zeros(1, int)).state[0]
        else:
            x = self.hops.starts[hop]
        path, _ = impacts.flight.run(x, impacts.p, time)
        speed = Affine(tuple(impacts.gap_speed.tolist()))
        places = Crossings(LIFTOFF_ORDER - 1 if impact == 0 else 1, rising=True)(
            speed.series(path.coefficients), path.steps
        )
        times = [float(path.times[step] + after) for step, after in places]
        return [(abs(2 * float(impacts.gap(path(each)[: len(x)]))) ** 0.5, each) for each in times if each < time]

    def unknowns(self, kind: str | Border) -> tuple[tuple[int, ...], list[float]]:
        """The numbers of impacts (period,) of the hops, and the unknowns of their statement at a flip, a fold or a
        border."""
        counts, launches, times = self.hops.counts.tolist(), list[float](), list[float]()
        for hop, count in enumerate(self.hops.counts.tolist()):
            liftoff, alpha, *own = self.hops.unknowns(self.impacts, np.array([hop]))[0].tolist()
            if isinstance(kind, Border) and kind.hop == hop and kind.kind != LEAVES_OR_STAYS:
                near = self._near_grazes(hop, kind.impact)
                speed, _ = self._at(self.hops.landings[hop, kind.impact])
                if kind.kind == LOSSLESS:
                    own = [0.5 * sum(own[:-1])]
                elif near and min(near)[0] < speed:  # it does not touch yet
                    own[kind.impact : kind.impact + 1] = [min(near)[1], own[kind.impact] - min(near)[1]]
                else:
                    counts[hop] = count - 1
            launches += [liftoff, alpha]
            times += own
        return tuple(counts), [*launches, *times]
