"""The machines of the cases as bodies with contacts, in MJCF, for simulators that compute with these.

A body moves up and down at one joint; springs act between two of them, or between one and the ground. A contact is that
of a sphere with the ground, or with a box on another body.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import casadi as ca

from orbits.show.cubic_springs import Cubic, cubic_sum
from problems import springs
from studies.exact_orbits.automaton import OPERATIONS, Automaton
from studies.exact_orbits.blocks import Block, housner, inertial, rocker, wheel, wheel_of_hub
from studies.exact_orbits.reader import Case

EXPRESSIONS = {
    **OPERATIONS,
    **{name: getattr(ca, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt")},
    **{"max": ca.fmax, "min": ca.fmin, "abs": ca.fabs},
}
APART = 200.0  # what a spring in Drake is longer than its extension
HEAVY = 1e8  # the mass of a body that does not feel the others


@dataclass(frozen=True)
class Spring:
    """A spring between two bodies, or, without `below`, between one and the ground.

    cubics : its force, tension positive, of the difference of their places
    inertance, damping : the force over the second and the first derivative of the difference
    """

    above: str
    below: str | None
    cubics: list[Cubic]
    inertance: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True)
class Bodies:
    """A machine of bodies on one vertical line.

    masses : by the name of the body, which is that of its place in the case
    contacts : pairs (above, below) of bodies that touch where their places are equal; below None is the ground at 0
    states : the names of place and speed in the case, by body
    drag : the force against the speed of a body, over the speed
    missing : the place of a body that has no state of its own while in contact: that of another body, or a number
    moving : the places and speeds at the start of heavy bodies that no state names
    """

    masses: Mapping[str, float]
    springs: list[Spring]
    contacts: list[tuple[str, str | None]]
    states: Mapping[str, tuple[str, str]]
    gravity: float = 1.0
    missing: Mapping[str, str | float] = field(default_factory=dict)
    restitution: float = 0.0
    drag: Mapping[str, float] = field(default_factory=dict)
    moving: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def joints(self) -> list[str]:
        """The names of the joints."""
        return list(self.masses)

    @property
    def weight(self) -> float:
        """The weight of all bodies that fall, or, without gravity, their mass."""
        falling = [mass for name, mass in self.masses.items() if mass < HEAVY]
        return sum(falling) * (self.gravity or 1.0)

    def start(self, state: Mapping[str, float]) -> dict[str, tuple[float, float]]:
        """The places and speeds of the bodies from the state of a case."""
        found = dict(self.moving)
        for name, (place, speed) in self.states.items():
            if place in state:
                found[name] = state[place], state[speed]
        for name in self.states.keys() - found.keys():
            rest = self.missing[name]
            found[name] = found[rest] if isinstance(rest, str) else (rest, 0.0)
        return found

    def state(self, places: Mapping[str, float], speeds: Mapping[str, float], sample: int) -> dict[str, float]:
        """The states of the case at a sample, of all modes, from places and speeds of the joints."""
        pairs = self.states.items()
        return {a: places[name] for name, (a, _) in pairs} | {b: speeds[name] for name, (_, b) in pairs}

    def model(self, option: str = "", contact: str = "") -> str:
        """The machine in MJCF, with attributes of its options and of its contacts."""
        above, below = {a for a, _ in self.contacts}, {b for _, b in self.contacts if b}
        body = "\n".join(self._body(name, name in above, name in below, contact) for name in self.masses)
        tendons = "\n".join(self._tendon(each, i) for each in self.springs for i in range(len(each.cubics)))
        plane = f'<geom name="ground" type="plane" size="100 100 1" condim="1" {contact}/>'
        plane = plane if any(b is None for _, b in self.contacts) else ""
        pairs = "\n".join(f'<exclude body1="{a}" body2="{b}"/>' for a, b in self._apart())
        return f"""<mujoco model="case"><compiler angle="radian" inertiafromgeom="false" autolimits="true"/>
