"""Where the foot lifts off: the extension at which the spring's force, with a constant load, reaches 1."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from orbits.errors import InputError, NoOrbit

from .laws import Law

# Below this slope, rounding cannot tell a force that passes the level of lift-off from one that only touches it.
FLATTEST_LIFTOFF = 1e-14
# Distances from rest at which the force is sampled: densely where a spring in its own units lifts off.
SAMPLED_DISTANCES = np.concatenate(
    [[0.0], np.geomspace(1e-9, 1e-3, 50)[:-1], np.geomspace(1e-3, 1e3, 200), np.geomspace(1e3, 1e9, 50)[1:]]
)
# Halvings of an interval after which its ends are neighbouring numbers.
BISECTIONS = 60


@dataclass(frozen=True)
class Liftoff:
    """The condition force + load + damping * speed = 1 that ends sustained contact.

    load : constant force beside the spring's, 0 for the hopper and the hand's weight 1 for the juggler
    name : the force that lift-off waits for, in words
    """

    load: float
    name: str

    def extension(self, law: Law) -> float:
        """The extension at which force + load = 1 is first reached from rest, the force rising.

        Raises `NoOrbit` where the force never passes that level, `InputError` for a law that is no spring.
        """
        if law.key.degree() == 0:
            raise InputError(f"spring '{law.text}' does not depend on the extension {law.variable}: it is no spring")
        low, high = law.range()
        rest, level = law.rest(), 1.0 - self.load
        rises = float(law(rest)) < level
        extensions, forces = _sampled_from_rest(law, rest, away=1.0 if rises else -1.0)
        if float(forces[0]) == level:
            return self._checked(law, rest)
        beyond = np.flatnonzero((forces >= level) == rises)
        if not len(beyond):
            extreme = f"largest tension {forces.max():.4g}" if rises else f"least force {forces.min():.4g}"
            within = f" within [{low:g}, {high:g}]" if np.isfinite(high) or np.isfinite(low) else ""
            reached = f"never reaches {self.name} ({extreme}{within})"
            raise NoOrbit(f"spring '{law.text}' {reached}: nothing leaves the ground")
        first = beyond[0]
        low, high = np.sort(extensions[first - 1 : first + 1])[:, None]
        return self._checked(law, float(_level_crossings(law, np.array([level]), low, high)[0]))

    def extensions_at(self, law: Law, damping: float, alpha: ArrayLike) -> np.ndarray:
        """The extensions (m,) at lift-off with speeds `alpha` (m,), with a damper of this coefficient.

        They lie on the rising branch of the force that passes the level at rest; NaN where that branch ends before.
        """
        static, alpha = self.extension(law), np.asarray(alpha, dtype=float)
        if damping == 0.0:
            return np.full(alpha.shape, static)
        level, result = 1.0 - self.load - damping * alpha, np.full(alpha.shape, np.nan)
        extensions, forces = _rising_branch(law, static, up=damping < 0)
        cell = np.searchsorted(forces, level, side="right") - 1
        inside = (cell >= 0) & (cell < len(extensions) - 1)
        if inside.any():
            ends = extensions[cell[inside]], extensions[cell[inside] + 1]
            result[inside] = _level_crossings(law, level[inside], *ends)
        return result

    def _checked(self, law: Law, liftoff: float) -> float:
        """The extension at lift-off; raises `NoOrbit` where the force only touches the level there."""
        slope = float(law.with_slope(liftoff)[1])
        if slope > FLATTEST_LIFTOFF:
            return liftoff
        where = f"at extension {liftoff:.6g}, with slope {slope:.1e}"
        raise NoOrbit(f"spring '{law.text}' only just reaches {self.name} {where}: nothing lifts off cleanly")


def _sampled_from_rest(law: Law, rest: float, away: float) -> tuple[np.ndarray, np.ndarray]:
    """Extensions (n,) away from rest, as far as the force is finite, with its turning points, and the forces there."""
    extensions = np.clip(rest + away * SAMPLED_DISTANCES, *law.range())
    forces, slopes = law.with_slope(extensions)
    finite = np.isfinite(forces)
    count = len(extensions) if finite.all() else int(np.argmin(finite))
    if count == 0:
        raise InputError(f"spring '{law.text}' has no force at rest (r = {rest:g})")
    extensions, forces, slopes = extensions[:count], forces[:count], slopes[:count]
    cells = np.flatnonzero((slopes[:-1] > 0) & (slopes[1:] <= 0))
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
    fails = np.flatnonzero(~(rises & (slopes > 0) & np.isfinite(forces)))
    if len(fails):
        count = max(int(fails[0]), 1)
        turn = _end_of_rise(law, extensions[count - 1], extensions[count])
        extensions, forces = np.append(extensions[:count], turn), np.append(forces[:count], law(turn))
    return extensions[:: int(side)], forces[:: int(side)]


def _end_of_rise(law: Law, inner: ArrayLike, outer: ArrayLike) -> np.ndarray:
    """The last extensions (m,) with a finite, rising force between `inner` (m,), where it rises, and `outer` (m,)."""
    inner, outer = np.asarray(inner), np.asarray(outer)
    for _ in range(BISECTIONS):
        middle = 0.5 * (inner + outer)
        force, slope = law.with_slope(middle)
        rises = (slope > 0) & np.isfinite(force)
        inner, outer = np.where(rises, middle, inner), np.where(rises, outer, middle)
    return inner


def _level_crossings(law: Law, level: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Where the force rises through levels (m,) between extensions (m,): Newton's method safeguarded by bisection."""
    r = 0.5 * (low + high)
    for _ in range(200):
        force, slope = law.with_slope(r)
        low, high = np.where(force < level, r, low), np.where(force < level, high, r)
        new = np.divide(level - force, slope, out=low - r, where=slope != 0) + r
        if (np.abs(new - r) <= 4e-16 * np.abs(r)).all():
            break
        r = np.where((low < new) & (new < high), new, 0.5 * (low + high))
    return np.clip(new, low, high)
