"""Plots of orbits, families and diagrams: axes in, axes out; matplotlib is imported only when something is drawn.

Results draw themselves by these functions through `orbits.result.shown`; only the type checker imports their
types.
"""

from collections.abc import Iterable
from itertools import cycle
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..model import Affine
from ..result import Axes
from ..units import LIFTOFF_SPEED
from .canvas import axes_or_new, entitled, finished, headline
from .family_ends import MARKERS_OF_ENDS, NAMES_OF_ENDS, ends_of
from .style import (
    COLOURS,
    MARKERS,
    MOTIONS,
    NO_MOTIONS,
    SHADE,
    STYLE,
    label_of,
    machine_title,
    numbers_of,
    plain,
    unit_labels,
    value_of,
)

if TYPE_CHECKING:
    from ..continuation import Family
    from ..design import DesignCurve, Front
    from ..hops import Simulation
    from ..periodic import Orbit
    from ..returns import ReturnMap


class Drawn(NamedTuple):
    """How much is drawn in figures and animations, those of machines in the plane among them."""

    stage_samples: int = 401  # times of a stage at which its curves are drawn
    cycles_of_map: int = 12  # that are drawn in a map: more would not be distinguished
    destinations: float = 0.05  # height of the bar that shows them, as a share of the axes
    most_bars: int = 300  # intervals of launches that are drawn as bars; of more, their share in bins is drawn
    bins: int = 1000
    least_share: float = 1e-4  # of launches that are chaotic or undecided, below which they are left out next to a map
    # Dashes of curves of bifurcations, one for each doubling of the period.
    dashes_at_borders: tuple = ((0, (1, 1.3)), (0, (1, 2)), (0, (1, 3)), (0, (1, 4)))
    contours: int = 8  # of a map of results
    width_of_bar: float = 0.38  # whose neighbours are 1 apart
    bars: int = 40  # of a histogram, at most
    cycles_onward: int = 4  # of a machine that goes on in an animation, which shows two of one that comes back
    swing_instants: int = 9  # of a swing from hold to hold, drawn over one another
    times_of_cycle: int = 60  # of a machine on a page
    cycles_on_page: int = 12  # until a machine looks as at first, at most
    alike: float = 1e-6  # share of its size by which a machine that looks as at first differs
    cycles_behind: int = 2  # whose path is drawn behind a machine on a page
    gap: float = 1.2  # from instant to instant side by side, in widths of the machine
    apart: float = 0.33  # the least gap in heights of the machine, which leaves room for the times


DRAWN = Drawn()


def angles_shown(orbit: "Orbit", drawn: bool = False) -> tuple[str, ...]:
    """The coordinates of an orbit whose machine turns and is shown by its angles: where these are its heights, or where
    it is `drawn` next to them; none of another."""
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
        axes.plot(t, height(states), color=colour, label=label_of(name), **_style(name))
    if orbit.contact_time is not None:
        closed = phases_in_words(orbit.source)[1]
        axes.axvspan(orbit.flight_time, t[-1], fc=SHADE, ec="0.7", lw=0.5, label=closed, zorder=0)
    axes.axhline(0, color="0.4", lw=0.8)
    entitled(axes, title(orbit))
    label = "angle" if angles_shown(orbit) else vertical(orbit.certificate.smallest_separation) + metres
    return finished(axes, xlim=(0, t[-1]), xlabel="time" + seconds, ylabel=label)


def _style(name: str) -> dict[str, object]:
    """The style of a mass's height: full, and that of the centre of mass dashed."""
    return {"lw": 1.2, "ls": (0, (5, 2))} if name == "centre of mass" else {"lw": STYLE.line}


def _cycle(orbit, count: int):
    """Times over a cycle, or over the flight where the contact does not end, and the states then."""
    t = np.linspace(0, orbit.flight_time if orbit.contact_time is None else orbit.period, count)
    return t, states_to_show(orbit, t)


def states_to_show(orbit: "Orbit", t: np.ndarray) -> np.ndarray:
    """Flight states (k, n) of an orbit at times (k,): of a machine that steps in the labels of the first flight, where
    all heights are sums of coordinates, so that they do not jump at a landing."""
    return orbit.unrolled(t) if all(isinstance(each, Affine) for each in orbit.shape.heights.values()) else orbit(t)


def plot_phase_portrait(orbit: "Orbit", axes: Axes | None = None) -> Axes:
    """Plot speed against height of every mass over a cycle; return the axes."""
    metres, _, speeds_in = unit_labels(orbit.scales)
    axes, (_, states) = axes_or_new(axes, 0.85), _cycle(orbit, 2001)
    for (name, (height, speed)), colour in zip(masses_at(orbit, states).items(), cycle(COLOURS), strict=False):
        axes.plot(height, speed, color=colour, lw=1.6, label=label_of(name))
    entitled(axes, title(orbit))
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

    Orbits that are not motions are dashed. Further families go into the same axes, each with its `label`.
    """
    axes = axes_or_new(axes, 0.75)
    x, y, motions, others = family_curve(family, quantity)
    dashed: dict[str, Any] = {"lw": 1.4, "ls": (0, (4, 2)), "zorder": 1}
    styles: dict[str, tuple[np.ndarray, dict[str, Any]]] = {
        MOTIONS: (motions, {"lw": STYLE.line}),
        NO_MOTIONS: (others, dashed),
    }
    colour: dict[str, Any] = {}
    for name, (values, style) in styles.items():
        places = np.flatnonzero(np.isfinite(values))
        if not len(places):
            continue
        own = (None if colour else label) if label else _new_entry(axes, name)
        colour = {"color": axes.plot(x, values, label=own, **colour, **style)[0].get_color()}
        if label and (entry := _new_entry(axes, name)):  # one for all families, a line of one point
            axes.plot(x[places[:1]], values[places[:1]], color="0.15", label=entry, **style)
    _mark(axes, family, x, y)
    headline(axes, family.machine, without=(family.name,))
    across, up = (label_of(name, family.unit_of(name)) for name in (family.name, quantity))
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
    for i, name, marker, size in (each for each in marks if np.isfinite(y[each[0]])):
        style = {"marker": marker, "ls": "", "ms": size, "mfc": "white", "mew": 1.4, "zorder": 4}
        axes.plot(x[i], y[i], color="0.15", label=_new_entry(axes, plain(name)), **style)


def family_curve(family: "Family", quantity: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The parameter (k,) at the points and events in order along a family's curve, and the quantity (k,) three times:
    of all orbits, of the motions, and of the others, NaN elsewhere."""
    along = family.in_order()  # admissibility changes at an event, not at a point next to it
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
    entitled(axes, axes.get_title()).title.set_y(1.4)
    axes.figure.set_figheight(1.25 * axes.figure.get_figheight())
    axes.figure.draw_without_rendering()  # the axes are lower now and have other ticks, so the layout is made again
    return axes


