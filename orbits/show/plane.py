"""Machines in the plane, drawn by the outlines that they state and moved on by their steps."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..io import writing
from ..mechanics import LANDINGS, REPEATED, Drawing, Outline, value_of
from ..model import STEP_LENGTH
from ..result import Axes, Progress
from ..units import Units
from .canvas import entitled, headline, legend_below, new_axes, off_screen
from .plot import DRAWN, phases_in_words, title
from .style import COLOURS, SHADE, STYLE, label_of, unit_labels

if TYPE_CHECKING:
    from ..hops import Simulation
    from ..periodic import Orbit, Swing

EDGE, WALL = "#4c4c4c", "#8c8c8c"  # colours of the ground's edge and of what is fixed


@dataclass(frozen=True, eq=False)
class PlanePath:
    """An outline at several times.

    outline : whose path it is
    colour : of its part
    points : (k, m, 2), across and height
    """

    outline: Outline
    colour: str
    points: np.ndarray


def drawing_of(machine: Any) -> Drawing | None:
    """The drawing that a machine states, None where it states none."""
    return getattr(machine, "drawing", None)


def landings_of(orbit: "Orbit", t: np.ndarray) -> np.ndarray:
    """The number (k,) of landings of an orbit before times (k,)."""
    if orbit.contact_time is None:
        return np.zeros(len(t), int)
    return (np.floor(t / orbit.period) + (np.mod(t, orbit.period) > orbit.flight_time)).astype(int)


def steps_of_run(run: "Simulation", t: np.ndarray) -> np.ndarray:
    """The number (k,) of steps of a simulated motion before times (k,)."""
    legs = np.searchsorted([leg.start for leg in run.legs], t, "right") - 1
    return np.array([getattr(leg, "stance", 0) for leg in run.legs])[np.maximum(legs, 0)]


class Outlined(NamedTuple):
    """What outlines need of a machine: its drawing, its coordinates, and its parameters, the step (k,) so far, on
    average, among them."""

    drawing: Drawing
    coordinates: Sequence[str]
    values: Mapping[str, Any]


def outlined(machine: Any, step: Any) -> Outlined:
    """A machine with the step of an orbit or a simulation, None for one without."""
    own = {} if step is None else {STEP_LENGTH: step}
    return Outlined(machine.drawing, machine.coordinates, {**machine.values, **own})


def labelled(result: Any, t: np.ndarray) -> tuple[Any, np.ndarray, np.ndarray]:
    """The machine of an orbit or a simulation, and its flight states (k, n) at times (k,) in the labels after these
    numbers of landings (k,)."""
    machine = result.source
    if hasattr(result, "contact_time"):
        own = machine if result.step is None else outlined(machine, result.step)
        return own, result(t), landings_of(result, t)
    if machine.model.runs:  # each step of a simulation has a length of its own
        return machine, result.unrolled(t), np.zeros(len(t), int)
    steps = steps_of_run(result, t)
    if not machine.model.sticks:
        return machine, result(t), steps
    steps = np.where(
        steps == 0, 2, steps
    )  # after a step ahead and one behind, too, it has its labels, but not its place
    return outlined(machine, result.footholds_at(t) / steps), result(t), steps


def cycles_shown(orbit: "Orbit") -> int:
    """The number of cycles after which an orbit shows that it moves on, or that it is back."""
    drawing = drawing_of(orbit.source)
    if orbit.contact_time is None or not (drawing and drawing.onward):
        return 1
    return 2 if comes_back(drawing, outlined(orbit.source, orbit.step).values) else DRAWN.cycles_onward


def plane_paths(machine: Any, states: np.ndarray, landings: np.ndarray) -> list[PlanePath]:
    """The outlines of a machine in flight states (k, n) in the labels after these numbers of landings (k,)."""
    drawing, p, found = machine.drawing, machine.values, list[PlanePath]()
    place: dict[str, Any] = dict(zip(machine.coordinates, states[:, : 2 * len(machine.coordinates) : 2].T, strict=True))
    place[LANDINGS] = landings.astype(float)
    names = dict.fromkeys(outline.name for outline in drawing.outlines if not (outline.fixed or outline.traced))
    colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(names)}
    for outline in drawing.outlines:
        for i in range(max(round(float(value_of(outline.repeat, {}, p))), 0)):
            own = place | {REPEATED: float(i)}
            each = [value_of(value, own, p) for point in outline.points for value in point]
            points = np.stack(np.broadcast_arrays(*each, landings)[:-1], axis=1).reshape(len(landings), -1, 2)
            if not outline.fixed:
                points = _led_on(drawing, points.astype(float), landings, p)
            colour = colours.get(outline.name, WALL)
            found.append(PlanePath(outline, colour, _tilted(points, drawing, p)))
    return found


def _led_on(drawing: Drawing, points: np.ndarray, landings: np.ndarray, p: Mapping) -> np.ndarray:
    """Points (k, m, 2) after these numbers of landings (k,), in the labels of the first flight; below 0 for steps
    back."""
    (signs, shifts), k = _after_landing(drawing, p), landings[:, None, None]
    shifts = shifts[..., None, :]
    turned = np.where(k % 2 == 1, shifts - points, points)
    return np.where(signs > 0, points + k * shifts, turned)


def _after_landing(drawing: Drawing, p: Mapping) -> tuple[np.ndarray, np.ndarray]:
    """The signs (2,) and the shifts (..., 2) of the places after a landing."""
    rules = [drawing.onward.get(name, name) for name in "xy"]
    places = ([value_of(rule, {"x": x, "y": x}, p) for rule in rules] for x in (0.0, 1.0))
    zero, one = (np.stack(np.broadcast_arrays(*each), -1) for each in places)
    return np.sign(one - zero).reshape(-1, 2)[0], zero


def _tilted(points: np.ndarray, drawing: Drawing, p: Mapping) -> np.ndarray:
    angle = float(value_of(drawing.tilt, {}, p))
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, -s], [s, c]])


def comes_back(drawing: Drawing, p: Mapping) -> bool:
    """Whether two landings lead a machine back to where it was."""
    signs, shifts = _after_landing(drawing, p)
    return bool(((signs < 0) | (shifts == 0)).all())


@dataclass(frozen=True, eq=False)
class PlaneMotion:
    """A machine in the plane over several cycles, for a page, as seen by an observer who moves with it.

    points : flat, of each outline its points one time after the other, (cycles * times, size, 2)
    outlines : columns by name, one entry for each outline: "size", which is 0 of one that is traced, "name", "colour",
        "closed" and "ends"
    trails : flat, of each outline that is traced its points, in fixed coordinates, over the cycles behind the machine
        and then those shown
    advance : of a cycle, across
    marks : places across of the standing feet, in addition to the trails
    cycles : after which it begins again
    middle : of the picture, across
    ground : whether there is ground
    span : the lowest and the highest height that is drawn
    """

    points: np.ndarray
    outlines: dict[str, list]
    trails: np.ndarray
    advance: float
    marks: list[float]
    cycles: int
    middle: float
    ground: bool
    span: tuple[float, float]


def motion_in_plane(orbit: "Orbit") -> PlaneMotion | None:
    """The motion of an orbit whose machine states its drawing; None for another, and where the contact never ends."""
    machine: Any = orbit.source
    if (drawing := drawing_of(machine)) is None or orbit.contact_time is None:
        return None
    machine = outlined(machine, orbit.step)
    advance = np.zeros(2) if comes_back(drawing, machine.values) else _after_landing(drawing, machine.values)[1]
    cycles = _cycles_alike(orbit, advance)
    t = np.linspace(0, cycles * orbit.period, cycles * DRAWN.times_of_cycle)
    along = (t / orbit.period)[:, None, None] * advance
    paths = plane_paths(*labelled(orbit, t))
    moving = [PlanePath(each.outline, each.colour, each.points - along) for each in paths if not each.outline.traced]
    columns: dict[str, list] = {
        "size": [0 if each.outline.traced else each.points.shape[1] for each in paths],
        "colour": [each.colour for each in paths],
        **{name: [getattr(each.outline, name) for each in paths] for name in ("name", "closed", "ends")},
    }
    points = np.concatenate([each.points.ravel() for each in moving]).astype(np.float32)
    # The path behind a machine that goes on is that of its last cycles, some cycles earlier.
    behind = DRAWN.cycles_behind
    last, back = -behind * DRAWN.times_of_cycle, cycles * advance
    traced = [each.points[:, 0] for each in paths if each.outline.traced]
    trails = [np.concatenate([each[last:] - back, each]).ravel() for each in traced]
    marks = [k * float(advance[0]) for k in range(-behind - 1, cycles + behind + 1)] if advance.any() else []
    across, span = _extent_of(moving)
    trail = np.concatenate([*trails, np.zeros(0)]).astype(np.float32)
    return PlaneMotion(points, columns, trail, float(advance[0]), marks, cycles, sum(across) / 2, drawing.ground, span)


def _cycles_alike(orbit: "Orbit", advance: np.ndarray) -> int:
    """The number of cycles after which a machine looks as at first to an observer who moves with it,
    `DRAWN.cycles_onward` where it takes too many."""
    behind = DRAWN.cycles_behind
    t = (np.arange(DRAWN.cycles_on_page + 1) + 0.1) * orbit.period
    parts: dict[str, list[np.ndarray]] = {}
    for each in plane_paths(*labelled(orbit, t)):
        if not each.outline.traced:
            parts.setdefault(each.outline.name, []).append(each.points - (t / orbit.period)[:, None, None] * advance)
    apart = np.zeros(DRAWN.cycles_on_page + 1)
    for paths in parts.values():
        points = np.concatenate(paths, axis=1)
        far = np.linalg.norm(points[:, :, None] - points[0], axis=3).min(2).max(1) / np.ptp(points[0], axis=0).max()
        apart = np.maximum(apart, far)
    alike = behind + np.flatnonzero(apart[behind:] < DRAWN.alike)  # so that there is a path behind it
    return int(alike[0]) if len(alike) else DRAWN.cycles_onward


def plot_in_plane(orbit: "Orbit", axes: Axes | None = None) -> Axes:
    """Plot a machine in the plane at instants of a cycle side by side, from lift-off to the middle of the contact;
    return the axes."""
    machine: Any = orbit.source
    flight = orbit.flight_time
    middle = phases_in_words(machine)[2]
    instants = {0.0: "lift-off", flight / 4: "", flight / 2: middle, 0.75 * flight: "", flight: "landing"}
    if orbit.contact_time is not None:
        instants[flight + orbit.contact_time / 2] = "mid-contact"
    t = np.array([*instants])
    paths, (metres, seconds, _) = plane_paths(*labelled(orbit, t)), unit_labels(orbit.scales)
    paths = [each for each in paths if not each.outline.traced]
    ranges = np.array([[each.points[..., 0].min(1), each.points[..., 0].max(1)] for each in paths])
    left_ends, right_ends = ranges[:, 0].min(0), ranges[:, 1].max(0)
    (_, _), (low, high) = _extent_of(paths)
    places = max(DRAWN.gap * (right_ends - left_ends).max(), DRAWN.apart * (high - low)) * np.arange(len(t))
    aside = places - 0.5 * (left_ends + right_ends)
    moved = [PlanePath(each.outline, each.colour, each.points + aside[:, None, None] * [1.0, 0.0]) for each in paths]
    (left, right), (low, high) = _extent_of(moved)
    if axes is None:
        axes = new_axes(float(np.clip((high - low) / (right - left) + 0.26, 0.3, 0.75)), STYLE.page)
    _set(axes, (left, right), (low, high), metres)
    _draw_ground(axes, machine, (left, right), low - (high - low))
    named = set[str]()
    for i in range(len(t)):
        for each in moved:
            label = None if each.outline.name in named or each.outline.fixed else label_of(each.outline.name)
            named.add(each.outline.name)
            _artist(axes, each, _drawn_points(each, i), label)
    axes.set_xticks(places, [f"{time:.3g}\n" + words.replace("-", "-\n") for time, words in instants.items()])
    axes.tick_params(axis="x", length=0)
    axes.set_xlabel("time" + seconds)
    return legend_below(entitled(axes, title(orbit)))


def plot_swing(swing: "Swing", axes: Axes | None = None) -> Axes:
    """Plot a machine at instants of a swing from hold to hold over one another, the later the darker; return the
    axes."""
    t = np.linspace(0.0, swing.period * (1 - 1e-12), DRAWN.times_of_cycle * (DRAWN.swing_instants - 1) + 1)
    paths, (metres, *_) = plane_paths(swing.drawn, swing(t), np.zeros(len(t), int)), unit_labels(swing.source.units)
    across, span = _extent_of([each for each in paths if not each.outline.fixed])
    axes = new_axes(float(np.clip(np.ptp(span) / np.ptp(across) + 0.2, 0.4, 0.9))) if axes is None else axes
    _set(axes, across, span, metres)
    for i in range(0, len(t), DRAWN.times_of_cycle):
        last = i == len(t) - 1
        for each in paths:
            if last or not (each.outline.traced or each.outline.fixed):
                label = label_of(each.outline.name) if last and not each.outline.fixed else None
                artist = _artist(axes, each, _drawn_points(each, i), label)
                artist.set(alpha=0.15 + 0.85 * i / len(t), clip_on=True)
    return legend_below(headline(axes, swing.machine))


def animate_in_plane(
    path: Path, words: np.ndarray, machine: Any, states: np.ndarray, landings: np.ndarray, units: Units | None,
    progress: Progress,
) -> Path:  # fmt: skip
    """Write an animation of a machine in flight states (frames, n) after these numbers of landings (frames,)."""
    paths, (metres, *_) = plane_paths(machine, states, landings), unit_labels(units)
    (left, right), (low, high) = _extent_of(paths)
    with off_screen():
        axes = new_axes(float(np.clip((high - low) / (right - left) + 0.25, 0.4, 1.1)))
    _set(axes, (left, right), (low, high), metres)
    _draw_ground(axes, machine, (left, right), low - (high - low))
    named, artists = set[str](), []
    for each in paths:
        label = None if each.outline.name in named or each.outline.fixed else label_of(each.outline.name)
        named.add(each.outline.name)
        artists.append(_artist(axes, each, _drawn_points(each, 0), label))
    label = axes.set_title("contact")
    legend_below(axes).figure.canvas.draw()
    axes.figure.set_layout_engine("none")  # the layout is made once, not again for every frame

    def draw(i: int) -> tuple:
        for each, artist in zip(paths, artists, strict=True):
            _move(artist, each, _drawn_points(each, i))
        label.set_text(words[i])
        return *artists, label

    return write_frames(path, axes, draw, len(words), progress)


def write_frames(path: Path, axes: Axes, draw: Callable, count: int, progress: Progress) -> Path:
    """Write an animation of `count` frames; `draw` draws each of them on axes by its number."""
    from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter

    writer = (FFMpegWriter if path.suffix.lower() == ".mp4" else PillowWriter)(fps=30)
    report = (lambda i, count: progress((i + 1) / count)) if progress else None
    with writing("animation", path) as target:
        animation = FuncAnimation(axes.figure, draw, frames=count, blit=False)
        animation.save(target, writer, dpi=100, progress_callback=report)
    return path


def _extent_of(paths: Iterable[PlanePath]) -> tuple[tuple[float, float], tuple[float, float]]:
    """The range across and the range of heights of paths, with a margin."""
    points = np.concatenate([each.points.reshape(-1, 2) for each in paths])
    (left, low), (right, high) = points.min(0), points.max(0)
    margin = 0.08 * (high - low)
    return (float(left - margin), float(right + margin)), (float(low - margin), float(high + margin))


def _set(axes: Axes, across: tuple[float, float], up: tuple[float, float], metres: str) -> None:
    axes.set(xlim=across, ylim=up, xticks=[], ylabel="height" + metres, aspect="equal")
    axes.spines[["top", "right", "bottom"]].set_visible(False)


def _draw_ground(axes: Axes, machine: Any, across: tuple[float, float], low: float) -> None:
    """The ground, as far as the axes go."""
    if machine.drawing.ground:
        line = _tilted(
            np.array([[2 * across[0] - across[1], 0.0], [2 * across[1] - across[0], 0.0]]),
            machine.drawing,
            machine.values,
        )
        axes.fill_between(*line.T, low - abs(line[:, 1]).max(), color=SHADE, lw=0, zorder=0)
        axes.plot(*line.T, color=EDGE, lw=1.5, zorder=1)


def _drawn_points(path: PlanePath, i: int) -> np.ndarray:
    """The points that are drawn of an outline at the time of a number."""
    return path.points[: i + 1, 0] if path.outline.traced else path.points[i]


def _artist(axes: Axes, path: PlanePath, points: np.ndarray, label: str | None) -> Any:
    """What draws an outline."""
    outline = path.outline
    if outline.closed:
        (polygon,) = axes.fill(*points.T, fc=path.colour + "55", ec=path.colour, lw=1.8, label=label, zorder=2)
        return polygon
    style: dict[str, object] = (
        {"marker": "o", "ms": 6, "clip_on": False} if outline.ends else {"ls": ":"} if outline.traced else {}
    )
    width = 4.0 if outline.fixed else 3.0 if outline.ends else 1.6 if outline.traced else 2.2
    (line,) = axes.plot(*points.T, color=path.colour, lw=width, label=label, solid_capstyle="round", zorder=3, **style)
    return line


def _move(artist: Any, path: PlanePath, points: np.ndarray) -> None:
    if path.outline.closed:
        artist.set_xy(points)
    else:
        artist.set_data(*points.T)
