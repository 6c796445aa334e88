"""The spring's force over its extension as a figure of Bokeh, with the range that a hop uses."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ...errors import InputError
from ...model import Machine, dimensionless
from ...running import exclusive
from ...units import EXTENSION, FORCE, TORQUE
from ..plot import angles_shown
from ..style import COLOURS, SHADE
from .bokeh_figures import (
    EDGE,
    GREY,
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
    from ...periodic import Orbit


@dataclass(frozen=True, eq=False)
class LawData:
    """The data of the figure of a law, as arrays and texts that can be sent to another process.

    extension, force : (k,) of the spring, NaN where the law has no value; a tension is positive
    used : the smallest and the largest extension of the hop
    liftoff : the extension at lift-off, and the force there
    title : the law as it was stated, cut where it is long
    labels : of the two axes, with units: a force over an extension, or a torque over an angle
    """

    extension: np.ndarray
    force: np.ndarray
    used: tuple[float, float]
    liftoff: tuple[float, float]
    title: str
    labels: tuple[str, str]


def law_data(machine: Machine, orbit: "Orbit") -> LawData:
    """The data of the springs over the extension that a machine counts, and of its hop, for the figure; in SI for a
    machine that is stated in SI.

    orbit : an `Orbit` of this machine

    Raises `InputError` for a machine that states no force of a spring.
    """
    bare, own, units = orbit.dimensionless(), dimensionless(machine), orbit.scales
    end = bare.flight_time if bare.contact_time is None else bare.period
    extension = own.model.extension_of(own.values)
    states = bare(np.linspace(0, end, PAGE.extensions))
    used = extension(states)
    low, high = float(used.min()), float(used.max())
    beside = PAGE.beside_law * (high - low)
    places, forces = _forces(own, np.linspace(low - beside, high + beside, PAGE.extensions))
    start = _forces(own, np.array([bare.liftoff_extension]))[1]
    turns = "liftoff" in units.angles if units else bool(angles_shown(orbit, True))
    title = f"Spring: {orbit.machine['spring']}"
    (across, up), dimension = (("angle", "torque"), TORQUE) if turns else (("extension", "force"), FORCE)
    dimensions = EXTENSION, dimension
    length, force = (units.of(each) if units else 1.0 for each in dimensions)
    texts = [f" ({units.text(each)})" if units else "" for each in dimensions]
    return LawData(
        extension=places * length,
        force=forces * force,
        used=(low * length, high * length),
        liftoff=(bare.liftoff_extension * length, float(start[0]) * force),
        title=title if len(title) <= PAGE.title else title[: PAGE.title - 3] + "...",
        labels=(across + texts[0], up + texts[1]),
    )


@exclusive
def _forces(machine: Machine, extensions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The extensions among these (m,) for which a law is stated, and the forces there, NaN where there is none."""
    model, p = machine.model, machine.values
    if model.tension is None:
        raise InputError("this machine states no force of a spring over its extension")
    extension, pieces = model.extension_of(p), model.flight.pieces
    weights = np.array(extension.weights, dtype=float)
    states = np.outer((extensions - extension.offset) / (weights @ weights), weights)
    data = np.zeros((len(states), 0))
    if pieces is not None:
        breaks, rows = map(np.asarray, pieces.table(p))
        place = pieces.place(states[:, : len(pieces.coordinate)], p)
        inside = (breaks[0] <= place) & (place <= breaks[-1])
        extensions, states, place = extensions[inside], states[inside], place[inside]
        data = rows.reshape(len(rows), -1)[np.clip(np.searchsorted(breaks, place, "right") - 1, 0, len(breaks) - 2)]
    x, q = ca.SX.sym("x", len(weights)), ca.SX.sym("q", data.shape[1])
    tension = ca.Function("tension", [x, q], [model.tension(ca.vertsplit(x), p, ca.vertsplit(q) if q.numel() else [])])
    with np.errstate(all="ignore"):
        forces = np.array(tension.map(len(states))(states.T, data.T)).ravel()
    return extensions, np.where(np.isfinite(forces), forces, np.nan)


class LawFigure:
    """The figure of a law; `show` replaces the law."""

    def __init__(self, height: int = 260) -> None:
        models, new = bokeh("models"), bokeh("models").ColumnDataSource
        self._curve = new(empty_columns("extension", "force"))
        self._used, self._liftoff = new(empty_columns("low", "high")), new(empty_columns("extension", "force"))
        self.figure = figure = new_figure("", height)
        strip = figure.vstrip("low", "high", source=self._used, fill_color=SHADE, line_color=EDGE, level="underlay")
        figure.add_layout(models.Span(location=0, dimension="width", line_color=GREY))
        line = figure.line("extension", "force", source=self._curve, line_width=2.5, color=COLOURS[0])
        style = {"size": 9, "fill_color": COLOURS[1], "line_color": "white"}
        dot = figure.scatter("extension", "force", source=self._liftoff, **style)
        item = models.LegendItem
        named = {"spring": line, "used": strip, "lift-off": dot}
        legend_above(figure, *(item(label=name, renderers=[renderer]) for name, renderer in named.items()))
        self._hover = hover([line], _law_tip_entries("extension", "force"), mode="vline")
        figure.add_tools(self._hover)

    def show(self, data: LawData, steady: bool = True) -> None:
        """Show another law in place of the current one.

        steady : whether axes stay as they are while the law fills them well
        """
        apply(self.changes(data, steady))

    def changes(self, data: LawData, steady: bool = True) -> list[Change]:
        """The changes that `show` makes."""
        (low, high), (extension, force) = data.used, data.liftoff
        changes: list[Change] = [
            (self._curve, "data", {"extension": data.extension, "force": data.force}),
            (self._used, "data", {"low": [low], "high": [high]}),
            (self._liftoff, "data", {"extension": [extension], "force": [force]}),
            (self.figure.title, "text", data.title),
            (self.figure.xaxis[0], "axis_label", data.labels[0]),
            (self.figure.yaxis[0], "axis_label", data.labels[1]),
            (self._hover, "tooltips", tip(_law_tip_entries(*(label.partition(" ")[0] for label in data.labels)))),
            *range_changes(self.figure.x_range, float(data.extension[0]), float(data.extension[-1]), steady, 0.0),
        ]
        known = data.force[np.isfinite(data.force)]
        if len(known):
            changes += range_changes(self.figure.y_range, float(known.min()), float(known.max()), steady)
        return changes


def _law_tip_entries(across: str, up: str) -> list[tuple[str, str]]:
    """The entries of the tooltip on the curve, by the names of the axes."""
    return [(across, "@extension{%.5g}"), (up, "@force{%.5g}")]
