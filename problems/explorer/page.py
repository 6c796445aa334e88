"""The page of one tab: what is asked in its fields, what its workers answer, and what it then shows."""

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
PIECES_KEPT = 8  # of a family that grows: a slider may have been moved before the newest one was there
CALM = 300  # milliseconds without a change, after which the law is drawn, and the family and the map are computed


class Bridge(DataModel):
    """What a tab and its page tell each other: a field that was changed, everything the fields show, and measured rows
    to be saved; the first two as JSON."""

    asked = String(default="")
    told = String(default="")
    rows = String(default="")


class Explorer:
    """The page of one tab.

    document : Bokeh's, which shows it
    scene : what it shows first
    given : the machine of the page, where no statement makes it
    problem : in words, what is wrong with the link that was followed; "" if nothing is
    """

    def __init__(self, document: Document, scene: Scene, given: Any = None, problem: str = ""):
        self._document, self._given = document, given
        self._wanted, self._shown = scene, scene
        self._history: list[Scene] = []
        self._cause, self._last_change = "", 0.0
        self._problems: dict[str, str] = {}
        self._failed: dict[str, str] = {}  # of these, why the hop that is wanted is not shown
        self._hop: HopAnswer | None = None
        self._family: FamilyAnswer | None = None
        self._families_told: deque[tuple[str, FamilyAnswer]] = deque(maxlen=PIECES_KEPT)
        self._dials: dict[tuple[Any, ...], list[Dial]] = {}  # by what their ends depend on
        self._texts = {"family": "", "map": ""}
        self._number = self._count = 0
        self._awaited: Task | None = None  # of which the hop is not shown yet
        self._around_it: dict[str, Task] = {}  # the newest that was asked around a hop
        self._pending: Any = None  # what will compute the family and the map
        self._workers = {
            "hop": self._worker(self._hop_came),
            "family": self._worker(self._family_came, calm=True),
            "map": self._worker(self._map_came, calm=True),
        }
        self._new_figures()
        document.on_session_destroyed(lambda _: self.close())
        self._ask_hop()
        if problem:
            self._problems = {"page": problem}

    def close(self) -> None:
        """End the workers."""
        for worker in self._workers.values():
            worker.stop()

    def _worker(self, came: Callable[[Task, Any], None], calm: bool = False) -> Worker:
        """A worker whose answers come to a method in their order, in the thread of the document."""
        answers = SimpleQueue[tuple[Task, Any]]()  # callbacks from before the session begins come in any order

        def deliver(question: Task, answer: Any) -> None:
            context = self._document.session_context
            if context is None or context.destroyed:
                return  # the tab was closed while this was computed
            answers.put((question, answer))
            self._document.add_next_tick_callback(lambda: came(*answers.get()))

        return Worker(deliver, self._given, calm)

    # ---- figures

    def _new_figures(self) -> None:
        self._bridge: Any = Bridge()
        self._hops, self._families, self._maps, self._laws = HopFigures(), FamilyFigure(), MapFigure(), LawFigure()
        hops = {name: getattr(self._hops, name) for name in ("machine", "heights", "portrait", "force", "player")}
        figures = {**hops, "family": self._families.figure, "map": self._maps.figure, "law": self._laws.figure}
        # A click that takes longer is a press. What is asked for after the figures are in the document is not heard.
        for event in (Tap, Press):
            self._families.figure.on_event(event, self._family_clicked)
            self._maps.figure.on_event(event, self._map_clicked)
        with self._document.models.freeze():  # otherwise all models are counted again for each figure
            for name, figure in figures.items():
                figure.name = name
                self._document.add_root(figure)
        self._bridge.on_change("asked", lambda attribute, old, new: self._asked(new))
        start = CustomJS(args={"bridge": self._bridge, "figures": figures}, code="startExplorer(bridge, figures)")
        self._document.js_on_event("document_ready", start)
        self._hops.heights.js_on_change("tags", start)  # what no root refers to is not kept equal on both sides
        lost = CustomJS(code="document.getElementById('lost').hidden = false")
        self._document.js_on_event("connection_lost", lost)
        self._document.title = "Lossless hops"
        self._document.template = Template((FOLDER / "page.html").read_text(encoding="utf-8"))
        texts = {f"page_{kind}": (FOLDER / f"page.{kind}").read_text(encoding="utf-8") for kind in ("css", "js")}
        needed = Resources(mode="server", root_url="", components=["bokeh", "bokeh-widgets"]).render_js()
        self._document.template_variables.update(**texts, bokeh_needed=needed)

    # ---- what is asked

    def _asked(self, text: str) -> None:
        """A field was changed: {"n": number of the change, "act": name, ...}, of which nothing is trusted."""
        try:
            told = json.loads(text)
            act, self._number = str(told["act"]), int(told["n"])
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
            self._place_moved(told)
        elif act == "give-rows":
            if self._shown.rows:
                self._bridge.rows = ""
                self._bridge.rows = self._shown.rows.text
        else:
            self._change(act, told)
        self._tell()

    def _change(self, act: str, told: dict[str, Any]) -> None:
        """Go to the scene with a change, or say why there is none."""
        place = act if act in ("spring", "gravity", "rows") else "page"
        try:
            scene = changed(self._wanted, act, told)
        except InputError as error:
            self._problems = self._failed | {place: str(error)}
            return
        self._go(scene, f"{act} {told.get('name', '')}" if act == "number" else act)

    def _go(self, scene: Scene, cause: str) -> None:
        before, self._wanted = self._wanted, scene
        now = time.monotonic()
        gesture = cause == self._cause and now - self._last_change < GESTURE
        if scene != before and not gesture and self._history[-1:] != [self._shown]:
            self._history = [*self._history, self._shown][-LONGEST_HISTORY:]
        self._cause, self._last_change = cause, now
        if scene.hop == before.hop and self._hop is not None:
            self._shown, self._problems = self._with_surroundings(self._shown), self._failed
            self._around_later(now=True)
        else:
            self._ask_hop()

    def _with_surroundings(self, scene: Scene) -> Scene:
        """A scene with what is to be shown around the hop now."""
        return replace(scene, along=self._wanted.along, launch=self._wanted.launch)

    def _ask_hop(self) -> None:
        self._problems = self._failed = {}
        self._awaited = Task("hop", (self._wanted, not self._dials_for(self._wanted)))
        self._workers["hop"].ask(self._awaited)

    @staticmethod
    def _kind_of(scene: Scene) -> tuple[Any, ...]:
        """What the ends of the sliders depend on."""
        return scene.machine, scene.si, scene.spring, scene.gravity, scene.rows, tuple(scene.numbers)

    def _dials_for(self, scene: Scene) -> list[Dial]:
        """The sliders of a scene, none where they are not known yet."""
        return self._dials.get(self._kind_of(scene), [])

    def _undo(self) -> None:
        failed = self._wanted != self._shown
        if not failed and not self._history:
            return
        scene = self._shown if failed else self._history[-1]
        if self._history[-1:] == [scene]:
            self._history = self._history[:-1]
        self._wanted, self._cause = scene, ""
        self._ask_hop()

    def _leave(self) -> None:
        """Compute nothing more for a page that nobody sees, whose session ends some seconds later; what is on its way
        is not shown, and whatever is asked later begins anew."""
        self._forget_pending()
        self.close()
        self._awaited = None
        self._around_it.clear()

    def _stop(self) -> None:
        self._workers["hop"].stop()
        self._awaited = None
        if self._hop is None:
            self._problems = self._failed = {"page": "Stopped: no hop has been found yet."}
        else:
            self._wanted, self._failed = self._shown, {}
            self._problems = {"page": "Stopped: this is still the hop before."}

    def _family_clicked(self, event: Any) -> None:
        """Go to the hop of the family that is nearest to a click."""
        family = self._family_of(self._shown)
        if family is not None:
            self._go_along(family, family.nearest(event.x, event.y))
            self._tell()

    def _place_moved(self, told: dict[str, Any]) -> None:
        """Go to a hop by its number in a piece of the family, which may have grown since."""
        place, key = told.get("value"), told.get("key")
        for known, family in self._families_told:
            if known == key and type(place) is int and 0 <= place < len(family.values) and family.holds(self._shown):
                self._go_along(family, place)

    def _family_of(self, scene: Scene) -> FamilyAnswer | None:
        """The family that is drawn, if it is that of a scene's hop; another one may be being followed."""
        family = self._family
        return family if family is not None and family.holds(scene) else None

    def _go_along(self, family: FamilyAnswer, place: int) -> None:
        scene = self._shown.with_numbers(**{family.along: family.values[place]})
        self._go(replace(scene, start=family.starts[place]), "family point")

    def _map_clicked(self, event: Any) -> None:
        if event.x is not None and event.x > 0:
            self._change("launch", {"value": float(f"{event.x:.6g}")})
            self._tell()

    # ---- what comes

    def _hop_came(self, question: Task, answer: Any) -> None:
        if self._awaited is None or isinstance(answer, Done):
            return  # what was on its way when it was stopped is not shown
        newest = question.number == self._awaited.number
        if isinstance(answer, HopAnswer):
            self._show_hop(question, answer)
        elif isinstance(answer, DialsAnswer):
            self._dials[self._kind_of(question.arguments[0])] = answer.dials
            newest = False  # the hop comes after them
        elif newest:
            place = self._cause if self._cause in ("spring", "gravity", "rows") else "page"
            self._failed = {place: answer.reason}
            self._problems = self._problems | self._failed
        if newest:
            self._awaited = None
        self._tell()

    def _show_hop(self, question: Task, answer: HopAnswer) -> None:
        asked = question.arguments[0]
        shown = self._with_surroundings(answer.scene)
        if asked.hop == self._wanted.hop:
            self._wanted = shown
        first, self._hop = self._hop is None, answer
        steady = not first and self._kind_of(self._shown) == self._kind_of(asked)
        self._shown = shown
        self._count += 1
        self._hops.show(answer.data, steady)
        self._mark()
        self._around_later()

    def _mark(self) -> None:
        """Mark the hop in the family, where that is the family through it."""
        family, hop = self._family_of(self._shown), self._hop
        if family is not None and hop is not None:
            self._families.mark(hop.scene.numbers[family.along], hop.alpha)
        else:
            self._families.mark()

    def _around_later(self, now: bool = False) -> None:
        """Compute the family and the map once nothing has changed for a while."""
        self._forget_pending()
        self._pending = self._document.add_timeout_callback(self._around, 1 if now else CALM)

    def _forget_pending(self) -> None:
        if self._pending is not None:
            self._document.remove_timeout_callback(self._pending)
            self._pending = None

    def _around(self) -> None:
        self._pending = None
        law = self._hop.law if self._hop else None
        self._laws.figure.visible = law is not None
        if law is not None:
            self._laws.show(law)
        self._follow()
        self._ask_around("map", self._shown)
        self._tell()

    def _ask_around(self, what: str, *arguments: Any) -> None:
        """Ask for a family or a map; only what comes of this is shown from now on."""
        self._around_it[what] = Task(what, arguments)
        self._workers[what].ask(self._around_it[what])

    def _follow(self) -> None:
        """Follow the family of the hop, unless that is what is shown or is being followed."""
        scene, asked = self._shown, self._around_it.get("family")
        bounds = {dial.name: (dial.low, dial.high) for dial in self._dials_for(scene) if dial.name in scene.numbers}
        if scene.along not in bounds:
            self._workers["family"].stop()
            self._around_it.pop("family", None)
            self._no_family("")
        elif asked is None or not same_family(asked.arguments[0], scene):
            self._texts["family"] = "The family is being followed."
            self._ask_around("family", scene, *bounds[scene.along])

    def _no_family(self, why: str) -> None:
        self._family, self._texts["family"] = None, why
        self._families.figure.visible = False

    def _family_came(self, question: Task, answer: Any) -> None:
        if question != self._around_it.get("family"):
            return
        if isinstance(answer, Failure):
            del self._around_it["family"]
            self._no_family(f"No family here: {answer.reason}")
        elif isinstance(answer, FamilyAnswer):
            steady = self._family is not None and self._family.along == answer.along
            self._family, self._texts["family"] = answer, answer.text
            self._families_told.append((f"{question.number} {len(answer.values)}", answer))
            self._families.figure.visible = True
            self._families.show(answer.data, steady)
            self._mark()
        self._tell()

    def _map_came(self, question: Task, answer: Any) -> None:
        if question != self._around_it.get("map"):
            return
        if isinstance(answer, Failure):
            self._texts["map"] = f"No map here: {answer.reason}"
            self._maps.figure.visible = False
        elif not isinstance(answer, Done):
            self._maps.figure.visible = True
            self._maps.show(answer)
            share = answer.share
            found = f"{share or 0:.1%} of these launches come to a lossless hop."
            self._texts["map"] = "The basin is being found." if share is None else found
        self._tell()

    # ---- what is told

    def _place(self) -> dict[str, Any] | None:
        """Which hop of its family is wanted, by its number among so many; None without one."""
        scene = self._shown if self._awaited is None else self._wanted
        family, hop = self._family_of(scene), self._hop
        if family is None or hop is None:
            return None
        value, alpha = scene.numbers[family.along], hop.alpha if scene.start is None else scene.start[1]
        at, count = family.nearest(value, alpha), len(family.values)
        text = f"hop {at + 1} of {count}, {family.along} = {value:.6g}, alpha = {alpha:.6g}"
        return {"at": at, "of": count, "key": self._families_told[-1][0], "text": text}

    def _tell(self) -> None:
        """Tell the tab everything that its fields show."""
        hop, scene = self._hop, self._shown
        link, whole = link_of(scene)
        try:
            file = machine_file(scene)
        except InputError as error:
            file = str(error)
        rows = hop.rows if hop else []
        dials = self._dials_for(self._wanted) or self._dials_for(scene)
        failing = "" if hop is None or hop.admissible else ", which is no motion"
        state = {
            "n": self._number,
            "shown": self._count,
            "idle": self._awaited is None,
            "status": f"A hop of family {scene.family}, alpha = {hop.alpha:.8g}{failing}." if hop else "",
            "title": hop.data.title if hop else "",
            "problems": self._problems,
            "table": html_table(rows, "Certificate"),
            "undo": bool(self._history) or self._wanted != self._shown,
            "lowest": scene.start is not None,
            "link": link,
            "link-text": "" if whole else ROWS_LEFT_OUT,
            "family-text": self._texts["family"],
            "map-text": self._texts["map"],
            "place": self._place(),
            "python": python_lines(scene),
            "file": file,
            **shown_fields(self._wanted, dials, self._given is not None),
        }
        self._bridge.told = json.dumps(state)
