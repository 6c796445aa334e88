"""The coefficient of friction that an orbit in the plane needs: the largest ratio of the force along the ground to the
force across it.

The largest |T|/N is the number q for which the minimum of q N - |T| over the motion is 0. From a smaller q, the place
of that minimum gives the next q (Dinkelbach 1967), and the last place is that of the largest |T|/N. Where a foot
sticks, both forces vanish at landing and at lift-off: there the ratio is |T'|/N' of their rates. Of two feet that hold
a machine, each is judged by the forces on it.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..flow import Trajectories, flow_of
from ..model import Model, Phase
from ..numerics import evaluate
from ..records import NONE, Records
from ..shooting import EPS, Cycles, columns, vectors
from ..symbolic import ElementwiseFunction, cached
from ..units import FORCE, TIME, Message, Quantity
from .certificate import Certificate
from .extrema_and_zeros import Sought, turns_and_zeros
from .loss_coefficient import by_launch_speed

# Shares double their digits from round to round.
MOST_SHARES = 40
SAME_SHARE = 4 * EPS
# Within this share of a motion its derivatives are those at its start.
NEAR_START = 1e-6
# Rounding of the share, in units of the last place of the largest states.
SHARE_ROUNDING = 16


class _OfGround(NamedTuple):
    """The forces of the ground on the motions (k,) of one phase.

    which : (k,), the cycles of the motions
    names : of the forces across and along the ground
    normal, along : (N, K + 1), the forces
    vanishing : whether both vanish where the motions begin
    """

    phase: Phase
    motions: Trajectories
    which: np.ndarray
    names: tuple[str, str]
    normal: np.ndarray
    along: np.ndarray
    vanishing: bool

    def at_start(self) -> np.ndarray:
        """|T|/N (k,) where the motions begin, of forces that vanish there; 0 where N does not rise, and for others."""
        rates = (each[self.motions.first, 1] for each in (self.normal, self.along))
        normal, along = rates if self.vanishing else np.zeros((2, len(self.motions)))
        return np.divide(np.abs(along), normal, out=np.zeros(len(normal)), where=normal > 0)

    def steps_at(self, times: np.ndarray) -> np.ndarray:
        """The steps (k,) of the motions in which times (k,) lie."""
        begun = (self.motions.starts <= times[self.motions.owner]).astype(int)
        return self.motions.first + np.maximum(np.add.reduceat(begun, self.motions.first), 1) - 1

    def share(self, times: np.ndarray) -> np.ndarray:
        """|T|/N (k,) at times (k,), 0 where both are 0."""
        step = self.steps_at(times)
        normal, along = (evaluate(each[step], times - self.motions.starts[step]) for each in (self.normal, self.along))
        return np.divide(np.abs(along), normal, out=np.zeros(len(step)), where=along != 0)

    def least(self, shares: np.ndarray) -> np.ndarray:
        """The times (k,) at which shares (k,) of N less |T| are least."""
        own = shares[self.motions.owner, None] * self.normal
        sought = {sign: Sought.of(self.motions, own - sign * self.along) for sign in (1.0, -1.0)}
        (low, when), (other, then) = (curve.lowest() for curve in turns_and_zeros(sought).values())
        return np.where(low < other, when, then)


def with_friction(model: Model, cycles: Cycles, certificates: Records[Certificate]) -> Records[Certificate]:
    """The certificates (m,) with the friction that the orbits need, and violations by feet that lift or slide. Where
    the ground would have to pull, no friction is enough."""
    # Of whole motions, which nothing turns back, the forces are not stored.
    if model.planar is None or model.reversor is None:
        return certificates
    planar, violations = model.planar, list(certificates.column("violations"))
    parts, (stance, ends) = list[_OfGround](), np.full((2, len(cycles)), NONE)
    pulls = np.zeros(len(cycles), dtype=bool)
    for phase, *names, vanishing in model.standing_points:
        if phase == "flight":
            part = _forces_of_ground(model.flight, cycles.halves, np.arange(len(cycles)), names)
        elif cycles.contacts:
            part = _forces_of_ground(model.contact, cycles.contacts, cycles.with_contact, names, vanishing)
        else:
            continue
        parts.append(part)
        least, when = turns_and_zeros({"normal": Sought.of(part.motions, part.normal)})["normal"].lowest()
        if phase == "flight":
            stance, ends = least, when
        else:
            pulls[part.which] |= least < 0
    lifts, words = stance <= 0, model.violations.get("stance")
    judged = np.full(len(cycles), bool(words) if planar.stands else None, dtype=object)
    text = "{lifts} at t = {time:.6g} of the flight (force {force:.3g})"
    for i in lifts.nonzero()[0].tolist() if words else ():
        time, force = Quantity(ends[i], TIME), Quantity(stance[i], FORCE)
        violations[i] += (Message(text, lifts=words, time=time, force=force),)
    needed, where, place = _largest(parts, len(cycles))
    known = ~lifts & ~pulls & np.isfinite(needed)
    known[[*cycles.without_contact]] = False
    error = _share_errors(model, cycles, parts, needed, where, place)
    limits = np.broadcast_to(planar.friction(cycles.p) if planar.friction else np.inf, len(cycles))
    when = place + np.where(where == planar.stands, cycles.flight_times, 0.0)
    for i in (known & (needed > limits)).nonzero()[0].tolist():
        text = (
            "it needs the friction coefficient {needed:.6g} at t = {time:.6g}, above the stated {limit:.6g}: a "
            "foot slides"
        )
        numbers = {"needed": float(needed[i]), "limit": float(limits[i]), "time": Quantity(when[i], TIME)}
        violations[i] += (Message(text, **numbers),)
    found = {"friction_needed": needed, "friction_error": error, "friction_time": when}
    found = {name: np.where(known, values, NONE) for name, values in found.items()}
    found |= {"smallest_stance_force": stance, "stance_judged": judged}
    if planar.stands and model.sticks:  # the least force on a foot, but where it lands and lifts off
        found["smallest_contact_force"] = np.fmin(certificates.column("smallest_contact_force"), stance)
    motion = np.array([not each for each in violations], dtype=bool)
    sides = np.where(motion, certificates.column("stable_side"), None)
    return certificates.replaced(**found, violations=violations, stable_side=sides)


def _forces_of_ground(
    phase: Phase, motions: Trajectories, which: np.ndarray, names: Sequence[str], vanishing: bool = False
) -> _OfGround:
    rows = [motions.coefficients[:, motions.names.index(name)] for name in names]
    if vanishing:  # up to rounding
        rows = [row.copy() for row in rows]
        for row in rows:
            row[motions.first, 0] = 0.0
    return _OfGround(phase, motions, which, (names[0], names[1]), rows[0], rows[1], vanishing)


def _largest(parts: list[_OfGround], count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The largest shares (m,) over all parts, the part of each, and the time in it."""
    needed, where, place = np.zeros((3, count))
    for j, part in enumerate(parts):
        if not part.along.any():
            continue
        limits, shares = part.at_start(), needed[part.which]
        first = limits > shares
        shares, which = np.where(first, limits, shares), part.which[first]
        needed[which], where[which], place[which] = limits[first], j, 0.0
        for _ in range(MOST_SHARES):
            with np.errstate(all="ignore"):
                times = part.least(shares)
                at = part.share(times)
            rises = at > shares * (1 + SAME_SHARE)
            shares, which = np.where(rises, at, shares), part.which[rises]
            needed[which], where[which], place[which] = at[rises], j, times[rises]
            if not rises.any():
                break
    return needed, where, place


