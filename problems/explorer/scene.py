"""The scene that the page shows, as one frozen object, and the machine that it describes.

A scene comes from a link, from fields of the page or from a dropped file. None of them is trusted: names, numbers and
texts are bounded here, its formulas are read by the project's parser alone, and no formula can name a file. The rows of
a measured spring are part of the scene.
"""

import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

from orbits.errors import InputError, finite_number, whole_number
from orbits.laws import Law
from orbits.model import Machine, free_parameters
from orbits.periodic import LinearSearch
from orbits.symbolic import parse, suggest
from orbits.units import STANDARD_GRAVITY

from ..laws import gravity as gravities, springs
from ..machines import KINDS, MASSES, SI_KEYS, SI_KEYS_OF_STEPS, SI_PARAMETERS, STEPPING, AnyMachine, MachineInSI, build

# A machine passed to `explore` that no statement makes.
PYTHON_MACHINE = "given"
# Machines whose laws the page does not change, by the names of the functions of `problems` that make them.
WITH_FIXED_LAWS = ("inerter_hopper", "knee_hopper")
# The spring of a machine in SI whose stiffness is a parameter of its own.
LINEAR_IN_SI = "stiffness*r"
LOSSES = ("restitution", "damping", "drag")
# Numbers of a machine that steps that it may be without; none of them changes a lossless step.
OPTIONAL_OF_STEPS = ("friction", "share", "slope")
# A lossless run has a stated speed, for which two numbers of the runner are tuned; where its search begins, by name.
RUNNER, TUNED_OF_RUNNERS, SPEED_OF_RUN = "runner", ("inertia", "hip_stiffness"), "speed"
TWO_FEET = "alternating-hopper"
# Numbers that other machines may be without, those without units and all.
OPTIONAL_WITHOUT_UNITS = ("body_mass", "stiffness", "surface_gravity")
OPTIONAL = {RUNNER: ("friction",), TWO_FEET: ("rest_length",)}
START_OF_HOP = ("liftoff", "alpha", "duration")
STARTS = {
    RUNNER: ("liftoff", "alpha", "theta", "theta'", "phi", "phi'", "duration", "contact_duration", "step"),
    TWO_FEET: ("liftoff", "alpha", "half", "half'", "duration", "contact_duration"),
}


class SceneOptions(NamedTuple):
    """The largest scenes that a page takes, and that a link holds."""

    numbers: int = 40  # parameters, each with a slider
    family: int = 1000  # number of a family
    law: int = 2000  # characters of a formula
    rows: int = 1 << 20  # characters of a dropped table
    new_number: float = 0.1  # value of a parameter that is new in a formula
    # Characters of packed measured rows in a link; browsers and servers accept addresses of some 60,000.
    rows_in_link: int = 8000
    value_in_link: int = 12_000  # characters of any other value in a link


