"""What makes a figure hard to read, found from what matplotlib would draw."""

from itertools import combinations

import numpy as np
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.path import Path
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from orbits.show import STYLE
from orbits.show.canvas import set_width

SMALLEST = 6.0  # points, of type in a journal
SLACK = 1.0  # pixels by which boxes may overlap: a text's box is a little wider than its letters


def faults(figure) -> list[str]:
    """The faults of a figure in words, as it is and as wide as a column of a journal: small type, texts that leave it,
    meet each other or lie on a curve, axes without a name, legends whose entries are not the artists drawn, and curves
    under a legend."""
    found, size = _faults_now(figure), figure.get_size_inches()
    places = {axes: place for axes in figure.axes if (place := axes.get_subplotspec())}
    set_width(figure.axes[0], STYLE.column)
    found += [f"in a column: {fault}" for fault in _faults_now(figure)]
    for axes, place in places.items():
        axes.set_subplotspec(place)
    figure.set_size_inches(size)
    return found


def _faults_now(figure) -> list[str]:
    _draw(figure)
    boxes = [(text.get_text(), text.get_window_extent()) for text in _texts(figure)]
    sizes = {text.get_text(): text.get_fontsize() for text in _texts(figure)}
    found = [f"{words!r} has {size:.1f} points" for words, size in sizes.items() if size < SMALLEST]
    found += [f"{words!r} leaves the figure" for words, box in boxes if not _inside(box, figure.bbox)]
    found += [f"{a!r} meets {b!r}" for (a, one), (b, other) in combinations(boxes, 2) if _meet(one, other)]
    curves = [(axes, path) for axes in figure.axes if axes.get_visible() for path in _curves(axes)]
    found += [f"{words!r} lies on a curve" for words, box in boxes if any(_crossed(box, *each) for each in curves)]
    for axes in (each for each in figure.axes if each.axison and each.get_visible()):
        found += _faults_of_legend(axes)
        for which in ("x", "y"):
            if getattr(axes, f"get_{which}ticks")().size and not _is_named(axes, which):
                found.append(f"the {which} axis of {axes.get_title()!r} has no name")
    return found


def _curves(axes) -> list[Path]:
    """The curves that are drawn on axes, in pixels."""
    lines = [line for line in axes.lines if line.get_visible() and line.get_linestyle() != "None"]
    found = [line.get_transform().transform_path(line.get_path()) for line in lines]
    for several in axes.collections:
        if isinstance(several, LineCollection) and several.get_visible():
            found += [several.get_transform().transform_path(path) for path in several.get_paths()]
    return found


def _crossed(box: Bbox, axes, curve: Path) -> bool:
    """Whether a curve passes through a text's box, as far as this lies within the axes."""
    inside = Bbox.intersection(box.padded(-SLACK), axes.bbox)
    return inside is not None and min(inside.size) > SLACK and curve.intersects_bbox(inside, filled=False)


def smallest_text(figure, width: float) -> float:
    """The smallest font size of a figure, in pixels, where the figure is shown this many pixels wide."""
    _draw(figure)
    return min(text.get_fontsize() for text in _texts(figure)) / 72 * width / figure.get_size_inches()[0]


def _draw(figure) -> None:
    """Place all that is drawn, where it has changed since."""
    if figure.stale:
        figure.draw_without_rendering()


def _texts(figure) -> list[Text]:
    """The texts that are drawn; ticks beyond the limits of an axis have texts that are not."""
    beyond = set()
    for axes in figure.findobj(lambda artist: hasattr(artist, "xaxis")):
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            slack = 1e-9 * (high - low)
            shown = axes.axison and axis.get_visible() and axes.get_visible()
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                if not (shown and low - slack <= tick.get_loc() <= high + slack):
                    beyond |= {tick.label1, tick.label2}
            if not shown:
                beyond |= {axis.label, axis.offsetText}
    drawn = (text for text in figure.findobj(Text) if text.get_visible() and text not in beyond)
    return [text for text in drawn if text.get_text().strip()]


def _inside(box: Bbox, outer: Bbox) -> bool:
    return bool((box.min >= outer.min - SLACK).all() and (box.max <= outer.max + SLACK).all())


def _meet(one: Bbox, other: Bbox) -> bool:
    return bool((np.minimum(one.max, other.max) - np.maximum(one.min, other.min) > SLACK).all())


def _is_named(axes, which: str) -> bool:
    """Whether an axis, or one that shares its place in the same row or column of the figure, has a name."""
    if getattr(axes, f"get_{which}label")() or not any(
        label.get_text() and label.get_visible() for label in getattr(axes, f"get_{which}ticklabels")()
    ):
        return True
    place = {"x": "x0", "y": "y0"}[which]
    here = getattr(axes.get_position(), place)
    return any(
        getattr(other, f"get_{which}label")()
        and abs(getattr(other.get_position(), {"x": "x0", "y": "y0"}[which]) - here) < 0.01
        for other in axes.figure.axes
    )


def _faults_of_legend(axes) -> list[str]:
    legend, (handles, labels) = axes.get_legend(), axes.get_legend_handles_labels()
    if legend is None:
        return []
    if not labels:  # the lowest of several panels has the legend of those above
        panels = axes.get_shared_x_axes().get_siblings(axes)
        handles = [handle for panel in panels for handle in panel.get_legend_handles_labels()[0]]
        labels = [handle.get_label() for handle in handles]
    entries, found = [text.get_text() for text in legend.get_texts()], []
    if sorted(entries) != sorted(set(labels)):
        found.append(f"the legend has {entries} of {labels}")
    found += [
        f"nothing of {label!r} is drawn"
        for handle, label in zip(handles, labels, strict=True)
        if not (_drawn(handle) or _names_a_style(handle, axes))
    ]
    box = legend.get_window_extent().padded(-2)
    for line in axes.lines:
        points = _points(line)
        if line.get_visible() and ((points >= box.min) & (points <= box.max)).all(axis=1).any():
            found.append(f"the curve {line.get_label()!r} runs under the legend of {axes.get_title()!r}")
    return found


def _drawn(handle) -> bool:
    """Whether anything of a labelled curve or of marks lies within its axes; areas are taken as they are."""
    if isinstance(handle, Line2D | PathCollection):
        return len(_points(handle)) > 0
    return True


def _names_a_style(handle, axes) -> bool:
    """Whether a grey entry without points stands for the dashes of curves that are drawn, whatever their colour."""
    if not isinstance(handle, Line2D) or len(handle.get_xydata()) or len({*to_rgb(handle.get_color())}) > 1:
        return False
    alike = (line for line in axes.lines if line.get_linestyle() == handle.get_linestyle() and len(line.get_xydata()))
    return any(len(_points(line)) for line in alike)


def _points(artist) -> np.ndarray:
    """Points (k, 2) of a curve or of marks within its axes, in pixels, those of a curve close to each other."""
    if isinstance(artist, Line2D):
        data = artist.get_transform().transform(artist.get_xydata())
        if artist.get_linestyle() != "None" and len(data) > 1:
            data = np.linspace(data[:-1], data[1:], 20, axis=1).reshape(-1, 2)
    else:
        data = artist.get_offset_transform().transform(artist.get_offsets())
    inside = artist.axes.bbox.padded(SLACK)
    kept = np.isfinite(data).all(axis=1)
    data = data[kept]
    return data[((data >= inside.min) & (data <= inside.max)).all(axis=1)]
