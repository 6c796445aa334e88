"""The page of one tab: the requests of its fields, the results of its workers, and the figures and fields shown."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from bokeh.core.properties import String
from bokeh.document import Document
from bokeh.events import Press, Tap
from bokeh.model import DataModel
from bokeh.models import CustomJS
from bokeh.resources import Resources
from bokeh.server.callbacks import TimeoutCallback
from jinja2 import Template

from orbits.errors import InputError
from orbits.show import THEME, FamilyFigure, HopFigures, LawFigure, MapData, MapFigure

from .fields import changed
from .page_state import PAGES, Computed, Requested, kind_of, tab_state
from .results import DialsResult, FamilyResult, HopResult, same_family
from .scene import Scene
from .worker import Done, Failure, Pools, Task, Worker, pools_of

FOLDER = Path(__file__).parent


class Bridge(DataModel):
    """The messages between a tab and its page: a field that was changed, the state of all fields, and measured rows to
    be saved; the first two as JSON."""

    request = String(default="")
    page_state = String(default="")
    rows = String(default="")


@dataclass(frozen=True)
class Figures:
    """The figures of a page."""

    hops: HopFigures = field(default_factory=HopFigures)
    family: FamilyFigure = field(default_factory=FamilyFigure)
    map: MapFigure = field(default_factory=MapFigure)
    law: LawFigure = field(default_factory=LawFigure)

    def by_name(self) -> dict[str, Any]:
        """Bokeh's models by the names that the template has for them."""
        hops = {name: getattr(self.hops, name) for name in ("machine", "heights", "portrait", "force", "player")}
        return {**hops, "family": self.family.figure, "map": self.map.figure, "law": self.law.figure}


