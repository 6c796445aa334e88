"""Coordinates that stick in contact: where the foot stands, what a landing stops, and the friction that holds it.

The place of a coordinate that sticks is 0 in the labels of each stance, unless the motion depends on it, and a
simulation keeps the place from which it is counted, the foothold. A landing stops the speed of the gap and that along
the ground, by one impulse. Where a coefficient of friction is stated, the foot slips as soon as it needs more.
"""

from collections.abc import Iterable, Sequence
from functools import cached_property, partial
from typing import Any, cast

import numpy as np

from ..errors import InputError
from ..flow import Flow
from ..laws import Parameters
from ..model import Affine, Model, StateFormula
from ..numerics import Crossings, bracketed_root, evaluate
from ..units import LENGTH, Message, Quantity, described
from .points_of_contact import Foot

SLIPS = "slips"  # how a contact ends where the friction is exceeded
FALLS = "falls"  # how a flight or a contact ends where a height other than the closed gap reaches the ground
# A foot slips where it needs more than the stated friction by this share of the machine's weight, or while the contact
# force is larger than this: both forces vanish together at a lossless lift-off, up to errors that grow step by step.
SLIPPING = 1e-9
TILTS = np.linspace(0.0, 2 * np.pi, 129)  # between two of these the first zero of a height within a turn is searched


class Footing:
    """What sticks of a machine, at values of its parameters.

    sticks : the number of its place in the flight state, [] where nothing sticks
    counted : those of them that are counted from the foothold, so that they stick at 0
    rocks : whether the machine stands on one foot after the other, and does not turn while it stands on both
    friction : the largest share of the force across the ground that the force along it may have, None for any
    """

    def __init__(self, model: Model, flight: Flow, contact: Flow, p: Parameters):
        self.model, self.flight, self.contact, self.p = model, flight, contact, p
        self.sticks = [model.flight.states.index(name) for name in model.sticks]
        self.counted = self.sticks if model.runs else []
        self.rocks = model.changes_contact and not model.sticks
        stated = model.planar.friction if self.sticks and model.planar else None
        self.friction = None if stated is None else float(stated(p))

    @cached_property
    def held(self) -> tuple[Foot, ...]:
        """What sticks, as places with their rates."""
        unit = np.eye(self.flight.size)
        return tuple(Foot(self.flight, "", Affine(tuple(unit[i]))) for i in self.sticks)

    def placed(self, x: np.ndarray) -> np.ndarray:
        """Flight states (..., n) counted from where the foot stands."""
        x = x.copy()
        x[..., self.counted] = 0.0
        return x

    def moved(self, before: np.ndarray, after: np.ndarray) -> float:
        """How far the foothold moves where flight states (n,) are counted anew: by the place at which a foot sticks, or
        by what the centre of mass, which stays, is away from each."""
        if self.counted or not self.sticks:
            return sum(before[self.counted].tolist())
        across = cast(Any, self.model.planar).across
        return float(across(before.tolist(), self.p) - across(after.tolist(), self.p))

    def stuck(self, x: np.ndarray) -> np.ndarray:
        """Flight states (m, n) after plastic impacts at flight states (m, n)."""
        rows = self.model.landed(list(x.T), self.p)
        return np.stack(np.broadcast_arrays(*rows, x[:, 0])[:-1], axis=1)

    def refuse_sliding(self, x: np.ndarray, tolerance: float) -> None:
        """Raise `InputError` for a flight state (n,) on the ground in which what sticks has a speed."""
        names = self.flight.phase.states
        if any(abs(x[i + 1]) > tolerance for i in self.sticks):
            text = "state = {place}: its foot sticks to the ground, so '{name}' must be 0"
            raise InputError(Message(text, place=described(names, x), name=names[self.sticks[0] + 1]))

    @property
    def forces_on_feet(self) -> list[tuple[str, str]]:
        """The names of the forces across and along the ground on each foot that stands in contact."""
        return [(across, along) for phase, across, along, _ in self.model.standing_points if phase == "contact"]

    @property
    def cone(self) -> tuple[tuple[Affine, Affine, int], ...]:
        """What is left of the friction in each direction, the force across the ground, as functions of the rows of the
        contact's motion, and the number of the foot."""
        if self.friction is None:
            return ()
        rows = [*self.model.contact.states, *self.model.contact.watch]
        held = [
            ({across: self.friction, along: sign}, {across: 1.0}, i)
            for i, (across, along) in enumerate(self.forces_on_feet)
            for sign in (1.0, -1.0)
        ]
        of = lambda weights: Affine(tuple(weights.get(name, 0.0) for name in rows))  # noqa: E731
        return tuple((of(left), of(force), i) for left, force, i in held)

    @cached_property
    def heights(self) -> dict[str, Affine | StateFormula]:
        """The heights that stay above the ground: of a machine that sticks all but the gap, and of one that steps that
        which is its separation, as of the corner on which a block would lie on its side."""
        heights, gap = self.model.heights(self.p), self.model.gap(self.p)
        if self.rocks:
            apart = self.model.separation(self.p)
            return {name: each for name, each in heights.items() if each == apart}
        return {name: each for name, each in heights.items() if self.sticks and each != gap}

    @cached_property
    def in_contact(self) -> dict[str, Affine | StateFormula]:
        """The heights that stay above the ground while a point stands, as functions of the flight state: those of the
        flight, unless the machine does not turn while two points stand, and that of the point that lands next."""
        heights = {} if self.rocks else dict(self.heights)
        if (landing := self.model.landing_gap) and self.model.standing_gap(self.p):
            heights[self.model.feet[-1] if self.model.feet else "next point"] = landing(self.p)
        return heights

    @cached_property
    def tilts(self) -> tuple[Foot, ...]:
        """For each of the heights of a machine that steps, if it depends on one coordinate alone: what closes as that
        coordinate comes to the first place above 0 where the height vanishes."""
        found = list[Foot]()
        for each in self.heights.values() if self.rocks else ():
            if isinstance(each, StateFormula) and len(each.coordinates) == 1:
                turned = np.eye(self.flight.size)[self.flight.phase.states.index(each.coordinates[0])]
                values = np.asarray(each(TILTS[:, None] * turned))
                above = values > 0
                for i in np.flatnonzero(above[:-1] & ~above[1:])[:1]:
                    ends = *TILTS[i : i + 2].tolist(), *values[i : i + 2].tolist()
                    at = bracketed_root(partial(_turned_height, each, turned), *ends)
                    found.append(Foot(self.flight, "", Affine(tuple(-turned), at)))
        return tuple(found)

    @property
    def falls_by_formula(self) -> bool:
        """Whether a height in flight reaches the ground where none of the `tilts` closes."""
        return len(self.tilts) < len(self.heights)

    @property
    def watched_alone(self) -> bool:
        """Whether contacts end by slip or by heights that are not functions of the contact state."""
        return bool(self.cone) or (bool(self.heights) and not self.rocks)

    def refuse_fallen(self, x: np.ndarray) -> None:
        """Raise `InputError` for a flight state (n,) in which one of the heights lies below the ground."""
        for name, each in {**self.heights, **self.in_contact}.items():
            if (height := float(each.series(x[None, :, None])[0, 0])) < 0:
                text = "its {name} is at the height {height:.6g} at the start, below the ground"
                raise InputError(Message(text, name=name, height=Quantity(height, LENGTH)))

    def fallen(self, x: np.ndarray, contact: bool = False) -> str:
        """The name of the height that vanishes in a flight state (n,), in flight or in contact."""
        heights = {**self.in_contact} if contact else {**self.heights}
        if self.model.grazes and not contact:
            heights["swinging foot"] = self.model.height_of(self.p)
        return min(heights, key=lambda name: abs(float(heights[name].series(x[None, :, None])[0, 0])))

    @cached_property
    def weight(self) -> float:
        """That of a machine that sticks."""
        assert self.model.planar is not None
        assert self.model.planar.weight is not None
        return float(self.model.planar.weight(self.p))

    def slips_at_landing(self, impulses: Iterable[np.ndarray], lasted: float) -> bool:
        """Whether one of the impulses (2,) across and along the ground of a plastic landing leaves the cone of
        friction, beyond roundings of the momentum that gravity gives in a flight that has `lasted` so long."""
        return any(self._exceeds(along, across, self.weight * lasted) for across, along in impulses)

    def slips_at_once(self, y: np.ndarray) -> bool:
        """Whether the forces of the ground on a foot in a contact state (k,) lie outside the cone of friction."""
        if self.friction is None:
            return False
        forces = dict(zip(self.contact.phase.watch, self.contact.field(y[None], self._data)[1][0], strict=True))
        return any(self._exceeds(forces[along], forces[across], self.weight) for across, along in self.forces_on_feet)

    @cached_property
    def _data(self) -> np.ndarray:
        return np.array([self.p[name] for name in self.contact.parameters], dtype=float)

    def _exceeds(self, along: Any, across: Any, size: float) -> bool:
        assert self.friction is not None
        return bool(abs(along) > self.friction * across + SLIPPING * size)