def _share_errors(
    model: Model, cycles: Cycles, parts: list[_OfGround], needed: np.ndarray, where: np.ndarray, place: np.ndarray
) -> np.ndarray:
    """Estimates (m,) of the errors of the shares: by that of the launch speed at the places where they are largest,
    and by rounding."""
    slope = model.liftoff_slope(cycles.u, cycles.p) if model.liftoff_slope else None
    names, ps, errors = tuple(cycles.p), vectors(cycles.p, len(cycles)), np.zeros(len(cycles))
    for j, part in enumerate(parts):
        mine = (where == j)[part.which].nonzero()[0]
        if not len(mine):
            continue
        begin = model.launch if part.phase is model.flight else model.touchdown
        moved = by_launch_speed(partial(begin, p=cycles.p), cycles.u, slope)
        seeds = columns([*moved, cycles.u["alpha"]])[:, :-1, None]
        which, step, flow = part.which[mine], part.steps_at(place[part.which])[mine], flow_of(part.phase, names)
        rows, times, changes = part.motions.coefficients[:, : flow.size], place[which], seeds[which]
        if len(late := np.flatnonzero(times > NEAR_START * part.motions.ends[mine])):
            begins, still = rows[part.motions.first[mine[late]], :, 0], np.zeros((len(late), len(names), 1))
            changes[late] = flow.run_all(begins, ps[which[late]], times[late], changes[late], still)[1]
        states = evaluate(rows[step], (times - part.motions.starts[step])[:, None])
        data = flow.mesh_data(part.motions, ps[part.which])[step]
        (slopes,) = _share_slopes(part.phase, names, part.names)(states, data)
        if part.vanishing and (times == 0).any():
            (limits,) = _share_slopes(part.phase, names, part.names, by_rates=True)(states, data)
            slopes = np.where((times == 0)[:, None], limits, slopes)
        by_speed = np.abs((slopes * changes[:, :, 0]).sum(1)) * cycles.error[which]
        errors[which] = by_speed + SHARE_ROUNDING * EPS * (needed[which] + np.abs(slopes * states).sum(1))
    return errors


@cached
def _share_slopes(
    phase: Phase, parameters: tuple[str, ...], names: tuple[str, str], by_rates: bool = False
) -> ElementwiseFunction:
    """The derivatives of T/N, or of the ratio of their rates, by the state, (x, parameters with data of a piece)."""
    flow = flow_of(phase, parameters)
    x = ca.SX.sym("x", flow.size)
    p = ca.SX.sym("p", len(parameters) + (phase.pieces.size if phase.pieces else 0))
    known = flow.symbols(x, p)
    normal, along = (phase.watch[name](*known) for name in names)
    if by_rates:
        rates = ca.vertcat(*phase.field(*known))
        normal, along = (ca.jtimes(force, x, rates) for force in (normal, along))
    return ElementwiseFunction(ca.Function("slopes", [x, p], [ca.gradient(along / normal, x)]))
