"""The check of a machine against its statement: at states, along an orbit, and along hops near it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from ..errors import InconsistentModel, InputError, NoOrbit, finite_number
from ..hops import Simulation, simulate
from ..laws import coefficient_of_restitution
from ..mechanics import Damper, Force, Mechanism
from ..model import CONTACT_FORCE, Machine, check_machine, dimensionless, machine_in_words
from ..periodic import Orbit, StartLike, find, start_in_file
from ..result import Result
from ..returns import ReturnMap
from ..running import exclusive
from ..symbolic import MappedFunction
from ..units import LIFTOFF_SPEED
from .at_states import AtStates
from .relation import OPTIONS, Relation, share


@dataclass(frozen=True, repr=False)
class Checked(Result, what="check", printed_digits=2, undrawn="relations cannot be drawn: print them"):
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

    machine : a `Mechanism`, or a machine that is stated as one, such as those of `problems`
    start : an initial guess as in `find`, for a machine whose launch has several numbers. For a machine with a
        coordinate that sticks, an orbit of that machine, to which its parameters were tuned

    At random states, in flight and in contact, the forces of the stated elements must balance, and so must the impulses
    at impacts and changes of foot. Gaps, heights, extensions, spring forces and the maps of steps must agree with the
    statement. SciPy's DOP853 integrates an orbit and a hop near it again, and the energy along them is summed from
    masses, heights and laws. The orbit must land in the mirror image of its launch and lift off at zero contact force.
    Where reduced equations found it, it must satisfy all equations. The return map must give the launches of the
    simulation. `left_out` lists what could not be compared. Raises `InputError` for a machine without stated mechanics
    and for numbers out of their bounds, and `InconsistentModel` with all relations that do not hold.

    >>> from orbits import check
    >>> from problems import Hopper
    >>> check(Hopper()).largest < 1
    True
    """
    if not hasattr(machine, "stated"):
        kind = type(machine).__name__
        raise InputError(f"a {kind} states no mechanics to check: state an orbits.Mechanism")
    check_machine(machine)
    if machine.model.height is not None:
        raise InputError(f"the gap of a {machine.model.name} is a formula, with which check compares nothing")
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
        raise InconsistentModel(f"the {stated.name} does not move as its statement says: {text}", tuple(broken))
    return Checked(machine_in_words(machine), tuple(relations), tuple(left_out))


def _refuse_numbers(machine: Machine) -> None:
    """Raise `InputError` for a number of the machine that is out of its bounds."""
    for name, value in machine.values.items():
        finite_number(name, value)
    coefficient_of_restitution(getattr(machine, "restitution", 0.0))
    if (rest_length := getattr(machine, "rest_length", None)) is not None:
        finite_number("rest_length", rest_length)


