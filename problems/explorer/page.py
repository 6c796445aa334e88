"""The page of one tab: the requests of its fields, the results of its workers, and the figures and fields shown."""

import json
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from bokeh.core.properties import String
from bokeh.document import Document
from bokeh.events import Press, Tap
from bokeh.model import DataModel
from bokeh.models import CustomJS
from bokeh.resources import Resources
from jinja2 import Template

from orbits.errors import InputError
from orbits.show.pages.family_view import FamilyFigure
from orbits.show.pages.hop_view import HopFigures
from orbits.show.pages.law_view import LawFigure
from orbits.show.pages.map_view import MapFigure
from orbits.tables import html_table

from .answers import DialsAnswer, FamilyAnswer, HopAnswer, same_family
from .dials import Dial
from .fields import changed, shown_fields
from .forms import link_of, machine_file, python_lines
from .scene import Scene
from .worker import Done, Failure, Task, Worker

FOLDER = Path(__file__).parent
LONGEST_HISTORY = 200
GESTURE = 1.0  # seconds: changes of one field that follow sooner are undone together
ROWS_LEFT_OUT = "The measured rows are too many for a link, which leaves them out: save the machine file and its rows."
MOST_SENT_PIECES = 8  # of a growing family: a slider may have been moved before the newest piece arrived
CALM = 300  # milliseconds without a change, after which the law is drawn, and the family and the map are computed


class Bridge(DataModel):
    """The messages between a tab and its page: a field that was changed, the state of all fields, and measured rows to
    be saved; the first two as JSON."""

    request = String(default="")
    page_state = String(default="")
    rows = String(default="")


