"""The state of a page: what was requested of it, what was computed for it, and the fields of its tab, which follow."""

import time
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from orbits.errors import InputError
from orbits.tables import html_table

from .dials import Dial
from .fields import shown_fields
from .forms import link_of, machine_file, python_lines
from .results import FamilyResult, HopResult
from .scene import Scene
from .words import captions, verdict


class PageOptions(NamedTuple):
    """When a page computes and sends, and what it undoes."""

    history: int = 200  # scenes to which undo returns, at most
    gesture: float = 1.0  # seconds: changes of one field that follow sooner are undone together
    sent_pieces: int = 8  # pieces of a growing family: a slider may have been moved before the newest piece arrived
    # Milliseconds without a change, after which the law is drawn, and the family and the map are computed.
    calm: int = 300


PAGES = PageOptions()
ROWS_LEFT_OUT = "The measured rows are too many for a link, which leaves them out: save the machine file and its rows."
FIGURES_OF_HOP = ("machine", "heights", "portrait", "force")


@dataclass(frozen=True)
class Requested:
    """What was requested of a page.

    scene : requested last
    history : the scenes to which undo returns, the newest last
    cause, changed_at : the change that led to the scene, and when it came (s)
    refused : why the last change was not made, in words, by the place on the page
    message : the number of the tab's last message
    """

    scene: Scene
    history: tuple[Scene, ...] = ()
    cause: str = ""
    changed_at: float = 0.0
    refused: Mapping[str, str] = field(default_factory=dict)
    message: int = 0

    def going_to(self, scene: Scene, cause: str, shown: Scene) -> "Requested":
        """After a change to a scene; undo returns to the one that is shown."""
        now, history = time.monotonic(), self.history
        gesture = cause == self.cause and now - self.changed_at < PAGES.gesture
        if scene != self.scene and not gesture and history[-1:] != (shown,):
            history = (*history, shown)[-PAGES.history :]
        return replace(self, scene=scene, history=history, cause=cause, changed_at=now, refused={})

    def can_undo(self, shown: Scene) -> bool:
        """Whether there is a scene to which undo returns."""
        return bool(self.history) or self.scene != shown

    def undone(self, shown: Scene) -> "Requested":
        """After an undo: back to the scene that is shown or, where that is the requested one, to the one before it."""
        scene = shown if self.scene != shown else self.history[-1]
        history = self.history[:-1] if self.history[-1:] == (scene,) else self.history
        return replace(self, scene=scene, history=history, cause="", refused={})

    def around(self, scene: Scene) -> Scene:
        """A scene with the family parameter and the launch speed that are requested now."""
        return replace(scene, along=self.scene.along, launch=self.scene.launch)


@dataclass(frozen=True)
class Computed:
    """What was computed for a page.

    scene : that is shown: the hop's or, before there is one, the page's first
    hop : that is shown, None before there is one
    count : the number of hops that were shown
    failed : why the requested hop is not shown, in words, by the place on the page
    dials : the sliders that are known, by the `kind_of` their scenes
    family, family_text : the family that is drawn, None without one; its extent, or why there is none, in words
    pieces : the newest families that were drawn, the last one last, each after the key by which the tab refers to it
    drawn : the scenes whose spring and whose map are drawn, by the figures' names
    map_text, map_centre : the status of the map, in words, and the launch speed from which it counts all others
    """

    scene: Scene
    hop: HopResult | None = None
    count: int = 0
    failed: Mapping[str, str] = field(default_factory=dict)
    dials: Mapping[Hashable, list[Dial]] = field(default_factory=dict)
    family: FamilyResult | None = None
    family_text: str = ""
    pieces: tuple[tuple[str, FamilyResult], ...] = ()
    drawn: Mapping[str, Scene] = field(default_factory=dict)
    map_text: str = ""
    map_centre: float = 0.0

    def dials_for(self, scene: Scene) -> list[Dial]:
        """The sliders of a scene; none where they are not known yet."""
        return self.dials.get(kind_of(scene), [])

    def family_of(self, scene: Scene) -> FamilyResult | None:
        """The drawn family, if it is that of a scene's hop; another one may be in computation."""
        return self.family if self.family is not None and self.family.holds(scene) else None

    def with_family(self, key: str, family: FamilyResult) -> "Computed":
        """These results with a family that is drawn from now on."""
        pieces = (*self.pieces, (key, family))[-PAGES.sent_pieces :]
        return replace(self, family=family, family_text=family.text, pieces=pieces)


def kind_of(scene: Scene) -> Hashable:
    """The properties of a scene on which the ends of the sliders depend."""
    return scene.machine, scene.si, scene.spring, scene.gravity, scene.rows, tuple(scene.numbers)


def tab_state(requested: Requested, computed: Computed, idle: bool, has_python_machine: bool) -> dict[str, object]:
    """The fields of the tab by name, ready for JSON.

    idle : whether no hop is awaited
    has_python_machine : whether the page has a machine that was made in Python
    """
    hop, scene = computed.hop, computed.scene
    link, whole = link_of(scene)
    try:
        file = machine_file(scene)
    except InputError as error:
        file = str(error)
    rows = hop.rows if hop else []
    dials = computed.dials_for(requested.scene) or computed.dials_for(scene)
    yes_or_no, sentence = verdict(scene, hop, computed.failed)
    return {
        "n": requested.message,
        "shown": computed.count,
        "idle": idle,
        "verdict": yes_or_no,
        "status": sentence,
        "title": hop.data.title if hop else "",
        "problems": {**computed.failed, **requested.refused},
        "captions": captions(scene, hop),
        "stale": _stale(requested.scene, computed),
        "certificate-title": f"Certificate: all {len(rows)} numbers of this motion, with error bounds" if rows else "",
        "table": html_table(rows, "Certificate"),
        "undo": requested.can_undo(scene),
        "lowest": scene.start is not None and not scene.tuned,
        "link": link,
        "link-text": "" if whole else ROWS_LEFT_OUT,
        "family-text": computed.family_text,
        "map-text": computed.map_text,
        "place": _place(computed, scene if idle else requested.scene),
        "python": python_lines(scene),
        "file": file,
        **shown_fields(requested.scene, dials, has_python_machine),
    }


def _stale(requested: Scene, computed: Computed) -> list[str]:
    """The figures that are not those of the requested scene, by name."""
    hop = requested.hop
    names = [*FIGURES_OF_HOP] if computed.hop is not None and computed.scene.hop != hop else []
    names += [name for name, scene in computed.drawn.items() if scene.hop != hop]
    return names + ([] if computed.family is None or computed.family_of(requested) else ["family"])


def _place(computed: Computed, scene: Scene) -> dict[str, object] | None:
    """The index of a scene's hop in the drawn family and the number of hops there; None without a family."""
    family, hop = computed.family_of(scene), computed.hop
    if family is None or hop is None:
        return None
    value, alpha = scene.numbers[family.along], hop.alpha if scene.start is None else scene.start[1]
    at, count = family.nearest(value, alpha), len(family.values)
    text = f"hop {at + 1} of {count}, {family.along} = {value:.6g}, alpha = {alpha:.6g}"
    return {"at": at, "of": count, "key": computed.pieces[-1][0], "text": text}