LARGEST = SceneOptions()
NAME = re.compile(r"[A-Za-z_]\w{0,39}", re.ASCII)
# The default scene of each kind of machine.
BEGINNINGS: dict[tuple[str, bool], dict[str, Any]] = {
    ("hopper", False): {
        "spring": "r + beta*r**3",
        "along": "beta",
        "numbers": {"mass_ratio": 1.0, "rest_length": 8.0, "beta": 0.3},
    },
    ("juggler", False): {"spring": "r", "along": "mass_ratio", "numbers": {"mass_ratio": 1.0}},
    ("hopper", True): {
        "spring": "k*r + b*r**3",
        "along": "b",
        "numbers": {"body_mass": 60.0, "foot_mass": 3.0, "surface_gravity": STANDARD_GRAVITY, "rest_length": 0.8}
        | {"k": 8000.0, "b": 2e6},
    },
    ("juggler", True): {
        "spring": LINEAR_IN_SI,
        "along": "ball_mass",
        "numbers": {"ball_mass": 0.1, "hand_mass": 0.2, "surface_gravity": STANDARD_GRAVITY, "stiffness": 50.0},
    },
    ("wheel", False): {
        "spring": "r",
        "along": "angle",
        "numbers": {"inertia_ratio": 1.0, "gravity_ratio": 0.5, "angle": pi / 8},
    },
    ("rocker", False): {
        "spring": "r",
        "along": "gravity_ratio",
        "numbers": {"inertia_ratio": 1.0, "gravity_ratio": 0.5, "angle": 0.3},
    },
    ("shuttle", False): {
        "spring": "r",
        "along": "inertia_ratio",
        "numbers": {"inertia_ratio": 1.0, "gravity_ratio": 0.5, "angle": 0.3},
    },
    ("wheel", True): {
        "spring": LINEAR_IN_SI,
        "along": "body_inertia",
        "numbers": {"mass": 2.0, "length": 0.4, "spokes": 8.0, "inertia": 0.5, "body_inertia": 0.5, "stiffness": 20.0}
        | {"surface_gravity": STANDARD_GRAVITY, "friction": 0.5},
    },
    ("rocker", True): {
        "spring": LINEAR_IN_SI,
        "along": "stiffness",
        "numbers": {"mass": 2.0, "half_width": 0.1, "half_height": 0.2, "inertia": 0.15, "body_inertia": 0.15}
        | {"stiffness": 20.0, "surface_gravity": STANDARD_GRAVITY, "friction": 0.8},
    },
    ("shuttle", True): {
        "spring": LINEAR_IN_SI,
        "along": "body_inertia",
        "numbers": {"inertia": 0.5, "body_inertia": 0.5, "stiffness": 20.0, "angle": 0.3, "mass": 2.0, "length": 0.4}
        | {"surface_gravity": STANDARD_GRAVITY},
    },
    (RUNNER, False): {
        "spring": LINEAR_IN_SI,
        "along": SPEED_OF_RUN,
        "numbers": {"foot_mass": 0.1, "rest_length": 3.7, "inertia": 5.7, "hip_stiffness": 5.4, SPEED_OF_RUN: 0.4},
    },
    (RUNNER, True): {
        "spring": LINEAR_IN_SI,
        "along": SPEED_OF_RUN,
        "numbers": {"body_mass": 70.0, "foot_mass": 7.0, "rest_length": 0.9, "stiffness": 2800.0, "inertia": 24.0}
        | {"hip_stiffness": 900.0, "surface_gravity": STANDARD_GRAVITY, SPEED_OF_RUN: 0.7},
    },
    (TWO_FEET, False): {
        "spring": LINEAR_IN_SI,
        "along": "foot_mass",
        "numbers": {"foot_mass": 4.0, "rest_length": 45.0},
    },
    (TWO_FEET, True): {
        "spring": LINEAR_IN_SI,
        "along": "foot_mass",
        "numbers": {"body_mass": 5.0, "foot_mass": 20.0, "stiffness": 2500.0, "rest_length": 1.0}
        | {"surface_gravity": STANDARD_GRAVITY},
    },
}


@dataclass(frozen=True)
class DroppedRows:
    """A measured spring: the name and the text of its file, and the options with which `springs.table` reads it."""

    name: str
    text: str
    branch: str | None = None
    noise: float | None = None
    cycle: int | str | None = None
    columns: tuple[str | int, ...] | None = None
    units: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and isinstance(self.text, str)):
            raise InputError("a table must have a name and a text")
        if len(self.text) > LARGEST.rows:
            raise InputError(f"the table has {len(self.text)} characters; at most {LARGEST.rows} are allowed")
        object.__setattr__(self, "name", re.sub(r"[^\w.-]", "_", self.name, flags=re.ASCII)[-60:].lstrip(".") or "rows")
        if self.branch not in (None, "loading", "unloading", "mean"):
            raise InputError(f"branch = {str(self.branch)[:40]!r}; it must be loading, unloading or mean")
        if self.noise is not None and finite_number("noise", self.noise) < 0:
            raise InputError(f"noise = {self.noise:g} is below 0; it is the standard deviation of a row's force")

    @property
    def spring(self) -> str:
        """The spring that names the file and the options, as the command line and machine files do."""
        pairs = {
            name: own and ",".join(map(str, own)) for name, own in (("columns", self.columns), ("units", self.units))
        }
        settings = {"branch": self.branch, "noise": self.noise, "cycle": self.cycle, **pairs}
        options = "&".join(f"{name}={value}" for name, value in settings.items() if value is not None)
        return f"table:{self.name}" + (f"?{options}" if options else "")

    def law(self, in_si: bool) -> Law:
        """The law of the rows; raises `InputError` for a text that is not a table."""
        return _law_of_rows(self, in_si)


@lru_cache(maxsize=8)
def _law_of_rows(rows: DroppedRows, in_si: bool) -> Law:
    own = {name: getattr(rows, name) for name in ("columns", "units", "cycle", "branch", "noise")}
    with tempfile.TemporaryDirectory() as folder:  # the reader of tables reads files
        path = Path(folder) / rows.name
        path.write_text(rows.text, encoding="utf-8")
        return springs.table(path, in_si=in_si, **own)


