"""Plots of orbits, families and diagrams: axes in, axes out; matplotlib is imported only when something is drawn.

Results draw themselves by these functions through `orbits.result.shown`; only the type checker imports their
types.
"""

import re
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from io import BytesIO
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..errors import InputError
from ..io import check_path, writing
from ..model import Affine, laws_in_words, title_of_machine
from ..result import Axes
from ..units import LIFTOFF_SPEED, Units
from .family_ends import MARKERS_OF_ENDS, NAMES_OF_ENDS, ends_of

if TYPE_CHECKING:
    from ..continuation import Family
    from ..design import DesignCurve, Front
    from ..hops import Simulation
    from ..periodic import Orbit
    from ..returns import ReturnMap

FIGURES = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".eps")


class Style(NamedTuple):
    """The sizes and numbers of figures, those of machines in the plane among them."""

    resolution: int = 160  # of figures that are written, in pixels an inch
    legend_below: float = 4.4  # distance of a legend below axes in its font sizes, clear of the name of the abscissa
    columns_apart: float = 1.4  # distance between the columns of a legend in its font sizes
    letter: float = 0.52  # width of a letter in a legend in its font sizes
    entry: float = 4.2  # width of a legend's entry without its letters in its font sizes
    widened: float = 1.15  # factor by which the layout makes axes wider
    stage_samples: int = 401  # times of a stage at which its curves are drawn
    cycles_of_map: int = 12  # that are drawn in a map: more would not be distinguished
    destinations: float = 0.05  # height of the bar that shows them, as a share of the axes
    # Dashes of curves of bifurcations, one for each doubling of the period.
    dashes_at_borders: tuple = ((0, (1, 1.3)), (0, (1, 2)), (0, (1, 3)), (0, (1, 4)))
    # Where the names of curves stand in a figure with several, as shares of these and in points beside them.
    places_of_names: tuple[tuple[float, tuple[int, int]], ...] = (
        (0.5, (-34, 10)),
        (0.45, (34, -14)),
        (0.72, (-46, 14)),
        (0.85, (-52, 4)),
        (0.3, (40, -10)),
    )
    contours: int = 8  # of a map of results
    width_of_bar: float = 0.38  # whose neighbours are 1 apart
    bars: int = 40  # of a histogram, at most
    cycles_onward: int = 4  # of a machine that goes on in an animation, which shows two of one that comes back
    times_of_cycle: int = 60  # of a machine on a page
    cycles_on_page: int = 12  # until a machine looks as at first, at most
    alike: float = 1e-6  # share of its size by which a machine that looks as at first differs
    cycles_behind: int = 2  # whose path is drawn behind a machine on a page
    legend_width: float = 4.5  # inches that three names in a row need
    gap: float = 1.2  # between instants side by side, in widths of the machine


STYLE = Style()
# One colour for each role; colour-blind readers can distinguish them too (Okabe and Ito 2008).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
SHADE = "#e8e4d8"
PALE = "#cfdbe6"
MARKERS = {"fold": "o", "branch point": "s", "grazing": "v", "masses touch": "X", "contact pulls": "^"}
MARKERS |= {"landing jerk": "<", "collapse": "D", "law ends": "d", "family": "*", "corner": "P"}
MOTIONS, NO_MOTIONS, NO_ORBITS = "motions", "no motions", "no orbits"  # entries of legends
_OFF_SCREEN = ContextVar("off screen", default=False)


@contextmanager
def off_screen() -> Iterator[None]:
    """Where figures are drawn for a file or a page: `new_axes` hides them from pyplot, whatever is loaded."""
    token = _OFF_SCREEN.set(True)
    try:
        yield
    finally:
        _OFF_SCREEN.reset(token)


def _on_screen() -> bool:
    """Whether a new figure is one of pyplot's: in the main thread of a notebook's kernel, and of a program that has
    loaded pyplot, unless it is for a file."""
    if _OFF_SCREEN.get() or threading.current_thread() is not threading.main_thread():
        return False
    if "matplotlib.pyplot" in sys.modules:
        return True
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    return getattr(shell, "kernel", None) is not None


