"""A family as a figure of Bokeh: a quantity along the curve, with its events, to hover over and to click."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...tables import number_text
from ..family_ends import NAMES_OF_ENDS, ends_of
from ..plot import family_curve
from ..style import COLOURS
from .bokeh_figures import (
    INK,
    MOVING,
    PAGE,
    Change,
    apply,
    bokeh,
    empty_columns,
    hover,
    legend_above,
    new_figure,
    range_changes,
    tip,
)

if TYPE_CHECKING:
    from ...continuation import Family
    from ...curves import End

# Markers of events, the same in each figure of a family.
SHAPES = {"fold": "circle", "branch point": "square", "grazing": "inverted_triangle", "masses touch": "x"}
SHAPES |= {"contact pulls": "triangle", "landing jerk": "square_x", "collapse": "diamond", "family": "star"}
SHAPES |= {"law ends": "diamond_cross"}
OTHER_SHAPE, SHAPE_OF_END = "plus", "square_pin"
# Of ends, whose kinds name what became of the parameter.
LABELS = {f"end: {kind}": name for kind, name in NAMES_OF_ENDS.items()}


@dataclass(frozen=True, eq=False)
class FamilyData:
    """The data of the figure of a family, as arrays and texts that can be sent to another process.

    value, motions, others : (k,) the parameter along the curve, and the quantity where the orbits are motions and where
        they are not, NaN elsewhere
    points : columns (k,) of the orbits: "value", "quantity", "alpha", and "note", whether they are motions and which
        event is there
    events : columns of the events and of the ends: "value", "quantity", "kind"
    labels : of the two axes, with units
    """

    value: np.ndarray
    motions: np.ndarray
    others: np.ndarray
    points: dict[str, Any]
    events: dict[str, Any]
    labels: tuple[str, str]


def family_data(family: Any, quantity: str = "alpha") -> FamilyData:
    """The data of a `Family` for its figure, in SI for a machine that is stated in SI.

    quantity : as in `Family.quantity`, which raises `InputError` for an unknown one
    """
    value, whole, motions, others = family_curve(family, quantity)
    along, speed_in = family.in_order(), family.units.get("alpha", "")
    texts = ["a motion" if point.admissible else "; ".join(point.violations) for point, _ in along]
    texts = [text if event is None else f"{event.kind}: {text}" for text, (_, event) in zip(texts, along, strict=True)]
    marked = [i for i, (_, event) in enumerate(along) if event and event.kind != "value"]
    kinds = [along[i][1].kind for i in marked]
    for place, end in reversed(ends_of(family).items()):
        marked, kinds = [*marked, place], [*kinds, f"end: {end.kind}"]
        texts[place] += f"; {kinds[-1]}, {ending(family, end)}"
    speeds = [number_text(point.alpha, speed_in) for point, _ in along]
    points = {"value": value, "quantity": whole, "alpha": speeds, "note": texts}
    events = {"value": value[marked], "quantity": whole[marked], "kind": kinds}
    across, up = (family.heading(name).replace("_", " ") for name in (family.name, quantity))
    return FamilyData(value, motions, others, points, events, (across, up))


def ending(family: "Family", end: "End") -> str:
    """How a `Family` ends at its first or last point, in words."""
    unit = family.units.get(family.name, "")
    if end.limit is None:
        return end.reason
    off = "" if end.limit_error is None else f" (about {end.limit_error:.0e} off)"
    return f"{end.reason}, {family.name} tends to {number_text(float(end.limit), unit, 8)}{off}"


class FamilyFigure:
    """The figure of a family; `show` replaces the family.

    figure : of Bokeh
    points : the source of the orbits, with columns "value" and "quantity"; clicks select from it
    """

    def __init__(self, height: int = 360) -> None:
        models, new = bokeh("models"), bokeh("models").ColumnDataSource
        self._curve = new(empty_columns("value", "motions", "others"))
        self.points = new(empty_columns("value", "quantity", "alpha", "note"))
        self._events = new(empty_columns("value", "quantity", "kind", "marker", "label", "aside", "below", "align"))
        self._here = new(empty_columns("value", "quantity"))
        self.figure = figure = new_figure("", height)
        line = figure.line("value", "motions", source=self._curve, line_width=2.5, color=COLOURS[0])
        dashed = figure.line("value", "others", source=self._curve, line_width=2, color=COLOURS[0], line_dash=[4, 4])
        # The orbits themselves would fill the gaps of the dashes: they are shown only at the pointer.
        unseen: dict[str, object] = dict.fromkeys(("line_color", "fill_color", "nonselection_fill_color"))
        unseen |= {"hover_fill_color": COLOURS[0], "hover_line_color": None, "size": 7}
        points = figure.scatter("value", "quantity", source=self.points, **unseen)
        style = {"marker": "marker", "fill_color": "white", "line_color": INK, "line_width": 1.6, "size": 10}
        text: dict[str, object] = {
            "text": "label",
            "x_offset": "aside",
            "y_offset": "below",
            "text_align": "align",
            "text_color": INK,
            "text_font_size": "12px",
        }
        text |= {"text_baseline": "middle", "background_fill_color": "white", "background_fill_alpha": 0.8}
        figure.text("value", "quantity", source=self._events, **text)
        figure.scatter("value", "quantity", source=self._events, **style)
        ring = {"size": 16, "fill_color": None, "line_color": COLOURS[1], "line_width": 3}
        here = figure.scatter("value", "quantity", source=self._here, **ring, **MOVING)
        new_item = models.LegendItem
        self._items = [new_item(label="motions", renderers=[line]), new_item(label="no motions", renderers=[dashed])]
        self._items.append(new_item(label="shown", renderers=[here], visible=False))
        legend_above(figure, *self._items, columns=3)
        self._hover = hover([points], [("", "@note")])
        figure.add_tools(self._hover, models.TapTool(renderers=[points]))

    def show(self, data: FamilyData, steady: bool = True) -> None:
        """Show another family in place of the current one; this removes what `mark` has marked.

        steady : whether axes stay as they are while the family fills them well
        """
        apply(self.changes(data, steady))

    def changes(self, data: FamilyData, steady: bool = True) -> list[Change]:
        """The changes that `show` makes."""
        across, up = data.labels
        kinds = data.events["kind"]
        markers = [SHAPE_OF_END if kind.startswith("end: ") else SHAPES.get(kind, OTHER_SHAPE) for kind in kinds]
        tips = [(across, "@value{%.7g}"), (up, "@quantity{%.7g}")]
        tips += [("", "@note")] if up.startswith("alpha") else [("alpha", "@alpha"), ("", "@note")]
        changes: list[Change] = [
            (self._curve, "data", {name: getattr(data, name) for name in ("value", "motions", "others")}),
            (self.points, "data", data.points),
            (self._events, "data", {**data.events, "marker": markers, **_event_labels(data)}),
            (self.figure.xaxis[0], "axis_label", across),
            (self.figure.yaxis[0], "axis_label", up),
            (self._items[0], "visible", bool(np.isfinite(data.motions).any())),
            (self._items[1], "visible", bool(np.isfinite(data.others).any())),
            (self._hover, "tooltips", tip(tips)),
            (self._hover, "formatters", {"@value": "printf", "@quantity": "printf"}),
            *self.marks(),
        ]
        ranges = {"value": (self.figure.x_range, PAGE.margin), "quantity": (self.figure.y_range, PAGE.margin_of_labels)}
        for name, (shown, margin) in ranges.items():
            known = data.points[name][np.isfinite(data.points[name])]
            if len(known):
                changes += range_changes(shown, float(known.min()), float(known.max()), steady, margin)
        return changes

    def mark(self, value: float | None = None, quantity: float | None = None) -> None:
        """Mark the place of the hop that is shown; none without a value."""
        apply(self.marks(value, quantity))

    def marks(self, value: float | None = None, quantity: float | None = None) -> list[Change]:
        """The changes that `mark` makes."""
        marked = value is not None and quantity is not None
        place = {"value": [value], "quantity": [quantity]} if marked else empty_columns("value", "quantity")
        return [(self._here, "data", place), (self._items[2], "visible", marked)]


def _event_labels(data: FamilyData) -> dict[str, list]:
    """The labels of the events with their distances aside and down in pixels, away from the curve: one label at the
    first of several events that are close together, and none at the others."""
    curve = np.array([data.value, data.points["quantity"]], dtype=float)
    curve = curve[:, np.isfinite(curve).all(0)]
    low, size = curve.min(1, initial=np.inf), np.ptp(curve, axis=1) if curve.size else np.ones(2)
    shares, along = (
        (np.array(each, dtype=float) - low[:, None]) / np.where(size > 0, size, 1.0)[:, None]
        for each in ([data.events["value"], data.events["quantity"]], curve)
    )
    columns: dict[str, list] = {"label": [], "aside": [], "below": [], "align": []}
    curve, pixels = _along(along), np.array(PAGE.on_phone)[:, None]
    for i, place in enumerate(shares.T):
        near = (np.abs(shares - place[:, None]) < np.array(PAGE.near_events)[:, None]).all(0)
        kinds = (
            [LABELS.get(kind := data.events["kind"][k], kind) for k in np.flatnonzero(near)]
            if near.argmax() == i
            else []
        )
        label, side = ", ".join(dict.fromkeys(kinds)), 1 if place[0] < 0.5 else -1
        across, up = (curve - place[:, None]) * pixels
        aside, below = _place_of_label(side * across, -up, PAGE.letter * len(label))
        columns["label"].append(label)
        columns["aside"].append(side * aside)
        columns["below"].append(below)
        columns["align"].append("left" if side > 0 else "right")
    return columns


def _place_of_label(aside: np.ndarray, below: np.ndarray, width: float) -> tuple[int, int]:
    """The distances aside and down from an event at which a label of this width hides least of a curve, whose points
    (k,) lie so far aside and below; all in pixels."""
    places = [(PAGE.aside * a, PAGE.aside * b) for a, b in PAGE.places_of_labels]
    hidden = [np.sum((x < aside) & (aside < x + width) & (np.abs(below - y) < PAGE.half_line)) for x, y in places]
    return places[int(np.argmin(hidden))]


def _along(curve: np.ndarray) -> np.ndarray:
    """Points (2, `PAGE.avoided`) at equal distances along the lines between the points (2, k) of a curve."""
    if not curve.size:
        return curve
    length = np.append(0.0, np.hypot(*np.diff(curve)).cumsum())
    return np.array([np.interp(np.linspace(0, length[-1], PAGE.avoided), length, row) for row in curve])
