"""The verdict as a sentence, and the lines below the figures."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

pytest.importorskip("bokeh")

from problems.explorer import Scene, beginning
from problems.explorer.words import captions, verdict

pytestmark = pytest.mark.extra("bokeh")


def hop(*violations: str, names=("body", "foot"), turns=False, marks=None, why="", force="force (N)", landed=None):
    """A hop with what its words depend on."""
    plane = None if marks is None else SimpleNamespace(marks=marks)
    labels = {"force": "contact force" + (" (N m)" if force == "torque" else "")}
    data, law = (
        SimpleNamespace(names=names, turns=turns, plane=plane, why=why, landed=landed, labels=labels),
        SimpleNamespace(labels=("extension", force)),
    )
    return SimpleNamespace(violations=violations, data=data, law=law)


def test_the_verdict_says_whether_there_is_a_motion_and_why_not():
    scene = beginning("hopper")
    assert verdict(scene, None, {}) == ("", "The first motion is being found.")
    assert verdict(scene, hop(), {})[0] == "yes"
    assert verdict(scene, hop(), {})[1].startswith("A motion without loss: it hops forever")
    kind, text = verdict(scene, hop("foot below ground at t = 1", "the ground would have to pull"), {})
    assert (kind, text.startswith("No motion: foot below ground at t = 1; the ground")) == ("no", True)
    assert verdict(scene, None, {"page": "no"}) == ("no", "No motion is found for these numbers.")
    assert "dimmed" in verdict(scene, hop(), {"page": "no"})[1]  # the picture beside it is that of other numbers
    given = Scene("given")  # a machine that was made in Python
    juggled = hop(names=("ball", "hand"))
    for found, does in ((juggled, "thrown and caught"), (hop(turns=True), "steps on"), (hop(), "it hops")):
        assert does in verdict(given, found, {})[1]
    assert "inertia = 24 kg m^2 and hip stiffness = 900 N m/rad" in verdict(beginning("runner", True), hop(), {})[1]
    assert "inertia = 5.7 and hip stiffness = 5.4, which are tuned" in verdict(beginning("runner"), hop(), {})[1]


@pytest.mark.parametrize(
    ("scene", "found", "words"),
    [
        (beginning("hopper"), hop(), {"heights": "the foot stands", "machine": "nothing drives it", "family": "beta"}),
        (beginning("juggler"), hop(names=("ball", "hand")), {"heights": "ball lies on the hand", "title": "the ball"}),
        (replace(beginning("hopper"), family=3), hop(), {"title": "the spring turns back 3 times"}),
        (
            beginning("hopper"),
            hop(),
            {"law": "Force over extension", "map": "after a landing:", "family": "one shown;"},
        ),
        (Scene(), hop(), {"family": "Choose a parameter"}),
        (beginning("wheel"), hop(turns=True, marks=[0.0]), {"portrait": "turned on", "heights": "while it touches"}),
        (
            beginning("rocker"),
            hop(turns=True, landed=[0.0]),
            {"portrait": "mirrored", "force": "that landed", "heights": "of the block, and phi"},
        ),
        (
            beginning("wheel"),
            hop(turns=True, force="torque"),
            {
                "law": "Torque over the angle",
                "force": "at 0. The page shows torques, since the gap that closes is an angle",
                "map": "less that of the lossless",
            },
        ),
        (beginning("runner"), hop(marks=[0.0]), {"portrait": "closed curve", "machine": "where feet stand"}),
        (replace(beginning("wheel"), numbers={}), hop(turns=True), {"machine": "For small angles there is no picture"}),
        (Scene(), hop(why="the contact never ends"), {"force": "no contact force: the contact never ends"}),
    ],
)
def test_each_figure_has_its_line(scene, found, words):
    lines = captions(scene, found)
    assert {*lines} == {"title", "machine", "heights", "portrait", "force", "law", "family", "map"}
    for name, text in words.items():
        assert text in lines[name]
    assert captions(scene, None) == {}