@dataclass(frozen=True)
class Scene:
    """The scene that the page shows.

    machine : "hopper", "juggler", one of `STEPPING`, one of `WITH_FIXED_LAWS`, or `PYTHON_MACHINE`
    si : whether a machine is stated in SI
    spring, gravity : formulas or names of laws; ignored where the laws are fixed
    rows : a measured spring, which replaces `spring`
    numbers : the parameters by name, those of the formulas among them
    family : of the hop
    start : the unknowns `start_names` from which the hop is found, where it is not the lowest of its family
    along : the parameter that the family is followed along, "" for none
    launch : the launch speed from which a cobweb is drawn in the return map
    """

    machine: str = "hopper"
    si: bool = False
    spring: str = "r"
    gravity: str = "1"
    rows: DroppedRows | None = None
    numbers: Mapping[str, float] = field(default_factory=dict)
    family: int = 1
    start: tuple[float, ...] | None = None
    along: str = ""
    launch: float | None = None

    def __post_init__(self) -> None:
        known = (*KINDS, *STEPPING, *WITH_FIXED_LAWS, PYTHON_MACHINE)
        if self.machine not in known:
            raise InputError(f"unknown machine {str(self.machine)[:40]!r}{suggest(str(self.machine)[:40], known)}")
        if self.steps and (self.machine, self.si) not in BEGINNINGS:
            raise InputError(f"the page does not show a {self.machine}, whose numbers are tuned: call find(tune=)")
        for name in ("spring", "gravity"):
            text = getattr(self, name)
            if not isinstance(text, str) or len(text) > LARGEST.law:
                raise InputError(f"the {name} must be a formula of at most {LARGEST.law} characters")
            if text.strip().partition(":")[0].strip() == "table":
                raise InputError(f"{name} {text[:40]!r}: to use a table, drop its file onto the page")
        if self.steps and (self.rows or self.gravity != "1"):
            raise InputError("measured rows and varying gravity need a machine that hops: choose one")
        self._check_numbers()
        whole_number("family", self.family, most=LARGEST.family)

    def _check_numbers(self) -> None:
        """Convert the numbers to floats; raises `InputError` for values that are not numbers, and for too many."""
        if len(self.numbers) > LARGEST.numbers:
            raise InputError(
                f"{len(self.numbers)} parameters are more than the page has sliders for, {LARGEST.numbers}"
            )
        for name in (*self.numbers, *([self.along] if self.along else [])):
            if not isinstance(name, str) or not NAME.fullmatch(name):
                raise InputError(f"{str(name)[:40]!r} is not a name of a parameter")
        numbers = {name: finite_number(name, value) for name, value in self.numbers.items()}
        object.__setattr__(self, "numbers", numbers)
        if self.start is not None:
            start = tuple(finite_number("start", value) for value in self.start)
            if len(start) != len(self.start_names) or start[self.start_names.index("duration")] <= 0:
                raise InputError(f"a start must have {', '.join(self.start_names)}, and a duration above 0")
            object.__setattr__(self, "start", start)
        if not self.prescribed.get(SPEED_OF_RUN, 1.0) > 0:
            raise InputError(f"speed = {numbers[SPEED_OF_RUN]:g}; the speed of a run must be above 0")
        if self.launch is not None and finite_number("launch", self.launch) <= 0:
            raise InputError(f"launch = {self.launch:g}; a launch speed must be above 0")

    @property
    def fixed_laws(self) -> bool:
        """Whether the page does not change the machine's laws."""
        return self.machine not in (*KINDS, *STEPPING)

    @property
    def steps(self) -> bool:
        """Whether formulas state a machine that steps."""
        return self.machine in STEPPING

    @property
    def tuned(self) -> tuple[str, ...]:
        """The numbers of the machine that are tuned, and so are results: the scene has values at which that begins."""
        return TUNED_OF_RUNNERS if self.machine == RUNNER else ()

    @property
    def prescribed(self) -> dict[str, float]:
        """The numbers that are stated of the motion, not of the machine."""
        names = (SPEED_OF_RUN,) if self.machine == RUNNER else ()
        return {name: self.numbers[name] for name in names if name in self.numbers}

    @property
    def start_names(self) -> tuple[str, ...]:
        """The names of the unknowns of a start."""
        return STARTS.get(self.machine, START_OF_HOP)

    @property
    def hop(self) -> "Scene":
        """The scene without the family parameter and the launch speed."""
        return replace(self, along="", launch=None)

    def with_numbers(self, **numbers: float) -> "Scene":
        """The scene with other values of some parameters."""
        return replace(self, numbers={**self.numbers, **numbers})

    def complete(self) -> "Scene":
        """The scene with exactly the parameters of its machine and its formulas, new ones with default values.

        Raises `InputError` for a formula that cannot be read.
        """
        if self.fixed_laws:
            return self
        if self.steps:
            return self._complete_steps()
        needed = _own_numbers(self) | _names_in_gravity(self.gravity) | ({} if self.rows else _names_in(self.spring))
        optional = {name: self.numbers[name] for name in (*LOSSES, "rest_length") if name in self.numbers}
        # For a spring without a slope at rest, the stiffness sets the units.
        if self.si and "stiffness" in self.numbers and "stiffness" not in needed and self.spring != LINEAR_IN_SI:
            optional["stiffness"] = self.numbers["stiffness"]
        numbers = {name: self.numbers.get(name, value) for name, value in needed.items()} | optional
        along = self.along if self.along in numbers else ""
        return replace(self, numbers=numbers, along=along)

    def _complete_steps(self) -> "Scene":
        """The complete scene of a machine that steps."""
        free = (*(() if self.si else ("angle",)), *OPTIONAL_OF_STEPS)  # without units no angle is for small ones
        own, in_spring = BEGINNINGS[self.machine, self.si]["numbers"], _names_in(self.spring)
        if self.machine in OPTIONAL:
            free = (*OPTIONAL[self.machine], *(() if self.si else OPTIONAL_WITHOUT_UNITS))
            if in_spring.pop("stiffness", None) is None and self.spring.replace(" ", "") != LINEAR_IN_SI:
                own, free = ({n: own[n] for n in own if n != "stiffness"}, tuple(n for n in free if n != "stiffness"))
        needed = {name: value for name, value in own.items() if name not in free}
        needed |= {name: value for name, value in in_spring.items() if name not in own}
        known = {name: self.numbers.get(name, value) for name, value in needed.items()}
        numbers = known | {name: self.numbers[name] for name in free if name in self.numbers}
        return replace(self, numbers=numbers, along=self.along if self.along in numbers else "")

    def statement(self) -> dict[str, Any]:
        """The scene's machine as a machine file states one, with a file's name in place of measured rows."""
        if self.steps:
            return self._statement_of_steps()
        numbers, masses = dict(self.numbers), MASSES[self.machine]
        own = (*masses, *SI_KEYS[:-1]) if self.si else ("mass_ratio", "rest_length")
        stated = {name: numbers.pop(name) for name in own if name in numbers}
        losses = {name: numbers.pop(name) for name in LOSSES if numbers.get(name)}
        laws = {"spring": self.rows.spring if self.rows else self.spring, "gravity": self.gravity}
        if self.si and not self.rows and self.spring.replace(" ", "") == LINEAR_IN_SI:
            del laws["spring"]
        if self.gravity == "1":
            del laws["gravity"]
        numbers = {name: value for name, value in numbers.items() if name not in LOSSES}
        words: dict[str, object] = {"machine": self.machine, **laws, **losses}
        words |= {"si": stated} if self.si else stated
        return words | ({"parameters": numbers} if numbers else {})

    def _statement_of_steps(self) -> dict[str, Any]:
        """The statement of a machine that steps."""
        numbers: dict[str, float] = {name: x for name, x in self.numbers.items() if name not in self.prescribed}
        if (spokes := numbers.get("spokes", 0.5)).is_integer():
            numbers["spokes"] = int(spokes)
        names = SI_KEYS_OF_STEPS[self.machine] if self.si else []
        si = {name: numbers.pop(name) for name in names if name in numbers}
        plain = self.spring.replace(" ", "") == BEGINNINGS[self.machine, self.si]["spring"]
        words: dict[str, Any] = {"machine": self.machine} | ({} if plain else {"spring": self.spring})
        return words | ({"si": si} if self.si else {}) | ({"parameters": numbers} if numbers else {})

    def build(self, python_machine: Any = None) -> Any:
        """The machine of the scene, which is `python_machine` with other numbers where no statement makes it; raises
        `InputError` that names the invalid part."""
        if not self.fixed_laws:
            statement = self.statement()
            return build({**statement, "spring": self.rows.law(self.si)} if self.rows else statement, "this machine")
        if self.machine == PYTHON_MACHINE and python_machine is None:
            raise InputError("this link needs a machine made in Python: open it from the page that shows the machine")
        base = python_machine if self.machine == PYTHON_MACHINE else _with_its_own_laws(self.machine)
        return base.with_values(**{name: value for name, value in self.numbers.items() if name != "restitution"})


