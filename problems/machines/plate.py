"""A hopper that lands on a sprung plate: a body and a foot joined by a spring, and the plate on a spring to the
ground.

Units: whatever the masses, the springs' forces and their extensions are stated in, with gravity 1. Places y1, y2, y3
of body, foot and plate are counted from where both springs are unloaded and the foot is on the plate; with the force
phi of the leg and psi of the plate's spring, in flight

    m1 y1'' = -phi(y1 - y2) - m1        m2 y2'' = phi(y1 - y2) - m2        m3 y3'' = -psi(y3) - m3,

and in contact foot and plate move as one, until the plate falls as fast as the foot: phi/m2 = -psi/m3. "alpha" is the
speed of the body at lift-off.

On a heavy or a stiff plate it is the plain hopper. For linear springs with stiffnesses k and K, half times of flight T
and of contact S, alpha_0 the plain hopper's launch speed and x0 = tan x0 that of `Hopper()`,

    heavy:  alpha/alpha_0 = 1 + m2/m3 + O(1/m3^2), with a flight time that is off by O(1/m3^2) only
    stiff:  alpha/alpha_0 = 1 + k alpha_0 / (x0^2 m3 W (tan W T + sqrt(1 + m2/m3) tan V S)) + O(1/W^2)

with W = sqrt(K/m3) and V = sqrt(K/(m2 + m3)), the plate's frequencies in flight and in contact. A heavy plate is
pressed up by the hopper's weight all the time, so that in flight it accelerates by (m1 + m2)/m3, as if gravity were so
much larger. A stiff one is left vibrating at lift-off: before, its place follows the leg's pull, and afterwards it
does not. Its phases W T and V S turn fast as the stiffness grows, so that there are ever more hops near the plain one;
those near a zero of the denominator shake the plate hard.
"""

from collections.abc import Mapping, Sequence

from orbits import Mechanism
from orbits.laws import LawLike
from orbits.mechanics import Ground, Mass, Spring

from ..laws import as_spring
from .chain import mass_parameters
from .parameters import checked_numbers, with_parameters


def plate_hopper(
    masses: Sequence[float] = (1.0, 1.0, 1.0),
    spring: LawLike = "r",
    plate_spring: LawLike = "plate_stiffness*r",
    parameters: Mapping[str, float] | None = None,
    restitution: float = 0.0,
) -> Mechanism:
    """A hopper on a sprung plate.

    masses : of body, foot and plate, called m1, m2, m3
    spring, plate_spring : as in `TwoMassMachine`, with parameters in common
    parameters : values of the formulas' names, by default a plate_stiffness of 100
    restitution : of the impacts of the foot, 0 <= e <= 1

    >>> from orbits import find_all, starts
    >>> from problems import plate_hopper
    >>> plate = plate_hopper()
    >>> len(find_all(plate, starts(plate, 3, 3))) > 50
    True
    """
    values = checked_numbers({"plate_stiffness": 100.0} if parameters is None else parameters)
    names, own = ("body", "foot"), mass_parameters(masses, 3, 3)
    return Mechanism(
        name="hopper on a plate",
        coordinates=names,
        elements=[
            *(Mass(name, mass) for name, mass in zip(names, own, strict=False)),
            Spring("body - foot", as_spring(spring, values, shared=True)),
        ],
        gap="foot",
        ground=Ground("m3", as_spring(plate_spring, values, shared=True), "plate"),
        parameters=with_parameters(own, values, "a mass"),
        restitution=restitution,
        words={
            "liftoff": "the plate falls as fast as the foot",
            "gap": "foot below the plate",
            "pull": "the plate would have to pull the foot",
            "end": "contact: the foot never leaves the plate again",
        },
    )
