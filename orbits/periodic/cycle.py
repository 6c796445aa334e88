"""The states over a whole cycle, from the stored halves of flight and contact."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..flow.trajectory import Trajectory
from ..model.phase import Affine


@dataclass(frozen=True)
class Shape:
    """How the stored half motions make a whole cycle, and what of it to show.

    reversor, contact_reversor : signs of the states under time reversal, None where whole motions are stored
    embed : (n, m) matrix from contact to flight states
    heights : names and functions of the flight state, the masses first
    springs : names of the heights, lower and upper, that springs join, None for the ground
    """

    reversor: tuple[int, ...] | None
    contact_reversor: tuple[int, ...] | None
    embed: np.ndarray
    heights: Mapping[str, Affine]
    springs: tuple[tuple[str | None, str], ...]

    def in_flight(self, flight: Trajectory, flight_time: float, t: np.ndarray) -> np.ndarray:
        """Flight states (..., n) at times `t` (...) after lift-off."""
        return _mirrored(flight, np.minimum(t, flight_time), flight_time, self.reversor)

    def in_contact(self, contact: Trajectory, contact_time: float, t: np.ndarray) -> np.ndarray:
        """Flight states (..., n) at times `t` (...) after landing."""
        states = _mirrored(contact, np.clip(t, 0, contact_time), contact_time, self.contact_reversor)
        return states[..., : self.embed.shape[1]] @ self.embed.T


def _mirrored(path: Trajectory, t: np.ndarray, duration: float, signs: tuple[int, ...] | None) -> np.ndarray:
    """Rows at times `t` of a motion whose first half is `path` and whose second is its image under `signs`, if any."""
    if signs is None:
        return path(t)
    later = t > path.times[-1]
    states = path(np.where(later, duration - t, t))[..., : len(signs)]
    return np.where(later[..., None], states * np.array(signs), states)
