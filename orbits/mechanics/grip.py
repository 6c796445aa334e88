"""A contact that holds both ways and opens by choice, as a hand does: the swings of a machine from hold to hold.

A machine with one grip hangs, and has no gap. At the next hold a second grip closes, and the coordinates that rest
while both hold have places that a few numbers of the release determine; the others move on. A release needs no
condition on the forces, since a grip bears all of them. A lossless swing leads from a release to its mirror image under
the reversor, where the second grip closes without an impact; with the grips' names exchanged it is the release again.
So half a swing leads from a release to a state that the reversor leaves as it is: n conditions for n coordinates, in
n - 1 numbers of the release and the time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from ..laws import Algebraic, Parameters
from ..symbolic import suggest
from .elements import Scalar, names_in, value_of

# The unknown of a swing besides the numbers of its release.
HALF_SWING = "half_swing"


@dataclass(frozen=True)
class Grip:
    """The second grip of a machine that swings from hold to hold, as `Mechanism(gap=None, grip=...)` states it.

    places : of the coordinates that rest while both grips hold: formulas of the numbers of the release and of the
        parameters, by coordinate
    release : the least and the largest value, as formulas of the parameters, within which the search looks for each
        number of the release: those in `places`, and of each other coordinate its rate, such as "body'", where the
        reversor turns the coordinate to its negative, or its place. The other one of the two is 0
    step : the distance of two holds, a formula of the numbers of the release
    clearance : the distance of the free grip from what it takes hold of, which must not vanish within a swing, a
        formula of the coordinates in `places`
    longest : the longest half of a swing that is searched

    A clearance that does not vanish at a release and at its mirror image is refused; nobody checks the step, and that
    the mirror image is the same release with the grips' names exchanged.
    """

    places: Mapping[str, Scalar]
    release: Mapping[str, tuple[Scalar, Scalar]]
    step: Scalar
    clearance: str
    longest: Scalar

    def __hash__(self) -> int:
        return hash((*self.places.items(), *self.release.items(), self.step, self.clearance, self.longest))

    @property
    def unknowns(self) -> tuple[str, ...]:
        """The names of the unknowns of half a swing."""
        return *self.release, HALF_SWING

    def start(self, coordinates: Sequence[str], u: Parameters, p: Parameters) -> list[Algebraic]:
        """The state (2n,) at a release."""
        places = {name: value_of(place, u, p) for name, place in self.places.items()}
        own = [(places.get(name, u.get(name, 0.0)), u.get(f"{name}'", 0.0)) for name in coordinates]
        return [part for pair in own for part in pair]


def _refuse_apart(grip: Grip, reversor: Mapping[str, Scalar], known: Sequence[str]) -> None:
    """Raise `InputError` for a clearance that does not vanish where both grips hold, at random numbers."""
    if not names_in(grip.clearance) & {*grip.places}:
        raise InputError(f"grip: clearance '{grip.clearance}' has none of the coordinates {', '.join(grip.places)}")
    rng = np.random.default_rng(0)
    for _ in range(3):
        p, u = (dict(zip(names, rng.uniform(0.3, 0.6, len(names)), strict=True)) for names in (known, [*grip.release]))
        places = {name: value_of(place, u, p) for name, place in grip.places.items()}
        image = {name: value_of(reversor.get(name, name), places, p) for name in places}
        each, sizes = [value_of(grip.clearance, at, p) for at in (places, image)], [*places.values(), *p.values()]
        if np.isfinite(each).all() and np.abs(each).max() > 1e-9 * np.abs(sizes).max():
            raise InputError(f"grip: clearance '{grip.clearance}' does not vanish at a release and at its mirror image")


def refuse_misheld(m: Any, known: set[str]) -> None:
    """Raise `InputError` for a grip that a `Mechanism` with parameters of these names cannot have."""
    grip: Grip = m.grip
    if not isinstance(grip, Grip):
        raise InputError(f"grip = {grip!r}; it must be a Grip, see `orbits.mechanics.Grip`")
    if m.gap is not None or m.reversor is None:
        raise InputError("a machine with a grip hangs by another one: it needs gap=None, and a reversor")
    if unknown := [name for name in grip.places if name not in m.coordinates]:
        raise InputError(f"grip: there is no coordinate '{unknown[0]}'{suggest(unknown[0], m.coordinates)}")
    ends = [end for pair in grip.release.values() for end in pair]
    allowed = [(each, {*grip.release}) for each in (*grip.places.values(), grip.step)]
    allowed += [(grip.clearance, {*grip.places}), *((each, set()) for each in (*ends, grip.longest))]
    for text, own in allowed:
        if callable(text) or (wrong := sorted(names_in(text) - own - known)):
            why = "is a Python function" if callable(text) else f"has '{wrong[0]}'"
            raise InputError(f"grip: '{text}' {why}; it must be a formula of {', '.join(sorted(own | known))}")
    used = {name for place in grip.places.values() for name in names_in(place)} - known
    for name in m.coordinates:
        found = [each for each in (name, f"{name}'") if each in grip.release]
        if len(found) != (name not in grip.places):
            each = f"a place in places, or in release either '{name}' or \"{name}'\""
            raise InputError(f"grip: coordinate '{name}' needs {each}")
        used |= {*found}
    if len(used) != len(m.coordinates) - 1 or used != grip.release.keys():
        raise InputError(
            f"grip: release has {', '.join(grip.release) or 'no numbers'}; {len(m.coordinates)} coordinates need "
            f"{len(m.coordinates) - 1} numbers that occur in places or are rates, one less than half a swing has "
            "conditions"
        )
    _refuse_apart(grip, m.reversor, sorted(known))