def axes_or_new(axes: object, width: float = 5.6, height: float = 3.8) -> Axes:
    """The axes that are stated, or else new ones of a size; raises `InputError` for what are none."""
    from matplotlib.axes import Axes as Known

    if not (axes is None or isinstance(axes, Known)):
        raise InputError(f"axes = {axes!r}; they are Axes of matplotlib, as figure.add_subplot() has them")
    return new_axes(width, height) if axes is None else axes


def new_axes(width: float = 5.6, height: float = 3.8) -> Axes:
    """Axes on a new figure.

    In a notebook, and where `matplotlib.pyplot` has been imported before, it is one of pyplot's figures, so that the
    cell or `plt.show()` shows it. Otherwise, in a thread and within `off_screen` no window and no global state of
    matplotlib knows it, and it is gone with the last reference to it.
    """
    if _on_screen():
        from matplotlib import pyplot

        figure = pyplot.figure(figsize=(width, height), layout="constrained")
    else:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set_prop_cycle(color=COLOURS)
    return axes


def new_row(count: int, width: float = 3.6, height: float = 3.4, rows: int = 1) -> np.ndarray:
    """An array of `count` axes side by side on a new figure, or (rows, count) of them for more rows than one.

    The type of a figure up to 11 inches wide can be read where it is shown 900 pixels wide.
    """
    first = new_axes(width * count, height * rows)
    figure = first.figure
    first.remove()
    figure.get_layout_engine().set(h_pad=0.08, w_pad=0.08)
    axes = figure.subplots(rows, count)
    for one in np.ravel(axes):
        one.spines[["top", "right"]].set_visible(False)
        one.locator_params(axis="x", nbins=6)
        one.set_prop_cycle(color=COLOURS)
    return axes


def unit_labels(units: Units | None) -> tuple[str, str, str]:
    """The units of length, time and speed as text for a plot: SI for a machine that is stated in SI, else nothing."""
    return ("", "", "") if units is None else (" (m)", " (s)", " (m/s)")


def angles_shown(orbit: "Orbit", drawn: bool = False) -> tuple[str, ...]:
    """The coordinates of an orbit whose machine turns and is shown by its angles: where these are its heights, or where
    it is `drawn` beside them; none of another."""
    own, angles = (getattr(orbit.source, name, ()) for name in ("coordinates", "angles"))
    return tuple(reversed(own)) if {*(own if drawn else orbit.shape.heights)} <= {*angles} else ()


def phases_in_words(machine: Any) -> tuple[str, str, str]:
    """The phases with an open and with a closed gap, and the middle of the first: a machine that stands on the ground
    in both has no flight."""
    planar = machine.model.planar if machine else None
    stands = planar is not None and planar.stands
    return ("single support", "double support", "mid-swing") if stands else ("flight", "contact", "mid-flight")


def plot_orbit(orbit: "Orbit", axes: Axes | None = None) -> Axes:
    """Plot heights of the masses against time over a cycle, contact shaded, as in Fig. 3 of the paper; return the axes.

    In metres and seconds for a machine that is stated in SI.
    """
    metres, seconds, _ = unit_labels(orbit.scales)
    axes, (t, states) = axes_or_new(axes), _cycle(orbit, 2001)
    for (name, height), colour in zip(orbit.shape.heights.items(), COLOURS, strict=False):
        axes.plot(t, height(states), color=colour, label=plain(name), **_style(name))
    if orbit.contact_time is not None:
        closed = phases_in_words(orbit.source)[1]
        axes.axvspan(orbit.flight_time, t[-1], fc=SHADE, ec="0.7", lw=0.5, label=closed, zorder=0)
    axes.axhline(0, color="0.4", lw=0.8)
    axes.set_title(plain(title(orbit)), fontsize="medium", wrap=True)
    label = "angle" if angles_shown(orbit) else vertical(orbit.certificate.smallest_separation) + metres
    return finished(axes, xlim=(0, t[-1]), xlabel="time" + seconds, ylabel=label)


