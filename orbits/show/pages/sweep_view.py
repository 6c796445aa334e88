"""A sweep as figures of Bokeh: a quantity over its parameters, with a tooltip for each member."""

from typing import Any

import numpy as np

from ...errors import InputError
from ..style import COLOURS
from .bokeh_figures import GREY, PAGE, bokeh, empty_columns, hover, legend_above, new_figure

MAPPED = "Viridis256"  # colours that are read in print and by colour-blind readers
MOTIONS = ("certified", "lifts_off")  # statuses of members that are motions


def sweep_figures(sweep: Any, quantity: str | None = None) -> tuple[list[Any], str]:
    """Figures of a `Sweep` side by side, and a sentence on what they show.

    quantity : a column of numbers, the first one for None

    Over one parameter it is the quantity against it, over two their plane with the quantity as colour, and over more
    the quantity against each, where members that are selected in one figure are so in all. In SI for a machine that is
    stated so. Without members that have the quantity there is no figure over one parameter. Raises `InputError` for a
    column that is not a number, and for a plane of several families.
    """
    quantity = quantity or sweep.numbers[0]
    values = sweep[quantity]
    if quantity not in sweep.numbers:
        raise InputError(f"'{quantity}' is not a column of numbers: choose one of {', '.join(sweep.numbers)}")
    if len(sweep.parameters) == 2 and len(sweep.about["families"]) > 1:
        raise InputError("a figure over two parameters shows one family: use sweep.of_family(n)")
    step = -(-len(sweep) // PAGE.members) or 1
    chosen = np.arange(0, len(sweep), step)
    known = np.isfinite(values[chosen])
    found, nothing = (_source(sweep, quantity, rows) for rows in (chosen[known], chosen[~known]))
    caption = f"{int(known.sum())} of {len(chosen)} members have {sweep.heading(quantity).replace('_', ' ')}"
    if step > 1:
        caption = f"One of {step} members is shown: {caption}"
    if len(sweep.parameters) == 2:
        return [_plane(sweep, quantity, found, nothing)], caption + "."
    return [_against(sweep, name, quantity, found) for name in sweep.parameters if known.any()], caption + "."


def _source(sweep: Any, quantity: str, rows: np.ndarray) -> object:
    """The source of these members."""
    if not len(rows):
        return bokeh("models").ColumnDataSource(
            empty_columns(*_columns(sweep), "quantity", "member", "note", "kind", "family")
        )
    status, reason = (sweep[name][rows].astype(str) for name in ("status", "reason"))
    families = np.array(sweep.about["families"])
    texts = [f"{a}: {b[: PAGE.reason]}" if b else a for a, b in zip(status.tolist(), reason.tolist(), strict=True)]
    columns = {column: sweep[name][rows] for column, name in _columns(sweep).items()}
    columns |= {"quantity": sweep[quantity][rows], "member": sweep.index[rows], "note": texts}
    columns["kind"] = np.where(np.isin(status, MOTIONS), "motions", "no motions").tolist()
    columns["family"] = [_family_name(family) for family in families[sweep.index[rows] % len(families)].tolist()]
    return bokeh("models").ColumnDataSource(columns)


def _family_name(family: int) -> str:
    return f"family {family}"


def _columns(sweep: Any) -> dict[str, str]:
    """The names of the parameters by those of their columns, which are plain words."""
    return {f"p{i}": name for i, name in enumerate(sweep.parameters)}


def _plane(sweep: Any, quantity: str, found: Any, nothing: Any) -> object:
    """Two parameters against each other, with the quantity as colour, and where there is none."""
    models, (across, up) = bokeh("models"), sweep.parameters
    figure, values = _empty_figure(sweep, across, up), np.asarray(found.data["quantity"], dtype=float)
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    mapper = models.LinearColorMapper(palette=MAPPED, low=low, high=high)
    crosses = figure.scatter("p0", "p1", source=nothing, marker="x", size=5, color=GREY)
    marks = _marks(figure, sweep, found, "p0", "p1", {"field": "quantity", "transform": mapper}, "kind")
    figure.add_tools(_member_tool(sweep, quantity, [marks]))
    if len(nothing.data["p0"]):
        figure.legend[0].items.append(models.LegendItem(label="none", renderers=[crosses]))
        figure.add_tools(_member_tool(sweep, None, [crosses]))
    if len(values):
        plain = {"title_text_font_style": "normal", "title_text_font_size": "12px", "height": 12}
        figure.add_layout(models.ColorBar(color_mapper=mapper, title=_label(sweep, quantity), **plain), "below")
    return figure


def _against(sweep: Any, name: str, quantity: str, found: object) -> object:
    """The quantity against one parameter, in a colour for each family."""
    figure, families = _empty_figure(sweep, name, quantity), list(map(_family_name, sweep.about["families"]))
    column, colour, field = next(column for column, each in _columns(sweep).items() if each == name), COLOURS[0], "kind"
    if len(families) > 1:
        shades = [COLOURS[i % len(COLOURS)] for i in range(len(families))]
        colour, field = bokeh("transform").factor_cmap("family", shades, families), "family"
    marks = _marks(figure, sweep, found, column, "quantity", colour, field)
    figure.add_tools(_member_tool(sweep, quantity, [marks]), bokeh("models").BoxSelectTool())
    return figure


def _marks(figure: Any, sweep: Any, found: object, x: str, y: str, colour: object, field: str) -> object:
    """The marks of members, crosses where they are not motions, with a legend by a column."""
    transform, models = bokeh("transform"), bokeh("models")
    shape = transform.factor_mark("kind", ["circle", "x"], ["motions", "no motions"])
    marks = figure.scatter(
        x, y, source=found, size=7, marker=shape, fill_color=colour, line_color=colour, fill_alpha=0.8,
        nonselection_fill_alpha=0.08, nonselection_line_alpha=0.08,
    )  # fmt: skip
    legend_above(figure, models.LegendItem(label={"field": field}, renderers=[marks]))
    return marks


def _member_tool(sweep: Any, quantity: str | None, renderers: list[object]) -> object:
    """The tooltip of a member."""
    tips = [("member", "@member")] + ([("", "@family")] if len(sweep.about["families"]) > 1 else [])
    tips += [(sweep.heading(name), f"@{column}{{%.6g}}") for column, name in _columns(sweep).items()]
    tips += [(_label(sweep, quantity), "@quantity{%.7g}")] if quantity else []
    return hover(renderers, [*tips, ("", "@note")])


def _empty_figure(sweep: Any, across: str, up: str) -> Any:
    """A figure with logarithmic axes for parameters that are swept over decades."""
    new_range, axes = bokeh("models").DataRange1d, {"x": across, "y": up}
    ranges = {f"{axis}_range": new_range() for axis in axes}
    scales = {
        f"{axis}_axis_type": "log" if name in sweep.about["logarithmic"] else "linear" for axis, name in axes.items()
    }
    labels = {f"{axis}_axis_label": _label(sweep, name) for axis, name in axes.items()}
    return new_figure("", 400, **ranges, **scales, **labels)


def _label(sweep: Any, name: str) -> str:
    """A name for an axis, with its unit."""
    return sweep.heading(name).replace("_", " ")
