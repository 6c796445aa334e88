"""Springs with hysteresis from two branches, from a mean law with its loss, and from a measured loop."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from orbits.errors import InputError
from orbits.laws import (
    LARGEST_CROSSING,
    ONE_PIECE,
    HystereticLaw,
    Law,
    LawPieces,
    hysteretic_law,
    merged_pieces,
    number,
    scaled_branch,
    sides_of,
)
from orbits.numerics import GAUSS_PLACES, GAUSS_WEIGHTS, bracketed_root


class LoopOptions(NamedTuple):
    """How loops of hysteresis are sampled."""

    samples: int = 2001  # of a law
    farthest: float = 20.0  # distance from rest of the samples of a law, where the range of the law does not end before
    panels: int = 256  # of the quadrature of a loop's area


LOOPS = LoopOptions()
# A loss factor below this keeps both branches of `lossy` pulling toward rest.
LARGEST_LOSS_FACTOR = 2 / math.pi


def of_branches(text: str, extending: Law, shortening: Law) -> HystereticLaw:
    """The spring with these branches; raises `InputError` where a loop between them would gain energy."""
    law = hysteretic_law(text, extending, shortening)
    r = _samples(law.mean)
    with np.errstate(all="ignore"):
        width = extending(r) - shortening(r)
    known = np.isfinite(width)
    r, width = r[known], width[known]
    if not len(r):
        return law
    if width.max() <= 0 and width.min() < 0:
        raise InputError(f"'{text}': the force is smaller while the spring extends: exchange the two branches")
    if width.min() < -LARGEST_CROSSING * width.max() and np.isfinite(law.range()).all():
        place = r[width.argmin()]
        raise InputError(
            f"'{text}': its branches cross, and at r = {place:.6g} the force is smaller while the spring extends: a "
            f"loop there would gain energy; measure it again, or take its mean"
        )
    return law


def of_loss(mean: Law, loss_factor: float) -> HystereticLaw:
    """The spring whose branches are (1 +- pi/2 loss_factor) times its mean law, the force being the larger one while it
    moves away from rest; raises `InputError` for a mean law that does not pull toward one place of rest."""
    share = number("loss_factor", loss_factor)
    if not 0 <= share < LARGEST_LOSS_FACTOR:
        raise InputError(
            f"loss_factor = {share:g}; it must be at least 0 and below 2/pi, at which the spring would not come back"
        )
    if "loss_factor" in mean.parameters:
        raise InputError(f"'{mean.text}' has a parameter 'loss_factor', which is that of the loop: rename it")
    zero = zero_of(mean)
    own = mean.pieces or ONE_PIECE
    place = zero * float(own.units(mean.parameters)) - float(own.origins(mean.parameters))
    sides = Law("sides", "r", mean.expression, {}, LawPieces(1, sides_of(place), own.unit, own.origin))
    pieces = merged_pieces(mean, sides)
    values = {**mean.parameters, "loss_factor": share}
    text = f"lossy:{mean.text}"
    extending, shortening = (
        Law(text, "r", scaled_branch(mean.expression, own.size, side), values, pieces) for side in (1, -1)
    )
    return hysteretic_law(text, extending, shortening, mean)


def zero_of(mean: Law) -> float:
    """The extension at which a mean law vanishes, or that of its range nearest to rest; raises `InputError` where its
    force does not pull toward that place from near it."""
    r = _samples(mean)
    with np.errstate(all="ignore"):
        force = mean(r)
    r, force = r[np.isfinite(force)], force[np.isfinite(force)]
    zero = mean.rest()
    if float(mean(zero)) != 0.0:
        changes = np.flatnonzero((force[:-1] < 0) & (force[1:] >= 0))
        if mean.pieces is None:
            where = f"'{mean.text}' is {float(mean(zero)):g} at r = {zero:g}"
            raise InputError(f"{where}: a loss factor needs a spring that is unloaded there; state its two branches")
        if len(changes) == 1:
            i = int(changes[0])
            zero = float(bracketed_root(lambda x: float(mean(x)), r[i], r[i + 1], float(force[i]), float(force[i + 1])))
    for place in (np.flatnonzero(r < zero)[-1:], np.flatnonzero(r > zero)[:1]):
        if (force[place] * (r[place] - zero) < 0).any():
            where = f"'{mean.text}' is {force[place][0]:.4g} at r = {r[place][0]:.6g}, and pulls away from rest"
            raise InputError(f"{where}: a loss factor would feed it energy there; state its two branches")
    return zero


def loss_factor_of(mean: Law, loop_area: float, between: tuple[float, float]) -> float:
    """The loss factor with which a loop between two extensions has an area."""
    try:
        low, high = sorted(number("between", end) for end in between)
    except TypeError:
        raise InputError(
            f"between = {between!r}; it must be the two extensions between which the loop was measured"
        ) from None
    area, bounds = number("loop_area", loop_area), mean.range()
    if area < 0:
        raise InputError(f"loop_area = {area:g} is below 0; it is the energy that one cycle loses")
    if not bounds[0] <= low < high <= bounds[1]:
        raise InputError(f"between = ({low:g}, {high:g}); the law is known from {bounds[0]:g} to {bounds[1]:g}")
    zero = zero_of(mean)
    inside = [float(place) for place in mean.corners() if low < place < high]
    ends = sorted({low, high, *inside, *([zero] if low < zero < high else [])})
    edges = np.unique(np.concatenate([np.linspace(a, b, LOOPS.panels) for a, b in pairwise(ends)]))
    widths = np.diff(edges)
    forces = np.abs(mean(edges[:-1, None] + widths[:, None] * GAUSS_PLACES))
    whole = float((widths[:, None] * GAUSS_WEIGHTS * forces).sum())
    return area / (math.pi * whole)


def _samples(law: Law) -> np.ndarray:
    """Extensions throughout the range of a law, as far as it is near rest."""
    low, high = (min(max(end, -LOOPS.farthest), LOOPS.farthest) for end in law.range())
    return np.linspace(low, high, LOOPS.samples)
