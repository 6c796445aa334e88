"""What hopper and juggler share: under constant gravity the spring's extension moves alone, r'' = -F(r).

F is the spring's force plus a constant load (0 for the hopper, the hand's weight 1 for the juggler), and F = 1 at
lift-off. The other coordinate is thrown upward at speed alpha under unit gravity, so half the flight takes the time
alpha, and an orbit is a root of r'(alpha) = 0: a problem in two states (section 8 of the paper, for a linear spring).
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from orbits.errors import FlowError, InputError, NoOrbit, OutOfRange
from orbits.flow.flow import flow_of
from orbits.model.closed_form import Oscillator, ThrownOscillator
from orbits.model.model import Reduction
from orbits.model.phase import Arc, Phase, Pieces, Statement
from orbits.numerics.bernstein import Crossings
from orbits.numerics.roots import bracketed_root

from .laws import Key, Law, from_key

# Launch speeds beyond this, times the family, are hops of 5e7 lengths and more: not a machine.
FASTEST = 1e4
SLOWEST = 1e-3
STIFFNESSES = (1e-12, 1e12)
# A force that passes the lift-off level more slowly than rounding can tell does not pass it.
FLATTEST = 1e-14
# The guess of a launch speed is for Newton's method to finish: off by this share of half an oscillation.
GUESS = 1e-3
# ... and, where there is another root close above, by this share of how far the equation goes beyond zero in between.
DEPTH = 0.01
# Where lift-off is looked for, from rest: densely where a spring in its own units lifts off.
DISTANCES = np.concatenate(
    [[0.0], np.geomspace(1e-9, 1e-3, 50)[:-1], np.geomspace(1e-3, 1e3, 200), np.geomspace(1e3, 1e9, 50)[1:]]
)


def spring_pieces(key: Key, coordinate: tuple[float, ...]) -> Pieces | None:
    """The pieces of a spring law's key, for a phase whose state gives the extension by these weights."""
    return key.pieces and Pieces(coordinate, *key.pieces, "extension")


def straight_line(key: Key, p) -> tuple[float, float]:
    """Stiffness k and zero r0 of a straight-line law k (r - r0) at parameter values `p`."""
    law = from_key(key, p)
    value, slope = law.with_slope(0.0)
    if not STIFFNESSES[0] < slope < STIFFNESSES[1]:
        raise InputError(
            f"spring '{law.text}' has stiffness {slope:g}: it never reaches a lift-off that can be computed; "
            f"stiffness lies between {STIFFNESSES[0]:g} and {STIFFNESSES[1]:g}"
        )
    return float(slope), -float(value) / float(slope)


@lru_cache(maxsize=64)
def relative_phase(spring: Key, load: float) -> Phase:
    """The motion r'' = -(phi(r) + load) of a spring law's key, in closed form where the law is a straight line."""
    force = spring.expression

    def oscillator(p):
        k, zero = straight_line(spring, p)
        return Oscillator(k, zero - load / k)

    return Phase(
        "flight",
        ("r", "r'"),
        lambda x, p, q: [x[1], -(force(x[0], p, q) + load)],
        pieces=spring_pieces(spring, (1.0, 0.0)),
        closed_form=oscillator if spring.degree() == 1 else None,
    )


def relative_reduction(spring: Key, load: float, complete: Callable, gap_slope: Callable, what: str) -> Reduction:
    """The reduction of a machine under constant gravity; `complete` and `gap_slope` as in `Reduction`.

    spring : the law's key
    load : F - phi
    what : the force that lift-off waits for, in words
    """
    phase, force = relative_phase(spring, load), spring.expression

    def exact(family, p):
        """Eq. (12): b = tan b with alpha = b/sqrt(k); b = n pi + atan(b) contracts to it."""
        k, zero = straight_line(spring, p)
        b = (family + 0.5) * np.pi
        for _ in range(60):
            b, before = family * np.pi + np.arctan(b), b
            if b == before:
                break
        alpha = b / np.sqrt(k)
        # The error: the residual of sin b = b cos b through its slope b sin b, and one rounding.
        error = abs((np.sin(b) - b * np.cos(b)) / (b * np.sin(b))) / np.sqrt(k) + np.spacing(alpha)
        return {"liftoff": zero + (1 - load) / k, "alpha": alpha}, float(error)

    arc = Arc(
        phase,
        start=lambda u, before, p: [u["liftoff"], u["alpha"]],
        duration=lambda u, p: u["alpha"],
        conditions=lambda u, x, p: [x[1]],
        guard=lambda u, x, p, q: [force(x[0], p, q) + load - 1],
    )
    statement = Statement("relative", ("liftoff", "alpha"), (arc,), ("alpha",))
    return Reduction(statement, (1, -1), complete, gap_slope, exact if phase.closed_form else None)


