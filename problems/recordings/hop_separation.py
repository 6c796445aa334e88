"""Which parameters a record separates, with what deviations, and which further measurement would."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .channels import channels_of
from .hop_program import HopProgram


class SeparationOptions(NamedTuple):
    """When parameters are not separated, and what another channel is taken to be like."""

    same: float = 1e-6  # share of the largest singular value below which a direction is not seen
    seen: float = 1e-4  # the share that another channel has to lift it to
    involved: float = 1e-3  # share of a direction from which on a parameter is in it
    noise: float = 0.01  # of another channel, in sizes


SEPARATION = SeparationOptions()


class Separation(NamedTuple):
    """What a record says about the unknown parameters.

    covariance : (k, k), infinite for parameters that are not separated
    together : groups of names that the record does not separate
    remedy : which further channels would separate them, in words
    """

    covariance: np.ndarray
    together: tuple[tuple[str, ...], ...]
    remedy: str


def separation(program: HopProgram, z: np.ndarray, slopes: np.ndarray) -> Separation:
    """The covariance of the unknown parameters from the derivatives (r, d) of the weighted residuals."""
    names, sizes = program.unknowns.names, program.parameter_sizes
    k = len(names)
    values, rows, scale = _directions(slopes)
    hidden = np.flatnonzero(values <= SEPARATION.same * values[0])
    groups = _groups(rows[hidden][:, :k], names)
    with np.errstate(divide="ignore"):
        inverse = np.where(values > SEPARATION.same * values[0], 1 / values, 0.0)
    half = (rows.T * inverse)[:k] * (sizes / scale[:k])[:, None]
    covariance = half @ half.T
    for group in groups:
        own = [names.index(name) for name in group]
        covariance[own], covariance[:, own] = 0.0, 0.0
        covariance[own, own] = np.inf
    return Separation(covariance, groups, _remedy(program, z, slopes) if groups else "")


def _directions(slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Singular values and right vectors of the derivatives in columns of length 1, and the lengths of the columns."""
    scale = np.linalg.norm(slopes, axis=0)
    scale[scale == 0] = 1.0
    _, values, rows = np.linalg.svd(slopes / scale, full_matrices=False)
    return values, rows, scale


def _groups(directions: np.ndarray, names: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """The parameters in directions (h, k) that nothing recorded depends on, those together that share one."""
    found = list[set[str]]()
    for row in directions:
        own = {name for name, share in zip(names, row, strict=True) if abs(share) > SEPARATION.involved}
        if not own:
            continue
        for other in [each for each in found if each & own]:
            own |= other
            found.remove(other)
        found.append(own)
    return tuple(tuple(name for name in names if name in each) for each in found)


def _remedy(program: HopProgram, z: np.ndarray, slopes: np.ndarray) -> str:
    """The channels that would each separate the parameters, at the times of the first recorded channel."""
    recorded = {each.name for each in program.unknowns.channels}
    others = [each for name, each in channels_of(program.unknowns.machine).items() if name not in recorded]
    k, found = len(program.unknowns.names), []
    for channel in others:
        first = program.samples[0]
        sample = first._replace(values=np.zeros(len(first.times)), weights=np.ones(len(first.times)))
        own = program.unknowns._replace(channels=(channel,), biased=(False,), delayed=(False,), sizes=(1.0,))
        other = HopProgram(own, program.motions, [sample])  # its unknowns have the same sizes
        point = np.concatenate([z[:k], z[program.unknowns.common :]])
        more, size = other.slopes(point, [sample])[0], np.ptp(other.residuals(point)[0][0])
        if not size > 0:
            continue
        wide = np.zeros((len(more), slopes.shape[1]))
        wide[:, :k] = more[:, :k]
        wide[:, program.unknowns.common :] = more[:, k:]
        values, rows, _ = _directions(np.vstack([slopes, wide / (SEPARATION.noise * size)]))
        hidden = rows[values <= SEPARATION.seen * values[0]][:, :k]
        if not (np.abs(hidden) > SEPARATION.involved).any():
            found.append(channel.name)
    return f"the {' or the '.join(found)} would separate them" if found else "no other channel would separate them"