def _style(name: str) -> dict[str, object]:
    """The style of a mass's height: full, and that of the centre of mass dashed."""
    return {"lw": 1.2, "ls": (0, (5, 2))} if name == "centre of mass" else {"lw": 2}


def _cycle(orbit, count: int):
    """Times over a cycle, or over the flight where the contact does not end, and the states then."""
    t = np.linspace(0, orbit.flight_time if orbit.contact_time is None else orbit.period, count)
    return t, states_to_show(orbit, t)


def states_to_show(orbit: "Orbit", t: np.ndarray) -> np.ndarray:
    """Flight states (k, n) of an orbit at times (k,): of a machine that steps in the labels of the first flight, where
    all heights are sums of coordinates, so that they do not jump at a landing."""
    return orbit.unrolled(t) if all(isinstance(each, Affine) for each in orbit.shape.heights.values()) else orbit(t)


def finished(axes: Axes, legend: Mapping | None = None, **labels: object) -> Axes:
    """The axes with limits and labels, open above and on the right; with a legend below, or where `legend` says."""
    axes.set(**labels)
    axes.spines[["top", "right"]].set_visible(False)
    if legend is None:
        return legend_below(axes)
    axes.legend(frameon=False, fontsize="small", **legend)
    return axes


def legend_below(axes: Axes, of: Axes | None = None) -> Axes:
    """Give axes a legend below them, in as many columns as there is room for; return them.

    of : the axes whose labelled curves it names, by default these
    """
    from matplotlib.font_manager import FontProperties

    last = {MOTIONS, NO_MOTIONS, NO_ORBITS, *MARKERS, *MARKERS_OF_ENDS}  # curves are named before the marks on them
    entries = list(zip(*(of or axes).get_legend_handles_labels(), strict=True))
    entries.sort(key=lambda entry: entry[1] in last and hasattr(entry[0], "get_marker"))
    inches = STYLE.widened * axes.get_window_extent().width / axes.figure.dpi
    room = 72 * inches / FontProperties(size="small").get_size_in_points()
    lengths = [STYLE.letter * len(name) + STYLE.entry for _, name in entries]
    count = rows = len(entries)
    for rows in range(1, count + 1):
        if sum(max(lengths[i : i + rows]) for i in range(0, count, rows)) <= room:
            break
    if entries:
        place = {
            "loc": "upper center",
            "bbox_to_anchor": (0.5, 0),
            "borderaxespad": STYLE.legend_below,
            "columnspacing": STYLE.columns_apart,
        }
        axes.legend(*zip(*entries, strict=True), frameon=False, fontsize="small", ncols=-(-count // rows), **place)
    return axes


def plot_phase_portrait(orbit: "Orbit", axes: Axes | None = None) -> Axes:
    """Plot speed against height of every mass over a cycle; return the axes."""
    metres, _, speeds_in = unit_labels(orbit.scales)
    axes, (_, states) = axes_or_new(axes, 4.5, 4.0), _cycle(orbit, 2001)
    for (name, (height, speed)), colour in zip(masses_at(orbit, states).items(), cycle(COLOURS), strict=False):
        axes.plot(height, speed, color=colour, lw=1.6, label=plain(name))
    axes.set_title(plain(title(orbit)), fontsize="medium", wrap=True)
    label = vertical(orbit.certificate.smallest_separation) + metres
    return finished(axes, xlabel=label, ylabel="speed" + speeds_in)


def masses_at(orbit: "Orbit", states: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Height and speed (k,) of each mass at flight states (k, n) of an orbit, by name."""
    names = orbit.flight.names[: states.shape[1]]
    moving = [i for i, name in enumerate(names) if name.endswith("'")]
    shift = np.zeros_like(states)
    shift[:, [names.index(names[i][:-1]) for i in moving]] = 1e-6 * orbit.flight_time * states[:, moving]
    heights = {name: height for name, height in orbit.shape.heights.items() if name != "centre of mass"}
    return {
        name: (height(states), (height(states + shift) - height(states - shift)) / (2e-6 * orbit.flight_time))
        for name, height in heights.items()
    }


def plot_family(family: "Family", axes: Axes | None = None, quantity: str = "alpha", label: str | None = None) -> Axes:
    """Plot a quantity of a family's orbits against the parameter, with events and ends marked; return the axes.

    Orbits that are no motions are dashed. Further families go into the same axes, each with its `label`.
    """
    axes = axes_or_new(axes, 5.6, 4.2)
    x, y, motions, others = family_curve(family, quantity)
    dashed: dict[str, Any] = {"lw": 1.4, "ls": (0, (4, 2)), "zorder": 1}
    styles: dict[str, tuple[np.ndarray, dict[str, Any]]] = {MOTIONS: (motions, {"lw": 2}), NO_MOTIONS: (others, dashed)}
    colour: dict[str, Any] = {}
    for name, (values, style) in styles.items():
        if not np.isfinite(values).any():
            continue
        own = (None if colour else label) if label else _new_entry(axes, name)
        colour = {"color": axes.plot(x, values, label=own, **colour, **style)[0].get_color()}
        if label and (entry := _new_entry(axes, name)):  # one for all families
            axes.plot([], [], color="0.15", label=entry, **style)
    _mark(axes, family, x, y)
    axes.set_title(plain(title_of_machine(family.machine)), fontsize="medium", wrap=True)
    across, up = (label_of(family.heading(name)) for name in (family.name, quantity))
    return finished(axes, xlabel=across, ylabel=up)


def _new_entry(axes: Axes, name: str) -> str | None:
    """The name of an entry of the legend; None where it has one of this name."""
    return None if name in axes.get_legend_handles_labels()[1] else name


def _mark(axes: Axes, family: "Family", x: np.ndarray, y: np.ndarray) -> None:
    """Mark the events and ends of a family at its points and events in order (k,)."""
    kinds = {i: event.kind for i, (_, event) in enumerate(family.in_order()) if event and event.kind != "value"}
    marks = [(i, kind, MARKERS.get(kind, "P"), 6.0) for i, kind in kinds.items()]
    for i, end in ends_of(family).items():
        name = NAMES_OF_ENDS.get(end.kind, end.kind)
        marks.append((i, name, MARKERS_OF_ENDS.get(name, "p"), 8.0))
    for i, name, marker, size in marks:
        style = {"marker": marker, "ls": "", "ms": size, "mfc": "white", "mew": 1.4, "zorder": 4}
        axes.plot(x[i], y[i], color="0.15", label=_new_entry(axes, plain(name)), **style)


def label_of(name: str) -> str:
    """The name of a quantity with its unit as text for a plot: without underscores, and with powers raised."""
    return re.sub(r"\^(-?\d+)", r"$^{\1}$", plain(name).replace("_", " "))


def plain(text: str) -> str:
    """A text for a label, in which a dollar sign begins no mathematics."""
    return text.replace("$", r"\$")


def family_curve(family: "Family", quantity: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The parameter (k,) at the points and events in order along a family's curve, and the quantity (k,) three times:
    of all orbits, of those that are motions, and of the others, NaN elsewhere."""
    along = family.in_order()  # admissibility changes at an event, not at a point beside it
    x, y = (family.values_at([point for point, _ in along], name) for name in ("value", quantity))
    motion = np.array([point.admissible for point, _ in along], dtype=bool)
    joint = np.array([event is not None for _, event in along], dtype=bool)
    joint[1:-1] &= motion[2:] != motion[:-2]
    return x, y, np.where(motion | joint, y, np.nan), np.where(~motion | joint, y, np.nan)


def spread(family: "Family", count: int) -> list:
    """At most `count` points of a family, evenly spaced along its curve as drawn, with the first and the last."""
    places = np.array([family.column("value"), family.column("alpha")], dtype=float)
    places /= np.maximum(np.ptp(places, axis=1, keepdims=True), 1e-300)
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(places))))
    nearest = np.abs(way - np.linspace(0.0, way[-1], count)[:, None]).argmin(1)
    return [family[int(i)] for i in np.unique(nearest)]