<option gravity="0 0 {-self.gravity!r}" {option}/>
<worldbody>{plane}
{body}
</worldbody>
<contact>{pairs}</contact>
<tendon>{tendons}</tendon>
</mujoco>"""

    def _apart(self) -> list[tuple[str, str]]:
        names, touch = list(self.masses), set(self.contacts)
        return [
            (a, b) for i, a in enumerate(names) for b in names[i + 1 :] if (a, b) not in touch and (b, a) not in touch
        ]

    def _body(self, name: str, ball: bool, table: bool, contact: str) -> str:
        contact, geoms, mass = f'condim="1" {contact}', "", self.masses[name]
        if ball:
            own = 'type="sphere" size="0.5" pos="0 0 0.5" conaffinity="0"'
            geoms += f'<geom name="{name}_ball" {own} {contact}/>'
        if table:
            geoms += f'<geom name="{name}_table" type="box" size="10 10 10" pos="0 0 -10" contype="0" {contact}/>'
        joint = f'<joint name="{name}" type="slide" axis="0 0 1" damping="{self.drag.get(name, 0.0)!r}"/>'
        return f'<body name="{name}">{joint}{inertial(mass, mass)}{geoms}</body>'

    @staticmethod
    def _tendon(spring: Spring, number: int) -> str:
        place, (a, b, c), side = spring.cubics[number]
        signs = [(spring.above, 1.0)] + ([(spring.below, -1.0)] if spring.below else [])
        if place < 0:  # a length below 0 would stand for that at the start
            signs, place, b, side = [(name, -sign) for name, sign in signs], -place, -b, -side
        rest = {0: f"{place!r}", 1: f"-1e10 {place!r}", -1: f"{place!r} 1e10"}[side]
        others = "" if number else f'armature="{spring.inertance!r}" damping="{spring.damping!r}"'
        joints = "".join(f'<joint joint="{name}" coef="{sign}"/>' for name, sign in signs)
        return f'<fixed stiffness="{a!r} {b!r} {c!r}" springlength="{rest}" {others}>{joints}</fixed>'


def linear(above: str, below: str | None, stiffness: float, inertance: float = 0.0) -> Spring:
    """A linear spring that is unloaded where the places are equal."""
    return Spring(above, below, [Cubic(0.0, (float(stiffness), 0.0, 0.0))], inertance)


def law(case: Case, text: str, variable: str, factor: float = 1.0) -> list[Cubic]:
    """A formula of one state as cubics, over the range that this state has in the motion; the others are 0 in it.

    variable : a state, or "r" for the difference of y1 and y2
    """
    formula, others = Automaton(case, EXPRESSIONS).function(text), {"y1": 0.0, "y2": 0.0, "v1": 0.0, "v2": 0.0}
    name = "y1" if variable == "r" else variable
    own = springs.function(lambda r: factor * formula({**others, name: r}))
    states = [each["state"] for each in case["samples"]] + [each["before"] for each in case["events"]]
    places = [x["y1"] - x["y2"] if variable == "r" else x[variable] for x in states]
    return cubic_sum(own, min(places), max(places)).cubics


def hop(case: Case, p: Mapping[str, float]) -> Bodies:
    """A body and a foot with any spring, gravity, damper and drag; without units, in those of the foot's weight."""
    ratio, formulas = p.get("M", 0.0), case["formulas"]
    if case["units"] == "SI":
        masses, gravity, share = {"body": p["m1"], "foot": p["m2"]}, p["g"], 1.0
        weights = masses
    else:
        masses, gravity, share = {"body": 1 + ratio, "foot": ratio * (1 + ratio)}, 1 / (1 + ratio), ratio
        weights = {"body": 1.0, "foot": ratio}
    own = [Spring("body", "foot", law(case, "force", "r", share), damping=share * p.get("damping", 0.0))]
    if "gravity1" in formulas:  # all weight is a force of the height
        heights = {"body": ("gravity1", "y1"), "foot": ("gravity2", "y2")}
        own += [Spring(name, None, law(case, *heights[name], weights[name])) for name in masses]
        gravity = 0.0
    states, drag = {"body": ("y1", "v1"), "foot": ("y2", "v2")}, share * p.get("drag", 0.0)
    return Bodies(
        masses, own, [("foot", None)], states, gravity, restitution=p.get("e", 0.0), drag=dict.fromkeys(masses, drag)
    )