def guess(spring: Key, load: float, what: str) -> Callable:
    """(family, p) -> lift-off extension, launch speed and half flight time under constant gravity."""

    def start(family, p):
        law = from_key(spring, p)
        liftoff = liftoff_extension(law, load, what)
        low, high = law.range()
        slopes = [float(law.with_slope(r)[1]) for r in (liftoff, min(max(0.0, low), high))]
        scale = 1 / np.sqrt(max(filter(np.isfinite, slopes)))  # at rest a law may have none, at lift-off it has
        alpha = launch_speed(relative_phase(spring, load), p, liftoff, family, scale, f"spring '{law.text}'")
        return {"liftoff": liftoff, "alpha": alpha, "duration": alpha}

    return start


def thrown(times, count: int, u):
    """Coefficients (N, 2, count) of the coordinate thrown up at lift-off under unit gravity, and of its speed, in steps
    from `times` (N,)."""
    rows = np.zeros((len(times), 2, count))
    rows[:, 0, 0] = u["liftoff"] + times * (u["alpha"] - times / 2)
    rows[:, 0, 1] = rows[:, 1, 0] = u["alpha"] - times
    rows[:, 0, 2], rows[:, 1, 1] = -0.5, -1.0
    return rows


def thrown_flight(reduction: Reduction | None, mix: Callable, apart: Callable) -> Callable | None:
    """The closed form of the whole flight where its relative motion has one; p -> matrices as in `ThrownOscillator`."""
    phase = reduction and reduction.statement.arcs[0].phase
    return phase and phase.closed_form and (lambda p: ThrownOscillator(phase.closed_form(p), mix(p), apart(p)))


def no_orbit(family, p):
    """The guess of a damped machine."""
    raise NoOrbit("a damped machine loses energy on every hop: it has no lossless orbit, but a return map")


def released(law: Law, load: float, what: str, damping: float, alpha) -> np.ndarray:
    """The extension (m,) at lift-off with speeds `alpha` (m,), where force + load + damping * speed = 1: on the rising
    branch of the force that lifts off at rest, NaN where that does not reach so far."""
    rest = liftoff_extension(law, load, what)
    alpha = np.asarray(alpha, dtype=float)
    if damping == 0.0:
        return np.full(alpha.shape, rest)
    level = 1.0 - load - damping * alpha
    grid, forces = _rising_branch(law, rest, up=damping < 0)
    cell = np.searchsorted(forces, level, side="right") - 1
    found = np.full(alpha.shape, np.nan)
    inside = (cell >= 0) & (cell < len(grid) - 1)
    if inside.any():
        ends = grid[cell[inside]], grid[cell[inside] + 1]
        found[inside] = _level_crossings(law, level[inside], *ends)
    return found


def _rising_branch(law: Law, rest: float, up: bool) -> tuple[np.ndarray, np.ndarray]:
    """Extensions and forces (n,), both ascending, from `rest` up or down to where the force turns or ends."""
    side = 1.0 if up else -1.0
    grid = np.unique(np.clip(rest + side * DISTANCES, *law.range()))[:: int(side)]
    forces, slopes = law.with_slope(grid)
    with np.errstate(invalid="ignore"):
        rises = np.append(True, side * np.diff(forces) > 0)
    fails = np.flatnonzero(~(rises & (slopes > 0) & np.isfinite(forces)))
    if len(fails):
        known = max(int(fails[0]), 1)
        inner, outer = grid[known - 1], grid[known]
        for _ in range(60):  # the turn itself, between two samples
            middle = 0.5 * (inner + outer)
            force, slope = law.with_slope(middle)
            inner, outer = (middle, outer) if slope > 0 and np.isfinite(force) else (inner, middle)
        grid = np.append(grid[:known], inner)
        forces = np.append(forces[:known], float(law(inner)))
    return grid[:: int(side)], forces[:: int(side)]