def thumbnails(axes: Axes, family: "Family", orbits: Iterable[tuple[Any, Any]], quantity: str = "alpha") -> Axes:
    """Draw small orbits, as pairs (point of the family, its `Orbit`), in a row above a family's axes, which are
    alone on their figure, joined to their places on the curve; return the axes."""
    from matplotlib.patches import ConnectionPatch

    orbits = sorted(orbits, key=lambda pair: pair[0].value)
    width = 1.0 / max(len(orbits), 1)
    for i, (point, orbit) in enumerate(orbits):
        small, (t, states) = axes.inset_axes((i * width, 1.12, 0.88 * width, 0.24)), _cycle(orbit, 401)
        for (name, height), colour in zip(orbit.shape.heights.items(), COLOURS, strict=False):
            if name != "centre of mass":
                small.plot(t, height(states) - height(states).min(), color=colour, lw=1)
        if orbit.contact_time is not None:
            small.axvspan(orbit.flight_time, t[-1], fc=SHADE, zorder=0)
        small.set(xticks=[], yticks=[])
        small.spines[:].set_color("0.7")
        place = point.value, family.quantity(point, quantity)
        line = ConnectionPatch((0.5, 0), place, small.transAxes, axes.transData, color="0.7", lw=0.7)
        axes.add_artist(line).set_in_layout(False)
        axes.plot(*place, ".", color="0.4", ms=5, zorder=3)
    axes.figure.suptitle(axes.get_title(), fontsize="medium", wrap=True)
    axes.set_title("")
    axes.figure.set_figheight(1.25 * axes.figure.get_figheight())
    axes.figure.draw_without_rendering()  # the axes are lower now and have other ticks, so the layout is made again
    return axes


