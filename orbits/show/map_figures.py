"""Figures of the return map: with a cobweb, of its basins, and of bifurcations; in SI where the machine is."""

from collections.abc import Iterable, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, finite_number, true_or_false
from ..result import Axes
from ..returns import CHAOS, UNDECIDED, WORDS_OF_STABILITY, name_of_hops
from ..units import LIFTOFF_SPEED
from .canvas import axes_or_new, entitled, finished, headline
from .plot import DRAWN, cobweb, sampled_map
from .style import COLOURS, STYLE, label_of

if TYPE_CHECKING:
    from ..returns import Hops, ReturningHops, ReturnMap

COLOURS_OF_OTHERS = {CHAOS: "0.45", UNDECIDED: "0.15"}  # of what launches come to besides hops, in `Basins`
IDENTITY: dict[str, object] = {"color": "0.6", "lw": 0.8, "zorder": 1}
# Markers of fixed points: full where they attract, open where they do not, half where they attract from above only.
STYLES_OF_POINTS: dict[str, dict[str, object]] = {
    "stable": {"mfc": "0.15"},
    "unstable": {"mfc": "white"},
    "lossless, attracts from above": {"fillstyle": "right", "mfc": "0.15", "markerfacecoloralt": "white"},
}
STYLES_OF_STABILITY: dict[bool | None, dict[str, object]] = {
    True: {"lw": STYLE.line},
    False: {"lw": 1.3, "ls": (0, (4, 2))},
    None: {"lw": 1.3, "ls": (0, (1, 2))},
}
LOOKS_OF_EVENTS = {
    **{"flip": "o", "fold": "s", "branch point": "D", "border collision": "X", "non-smooth fold": "v"},
    "Neimark-Sacker": "P",
}


def plot_map(
    step: "ReturnMap", low: float, high: float, axes: Axes | None = None, samples: int = 4000,
    start: float | None = None, hops: int = 60, fixed_points: bool = True,
) -> Axes:  # fmt: skip
    """Plot the return map between two launch speeds, with the identity line; return the axes.

    step : a `ReturnMap`
    start, hops : launch speed from which a cobweb is drawn, None for no cobweb, and its number of hops
    fixed_points : mark the fixed points of the map too
    """
    axes = _drawn_map(step, low, high, axes_or_new(axes, 0.95), samples)
    if start is not None:
        axes.plot(*cobweb(step, finite_number("start", start), hops), color=COLOURS[1], lw=0.9, label=f"from {start:g}")
    if true_or_false("fixed_points", fixed_points):
        _mark(axes, [(point.alpha, _stability(point)) for point in step.fixed_points(low, high)])
    headline(axes, step.machine.describe(), ", return map")
    return _labelled_map(axes, step, low, high)


def plot_hops(hops: "Hops", axes: Axes | None = None) -> Axes:
    """Plot the next launch speeds of `Hops` against their launch speeds, with the identity line; return the axes."""
    axes = axes_or_new(axes, 0.95)
    ends = [float(np.nanmin(hops.alpha)), float(np.nanmax(hops.alpha))]
    axes.plot(ends, ends, label="identity", **IDENTITY)
    axes.plot(np.ravel(hops.alpha), np.ravel(hops.next), ".", color=COLOURS[0], label="hops")
    across, up = (label_of(name, hops.unit_of(name)) for name in ("alpha", "next"))
    return finished(axes, xlabel=across, ylabel=up)


def _drawn_map(step: "ReturnMap", low: float, high: float, axes: Axes, samples: int) -> Axes:
    """The identity line and the map, broken where it jumps."""
    axes.plot([low, high], [low, high], label="identity", **IDENTITY)
    axes.plot(*sampled_map(step, low, high, samples), color=COLOURS[0], lw=1.6, label="map")
    return axes


def _labelled_map(axes: Axes, step: "ReturnMap", low: float, high: float) -> Axes:
    unit = step.machine.units.text(LIFTOFF_SPEED) if step.machine.units else ""
    labels: dict[str, Any] = {"xlabel": label_of("alpha", unit), "ylabel": label_of("next", unit)}
    lowest = float(np.nanmin(np.hstack([line.get_ydata() for line in axes.lines])))
    bottom = 0.0 if lowest < 0.3 * high else lowest - 0.05 * (high - lowest)
    return finished(axes, xlim=(low, high), ylim=(bottom, high), **labels)


def _stability(point: "ReturningHops") -> str:
    """The name of a fixed point's stability in a legend."""
    if point.kind == "lossless":
        return "lossless, attracts from above"
    return "stable" if point.stable else "unstable"