def liftoff_extension(law: Law, load: float, what: str) -> float:
    """The extension at which force + load = 1 is first reached from rest, the force rising; `NoOrbit` when never."""
    if law.key.degree() == 0:
        raise InputError(f"spring '{law.text}' does not depend on the extension {law.variable}: it is no spring")
    low, high = law.range()
    start = min(max(0.0, low), high)
    level = 1.0 - load
    below = float(law(start)) < level
    grid = start + DISTANCES if below else start - DISTANCES
    grid = np.clip(grid, low, high)
    values, slopes = law.with_slope(grid)
    finite = np.isfinite(values)
    known = len(grid) if finite.all() else int(np.argmin(finite))
    if known == 0:
        raise InputError(f"spring '{law.text}' has no force at rest (r = {start:g})")
    grid, values = _with_turns(law, grid[:known], values[:known], slopes[:known])
    if float(values[0]) == level:
        return _cleanly(law, start, what)
    crossed = np.flatnonzero((values >= level) == below)
    if not len(crossed):
        extreme = values.max() if below else values.min()
        side = f"largest tension {extreme:.4g}" if below else f"least force {extreme:.4g}"
        where = f" within [{low:g}, {high:g}]" if np.isfinite(high) or np.isfinite(low) else ""
        raise NoOrbit(f"spring '{law.text}' never reaches {what} ({side}{where}): nothing leaves the ground")
    i = crossed[0]
    low, high = np.sort(grid[i - 1 : i + 1])[:, None]
    return _cleanly(law, float(_level_crossings(law, np.array([level]), low, high)[0]), what)


def _level_crossings(law: Law, level, low, high) -> np.ndarray:
    """Where the force rises through levels (m,) between extensions (m,): Newton's method kept inside by bisection."""
    r = 0.5 * (low + high)
    for _ in range(200):
        value, slope = law.with_slope(r)
        low, high = np.where(value < level, r, low), np.where(value < level, high, r)
        new = np.divide(level - value, slope, out=low - r, where=slope != 0) + r
        if (np.abs(new - r) <= 4e-16 * np.abs(r)).all():
            break
        r = np.where((low < new) & (new < high), new, 0.5 * (low + high))
    return np.clip(new, low, high)


def _cleanly(law: Law, liftoff: float, what: str) -> float:
    """The extension at lift-off, if the force passes the level there."""
    slope = float(law.with_slope(liftoff)[1])
    if not slope > FLATTEST:
        raise NoOrbit(
            f"spring '{law.text}' only just reaches {what} at extension {liftoff:.6g}, with slope {slope:.1e}: "
            "nothing lifts off cleanly"
        )
    return liftoff


def _with_turns(law: Law, grid, values, slopes) -> tuple[np.ndarray, np.ndarray]:
    """A grid away from rest with its forces, and where between its places the force turns back: a maximum that barely
    reaches the level lies between samples."""
    cells = np.flatnonzero((slopes[:-1] > 0) & (slopes[1:] <= 0))
    if not len(cells):
        return grid, values
    inner, outer = grid[cells], grid[cells + 1]
    for _ in range(60):
        middle = 0.5 * (inner + outer)
        rises = law.with_slope(middle)[1] > 0
        inner, outer = np.where(rises, middle, inner), np.where(rises, outer, middle)
    return np.insert(grid, cells + 1, inner), np.insert(values, cells + 1, law(inner))