def ball(case: Case, p: Mapping[str, float]) -> Bodies:
    """A ball on the ground."""
    drag = {"ball": p.get("c", 0.0)}
    return Bodies({"ball": 1.0}, [], [("ball", None)], {"ball": ("y", "v")}, p["g"], restitution=p["e"], drag=drag)


def _named(*names: str) -> dict[str, tuple[str, str]]:
    return {name: (name, f"{name}_speed") for name in names}


def juggler(case: Case, p: Mapping[str, float]) -> Bodies:
    """A hand on a spring to the ground, and a ball."""
    own = Spring("hand", None, [Cubic(0.0, (1.0, 0.0, float(p.get("hardening", 0.0))))])
    masses = {"hand": 1.0, "ball": 1 / p.get("mass_ratio", p.get("M"))}
    states = {"hand": ("y2", "v2"), "ball": ("y1", "v1")} if "M" in p else _named("hand", "ball")
    return Bodies(masses, [own], [("ball", "hand")], states, missing={"ball": "hand"})


def heavy_hand(case: Case, p: Mapping[str, float]) -> Bodies:
    """A ball on a hand that is heavier by so much that it does not feel it."""
    own = linear("hand", None, HEAVY)
    masses = {"hand": HEAVY, "ball": 1.0}
    return Bodies(masses, [own], [("ball", "hand")], _named("hand", "ball"), missing={"ball": "hand"})


def chain_three(case: Case, p: Mapping[str, float]) -> Bodies:
    """Three masses with two springs."""
    own = [linear("top", "middle", p["k1"]), linear("middle", "foot", p["k2"])]
    masses = {"top": p["m1"], "middle": p["m2"], "foot": p["m3"]}
    return Bodies(masses, own, [("foot", None)], _named(*masses), missing={"foot": 0.0})


def chain_hand(case: Case, p: Mapping[str, float]) -> Bodies:
    """A ball on a hand, on a spring on a mass on a spring."""
    own = [linear("hand", "base", p["k2"]), linear("base", None, p["k3"])]
    masses = {"ball": p["m1"], "hand": p["m2"], "base": p["m3"]}
    return Bodies(masses, own, [("ball", "hand")], _named(*masses), missing={"ball": "hand"})


def plate(case: Case, p: Mapping[str, float]) -> Bodies:
    """A body, a foot and a plate on a spring."""
    own = [linear("body", "foot", p["stiffness"]), linear("plate", None, p["plate_stiffness"])]
    masses = {"body": p["m1"], "foot": p["m2"], "plate": p["m3"]}
    return Bodies(masses, own, [("foot", "plate")], _named(*masses), missing={"foot": "plate"})


def inerter(case: Case, p: Mapping[str, float]) -> Bodies:
    """A body and a foot with a spring and an inerter."""
    own = [linear("body", "foot", p["stiffness"], p["inertance"])]
    masses = {"body": p["body_mass"], "foot": p["foot_mass"]}
    return Bodies(masses, own, [("foot", None)], _named(*masses), p["gravity"], missing={"foot": 0.0})


def alternating(case: Case, p: Mapping[str, float]) -> Bodies:
    """A body with two feet."""
    own = [linear("body", "left", 1.0), linear("body", "right", 1.0)]
    masses = {"body": 1.0, "left": p["foot_mass"], "right": p["foot_mass"]}
    missing = {"left": 0.0, "right": 0.0}
    return Bodies(masses, own, [("left", None), ("right", None)], _named(*masses), missing=missing)


