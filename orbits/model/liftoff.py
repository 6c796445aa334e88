"""Lift-off: the extension at which the force of a law, with a constant load, opens a contact."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, NoOrbit
from ..laws import ONE_SIDED, WRONG_SIGN, Key, Law, sampled_closely, values_and_slopes
from ..units import EXTENSION, Message, Quantity


class LiftoffOptions(NamedTuple):
    """When a force passes the level of lift-off, and how the place is found."""

    # Below this slope, rounding cannot distinguish a force that passes the level from one that only touches it.
    flattest: float = 1e-14
    jumps_over: float = 1e-6  # a force that differs from the level by more just next to the place jumps over it
    digits_beside: float = 4.0  # last digits of the extension from lift-off to there
    block: int = 256  # springs that are searched together, so that their sampled forces stay in the processor's cache
    bisections: int = 60  # of an interval, after which its ends are neighbouring numbers


LIFTOFF = LiftoffOptions()
# Distances from rest at which the force is sampled: densely where a spring in its own units lifts off.
SAMPLED_DISTANCES = np.concatenate(
    [[0.0], np.geomspace(1e-9, 1e-3, 50)[:-1], np.geomspace(1e-3, 1e3, 200), np.geomspace(1e3, 1e9, 50)[1:]]
)
# The dimension of a force's slope; the extension is a length or an angle.
FORCE_PER_EXTENSION = (0, 0, 1, 0, -1)


class Liftoff(NamedTuple):
    """The condition force + load + damping * speed = 1 that ends sustained contact.

    load : constant force in addition to the spring's, 0 for the hopper and the hand's weight 1 for the juggler
    name : the force that lift-off waits for, in words
    scale : p -> (unit, zero, place) for messages: a value phi of the law is the force unit * (phi - zero), and its
        extension is counted from that place
    named : the name of the law in messages
    """

    load: float
    name: str
    scale: Callable = lambda p: (1.0, 0.0, 0.0)
    named: str = "spring '{law}'"

    def extension(self, law: Law) -> float:
        """The extension at which force + load = 1 is first reached from rest, the force rising.

        Raises `NoOrbit` where the force never passes that level, `InputError` for a law that is not a spring.
        """
        if law.key.degree() == 0:
            raise InputError(
                f"'{law.text}' does not depend on the extension {law.variable}: no spring opens the contact"
            )
        low, high = law.range()
        rest, level = law.rest(), 1.0 - self.load
        rises = float(law(rest)) < level
        extensions, forces = _sampled_from_rest(law, rest, 1.0 if rises else -1.0, level)
        if float(forces[0]) == level:
            return self._checked(law, rest)
        beyond = ((forces >= level) == rises).nonzero()[0]
        if not len(beyond):
            unit, zero, _ = self.scale(law.parameters)
            extreme = "largest tension" if rises == (unit > 0) else "least force"
            force = Quantity(float(unit * ((forces.max() if rises else forces.min()) - zero)), "smallest_contact_force")
            bounds = {"low": Quantity(low, EXTENSION), "high": Quantity(high, EXTENSION)}
            within = Message(" within [{low:g}, {high:g}]", **bounds) if np.isfinite([low, high]).any() else ""
            text = self.named + " never reaches {level} ({extreme} {force:.4g}{within}): {why}"
            why = "nothing leaves the ground"
            if extreme == "largest tension" and force.value <= 0:
                why = ONE_SIDED if high <= 0 else WRONG_SIGN
            parts = {"level": self.name, "extreme": extreme, "force": force, "within": within, "why": why}
            raise NoOrbit(Message(text, law=law.text, **parts))
        low, high = np.sort(extensions[beyond[0] - 1 : beyond[0] + 1])[:, None]
        return self._checked(law, float(_level_crossings(law.with_slope, np.array([level]), low, high)[0]))

    def extensions(self, key: Key, p: Mapping[str, np.ndarray]) -> np.ndarray:
        """`extension` of springs with parameters (m,) by name, whose force rises or falls all the way from rest, at 0,
        to the level without a jump; NaN for others."""
        count, level = len(next(iter(p.values()))), 1.0 - self.load
        found = np.full(count, np.nan)
        if not count or key.degree() == 0 or (key.pieces and key.pieces.jumps):
            return found
        forces, slopes = values_and_slopes(key, p, np.zeros((count, 1)))
        away = np.where(forces[:, 0] < level, 1.0, -1.0)
        for first in range(0, count, LIFTOFF.block):
            rows = slice(first, first + LIFTOFF.block)
            extensions, block = away[rows, None] * SAMPLED_DISTANCES, {name: values[rows] for name, values in p.items()}
            forces, slopes = values_and_slopes(key, block, extensions)
            with np.errstate(invalid="ignore"):
                beyond, ends_there = (forces >= level) == (away[rows, None] > 0), ~np.isfinite(forces)
                ends_there[:, 1:] |= (slopes[:, :-1] > 0) & (slopes[:, 1:] <= 0)
            cell = beyond.argmax(axis=1)
            each = np.arange(len(cell))
            steady = (cell > 0) & (np.cumsum(ends_there, axis=1)[each, cell] == 0) & (forces[:, 0] != level)
            ends = np.sort([extensions[each, cell - 1][steady], extensions[each, cell][steady]], axis=0)
            found[rows][forces[:, 0] == level] = 0.0
            found[rows][steady] = self._reached(key, {name: values[steady] for name, values in block.items()}, *ends)
        forces, slopes = (each[:, 0] for each in values_and_slopes(key, p, np.nan_to_num(found)[:, None]))
        found[~(slopes > LIFTOFF.flattest) | (np.abs(forces - level) > LIFTOFF.jumps_over)] = np.nan
        return found

    def _reached(self, key: Key, p: Mapping[str, np.ndarray], low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Where springs with parameters (m,) by name reach the level between extensions (m,)."""

        def force_and_slope(r: np.ndarray) -> list[np.ndarray]:
            return [column[:, 0] for column in values_and_slopes(key, p, r[:, None])]

        return _level_crossings(force_and_slope, np.full(len(low), 1.0 - self.load), low, high) if len(low) else low

    def extensions_at(self, law: Law, damping: float, alpha: ArrayLike) -> np.ndarray:
        """The extensions (m,) at lift-off with speeds `alpha` (m,), with a damper of this coefficient.

        They lie on the rising branch of the force that passes the level at rest; NaN where that branch ends before.
        """
        static, alpha = self.extension(law), np.asarray(alpha, dtype=float)
        if damping == 0.0:
            return np.full(alpha.shape, static)
        with np.errstate(over="ignore"):  # no force has an infinite level
            level, result = 1.0 - self.load - damping * alpha, np.full(alpha.shape, np.nan)
        extensions, forces = _rising_branch(law, static, up=damping < 0)
        cell = np.searchsorted(forces, level, side="right") - 1
        inside = (cell >= 0) & (cell < len(extensions) - 1)
        if inside.any():
            ends = extensions[cell[inside]], extensions[cell[inside] + 1]
            result[inside] = _level_crossings(law.with_slope, level[inside], *ends)
        return result

    def refuse_jump(self, law: Law, liftoff: float) -> None:
        """Raise `NoOrbit` where the force jumps over the level of lift-off: the equations of an orbit, in which it
        equals the level there, have no solution."""
        digits = LIFTOFF.digits_beside * np.spacing(np.abs(liftoff))
        beside = np.clip(liftoff + np.array([-1.0, 1.0]) * digits, *law.range())
        below, above = law(beside).tolist()
        if max(1.0 - self.load - below, above - (1.0 - self.load)) <= LIFTOFF.jumps_over:
            return
        unit, zero, place = self.scale(law.parameters)
        text = (
            self.named + " jumps over {level} at extension {liftoff:.6g}, from {below:.4g} to {above:.4g}: a lossless "
        )
        text += "hop needs a force that passes through this level; replace the jump by a steep slope"
        below, above = (Quantity(float(unit * (x - zero)), "smallest_contact_force") for x in (below, above))
        numbers = {"liftoff": Quantity(place + liftoff, EXTENSION), "below": below, "above": above}
        raise NoOrbit(Message(text, law=law.text, level=self.name, **numbers))

    def _checked(self, law: Law, liftoff: float) -> float:
        """The extension at lift-off; raises `NoOrbit` where the force only touches the level there."""
        slope = float(law.with_slope(liftoff)[1])
        if slope > LIFTOFF.flattest:
            return liftoff
        unit, _, place = self.scale(law.parameters)
        if np.isnan(slope):
            text = self.named + " has no finite slope at extension {liftoff:.6g}, where it reaches {level}: "
            text += "a part of it overflows, as exp(x) does for x > 709; write 1/(1 + exp(x)) as (1 - tanh(x/2))/2"
            at = Quantity(place + liftoff, EXTENSION)
            raise NoOrbit(Message(text, law=law.text, level=self.name, liftoff=at))
        reaches = self.named + " only just reaches {level} at extension {liftoff:.6g}, with slope {slope:.1e}"
        numbers = {
            "liftoff": Quantity(place + liftoff, EXTENSION),
            "slope": Quantity(unit * slope, FORCE_PER_EXTENSION),
        }
        raise NoOrbit(Message(reaches + ": nothing lifts off cleanly", law=law.text, level=self.name, **numbers))