def half_oscillations(phase: Phase, p: dict[str, float], liftoff: float, alpha: float) -> tuple[float, float]:
    """Time from lift-off to the first turn of the extension, and half its period; infinite when it does not return
    in a thousand times as long. Raises `FlowError` when it cannot be carried on."""
    turns, clock, crossings = [], [0.0], Crossings()

    def second_turn(coefficients, steps):
        for i, t in crossings(coefficients[:, 1], steps):
            turns.append(clock[0] + steps[:i].sum() + t)
            if len(turns) == 2:
                return i, t
        clock[0] += steps.sum()
        return None

    flow_of(phase, tuple(p)).run([liftoff, alpha], list(p.values()), 1e3 * (1 + alpha), stop=second_turn)
    return (turns[0], turns[1] - turns[0]) if len(turns) == 2 else (np.inf, np.inf)


def launch_speed(phase: Phase, p: dict[str, float], liftoff: float, family: int, scale: float, what: str) -> float:
    """The lowest launch speed whose half flight ends on the family's turn: alpha = first turn + family half periods.

    The time of that turn is a function of alpha alone, so this is one scalar equation for any spring, and the family
    is right by construction. `scale` is the speed in whose multiples is searched. Raises `NoOrbit` when there is none.
    """
    halves = {}

    def excess(alpha):
        nonlocal reason
        try:
            first, halves[alpha] = half_oscillations(phase, p, liftoff, alpha)
        except OutOfRange as error:
            reason = f"beyond launch speed {alpha:.4g} {error}"
            return np.inf
        except FlowError as error:
            reason = f"at launch speed {alpha:.4g} the extension does not come back: {error}"
            return np.inf
        if not np.isfinite(first):
            reason = f"at launch speed {alpha:.4g} the extension does not come back"
        return first + family * halves[alpha] - alpha

    fastest, slowest = FASTEST * family * scale, SLOWEST * scale
    samples, cap = [(0.0, 1.0)], np.inf  # beyond the cap there is no return
    alpha, reason = 2 * family * scale, ""  # rather low for most springs; where it is too fast, from the slowest
    while alpha < fastest and samples[-1][0] < (1 - 1e-4) * cap:
        gap = excess(alpha)
        if len(samples) == 1 and alpha > slowest and not 0 < gap < np.inf:
            alpha, reason = slowest, ""
            continue
        if gap <= 0:
            enough = min(GUESS * halves[alpha], DEPTH * abs(gap))
            return bracketed_root(excess, samples[-1][0], alpha, samples[-1][1], gap, enough)
        if np.isfinite(gap):
            samples.append((alpha, gap))
        elif alpha > slowest:
            cap = alpha
        else:
            break
        if len(samples) > 3 and samples[-2][1] < samples[-3][1] and samples[-2][1] <= samples[-1][1]:
            dip = _lowest(excess, samples[-3][0], samples[-1][0])  # a pair of roots between samples, near a fold
            if (bottom := excess(dip)) <= 0:
                enough = min(GUESS * halves[dip], DEPTH * abs(bottom))
                return bracketed_root(excess, samples[-3][0], dip, samples[-3][1], bottom, enough)
        last, before = samples[-1], samples[-2] if len(samples) > 1 else samples[-1]
        slope = (last[1] - before[1]) / (last[0] - before[0]) if len(samples) > 2 else 0.0
        # Just past where the last two samples point, so that the next one brackets the root.
        ahead = 1.2 * last[1] / max(-slope, 0.3) if slope < 0 else last[1] / 1.5
        alpha = last[0] + max(ahead, 0.02 * (scale + last[0]))
        if alpha >= cap:
            alpha = 0.5 * (last[0] + cap)
    if not reason:
        reason = f"none up to launch speed {fastest:g}"
    raise NoOrbit(f"{what} has no lossless orbit of family {family} under constant gravity: {reason}")


def _lowest(function, a: float, b: float) -> float:
    """Golden-section search for a minimum between a and b, to half the digits, which is all that a minimum has."""
    ratio = (np.sqrt(5) - 1) / 2
    c, d = b - ratio * (b - a), a + ratio * (b - a)
    fc, fd = function(c), function(d)
    while abs(b - a) > 1e-8 * (abs(a) + abs(b)) and min(fc, fd) > 0:
        if fc < fd:
            b, d, fd = d, c, fc
            c = b - ratio * (b - a)
            fc = function(c)
        else:
            a, c, fc = c, d, fd
            d = a + ratio * (b - a)
            fd = function(d)
    return c if fc < fd else d
