"""Compliant ground: a machine lands on a mass on a spring.

The foot lands on it plastically, and both move as one until the ground falls as fast as the foot: what was the gap to
rigid ground is the gap to the ground's own coordinate. Its weight presses its spring as the machine's does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..laws import Key, LawLike
from .elements import Element, Mass, Scalar, Spring, names_in
from .refusals import listed


@dataclass(frozen=True)
class Ground:
    """The ground under a machine: a mass on a spring, which `Mechanism(ground=...)` adds as a coordinate.

    mass : of the moving ground, a formula of the parameters or a number
    spring : the law of its force, tension positive, by its height, which is 0 where it is unloaded; or its stiffness
    name : of its coordinate

    Rigid ground is the limit of a large mass, at any stiffness, where the difference of the launch speed falls like one
    over the mass. It is also the limit of a large stiffness K: along hops with the same phase in the ground's own
    vibration, the difference falls like 1/sqrt(K), see `problems.machines.plate`.
    """

    mass: Scalar
    spring: Any
    name: str = "ground"

    if TYPE_CHECKING:  # a machine stores the law

        def __init__(self, mass: Scalar, spring: LawLike | Key | float, name: str = "ground"): ...

    @property
    def force(self) -> Any:
        """The law of the spring."""
        stiffness = isinstance(self.spring, Real) and not isinstance(self.spring, bool)
        return f"{float(self.spring)!r}*r" if stiffness else self.spring

    @property
    def elements(self) -> list[Element]:
        """What the ground adds to the elements of a mechanism."""
        return [Mass(self.name, self.mass), Spring(self.name, self.force)]


def on_ground(
    ground: object, coordinates: Sequence[str], elements: Sequence[Element], gap: object, launch: str | None,
    heights: Any, inertia: Any,
) -> dict[str, Any]:  # fmt: skip
    """The statement of a mechanism with the ground's coordinate; raises `InputError` for anything but a `Ground`, and
    for a gap that is not the height of one coordinate above the ground."""
    if not isinstance(ground, Ground):
        raise InputError(f"ground = {ground!r}; it must be a Ground, for example ground=Ground(mass=2.0, spring=100.0)")
    if gap not in coordinates:
        above = f"the gap '{gap}' must be one coordinate, the height of a foot above the ground"
        raise InputError(f"ground={ground!r}: {above}; state a coordinate of the ground, with its Mass and its Spring")
    if ground.name in coordinates:
        raise InputError(f"'{ground.name}' is a coordinate; give the ground another name=")
    if unknown := sorted(names_in(ground.mass) & {*coordinates}):
        raise InputError(f"the mass of the ground, '{ground.mass}', depends on the coordinate '{unknown[0]}'")
    left = [name for name in coordinates if name != gap]
    # The centre of mass of the machine alone is not that of all that moves.
    own = {name: height for name, height in (heights or {}).items() if name != "centre of mass"}
    if inertia and not isinstance(inertia, Mapping):
        rows = [listed("inertia", row) for row in listed("inertia", inertia)]
        inertia = [*((*row, 0.0) for row in rows), (0.0,) * (len(coordinates) + 1)]
    return {
        "coordinates": (*coordinates, ground.name),
        "elements": (*elements, *ground.elements),
        "gap": f"{gap} - {ground.name}",
        "launch": launch or (left[-1] if left else None),
        "heights": {**own, ground.name: ground.name} if own else heights,
        "inertia": inertia,
        "ground": None,
    }
