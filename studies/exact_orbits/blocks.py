"""Rigid bodies in the plane that stand on their corners, in MJCF: blocks that rock and wheels without a rim."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from studies.exact_orbits.reader import Case

LIGHT = 1e-9  # the mass of a body that the others do not feel
POINT, SLIGHT = 1e-6, 1e-7  # the radius of a sphere at a corner, and the inertia of a mass at a point
WHEEL = ("theta", "theta_rate", "phi", "phi_rate")


def inertial(mass: float, inertia: float) -> str:
    """The mass and the inertia of a body in MJCF."""
    return f'<inertial pos="0 0 0" mass="{mass!r}" diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'


@dataclass(frozen=True)
class Block:
    """A rigid body in the plane that stands on its corners, perhaps with a rotor on a torsion spring inside.

    corners : across and up of the centre of mass; the first one is at 0 at the start
    mass, inertia : the latter about the centre
    gravity : across and up
    names : of the states of the turn and of the rotor, with their rates
    rotor : the inertia of the rotor, 0 for none; its spring has the stiffness 1
    raised : the angles of the states where the body has not turned
    flips, shifts : the signs of the states at the samples, and what their angles are less than those of the bodies
    """

    corners: tuple[tuple[float, float], ...]
    mass: float
    inertia: float
    gravity: tuple[float, float]
    names: tuple[str, ...]
    rotor: float = 0.0
    raised: float = 0.0
    flips: tuple[float, ...] = ()
    shifts: tuple[float, ...] = ()
    springs: tuple = ()
    restitution: float = 0.0

    @property
    def joints(self) -> list[str]:
        """The names of the joints."""
        return ["across", "up", "turn"] + ["rotor"] * (self.rotor > 0)

    @property
    def weight(self) -> float:
        """The weight of the block."""
        return self.mass * math.hypot(*self.gravity)

    def start(self, state: Mapping[str, float]) -> dict[str, tuple[float, float]]:
        """The places and speeds of the joints from the state of a case."""
        turn, rate = state.get(self.names[0], 0.0) - self.raised, state.get(self.names[1], 0.0)
        (x, z), c, s = self.corners[0], math.cos(turn), math.sin(turn)
        across, up = -(c * x + s * z), s * x - c * z
        found = {"across": (across, up * rate), "up": (up, -across * rate), "turn": (turn, rate)}
        if self.rotor:
            found["rotor"] = state[self.names[2]] - turn, state[self.names[3]] - rate
        return found

    def state(self, places: Mapping[str, float], speeds: Mapping[str, float], sample: int) -> dict[str, float]:
        """The states of the case at a sample from places and speeds of the joints."""
        sign = self.flips[sample] if self.flips else 1.0
        shift = self.raised - (self.shifts[sample] if self.shifts else 0.0)
        values = [places["turn"] + shift, speeds["turn"]]
        if self.rotor:
            values += [places["turn"] + places["rotor"] + shift, speeds["turn"] + speeds["rotor"]]
        return dict(zip(self.names, [sign * x for x in values], strict=True))

    def model(self, option: str = "", contact: str = "") -> str:
        """The machine in MJCF, with attributes of its options and of its contacts."""
        contact = f'condim="3" friction="5 0 0" {contact}'
        corners = "".join(
            f'<geom type="sphere" size="{POINT!r}" pos="{x!r} 0 {z!r}" conaffinity="0" {contact}/>'
            for x, z in self.corners
        )
        across, up = self.gravity
        rotor = f"""<body name="rotor"><joint name="rotor" type="hinge" axis="0 1 0" stiffness="1"/>
{inertial(LIGHT, self.rotor)}</body>"""
        return f"""<mujoco model="case"><compiler angle="radian" inertiafromgeom="false" autolimits="true"/>
<option gravity="{across!r} 0 {up!r}" cone="elliptic" impratio="10" {option}/>
<worldbody><geom name="ground" type="plane" pos="0 0 {-POINT!r}" size="100 100 1" {contact}/>
<body name="slider"><joint name="across" type="slide" axis="1 0 0"/>{inertial(LIGHT, LIGHT)}
<body name="lift"><joint name="up" type="slide" axis="0 0 1"/>{inertial(LIGHT, LIGHT)}
<body name="block"><joint name="turn" type="hinge" axis="0 1 0"/>{inertial(self.mass, self.inertia)}{corners}
{rotor if self.rotor else ""}</body></body></body></worldbody>
</mujoco>"""


def housner(case: Case, p: Mapping[str, float]) -> Block:
    """A solid block."""
    a, b = p["half_width"], p["half_height"]
    return Block(((a, -b), (-a, -b)), 1.0, (a**2 + b**2) / 3, (0.0, -p["gravity"]), ("tilt", "tilt_rate"))


def _before(case: Case, event: str) -> list[int]:
    """How many events of a name are before each sample."""
    times = [each["time"] for each in case["events"] if each["event"] == event]
    return [sum(t <= each["time"] for t in times) for each in case["samples"]]


def rocker(case: Case, p: Mapping[str, float]) -> Block:
    """A block of height 2 whose mass is a tenth of its inertia about an edge, with a rotor of the inertia 1."""
    width, whole = math.tan(p["angle"]), 1 / p["inertia_ratio"]
    mass, flips = 0.1 * whole, tuple((-1.0) ** count for count in _before(case, "landing"))
    inertia, corners = whole - mass * (1 + width**2), ((width, -1.0), (-width, -1.0))
    return Block(corners, mass, inertia, (0.0, -p["gravity_ratio"] / mass), WHEEL, 1.0, flips=flips)


def wheel(case: Case, p: Mapping[str, float]) -> Block:
    """A wheel with a rotor of the inertia 1, and its four next feet."""
    whole, a = 1 / p["inertia_ratio"], p["angle"]
    mass, shifts = 0.1 * whole, tuple(2 * a * count for count in _before(case, "landing"))
    feet = tuple((-math.sin(each), -math.cos(each)) for each in (-a, a, -3 * a, -5 * a))
    return Block(feet, mass, whole - mass, (0.0, -p["gravity_ratio"] / mass), WHEEL, 1.0, shifts=shifts)


def wheel_of_hub(case: Case, p: Mapping[str, float]) -> Block:
    """A wheel with all of its mass at the hub, on a slope, along which the first joint is."""
    between, count = 2 * p["half_angle"], round(p["spokes"])
    steps = [a - b for a, b in zip(_before(case, "step forward"), _before(case, "step back"), strict=True)]
    feet = tuple((math.sin(between * k), -math.cos(between * k)) for k in range(count))
    gravity, shifts = (math.sin(p["slope"]), -math.cos(p["slope"])), tuple(between * each for each in steps)
    return Block(feet, 1.0, SLIGHT, gravity, ("theta", "theta_rate"), raised=p["slope"], shifts=shifts)
