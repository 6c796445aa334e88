"""TOML files that state a machine, dimensionless or in SI.

machine = "hopper"              machine = "hopper"
mass_ratio = 0.5                spring = "8000*r + 2e6*r**3"      # N of m
rest_length = 10                [si]
spring = "r + beta*r**3"        body_mass = 60.0
gravity = "constant"            foot_mass = 3.0
[parameters]                    rest_length = 0.8
beta = 0.3                      surface_gravity = 9.80665

on compliant ground, by its mass (over the foot's, or in kg) and its stiffness or the spring of a formula,

[ground]
mass = 2.0
stiffness = 50.0

a machine that steps, "wheel", "rocker" or "shuttle", by its ratios or, in [si], by the arguments of its function in
`problems.machines.steps`, and a "runner", "walker", "brachiator" or "alternating-hopper" by those of its function in
[parameters] or in [si],

machine = "wheel"               machine = "wheel"
spring = "r + beta*r**3"        [si]
[parameters]                    mass = 2.0
inertia_ratio = 1.0             length = 0.4
gravity_ratio = 0.5             spokes = 8
angle = 0.3                     inertia = 0.5
beta = 1.0                      body_inertia = 0.5
                                stiffness = 20.0

how `orbits find` finds a hop of a machine with tuned numbers, unless its options say otherwise:

[find]
tune = ["inertia", "hip_stiffness"]
at = {speed = 0.4}
start = {alpha = 1.5, theta = 0.07}   # unknowns and tuned numbers, or left out

and what to design of it, in the machine's units or in SI:

[design]
minimise = "loss_coefficient"   # or maximise; minimise = ["a", "b"] is a front of `points` designs
subject_to = ["stroke <= 0.25", "centre_of_mass_rise == 0.2"]
family = 2
starts = 4                      # or 'global'; and seed = 0
[design.over]
k = [1e3, 1e5]
"""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypedDict

from orbits import Mechanism
from orbits.errors import InputError
from orbits.io import conform, read_file
from orbits.mechanics import Ground
from orbits.symbolic import suggest

from .alternating_hopper import alternating_hopper
from .brachiator import brachiator
from .hopper import Hopper
from .juggler import Juggler
from .runner import runner
from .steps import RATIOS, rimless_wheel, rocking_block, shuttle
from .two_masses import DAMPERS, GROUND_MASS, TwoMassMachine
from .walker import walker

if TYPE_CHECKING:
    from .in_si import AnyMachine

MachineOfFile: TypeAlias = "AnyMachine | Mechanism"
KINDS: dict[str, type[TwoMassMachine]] = {"hopper": Hopper, "juggler": Juggler}
MASSES = {"hopper": ("body_mass", "foot_mass"), "juggler": ("ball_mass", "hand_mass")}
STEPPING: dict[str, Callable[..., Mechanism]] = {
    **{"wheel": rimless_wheel, "rocker": rocking_block, "shuttle": shuttle, "runner": runner, "walker": walker},
    "alternating-hopper": alternating_hopper,
}
# All machines that a function states by their own numbers.
FUNCTIONS: dict[str, Callable[..., Mechanism]] = {**STEPPING, "brachiator": brachiator}
# Those that have the same numbers without units as in SI.
SAME_IN_SI = tuple(kind for kind, build in FUNCTIONS.items() if "in_si" in signature(build).parameters)
SI_KEYS_OF_STEPS = {
    kind: [
        name
        for name in signature(build).parameters
        if name not in ("spring", "hip_spring", "parameters", "in_si", *RATIOS) or (kind, name) == ("shuttle", "angle")
    ]
    for kind, build in FUNCTIONS.items()
}
OWN_KEYS = ("spring", "mass_ratio", "rest_length")
COMMON_KEYS = ("gravity", "restitution", "damping", "drag", "parameters", "ground")
GROUND_KEYS = ("mass", "stiffness", "spring")
# The parameters of compliant ground, by the keys of [ground] that state them.
GROUND_PARAMETERS = {GROUND_MASS: "mass", "ground_stiffness": "stiffness"}
KEYS = ("machine", *OWN_KEYS, *COMMON_KEYS, "si", "find", "design")
KEYS_OF_STEPS = ("machine", "spring", "parameters", "si", "find", "design")
SI_KEYS = ("surface_gravity", "stiffness", "rest_length", "body_radius")
# The parameters of a machine in SI that its file states in [si].
SI_PARAMETERS = {*SI_KEYS, *(name for names in (*MASSES.values(), *SI_KEYS_OF_STEPS.values()) for name in names)}


