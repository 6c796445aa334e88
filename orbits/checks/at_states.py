"""Comparisons of a machine with its statement at random states: lengths, maps, forces, impacts and energies.

Derived quantities are never compared with themselves. With places q, speeds v and accelerations a of the model, the
stated elements must balance along every coordinate (d'Alembert's principle),

    sum of m h'' dh/dq  +  sum of forces on extensions r times dr/dq  =  F dg/dq,

where h'' is the second derivative of a stated height or extension, and F the contact force on the gap g, 0 in flight.
"""

from collections.abc import Callable, Mapping

import casadi as ca
import numpy as np

from ..errors import InputError
from ..hops import Simulation
from ..mechanics import Balance, Mass, Mechanism, value_of
from ..model import (
    CONTACT_FORCE,
    LANDED_FORCE,
    NORMAL_FORCE,
    TANGENTIAL_FORCE,
    Machine,
    Phase,
    names_of_holding,
)
from ..periodic import Orbit
from ..symbolic import MappedFunction
from ..units import ENERGY, FORCE, LENGTH, SPEED, TIME, Dimension
from .relation import OPTIONS, Relation, share, share_of_each


class AtStates:
    """A machine together with its statement. All states are in the units of the statement; those of contact are y (N,
    m)."""

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
            raise InputError(f"the laws of the {self.stated.name} have no finite values near rest")
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
        if planar := model.planar:
            weight = planar.weight and (lambda x, p, heavy=planar.weight: heavy(p))
            owns = (planar.across, LENGTH), (planar.travel, SPEED), (weight, FORCE)
            for (own, unit), along in zip(owns, balanced["across"][..., 0].T, strict=True):
                if own is not None:
                    seen = self._of_model(x, lambda x, p, q, own=own: [own(x, p)])[:, 0] * self.unit(unit)
                    off.append(share(seen - along, seen, 0.0 if unit is FORCE else x))
        return Relation("gaps, distances, heights and maps agree with the statement", max(off))

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
                off.append(share_of_each(seen * units - stated[name][..., 0], stated[name][..., 0]))
        return Relation("in flight the forces equal masses times accelerations", max(off))

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
        return Relation("in contact the forces equal masses times accelerations", off)

    def _in_closed_form(self, where: str, x: np.ndarray) -> float:
        """By which share the accelerations and the watched forces of a closed form are not those of the phase."""
        phase: Phase = getattr(self.model, where)
        if phase.closed_form is None:
            return 0.0
        size, (rates, watched), form = self.sizes[where], self._rates(where, x), phase.closed_form(self.machine.values)
        places, speeds = (slice(i, 2 * len(form.squares), 2) for i in (0, 1))
        pushes = (form.loads - form.squares * ((x / size)[:, places] @ form.apart.T)) @ form.shapes.T
        off = [share_of_each(pushes * size[speeds] / self.unit(TIME) - rates[:, speeds], rates[:, speeds])]
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
        off.append(share_of_each(terms.sum(2) - held, np.abs(terms).sum(2) + np.abs(held)))
        if NORMAL_FORCE in watched:
            seen = np.column_stack([watched[NORMAL_FORCE], watched[TANGENTIAL_FORCE]])
            off.append(share(seen - balanced["ground"][..., 0], seen, balanced["ground"]))
        return max(off)

    def _gradient(self, x: np.ndarray) -> Relation:
        seen = self._of_model(x, lambda x, p, q: self.model.flight_gradient(x, p, q)) / self.sizes["flight"]
        stated = self.balance(x)["gradient"][..., 0]
        off = share_of_each(seen * self.unit(ENERGY) * self.energy_unit - stated, stated)
        return Relation("the energy's slopes agree with masses, heights and laws", off)

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
