"""A hop as figures of Bokeh: the animated machine, heights, phase portrait and contact force."""

from dataclasses import dataclass
from itertools import cycle, islice
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InputError
from ...model import LANDED_FORCE
from ..animation import drawn_heights, drawn_range
from ..plane import PlaneMotion, motion_in_plane
from ..plot import angles_shown, masses_at, states_to_show, title, vertical
from ..style import COLOURS, SHADE, unit_labels
from .bokeh_figures import (
    EDGE,
    GREY,
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
from .player import new_player

if TYPE_CHECKING:
    from ...periodic import Orbit

CENTRE_OF_MASS = "centre of mass"
IN_PLANE = ("points", "trails", "advance", "marks", "cycles", "middle")  # columns of one motion in the plane


@dataclass(frozen=True, eq=False)
class HopData:
    """The data of the figures of a hop, as arrays and texts that can be sent to another process.

    title : machine, family, speed and laws in two lines
    names : of the m masses, the upper before the lower, or of the angles of a machine that turns
    time : (k,) over a cycle, or over the flight of an orbit whose contact never ends
    height, speed, drawn : (m, k) of the masses; `drawn` are heights with room for springs of unknown rest length. Of a
        machine that turns they are its angles, and their rates
    centre : (k,) the height of the centre of mass; None where there is none
    force : (k,) the contact force, on the point that opens next where points take turns; None where there is none
    landed : (k,) that on the point that has landed; None where only one point holds
    why : in words, why there is no contact force
    flight_time : of the hop
    floating : whether `drawn` are not true heights
    springs : numbers of the masses, lower and upper, that springs join; -1 is the ground
    knees : such numbers with the length of each of the two links
    span : the lowest and the highest height that is drawn
    labels : of the axes, by "time", "height", "drawn" (the animation's), "speed" and "force", with units
    turns : whether the machine turns
    plane : the motion of a machine that states its drawing in the plane; None for masses on one vertical line
    """

    title: str
    names: tuple[str, ...]
    time: np.ndarray
    height: np.ndarray
    speed: np.ndarray
    drawn: np.ndarray
    centre: np.ndarray | None
    force: np.ndarray | None
    landed: np.ndarray | None
    why: str
    flight_time: float
    floating: bool
    springs: tuple[tuple[int, int], ...]
    knees: tuple[tuple[int, int, float], ...]
    span: tuple[float, float]
    labels: dict[str, str]
    turns: bool = False
    plane: PlaneMotion | None = None

    @property
    def end(self) -> float:
        """The last time."""
        return float(self.time[-1])


def hop_data(orbit: "Orbit") -> HopData:
    """The data of an `Orbit` for its figures, in SI for a machine that is stated in SI."""
    count = min(PAGE.times + PAGE.times_of_family * orbit.family, PAGE.most_times)
    time, force, landed, why = np.linspace(0, orbit.flight_time, count), None, None, "the contact never ends"
    if orbit.contact_time is not None:
        time = np.append(time, np.linspace(orbit.flight_time, orbit.period, count // 2)[1:])
        try:
            force, why = orbit.contact_force(time), ""
            if (
                orbit.contact is not None and LANDED_FORCE in orbit.contact.names
            ):  # at the end of the contact, before the points change their names
                landed = orbit.contact_force(np.minimum(time, np.nextafter(orbit.period, 0)), landed=True)
        except InputError as error:
            why = str(error)
    states, shape, floating = states_to_show(orbit, time), orbit.shape, orbit.certificate.smallest_separation is None
    plane = motion_in_plane(orbit)
    angles, masses = angles_shown(orbit, plane is not None), masses_at(orbit, states)
    if angles:
        names, states = orbit.flight.names, orbit.unrolled(time)
        masses = {name: (states[:, names.index(name)], states[:, names.index(name + "'")]) for name in angles}
    heights, floating = drawn_heights(states, shape.heights, (shape.springs, shape.knees, shape.embed), floating)
    places = {None: -1} | {name: i for i, name in enumerate(masses)}
    metres, seconds, speeds_in = unit_labels(orbit.scales)
    centre = shape.heights.get(CENTRE_OF_MASS)
    height, speed = vertical(orbit.certificate.smallest_separation), "speed" + speeds_in
    return HopData(
        title=title(orbit, numbers=False),
        names=tuple(masses),
        time=time,
        height=np.array([height for height, _ in masses.values()]),
        speed=np.array([speed for _, speed in masses.values()]),
        drawn=np.array([masses[name][0] if angles else heights[name] for name in masses]),
        centre=None if centre is None else np.asarray(centre(states)),
        force=force,
        landed=landed,
        why=why,
        flight_time=orbit.flight_time,
        floating=floating and plane is None and not angles,
        springs=tuple((places[lower], places[upper]) for lower, upper in shape.springs),
        knees=tuple((places[lower], places[upper], link) for lower, upper, link in shape.knees),
        span=plane.span if plane else drawn_range(heights, shape.knees),
        labels={
            "time": "time" + seconds,
            "height": ("angle" + (" (rad)" if orbit.scales else "")) if angles else height + metres,
            "drawn": ("height" if plane else height) + metres,
            "speed": ("rate" + (" (rad/s)" if orbit.scales else "")) if angles else speed,
            "force": "contact force" + (f" ({orbit.units['contact force']})" if orbit.scales else ""),
        },
        turns=bool(angles),
        plane=plane,
    )


class HopFigures:
    """Figures of a hop; `show` replaces the hop, also by one of a machine with other masses.

    machine : the animated machine
    heights : heights of the masses against time, contact shaded
    portrait : speed of the masses against height
    force : contact force against time
    player : widgets for the animation, which runs in the browser alone
    """

    def __init__(self) -> None:
        new = bokeh("models").ColumnDataSource
        masses, joints, paths = ("time", "height", "speed", "colour", "name"), ("lower", "upper"), ("xs", "ys")
        self._masses, self._centre = new(empty_columns(*masses)), new(empty_columns("time", "height"))
        self._force, self._contact = new(empty_columns("time", "force")), new(empty_columns("start", "end"))
        self._landed = new(empty_columns("time", "force"))
        self._motion = new(empty_columns("drawn"))
        self._springs, self._knees = new(empty_columns(*joints, *paths)), new(empty_columns(*joints, "link", *paths))
        self._bodies = new(empty_columns(*masses, "x", "y", "marker", "size", "aside", "align", "force"))
        self._plane = new(empty_columns(*IN_PLANE))
        self._outlines = new(empty_columns("size", "colour", "closed", "ends", "name", "line", "fill", *paths))
        self._dots, self._parts = (
            new(empty_columns("x", "y", "colour", "size")),
            new(empty_columns("x", "y", "colour", "name")),
        )
        self.machine = self._new_machine()
        self.heights, self._centre_item, self._contact_item = self._new_heights()
        self.portrait, (self.force, self._feet_items) = self._new_portrait(), self._new_force()
        shown = {"masses": self._masses, "motion": self._motion, "force": self._force, "bodies": self._bodies}
        self.player = new_player(
            self.machine,
            **shown,
            springs=self._springs,
            knees=self._knees,
            plane=self._plane,
            outlines=self._outlines,
            dots=self._dots,
        )

    def show(self, data: HopData, steady: bool = True) -> None:
        """Show another hop in place of the current one.

        steady : whether axes stay as they are while the hop fills them well
        """
        apply(self.changes(data, steady))

    def changes(self, data: HopData, steady: bool = True) -> list[Change]:
        """The changes that `show` makes, in this order."""
        stands, nothing = data.end > data.flight_time, np.zeros(0)
        force, landed, centre = (nothing if row is None else row for row in (data.force, data.landed, data.centre))
        column = data.plane is None  # of masses on one vertical line
        changes: list[Change] = [
            (self._springs, "data", _joints(data.springs if column else (), "lower", "upper")),
            (self._knees, "data", _joints(data.knees if column else (), "lower", "upper", "link")),
            *self._changes_in_plane(data.plane),
            (self._force, "data", {"time": data.time[: len(force)], "force": force}),
            (self._landed, "data", {"time": data.time[: len(landed)], "force": landed}),
            *((item, "visible", data.landed is not None) for item in self._feet_items),
            (self.machine, "visible", data.plane is not None or not data.turns),
            (self.heights.title, "text", "Angles" if data.turns else "Heights"),
            (self._centre, "data", {"time": data.time[: len(centre)], "height": centre}),
            (self._contact, "data", {"start": [data.flight_time][:stands], "end": [data.end][:stands]}),
            (self.force.title, "text", f"Contact force: {data.why}" if data.why else "Contact force"),
            (self.machine.yaxis[0], "visible", not data.floating),
            (self._centre_item, "visible", data.centre is not None),
            (self._contact_item, "visible", stands),
        ]
        axes = {"time": [self.heights.xaxis, self.force.xaxis], "speed": [self.portrait.yaxis]}
        axes |= {"height": [self.heights.yaxis, self.portrait.xaxis], "drawn": [self.machine.yaxis]}
        axes |= {"force": [self.force.yaxis]}
        changes += [(axis[0], "axis_label", data.labels[name]) for name, some in axes.items() for axis in some]
        changes += self._range_changes(data, steady)
        place, rate = ("angle", "rate") if data.turns else ("height", "speed")
        tips = (self._tip_of_heights, ("time", place)), (self._tip_of_portrait, (place, rate))
        changes += [(tool, "tooltips", tip(_tip_entries(*names))) for tool, names in tips]
        *colours, of_centre = islice(cycle(COLOURS), len(data.names) + 1)
        changes.append((self._centre_item.renderers[0].glyph, "line_color", of_centre))
        rows = {"time": [data.time] * len(colours), "colour": colours, "name": list(data.names)}
        rows |= {"height": list(data.height), "speed": list(data.speed)}
        return [*changes, (self._masses, "data", rows), (self._motion, "data", {"drawn": list(data.drawn)})]

    def _changes_in_plane(self, plane: PlaneMotion | None) -> list[Change]:
        """The changes that show a machine in the plane, or none."""
        outlines, numbers = (
            {name: list[Any]() for name in self._outlines.data},
            empty_columns(*IN_PLANE),
        )
        parts, ground = empty_columns("x", "y", "colour", "name"), plane is None or plane.ground
        if plane:
            numbers = {name: [getattr(plane, name)] for name in numbers}
            named = dict(zip(plane.outlines["name"], plane.outlines["colour"], strict=True))
            unseen: list[Any] = [[] for _ in plane.outlines["name"]]
            outlines = plane.outlines | {"xs": unseen, "ys": unseen}
            rows = zip(plane.outlines["ends"], plane.outlines["size"], strict=True)
            outlines["line"] = [4.0 if ends else 2.5 if size else 1.2 for ends, size in rows]
            outlines["fill"] = [0.3 if closed else 0.0 for closed in plane.outlines["closed"]]
            parts = dict.fromkeys("xy", [np.nan] * len(named)) | {"colour": [*named.values()], "name": [*named]}
        changes: list[Change] = [(each, "visible", ground) for each in self._ground]
        changes += [(self._parts_item, "visible", plane is not None), (self._parts, "data", parts)]
        return [*changes, (self._outlines, "data", outlines), (self._plane, "data", numbers)]

    def _range_changes(self, data: HopData, steady: bool) -> list[Change]:
        high, low = data.height.max(), min(data.height.min(), 0.0)
        force = np.concatenate([np.zeros(1) if row is None else row for row in (data.force, data.landed)])
        bounds = [
            (self.heights.x_range, 0.0, data.end, 0.0),
            (self.heights.y_range, low, high, PAGE.margin),
            (self.portrait.x_range, low, high, PAGE.margin),
            (self.portrait.y_range, data.speed.min(), data.speed.max(), PAGE.margin),
            (self.force.y_range, min(force.min(), 0.0), force.max(), PAGE.margin),
            (self.machine.y_range, *data.span, 2 * PAGE.margin),
        ]
        each = (range_changes(shown, float(a), float(b), steady, margin) for shown, a, b, margin in bounds)
        return [change for changes in each for change in changes]

    def _new_machine(self) -> Any:
        models, figure = bokeh("models"), new_figure("", 320, x_range=bokeh("models").Range1d(-1, 1), tools="save")
        figure.grid.visible = figure.xaxis.visible = False
        self._ground = (
            models.BoxAnnotation(top=0, fill_color=SHADE, fill_alpha=1, line_color=None, level="underlay"),
            models.Span(location=0, dimension="width", line_color=INK, line_width=1.5),
        )
        for each in self._ground:
            figure.add_layout(each)
        paths = {"source": self._outlines, "line_join": "round", "line_cap": "round", **MOVING}
        figure.patches(
            "xs", "ys", source=self._outlines, fill_color="colour", fill_alpha="fill", line_color=None, **MOVING
        )
        figure.multi_line("xs", "ys", line_color="colour", line_width="line", **paths)
        figure.scatter("x", "y", source=self._dots, size="size", color="colour", **MOVING)
        parts = figure.scatter("x", "y", source=self._parts, size=12, color="colour")
        self._parts_item = models.LegendItem(label={"field": "name"}, renderers=[parts])
        legend_above(figure, self._parts_item)
        figure.multi_line("xs", "ys", source=self._springs, line_color=GREY, line_width=2, line_join="round", **MOVING)
        figure.multi_line("xs", "ys", source=self._knees, line_color=GREY, line_width=5, line_join="round", **MOVING)
        columns = {"color": "colour", "marker": "marker", "size": "size"}
        drawn = figure.scatter("x", "y", source=self._bodies, line_width=6, **columns, **MOVING)
        text = {"text": "name", "x_offset": "aside", "text_align": "align", "text_color": INK, "text_font_size": "13px"}
        figure.text("x", "y", source=self._bodies, text_baseline="middle", y_offset=-11, **text, **MOVING)
        entries = [("", "@name"), *((name, f"@{name}{{%.5g}}") for name in ("time", "height", "speed"))]
        figure.add_tools(hover([drawn], entries))
        return figure

    def _new_heights(self) -> tuple[Any, Any, Any]:
        """The figure of heights, and the items of its legend that not every hop has: the centre and the contact."""
        models, figure = bokeh("models"), new_figure("Heights", 300)
        strip = self._shade(figure)
        figure.add_layout(models.Span(location=0, dimension="width", line_color=GREY))
        lines = figure.multi_line("time", "height", source=self._masses, line_color="colour", line_width=2.5)
        centre = figure.line("time", "height", source=self._centre, line_dash=[5, 3], line_width=1.5)
        figure.scatter("time", "height", source=self._bodies, size=9, color="colour", line_color="white", **MOVING)
        new = models.LegendItem
        of_centre, of_contact = new(label=CENTRE_OF_MASS, renderers=[centre]), new(label="contact", renderers=[strip])
        named = new(label={"field": "name"}, renderers=[lines])
        legend_above(figure, named, of_centre, of_contact)
        self._tip_of_heights = hover([lines], _tip_entries("time", "height"), mode="vline", line_policy="interp")
        figure.add_tools(self._tip_of_heights)
        return figure, of_centre, of_contact

    def _new_portrait(self) -> Any:
        figure = new_figure("Phase portrait", 300)
        lines = figure.multi_line("height", "speed", source=self._masses, line_color="colour", line_width=2.5)
        figure.scatter("height", "speed", source=self._bodies, size=9, color="colour", line_color="white", **MOVING)
        self._tip_of_portrait = hover([lines], _tip_entries("height", "speed"), line_policy="interp")
        figure.add_tools(self._tip_of_portrait)
        return figure

    def _new_force(self) -> tuple[Any, list[Any]]:
        """The figure of the contact force, and the items of its legend, which names points that take turns."""
        figure = new_figure("Contact force", 240, x_range=self.heights.x_range)
        self._shade(figure)
        line = figure.line("time", "force", source=self._force, line_color=INK, line_width=2.5)
        other = figure.line("time", "force", source=self._landed, line_color=GREY, line_width=2.5, line_dash=[5, 3])
        named = {"on the point that opens": line, "that landed": other}
        items = [bokeh("models").LegendItem(label=name, renderers=[drawn]) for name, drawn in named.items()]
        legend_above(figure, *items)
        figure.scatter("time", "force", source=self._bodies, size=9, color=INK, line_color="white", **MOVING)
        entries = [("time", "@time{%.5g}"), ("force", "@force{%.5g}")]
        figure.add_tools(hover([line], entries, mode="vline"))
        return figure, items

    def _shade(self, figure: Any) -> object:
        """Shade the contact in a figure against time."""
        return figure.vstrip("start", "end", source=self._contact, fill_color=SHADE, line_color=EDGE, level="underlay")


def _tip_entries(across: str, up: str) -> list[tuple[str, str]]:
    """The entries of a tooltip on a mass's curve, by the names of the axes."""
    return [("", "@name"), (across, "$snap_x{%.5g}"), (up, "$snap_y{%.5g}")]


def _joints(joints: tuple, *names: str) -> dict[str, list]:
    """The columns of springs or knees; the browser computes where they are drawn."""
    unseen: list[list[float]] = [[] for _ in joints]
    return {name: [joint[i] for joint in joints] for i, name in enumerate(names)} | {"xs": unseen, "ys": unseen}
