"""A scene in the forms in which it leaves the page and comes back: a link, a machine file, lines of Python."""

import base64
import json
import zlib
from collections.abc import Mapping
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from orbits.errors import InputError

from ..laws import HYSTERETIC_KINDS
from ..machines import MASSES, RATIOS, SAME_IN_SI, SI_KEYS, SI_KEYS_OF_STEPS, STEPPING
from .scene import (
    LARGEST,
    LINEAR_IN_SI,
    LOSSES,
    PYTHON_MACHINE,
    DroppedRows,
    Scene,
    beginning,
    with_surroundings,
)

# The prefix of a parameter's name in a link, so that no parameter is mistaken for a word of `LINK_WORDS`.
NUMBER = "p."
LINK_WORDS = (
    "machine",
    "si",
    "spring",
    "gravity",
    "family",
    "start",
    "along",
    "launch",
    "rows",
    "name",
    "branch",
    "noise",
)


def link_of(scene: Scene) -> tuple[str, bool]:
    """The scene as the query of an address, and whether it is complete: a link leaves out many measured rows."""
    args: dict[str, str] = {"machine": scene.machine}
    if scene.si:
        args["si"] = "1"
    if not scene.fixed_laws:
        args |= {"spring": scene.spring, "gravity": scene.gravity}
    args |= {NUMBER + name: repr(value) for name, value in scene.numbers.items()} | {"family": str(scene.family)}
    if scene.start is not None:
        args["start"] = ",".join(map(repr, scene.start))
    args |= {"along": scene.along} if scene.along else {}
    args |= {"launch": repr(scene.launch)} if scene.launch is not None else {}
    whole = True
    if scene.rows is not None:
        packed = base64.urlsafe_b64encode(zlib.compress(scene.rows.text.encode(), 9)).decode()
        if whole := len(packed) <= LARGEST.rows_in_link:
            args |= {"name": scene.rows.name, "rows": packed}
            args |= {"branch": scene.rows.branch} if scene.rows.branch else {}
            args |= {"noise": repr(scene.rows.noise)} if scene.rows.noise is not None else {}
    return urlencode(args), whole


def scene_of_link(query: Mapping[str, list[bytes]]) -> Scene:
    """The scene of a query, as a server receives its arguments; raises `InputError` for an invalid one."""
    args: dict[str, str] = {}
    for name, values in query.items():
        if len(values) != 1 or len(values[0]) > LARGEST.value_in_link:
            raise InputError(f"the link states '{name[:40]}' more than once, or its value is too long")
        if name not in LINK_WORDS and not name.startswith(NUMBER):
            raise InputError(f"the link has an unknown word '{name[:40]}'; it knows {', '.join(LINK_WORDS)}")
        try:
            args[name] = values[0].decode("utf-8")
        except UnicodeDecodeError:
            raise InputError(f"'{name[:40]}' of the link is not text") from None
    numbers = {
        name.removeprefix(NUMBER): _number_in_link(name, text) for name, text in args.items() if name.startswith(NUMBER)
    }
    start = tuple(_number_in_link("start", part) for part in args["start"].split(",")) if "start" in args else None
    scene = Scene(
        args.get("machine", "hopper"),
        _number_in_link("si", args.get("si", "0")) == 1,
        args.get("spring", "r"),
        args.get("gravity", "1"),
        _rows_of(args),
        numbers,
        _whole_in_link("family", args.get("family", "1")),
        start,
        args.get("along", ""),
        _number_in_link("launch", args["launch"]) if "launch" in args else None,
    )
    return scene.complete()