def si_keys_of(statement: Mapping[str, Any]) -> Sequence[str]:
    """The keys that the table [si] of a machine's statement may have."""
    kind = statement.get("machine", "hopper")
    return SI_KEYS_OF_STEPS.get(kind, (*MASSES.get(kind, ()), *SI_KEYS))


# A spring of a file, which may be the mean or a branch of one with hysteresis.
OF_A_FILE = re.compile(r"((?:^|[:;]\s*)(?:table|loop):)([^;]+)")
LARGEST_MACHINE_FILE = 1 << 14  # of a machine file: reading a longer one may take its length squared


class FindTable(TypedDict, total=False):
    """The table [find] of a file."""

    tune: list[str]
    at: dict[str, float]
    start: dict[str, float]


class DesignTable(TypedDict, total=False):
    """The table [design] of a file; `over` is checked separately, since an error in it shows how it is written."""

    minimise: str | list[str]
    maximise: str
    over: Any
    subject_to: list[str]
    family: int
    tune: list[str]
    at: dict[str, float]
    starts: int | str
    seed: int
    points: int


def read(path: str | Path) -> dict[str, Any]:
    """The statement in a TOML file, its keys checked; raises `InputError` that names the file and the key."""
    import tomllib

    path = Path(path)
    data = read_file(path, f"the machine file {str(path)!r} cannot be read", tomllib.load, LARGEST_MACHINE_FILE)
    _check_keys(path, data, KEYS)
    for table in ("parameters", "si", "find", "design", "ground"):
        if not isinstance(data.get(table, {}), dict):
            raise InputError(f"{path}: '{table}' is a table: write [{table}]")
    for owner in (data, data.get("ground", {})):
        if isinstance(spring := owner.get("spring"), str):  # a table's path counts from the file that names it
            owner["spring"] = OF_A_FILE.sub(lambda found: found[1] + str(path.parent / found[2]), spring)
    return data


def search(statement: dict[str, Any], where: str) -> FindTable:
    """What a statement states of the search for a hop, as arguments of `orbits.find`; raises `InputError` for unknown
    keys and other types."""
    table = statement.get("find", {})
    _check_keys(f"{where}, [find]", table, FindTable.__annotations__)
    return conform(table, FindTable, f"{where}: [find]")


def design(statement: dict[str, Any], where: str) -> dict[str, Any]:
    """The design problem that a statement states, as arguments of `orbits.optimize`, or of `orbits.pareto` with two
    objectives; raises `InputError` for unknown or missing keys."""
    if "design" not in statement:
        raise InputError(f"{where} has no [design]: state what to minimise or maximise, over which parameters")
    _check_keys(f"{where}, [design]", statement["design"], DesignTable.__annotations__)
    problem = conform(statement["design"], DesignTable, f"{where}: [design]")
    if not isinstance(problem.get("over"), dict):
        raise InputError(f"{where}: [design.over] must name the parameters with their bounds, such as k = [1e3, 1e5]")
    if not isinstance(problem.get("minimise"), list):
        if "points" in problem:
            raise InputError(
                f"{where}: points are for a front of two objectives, minimise = [..., ...]; leave them out"
            )
        return problem
    if "maximise" in problem:
        raise InputError(f"{where}: both objectives of a front are minimised; to maximise alpha, write '-alpha'")
    return problem | {"minimise": tuple(problem["minimise"])}


def build(statement: dict[str, object], where: str = "the options") -> MachineOfFile:
    """The machine of a statement, as `read` returns it; raises `InputError`, whose message begins with `where`."""
    try:
        return _build(statement)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _build(statement: dict[str, Any]) -> MachineOfFile:
    kind = statement.get("machine", "hopper")
    if not isinstance(kind, str) or kind not in (*KINDS, *FUNCTIONS):
        raise InputError(f"unknown machine {kind!r}{suggest(kind, (*KINDS, *FUNCTIONS))}")
    if kind in FUNCTIONS:
        return _stepping_machine(kind, statement)
    common = {name: statement[name] for name in COMMON_KEYS if name in statement}
    if "ground" in common:
        common["ground"] = _ground(common["ground"])
    if "si" not in statement:
        return KINDS[kind](**{name: statement[name] for name in OWN_KEYS if name in statement}, **common)
    si = statement["si"]
    _check_keys("[si]", si, si_keys_of(statement))
    for name in ("mass_ratio", "rest_length"):
        if name in statement:
            raise InputError(f"'{name}' together with [si]; state lengths and masses in [si], or leave [si] out")
    for name in MASSES[kind]:
        if name not in si:
            raise InputError(f"[si] needs {name} (kg)")
    from .in_si import hopper_in_si, juggler_in_si

    in_si: Callable = hopper_in_si if kind == "hopper" else juggler_in_si
    return in_si(**si, force=statement.get("spring"), **common)


