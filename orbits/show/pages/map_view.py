"""The return map as a figure of Bokeh: the map and the identity line, the basin coloured, and a cobweb."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...units import LIFTOFF_SPEED
from ..plot import cobweb, sampled_map
from ..style import COLOURS, PALE
from .bokeh_figures import (
    EDGE,
    GREY,
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
)

if TYPE_CHECKING:
    from ...returns import ReturnMap


@dataclass(frozen=True, eq=False)
class MapData:
    """The data of the figure of a return map, as arrays and texts that can be sent to another process.

    centre : the launch speed from which all others are counted, 0.0 for none
    low, high : launch speeds between which the map is drawn
    alpha, following : (k,) launch speeds and the next ones, NaN where there is none or the map jumps
    basin : (b, 2) the intervals of launch speeds that come to a lossless hop; None where they are not known
    web : (2, j) the corners of the cobweb, empty for none
    unit : of a launch speed, "" without units
    """

    centre: float
    low: float
    high: float
    alpha: np.ndarray
    following: np.ndarray
    basin: np.ndarray | None
    web: np.ndarray
    unit: str

    @property
    def share(self) -> float | None:
        """The share of the launch speeds drawn that come to a lossless hop; None where that is not known."""
        return None if self.basin is None else float(np.diff(self.basin).sum() / (self.high - self.low))


def map_data(
    step: "ReturnMap",
    low: float,
    high: float,
    *,
    centre: float = 0.0,
    basin: Any = None,
    start: float | None = None,
    samples: int = PAGE.map_samples,
    hops: int = PAGE.web_hops,
) -> MapData:
    """The data of a `ReturnMap` between two launch speeds for the figure.

    low, high, centre : as in `MapData`
    basin : the intervals that `ReturnMap.basin` returned, None for none
    start, hops : launch speed from which a cobweb is drawn, None for no cobweb, and its number of hops
    """
    web = np.zeros((2, 0)) if start is None else cobweb(step, start, hops)
    units = step.machine.units
    unit = units.text(LIFTOFF_SPEED) if units else ""
    intervals = None if basin is None else np.reshape(basin, (-1, 2))
    alpha, following = (each - centre for each in sampled_map(step, centre + low, centre + high, samples))
    return MapData(centre, low, high, alpha, following, intervals, web - centre, unit)


class MapFigure:
    """A figure of a return map; `show` replaces the map; `figure` is that of Bokeh."""

    def __init__(self) -> None:
        models = bokeh("models")
        new = models.ColumnDataSource
        self.figure = figure = new_figure("Return map", 380)
        figure.axis.formatter = models.CustomJSTickFormatter(code="return String(Number(tick.toPrecision(6)))")
        lines = (new(empty_columns("alpha", "following")) for _ in range(4))
        self._map, self._web, self._identity, self._start = lines
        self._basin = new(empty_columns("low", "high"))
        strips = figure.vstrip("low", "high", source=self._basin, fill_color=PALE, line_color=EDGE, level="underlay")
        identity = figure.line("alpha", "following", source=self._identity, line_color=GREY, line_dash=[4, 3])
        line = figure.line("alpha", "following", source=self._map, line_color=COLOURS[0], line_width=2.5)
        web = figure.line("alpha", "following", source=self._web, line_color=COLOURS[1], line_width=1.5)
        figure.scatter(
            "alpha", "following", source=self._start, color=COLOURS[1], line_color="white", size=10, **MOVING
        )
        names = ("map", line), ("next = this", identity), ("cobweb", web), ("basin", strips)
        self._items = {name: models.LegendItem(label=name, renderers=[drawn]) for name, drawn in names}
        legend_above(figure, *self._items.values())
        entries = [("launch speed", "@alpha{%.6g}"), ("next", "@following{%.6g}")]
        figure.add_tools(hover([line], entries, mode="vline"))

    def show(self, data: MapData, steady: bool = True) -> None:
        """Show another map in place of the current one; if `steady`, axes stay while it fills them well."""
        apply(self.changes(data, steady))

    def changes(self, data: MapData, steady: bool = True) -> list[Change]:
        """The changes that `show` makes."""
        basin = np.zeros((0, 2)) if data.basin is None else data.basin
        most = np.nanmax(data.following, initial=data.high, where=np.isfinite(data.following))
        lines: list[tuple[object, object, object]] = [
            (self._map, data.alpha, data.following),
            (self._web, *data.web),
            (self._start, *data.web[:, :1]),
            (self._identity, [data.low, data.high], [data.low, data.high]),
        ]
        changes: list[Change] = [(source, "data", {"alpha": x, "following": y}) for source, x, y in lines]
        changes.append((self._basin, "data", {"low": basin[:, 0], "high": basin[:, 1]}))
        changes += range_changes(self.figure.x_range, data.low, data.high, steady, 0.0)
        # Beside a launch speed, where the next one falls steeply, the map is drawn as far as the identity line.
        changes += range_changes(self.figure.y_range, min(data.low, 0.0), float(most), steady)
        unit = (f" - {data.centre:.9g}" if data.centre else "") + (f" ({data.unit})" if data.unit else "")
        changes += [(self.figure.xaxis[0], "axis_label", "launch speed" + unit)]
        changes += [(self.figure.yaxis[0], "axis_label", "next launch speed" + unit)]
        shown = {"cobweb": data.web.size > 0, "basin": len(basin) > 0}
        return [*changes, *((self._items[name], "visible", is_shown) for name, is_shown in shown.items())]
