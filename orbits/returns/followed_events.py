"""Curves of the flips, folds and border collisions of hops in two parameters, by continuation.

The equations are those of the hops of a `HopProblem`, and one more: the product of the slopes of the map at the
launches is -1 at a flip and 1 at a fold, and at a border a slack of the word vanishes. At flips and folds the equations
of each hop are those of its variation too, whose derivatives are exact. A curve ends where another slack vanishes, as
the hops have other numbers of impacts from there on.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np

from ..continuation import Options, StepControl, bounds_of, checked_options
from ..curves import ASKS, CHANGES, FOLD, End, Event, Points, Run, Steps, Test, started
from ..errors import InputError, NoOrbit, OrbitsError
from ..hops import LIFTOFF_ORDER, Impacts, landed
from ..model import Affine, Machine, machine_in_words
from ..numerics import Crossings
from ..units import LIFTOFF_SPEED
from .bifurcation import Bifurcation
from .bifurcation_curve import BifurcationCurve, PlaceOnCurve
from .flown_hops import flown_hops
from .hop_borders import COLLISIONS
from .hop_problem import HopProblem, HopValues
from .hop_statement import CONTACT, FORCE, GAP, REST, SPEED, Slack, Word, hop_equations, pressing, varied_hop_equations
from .hops_along import DIFFERENCE, INJECT, HopsAlong
from .launch_cycles import RESTITUTION, parameters_of_maps
from .periodic_launch import MULTIPLIER_AT

# What happens where a slack of a word vanishes, by its kind.
IN_WORDS = {
    FORCE: "the contact force vanishes after impact {impact} of hop {hop}",
    SPEED: "impact {impact} of hop {hop} becomes tangential",
    GAP: "the foot grazes the ground before impact {impact} of hop {hop}",
    CONTACT: "the contact of hop {hop} opens earlier",
    REST: "hop {hop} ends at rest",
}


class SameEvent(NamedTuple):
    """When a bifurcation is the one that is meant.

    share : a solved one lies at most this far from where a diagram has it, as a share of the parameter, which is
        located to some 1e-11; and a turn so far from the end of a curve is another place
    near_border : the border condition that vanishes is the one that does so to this share of the largest launch speed
    cusp : the share of the first parameter in the tangent, which vanishes at a cusp compared with that of the second
        one
    slow : the first landing of a lossless hop is slower than this share of the launch speed, by rounding
    force : a contact force below this, where 1 lifts the foot, vanishes near a lossless hop
    """

    share: float = 1e-6
    near_border: float = 1e-3
    cusp: float = 1e-5
    slow: float = 1e-6
    force: float = 0.05


SAME = SameEvent()


def in_words(slack: Slack, lossless: bool = False) -> str:
    """What happens where a slack vanishes, that of the force of a `lossless` hop or another one."""
    if lossless:
        return f"hop {slack.hop + 1} is lossless"
    return IN_WORDS[slack.kind].format(hop=slack.hop + 1, impact=slack.impact + 1)


class EventCurve(HopProblem):
    """The curve of one kind of bifurcation of hops with a word in two parameters, the last components of its points; it
    is followed along the second one, whose whole range `span` is its unit. `own` of points are their slacks (k,)."""

    def __init__(
        self, machine: Machine, along: str, second: str, event: str | Slack, word: Word, inject: float, span: float,
    ):  # fmt: skip
        self.machine, self.second, self.span, self.event = machine, second, span, event
        hops = HopsAlong(machine, along, inject, span, ("alpha",), lambda value: Impacts(machine))
        statement = hop_equations if isinstance(event, Slack) else partial(varied_hop_equations, along=along)
        super().__init__(hops, word, (along, second), lambda count: statement(machine.model, count, hops.names))
        # The parameter of a variation is an unknown of its equations; the injection is in no equation of a hop.
        own = () if isinstance(event, Slack) else (along,)
        self.vary = tuple(name for name in self.names if name != INJECT and name not in own)
        self.groups = [self._group(impacts) for impacts in sorted({*word})]
        self.start = np.array([inject if name == INJECT else machine.values[name] for name in self.names])
        # The unit of a parameter that passes zero is its first value, or 1 when that is zero.
        self.least = 0.1 * abs(self.start[0]) or 1.0
        self.others = [k for k, each in enumerate(self.slacks) if each != event]
        self.tests = (
            replace(FOLD, kind="turn", confirmed=_kind_of_turn),
            Test("border", lambda problem, points: np.array([*points.own]), CHANGES),
            Test("border", lambda problem, points: np.array([min(each) for each in points.own]), ASKS),
        )

    def parameters(self, xs: np.ndarray) -> np.ndarray:
        ps = np.tile([*self.machine.values.values()], (len(xs), 1))
        for name, column in zip(self.names, xs[:, -2:].T, strict=True):
            if name != INJECT:
                ps[:, self.hops.names.index(name)] = column
        return ps

    def unit_at(self, xs: np.ndarray) -> np.ndarray:
        """The units (m,) of launch speeds at points (m, n + 1)."""
        units, p = self.hops.model.units, dict(zip(self.hops.names, self.parameters(xs).T, strict=True))
        return np.broadcast_to(units(p).of(LIFTOFF_SPEED), len(xs)) if units else np.ones(len(xs))

    def injection(self, xs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        injected = xs[:, -2 + self.names.index(INJECT)] if INJECT in self.names else np.full(len(xs), self.hops.inject)
        unit, rates = self.unit_at(xs), np.zeros((len(xs), 2))
        for k, name in enumerate(self.names):
            step = np.zeros(xs.shape)
            step[:, k - 2] = DIFFERENCE * np.maximum(np.abs(xs[:, k - 2]), DIFFERENCE * self.span)
            growing = (self.unit_at(xs + step) - self.unit_at(xs - step)) / (2 * step[:, k - 2])
            rates[:, k] = ((name == INJECT) - injected * growing / unit) / unit
        return injected / unit, rates

    def close(self, values: HopValues, bends: np.ndarray) -> None:
        if isinstance(self.event, Slack):
            k = self.slacks.index(self.event)
            values.residual[:, -1], values.jacobian[:, -1] = values.slacks[:, k], values.steps[:, k]
            return
        slopes = values.slopes[:, :, 0, 0]
        values.residual[:, -1] = slopes.prod(1) - MULTIPLIER_AT[self.event]
        others = np.array([np.delete(slopes, hop, axis=1).prod(1) for hop in range(self.period)])
        values.jacobian[:, -1] = np.einsum("hm,mhj->mj", others, bends)

    def alphas_at(self, xs: np.ndarray) -> np.ndarray:
        """The launch speeds (m, period) at points (m, n + 1), in the machine's units."""
        return xs[:, self.speeds] * self.unit_at(xs)[:, None]

    def size(self, lanes: np.ndarray, xs: np.ndarray) -> np.ndarray:
        size = np.abs(xs)
        size[:, :-2] = np.maximum(size[:, :-2], 0.1 * size[:, :-2].max(1, keepdims=True))
        size[:, -2], size[:, -1] = np.maximum(size[:, -2], self.least), self.span
        return size

    def certify(self, points: Points) -> tuple[Points, dict[int, Exception]]:
        """The points with their slacks; there are no machines where some are refused."""
        ps, errors = self.parameters(points.xs), dict[int, Exception]()
        for i, p in enumerate(ps.tolist()):
            try:
                self.machine.with_values(**dict(zip(self.hops.names, p, strict=True)))
            except OrbitsError as error:
                errors[i] = error
        found = np.column_stack([points.evaluation.slacks[points.places], self.sampled(points)])[:, self.others]
        own = np.empty(len(points), object)
        own[:] = [tuple(each) for each in found.tolist()]
        return points.having(own=own, evaluation=None), errors  # without the motions, which are long

    def changed(self, event: Event, passed: Sequence[Points]) -> End:
        slack = self.slacks[self.others[int(np.argmin(event.point.own[0]))]]
        return End("border", f"{in_words(slack)}: from there on the hops have other impacts")

    def lost(self, lane: int, passed: Sequence[Points], error: object) -> End:
        where = f"at {self.second} = {passed[-1].values[-1]:.10g}"
        if isinstance(error, InputError):
            return End("degenerate", f"the machine ceases to exist {where}: {error}")
        return End("stuck", f"{where}: {error}")


