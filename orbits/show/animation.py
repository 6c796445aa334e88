"""Animations of orbits and simulations: masses, springs, knees and the ground, in files that matplotlib writes."""

from collections.abc import Iterable, Mapping
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..io import check_path
from ..result import Axes, Progress
from ..units import Units
from .canvas import finished, new_axes, off_screen
from .plane import animate_in_plane, cycles_shown, drawing_of, labelled, write_frames
from .plot import DRAWN, phases_in_words
from .style import COLOURS, SHADE, STYLE, unit_labels

if TYPE_CHECKING:
    from ..hops import Simulation
    from ..periodic import Orbit, Swing

ANIMATIONS = (".gif", ".mp4")
SPRING_END = "spring's end"  # the height of an end that an actuator moves; it is drawn as a thin bar


def animate_orbit(orbit: "Orbit", path: str | Path, frames: int = 80, progress: Progress = None) -> Path:
    """Write one cycle as an animation of masses, spring and ground, .gif or, by ffmpeg, .mp4; returns the path."""
    closed, drawing = orbit.contact_time is not None, drawing_of(orbit.source)
    end = (orbit.period if closed else orbit.flight_time) * cycles_shown(orbit)
    t = np.linspace(0, end, _frames(frames), endpoint=not closed)
    flying = np.mod(t, end if not closed else orbit.period) <= orbit.flight_time
    words = np.where(flying, *phases_in_words(orbit.source)[:2])
    if drawing:
        return animate_in_plane(check_animation(path), words, *labelled(orbit, t), orbit.scales, progress)
    shape, floating = orbit.shape, orbit.certificate.smallest_separation is None
    joints = shape.springs, shape.knees, shape.embed
    return _animate(path, words, orbit(t), shape.heights, joints, floating, orbit.scales, progress)


def animate_simulation(run: "Simulation", path: str | Path, frames: int = 200, progress: Progress = None) -> Path:
    """Write a simulated motion as an animation, as `animate_orbit` does; returns the path."""
    t, machine = np.linspace(0, run.end, _frames(frames)), run.source
    words = np.where(run.in_contact(t), *phases_in_words(machine)[1::-1])
    if drawing_of(machine):
        return animate_in_plane(check_animation(path), words, *labelled(run, t), machine.units, progress)
    floating, joints = run.smallest_separation is None, (run.springs, run.knees, machine.model.embed)
    return _animate(path, words, run(t), run.heights, joints, floating, machine.units, progress)


def animate_swing(swing: "Swing", path: str | Path, frames: int = 120, progress: Progress = None) -> Path:
    """Write some swings from hold to hold as an animation, as `animate_orbit` does; returns the path."""
    t = np.linspace(0.0, DRAWN.cycles_onward * swing.period, _frames(frames), endpoint=False)
    count = np.floor_divide(t, swing.period).astype(int)
    words, units = np.array([f"swing {k + 1}" for k in count]), swing.source.units
    return animate_in_plane(check_animation(path), words, swing.drawn, swing(t), count, units, progress)


def _frames(frames) -> int:
    if isinstance(frames, bool) or not isinstance(frames, int | np.integer) or frames < 2:
        raise InputError(f"frames = {frames!r}; an animation needs at least 2")
    return int(frames)


def check_animation(path: str | Path) -> Path:
    """The path of an animation to write; raises `InputError` where its ending or folder, or a lack of ffmpeg, rules
    that out."""
    path = check_path(path, ANIMATIONS)
    if path.suffix.lower() == ".mp4":
        from matplotlib.animation import FFMpegWriter

        if not FFMpegWriter.isAvailable():
            raise InputError(f"'{path}' cannot be written: writing .mp4 needs ffmpeg; write .gif instead")
    return path


def _sideways(axes: Axes, below: np.ndarray, above: np.ndarray, link: float) -> np.ndarray:
    """How far (frames,) along the abscissa a knee of two links is from the line between its ends at these heights, so
    that the links are drawn as long as they are."""
    box, across, up = axes.get_window_extent(), np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
    return np.sqrt(np.maximum(link**2 - 0.25 * (above - below) ** 2, 0.0)) * across / box.width * box.height / up


def _lifted(heights: Mapping, springs, standing: Mapping) -> dict:
    """Heights (frames,) by name with room for springs that are long enough, in whatever order these are listed.

    standing : the heights by name, None for the ground, at a generic state of the contact, where heights that land on
        each other are equal; these get the same room
    """
    room, near = 1.2 * max(map(np.ptp, heights.values())), 1e-9 * max(map(abs, standing.values()))
    touching = {name: [other for other in heights if abs(standing[name] - standing[other]) <= near] for name in heights}
    lifts = {name: 0 if name in touching[None] else 1 for name in heights}
    for _ in springs:  # one pass for each spring lifts even the top of a column that is listed from the top
        for below, above in springs:
            if above not in touching[None]:
                lifts |= dict.fromkeys(touching[above], max(lifts[above], lifts[below] + 1))
    return {name: height + room * lifts[name] for name, height in heights.items()}