def _rows_of(args: Mapping[str, str]) -> DroppedRows | None:
    """The measured rows in a link; no more characters are unpacked than a table may have."""
    if "rows" not in args:
        return None
    try:
        packed = base64.b64decode(args["rows"], altchars=b"-_", validate=True)
        unpacking = zlib.decompressobj()
        text = unpacking.decompress(packed, LARGEST.rows + 1)
        if len(text) > LARGEST.rows or not unpacking.eof:
            raise ValueError
        decoded = text.decode("utf-8")
    except (ValueError, zlib.error):
        raise InputError("the measured rows in the link are damaged, or too many") from None
    noise = _number_in_link("noise", args["noise"]) if "noise" in args else None
    return DroppedRows(args.get("name", "rows"), decoded, args.get("branch"), noise)


def _number_in_link(name: str, text: str) -> float:
    try:
        return float(text)  # the scene refuses numbers that are not finite
    except ValueError:
        raise InputError(f"'{name[:40]}' of the link is {text[:40]!r}, not a number") from None


def _whole_in_link(name: str, text: str) -> int:
    value = _number_in_link(name, text[:40])
    if not value.is_integer():
        raise InputError(f"'{name[:40]}' of the link is {text[:40]!r}, not a whole number")
    return int(value)


def scene_of_statement(stated: Mapping[str, Any], family: int = 1) -> Scene:
    """The scene of a statement of a machine file or of the command line, whose table is read from its file.

    Raises `InputError` for a table that cannot be read, and for what the page does not show; `Scene.build` refuses
    other faults.
    """
    si = stated.get("si")
    machine, spring = stated.get("machine", "hopper"), stated.get("spring")
    if machine in STEPPING:
        own = {name: stated[name] for name in ("mass_ratio", "rest_length") if stated.get(name) is not None}
        return _scene_of_steps(machine, si, spring, own | stated.get("parameters", {}), family)
    if "ground" in stated:
        raise InputError("the page shows hops on rigid ground, which have a family: leave [ground] out")
    if isinstance(spring, str) and spring.partition(":")[0] in HYSTERETIC_KINDS:
        raise InputError(
            f"spring '{spring}' has hysteresis, and no lossless hop to show: state the mean of its branches"
        )
    rows = _rows_from_file(spring) if isinstance(spring, str) and spring.startswith("table:") else None
    numbers = dict(stated.get("parameters", {}))
    numbers |= {name: stated[name] for name in ("mass_ratio", "rest_length", *LOSSES) if stated.get(name) is not None}
    gravity = str(stated.get("gravity", "1"))
    if si is not None:
        numbers |= si
        if "body_radius" in si:
            gravity = "1/(1 + z/body_radius)**2"
    plain = LINEAR_IN_SI if si is not None else "r"
    scene = Scene(
        str(machine), si is not None, plain if spring is None or rows else str(spring), gravity, rows, numbers, family
    )
    return with_surroundings(scene.complete())


def _scene_of_steps(
    machine: str, si: Mapping[str, float] | None, spring: str | None, parameters: Mapping[str, float], family: int
) -> Scene:
    """The scene of a statement of a machine that steps; the page begins with a usual one where nothing is stated."""
    if si is None and spring is None and not parameters:
        return replace(beginning(machine), family=family)
    numbers = dict(parameters)
    if si is not None:
        defaults = {name: each.default for name, each in signature(STEPPING[machine]).parameters.items()}
        usual = {name: defaults[name] for name in SI_KEYS_OF_STEPS[machine] if isinstance(defaults[name], float)}
        numbers |= {name: value for name, value in (usual | dict(si)).items() if (name, value) != ("slope", 0.0)}
    law = spring or beginning(machine, si is not None).spring
    return with_surroundings(Scene(machine, si is not None, law, numbers=numbers, family=family).complete())


def _rows_from_file(spring: str) -> DroppedRows:
    """The rows of "table:FILE?branch=loading&noise=0.5", with the text of the file."""
    from ..laws import table_options
    from ..recordings import text_of

    path, options = table_options(spring.removeprefix("table:"))
    if moved := [name for name in ("scale", "shift") if name in options]:
        raise InputError(f"spring '{spring}': the page shows a table only as it was measured: leave {moved[0]} out")
    return DroppedRows(Path(path).name, text_of(Path(path)), **options)


