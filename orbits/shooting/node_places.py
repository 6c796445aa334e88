"""Where the nodes lie that divide motions near unstable equilibria.

While a motion stays near an equilibrium a small change grows, and nodes in equal distances determine it. Where it
continues to a second equilibrium, as family 2 of a spring with a barrier, or family 1 of one with a barrier on either
side, the change shrinks on the way there, and the time between both passages depends on the last digits of the energy
alone. With states on that way as unknowns the equations would hardly change if all of these moved along the motion, and
Newton's method would converge only from within these last digits. So nodes lie where a change has grown no more than at
any later time: on the way to the first equilibrium, and at the middle of each passage, where the state is nearest to
the equilibrium and its distance from there, and so the energy, has most digits.
"""

from collections.abc import Iterator, Sequence
from itertools import islice, pairwise
from typing import NamedTuple

import numpy as np

from ..flow import Trajectories
from ..numerics import Array, slopes
from .single_shooting import Evaluation


class DivisionOptions(NamedTuple):
    """When motions are divided at nodes, and where these are."""

    # Largest growth of a small change over an arc: with more its derivatives lose their rank to rounding.
    arc_growth: float = 3e7
    # Error of the launch speed, a share of it or of 1 if it is less, from which on motions are divided before.
    error: float = 3e-12
    growth: float = 3e3  # of a small change, below which an error of the launch speed has other reasons
    # Growth of a small change on the motions from which Newton's method begins: with more it begins with nodes.
    sensitive: float = 4e4
    most_growth: float = 1e14  # with more growth the launch does not determine the motion any more in 16 digits
    # Growth from one node to the next that is aimed at. Where a change shrinks again by a larger factor, there are no
    # nodes on the way.
    part_growth: float = 1e2
    # Largest growth between nodes where a motion is divided: it varies along the motion, and increases along a curve.
    largest_part_growth: float = 1e3
    parts: int = 100  # of an arc, at most
    # Multiples of the number of nodes that are tried. Where a motion passes several equilibria there are no nodes on
    # the ways between, however fine the others are.
    finer: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64)
    # Unknowns stay as they are in directions in which the equations change by a smaller share.
    undetermined: float = 1e-8
    steps_to_nearest: int = 30  # of Newton's method to the nearest solution, at most
    least_state: float = 0.1  # states at nodes that are a smaller share of the largest are measured in it
    steady_points: int = 4  # through which polynomials give the tangents at nodes that are not known well enough
    too_near: float = 0.1  # share of the mean distance of points: closer ones are not used together


DIVISION = DivisionOptions()


class GrowthAlong(NamedTuple):
    """The growths (k,) of a small change from the start of an arc to some times (k,), from 0 to the arc's end."""

    times: Array
    growths: Array


class _ChangesOverPart(NamedTuple):
    """The motions (m,) over a part of an arc, and the derivatives of their states by the state at the start of the arc:
    at the starts of their steps (N, n, n), None where they are not known, and at their ends (m, n, n)."""

    motions: Trajectories
    at_steps: Array | None
    at_end: Array


def growths_along(evaluation: Evaluation, counts: Sequence[int]) -> list[GrowthAlong]:
    """The growths along each arc of one motion (1), whose arcs are divided into these numbers of parts."""
    found = list[GrowthAlong]()
    for parts in _changes_along(evaluation, counts):
        begun, times, growths = 0.0, [np.zeros(1)], [np.ones(1)]
        for motions, at_steps, at_end in parts:
            if at_steps is not None:
                times.append(begun + motions.starts[1:])
                growths.append(np.abs(at_steps[1:]).max((1, 2)))
            begun += float(motions.ends[0])
            times.append(np.array([begun]))
            growths.append(np.abs(at_end).max((1, 2)))
        found.append(GrowthAlong(np.concatenate(times), np.concatenate(growths)))
    return found


def largest_growths(evaluation: Evaluation, counts: Sequence[int]) -> Array:
    """The largest growths (m, arcs) of a small change from the start of each arc of m motions to a place of it."""
    growths = list[Array]()
    for parts in _changes_along(evaluation, counts):
        known = [np.abs(part.at_end).max((1, 2)) for part in parts]
        known += [part.motions.largest(part.at_steps) for part in parts if part.at_steps is not None]
        growths.append(np.max(known, axis=0))
    return np.array(growths).T


def _changes_along(evaluation: Evaluation, counts: Sequence[int]) -> Iterator[list[_ChangesOverPart]]:
    """The parts of each arc, where the arcs are divided into these numbers of parts."""
    every = iter(zip(evaluation.trajectories, evaluation.transitions, strict=True))
    for count in counts:
        parts = list[_ChangesOverPart]()
        for motions, transition in islice(every, count):
            n = transition.shape[1]
            before = parts[-1].at_end if parts else np.broadcast_to(np.eye(n), (len(transition), n, n))
            known = motions.variations
            at_steps = None if known is None else known[:, :, :n] @ before[motions.owner]
            parts.append(_ChangesOverPart(motions, at_steps, transition[:, :, :n] @ before))
        yield parts


def even(count: int) -> tuple[float, ...]:
    """The shares of an arc's duration that this number of parts of equal durations take."""
    return (1 / count,) * count


def lengths_of_parts(along: GrowthAlong, finer: int = 1) -> tuple[float, ...]:
    """The shares of an arc's duration that its parts take between nodes, from how small changes grow along it; with
    `finer` times as many nodes as where the growth between two of them is the one that is aimed at."""
    times, growths = along
    later = np.minimum.accumulate(growths[::-1])[::-1]
    if (growths <= DIVISION.part_growth * later).all():
        count = int(np.ceil(np.log(np.maximum(growths.max(), 1.0)) / np.log(DIVISION.part_growth))) * finer
        return even(count + 1 if count > 1 else 1)
    nodes, last, between, aimed = list[int](), 0, False, DIVISION.part_growth ** (1 / finer)
    for here, following in pairwise(np.flatnonzero(growths <= later).tolist()):
        ends, between = between, bool(growths[here:following].max() > DIVISION.part_growth * later[here])
        if here > 0 and (ends or between or growths[following] > aimed * growths[last]):
            nodes.append(here)
            last = here
    return tuple((np.diff([0.0, *times[nodes], times[-1]]) / times[-1]).tolist())


def steady_tangents(xs: Array, tangents: Array, sizes: Array, nodes: slice) -> Array:
    """The tangents (c, N + 1) at a chain of points (c, N + 1) of a curve, whose components have these units. Where
    motions pass two unstable equilibria one after the other, the Jacobian has few digits for the states at nodes: their
    tangents are then those of polynomials through the points, if these are enough."""
    if len(xs) < DIVISION.steady_points:
        return tangents
    found, shares = tangents.copy(), np.abs(tangents / sizes)
    shares[:, nodes] = 0.0
    for i, j in enumerate(shares.argmax(1).tolist()):  # the coordinate that changes most measures the way
        near = _points_apart(xs[:, j], i)
        found[i, nodes] = slopes(xs[near, j], xs[near, nodes]) * tangents[i, j]
    return found


def _points_apart(places: Array, i: int) -> list[int]:
    """The point number i of a chain with places (c,) and up to `DIVISION.steady_points` in all that are near it, but
    not so near to one another that their differences have few digits."""
    found, least = [i], DIVISION.too_near * float(np.ptp(places)) / (len(places) - 1)
    for k in np.argsort(np.abs(places - places[i]), kind="stable").tolist():
        if len(found) < DIVISION.steady_points and np.abs(places[found] - places[k]).min() > least:
            found.append(k)
    return found