def _stepping_machine(kind: str, statement: dict[str, Any]) -> Mechanism:
    """A machine that its own function states. Those of its numbers that are keys of machines that hop, as a rest
    length, may be keys too."""
    arguments = signature(FUNCTIONS[kind]).parameters
    own_names, sprung = SI_KEYS_OF_STEPS[kind] if kind in SAME_IN_SI else (*RATIOS, "friction"), "spring" in arguments
    known = [name for name in own_names if name in arguments]
    apart = {name: statement[name] for name in OWN_KEYS if name in statement and name in known}
    own_keys = {*KEYS_OF_STEPS, *apart} - (set() if sprung else {"spring"})
    if other := [name for name in statement if name in KEYS and name not in own_keys]:
        has = f"{'an' if kind[0] == 'a' else 'a'} {kind} has {', '.join(known)}{' and a spring' if sprung else ''}"
        raise InputError(f"'{other[0]}' belongs to machines that hop: {has}")
    values, own = dict(statement.get("parameters", {})), statement.get("si")
    if both := [name for name in apart if name in (values if own is None else own)]:
        raise InputError(f"'{both[0]}' is stated twice")
    if own is None:
        own = {name: values.pop(name) for name in known if name in values}
    else:
        _check_keys("[si]", own, si_keys_of(statement))
        own = {**own, **({"in_si": True} if kind in SAME_IN_SI else {})}
    own |= apart
    if not sprung:
        _check_keys(f"parameters of a {kind}", values, known)
        return FUNCTIONS[kind](**own)
    spring = {"spring": statement["spring"]} if "spring" in statement else {}
    return FUNCTIONS[kind](**own, **spring, parameters=values)


def _ground(statement: dict[str, Any]) -> Ground:
    """The ground of a table [ground]."""
    _check_keys("[ground]", statement, GROUND_KEYS)
    if "mass" not in statement or ("stiffness" in statement) == ("spring" in statement):
        raise InputError("[ground] must have a mass, and a stiffness or a spring")
    return Ground(statement["mass"], statement["stiffness" if "stiffness" in statement else "spring"])


def statement_for_file(machine: "AnyMachine") -> dict[str, Any] | None:
    """The statement of a machine for a file, from which `build` makes it again to the last bit; None for one that no
    file states alone, such as one with a Python function or a table as its spring."""
    law = machine.spring
    own = {name: getattr(machine, name) for name in ("restitution", *DAMPERS)}
    statement: dict[str, object] = {"machine": machine.kind, "gravity": machine.gravity.text, **own}
    statement |= {} if law is None else {"spring": law.text}
    ground = machine.ground
    below = ground.spring if ground else None
    statement |= {"ground": {"mass": ground.mass, "spring": ground.spring.text}} if ground else {}
    laws = [each.parameters for each in (law, machine.gravity, below) if each is not None]
    statement["parameters"] = {name: value for each in laws for name, value in each.items()}
    length = {} if machine.rest_length is None else {"rest_length": machine.rest_length}
    from .in_si import MachineInSI

    if isinstance(machine, MachineInSI):
        stiffness = {"stiffness": machine.stiffness, "surface_gravity": machine.surface_gravity}
        statement["si"] = {**machine.masses, **stiffness, **length}
    else:
        statement |= {"mass_ratio": machine.mass_ratio, **length}
    try:
        return statement if machine == machine_stated(statement) else None
    except InputError:
        return None


def machine_stated(statement: dict[str, object]) -> MachineOfFile:
    """The machine of a statement by `statement_for_file`; raises `InputError`, also where it refers to another file."""
    _check_keys("the machine", statement, KEYS)
    below: Any = statement.get("ground", {})
    if any(OF_A_FILE.search(str(each.get("spring", ""))) for each in (statement, below)):
        raise InputError("the machine's spring is in another file, which is not read")
    return build(statement, "the machine")


def _check_keys(where: object, data: dict[str, object], known: Collection[str]) -> None:
    for name in data:
        if name not in known:
            raise InputError(f"{where}: unknown key '{name}'{suggest(name, known)}")