def _mark(axes: Axes, points: list[tuple[float, str]]) -> None:
    """Mark fixed points on the identity line, each kind with one entry in the legend."""
    for kind, style in STYLES_OF_POINTS.items():
        if here := [alpha for alpha, other in points if other == kind]:
            axes.plot(here, here, "o", ms=6, mec="0.15", mew=1.2, zorder=4, label=kind, **style)


def plot_basin(step: "ReturnMap", low: float, high: float, axes: Axes | None, hops: int, samples: int) -> Axes:
    """Plot which launches between two speeds come to which hop, as a bar below the map; the legend states what share of
    the range comes to each, and the title what share comes to any; return the axes.

    step : a `ReturnMap`
    hops, samples : as in `ReturnMap.basins`
    """
    basins, width = step.basins(low, high, hops, samples), high - low
    unit = f" {step.machine.units.text(LIFTOFF_SPEED)}" if step.machine.units else ""
    axes = _drawn_map(step, low, high, axes_or_new(axes, 0.82), 4000)
    inside, below = axes.get_xaxis_transform(), np.zeros(DRAWN.bins + 1)
    few = _are_few(each.intervals for each in basins.attracting)
    for each, colour in zip(basins.destinations, _colours(basins), strict=True):
        share = sum(b - a for a, b in each.intervals) / width
        if not each.is_hop and (each.kind not in COLOURS_OF_OTHERS or share < DRAWN.least_share):
            continue
        name = f"to {', '.join(f'{alpha:.6g}' for alpha in each.launches)}{unit}" if each.is_hop else each.words
        options = {"transform": inside, "label": f"{name}: {100 * share:.3g}%"}
        below = _spans(axes, each.intervals, basins, below, DRAWN.destinations, colour, few, **options)
        if each.is_hop and few:
            spans = [(a, b - a) for a, b in each.intervals]
            span = DRAWN.destinations, 1 - DRAWN.destinations
            axes.broken_barh(spans, span, fc=colour, ec="none", transform=inside, alpha=0.12, zorder=0)
        for alpha in (alpha for alpha in each.launches if each.is_hop and low <= alpha <= high):
            following = float(step(alpha).next) if each.kind == "stable" else alpha
            axes.plot(alpha, following, "o", color=colour, mec="0.15", ms=6, zorder=4)
    total = basins.share * width
    part = f"{basins.at_least}{100 * total / width:.3g}%"
    words = f"{part} come to {basins.goal}: {total:.6g} of {width:.6g}{unit}"
    entitled(axes, words if basins else f"no launch here comes to {basins.goal}")
    return _labelled_map(axes, step, low, high)


def plot_basins(basins: Any, axes: Axes | None = None) -> Axes:
    """Plot `Basins` as bars over the launch speeds, a row for each hop and for each other end of launches; return the
    axes. Of very many intervals the height shows their share."""
    rows = basins.destinations
    axes = axes_or_new(axes, 0.25 + 0.08 * max(1, len(rows)))
    for i, (each, colour) in enumerate(zip(rows, _colours(basins), strict=True)):
        _spans(axes, each.intervals, basins, i - 0.35, 0.7, colour, _are_few([each.intervals]))
        for alpha in (alpha for alpha in each.launches if each.is_hop and basins.low <= alpha <= basins.high):
            axes.plot(alpha, i, "o", color=colour, mec="0.15", ms=6, zorder=4)
    axes.set_yticks(range(len(rows)), [f"{each.launches[0]:.6g}" if each.is_hop else each.kind for each in rows])
    entitled(axes, f"{basins.at_least}{basins.share:.3%} of the launches come to {basins.goal}")
    label = label_of("alpha", basins.unit_of("alpha"))
    axes.set(xlim=(basins.low, basins.high), ylim=(-0.6, max(1, len(rows)) - 0.4), xlabel=label, ylabel="comes to")
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def plot_intervals(found: Any, axes: Axes | None = None) -> Axes:
    """Plot `LaunchIntervals` as bars over the launch speeds; return the axes."""
    axes = axes_or_new(axes, 0.3)
    _spans(axes, found.intervals, found, 0.0, 1.0, COLOURS[1], _are_few([found.intervals]))
    entitled(axes, f"{found.share:.3%} of the launches")
    axes.set(xlim=(found.low, found.high), ylim=(0, 1.2), xlabel=label_of("alpha", found.unit_of("alpha")))
    axes.set_yticks([])
    axes.spines[["top", "right", "left"]].set_visible(False)
    return axes


def _colours(basins: Any) -> list[Any]:
    """The colour of each destination of `Basins`."""
    hops = cycle(COLOURS[1:])
    return [next(hops) if each.is_hop else COLOURS_OF_OTHERS.get(each.kind, "0.8") for each in basins.destinations]