def _kind_of_turn(problem: Any, point: Points, _: int) -> str | None:
    """A turn, or a cusp of folds, where the curve turns round in both parameters; None for that at the end of a
    curve."""
    if min(point.own[0]) < SAME.share:
        return None
    share = abs(point.tangents / problem.size(point.lanes, point.xs))[0, -2]
    return "cusp" if problem.event == "fold" and share < SAME.cusp else "turn"


def _bifurcation_near(curve: EventCurve, x: np.ndarray, way: float, options: Steps) -> Points:
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
    machine, curve, x, border = _event_curve(machine, along, event, second, inject)
    start = float(x[-1])
    behind, stop = bounds_of(second, start, stop, options.at)
    if second != INJECT:
        for bound in (behind, stop):
            machine.with_values(**{second: bound})  # an impossible machine is refused before the search
    curve.span, steps = abs(stop - behind), options.steps(options.step_control.largest_batch)
    first = _bifurcation_near(curve, x, stop - start, steps)
    if abs(first.xs[0, -2] - event.value) > SAME.share * max(abs(event.value), curve.least):
        nearest = f"the nearest one is at {first.xs[0, -2]:.9g}"
        raise NoOrbit(f"{along} = {event.value:.9g} is not a {event.kind}: {nearest}")
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
    words, units = machine_in_words(machine), machine.units
    texts = {**words.get("units", {}), **dict.fromkeys(("alpha", INJECT), units.text(LIFTOFF_SPEED))} if units else {}
    about, places = (event.kind, along, second, words, curve.word), (xs[:, -2:], curve.alphas_at(xs))
    return BifurcationCurve(*about, *places, tuple(events), replace(end, reason=reason), border, texts)


