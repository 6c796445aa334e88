"""The one style of all figures: the widths of a journal, type of 7 and 8 points, and labels with symbols and units.

Parameters and quantities are named by `label_of`, machines by `machine_title`; the size of whatever is not a title or
the name of an axis is `small_type(axes)`. Figures are begun, finished and written by the functions of `canvas`.
"""

import re
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np

from ..result import Axes
from ..tables import machine_numbers


class Style(NamedTuple):
    """The sizes of figures and of what is in them. Widths are in mm, and sizes of type in points."""

    column: float = 85.0  # width of a column of a journal
    screen: float = 120.0  # width of a figure with one panel, unless another is stated
    page: float = 174.0  # width of two columns, and of a figure with several panels
    panel: float = 55.0  # narrower panels stand below each other
    type: float = 8.0  # of titles and of names of axes
    small_type: float = 7.0  # of numbers on axes, legends and whatever else
    around: float = 32.0  # height of the texts around axes, which does not shrink with a figure
    line: float = 1.5  # width of a curve in points
    frame: float = 0.7  # width of axes and ticks in points
    steps: tuple[int, ...] = (1, 2, 5, 10)  # between the numbers on axes
    resolution: int = 200  # of figures that are written, in pixels an inch
    dots: int = 150  # of figures on a screen, in pixels an inch
    legend_below: float = 4.4  # distance of a legend below axes in its font sizes, clear of the name of the abscissa
    legend_gap: float = 0.6  # between that name and the legend, where it is measured
    columns_apart: float = 1.4  # distance between the columns of a legend in its font sizes
    letter: float = 0.52  # width of a letter in a legend in its font sizes
    entry: float = 4.2  # width of a legend's entry without its letters in its font sizes
    beside: float = 3.0  # what a legend leaves free of a figure's width in its font sizes
    widened: float = 1.15  # width of a legend below axes that stand in no grid, in theirs
    tick: float = 1.4  # room that a number on an axis needs, in its own sizes
    ticks: int = 8  # on an axis, at most
    margin: float = 6.0  # next to a text in pixels
    shortest: int = 6  # letters of a line that is not broken
    layouts: int = 3  # of a figure, each with the room that the one before left, at most
    digits: int = 6  # of the numbers in a title
    inch: float = 25.4  # mm


STYLE = Style()
# One colour for each role; colour-blind readers can distinguish them too (Okabe and Ito 2008).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
SHADE = "#e8e4d8"
PALE = "#cfdbe6"
MARKERS = {"fold": "o", "branch point": "s", "grazing": "v", "masses touch": "X", "contact pulls": "^"}
MARKERS |= {"landing jerk": "<", "collapse": "D", "law ends": "d", "family": "*", "corner": "P"}
MARKERS |= {"Krein collision": "h", "turn of the period": "|"}
MOTIONS, NO_MOTIONS, NO_ORBITS = "motions", "no motions", "no orbits"  # entries of legends
_GREEK = {
    **dict(zip(("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta"), "αβγδεζηθ", strict=True)),
    **dict(zip(("kappa", "lambda", "mu", "nu", "xi", "pi", "rho", "sigma"), "κλμνξπρσ", strict=True)),
    **dict(zip(("tau", "phi", "chi", "psi", "omega"), "τφχψω", strict=True)),
}
_RAISED, _LOWERED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"), str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
# Quantities whose names say too little alone.
_WORDS = {"alpha": "launch speed alpha", "next": "next launch speed", "inject": "injection"}


def small_type(axes: Axes) -> float:
    """The size of small type on axes in points: it follows that of the names of the axes."""
    return axes.xaxis.label.get_size() * STYLE.small_type / STYLE.type


def unit_labels(units: Any) -> tuple[str, str, str]:
    """The units of length, time and speed as text for a plot: SI for a machine that is stated in SI, else nothing."""
    return ("", "", "") if units is None else (" (m)", " (s)", " (m/s)")


def plain(text: str) -> str:
    """A text for a label, in which a dollar sign begins no mathematics."""
    return text.replace("$", r"\$")


