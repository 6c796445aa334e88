"""Landings of a machine that stands on one foot in flight: hand-overs from this foot to the one that lands.

A hand-over is a plastic impact in which the foot that lands is caught and the other one is let go. In the labels in
which the machine stands, with g' the speed of the gap there, D the direction of impacts and m their mass, it leads from
the rates y' to y' - (1 - rho) g' D, and m g'^2 (1 - rho^2)/2 is lost: rho is the share of the speed of the gap that is
left, the same for steps forward and back. Where it is above 0 the foot that was let go opens; else both feet stay where
both are pressed down. A landing so slow that its energy is rounding is caught by both feet, as a lossless one is.

Feet that stick are both caught with all of their speed where the impulses press them. An impulse may pull if the force
on its foot makes up for it in a short time. Otherwise the other foot is let go, and the momentum about the foot that
lands stays. Where that foot would have to pull, it would slide, which ends the motion.
"""

from typing import Any, NamedTuple

import numpy as np

from .points_of_contact import SLOW

# Hand-overs without a loss, up to rounding: then no contact ever holds.
LOSSLESS_HAND_OVER = 1e-12
# Hand-overs to and fro are summed once the accelerations that close the gaps change by less than this share while they
# last. All of the energy of their speed is lost in any case, and the rest of the motion changes by the share's cube.
SUMMED_HAND_OVERS = 1e-4


class Landed(NamedTuple):
    """What landings lead to, for m states.

    held : whether (m,) contact follows, immediately or after infinitely many bounces or hand-overs
    state : states (m, n) after them; the state with which a contact begins, or the states that leave at once
    loss, wait : energies (m,) lost and times (m,) of infinitely many bounces or hand-overs
    order, foot : numbers (m,) of the feet that leave at once, with the orders (m,) of the zeros of their gaps; of
        contact, the order of the zero of its force
    step : numbers (m,) of relabellings, those back below 0
    ended : (m,) "", or the status with which the motion ends
    left : shares (m,) of the speed of the gap, in the labels in which the machine stands, that are left
    """

    held: np.ndarray
    state: np.ndarray
    loss: np.ndarray
    wait: np.ndarray
    order: np.ndarray
    foot: np.ndarray
    step: np.ndarray
    ended: np.ndarray
    left: np.ndarray


def landed(impacts: Any, x: np.ndarray, foot: np.ndarray) -> Landed:
    """The effect of landings at flight states (m, n) in which the gaps of feet (m,) are closed."""
    z, step = standing(impacts, x, foot)
    if impacts.model.changes_contact and impacts.model.sticks:
        return _caught(impacts, x, foot)
    if impacts.model.changes_contact:
        return _hand_overs(impacts, z, step)
    held, after, loss, wait, rises = impacts.landing(z)
    order, none = np.where(held, rises, impacts.bounce_order), np.zeros(len(x), int)
    left = np.where(held, 0.0, -impacts.restitution)
    return Landed(held, after, loss, wait, order, none, step, np.full(len(x), ""), left)


