"""What the page says in plain words: whether the machine has such a motion, and what each figure shows."""

from collections.abc import Mapping

from orbits.tables import number_text

from .dials import UNITS_OF_RUNNERS
from .results import HopResult
from .scene import Scene

# What a machine does forever without losing energy, by its kind, and why nothing is lost; those that were made in
# Python are known by what moves: others that turn step, and the rest hop.
DOES = {
    "juggler": ("the ball is thrown and caught", "ball and hand meet at the same speed, without a blow"),
    "wheel": ("it walks over level ground", "each foot is at rest as it touches the ground"),
    "rocker": ("it rocks from edge to edge", "each edge is at rest as it touches the ground"),
    "shuttle": ("it goes from wall to wall", "it is at rest as it touches each"),
    "alternating-hopper": (
        "it hops on one foot and the other by turns",
        "each foot is at rest as it touches the ground",
    ),
    "runner": ("it runs over level ground", "its foot is at rest as it touches the ground, and sticks"),
}
IT_STEPS = ("it steps on", "what lands is at rest as it touches")
IT_HOPS = ("it hops", "its foot is at rest as it touches the ground")
# The two words in the title of the figures that need one, and what the launch speed is, by the kind of machine.
LAUNCH_SPEEDS = dict.fromkeys(
    ("hopper", "inerter_hopper", "runner", "alternating-hopper"), "of the body as its foot lifts off"
)
LAUNCH_SPEEDS |= {"juggler": "at which the ball leaves the hand", "knee_hopper": "of its knee as its foot lifts off"}
ON_TITLE = "alpha is the launch speed, {}. In family {} the spring turns back {} on the way to the middle of the {}."
NONE_YET, NOT_FOUND = "The first motion is being found.", "No motion is found for these numbers."
NO_MOTION = "The figures show a solution of the equations that no machine can follow."
DIMMED = "The figures, which are dimmed, still show the motion before."
# The outer of two bodies that turn, and what becomes of the motion with each step, by the kind of machine.
TWO_BODIES = {"wheel": ("wheel", ", turned on by an angle"), "rocker": ("block", ", mirrored")}
TWO_BODIES |= {"shuttle": ("pendulum", ", mirrored")}
BESIDE_IT = "The view moves along with the machine. Dots on the ground mark where feet stand, the line the path so far."
SMALL_ANGLES = (
    "For small angles there is no picture in the plane. The unit of an angle is half the angle between two spokes or "
    "walls; for a block it is its width over its height."
)
# Of figures that show the same of every machine.
ON_LAW = "{} over {}; the shaded range is what this motion uses."
ON_MAP = (
    "The launch speed after a landing{}: where the curve meets the dashes, the motion repeats. Click to launch there, "
    "and see what follows."
)
ON_FAMILY = (
    "Each point is the motion of a machine with another {}, at its launch speed alpha. The ring marks the one shown; "
    "dashed parts are not motions. Click on the curve to go there, or move the slider."
)
CHOOSE_PARAMETER = "Choose a parameter to see neighbouring machines."
ON_FORCES = (
    "The forces while both points touch. On the one that landed the force begins at 0, as nothing is lost; on the "
    "other it falls to 0, and that point opens. Neither may fall below 0, as a contact cannot pull."
)
AS_TORQUE = " The page shows torques, since the gap that closes is an angle."
ON_FORCE = "The force may never fall below 0, as a contact cannot pull. Where nothing is lost, it begins and ends at 0."


def verdict(scene: Scene, hop: HopResult | None, failed: Mapping[str, str]) -> tuple[str, str]:
    """Whether there is a motion, "yes", "no" or "" where that is not known yet, and the same as a sentence.

    scene, hop : that are shown; None before there is a hop
    failed : why the hop that was requested last is not shown, by the place on the page
    """
    if failed:
        return "no", f"{NOT_FOUND} {DIMMED}" if hop else NOT_FOUND
    if hop is None:
        return "", NONE_YET
    if hop.violations:
        return "no", f"No motion: {'; '.join(hop.violations)}. {NO_MOTION}"
    kind = "juggler" if "ball" in hop.data.names else scene.machine
    does, why = DOES.get(kind, IT_STEPS if hop.data.turns else IT_HOPS)
    units = UNITS_OF_RUNNERS if scene.si else {}
    values = {name: number_text(scene.numbers[name], units.get(name, ""), 6) for name in scene.tuned}
    tuned = " and ".join(f"{name.replace('_', ' ')} = {value}" for name, value in values.items())
    needs = f" It needs {tuned}, which are tuned to its speed." if tuned else ""
    return "yes", f"A motion without loss: {does} forever, because {why}.{needs}"


def captions(scene: Scene, hop: HopResult | None) -> dict[str, str]:
    """What the figures show, in one line each, by their names."""
    if hop is None:
        return {}
    data, along = hop.data, scene.along.replace("_", " ")
    stands = "the ball lies on the hand" if "ball" in data.names else "the foot stands"
    machine, portrait = "The motion, over and over: nothing drives it.", "a closed curve is a motion that repeats"
    if data.plane is None and data.turns:
        machine = SMALL_ANGLES
    elif data.plane is not None and data.plane.marks:
        machine = BESIDE_IT
    what, rate, cycle, launch = "Height of each part", "Speed over height", "cycle", ""
    middle, turned = "step" if data.turns else "flight", "once" if scene.family == 1 else f"{scene.family} times"
    speed = LAUNCH_SPEEDS.get("juggler" if "ball" in data.names else scene.machine, "at lift-off")
    if data.turns:
        outer, onward = TWO_BODIES.get(scene.machine, ("", ""))
        speed, portrait = "at which the body within turns as a step begins", f"with each step it begins again{onward}"
        what = f"theta, the angle of the {outer}, and phi, that of the body within," if outer else "Angle of each body"
        rate, cycle, stands = "Rate over angle", "step", "it touches" if data.landed is None else "both points touch"
        launch = " over the one before it, both less that of the lossless step"
    over, force = (label.partition(" ")[0] for label in (hop.law.labels if hop.law else ("extension", "force")))
    on_force = ON_FORCE if data.landed is None else ON_FORCES
    on_force += AS_TORQUE if data.labels["force"].endswith("(N m)") else ""
    return {
        "title": ON_TITLE.format(speed, scene.family, turned, middle),
        "machine": machine,
        "heights": f"{what} over one {cycle}; shaded while {stands}.",
        "portrait": f"{rate}: {portrait}.",
        "force": f"There is no contact force: {data.why}." if data.why else on_force,
        "law": ON_LAW.format(force.capitalize(), "the angle between the bodies" if data.turns else over),
        "family": ON_FAMILY.format(along) if along else CHOOSE_PARAMETER,
        "map": ON_MAP.format(launch),
    }
