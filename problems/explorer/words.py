"""What the page says in plain words: whether the machine has such a motion, and what each figure shows."""

from collections.abc import Mapping

from .results import HopResult
from .scene import Scene

# What a machine does for ever by its kind; other machines hop.
DOES = {
    "juggler": "the ball is thrown and caught for ever, and no energy is lost: the hand meets it with neither a speed nor "
    "an acceleration.",
    "wheel": "it walks over level ground for ever, and no energy is lost: no foot lands with a speed.",
    "rocker": "it rocks from edge to edge for ever, and no energy is lost: no edge lands with a speed.",
    "shuttle": "it goes from wall to wall for ever, and no energy is lost: it touches each without a speed.",
    "runner": "it runs over level ground for ever, and no energy is lost: its foot lands at rest and sticks.",
}
HOPS = "it hops for ever, and no energy is lost: its foot lands with neither a speed nor an acceleration."
FIRST, STILL = "The first motion is being found.", "The figures, which are dimmed, still show the motion before."
BESIDE_IT = "As one sees it who goes on beside it: dots on the ground are where feet stand, the line is the path so far."
SMALL_ANGLES = (
    "For small angles there is no picture in the plane. Angles are in units of half that between two spokes or walls, and "
    "of a block in units of its width over its height."
)


def verdict(scene: Scene, hop: HopResult | None, failed: Mapping[str, str]) -> tuple[str, str]:
    """Whether there is a motion, "yes", "no" or "" where that is not known yet, and the same as a sentence.

    scene, hop : that are shown; None before there is a hop
    failed : why the hop that was requested last is not shown, by the place on the page
    """
    if failed:
        return "no", "No motion is found for these numbers. " + (STILL if hop else "")
    if hop is None:
        return "", FIRST
    if hop.violations:
        return "no", f"No motion: the equations have a solution that no machine can follow. {'; '.join(hop.violations)}."
    tuned = " and ".join(f"{name.replace('_', ' ')} = {scene.numbers[name]:.6g}" for name in scene.tuned)
    return "yes", f"A motion: {DOES.get(scene.machine, HOPS)}" + (f" It needs {tuned}, which are tuned." if tuned else "")


def captions(scene: Scene, hop: HopResult | None) -> dict[str, str]:
    """What the figures show, in one line each, by their names."""
    if hop is None:
        return {}
    data, along = hop.data, scene.along.replace("_", " ")
    cycle, stands = ("step", "both points touch") if scene.steps and not scene.tuned else ("cycle", "the foot stands")
    if scene.machine == "juggler":
        stands = "the ball lies on the hand"
    what, rate = ("Angle of each body", "Rate over angle") if data.turns else ("Height of each part", "Speed over height")
    machine = SMALL_ANGLES if data.turns and data.plane is None else "The motion, over and over: nothing drives it."
    if data.plane is not None and data.plane.marks:
        machine = BESIDE_IT
    return {
        "machine": machine,
        "heights": f"{what} over one {cycle}; shaded while {stands}.",
        "portrait": f"{rate}: a closed curve is a motion that repeats.",
        "force": data.why and f"There is no contact force: {data.why}." or "It must never fall below 0, since nothing holds "
        "a foot down; it begins and ends at 0 where nothing is lost.",
        "law": "Force over extension; the shaded range is what this motion uses.",
        "family": f"Each point is the motion of a machine with another {along}, the ring the one above; dashed parts are no "
        "motions. Click on the curve to go there, or move the slider.",
        "map": "The launch speed after the next landing: where the curve meets the dashed line, the motion repeats. Click to "
        "launch there.",
    }
