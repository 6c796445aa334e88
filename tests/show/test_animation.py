"""Animations, also of machines whose springs are no column from the top down to the ground."""

import numpy as np
import pytest
from conftest import slow_after
from looks import check_looks
from PIL import Image

from orbits import InputError, Mechanism, find, simulate, starts
from orbits.mechanics import Mass, Spring
from orbits.show import animation, canvas
from problems import Chain, Hopper, Juggler, chain_hand, plate_hopper

FRAMES = 6


def first_motion(machine, half_contact=4.0, half_flight=4.0):
    return find(machine, start=starts(machine, half_contact, half_flight)[0])


def lever():
    """A spring between no two heights, b a foot."""
    return Mechanism(
        coordinates=("a", "b"),
        elements=[Mass("a", 1.0), Mass("b", 1.0), Spring("a - 2*b", "k*r")],
        gap="b",
        parameters={"k": 1.0},
    )


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """A function that animates something and returns the heights in its last frame by name, and the lengths of the
    coils."""

    def draw(motion, looks=None):
        kept, new_axes = [], canvas.new_axes
        monkeypatch.setattr(animation, "new_axes", lambda *size: kept.append(new_axes(*size)) or kept[-1])
        path = motion.animate(tmp_path / "motion.gif", FRAMES)
        with Image.open(path) as image:
            assert (image.n_frames, image.info["duration"]) == (FRAMES, 30)  # hundredths of a second, in milliseconds
        (axes,) = kept
        if looks:
            check_looks(f"animation: {looks}", axes.figure, draw=False)
        lines = [line for line in axes.lines if np.size(line.get_ydata())]
        heights = {line.get_label(): line.get_ydata()[0] for line in lines if not line.get_label().startswith("_")}
        return heights, [np.ptp(line.get_ydata()) for line in lines if np.size(line.get_ydata()) > 2]

    return draw


def lifts(heights, orbit):
    """By how many rooms each mass is drawn above its own coordinate in the last frame."""
    own = {name: float(orbit.shape.heights[name](orbit(orbit.period * (1 - 1 / FRAMES)))) for name in heights}
    added = {name: heights[name] - own[name] for name in heights}
    room = min(each for each in added.values() if each > 1e-9)
    return {name: pytest.approx(added[name] / room, abs=1e-9) for name in heights}


@pytest.mark.parametrize(
    ("motion", "rooms"),
    slow_after(
        3,
        [
            (lambda: find(Hopper()), {"body": 1, "foot": 0}),
            (lambda: find(Juggler()), {"ball": 1, "hand": 1}),
            (lambda: first_motion(Chain().mechanism), {"mass 1": 2, "mass 2": 1, "mass 3": 0}),
            (lambda: first_motion(plate_hopper()), {"body": 2, "foot": 1, "plate": 1}),
            (lambda: first_motion(chain_hand()), {"ball": 2, "hand": 2, "y3": 1}),
            (lambda: find(lever()), {"a": 1, "b": 0}),
        ],
    ),
)
def test_what_lands_on_a_mass_is_drawn_on_it(motion, rooms, drawn):
    """Each spring has a room of its own, and the two sides of the gap have the same room below them, so that they touch
    in contact."""
    orbit = motion()
    heights, coils = drawn(orbit, " ".join(rooms))
    assert rooms == lifts(heights, orbit)
    assert len(coils) == len(orbit.shape.springs)
    assert min(coils, default=1.0) > 0


def test_springs_in_any_order():
    """A column that is listed from the ground up, from the top down, or neither."""
    heights = {name: np.array([0.0, 1.0]) for name in "abcd"} | {None: np.zeros(2)}
    standing = {"a": 1.1, "b": 2.3, "c": 3.7, "d": 0.0, None: 0.0}
    pairs = [("d", "c"), ("c", "b"), ("b", "a")]
    for order in ((0, 1, 2), (2, 1, 0), (1, 2, 0), (2, 0, 1)):
        found = animation._lifted(heights, [pairs[i] for i in order], standing)
        assert [found[name][0] / 1.2 for name in "abcd"] == pytest.approx([3, 2, 1, 0])


def test_an_animation_reports_its_frames_and_needs_ffmpeg_for_mp4(tmp_path, monkeypatch):
    run, shares = simulate(Hopper(), 4.6, hops=1), []
    run.animate(tmp_path / "hop.gif", 3, progress=shares.append)
    assert shares == pytest.approx([1 / 3, 2 / 3, 1.0])
    monkeypatch.setattr("matplotlib.animation.FFMpegWriter.isAvailable", lambda: False)
    with pytest.raises(InputError, match=r"writing \.mp4 needs ffmpeg"):
        run.animate(tmp_path / "hop.mp4", 3)