def plot_front(front: "Front", axes: Axes | None = None) -> Axes:
    """Plot a Pareto front of two objectives; an objective "-alpha" is shown by the value of alpha. Return the axes."""
    axes = axes_or_new(axes, 5.4, 4.2)
    signs = [-1 if text.lstrip().startswith("-") else 1 for text in front.texts]
    axes.plot(*(front.values * signs).T, "o-", color=COLOURS[0], ms=4)
    texts = [text.lstrip().lstrip("-").strip() for text in front.texts]
    units = [front.designs[0].unit_of(text) for text in texts]
    labels = [label_of(text + (unit and f" ({unit})")) for text, unit in zip(texts, units, strict=True)]
    axes.set_title(plain(title_of_machine(front.machine)), fontsize="medium", wrap=True)
    return finished(axes, xlabel=labels[0], ylabel=labels[1])


def plot_design_curve(curve: "DesignCurve", axes: Axes | None = None) -> Axes:
    """Plot the objective of a curve of designs against the number that moves, with its events; return the axes."""
    axes = axes_or_new(axes, 5.4, 4.2)
    axes.plot(curve.values, curve.objectives, ".-", color=COLOURS[0], ms=5)
    for colour, kind in zip(COLOURS[1:], dict.fromkeys(event.kind for event in curve.events), strict=False):
        places = np.array([event.value for event in curve.events if event.kind == kind], float)
        heights = np.interp(places, *np.array(sorted(zip(curve.values, curve.objectives, strict=True))).T)
        axes.plot(places, heights, "o", color=colour, ms=6, label=kind)
    if curve.events:
        axes.legend()
    axes.set_title(plain(title_of_machine(curve.machine)), fontsize="medium", wrap=True)
    labels = [label_of(curve.heading(name)) for name in (curve.parameter, curve.designs[0].text)]
    return finished(axes, xlabel=labels[0], ylabel=labels[1])