def table(case: Case, p: Mapping[str, float]) -> Bodies:
    """A ball on a table that vibrates, which is heavy and on a spring."""
    t = float(case["start"]["time"])
    moving = {"table": (float(case.at("table", t)), float(case.at("table_speed", t)))}
    return Bodies(
        {"ball": 1.0, "table": HEAVY}, [Spring("table", None, [Cubic(1.0, (HEAVY, 0.0, 0.0))])],  # carries its weight
        [("ball", "table")], _named("ball"), restitution=p.get("restitution", 0.0), moving=moving,
    )  # fmt: skip


def box(case: Case, p: Mapping[str, float]) -> Bodies:
    """A body between two walls that vibrate together."""
    t, moving, own = float(case["start"]["time"]), {}, []
    for name, side in (("upper", 1), ("lower", -1)):
        moving[name] = float(case.at("box", t)) + side * p["half_gap"], float(case.at("box_speed", t))
        own.append(Spring(name, None, [Cubic(side * p["half_gap"], (HEAVY, 0.0, 0.0))]))
    masses, contacts = {"body": 1.0, "upper": HEAVY, "lower": HEAVY}, [("upper", "body"), ("body", "lower")]
    states = {"body": ("place", "velocity")}
    return Bodies(masses, own, contacts, states, 0.0, restitution=p["restitution"], moving=moving)


def oscillator(case: Case, p: Mapping[str, float]) -> Bodies:
    """A body on a spring to a heavy one that vibrates, against a stop."""
    rate, phase = p["frequency"], p["frequency"] * float(case["start"]["time"])
    moving = {"base": (p["force"] * math.cos(phase), -rate * p["force"] * math.sin(phase)), "stop": (p["stop"], 0.0)}
    own = [linear("body", "base", 1.0), linear("base", None, HEAVY * rate**2)]
    masses, states = {"body": 1.0, "base": HEAVY, "stop": HEAVY}, {"body": ("place", "speed")}
    return Bodies(
        masses, own, [("stop", "body")], states, 0.0, restitution=p["restitution"], moving=moving,
        drag={"body": 2 * p["damping_ratio"]},
    )  # fmt: skip


MACHINES: dict[str, Callable[[Case, Mapping[str, float]], Bodies | Block]] = {
    "bouncing_ball": ball, "dragged_ball": ball, "linear_juggler": juggler, "juggler": juggler,
    "juggler_cubic": juggler, "heavy_hand": heavy_hand, "heavy_hand_bounces": heavy_hand, "chain_three": chain_three,
    "chain_hand": chain_hand, "plate": plate, "inerter": inerter, "alternating_hopper": alternating, "housner": housner,
    "rocker": rocker, "wheel": wheel, "wheel_down_slope": wheel_of_hub, "wheel_rocks": wheel_of_hub,
    "wheel_slows_down": wheel_of_hub, "body_in_a_box": box, "impact_oscillator": oscillator, "impact_graze": oscillator,
    **dict.fromkeys(("table_period_one", "table_period_two", "table_chaos", "table_sticks"), table),
}  # fmt: skip
CANNOT = {
    **dict.fromkeys(("kept_up_hop", "alternating_hops"), "no impulse at lift-off"),
    **dict.fromkeys(("rocker_small", "housner_slender", "wheel_small"), "no bodies: small angles"),
    "ball_on_a_slope": "no impact that slows sliding",
    "knee": "no massless links",
    "brachiator": "no hands that hold on",
}


def bodies_of(case: Case) -> Bodies | Block:
    """The bodies of a case; raises `NotImplementedError` with the reason for a case without."""
    name, p = case["name"], {each: float(case.at(text)) for each, text in case["parameters"].items()}
    if name in CANNOT:
        raise NotImplementedError(CANNOT[name])
    if name in MACHINES:
        return MACHINES[name](case, p)
    if {"y1", "y2"} <= {*next(iter(case["modes"].values()))["states"]} and "force" in case["formulas"]:
        return hop(case, p)
    raise NotImplementedError("not in this script")