def _are_few(parts: Iterable[Sequence[tuple[float, float]]]) -> bool:
    """Whether intervals are so few that each is drawn."""
    return sum(map(len, parts)) <= DRAWN.most_bars


def _spans(
    axes: Axes, intervals: Sequence[tuple[float, float]], within: Any, bottom: Any, height: float, colour: Any,
    few: bool, **options: Any,
) -> Any:  # fmt: skip
    """Draw intervals as bars from a bottom, or unless they are few their share of narrow bins of the range as a height;
    return the bottom of bars that lie above these."""
    style = {"fc": colour, "ec": colour, "lw": 0.4, "zorder": 3, **options}
    if few:
        axes.broken_barh([(a, b - a) for a, b in intervals], (float(np.max(bottom)), height), **style)
        return bottom
    edges, ends = np.linspace(within.low, within.high, DRAWN.bins + 1), np.ravel(intervals)
    below = np.repeat(np.cumsum(np.diff(np.reshape(ends, (-1, 2)))[:, 0]), 2)
    below[::2] -= np.diff(np.reshape(ends, (-1, 2)))[:, 0]
    share = np.diff(np.interp(edges, ends, below)) / np.diff(edges)
    top = bottom + height * np.append(share, share[-1])
    axes.fill_between(edges, bottom, top, step="post", **{**style, "lw": 0})
    return top


def plot_periodic_hops(hops: Any, axes: Axes | None = None) -> Axes:
    """Plot each cycle of `PeriodicHops` as its itinerary, the launch speed against the hop up to the first launch
    again, stable ones as a line and others dashed, with the ends of the map's monotone branches; return the axes."""
    axes = axes_or_new(axes)
    for branch in hops.branches:
        axes.axhline(branch.low, color="0.85", lw=0.8, zorder=0)
    shown, count = hops.cycles[: DRAWN.cycles_of_map], np.arange(hops.period + 1)
    for each, colour in zip(shown, cycle(COLOURS[1:])):
        label = f"{' '.join(map(str, each.itinerary))}: {WORDS_OF_STABILITY[each.stable]}"
        style = "o-" if each.stable else "o--"
        axes.plot(count, [*each.alphas, each.alpha], style, color=colour, ms=4, lw=1.0, label=label)
    axes.set_xticks(count)
    return finished(axes, xlabel="hop", ylabel=label_of("alpha", hops.unit_of("alpha")))


def plot_bifurcations(diagram: Any, axes: Axes | None = None) -> Axes:
    """Plot the periodic launches of a `BifurcationDiagram` against its parameter: stable ones as a line, unstable ones
    dashed, over the launches that are visited in the long run, with its events marked; return the axes."""
    axes = axes_or_new(axes, 0.75)
    if not (len(diagram.branches) or len(diagram.visits)):
        raise InputError("nothing to draw: no launch in this range comes back")
    if len(diagram.visits):
        axes.plot(*diagram.visits.T, ".", ms=1.2, mew=0, color="0.55", zorder=1, rasterized=True)
        axes.plot(*diagram.visits[:1].T, "o", color="0.55", ms=3, label="visited in the long run", zorder=1)
    known: set[str] = set()
    for branch in diagram.branches:
        colour, words = (
            COLOURS[(branch.period - 1) % len(COLOURS)],
            name_of_hops(branch.period).removeprefix("hops of "),
        )
        for first, last, stable in branch.parts():
            label, part = f"{words}, {WORDS_OF_STABILITY[stable]}", slice(first, last + 1)
            for alphas in branch.alphas[part].T:
                style = {"color": colour, "label": None if label in known else label, "zorder": 2}
                axes.plot(branch.values[part], alphas, **style, **STYLES_OF_STABILITY[stable])
                known.add(label)
    for event in diagram.events:
        name = None if event.kind in known else event.kind
        places = np.full(len(event.alphas), event.value)
        axes.plot(places, event.alphas, LOOKS_OF_EVENTS[event.kind], color="0.15", mfc="white", ms=6, mew=1.4,
                  label=name, zorder=4, clip_on=False)  # fmt: skip
        known.add(event.kind)
    headline(axes, diagram.machine, ", return map", (diagram.along,))
    across, up = (label_of(name, diagram.unit_of(name)) for name in (diagram.along, "alpha"))
    drawn = np.concatenate([diagram.visits[:, 1], *(branch.alphas.ravel() for branch in diagram.branches)])
    margin = 0.05 * (np.ptp(drawn) or np.ptp(diagram.between))
    ends = (float(drawn.min() - margin), float(drawn.max() + margin))
    return finished(axes, xlim=diagram.span, ylim=ends, xlabel=across, ylabel=up)
