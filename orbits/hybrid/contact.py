"""How a sustained contact ends: by lift-off where the contact force vanishes, or never."""

import numpy as np

from ..flow.flow import Flow
from ..model.phase import Affine
from ..numerics.bernstein import Crossings
from ..periodic.formulations import contact_force_row

# After this many zeros of the contact's speed the contact never ends, see `ContactEnd`.
TURNS = 3
# A contact whose rates are all below this is at rest. An overdamped contact gets there without turning.
STILL_RATE = 1e-12


class ContactEnd:
    """A `stop` of the contact's flow: at lift-off, or as soon as it is known that lift-off never comes.

    speed : the coordinate of the contact that is its speed; None where rest is not looked for
    outcome : "lifts_off", "rests", or None while the contact lasts

    Trajectories of one coordinate do not cross in the phase plane. Once the speed has changed its sign three times, the
    contact has passed each extension upward and downward, and what follows stays, with damping or without, inside
    what it has passed. A contact that has not ended by then never does.
    """

    def __init__(self, contact: Flow, speed: Affine | None):
        self.size, self.force, self.speed = contact.size, contact_force_row(contact.phase), speed
        self.force_zeros, self.speed_zeros = Crossings(), Crossings()
        self.turns_left = TURNS
        self.outcome: str | None = None

    def __call__(self, coefficients: np.ndarray, steps: np.ndarray) -> tuple[int, float] | None:
        """The step at which the contact ends, and the time in that step; None while it lasts."""
        liftoff = self.force_zeros(self.force.series(coefficients), steps)[:1]
        rest = self._rest(self.speed, coefficients, steps) if self.speed else []
        first = min([*liftoff, *rest], default=None)
        self.outcome = None if first is None else "lifts_off" if liftoff and first == liftoff[0] else "rests"
        return first

    def _rest(self, speed: Affine, coefficients, steps) -> list[tuple[int, float]]:
        """Places from which the force never ends the contact: the last turn, and steps at whose start it is still."""
        turns = self.speed_zeros(speed.series(coefficients), steps)
        last, self.turns_left = turns[self.turns_left - 1 : self.turns_left], self.turns_left - len(turns)
        still = np.flatnonzero(np.abs(coefficients[:, : self.size, 1]).max(1) < STILL_RATE)[:1]
        return [*last, *((int(i), float(steps[i])) for i in still)]
