"""The fields of the page: their values for a scene, and the scene after a field was changed.

Messages from a tab are not trusted: every value is checked here, or by `Scene`.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from typing import Any

from orbits.errors import InputError

from ..laws import gravity as gravities, springs
from ..machines import SAME_IN_SI
from .dials import Dial
from .scene import BEGINNINGS, PYTHON_MACHINE, DroppedRows, Scene, beginning

KINDS_IN_WORDS = {
    "hopper": "hopper",
    "juggler": "juggler",
    "hopper si": "hopper, in SI",
    "juggler si": "juggler, in SI",
    "inerter_hopper": "hopper with an inerter",
    "knee_hopper": "hopper with a knee, in SI",
    "wheel": "rimless wheel",
    "rocker": "rocking block",
    "shuttle": "shuttle",
    "runner": "runner",
    "alternating-hopper": "hopper on two feet",
    "wheel si": "rimless wheel, in SI",
    "rocker si": "rocking block, in SI",
    "shuttle si": "shuttle, in SI",
    "runner si": "runner, in SI",
    "alternating-hopper si": "hopper on two feet, in SI",
}
OFFERED_FAMILIES = 12
REST_LENGTHS = {False: 10.0, True: 1.0}  # defaults for a spring without one, by whether it is in SI


def shown_fields(scene: Scene, dials: list[Dial], has_python_machine: bool) -> dict[str, Any]:
    """The values of the fields for a scene, ready for JSON.

    dials : of its parameters; their values may be older than the scene
    has_python_machine : whether the page has a machine that was made in Python
    """
    rows, fixed, free = scene.rows, scene.fixed_laws, _free_number(scene)
    shown = [_with_value(dial, scene.numbers.get(dial.name, dial.value)) for dial in dials]
    families = sorted({*range(1, OFFERED_FAMILIES + 1), scene.family})
    kinds = KINDS_IN_WORDS | ({PYTHON_MACHINE: "the machine of the Python call"} if has_python_machine else {})
    names = [dial.name for dial in dials if dial.name != "restitution" and not dial.whole]
    names = [*scene.prescribed] if scene.tuned else names  # along another number a third one would have to be tuned
    return {
        "scene": {
            "kind": scene.machine + (" si" if scene.si else ""),
            "family": scene.family,
            "spring": "" if rows else scene.spring,
            "gravity": scene.gravity,
            "fixed": fixed,
            "steps": "runs" if scene.machine in SAME_IN_SI else "yes" if scene.steps else "no",
            "floating": None if free is None else free not in scene.numbers,
            "rows": rows and {"name": rows.name, "branch": rows.branch or "", "noise": rows.noise},
            "along": scene.along,
            "launch": scene.launch,
        },
        "dials": [asdict(dial) | {"label": dial_label(dial.name)} for dial in shown],
        "machines": list(kinds.items()),
        "families": [(str(number), str(number)) for number in families],
        "alongs": [("", "none"), *((name, dial_label(name)) for name in names)],
        "springs": list(springs.NAMED),
        "gravities": list(gravities.NAMED),
    }


def _free_number(scene: Scene) -> str | None:
    """The number that a machine may be without, as one with a spring that is long enough, or with small angles."""
    if scene.fixed_laws or scene.tuned or (scene.steps and scene.si):
        return None
    return "angle" if scene.steps and scene.machine not in SAME_IN_SI else "rest_length"


def dial_label(name: str) -> str:
    """A parameter's name as a label."""
    words = name.replace("_", " ") if len(name) > 3 else name
    return "restitution of landings (map alone)" if name == "restitution" else words


def _with_value(dial: Dial, value: float) -> Dial:
    """A slider at a value, with ends that reach there."""
    low = dial.low if dial.factors and value <= 0 else min(dial.low, value)
    return replace(dial, value=value, low=low, high=max(dial.high, value))


def changed(scene: Scene, act: str, data: Mapping[str, object]) -> Scene:
    """The scene after a field was changed; raises `InputError` for an invalid change.

    act : the field
    data : what the tab sent with it
    """
    if act not in CHANGES:
        raise InputError(f"the page has no field '{act[:40]}'")
    return CHANGES[act](scene, data).complete()


def _to_number(scene: Scene, data: Mapping[str, object]) -> Scene:
    name = str(data.get("name"))
    if name != "restitution" and name not in scene.numbers:
        raise InputError(f"this machine has no parameter {name[:40]!r}")
    return scene.with_numbers(**{name: data.get("value")})  # type: ignore[arg-type]  # the scene checks it


def _to_machine(scene: Scene, data: Mapping[str, object]) -> Scene:
    kind, _, si = str(data.get("value")).partition(" ")
    if kind == PYTHON_MACHINE:
        raise InputError("go back to the machine of the Python call with undo, or by reloading the page without a link")
    return beginning(kind, si == "si")


def _to_floating(scene: Scene, data: Mapping[str, object]) -> Scene:
    free = _free_number(scene)
    if free is None:
        raise InputError("this machine needs all of its numbers")
    numbers = {name: value for name, value in scene.numbers.items() if name != free}
    if data.get("value") is not True:
        numbers[free] = BEGINNINGS[scene.machine, False]["numbers"][free] if scene.steps else REST_LENGTHS[scene.si]
    return replace(scene, numbers=numbers)


def _to_option_of_rows(name: str) -> Callable[[Scene, Mapping[str, object]], Scene]:
    def change(scene: Scene, data: Mapping[str, object]) -> Scene:
        if scene.rows is None:
            raise InputError(f"{name} needs measured rows, and there are none")
        value: Any = None if data.get("value") == "" else data.get("value")
        return replace(scene, rows=replace(scene.rows, **{name: value}))

    return change


# The fields by name; the scene checks the values.
CHANGES: dict[str, Callable[[Scene, Any], Scene]] = {
    "number": _to_number,
    "spring": lambda scene, data: replace(scene, spring=data.get("value"), rows=None, start=None),
    "gravity": lambda scene, data: replace(scene, gravity=data.get("value"), start=None),
    "machine": _to_machine,
    "family": lambda scene, data: replace(scene, family=data.get("value"), start=None),
    "floating": _to_floating,
    "rows": lambda scene, data: replace(scene, rows=DroppedRows(data.get("name"), data.get("text")), start=None),
    "rows-away": lambda scene, data: replace(scene, rows=None, start=None),
    "branch": _to_option_of_rows("branch"),
    "noise": _to_option_of_rows("noise"),
    "along": lambda scene, data: replace(scene, along=data.get("value") or ""),
    "launch": lambda scene, data: replace(scene, launch=data.get("value")),
    "lowest": lambda scene, data: replace(scene, start=None),
}