class SlipTest:
    """The places of a contact's motion, which comes block after block, at which its foot begins to slip.

    grazes : for each foot whether both of its forces vanish at the start, as after a lossless landing
    """

    def __init__(self, footing: Footing, grazes: Sequence[bool]):
        self.tolerance = SLIPPING * footing.weight if footing.cone else 0.0
        self.margins = [(margin, force, Crossings(int(grazes[i]))) for margin, force, i in footing.cone]

    def __call__(self, coefficients: np.ndarray, steps: np.ndarray) -> list[tuple[int, float]]:
        """The places, each a step and the time in it."""
        return [
            (i, t)
            for margin, force, zeros in self.margins
            for i, t in zeros(margin.series(coefficients), steps)
            if evaluate(force.series(coefficients[i : i + 1]), np.array([t]))[0] > self.tolerance
        ]


class FallTest:
    """A `stop` of a flow, flight or contact, where a height other than the closed gap reaches the ground."""

    def __init__(self, footing: Footing, contact: bool = False):
        model = footing.model
        self.embed = model.embed if contact else np.eye(len(model.embed))
        heights = footing.in_contact if contact else footing.heights
        self.heights = [(each, Crossings()) for each in heights.values()]

    def __call__(self, coefficients: np.ndarray, steps: np.ndarray) -> tuple[int, float] | None:
        """The first such place, a step and the time in it; None while there is none."""
        if not self.heights:
            return None
        states = self.embed @ coefficients[:, : self.embed.shape[1]]
        return min((place for each, zeros in self.heights for place in zeros(each.series(states), steps)), default=None)


def _turned_height(height: StateFormula, turned: np.ndarray, tilt: float) -> float:
    return float(height(tilt * turned))