@lru_cache(maxsize=8)
def _with_its_own_laws(name: str) -> Any:
    """A machine with fixed laws, with its default parameters."""
    import problems

    return getattr(problems, name)()


def beginning(machine: str, si: bool = False) -> Scene:
    """The scene that the page begins with for a kind of machine."""
    if machine in WITH_FIXED_LAWS:
        return with_surroundings(scene_with_fixed_laws(_with_its_own_laws(machine), machine))
    return Scene(machine, si, **BEGINNINGS.get((machine, si), {}))  # which refuses one that the page does not show


def scene_with_fixed_laws(machine: Machine, name: str = PYTHON_MACHINE) -> Scene:
    """The scene of a machine whose laws are fixed."""
    return Scene(name, numbers={each: machine.values[each] for each in free_parameters(machine)})


def with_surroundings(scene: Scene) -> Scene:
    """A scene with a parameter along which the family is followed: the last one of its laws where these have any, and
    a rest length only if there is no other, as it changes no hop under a constant gravity. That of a machine that
    steps is the one that the page begins with."""
    names = [name for name in scene.numbers if name not in (*LOSSES, *OPTIONAL_OF_STEPS)]
    if scene.steps and (usual := BEGINNINGS[scene.machine, scene.si]["along"]) in names:
        names = [usual]
    names.sort(key=lambda name: (name not in {"mass_ratio", *SI_PARAMETERS}, name != "rest_length"))
    return replace(scene, along=names[-1]) if names and not scene.along else scene