def _sampled_from_rest(law: Law, rest: float, away: float, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Extensions (n,) away from rest, as far as the force is finite, with its turning points, and the forces there. Up
    to where the force has come to a level they are so close that nothing in the law is between them."""
    extensions = np.clip(rest + away * SAMPLED_DISTANCES, *law.range())
    if law.pieces:  # on both sides of whose ends the force may be its largest
        ends = np.array(law.pieces.ends(np.array(law.pieces.table(law.parameters)[0]), law.parameters))[1:-1]
        beside = np.concatenate([np.nextafter(ends, -np.inf), ends])
        beside = beside[(away * (beside - rest) > 0) & (np.abs(beside - rest) < SAMPLED_DISTANCES[-1])]
        extensions = np.unique(np.concatenate([extensions, beside]))[:: int(away)]
    forces, slopes = law.with_slope(extensions)
    count = int(np.argmin(np.append(np.isfinite(forces), False)))
    if count == 0:
        raise InputError(f"no force at rest (r = {rest:g}): '{law.text}' is not a number there")
    ends = extensions[count - 1 : count + 1]
    extensions, forces, slopes = extensions[:count], forces[:count], slopes[:count]
    if len(ends) > 1 and not (away * (forces - level) >= 0).any():
        last = _last_where(lambda r: np.isfinite(law(r)), *ends[:, None])
        extensions = np.append(extensions, last)
        forces, slopes = law.with_slope(extensions)
    until = int(np.argmax(np.append(away * (forces - level) >= 0, True))) + 1
    closer = sampled_closely(law, extensions[:until])
    if len(closer) > min(until, count):
        extensions = np.concatenate([closer, extensions[until:]])
        forces, slopes = law.with_slope(extensions)
    cells = ((slopes[:-1] > 0) & (slopes[1:] <= 0)).nonzero()[0]
    if not len(cells):
        return extensions, forces
    turns = _end_of_rise(law, extensions[cells], extensions[cells + 1])
    return np.insert(extensions, cells + 1, turns), np.insert(forces, cells + 1, law(turns))


def _rising_branch(law: Law, static: float, up: bool) -> tuple[np.ndarray, np.ndarray]:
    """Extensions and forces (n,), ascending, from the static lift-off up or down to where the force turns or ends."""
    side = 1.0 if up else -1.0
    extensions = np.unique(np.clip(static + side * SAMPLED_DISTANCES, *law.range()))[:: int(side)]
    forces, slopes = law.with_slope(extensions)
    with np.errstate(invalid="ignore"):
        rises = np.append(True, side * np.diff(forces) > 0)
    fails = (~(rises & (slopes > 0) & np.isfinite(forces))).nonzero()[0]
    if len(fails):
        count = max(int(fails[0]), 1)
        turn = _end_of_rise(law, extensions[count - 1], extensions[count])
        extensions, forces = np.append(extensions[:count], turn), np.append(forces[:count], law(turn))
    return extensions[:: int(side)], forces[:: int(side)]


def _end_of_rise(law: Law, inner: ArrayLike, outer: ArrayLike) -> np.ndarray:
    """The last extensions (m,) with a finite, rising force between `inner` (m,), where it rises, and `outer` (m,)."""

    def rises(r: np.ndarray) -> np.ndarray:
        force, slope = law.with_slope(r)
        return (slope > 0) & np.isfinite(force)

    return _last_where(rises, np.asarray(inner), np.asarray(outer))


def _last_where(true: Callable, inner: np.ndarray, outer: np.ndarray) -> np.ndarray:
    """The last extensions (m,) where something is true between `inner` (m,), where it is, and `outer` (m,)."""
    for _ in range(LIFTOFF.bisections):
        middle = 0.5 * (inner + outer)
        here = true(middle)
        inner, outer = np.where(here, middle, inner), np.where(here, outer, middle)
    return inner


def _level_crossings(force_and_slope: Callable, level: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Where a force, x (m,) -> values and slopes (m,), rises through levels (m,) between extensions (m,): Newton's
    method safeguarded by bisection, each ended by its own step or bracket, which rounding alone determines where the
    force is flat."""
    r = 0.5 * (low + high)
    for turn in range(3 * LIFTOFF.bisections):
        force, slope = force_and_slope(r)
        low, high = np.where(force < level, r, low), np.where(force < level, high, r)
        new = np.divide(level - force, slope, out=np.full(r.shape, np.inf), where=slope != 0) + r
        settled = np.minimum(np.abs(new - r), high - low) <= 4e-16 * np.abs(r)
        if settled.all():
            break
        # Along a steep power Newton's method hardly moves.
        inside = (low < new) & (new < high) & (turn < LIFTOFF.bisections)
        following = np.where(inside, new, 0.5 * (low + high))
        r = np.where(settled, r, following)
    return np.clip(new, low, high)