def standing(impacts: Any, x: np.ndarray, foot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Flight states (m, n) in which the gaps of feet (m,) are closed, in the labels in which the machine stands on
    them, and the numbers (m,) of relabellings that lead there. What sticks at 0 is there, wherever it landed."""
    z, step = x, np.zeros(len(x), int)
    for i, each in enumerate(impacts.feet):
        if each.labels and (own := foot == i).any():
            z, step = np.where(own[:, None], each.labels(x, impacts.values), z), np.where(own, each.step, step)
    return (impacts.footing.placed(z) if impacts.model.sticks else z), step


def share_left(impacts: Any, z: np.ndarray) -> np.ndarray:
    """rho (m,) in hand-overs at states (m, n) in which the machine stands; NaN where it is not known."""
    return np.broadcast_to(impacts.model.share_left(list(z.T), impacts.values), len(z))


def _hand_overs(impacts: Any, z: np.ndarray, step: np.ndarray) -> Landed:
    """The hand-overs at states (m, n), in the labels in which the machine stands, after these numbers of steps."""
    speed, direction = z @ impacts.gap_speed, impacts.direction(z)
    stuck = z - speed[:, None] * direction
    forces = impacts.forces_of_exits(stuck)
    slow = np.abs(speed) <= SLOW * (1 + np.abs(z).max(1))
    rho = np.where(slow, 0.0, share_left(impacts, z))
    ended = np.where(np.isnan(rho), "unstated", np.where(rho**2 >= 1 - LOSSLESS_HAND_OVER, "rattles", ""))
    rho = np.where((ended == "") & (rho > 0), rho, 0.0)
    back = np.where(rho > 0, speed < 0, forces[1] < forces[0]).astype(int)  # the exit of the foot that leaves
    wait = _rattling(impacts, stuck, speed, rho, back)
    held = (forces >= 0).all(0) & ((rho == 0) | np.isfinite(wait)) & (ended == "")
    left = np.where(held, 0.0, rho)
    mass = impacts.model.impact_mass(list(z.T), impacts.values)
    loss = np.select([ended == "unstated", ended == "rattles"], [np.nan, 0.0], 0.5 * mass * speed**2 * (1 - left**2))
    state, foot = stuck + (left * speed)[:, None] * direction, np.zeros(len(z), int)
    leaves_back = ~held & (back == 1)
    if leaves_back.any():
        way = impacts.exits[1]
        state = np.where(leaves_back[:, None], way.opened(state, impacts.values), state)
        foot, step = np.where(leaves_back, way.foot, foot), step - leaves_back
    order = np.where(held, 0, np.where(rho > 0, 1, 2))
    return Landed(held, state, loss, np.where(held & (rho > 0), wait, 0.0), order, foot, step, ended, left)


def _rattling(impacts: Any, stuck: np.ndarray, speed: np.ndarray, rho: np.ndarray, back: np.ndarray) -> np.ndarray:
    """The times (m,) of infinitely many hand-overs, which are to be summed; infinite where they are not."""
    total, changes = np.zeros(len(stuck)), list[tuple[np.ndarray, np.ndarray]]()
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for i, way in enumerate(impacts.exits):
            foot, x = impacts.feet[way.foot], way.opened(stuck, impacts.values)
            closing = -(impacts.flight.field(x, impacts.p)[0] @ foot.speed)
            first = np.where(back == i, rho, rho**2)  # the foot that leaves first has more speed
            total += np.where(closing > 0, 2 * np.abs(speed) * first / (1 - rho**2) / closing, np.inf)
            changes.append((*(np.abs(foot.rates(x, impacts.p)) / closing),))
        largest = np.max([total * (jerk + 0.5 * total * snap) for jerk, snap in changes], axis=0)
        return np.where(largest <= SUMMED_HAND_OVERS, total, np.inf)


def let_go(impacts: Any, x: np.ndarray, foot: np.ndarray) -> np.ndarray:
    """The flight states (m, n) after landings on feet (m,) at flight states (m, n) where the other foot is let go, in
    its labels; NaN where they are not known."""
    planar, found = impacts.model.planar, np.full_like(x, np.nan)
    for i, taken_over in enumerate((planar.handed_back, planar.handed_over) if planar else ()):
        if taken_over and (own := foot == i).any():
            rows = taken_over(list(x[own].T), impacts.values)
            found[own] = np.stack(np.broadcast_arrays(*rows, x[own, 0])[:-1], axis=1)
    return found


def impulses(impacts: Any, x: np.ndarray, foot: int, after: Landed) -> list[np.ndarray]:
    """The impulses (2,) across and along the ground on the feet that a landing on one in a flight state (n,) presses.

    A foot that it unloads for a moment is left out."""
    model, values = impacts.model, impacts.values
    if not model.grazes:
        return [-np.array(model.impulses(x.tolist(), values), dtype=float)]
    if after.order[0] == 1:
        before, then = (model.planar.momentum(each.tolist(), values) for each in (x, after.state[0]))
        return [np.subtract(then, before)]
    (free,) = let_go(impacts, x[None], np.array([foot]))
    found = [-np.array(model.impulses(each.tolist(), values), dtype=float) for each in (x, free)]
    return [each for each in found if each[0] >= 0]


def _caught(impacts: Any, x: np.ndarray, foot: np.ndarray) -> Landed:
    """The landings of feet that stick at flight states (m, n), where both feet may stand then."""
    model, values, own = impacts.model, impacts.values, np.arange(len(x))
    z, step = standing(impacts, impacts.footing.stuck(x), foot)
    forces, free = impacts.forces_of_exits(z), let_go(impacts, x, foot)
    speeds = np.abs(np.stack(model.speeds_of_landing(list(x.T), values))).max(0)
    fast = speeds > SLOW * (1 + np.abs(x).max(1))
    opening = np.array([free @ each.speed for each in impacts.feet])[1 - foot, own]
    # The impulses on the foot that lands and on the other one, in the order of the exits.
    pushes = np.array([-np.stack(model.impulses(list(each.T), values))[0] for each in (x, free)])
    caught = ~fast | (_unloaded(impacts, z, forces, pushes[[foot, 1 - foot], own]) <= impacts.options.unloaded)
    leaves = ~caught & (opening > 0)
    if leaves.any():
        before, after = (np.stack(model.planar.momentum(list(each.T), values))[0] for each in (x, free))
        leaves &= after >= before
    ended = np.select([caught | leaves, np.isnan(opening)], ["", "unstated"], "slips")
    held = caught & (forces >= 0).all(0)
    back = np.where(leaves, foot == 0, ~held & (forces[1] < forces[0]))
    loss = np.where(ended == "", np.broadcast_to(model.lost_at(list(x.T), values), len(x)), np.nan)
    if leaves.any():
        loss[leaves] = impacts.energies(x[leaves]) - impacts.energies(free[leaves])
    way, none = impacts.exits[1], np.zeros(len(x))
    state = np.where(leaves[:, None], free, np.where(back[:, None], way.opened(z, values), z))
    order = np.where(held, 0, np.where(leaves, 1, 2))
    return Landed(held, state, loss, none, order, np.where(back, way.foot, 0), step - back, ended, none)


def _unloaded(impacts: Any, z: np.ndarray, forces: np.ndarray, pushes: np.ndarray) -> np.ndarray:
    """The largest share (m,) by which the accelerations of feet change while the forces (2, m) on them in states (m, n)
    make up for impulses (2, m) that would pull; infinite where they never do."""
    shares = np.zeros(pushes.shape)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for i, way in enumerate(impacts.exits):
            foot, there = impacts.feet[way.foot], way.opened(z, impacts.values)
            closing = -(impacts.flight.field(there, impacts.p)[0] @ foot.speed)
            lasts = np.where((forces[i] > 0) & (closing > 0), -pushes[i] / forces[i], np.inf)
            jerk, snap = np.abs(foot.rates(there, impacts.p)) / closing
            shares[i] = np.where(pushes[i] < 0, lasts * (jerk + 0.5 * lasts * snap), 0.0)
    return np.where(np.isnan(pushes), np.inf, shares).max(0)
