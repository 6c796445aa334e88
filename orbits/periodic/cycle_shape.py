"""The shape of a cycle: how the stored motions make up the whole cycle, and the parts of it that are shown."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple, NotRequired, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from ..flow import Trajectory
from ..model import Affine, Knee, SavedHeight, SignedShift, StateFormula, height_of


class StepMaps(NamedTuple):
    """The maps of a machine that steps.

    reversor_shift, contact_shift : what time reversal adds to flight states (n,) and to contact states (m,) after it
        changed their signs
    signs, shift : (n,), of the relabelling after a landing
    """

    reversor_shift: tuple[float, ...]
    contact_shift: tuple[float, ...]
    signs: tuple[float, ...]
    shift: tuple[float, ...]


@dataclass(frozen=True)
class Shape:
    """The construction of a whole cycle from the stored half motions, and the parts of it to show.

    reversor, contact_reversor : signs of the states under time reversal, None where whole motions are stored
    embed : (n, m) matrix from contact to flight states
    heights : names and functions of the flight state, the masses first
    springs : names of the heights, lower and upper, that springs join, None for the ground
    knees : such names with the length of each of the two links that join them
    steps : the maps of a machine that steps, None for another one
    extension : weights (n,) of the flight states in the extension, None in older files
    segments : such weights of the angles of limbs, by name
    """

    reversor: tuple[int, ...] | None
    contact_reversor: tuple[int, ...] | None
    embed: np.ndarray
    heights: Mapping[str, Affine | StateFormula]
    springs: tuple[tuple[str | None, str], ...]
    knees: tuple[Knee, ...] = ()
    steps: StepMaps | None = None
    extension: tuple[float, ...] | None = None
    segments: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def saved(self) -> dict[str, object]:
        """The fields for a file, without what the machine does not have."""
        absent: dict[str, object] = {"steps": None, "extension": None, "segments": {}}
        stated = {name: value for name, value in vars(self).items() if name not in absent or value != absent[name]}
        return stated | {"heights": {name: height.saved() for name, height in self.heights.items()}}

    def images(self, first: np.ndarray, contact: bool = False) -> np.ndarray | None:
        """The coefficients (N, n, K + 1) of the second half of a flight or contact from those of the first; None where
        both have the same places, and where whole motions are stored."""
        signs = self.contact_reversor if contact else self.reversor
        if self.steps is None or signs is None:
            return None
        shift = self.steps.contact_shift if contact else self.steps.reversor_shift
        return SignedShift(signs, lambda p: shift).rows(first, {})

    def in_units(self, sizes: np.ndarray) -> "Shape":
        """This shape, except its heights, in units in which one old unit of the flight states is `sizes` (n,)."""
        if self.steps is None:
            return self
        own = sizes, sizes[(self.embed != 0).argmax(0)], np.ones(len(sizes)), sizes
        steps = (tuple((unit * np.array(each)).tolist()) for unit, each in zip(own, self.steps, strict=True))
        return replace(self, steps=StepMaps(*steps))

    def unrolled(self, states: np.ndarray, landings: np.ndarray) -> np.ndarray:
        """Flight states (..., n) in the labels before these numbers of landings (...)."""
        return states if self.steps is None else relabelled_back(states, landings, self.steps.signs, self.steps.shift)


def relabelled_back(states: np.ndarray, steps: np.ndarray, signs: ArrayLike, shifts: ArrayLike) -> np.ndarray:
    """States (..., n) in the labels before these numbers of relabellings (...), x -> signs x + shifts."""
    moved, count = np.asarray(shifts), steps[..., None]
    turned = np.where(count % 2 == 1, moved - states, states)
    return np.where(np.asarray(signs) > 0, states - count * moved, turned)


def mirrored(
    path: Trajectory,
    t: np.ndarray,
    duration: float,
    signs: tuple[int, ...] | None,
    shift: tuple[float, ...] | None = None,
) -> np.ndarray:
    """States at times `t` of a motion with the first half `path`; its image under `signs`, if any, is the second."""
    t = np.clip(t, 0, duration)
    if signs is None:
        return path(t)
    later = t > path.times[-1]
    states = path(np.where(later, duration - t, t))[..., : len(signs)]
    images = states * np.array(signs)
    return np.where(later[..., None], images if shift is None else images + np.array(shift), states)


class SavedShape(TypedDict):
    """A `Shape` in a file: its heights as pairs of weights and offset, or as formulas."""

    reversor: tuple[int, ...] | None
    contact_reversor: tuple[int, ...] | None
    embed: np.ndarray
    heights: Mapping[str, SavedHeight]
    springs: tuple[tuple[str | None, str], ...]
    knees: NotRequired[tuple[Knee, ...]]
    steps: NotRequired[tuple[tuple[float, ...], ...]]
    extension: NotRequired[tuple[float, ...]]
    segments: NotRequired[Mapping[str, tuple[float, ...]]]


def shape_of(data: SavedShape, flight: Trajectory, contact: Trajectory | None) -> Shape:
    """A shape for the states of the motions; raises `ValueError` where it does not fit them."""
    embed, signs = data["embed"], (data["reversor"], data["contact_reversor"])
    sizes = embed.shape if embed.ndim == 2 and embed.dtype.kind in "fi" and np.isfinite(embed).all() else (0, 0)
    heights = {name: height_of(height, flight.names[: sizes[0]]) for name, height in data["heights"].items()}
    known = {*heights, None}
    fits = 0 < sizes[0] <= len(flight.names) and 0 < sizes[1] <= (sizes[1] if contact is None else len(contact.names))
    fits &= all(each is None or len(each) == size for each, size in zip(signs, sizes, strict=True))
    weights = (height.weights for height in heights.values() if isinstance(height, Affine))
    steps, own, extension = data.get("steps"), [sizes[0], sizes[1], sizes[0], sizes[0]], data.get("extension")
    segments = data.get("segments", {})
    fits &= all(len(each) == sizes[0] for each in (*([] if extension is None else [extension]), *segments.values()))
    fits &= steps is None or [len(each) for each in steps] == own
    fits &= bool(heights) and all(len(each) == sizes[0] for each in weights)
    knees = data.get("knees", ())
    if not fits or not {*sum(data["springs"], ()), *(name for *pair, _ in knees for name in pair)} <= known:
        raise ValueError("its shape does not fit its motion")
    maps = None if steps is None else StepMaps(*steps)
    return Shape(*signs, embed, heights, data["springs"], knees, maps, extension, segments)