def located(machine: Machine, along: str, event: Bifurcation, inject: float = 0.0) -> Bifurcation:
    """A flip, fold or border collision of hops by Newton's method on its equations, from a guess of it: with the exact
    value of the parameter and launch speeds. Raises `NoOrbit` where the method does not converge."""
    _, curve, x, _ = _event_curve(machine, along, event, "", inject)
    (x,) = _bifurcation_near(curve, x, 1.0, Steps()).xs
    alphas = tuple(curve.alphas_at(x[None])[0].tolist())
    return replace(event, value=float(x[-2]), alphas=alphas, multiplier=MULTIPLIER_AT.get(event.kind, np.nan))


def _event_curve(
    machine: Machine, along: str, event: Bifurcation, second: str, inject: float
) -> tuple[Machine, EventCurve, np.ndarray, str]:
    """The machine at a bifurcation, its curve along a second parameter, for "" along any other one, a guess of the
    point there, and what happens at a border, in words."""
    _check_event(machine, along, event, second)
    if along == INJECT:
        inject = event.value
    else:
        machine = machine.with_values(**{along: event.value})
    second = second or _other_than(along, machine)
    speed = machine.units.of(LIFTOFF_SPEED) if machine.units else 1.0
    hops = _Hops(Impacts(machine), [alpha / speed for alpha in event.alphas])
    if hops.lossless(SAME.slow) is not None and (event.kind == "fold" or len(event.alphas) == 1):
        raise InputError("this fold is a lossless hop: `follow` follows it along a parameter, without an injection")
    start = inject if second == INJECT else machine.values[second]
    span = max(abs(start), 1.0)
    if event.kind in MULTIPLIER_AT:
        curve = EventCurve(machine, along, second, event.kind, hops.word, inject, span)
        return machine, curve, np.array([*hops.varied(curve.hops), event.value, start]), ""
    word, x, slack, border = hops.border()
    curve = EventCurve(machine, along, second, slack, word, inject, span)
    return machine, curve, np.array([*x, event.value, start]), border


def _other_than(along: str, machine: Machine) -> str:
    """A parameter of hops other than one."""
    return next(name for name in (*machine.values, INJECT) if name != along)


