"""Checks of a machine against its statement: masses, heights, laws, gaps and maps.

Nothing that is derived is compared with itself. With places q, speeds v and accelerations a of the model, the stated
elements have to balance along every coordinate (d'Alembert's principle),

    sum of m h'' dh/dq  +  sum of forces on extensions r times dr/dq  =  F dg/dq,

where h'' is the second derivative of a stated height or extension, and F the contact force on the gap g, 0 in flight.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from .errors import InconsistentModel, InputError, NoOrbit, finite_number
from .hops import Simulation, simulate
from .laws import Algebraic, coefficient_of_restitution
from .mechanics import Balance, Damper, Force, Mass, Mechanism, value_of
from .model import (
    CONTACT_FORCE,
    LANDED_FORCE,
    NORMAL_FORCE,
    TANGENTIAL_FORCE,
    Machine,
    Phase,
    dimensionless,
    machine_in_words,
    names_of_holding,
)
from .periodic import Orbit, StartLike, find, start_in_file
from .result import Result
from .returns import ReturnMap
from .running import exclusive
from .symbolic import BufferedFunction, MappedFunction
from .units import ENERGY, FORCE, LENGTH, LIFTOFF_SPEED, SPEED, TIME, Dimension


@dataclass(frozen=True)
class CheckOptions:
    """The numbers of `check`.

    exact : what is exact holds to this share of its terms: rounding is far below, a mistake far above
    tolerance, same_motion : motions are integrated again with this relative tolerance, and agree to `same_motion`,
        since a motion amplifies errors, and laws may have corners
    moments : of such a motion, an odd number, so that one is its middle
    spreads : states lie this far about rest, in sizes of an orbit; the nearest are for laws with a small range
    states : with each spread
    beside : hops begin at this multiple of an orbit's launch speed, or state, so that they lose energy
    launch : the launch speed of a hop of a machine without an orbit
    hops, impacts : how many of them are followed, and the most impacts in each: a machine that rattles has
        some 80 before it stays in contact, and one that rolls down a slope has no last one
    """

    exact: float = 1e-8
    tolerance: float = 1e-11
    same_motion: float = 1e-6
    moments: int = 41
    spreads: tuple[float, ...] = (1.0, 0.3, 0.1, 0.01)
    states: int = 6
    beside: float = 1.05
    launch: float = 2.0
    hops: int = 2
    impacts: int = 100


OPTIONS = CheckOptions()


@dataclass(frozen=True)
class Relation:
    """A relation between a machine and its statement: in words, and by which share it does not hold."""

    words: str
    deviation: float
    bound: float = OPTIONS.exact

    @property
    def holds(self) -> bool:
        """Whether the deviation is rounding."""
        return self.deviation <= self.bound


@dataclass(frozen=True, repr=False)
class Checked(Result, what="check", printed_digits=2, undrawn="relations have nothing to draw: print them"):
    """The relations that `check` found to hold for a machine; printed, a table of them with their largest deviations.

    machine : in words and numbers
    relations : each with its deviation
    left_out : relations that could not be checked, with the reason
    """

    machine: Mapping[str, Any]
    relations: tuple[Relation, ...]
    left_out: tuple[str, ...] = ()

    @property
    def largest(self) -> float:
        """The largest deviation as a share of its tolerance."""
        return max(each.deviation / each.bound for each in self.relations)

    def _line(self) -> dict[str, object]:
        return {"machine": self.machine["machine"], "relations": len(self.relations), "largest": self.largest}

    def title(self) -> str:
        return f"{self.machine['machine']}: {len(self.relations)} relations hold"

    def _notes(self) -> list[str]:
        return list(self.left_out)

    def table(self) -> dict[str, list[Any]]:
        """The relations as columns: in words, their deviations, and the allowed ones."""
        columns = zip(*((each.words, each.deviation, each.bound) for each in self.relations), strict=True)
        return dict(zip(("relation", "deviation", "bound"), map(list, columns), strict=True))


@exclusive
def check(machine: Machine, *, start: StartLike | None = None) -> Checked:
    """Check that a machine moves as it is stated.

    machine : a `Mechanism`, or a machine that is stated as one, as those of `problems`
    start : an initial guess as in `find`, for a machine whose launch has several numbers. For a machine with a
        coordinate that sticks it is an orbit of that machine, to which numbers of the machine are tuned

    The forces of the stated elements have to balance at random states, in flight and in contact, and so have impulses
    at impacts and hand-overs; gaps, heights, extensions, spring forces and the maps of steps have to be those stated.
    An orbit, and a hop beside it, are integrated again by SciPy's DOP853, along which the energy is summed from masses,
    heights and laws. The orbit has to land in the mirror image of its launch, to lift off without a force, and to be
    that of all equations where it is found by the reduced ones; the return map has to have the launches of the
    simulation. What a machine does not have, or what is not found, is not compared: `left_out` says so.
    Raises `InputError` for a machine that is not stated and for numbers out of their bounds, and `InconsistentModel`
    with all relations that do not hold.

    >>> from orbits import check
    >>> from problems import Hopper
    >>> check(Hopper()).largest < 1
    True
    """
    if not hasattr(machine, "stated"):
        kind = type(machine).__name__
        raise InputError(f"a {kind} is not stated, so there is nothing to check it against: state an orbits.Mechanism")
    _refuse_numbers(machine)
    stated: Mechanism = machine.stated()
    launch = start_in_file(start) if isinstance(start, str | Path) else start
    left_out = list[str]()
    bare = machine if stated.in_si else dimensionless(machine)
    if launch is not None and bare is not machine and machine.units is not None:
        launch = machine.units.dimensionless("start", launch)
    relations = _Compared(bare, stated).relations(launch, left_out)
    if broken := [each for each in relations if not each.holds]:
        text = "; ".join(f"{each.words}: off by {each.deviation:.2g}" for each in broken)
        raise InconsistentModel(f"the {stated.name} does not move as it is stated: {text}", tuple(broken))
    return Checked(machine_in_words(machine), tuple(relations), tuple(left_out))


def _refuse_numbers(machine: Machine) -> None:
    """Raise `InputError` for a number of the machine that is out of its bounds."""
    for name, value in machine.values.items():
        finite_number(name, value)
    coefficient_of_restitution(getattr(machine, "restitution", 0.0))
    if (rest_length := getattr(machine, "rest_length", None)) is not None:
        finite_number("rest_length", rest_length)


class _Compared:
    """A machine beside its statement. All states are in the units of the statement; those of contact are y (N, m)."""

    def __init__(self, machine: Machine, stated: Mechanism):
        self.machine, self.model, self.stated = machine, machine.model, stated
        self.balance, self.count = Balance(stated, OPTIONS.exact), len(stated.coordinates)
        self.places, self.speeds = slice(0, 2 * self.count, 2), slice(1, 2 * self.count, 2)
        self.sticking = [stated.coordinates.index(name) for name in self.model.sticks]
        self.unit: Callable[[Dimension], float] = machine.units.of if machine.units else lambda dimension: 1.0
        self.energy_unit = float(ca.evalf(ca.SX(value_of(stated.energy_unit, {}, stated.values))))
        self.sizes = {"flight": self._sizes(self.model.flight), "contact": self._sizes(self.model.contact)}
        self.embed = np.asarray(self.model.embed, float) * self.sizes["flight"][:, None] / self.sizes["contact"]
        self.moves = {"flight": self._moves("flight"), "contact": self._moves("contact")}
        # Of the energy along motions, as shares of it; and their rates by phase.
        self.drifts, self.integrands = list[float](), dict[str, BufferedFunction]()

    def relations(self, start: Orbit | Mapping[str, float] | None, left_out: list[str]) -> list[Relation]:
        """All relations, each with its deviation."""
        orbit = self._orbit(start, left_out)
        run = self._hop(orbit, left_out)
        x = self._states(orbit)
        with np.errstate(all="ignore"):  # a deviation that is no number counts as unbounded
            found = [self._lengths(x), self._flight(x), self._contact(x, run), self._gradient(x), self._impact(x, run)]
            found += [*self._conserves(), *self._reduced(orbit, start, left_out)]
            found += self._along_orbit(orbit) if orbit else ()
            found += [self._along_hops(run, left_out)] if run else []
        words = "the energy along motions is that of the masses, heights and laws"
        return [*found, *([Relation(words, max(self.drifts), OPTIONS.same_motion)] if self.drifts else [])]

    def _orbit(self, start: Orbit | Mapping[str, float] | None, left_out: list[str]) -> Orbit | None:
        """An orbit of the machine; None where it has none, or none is found without a start."""
        unused = "" if start is None else ", so that start= is not used"
        if self.model.hysteretic or not self.model.conservative:
            left_out.append(f"no orbit: the machine loses energy, or forces drive it{unused}")
        elif self.model.sticks:
            if isinstance(start, Orbit) and start.source is not None and start.source.values == self.machine.values:
                return start
            unused = unused and ", and start= is not used, since it is no orbit of this machine"
            left_out.append(f"no orbit: its numbers are tuned; check(orbit.source, start=orbit) takes one{unused}")
        else:
            try:
                return find(self.machine, start=start)
            except NoOrbit as error:
                left_out.append(f"no orbit: {error}")
        return None

    def _conserves(self) -> Iterator[Relation]:
        """A model that loses energy has an element that does so: it would have no orbit to compare otherwise."""
        losing = any(isinstance(each, Damper | Force) for each in self.stated.elements) or self.stated.actuators
        if not (self.model.conservative or losing or self.model.hysteretic):
            yield Relation("energy is conserved where nothing that is stated loses it", np.inf)

    def _reduced(
        self, orbit: Orbit | None, start: Orbit | Mapping[str, float] | None, left_out: list[str]
    ) -> Iterator[Relation]:
        """The orbit by the reduced motion is that by all equations of motion, which may be found where that is not."""
        if self.model.reduction is None or not self.model.conservative or self.model.hysteretic:
            return
        try:
            whole = find(self.machine, start=start, method="half orbit")
        except NoOrbit as error:
            if orbit:
                left_out.append(f"no orbit by all equations: {error}")
            return
        off = share(whole.alpha - orbit.alpha, whole.alpha) if orbit else np.inf
        yield Relation("the reduced motion has the orbit of all equations", off, OPTIONS.same_motion)

    def _hop(self, orbit: Orbit | None, left_out: list[str]) -> Simulation | None:
        """Hops that lose energy: beside an orbit, or of a machine that a kick along the gap lifts from rest."""
        if self.model.hysteretic:
            left_out.append("no hop: the phases have the mean law of a spring with hysteresis, and hops its branches")
            return None
        rest = self._rest()
        if orbit:
            rest = OPTIONS.beside * orbit(orbit.flight_time / 2)
        elif not self.model.one_speed:
            here = self.balance(rest[None])
            try:
                kick = np.linalg.solve(here["inertia"][0], here["along_gap"][0, :, 0])
            except np.linalg.LinAlgError:
                left_out.append("no hop: the inertia is singular at rest, where a kick would lift the machine")
                return None
            rest[self.speeds] = OPTIONS.launch * kick / (kick @ here["along_gap"][0, :, 0])
        alpha = OPTIONS.beside * orbit.alpha if orbit else OPTIONS.launch * self.unit(LIFTOFF_SPEED)
        begins = {"alpha": alpha} if self.model.one_speed else {"state": rest}
        try:
            run = simulate(self.machine, **begins, hops=OPTIONS.hops, cap=OPTIONS.impacts)
        except (InputError, NoOrbit) as error:
            left_out.append(f"no hop: {error}")
            return None
        if run.legs:
            return run
        left_out.append(f"no hop: the simulation ends where it begins, {run.reason or run.status}")
        return None

    def _rest(self) -> np.ndarray:
        """The flight state at rest in contact."""
        still = np.zeros(len(self.model.flight.states))
        return self.sizes["flight"] * (self.model.rest(self.machine.values) if self.model.rest else still)

    def _states(self, orbit: Orbit | None) -> np.ndarray:
        """States (N, n) about rest as far away as an orbit, where the stated laws have numbers, also on the ground."""
        size, rest = np.ones(len(self.model.flight.states)), self._rest()
        if orbit:
            far = np.abs(orbit(np.linspace(0, orbit.flight_time, 5)) - rest)
            size[self.places], size[self.speeds] = far[:, self.places].max(), far[:, self.speeds].max()
        spreads = np.repeat(OPTIONS.spreads, OPTIONS.states)[:, None] * size
        x = rest + spreads * np.random.default_rng(1).standard_normal(spreads.shape)
        fine = [np.isfinite(self.balance(each)["terms"]).all((1, 2)) for each in (x, self._on_ground(x) @ self.embed.T)]
        if not (fine[0] & fine[1]).any():
            raise InputError(f"the laws of the {self.stated.name} have no numbers near rest")
        return x[fine[0] & fine[1]]

    def _on_ground(self, x: np.ndarray) -> np.ndarray:
        """The contact states (N, m) nearest to flight states."""
        return x @ np.linalg.pinv(self.embed).T

    def _lengths(self, x: np.ndarray) -> Relation:
        """The gaps, the separation, the extension, the heights, the place of rest, and the maps of steps."""
        model, p, size = self.model, self.machine.values, self.sizes["flight"]
        heights, balanced = dict(model.heights(p)), self.balance(x)
        functions = [model.gap(p), model.landing_gap_of(p), model.separation(p), model.extension_of(p)]
        functions += [heights.pop(name, None) for name in self.stated.heights or {}]
        pairs = list(zip(functions, balanced["lengths"][..., 0].T, strict=True))
        off = [share(self._rest() - self.balance.rest, x, self.balance.rest)]
        # Heights of other names are those of the masses, or of their centre, from any level: their rises matter.
        centre, masses = heights.pop("centre of mass", None), balanced["places"][..., 0].T
        for function, stated in [(centre, balanced["centre"][:, 0, 0]), *zip(heights.values(), masses, strict=False)]:
            pairs.append((function and (lambda x, own=function: own(x) - own(x[:1])), stated - stated[0]))
        for function, stated in pairs:
            if function is not None:
                seen = np.asarray(function(x / size)) * self.unit(LENGTH)
                off.append(share(seen - stated, x[:, self.places], stated))
        maps = {"relabelled": model.relabelling} | ({"reversed": model.reversal} if model.reversor else {})
        off += [share(own(x / size, p) * size - balanced[name][..., 0], x) for name, own in maps.items()]
        off.append(self._along_ground(x))
        return Relation("gaps, distances, heights and maps are those that are stated", max(off))

    def _flight(self, x: np.ndarray) -> Relation:
        """The balance in flight, and the forces of the springs."""
        rates, watched = self._rates("flight", x)
        off = [self._unbalanced(x, rates, np.zeros((len(x), self.count)), watched), self._in_closed_form("flight", x)]
        stated, model = self.balance(x), self.model
        dimensions = [model.spring_dimensions.get(name, FORCE) for name in model.spring_forces]
        for own, name in (([*model.spring_forces.values()], "springs"), ([model.tension], "tension")):
            if any(own):
                seen = self._of_model(x, lambda x, p, q, own=own: [each(x, p, q) for each in own])
                units = [self.unit(dimension) for dimension in [*dimensions, FORCE][: len(own)]]
                off.append(_share_of_each(seen * units - stated[name][..., 0], stated[name][..., 0]))
        return Relation("in flight masses times accelerations balance the forces", max(off))

    def _contact(self, x: np.ndarray, run: Simulation | None) -> Relation:
        """The balance in contact, without a force at a launch; the force on a point that has just landed is that of the
        labels before."""
        y = self._on_ground(x)
        closed = self._in_closed_form("contact", y)
        rates, watched = self._rates("contact", y)
        x, rates = y @ self.embed.T, rates @ self.embed.T
        pressing = float(np.abs(watched[CONTACT_FORCE]).max())
        held = watched[CONTACT_FORCE][:, None] * self.balance(x)["along_gap"][..., 0]
        for place, name in zip(self.sticking, names_of_holding(self.model.sticks), strict=True):
            held[:, place] += watched[name]
        off = max(self._unbalanced(x, rates, held, watched), closed)
        if LANDED_FORCE in watched:
            zero, one = self.balance(np.stack([0 * x[0], 0 * x[0] + 1]))["relabelled"][..., 0]
            x, rates = (x - zero) * (one - zero), rates * (one - zero)
            held = watched[LANDED_FORCE][:, None] * self.balance(x)["along_landing_gap"][..., 0]
            off = max(off, self._unbalanced(x, rates, held, {}))
        if run and self.model.one_speed:
            released = self._rates("contact", self._on_ground(run(0.0)[None]))[1][CONTACT_FORCE]
            off = max(off, share(released, pressing))
        return Relation("in contact the contact force balances them", off)

    def _in_closed_form(self, where: str, x: np.ndarray) -> float:
        """By which share the accelerations and the watched forces of a closed form are not those of the phase."""
        phase: Phase = getattr(self.model, where)
        if phase.closed_form is None:
            return 0.0
        size, (rates, watched), form = self.sizes[where], self._rates(where, x), phase.closed_form(self.machine.values)
        places, speeds = (slice(i, 2 * len(form.squares), 2) for i in (0, 1))
        pushes = (form.loads - form.squares * ((x / size)[:, places] @ form.apart.T)) @ form.shapes.T
        off = [_share_of_each(pushes * size[speeds] / self.unit(TIME) - rates[:, speeds], rates[:, speeds])]
        for name, (weights, force) in form.watch.items():
            seen = (x / size @ np.asarray(weights, float) + force) * self.unit(FORCE)
            off.append(share(seen - watched[name], watched[name]))
        return max(off)

    def _unbalanced(
        self, x: np.ndarray, rates: np.ndarray, held: np.ndarray, watched: Mapping[str, np.ndarray]
    ) -> float:
        """By which share the terms along any coordinate differ from the forces (N, n) that hold the machine, the rates
        of places from speeds, and the watched forces of the ground from what all masses need."""
        balanced = self.balance(x, rates[:, self.speeds])
        terms, off = balanced["terms"], [share(rates[:, self.places] - x[:, self.speeds], x)]
        off.append(_share_of_each(terms.sum(2) - held, np.abs(terms).sum(2) + np.abs(held)))
        if NORMAL_FORCE in watched:
            seen = np.column_stack([watched[NORMAL_FORCE], watched[TANGENTIAL_FORCE]])
            off.append(share(seen - balanced["ground"][..., 0], seen, balanced["ground"]))
        return max(off)

    def _gradient(self, x: np.ndarray) -> Relation:
        seen = self._of_model(x, lambda x, p, q: self.model.flight_gradient(x, p, q)) / self.sizes["flight"]
        stated = self.balance(x)["gradient"][..., 0]
        off = _share_of_each(seen * self.unit(ENERGY) * self.energy_unit - stated, stated)
        return Relation("the energy has the slopes of the masses, heights and laws", off)

    def _impact(self, x: np.ndarray, run: Simulation | None) -> Relation:
        """A plastic impact changes the momentum along the gap and along what sticks alone, and stops these. With B the
        slopes of these, and M the inertia, the first of the masses (B^T M^-1 B)^-1 is the impact's own."""
        before = self._on_ground(x) @ self.embed.T
        before[:, self.speeds] = x[:, self.speeds]
        after = self._of_model(before, lambda x, p, q: self.model.landed(x, p)) * self.sizes["flight"]
        known = self._of_model(before, lambda x, p, q: [self.model.lost_at(x, p), self.model.impact_mass(x, p)])
        lost, mass = (known * self.unit(ENERGY) * self.energy_unit).T
        here, there = self.balance(before), self.balance(after)
        held = np.tile(np.eye(self.count)[:, self.sticking], (len(x), 1, 1))
        along = np.concatenate([here["along_gap"], held], axis=2)
        change = here["inertia"] @ (after - before)[:, self.speeds, None]
        masses = np.linalg.inv(np.swapaxes(along, 1, 2) @ np.linalg.solve(here["inertia"], along))[:, 0, 0]
        loss = (here["kinetic"] - there["kinetic"])[:, 0, 0]
        off = [share(change - along @ (np.linalg.pinv(along) @ change), change), self._losses(run)]
        off.append(share(np.swapaxes(along, 1, 2) @ after[:, self.speeds, None], before[:, self.speeds]))
        off.append(share((after - before)[:, self.places], before))
        off += [share(lost - loss, loss), share(mass / self.sizes["flight"][1] ** 2 - masses, masses)]
        off.append(self._handed_over(x))
        return Relation("impacts change momentum and energy as the masses require", max(off))

    def _handed_over(self, x: np.ndarray) -> float:
        """By which share hand-overs change momentum: the point that lands gets an impulse alone, so that momentum along
        all motions about it stays. A relabelling that flips signs mirrors the places across."""
        planar, size, label, off = self.model.planar, self.sizes["flight"], self.model.relabelling, [0.0]
        p = self.machine.values
        if planar is None or planar.handed_over is None:
            return 0.0
        heights = sum(isinstance(each, Mass) for each in self.stated.elements)
        for handed, onward in ((planar.handed_over, label), (planar.handed_back, label.inverse)):
            named = onward(x / size, p) * size
            after = self._of_model(x, lambda x, p, q, handed=handed: handed(x, p)) * size
            off.append(share((after - named)[:, self.places], named))
            before, renamed, then = self.balance(x), self.balance(named), self.balance(after)
            before["rates"][:, heights:] *= min(label.signs)
            change = then["by_rates"] @ (then["rates"] - before["rates"]) + then["turning"] - renamed["turning"]
            off.append(share(change, then["by_rates"] @ then["rates"] + then["turning"]))
        return max(off)

    def _along_ground(self, x: np.ndarray) -> float:
        """By which share the centre of mass along the ground, its speed and the weight are not the stated ones."""
        off, planar, units = [0.0], self.model.planar, (LENGTH, SPEED, FORCE)
        if planar is None:
            return 0.0
        heavy = planar.weight
        weight = (lambda x, p: heavy(p)) if heavy else None
        for i, own in enumerate((planar.across, planar.travel, weight)):
            if own is not None:
                seen = self._of_model(x, lambda x, p, q, own=own: [own(x, p)])[:, 0] * self.unit(units[i])
                off.append(share(seen - self.balance(x)["across"][:, i, 0], seen, x if i < 2 else 0.0))
        return max(off)

    def _losses(self, run: Simulation | None) -> float:
        """By which share the losses of a simulation's impacts are not those of the stated energies. An impact leaves
        the places as they are, or takes them to the labels of the next contact, or of the last one in a step back; of a
        landing that nothing is stated of the loss is not known."""
        off, events = [0.0], run.events if run else ()
        known = events[:-1] if run and run.status == "unstated" else events
        for event in (each for each in known if each.kind in ("impact", "landing")):
            before, after = (self.balance(each[None]) for each in (event.before, event.after))
            moves = [event.before - event.after, before["relabelled"][0, :, 0] - event.after]
            moves.append(event.before - after["relabelled"][0, :, 0])
            own = [move[self.places] for move in moves]
            for move in own:
                move[self.sticking] = 0.0  # it is counted from where it lands
            off.append(min(share(move, event.before, event.after) for move in own))
            energies = [(each["kinetic"] + each["stored"])[0, 0, 0] for each in (before, after)]
            off.append(share(energies[0] - energies[1] - event.loss * self.energy_unit, before["kinetic"]))
        return max(off)

    def _along_orbit(self, orbit: Orbit) -> Iterator[Relation]:
        """An orbit integrated again: its middles, its landing in the mirror image of the launch, and its lift-off."""
        launch, time, middle = orbit(0.0), orbit.flight_time, OPTIONS.moments // 2
        flown = self._integrated("flight", launch, time)
        landed = self.balance(np.stack([launch, flown[-1]]))
        image, gaps = landed["reversed"][0, :, 0], self.balance(flown)["gap"]
        turned, same = flown[-1] - image, [share(flown[middle] - orbit(time / 2), launch, flown)]
        turned[self.places][self.sticking] = 0.0  # it has moved on by a step
        ends = [share(turned, launch, image), share(np.minimum(gaps, 0.0), gaps) if orbit.admissible else 0.0]
        if orbit.contact is not None and orbit.contact_time is not None:
            y = self._integrated("contact", self._on_ground(landed["relabelled"][1, :, 0]), orbit.contact_time)
            force, stood = self._rates("contact", y)[1][CONTACT_FORCE], y @ self.embed.T
            same.append(share(stood[middle] - orbit(time + orbit.contact_time / 2), launch, stood))
            ends += [share(stood[-1] - launch, launch, stood), share(force[-1], force)]
            ends.append(share(np.minimum(force, 0.0), force) if orbit.admissible else 0.0)
        yield Relation("the orbit is that integrated by DOP853", max(same), OPTIONS.same_motion)
        words = "it lands in the mirror image of its launch, and lifts off without a force"
        yield Relation(words, max(ends), OPTIONS.same_motion)

    def _along_hops(self, run: Simulation, left_out: list[str]) -> Relation:
        """The legs of a simulation integrated again, and the return map of its launches."""
        off, kinds = [0.0], {event.kind for event in run.events}
        for leg, event in zip(run.legs, run.events, strict=False):
            begins = leg.path(0.0)[: len(self.sizes[leg.phase])]
            ends = self._integrated(leg.phase, begins, float(leg.path.times[-1]))
            ends = ends @ self.embed.T if leg.phase == "contact" else ends
            off.append(share(ends[-1] - event.before, event.before, ends))
        words, launches = "hops are those integrated by DOP853", run.launches
        known = np.isfinite(launches[:-1]) & np.isfinite(launches[1:])
        missing = [kind for kind in ("landing", "lift-off") if kind not in kinds]
        missing += ["return map"] if self.model.one_speed and not known.any() else []
        if missing:
            events = "1 event" if len(run.events) == 1 else f"{len(run.events)} events"
            left_out.append(f"no {' or '.join(missing)}: the hop ends after {events}, {run.status}")
        if self.model.one_speed and known.any():
            words += " and of the return map"
            hops = ReturnMap(self.machine)(launches[:-1][known])
            off.append(share(hops.next - launches[1:][known], launches[1:][known]))
        return Relation(words, max(off), OPTIONS.same_motion)

    def _integrated(self, where: str, start: np.ndarray, time: float) -> np.ndarray:
        """States (moments, n) of a motion by DOP853, along which kinetic energy and the work of forces are summed."""
        from scipy.integrate import solve_ivp  # takes longer to import than most checks take

        if where not in self.integrands:
            x = ca.SX.sym("x", len(start) + 1)  # the last is the work
            flown = ca.mtimes(self.embed, x[:-1]) if where == "contact" else x[:-1]
            rates = ca.vertcat(self.moves[where](x[:-1])[0], self.balance.power(flown))
            self.integrands[where] = BufferedFunction(ca.Function("rate", [x], [ca.densify(rates)]))
        rate = self.integrands[where]
        smallest = OPTIONS.tolerance * max(float(np.abs(start).max()), np.finfo(float).tiny)
        options = {"method": "DOP853", "rtol": OPTIONS.tolerance, "atol": smallest}
        times = np.linspace(0.0, time, OPTIONS.moments)
        run = solve_ivp(lambda t, x: rate(x)[0][:, 0], (0.0, time), [*start, 0.0], t_eval=times, **options)
        states, work = run.y[:-1].T, run.y[-1]
        kinetic = self.balance(states @ self.embed.T if where == "contact" else states)["kinetic"][:, 0, 0]
        self.drifts.append(share(kinetic + work - kinetic[0], kinetic, work))
        return states

    def _sizes(self, phase: Phase) -> np.ndarray:
        """The units (n,) of the states of the model."""
        return self.machine.units.of_states(phase.states) if self.machine.units else np.ones(len(phase.states))

    def _moves(self, where: str) -> ca.Function:
        """A state -> its rate, and the watched forces of the phase."""
        phase: Phase = getattr(self.model, where)
        x, p = ca.SX.sym("x", len(phase.states)), self.machine.values
        states = ca.vertsplit(x / self.sizes[where])
        q = phase.data(states, p)
        rate = ca.vertcat(*phase.field(states, p, q)) * self.sizes[where] / self.unit(TIME)
        forces = [each(states, p, q) for each in phase.watch.values()]
        return ca.Function(where, [x], [ca.densify(rate), ca.densify(ca.vertcat(*forces, 0)) * self.unit(FORCE)])

    def _rates(self, where: str, x: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """The rates (N, n) of states, and the watched forces (N,) by name."""
        rates, forces = MappedFunction(self.moves[where])(x)
        return rates[..., 0], dict(zip(getattr(self.model, where).watch, forces[..., 0].T, strict=False))

    def _of_model(self, x: np.ndarray, function: Callable) -> np.ndarray:
        """A function (x, p, q) of the model in flight, in its own units, at states (N, n)."""
        symbols, p = ca.SX.sym("x", x.shape[1]), self.machine.values
        states = ca.vertsplit(symbols / self.sizes["flight"])
        value = ca.vertcat(*function(states, p, self.model.flight.data(states, p)))
        return MappedFunction(ca.Function("seen", [symbols], [ca.densify(value)]))(x)[0][..., 0]


def share(residual: Algebraic, *magnitudes: Algebraic) -> float:
    """The largest residual as a share of the largest of the magnitudes; infinite where one is no number."""
    largest = float(np.max(np.abs(residual), initial=0.0))
    size = max((float(np.max(np.abs(each), initial=0.0)) for each in magnitudes), default=1.0)
    if largest == 0:
        return 0.0
    return largest / size if np.isfinite(largest) and np.isfinite(size) and size > 0 else np.inf


def _share_of_each(residual: np.ndarray, sizes: np.ndarray) -> float:
    """The largest residual (N, n) as a share of the largest size in its column: columns have different units."""
    return max(share(*each) for each in zip(residual.T, sizes.T, strict=True))
