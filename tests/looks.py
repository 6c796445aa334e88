"""What a figure looks like, as lines of text: axes, curves, areas, marks and legends with their styles and extents."""

from difflib import ndiff

import numpy as np
from legibility import faults
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import Collection
from matplotlib.colors import to_hex
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.spines import Spine
from matplotlib.text import Text
from recorded import known

FEW = 30  # of more numbers the count may differ, as that of a family's points


def check_looks(name: str, figure, draw: bool = True) -> None:
    """Hold a figure against its recorded looks; an animation would begin anew where it is drawn."""
    found = faults(figure) if draw else []
    assert not found, found
    if draw and figure.stale:
        figure.draw_without_rendering()
    found = [_number(figure.get_size_inches()), *(line for axes in figure.findobj(Axes) for line in _of_axes(axes))]
    changes = [line for line in ndiff(known("looks", name, found), found) if line[0] in "+-"]
    assert not changes, "\n".join(changes)


def _number(values) -> str:
    """Numbers with four digits; those that are rounding of 0 are 0, and halves go to one side."""
    values = np.ravel(np.ma.filled(np.ma.asarray(values, dtype=float), np.nan))
    return " ".join(f"{0.0 if abs(each) < 1e-6 else each * (1 + 1e-9):.4g}" for each in values.tolist())


def _extent(values) -> str:
    """How many numbers there are, if few, and how many of them are finite; the first, the least, the largest and the
    last."""
    values = np.ravel(np.ma.filled(np.ma.asarray(values, dtype=float), np.nan))
    finite = values[np.isfinite(values)]
    ends = _number([finite[0], finite.min(), finite.max(), finite[-1]]) if len(finite) else ""
    counts = f"{len(values)} {len(finite)}" if len(values) <= FEW else "many"
    return f"{counts} [{ends}]"


def _colour(colours) -> str:
    rows = np.reshape(colours, (-1, 4)) if not isinstance(colours, str | tuple) else [colours]
    return " ".join(dict.fromkeys(to_hex(each, keep_alpha=True) for each in list(rows)[:8])) or "none"


def _of_axes(axes: Axes) -> list[str]:
    legend = axes.get_legend()
    spines = "".join(name[0] for name, spine in axes.spines.items() if spine.get_visible())
    lines = [
        f"axes {axes.get_title()!r} {axes.get_title('left')!r} x {axes.get_xlabel()!r} {axes.get_xscale()} "
        f"{_number(axes.get_xlim())} y {axes.get_ylabel()!r} {axes.get_yscale()} {_number(axes.get_ylim())} "
        f"spines {spines} ground {_colour(axes.get_facecolor())}{'' if axes.axison else ' off'}"
    ]
    frame = axes.patch, axes.title, axes._left_title, axes._right_title
    artists = [each for each in axes.get_children() if each.get_visible() and each not in frame]
    artists.sort(key=lambda each: each.get_zorder())
    lines += [_of_artist(each) for each in artists if isinstance(each, Line2D | Collection | Patch | Text)]
    if legend:
        words, size = [text.get_text() for text in legend.get_texts()], legend.get_texts()[0].get_fontsize()
        lines.append(
            f"legend {words} ncols {legend._ncols} size {_number(size)} frame {legend.get_frame_on()} at {legend._loc} "
            f"{_number([legend.borderaxespad, legend.columnspacing, legend.markerscale])}"
        )
    return lines


def _of_artist(artist) -> str:
    """One line of an artist."""
    label = str(artist.get_label() or "_")
    label = "" if label.startswith("_") else repr(label)
    kinds = {Line2D: "curve", Spine: "spine", Patch: "area", Text: "text", Collection: "collection"}
    kind = next(name for own, name in kinds.items() if isinstance(artist, own))
    own = f"{kind} {label} z {_number(artist.get_zorder())} alpha {artist.get_alpha()} "
    own += f"clip {artist.get_clip_on()} raster {artist.get_rasterized()} "
    if isinstance(artist, Text):
        words, at = artist.get_text(), artist.get_position()
        return f"{own}{words!r} {_number(at)} {_number(artist.get_fontsize())}"
    if isinstance(artist, Line2D):
        marks = f"{artist.get_marker()} {_number(artist.get_markersize())} {_number(artist.get_markeredgewidth())} "
        marks += f"{_colour(artist.get_markerfacecolor())} {_colour(artist.get_markeredgecolor())}"
        lines = f"{_colour(artist.get_color())} {_number(artist.get_linewidth())} {artist._dash_pattern}"
        data = f"x {_extent(artist.get_xdata())} y {_extent(artist.get_ydata())}"
        return f"{own}{lines} marks {'' if artist.get_marker() == 'None' else marks} {data}"
    colours = (
        f"{_colour(artist.get_facecolor())} on {_colour(artist.get_edgecolor())} {_number(artist.get_linewidth())} "
    )
    if isinstance(artist, Patch):
        places = artist.get_patch_transform().transform(artist.get_path().vertices)
        return f"{own}{colours}{artist.get_hatch()} {_number([*places.min(0), *places.max(0)])}"
    values = artist.get_array()
    if values is not None:
        name = artist.get_cmap().name
        colours = f"{name if name in colormaps else ''} {_extent(values)} {_number(artist.get_linewidth())} "
    data = [path.vertices for path in artist.get_paths()]
    sizes = _extent(artist.get_sizes()) if hasattr(artist, "get_sizes") else ""
    extents = [_extent(np.concatenate(data)[:, k]) for k in (0, 1)] if data and any(map(len, data)) else []
    hatch = getattr(artist, "hatches", artist.get_hatch())
    return (
        f"{own}{colours}{hatch} {len(data)} {' '.join(extents)} offsets {_extent(artist.get_offsets())} sizes {sizes}"
    )