def _check_event(machine: Machine, along: str, event: Bifurcation, second: str) -> None:
    """Raise `InputError` where a bifurcation cannot be followed along a second parameter."""
    model = machine.model
    if not isinstance(event, Bifurcation):
        raise InputError(f"event = {event!r}; it must be one of the `events` of a diagram")
    if not model.one_speed or not model.plain or model.hysteretic:
        other = "steps" if model.one_speed else "has launches of several numbers"
        what = "has hysteresis" if model.hysteretic else other
        raise InputError(f"a {model.name} {what}: bifurcations can be followed only where a launch is one speed")
    if event.kind not in (*MULTIPLIER_AT, *COLLISIONS):
        have = ", ".join((*MULTIPLIER_AT, *COLLISIONS))
        raise InputError(f"a {event.kind} has no curve in two parameters here; {have} have one")
    known = [name for name in parameters_of_maps(machine) if name not in (along, RESTITUTION)]
    if second and second not in known:
        raise InputError(f"second = '{second}'; a {event.kind} in {along} can be followed along {', '.join(known)}")
    if along == RESTITUTION or cast(Any, machine).restitution > 0:
        raise InputError(
            "with a restitution a hop has infinitely many impacts: bifurcations can be followed only with restitution 0"
        )
    if second and second not in (INJECT, *machine.values):
        raise InputError(f"second = '{second}': its value in the machine is 0; give it a small one")


class _Hops:
    """The hops of a bifurcation from launch speeds (period,), impact by impact."""

    def __init__(self, impacts: Impacts, alphas: Sequence[float]):
        self.impacts, self.hops = impacts, flown_hops(impacts, np.array(alphas))
        if not self.hops.counts.all():
            raise NoOrbit("the hops of this bifurcation are not found again at its launch speeds")
        self.word: Word = tuple(self.hops.counts.tolist())

    def lossless(self, slow: float) -> int | None:
        """The index of a hop that is lossless: its first landing is slower than a share of the launch speed, without a
        force."""
        for hop, alpha in enumerate(self.hops.alphas.tolist()):
            speed, force = self._at(self.hops.landings[hop, 0])
            if speed <= slow * alpha and force <= SAME.force:
                return hop
        return None

    def unknowns(self) -> list[list[float]]:
        """The unknowns of each hop."""
        return [self.hops.unknowns(self.impacts, np.array([hop]))[0].tolist() for hop in range(len(self.word))]

    def varied(self, hops: HopsAlong) -> list[float]:
        """The unknowns of all hops and of their variations."""
        found = list[float]()
        for count, us in zip(self.word, np.array(self.unknowns(), object), strict=True):
            hop, u = hops.hop(count), np.array(us, dtype=float)[None]
            _, evaluation = hop.equations.evaluate_lanes(u, self.impacts.p[None], fewest=True)
            if evaluation is None:
                raise NoOrbit("the hops of this bifurcation cannot be followed")
            found += [*u[0], *hop.moved(evaluation.jacobian)[0, :, 0]]
        return found

    def border(self) -> tuple[Word, list[float], Slack, str]:
        """The word at the border that the hops are at, their unknowns, the slack that vanishes there, and what happens
        in words; raises `NoOrbit` where there is no border."""
        us, word = self.unknowns(), list(self.word)
        if (hop := self.lossless(SAME.near_border)) is not None:
            found = [(0.0, Slack(FORCE, hop), 0.0)]
        else:
            found = list[tuple[float, Slack, float]]()
            for hop, (alpha, count) in enumerate(zip(self.hops.alphas.tolist(), self.word, strict=True)):
                for impact, x in enumerate(self.hops.landings[hop, :count]):
                    speed, force = self._at(x)
                    found.append((force, Slack(FORCE, hop, impact), 0.0))
                    if impact + 1 < count:
                        found.append((speed / alpha, Slack(SPEED, hop, impact), 0.0))
                    near = self._near_grazes(hop, impact)
                    found += [(size / alpha, Slack(SPEED, hop, impact), time) for size, time in near]
        size, slack, time = min(found, key=lambda each: each[0])
        if not size <= SAME.near_border:
            raise NoOrbit(
                "at these launch speeds no impact is about to vanish: the map's slope jumps for another reason"
            )
        own, place = us[slack.hop], slack.impact + 2  # the flight up to the impact
        if time:  # it does not touch yet
            own[place : place + 1] = [time, own[place] - time]
            word[slack.hop] += 1
        elif slack.kind == FORCE:
            for _ in range(word[slack.hop] - slack.impact - 1):  # flights that have no duration there
                own[place + 1 : place + 3] = [own[place + 1] + own[place + 2]]
                word[slack.hop] -= 1
        lossless = slack.kind == FORCE and self.lossless(SAME.near_border) is not None
        text = in_words(Slack(GAP, *slack[1:]) if slack.kind == SPEED else slack, lossless)
        return tuple(word), [each for own in us for each in own], slack, text

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