def scene_of_machine(machine: Machine) -> Scene:
    """The scene of any machine: a statement where that makes the same machine, else the machine itself.

    Raises `InputError` for a machine that sticks, except a runner with plain springs: its numbers have to be tuned.
    """
    if machine.model.sticks:
        if scene := _scene_by_numbers(machine, RUNNER):
            return scene
        raise InputError("the page tunes only a `problems.runner` with plain springs: call find(tune=) for others")
    if LinearSearch.finds_families(machine) and (scene := _scene_by_numbers(machine, TWO_FEET)):
        return scene
    if isinstance(machine, AnyMachine) and machine.kind in KINDS:
        words = machine.describe()
        si = isinstance(machine, MachineInSI)
        numbers = machine.stated_values if isinstance(machine, MachineInSI) else dict(machine.values)
        numbers = {**numbers, **{name: getattr(machine, name) for name in LOSSES if getattr(machine, name)}}
        if isinstance(machine, MachineInSI) and machine.spring and not machine.spring.with_slope(0.0)[1] > 0:
            numbers["stiffness"] = machine.stiffness  # it sets the units where the law has no slope
        try:
            scene = Scene(machine.kind, si, words["spring"], words["gravity"], numbers=numbers)
            if (scene := scene.complete()).build() == machine:
                return scene
        except InputError:
            pass  # laws that are Python functions or tables are no formulas
    return scene_with_fixed_laws(machine)


def _scene_by_numbers(machine: Machine, kind: str) -> Scene | None:
    """The scene of a machine of a kind with plain springs; None for another machine."""
    si = machine.units is not None
    begun = BEGINNINGS[kind, si]
    numbers = {begun["along"]: begun["numbers"][begun["along"]], **machine.values}
    scene = Scene(kind, si, begun["spring"], numbers=numbers, along=begun["along"]).complete()
    return scene if {**scene.build().describe()} == {**machine.describe()} else None


def _own_numbers(scene: Scene) -> dict[str, float]:
    """The parameters of a machine without those of its laws, with their default values."""
    begun = BEGINNINGS[scene.machine, scene.si]["numbers"]
    varying = scene.gravity.strip() not in ("1", "constant")
    names = (*MASSES[scene.machine], "surface_gravity") if scene.si else ("mass_ratio",)
    if scene.si and scene.spring.replace(" ", "") == LINEAR_IN_SI and not scene.rows:
        names = (*names, "stiffness")
    needed = {name: begun.get(name, 1.0) for name in names}
    return needed | ({"rest_length": begun.get("rest_length", 10.0)} if varying else {})


def _names_in(text: str, variable: str = "r", laws: Mapping[str, Any] = springs.NAMED) -> dict[str, float]:
    """The parameters in a formula or of a named law, with their default values."""
    key = text.strip().replace("-", "_")
    if key in laws:
        return dict(laws[key]().parameters)
    if text.replace(" ", "") == LINEAR_IN_SI:
        return {}
    names = parse(text.strip().removeprefix("potential:")).names - {variable}
    return dict.fromkeys(sorted(names), LARGEST.new_number)


def _names_in_gravity(text: str) -> dict[str, float]:
    """The parameters of a gravity law, whose default lengths are large."""
    found = _names_in(text, "z", gravities.NAMED)
    named = text.strip().replace("-", "_") in gravities.NAMED
    return found if named else dict.fromkeys(found, 100.0)