def drawn_heights(
    states: np.ndarray, functions: Mapping, joints: tuple, floating: bool
) -> tuple[dict[str | None, np.ndarray], bool]:
    """The heights (k,) by name, None for the ground, at which masses are drawn in flight states (k, n), and whether
    they have been lifted to make room for springs.

    functions, joints : as in `_animate`
    floating : whether no rest length says how far the masses are apart
    """
    springs, knees, embed = joints
    names = [name for name in functions if name != "centre of mass"]
    heights: dict[str | None, np.ndarray] = {name: functions[name](states) for name in names}
    heights[None] = np.zeros(len(states))
    if not floating or knees:  # links say how far the masses are apart
        return heights, False
    generic = embed @ np.sqrt(np.arange(2.0, 2.0 + embed.shape[1]))
    return _lifted(heights, springs, {name: functions[name](generic) for name in names} | {None: 0.0}), True


def drawn_range(heights: Mapping, knees: Iterable[tuple]) -> tuple[float, float]:
    """The lowest and the highest height that is drawn, with room for a knee at the side too."""
    low, high = min(map(np.min, heights.values())), max(map(np.max, heights.values()))
    return float(low), float(max([high, *(low + 2 * length for *_, length in knees)]))


def _animate(
    path, words, states, functions: Mapping, joints: tuple, floating: bool, units: Units | None, progress: Progress
) -> Path:
    """Animate masses, whose heights are functions of the states (frames, n), with a title from `words` for each frame.

    joints : the springs, the knees, and the matrix from contact to flight states, as in a `Shape`

    With `floating` no rest length says how far the masses are apart, and they are drawn with room between them.
    """
    path, (metres, *_), (springs, knees, _) = check_animation(path), unit_labels(units), joints
    names = [name for name in functions if name != "centre of mass"]
    heights, floating = drawn_heights(states, functions, joints, floating)
    with off_screen():
        axes = new_axes(1.0 if knees else 1.5, STYLE.column)
    low, high = drawn_range(heights, knees)
    margin = 0.08 * (high - low)
    axes.set(xlim=(-1, 1), ylim=(low - margin, high + margin), xticks=[], ylabel="height" + metres)
    if floating:
        axes.set_yticks([])
    axes.spines[["top", "right", "bottom"]].set_visible(False)
    axes.axhspan(low - 2 * margin, 0, color=SHADE, zorder=0)
    axes.axhline(0, color="0.3", lw=1.5)
    coils = [axes.plot([], [], color="0.35", lw=1.4, zorder=2)[0] for _ in springs]
    legs = [axes.plot([], [], color="0.35", lw=4, zorder=2)[0] for _ in knees]
    count = len(names) - (SPRING_END in names)
    marks = [{"marker": "o", "ms": 18}] * (count - 1) + [{"marker": "_", "ms": 34, "mew": 6}]
    drawn = zip(names, cycle(COLOURS), [*marks, {"marker": "_", "ms": 24, "mew": 3}], strict=False)
    masses = [axes.plot([], [], ls="", color=colour, label=name, zorder=3, **mark)[0] for name, colour, mark in drawn]
    label = axes.set_title("contact")
    zigzag = np.concatenate([[0, 0], np.tile([0.12, -0.12], 7), [0, 0]])
    finished(axes, {"loc": "upper right", "markerscale": 0.4}).figure.canvas.draw()
    axes.figure.set_layout_engine("none")  # the layout is made once, not again for every frame
    bends = [_sideways(axes, heights[below], heights[above], length) for below, above, length in knees]

    def draw(i):
        for leg, bend, (below, above, _) in zip(legs, bends, knees, strict=True):
            low, high = heights[below][i], heights[above][i]
            leg.set_data([0, bend[i], 0], [low, 0.5 * (low + high), high])
        for coil, (below, above) in zip(coils, springs, strict=True):
            coil.set_data(zigzag, np.linspace(heights[below][i], heights[above][i], len(zigzag)))
        for mass, name in zip(masses, names, strict=True):
            mass.set_data([0], [heights[name][i]])
        label.set_text(words[i])
        return *coils, *legs, *masses, label

    return write_frames(path, axes, draw, len(words), progress)