class Explorer:
    """The page of one tab.

    document : Bokeh's, which shows it
    scene : the scene shown first
    pools : the processes that compute hops, and in the background families and maps; those of a page alone by default
    python_machine : the machine of the page, where no statement makes it
    problem : the fault of the link that was followed, in words; "" if there is none
    """

    def __init__(
        self, document: Document, scene: Scene, pools: Pools | None = None, python_machine: object = None,
        problem: str = "",
    ):  # fmt: skip
        self._document, self._pools, self._python_machine = document, pools or pools_of(python_machine), python_machine
        self._workers = {
            "hop": self._worker(self._receive_hop),
            "family": self._worker(self._receive_family, calm=True),
            "map": self._worker(self._receive_map, calm=True),
        }
        # The messages between tab and page, and the figures.
        self._bridge: Any = Bridge()
        self._figures = Figures()
        # What was requested and what was computed: these two are replaced while the page is open.
        self._requested = Requested(scene, refused={"page": problem} if problem else {})
        self._computed = Computed(scene)
        # The newest task of each worker: that of a hop while it is awaited, those of a family and a map until the page
        # is left.
        self._tasks: dict[str, Task] = {}
        # The callback that will request the family and the map; None while neither is to be requested.
        self._pending: TimeoutCallback | None = None
        self._closed = False  # once a message has come that no page sends
        self._fill_document()
        document.on_session_destroyed(lambda _: self.close())
        self._request_hop()

    def close(self) -> None:
        """End the workers."""
        for worker in self._workers.values():
            worker.close()

    def _worker(self, receive: Callable[[Task, object], None], calm: bool = False) -> Worker:
        """A worker whose results are passed to a method in order, in the thread of the document."""
        results = SimpleQueue[tuple[Task, object]]()  # callbacks from before the session begins come in any order

        def deliver(task: Task, result: object) -> None:
            context = self._document.session_context
            if context is None or context.destroyed:
                return  # the tab was closed while this was computed
            results.put((task, result))
            self._document.add_next_tick_callback(lambda: receive(*results.get()))

        return Worker(deliver, self._pools.calm if calm else self._pools.urgent)

    def _fill_document(self) -> None:
        """Put the figures, the template and the events into the document."""
        figures = self._figures.by_name()
        # A longer click is a press. Events requested after the figures are in the document are not received.
        for event in (Tap, Press):
            self._figures.family.figure.on_event(event, self._family_clicked)
            self._figures.map.figure.on_event(event, self._map_clicked)
        for figure in (self._figures.family.figure, self._figures.map.figure, self._figures.law.figure):
            figure.visible = False  # until there is something to show
        with self._document.models.freeze():  # otherwise all models are counted again for each figure
            for name, figure in figures.items():
                figure.name = name
                self._document.add_root(figure)
        self._bridge.on_change("request", lambda attribute, old, new: self._receive(new))
        start = CustomJS(args={"bridge": self._bridge, "figures": figures}, code="startExplorer(bridge, figures)")
        self._document.js_on_event("document_ready", start)
        self._figures.hops.heights.js_on_change("tags", start)  # a model that no root refers to is not synchronised
        lost = CustomJS(code="document.getElementById('lost').hidden = false")
        self._document.js_on_event("connection_lost", lost)
        self._document.title = "Lossless hops"
        self._document.template = Template((FOLDER / "page.html").read_text(encoding="utf-8"))
        texts = {f"page_{kind}": (FOLDER / f"page.{kind}").read_text(encoding="utf-8") for kind in ("css", "js")}
        texts["page_css"] = THEME + texts["page_css"]
        needed = Resources(mode="server", root_url="", components=["bokeh", "bokeh-widgets"]).render_js()
        self._document.template_variables.update(**texts, bokeh_needed=needed)

    # ---- requests

    def _receive(self, text: str) -> None:
        """A field was changed: {"n": number of the change, "act": name, ...}. The message is not trusted: one that the
        page never sends ends the computations of the tab for good."""
        if self._closed:
            return
        try:
            message = json.loads(text)
            act, number = str(message["act"]), int(message["n"])
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
            self._closed = True
            self._leave()
            return
        self._requested = replace(self._requested, message=number)
        if act == "leave":
            self._leave()
            return
        if act == "undo":
            self._undo()
        elif act == "stop":
            self._stop()
        elif act == "place":
            self._place_moved(message)
        elif act == "give-rows":
            if rows := self._computed.scene.rows:
                self._bridge.rows = ""
                self._bridge.rows = rows.text
        else:
            self._change(act, message)
        self._send_state()

    def _change(self, act: str, message: Mapping[str, object]) -> None:
        """Go to the scene with a change, or state why there is none."""
        try:
            scene = changed(self._requested.scene, act, message)
        except InputError as error:
            place = _place_of_fault(act, self._requested.scene)
            self._requested = replace(self._requested, refused={place: str(error)})
            return
        self._go(scene, f"{act} {message.get('name', '')}" if act == "number" else act)

    def _go(self, scene: Scene, cause: str) -> None:
        computed, before = self._computed, self._requested.scene
        self._requested = self._requested.going_to(scene, cause, computed.scene)
        if scene.hop == before.hop and computed.hop is not None:
            self._computed = replace(computed, scene=self._requested.around(computed.scene))
            self._schedule_surroundings(now=True)
        else:
            self._request_hop()

    def _request_hop(self) -> None:
        self._computed = replace(self._computed, failed={})
        scene = self._requested.scene
        self._request("hop", scene, not self._computed.dials_for(scene))

    def _request(self, name: str, *arguments: object) -> None:
        """Request a hop, a family or a map; older results are shown of hops alone."""
        self._tasks[name] = Task(name, arguments)
        self._workers[name].ask(self._tasks[name])

    def _undo(self) -> None:
        if self._requested.can_undo(self._computed.scene):
            self._requested = self._requested.undone(self._computed.scene)
            self._request_hop()

    def _leave(self) -> None:
        """Compute nothing more for a closed page, whose session ends some seconds later; results on their way are not
        shown, and a later request begins anew."""
        self._forget_pending()
        self.close()
        self._tasks.clear()

    def _stop(self) -> None:
        self._workers["hop"].stop()
        self._tasks.pop("hop", None)
        if self._computed.hop is None:
            self._requested = replace(self._requested, refused={})
            self._computed = replace(self._computed, failed={"page": "Stopped: no hop has been found yet."})
        else:
            refused = {"page": "Stopped: the page still shows the hop before."}
            self._requested = replace(self._requested, scene=self._computed.scene, refused=refused)
            self._computed = replace(self._computed, failed={})

    def _family_clicked(self, event: Tap | Press) -> None:
        """Go to the hop of the family that is nearest to a click."""
        family = self._computed.family_of(self._computed.scene)
        if family is not None and event.x is not None and event.y is not None:
            self._go_along(family, family.nearest(event.x, event.y))
            self._send_state()

    def _place_moved(self, message: Mapping[str, object]) -> None:
        """Go to a hop by its index in a piece of the family, which may have grown since."""
        place, key = message.get("value"), message.get("key")
        if not isinstance(place, int) or isinstance(place, bool):
            return
        for known, family in self._computed.pieces:
            if known == key and 0 <= place < len(family.values) and family.holds(self._computed.scene):
                self._go_along(family, place)

    def _go_along(self, family: FamilyResult, place: int) -> None:
        scene = self._computed.scene.with_numbers(**{family.along: family.values[place]}, **family.tuned[place])
        self._go(replace(scene, start=family.starts[place]), "family point")

    def _map_clicked(self, event: Tap | Press) -> None:
        centre = self._computed.map_centre
        if event.x is not None and centre + event.x > 0:
            self._change("launch", {"value": centre + float(f"{event.x:.6g}")})
            self._send_state()

    # ---- results

    def _receive_hop(self, task: Task, result: object) -> None:
        awaited = self._tasks.get("hop")
        if awaited is None or isinstance(result, Done):
            return  # a result on its way when the task was stopped is not shown
        newest = task.number == awaited.number
        if isinstance(result, HopResult):
            self._show_hop(task.arguments[0], result)
        elif isinstance(result, DialsResult):
            dials = {**self._computed.dials, kind_of(task.arguments[0]): result.dials}
            self._computed = replace(self._computed, dials=dials)
            newest = False  # the hop comes after them
        elif newest and isinstance(result, Failure):
            place = _place_of_fault(self._requested.cause, self._requested.scene)
            refused = {name: why for name, why in self._requested.refused.items() if name != place}
            self._requested = replace(self._requested, refused=refused)
            self._computed = replace(self._computed, failed={place: result.reason})
        if newest:
            del self._tasks["hop"]
        self._send_state()

    def _show_hop(self, requested: Scene, result: HopResult) -> None:
        """Show the hop of a scene, in place of the current one."""
        before, shown = self._computed, self._requested.around(result.scene)
        if requested.hop == self._requested.scene.hop:
            self._requested = replace(self._requested, scene=shown)
        steady = before.hop is not None and kind_of(before.scene) == kind_of(requested)
        self._computed = replace(before, scene=shown, hop=result, count=before.count + 1)
        self._figures.hops.show(result.data, steady)
        self._mark()
        self._schedule_surroundings()

    def _mark(self) -> None:
        """Mark the hop in the drawn family, if that is the hop's family."""
        family, hop = self._computed.family_of(self._computed.scene), self._computed.hop
        if family is not None and hop is not None:
            self._figures.family.mark(hop.scene.numbers[family.along], hop.alpha)
        else:
            self._figures.family.mark()

    def _schedule_surroundings(self, now: bool = False) -> None:
        """Request the family and the map once nothing has changed for a while."""
        self._forget_pending()
        self._pending = self._document.add_timeout_callback(self._compute_surroundings, 1 if now else PAGES.calm)

    def _forget_pending(self) -> None:
        if self._pending is not None:
            self._document.remove_timeout_callback(self._pending)
            self._pending = None

    def _compute_surroundings(self) -> None:
        self._pending = None
        law = self._computed.hop.law if self._computed.hop else None
        self._figures.law.figure.visible = law is not None
        if law is not None:
            self._figures.law.show(law)
        self._note_drawn("law", self._computed.scene)
        self._follow()
        self._computed = replace(self._computed, map_text="The map is being computed.")
        self._request("map", self._computed.scene)
        self._send_state()

    def _note_drawn(self, name: str, scene: Scene) -> None:
        self._computed = replace(self._computed, drawn={**self._computed.drawn, name: scene})

    def _follow(self) -> None:
        """Follow the family of the hop, unless it is already shown or being followed."""
        scene, current = self._computed.scene, self._tasks.get("family")
        dials = self._computed.dials_for(scene)
        bounds = {dial.name: (dial.low, dial.high) for dial in dials if dial.name in scene.numbers}
        if scene.along not in bounds:
            self._workers["family"].stop()
            self._tasks.pop("family", None)
            self._no_family("")
        elif current is None or not same_family(current.arguments[0], scene):
            self._computed = replace(self._computed, family_text="The family is being followed.")
            self._request("family", scene, *bounds[scene.along])

    def _no_family(self, why: str) -> None:
        self._computed = replace(self._computed, family=None, family_text=why)
        self._figures.family.figure.visible = False

    def _receive_family(self, task: Task, result: object) -> None:
        if task != self._tasks.get("family"):
            return
        if isinstance(result, Failure):
            del self._tasks["family"]
            self._no_family(f"No family here: {result.reason}")
        elif isinstance(result, FamilyResult):
            before = self._computed.family
            self._computed = self._computed.with_family(f"{task.number} {len(result.values)}", result)
            self._figures.family.figure.visible = True
            self._figures.family.show(result.data, steady=before is not None and before.along == result.along)
            self._mark()
        self._send_state()

    def _receive_map(self, task: Task, result: object) -> None:
        if task != self._tasks.get("map"):
            return
        if isinstance(result, Failure):
            self._computed = replace(self._computed, map_text=f"No map here: {result.reason}")
            self._figures.map.figure.visible = False
        elif isinstance(result, MapData):
            self._figures.map.figure.visible = True
            self._figures.map.show(result)
            self._note_drawn("map", task.arguments[0])
            self._computed = replace(self._computed, map_text=_text_of_map(result), map_centre=result.centre)
        self._send_state()

    def _send_state(self) -> None:
        """Send the tab the state of all its fields."""
        idle = "hop" not in self._tasks
        state = tab_state(self._requested, self._computed, idle, self._python_machine is not None)
        self._bridge.page_state = json.dumps(state)


def _text_of_map(data: MapData) -> str:
    """What a return map shows, in words."""
    if data.basin is None:
        return "The basin is being found."
    if not data.centre:
        return f"{data.share or 0:.1%} of these launches come to a lossless hop: the basin, which is shaded."
    top = f"{data.basin.max():.2g}" + (f" {data.unit}" if data.unit else "")
    return f"Launches up to {top} faster than the lossless step come back to it; others near it lead away from it."


def _place_of_fault(act: str, scene: Scene) -> str:
    """The place on the page where the fault of a change of a scene is shown."""
    return act if act in (("spring",) if scene.steps else ("spring", "gravity", "rows")) else "page"