def label_of(name: str, unit: str = "") -> str:
    """The label of a parameter or quantity, or of an expression of some, with its unit: Greek letters for their names,
    no underscores, indices lowered and powers raised."""
    text = re.sub("[A-Za-z]+", lambda word: _GREEK.get(word[0], word[0]), _WORDS.get(name, name))
    text = re.sub(r"\b([^\W\d_])_?(\d+)\b", lambda match: match[1] + match[2].translate(_LOWERED), text)
    text = text.replace("_", " ") + (unit and f" ({unit})")
    text = re.sub(r"(?:\^|\*\*)(-?\d+)(?![\d.])", lambda match: match[1].translate(_RAISED), plain(text))
    return re.sub(r"(?:\^|\*\*)\((-?\d+/\d+)\)", r"$^{\1}$", text).replace("**", "^").replace("*", "·")


def machine_title(machine: Mapping[str, Any], first: str = "", without: Collection[str] = ()) -> str:
    """The lines of `headline`: the machine, its laws but not constant gravity, and its numbers."""
    texts = {name: machine[name] for name in ("spring", "gravity") if machine[name] not in ("", "1")}
    # The text of a table names its file.
    laws = ", ".join(f"{name} {plain(text) if ':' in text else label_of(text)}" for name, text in texts.items())
    shown = {name: value for name, value in numbers_of(machine).items() if value[0] or name in str(texts)}
    values = [value_of(name, *value) for name, value in shown.items() if name not in without]
    words = ", ".join(filter(None, [laws, *values]))
    return plain(machine["machine"]) + first + (("\n" if first else ", ") + words if words else "")


def numbers_of(machine: Mapping[str, Any]) -> dict[str, tuple[float, str]]:
    """The numbers of a machine with their units, by the names of its parameters."""
    converted = "unit_length" in machine and "units" not in machine  # only the numbers of its laws are in SI
    numbers = machine_numbers({"parameters": machine["parameters"]} if converted else machine)
    return {name.replace(" ", "_"): value for name, value in numbers.items()}


def value_of(name: str, value: float, unit: str = "") -> str:
    """A parameter's or quantity's value in a title or a legend, as "b = 0.3 N/m"."""
    short = label_of(name).removeprefix("launch speed ")
    return f"{short} = {value:.{STYLE.digits}g}" + (unit and f" {label_of(unit)}")


def is_laid_out(axes: Axes) -> bool:
    """Whether axes are on a figure of the style, whose texts and legends are fitted whenever it is drawn."""
    return hasattr(axes.figure.get_layout_engine(), "stack")


def place_legend(axes: Axes, handles: list, names: list[str]) -> None:
    """A legend below axes."""
    place = {
        "loc": "upper center",
        "bbox_to_anchor": (0.5, 0),
        "borderaxespad": STYLE.legend_below,
        "columnspacing": STYLE.columns_apart,
    }
    columns = columns_of_legend(axes, names)
    legend = axes.legend(handles, names, frameon=False, fontsize=small_type(axes), ncols=columns, **place)
    if is_laid_out(axes):
        axes.figure.get_layout_engine().columns[legend] = columns


def columns_of_legend(axes: Axes, names: list[str]) -> int:
    """The number of columns of a legend for which there is room in the figure below axes."""
    _, columns, own = grid_of(axes)
    width = axes.figure.bbox.width * own / columns if axes.get_subplotspec() else STYLE.widened * axes.bbox.width
    room = 72 * width / axes.figure.dpi / small_type(axes) - STYLE.beside
    letters = [len(re.sub(r"[$^{}\\]", "", name)) for name in names]
    lengths = STYLE.letter * np.array(letters) + STYLE.entry
    counts = range(len(names), 1, -1)
    return next((count for count in counts if sum(map(max, np.array_split(lengths, count))) <= room), 1)


def grid_of(axes: Axes) -> tuple[int, int, int]:
    """The numbers of rows and columns of a figure's grid, and how many of these columns axes take."""
    place = axes.get_subplotspec()
    if place is None:
        return 1, 1, 1
    place = place.get_topmost_subplotspec()
    return place.get_gridspec().nrows, place.get_gridspec().ncols, len(place.colspan)