def sampled_map(step: "ReturnMap", low: float, high: float, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Launch speeds (k,) between two bounds and the next ones, which are NaN where there is none or the map jumps."""
    alpha = np.linspace(low, high, samples)
    found = step(alpha)
    broken = step.jumps(found) + 1
    return np.insert(alpha, broken, np.nan), np.insert(found.next, broken, np.nan)


def cobweb(step: "ReturnMap", start: float, hops: int) -> np.ndarray:
    """The corners (2, k) of the cobweb of `hops` hops from a launch speed, fewer where there is no next launch."""
    web, here = [(start, start)], float(start)
    for _ in range(hops):
        there = float(step(here).next)
        if not np.isfinite(there):
            break
        web += [(here, there), (there, there)]
        here = there
    return np.transpose(web)


def plot_simulation(run: "Simulation", axes: Axes | None = None) -> Axes:
    """Plot heights of a simulated machine's masses against time, contacts shaded, impacts marked; return the axes.

    In metres and seconds for a machine that is stated in SI.
    """
    axes, machine, t = axes_or_new(axes), run.source, np.linspace(0, run.end, 4001)
    metres, seconds, _ = unit_labels(machine.units)
    heights, states = run.heights, run(t)
    for (name, height), colour in zip(heights.items(), COLOURS, strict=False):
        axes.plot(t, height(states), color=colour, label=plain(name), **_style(name))
    _shade_contacts(run, axes)
    impacts = [event for event in run.events if event.kind == "impact"]
    landing = int(np.argmax(machine.model.gap(machine.values).weights))
    alone = [each for each in heights.values() if np.flatnonzero(getattr(each, "weights", ())).tolist() == [landing]]
    times = [event.time for event in impacts]
    places = [min(float(height(event.after)) for height in alone or heights.values()) for event in impacts]
    if impacts:
        axes.plot(times, places, "|", color="0.2", ms=9, mew=1.4, label="impact", zorder=4)
    axes.axhline(0, color="0.4", lw=0.8)
    axes.set_title(plain(title_of_machine(machine.describe())), fontsize="medium", wrap=True)
    label = vertical(run.smallest_separation) + metres
    return finished(axes, xlim=(0, run.end), xlabel="time" + seconds, ylabel=label)


def plot_gap(run: "Simulation", axes: Axes | None = None, label: str | None = None) -> Axes:
    """Plot the gap of a simulated machine against time, as the foot path in Fig. 6 of the paper; return the axes."""
    axes, t = axes_or_new(axes), np.linspace(0, run.end, 4001)
    metres, seconds, _ = unit_labels(run.source.units)
    axes.plot(t, run.gap(run(t)), color=COLOURS[1], lw=2, label=label)
    _shade_contacts(run, axes)
    axes.set_title(plain(title_of_machine(run.source.describe())), fontsize="medium", wrap=True)
    return finished(axes, xlim=(0, run.end), xlabel="time" + seconds, ylabel="gap" + metres)


def _shade_contacts(run, axes):
    contacts, closed = [leg for leg in run.legs if leg.phase == "contact"], phases_in_words(run.source)[1]
    for i, leg in enumerate(contacts):
        ends = leg.start, leg.start + leg.path.times[-1]
        axes.axvspan(*ends, fc=SHADE, zorder=0, label=None if i else closed)


def title(orbit: "Orbit") -> str:
    """The title of an orbit's plot: machine, family and speed in one line, the laws in another."""
    speed = f"alpha = {orbit.alpha:.6g}" + (f" {orbit.scales.text(LIFTOFF_SPEED)}" if orbit.scales else "")
    kind = "" if orbit.admissible else " (inadmissible)"
    return f"{orbit.machine['machine']}, family {orbit.family}, {speed}{kind}\n{laws_in_words(orbit.machine)}"


def vertical(separation: float | None) -> str:
    """The name of the vertical axis; where nothing says how far the masses are apart, the upper one has a displacement
    and no height."""
    return "height" if separation is not None else "displacement"


def save_figure(axes: Axes, path: str | Path) -> Path:
    """Write the figure of some axes to a file, its kind from the ending; raises `InputError` when it cannot."""
    path = check_path(path, FIGURES)
    drawn = BytesIO()  # Matplotlib's writers do not all end well where a disk is full
    axes.figure.savefig(drawn, format=path.suffix[1:].lower(), dpi=STYLE.resolution)
    with writing("figure", path) as target:
        target.write_bytes(drawn.getvalue())
    return path