def machine_file(scene: Scene) -> str:
    """The scene's machine as the text of a file that `orbits find --machine` takes; raises `InputError` where no
    statement makes the machine."""
    if scene.fixed_laws:
        raise InputError("a machine that is made in Python has no machine file; the Python lines make it")
    stated = scene.statement()
    tables: dict[str, dict[str, Any]] = {name: stated.pop(name) for name in ("si", "parameters") if name in stated}
    lines = [f"{name} = {_toml(value)}" for name, value in stated.items()]
    if scene.tuned:
        tables["find"] = {"tune": [*scene.tuned], "at": dict(scene.prescribed)}
        if scene.start is not None:
            tables["find"]["start"] = dict(zip(scene.start_names, scene.start, strict=True))
    for name, values in tables.items():
        lines += ["", f"[{name}]", *(f"{each} = {_toml(value)}" for each, value in values.items())]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    """A text, a number, a list of texts, or numbers by name as TOML; texts of JSON are texts of TOML too."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{json.dumps(name)} = {number!r}" for name, number in value.items()) + "}"
    return json.dumps(value) if isinstance(value, str | list) else repr(value)


def python_lines(scene: Scene) -> str:
    """The lines of Python that make the scene's machine and find its hop."""
    start = ""
    if scene.start is not None:
        known = dict(zip(scene.start_names, scene.start, strict=True))
        named = f"dict({', '.join(f'{name}={value!r}' for name, value in known.items())})"
        start = f", start={named if all(map(str.isidentifier, known)) else repr(known)}"
    tuned = f", tune={scene.tuned!r}, at={scene.prescribed!r}" if scene.tuned else ""
    find = f"orbit = find(machine, family={scene.family}{tuned}{start})\nprint(orbit)\n"
    if scene.fixed_laws:
        numbers = ", ".join(f"{name}={value!r}" for name, value in scene.numbers.items() if name != "restitution")
        made = f"from problems import {scene.machine}\n\nmachine = {scene.machine}()"
        if scene.machine == PYTHON_MACHINE:
            made = "\n# machine: the one that explore was called with\nmachine = machine"
        return f"from orbits import find\n{made}.with_values({numbers})\n{find}"
    stated = scene.statement()
    si, parameters = stated.get("si"), stated.get("parameters")
    kind = stated["machine"]
    maker = f"{kind}_in_si" if si is not None else kind.capitalize()
    arguments = []
    if scene.steps:
        maker, parameters = STEPPING[kind].__name__, parameters or {}
        names = SI_KEYS_OF_STEPS[kind] if kind in SAME_IN_SI else (*RATIOS, "friction")
        own = si or {name: parameters[name] for name in names if name in parameters}
        parameters = {name: value for name, value in parameters.items() if name not in own}
        arguments += [f"{name}={value!r}" for name, value in own.items()]
        arguments += [f"spring={stated['spring']!r}"] if "spring" in stated else []
        arguments += ["in_si=True"] if kind in SAME_IN_SI and si else []
    elif si is not None:
        arguments += [repr(si[name]) for name in MASSES[kind]]
        arguments += [f"force={stated['spring']!r}"] if "spring" in stated else []
        arguments += [f"{name}={si[name]!r}" for name in SI_KEYS if name in si]
    else:
        arguments.append(repr(stated["spring"]))
        arguments += [f"{name}={stated[name]!r}" for name in ("mass_ratio", "rest_length") if name in stated]
    arguments += [f"{name}={stated[name]!r}" for name in ("gravity", *LOSSES) if name in stated]
    arguments += [f"parameters={parameters!r}"] if parameters else []
    call = f"machine = {maker}({', '.join(arguments)})"
    if len(call) > 100:
        call = f"machine = {maker}(\n    " + ",\n    ".join(arguments) + ",\n)"
    return f"from orbits import find\nfrom problems import {maker}\n\n{call}\n{find}"