class Explorer:
    """The page of one tab.

    document : Bokeh's, which shows it
    scene : the scene shown first
    python_machine : the machine of the page, where no statement makes it
    problem : the fault of the link that was followed, in words; "" if there is none
    """

    def __init__(self, document: Document, scene: Scene, python_machine: Any = None, problem: str = ""):
        self._document, self._python_machine = document, python_machine
        self._requested, self._shown = scene, scene
        self._history: list[Scene] = []
        self._cause, self._last_change = "", 0.0
        self._problems: dict[str, str] = {}
        self._failed: dict[str, str] = {}  # of these, why the requested hop is not shown
        self._hop: HopAnswer | None = None
        self._family: FamilyAnswer | None = None
        self._sent_families: deque[tuple[str, FamilyAnswer]] = deque(maxlen=MOST_SENT_PIECES)
        self._dials: dict[tuple[Any, ...], list[Dial]] = {}  # by the key of `_kind_of`, on which their ends depend
        self._texts = {"family": "", "map": ""}
        self._number = self._count = 0
        self._awaited: Task | None = None  # whose hop is not shown yet
        self._surrounding_tasks: dict[str, Task] = {}  # the newest family and map requested around a hop
        self._pending: Any = None  # the callback that will request the family and the map
        self._workers = {
            "hop": self._worker(self._receive_hop),
            "family": self._worker(self._receive_family, calm=True),
            "map": self._worker(self._receive_map, calm=True),
        }
        self._new_figures()
        document.on_session_destroyed(lambda _: self.close())
        self._request_hop()
        if problem:
            self._problems = {"page": problem}

    def close(self) -> None:
        """End the workers."""
        for worker in self._workers.values():
            worker.stop()

    def _worker(self, receive: Callable[[Task, Any], None], calm: bool = False) -> Worker:
        """A worker whose results are passed to a method in order, in the thread of the document."""
        results = SimpleQueue[tuple[Task, Any]]()  # callbacks from before the session begins come in any order

        def deliver(task: Task, result: Any) -> None:
            context = self._document.session_context
            if context is None or context.destroyed:
                return  # the tab was closed while this was computed
            results.put((task, result))
            self._document.add_next_tick_callback(lambda: receive(*results.get()))

        return Worker(deliver, self._python_machine, calm)

    # ---- figures

    def _new_figures(self) -> None:
        self._bridge: Any = Bridge()
        self._hops, self._families, self._maps, self._laws = HopFigures(), FamilyFigure(), MapFigure(), LawFigure()
        hops = {name: getattr(self._hops, name) for name in ("machine", "heights", "portrait", "force", "player")}
        figures = {**hops, "family": self._families.figure, "map": self._maps.figure, "law": self._laws.figure}
        # A longer click is a press. Events requested after the figures are in the document are not received.
        for event in (Tap, Press):
            self._families.figure.on_event(event, self._family_clicked)
            self._maps.figure.on_event(event, self._map_clicked)
        with self._document.models.freeze():  # otherwise all models are counted again for each figure
            for name, figure in figures.items():
                figure.name = name
                self._document.add_root(figure)
        self._bridge.on_change("request", lambda attribute, old, new: self._receive(new))
        start = CustomJS(args={"bridge": self._bridge, "figures": figures}, code="startExplorer(bridge, figures)")
        self._document.js_on_event("document_ready", start)
        self._hops.heights.js_on_change("tags", start)  # a model that no root refers to is not synchronised
        lost = CustomJS(code="document.getElementById('lost').hidden = false")
        self._document.js_on_event("connection_lost", lost)
        self._document.title = "Lossless hops"
        self._document.template = Template((FOLDER / "page.html").read_text(encoding="utf-8"))
        texts = {f"page_{kind}": (FOLDER / f"page.{kind}").read_text(encoding="utf-8") for kind in ("css", "js")}
        needed = Resources(mode="server", root_url="", components=["bokeh", "bokeh-widgets"]).render_js()
        self._document.template_variables.update(**texts, bokeh_needed=needed)

    # ---- requests

    def _receive(self, text: str) -> None:
        """A field was changed: {"n": number of the change, "act": name, ...}, none of which is trusted."""
        try:
            message = json.loads(text)
            act, self._number = str(message["act"]), int(message["n"])
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
            return
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
            if self._shown.rows:
                self._bridge.rows = ""
                self._bridge.rows = self._shown.rows.text
        else:
            self._change(act, message)
        self._send_state()

    def _change(self, act: str, message: dict[str, Any]) -> None:
        """Go to the scene with a change, or state why there is none."""
        place = act if act in ("spring", "gravity", "rows") else "page"
        try:
            scene = changed(self._requested, act, message)
        except InputError as error:
            self._problems = self._failed | {place: str(error)}
            return
        self._go(scene, f"{act} {message.get('name', '')}" if act == "number" else act)

    def _go(self, scene: Scene, cause: str) -> None:
        before, self._requested = self._requested, scene
        now = time.monotonic()
        gesture = cause == self._cause and now - self._last_change < GESTURE
        if scene != before and not gesture and self._history[-1:] != [self._shown]:
            self._history = [*self._history, self._shown][-LONGEST_HISTORY:]
        self._cause, self._last_change = cause, now
        if scene.hop == before.hop and self._hop is not None:
            self._shown, self._problems = self._with_surroundings(self._shown), self._failed
            self._schedule_surroundings(now=True)
        else:
            self._request_hop()

    def _with_surroundings(self, scene: Scene) -> Scene:
        """A scene with the family parameter and the launch speed that are requested now."""
        return replace(scene, along=self._requested.along, launch=self._requested.launch)

    def _request_hop(self) -> None:
        self._problems = self._failed = {}
        self._awaited = Task("hop", (self._requested, not self._dials_for(self._requested)))
        self._workers["hop"].ask(self._awaited)

    @staticmethod
    def _kind_of(scene: Scene) -> tuple[Any, ...]:
        """The properties of a scene on which the ends of the sliders depend."""
        return scene.machine, scene.si, scene.spring, scene.gravity, scene.rows, tuple(scene.numbers)

    def _dials_for(self, scene: Scene) -> list[Dial]:
        """The sliders of a scene; none where they are not known yet."""
        return self._dials.get(self._kind_of(scene), [])

    def _undo(self) -> None:
        failed = self._requested != self._shown
        if not failed and not self._history:
            return
        scene = self._shown if failed else self._history[-1]
        if self._history[-1:] == [scene]:
            self._history = self._history[:-1]
        self._requested, self._cause = scene, ""
        self._request_hop()

    def _leave(self) -> None:
        """Compute nothing more for a closed page, whose session ends some seconds later; results on their way are not
        shown, and a later request begins anew."""
        self._forget_pending()
        self.close()
        self._awaited = None
        self._surrounding_tasks.clear()

    def _stop(self) -> None:
        self._workers["hop"].stop()
        self._awaited = None
        if self._hop is None:
            self._problems = self._failed = {"page": "Stopped: no hop has been found yet."}
        else:
            self._requested, self._failed = self._shown, {}
            self._problems = {"page": "Stopped: this is still the hop before."}

    def _family_clicked(self, event: Any) -> None:
        """Go to the hop of the family that is nearest to a click."""
        family = self._family_of(self._shown)
        if family is not None:
            self._go_along(family, family.nearest(event.x, event.y))
            self._send_state()

    def _place_moved(self, message: dict[str, Any]) -> None:
        """Go to a hop by its index in a piece of the family, which may have grown since."""
        place, key = message.get("value"), message.get("key")
        for known, family in self._sent_families:
            if known == key and type(place) is int and 0 <= place < len(family.values) and family.holds(self._shown):
                self._go_along(family, place)

    def _family_of(self, scene: Scene) -> FamilyAnswer | None:
        """The drawn family, if it is that of a scene's hop; another one may be in computation."""
        family = self._family
        return family if family is not None and family.holds(scene) else None

    def _go_along(self, family: FamilyAnswer, place: int) -> None:
        scene = self._shown.with_numbers(**{family.along: family.values[place]})
        self._go(replace(scene, start=family.starts[place]), "family point")

    def _map_clicked(self, event: Any) -> None:
        if event.x is not None and event.x > 0:
            self._change("launch", {"value": float(f"{event.x:.6g}")})
            self._send_state()

    # ---- results

    def _receive_hop(self, task: Task, result: Any) -> None:
        if self._awaited is None or isinstance(result, Done):
            return  # a result on its way when the task was stopped is not shown
        newest = task.number == self._awaited.number
        if isinstance(result, HopAnswer):
            self._show_hop(task, result)
        elif isinstance(result, DialsAnswer):
            self._dials[self._kind_of(task.arguments[0])] = result.dials
            newest = False  # the hop comes after them
        elif newest:
            place = self._cause if self._cause in ("spring", "gravity", "rows") else "page"
            self._failed = {place: result.reason}
            self._problems = self._problems | self._failed
        if newest:
            self._awaited = None
        self._send_state()

    def _show_hop(self, task: Task, result: HopAnswer) -> None:
        requested = task.arguments[0]
        shown = self._with_surroundings(result.scene)
        if requested.hop == self._requested.hop:
            self._requested = shown
        first, self._hop = self._hop is None, result
        steady = not first and self._kind_of(self._shown) == self._kind_of(requested)
        self._shown = shown
        self._count += 1
        self._hops.show(result.data, steady)
        self._mark()
        self._schedule_surroundings()

    def _mark(self) -> None:
        """Mark the hop in the drawn family, if that is the hop's family."""
        family, hop = self._family_of(self._shown), self._hop
        if family is not None and hop is not None:
            self._families.mark(hop.scene.numbers[family.along], hop.alpha)
        else:
            self._families.mark()

    def _schedule_surroundings(self, now: bool = False) -> None:
        """Request the family and the map once nothing has changed for a while."""
        self._forget_pending()
        self._pending = self._document.add_timeout_callback(self._compute_surroundings, 1 if now else CALM)

    def _forget_pending(self) -> None:
        if self._pending is not None:
            self._document.remove_timeout_callback(self._pending)
            self._pending = None

    def _compute_surroundings(self) -> None:
        self._pending = None
        law = self._hop.law if self._hop else None
        self._laws.figure.visible = law is not None
        if law is not None:
            self._laws.show(law)
        self._follow()
        self._request("map", self._shown)
        self._send_state()

    def _request(self, name: str, *arguments: Any) -> None:
        """Request a family or a map; only the results of this task are shown from now on."""
        self._surrounding_tasks[name] = Task(name, arguments)
        self._workers[name].ask(self._surrounding_tasks[name])

    def _follow(self) -> None:
        """Follow the family of the hop, unless it is already shown or being followed."""
        scene, current = self._shown, self._surrounding_tasks.get("family")
        bounds = {dial.name: (dial.low, dial.high) for dial in self._dials_for(scene) if dial.name in scene.numbers}
        if scene.along not in bounds:
            self._workers["family"].stop()
            self._surrounding_tasks.pop("family", None)
            self._no_family("")
        elif current is None or not same_family(current.arguments[0], scene):
            self._texts["family"] = "The family is being followed."
            self._request("family", scene, *bounds[scene.along])

    def _no_family(self, why: str) -> None:
        self._family, self._texts["family"] = None, why
        self._families.figure.visible = False

    def _receive_family(self, task: Task, result: Any) -> None:
        if task != self._surrounding_tasks.get("family"):
            return
        if isinstance(result, Failure):
            del self._surrounding_tasks["family"]
            self._no_family(f"No family here: {result.reason}")
        elif isinstance(result, FamilyAnswer):
            steady = self._family is not None and self._family.along == result.along
            self._family, self._texts["family"] = result, result.text
            self._sent_families.append((f"{task.number} {len(result.values)}", result))
            self._families.figure.visible = True
            self._families.show(result.data, steady)
            self._mark()
        self._send_state()

    def _receive_map(self, task: Task, result: Any) -> None:
        if task != self._surrounding_tasks.get("map"):
            return
        if isinstance(result, Failure):
            self._texts["map"] = f"No map here: {result.reason}"
            self._maps.figure.visible = False
        elif not isinstance(result, Done):
            self._maps.figure.visible = True
            self._maps.show(result)
            share = result.share
            found = f"{share or 0:.1%} of these launches come to a lossless hop."
            self._texts["map"] = "The basin is being found." if share is None else found
        self._send_state()

    # ---- the state sent to the tab

    def _place(self) -> dict[str, Any] | None:
        """The requested hop's index in its family and the number of hops there; None without a family."""
        scene = self._shown if self._awaited is None else self._requested
        family, hop = self._family_of(scene), self._hop
        if family is None or hop is None:
            return None
        value, alpha = scene.numbers[family.along], hop.alpha if scene.start is None else scene.start[1]
        at, count = family.nearest(value, alpha), len(family.values)
        text = f"hop {at + 1} of {count}, {family.along} = {value:.6g}, alpha = {alpha:.6g}"
        return {"at": at, "of": count, "key": self._sent_families[-1][0], "text": text}

    def _send_state(self) -> None:
        """Send the tab the state of all its fields."""
        hop, scene = self._hop, self._shown
        link, whole = link_of(scene)
        try:
            file = machine_file(scene)
        except InputError as error:
            file = str(error)
        rows = hop.rows if hop else []
        dials = self._dials_for(self._requested) or self._dials_for(scene)
        failing = "" if hop is None or hop.admissible else ", which is no motion"
        state = {
            "n": self._number,
            "shown": self._count,
            "idle": self._awaited is None,
            "status": f"A hop of family {scene.family}, alpha = {hop.alpha:.8g}{failing}." if hop else "",
            "title": hop.data.title if hop else "",
            "problems": self._problems,
            "table": html_table(rows, "Certificate"),
            "undo": bool(self._history) or self._requested != self._shown,
            "lowest": scene.start is not None,
            "link": link,
            "link-text": "" if whole else ROWS_LEFT_OUT,
            "family-text": self._texts["family"],
            "map-text": self._texts["map"],
            "place": self._place(),
            "python": python_lines(scene),
            "file": file,
            **shown_fields(self._requested, dials, self._python_machine is not None),
        }
        self._bridge.page_state = json.dumps(state)