def plot_front(front: "Front", axes: Axes | None = None) -> Axes:
    """Plot a Pareto front of two objectives; an objective "-alpha" is shown by the value of alpha. Return the axes."""
    axes = axes_or_new(axes, 0.75)
    signs = [-1 if text.lstrip().startswith("-") else 1 for text in front.texts]
    axes.plot(*(front.values * signs).T, "o-", color=COLOURS[0], ms=4)
    texts = [text.lstrip().lstrip("-").strip() for text in front.texts]
    units = [front.designs[0].unit_of(text) for text in texts]
    labels = [label_of(text, unit) for text, unit in zip(texts, units, strict=True)]
    headline(axes, front.machine)
    return finished(axes, xlabel=labels[0], ylabel=labels[1])


def plot_design_curve(curve: "DesignCurve", axes: Axes | None = None) -> Axes:
    """Plot the objective of a curve of designs against the number that moves, with its events; return the axes."""
    axes = axes_or_new(axes, 0.75)
    axes.plot(curve.values, curve.objectives, ".-", color=COLOURS[0], ms=5)
    mark_events(axes, curve.values, curve.objectives, curve.events)
    headline(axes, curve.machine, without=(curve.parameter,))
    labels = [label_of(name, curve.unit_of(name)) for name in (curve.parameter, curve.designs[0].text)]
    return finished(axes, xlabel=labels[0], ylabel=labels[1])


def mark_events(axes: Axes, x: ArrayLike, y: ArrayLike, events: Iterable[Any]) -> None:
    """Mark events, which have a value of x and a kind, on a curve with points x and y (k,): a colour for each kind."""
    kinds: dict[str, list[float]] = {}
    for event in events:
        kinds.setdefault(event.kind, []).append(event.value)
    for colour, (kind, places) in zip(COLOURS[1:], kinds.items(), strict=False):
        heights = np.interp(places, *np.array(sorted(zip(np.asarray(x), np.asarray(y), strict=True))).T)
        axes.plot(places, heights, "o", color=colour, ms=6, label=plain(kind))


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
        axes.plot(t, height(states), color=colour, label=label_of(name), **_style(name))
    _shade_contacts(run, axes)
    impacts = [event for event in run.events if event.kind == "impact"]
    landing = int(np.argmax(machine.model.gap(machine.values).weights))
    alone = [each for each in heights.values() if np.flatnonzero(getattr(each, "weights", ())).tolist() == [landing]]
    times = [event.time for event in impacts]
    places = [min(float(height(event.after)) for height in alone or heights.values()) for event in impacts]
    if impacts:
        axes.plot(times, places, "|", color="0.2", ms=9, mew=1.4, label="impact", zorder=4)
    axes.axhline(0, color="0.4", lw=0.8)
    headline(axes, machine.describe())
    label = vertical(run.smallest_separation) + metres
    return finished(axes, xlim=(0, run.end), xlabel="time" + seconds, ylabel=label)


def plot_gap(run: "Simulation", axes: Axes | None = None, label: str | None = None) -> Axes:
    """Plot the gap of a simulated machine against time, as the foot path in Fig. 6 of the paper; return the axes."""
    axes, t = axes_or_new(axes), np.linspace(0, run.end, 4001)
    metres, seconds, _ = unit_labels(run.source.units)
    axes.plot(t, run.gap(run(t)), color=COLOURS[1], lw=STYLE.line, label=label)
    _shade_contacts(run, axes)
    headline(axes, run.source.describe())
    return finished(axes, xlim=(0, run.end), xlabel="time" + seconds, ylabel="gap" + metres)


def _shade_contacts(run, axes):
    contacts, closed = [leg for leg in run.legs if leg.phase == "contact"], phases_in_words(run.source)[1]
    for i, leg in enumerate(contacts):
        ends = leg.start, leg.start + leg.path.times[-1]
        axes.axvspan(*ends, fc=SHADE, zorder=0, label=None if i else closed)


def title(orbit: "Orbit", numbers: bool = True) -> str:
    """The title of an orbit's plot: machine, family and launch speed in one line, its laws, with its numbers, below."""
    speed = value_of("alpha", orbit.alpha, orbit.scales.text(LIFTOFF_SPEED) if orbit.scales else "")
    kind = "" if orbit.admissible else " (inadmissible)"
    without = () if numbers else numbers_of(orbit.machine)
    return machine_title(orbit.machine, f", family {orbit.family}, {speed}{kind}", without)


def vertical(separation: float | None) -> str:
    """The name of the vertical axis; where nothing says how far the masses are apart, the upper one has a displacement
    and no height."""
    return "height" if separation is not None else "displacement"