class _Compared(AtStates):
    """The relations of a machine: at states, along an orbit, and along hops."""

    def __init__(self, machine: Machine, stated: Mechanism):
        super().__init__(machine, stated)
        # The energy's drifts along motions, as shares of it, and the rates of states and of the work by phase.
        self.drifts, self.integrands = list[float](), dict[str, MappedFunction]()

    def relations(self, start: Orbit | Mapping[str, float] | None, left_out: list[str]) -> list[Relation]:
        """All relations, each with its deviation."""
        orbit = self._orbit(start, left_out)
        run = self._hop(orbit, left_out)
        x = self._states(orbit)
        with np.errstate(all="ignore"):  # a deviation that is not a number counts as unbounded
            found = [self._lengths(x), self._flight(x), self._contact(x, run), self._gradient(x), self._impact(x, run)]
            found += [*self._conserves(), *self._reduced(orbit, start, left_out)]
            found += self._along_orbit(orbit) if orbit else ()
            found += [self._along_hops(run, left_out)] if run else []
        words = "the energy along motions is that of the masses, heights and laws"
        return [*found, *([Relation(words, max(self.drifts), OPTIONS.same_motion)] if self.drifts else [])]

    def _orbit(self, start: Orbit | Mapping[str, float] | None, left_out: list[str]) -> Orbit | None:
        """An orbit of the machine; None where it has none, or none is found without a start."""
        unused = "" if start is None else ", and start= is not used"
        if self.model.hysteretic or not self.model.conservative:
            left_out.append(f"no orbit: the machine loses energy, or forces drive it{unused}")
        elif self.model.sticks:
            if isinstance(start, Orbit) and start.source is not None and start.source.values == self.machine.values:
                return start
            unused = unused and ", and start= is not used, since it is not an orbit of this machine"
            left_out.append(f"no orbit: its parameters must be tuned; use check(orbit.source, start=orbit){unused}")
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
            yield Relation("energy is conserved where no stated element loses it", np.inf)

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
        off = np.inf
        if orbit:
            pairs = [(orbit.alpha, whole.alpha)]
            pairs.append((orbit.certificate.loss_coefficient or 0.0, whole.certificate.loss_coefficient or 0.0))
            off = max(share(own - other, other) for own, other in pairs)
        words = "the reduced motion has the orbit of all equations, and its losses"
        yield Relation(words, off, OPTIONS.same_motion)

    def _hop(self, orbit: Orbit | None, left_out: list[str]) -> Simulation | None:
        """Hops that lose energy: near an orbit, or of a machine that a kick along the gap lifts from rest."""
        if self.model.hysteretic:
            left_out.append(
                "no hop: the phases use the mean law of a spring with hysteresis, but hops follow its branches"
            )
            return None
        rest = self._rest()
        if orbit:
            rest = OPTIONS.beside * orbit(orbit.flight_time / 2)
        elif not self.model.one_speed:
            here = self.balance(rest[None])
            try:
                kick = np.linalg.solve(here["inertia"][0], here["along_gap"][0, :, 0])
            except np.linalg.LinAlgError:
                left_out.append("no hop: the inertia is singular at rest, so a kick cannot lift the machine")
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

    def _along_orbit(self, orbit: Orbit) -> Iterator[Relation]:
        """An orbit integrated again: its middles, its landing in the mirror image of the launch, and its lift-off."""
        launch, time, middle = orbit(0.0), orbit.flight_time, OPTIONS.moments // 2
        (flown,) = self._integrated("flight", launch[None], np.array([time]))
        landed = self.balance(np.stack([launch, flown[-1]]))
        image, gaps = landed["reversed"][0, :, 0], self.balance(flown)["gap"]
        turned, same = flown[-1] - image, [share(flown[middle] - orbit(time / 2), launch, flown)]
        turned[self.places][self.sticking] = 0.0  # it has moved on by a step
        ends = [share(turned, launch, image), share(np.minimum(gaps, 0.0), gaps) if orbit.admissible else 0.0]
        if orbit.contact is not None and orbit.contact_time is not None:
            begins = self._on_ground(landed["relabelled"][1:, :, 0])
            (y,) = self._integrated("contact", begins, np.array([orbit.contact_time]))
            force, stood = self._rates("contact", y)[1][CONTACT_FORCE], y @ self.embed.T
            same.append(share(stood[middle] - orbit(time + orbit.contact_time / 2), launch, stood))
            ends += [share(stood[-1] - launch, launch, stood), share(force[-1], force)]
            ends.append(share(np.minimum(force, 0.0), force) if orbit.admissible else 0.0)
        ends.append(self._slope_of_launch(orbit.alpha / self.unit(LIFTOFF_SPEED)))
        yield Relation("the orbit agrees with an integration by DOP853", max(same), OPTIONS.same_motion)
        words = "it lands in the mirror image of its launch, and lifts off at zero contact force"
        yield Relation(words, max(ends), OPTIONS.same_motion)

    def _slope_of_launch(self, alpha: float) -> float:
        """By which share the slope of the extension at lift-off is not its fourth-order difference."""
        if self.model.liftoff_slope is None:
            return 0.0
        step, p = OPTIONS.difference * alpha, self.machine.values
        far, near, here, after, beyond = self.model.release(alpha + step * np.arange(-2.0, 3.0), p)
        slope = (far - 8 * near + 8 * after - beyond) / (12 * step)
        return share(slope - self.model.liftoff_slope({"alpha": alpha, "liftoff": here}, p), slope)

    def _along_hops(self, run: Simulation, left_out: list[str]) -> Relation:
        """The legs of a simulation integrated again, and the return map of its launches."""
        off, kinds = [0.0], {event.kind for event in run.events}
        for where, size in self.sizes.items():
            pairs = [pair for pair in zip(run.legs, run.events, strict=False) if pair[0].phase == where]
            if not pairs:
                continue
            begins = np.array([leg.path(0.0)[: len(size)] for leg, _ in pairs])
            paths = self._integrated(where, begins, np.array([leg.path.times[-1] for leg, _ in pairs]))
            paths = paths @ self.embed.T if where == "contact" else paths
            off += [
                share(path[-1] - event.before, event.before, path)
                for path, (_, event) in zip(paths, pairs, strict=True)
            ]
        words, launches = "hops agree with DOP853", run.launches
        known = np.isfinite(launches[:-1]) & np.isfinite(launches[1:])
        missing = [kind for kind in ("landing", "lift-off") if kind not in kinds]
        missing += ["return map"] if self.model.one_speed and not known.any() else []
        if missing:
            events = "1 event" if len(run.events) == 1 else f"{len(run.events)} events"
            left_out.append(f"no {' or '.join(missing)}: the hop ends after {events} with the status '{run.status}'")
        if self.model.one_speed and known.any():
            words += " and the return map"
            hops = ReturnMap(self.machine)(launches[:-1][known])
            off.append(share(hops.next - launches[1:][known], launches[1:][known]))
        return Relation(words, max(off), OPTIONS.same_motion)

    def _integrated(self, where: str, starts: np.ndarray, times: np.ndarray) -> np.ndarray:
        """States (N, moments, n) of motions from `starts` (N, n) for `times` (N,), integrated together by DOP853; along
        them kinetic energy and the work of forces are summed."""
        from scipy.integrate import solve_ivp  # takes longer to import than most checks take

        count, n = starts.shape
        if where not in self.integrands:
            x = ca.SX.sym("x", n + 1)  # the last is the work
            flown = ca.mtimes(self.embed, x[:-1]) if where == "contact" else x[:-1]
            rates = ca.vertcat(self.moves[where](x[:-1])[0], self.balance.power(flown))
            self.integrands[where] = MappedFunction(ca.Function("rate", [x], [ca.densify(rates)]))

        def rate(share_of_time: float, x: np.ndarray) -> np.ndarray:
            return (self.integrands[where](x.reshape(count, n + 1))[0][..., 0] * times[:, None]).ravel()

        smallest = OPTIONS.tolerance * np.maximum(np.abs(starts).max(1), np.finfo(float).tiny).repeat(n + 1)
        options = {"method": "DOP853", "rtol": OPTIONS.tolerance, "atol": smallest}
        moments = np.linspace(0.0, 1.0, OPTIONS.moments)
        run = solve_ivp(rate, (0.0, 1.0), np.column_stack([starts, 0 * times]).ravel(), t_eval=moments, **options)
        states = run.y.T.reshape(len(run.t), count, n + 1).swapaxes(0, 1)
        flown = states[..., :-1] @ self.embed.T if where == "contact" else states[..., :-1]
        kinetic = self.balance(flown.reshape(-1, flown.shape[2]))["kinetic"].reshape(count, -1)
        for own, work in zip(kinetic, states[..., -1], strict=True):
            self.drifts.append(share(own + work - own[0], own, work))
        return states[..., :-1]
