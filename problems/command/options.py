"""The options that the commands share: the description of a machine, its losses and the files to write."""

import logging
import math
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import reduce
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    import numpy as np

    from orbits.proof import Proof
    from orbits.returns import BifurcationDiagram

    from ..explorer import Scene
    from ..machines import MachineOfFile


def combined(*options: Callable) -> Callable:
    """Several options as one decorator, shown in this order."""

    return lambda command: reduce(lambda decorated, option: option(decorated), reversed(options), command)


MOST_LAUNCHES = 1_000_000  # of one map, some hundred bytes each
IN_UNITS = ", in the machine's units."
POSITIVE = click.FloatRange(0, min_open=True)
machine_options = combined(
    click.option(
        "--machine",
        metavar="KIND|FILE.toml",
        help="Kind of machine: hopper (the default), juggler, wheel, rocker, shuttle, runner, walker, "
        "brachiator or alternating-hopper; or a file that states it. A wheel, a rocker and a shuttle step. They take "
        "--set inertia_ratio=J/A and gravity_ratio=M*g*l/k (M*g*h/k for a rocker). Their angles are small unless you "
        "set angle=a in rad, which is half the angle between spokes or walls (tan a = b/h for a rocker). A runner "
        "takes --set foot_mass=M, rest_length=L, inertia=I, hip_stiffness=K and its other parameters, a walker "
        "--set leg_mass=M, leg_centre=D, torso_inertia=J, hip_stiffness=K and others, a brachiator "
        "--set arm_mass=M, arm_centre=D and others, and an alternating-hopper --set foot_mass=M and --rest-length L.",
    ),
    click.option(
        "--mass-ratio",
        type=POSITIVE,
        metavar="M",
        help="Mass of the foot (hand) over the mass of the body (ball); default: 1.",
    ),
    click.option(
        "--masses", metavar="KG,KG", help="Masses of body and foot (ball and hand). All numbers are then in SI."
    ),
    click.option(
        "--stiffness",
        type=POSITIVE,
        metavar="N/M",
        help="Stiffness of a linear spring, or of a named law, of a machine in SI.",
    ),
    click.option(
        "--rest-length",
        type=POSITIVE,
        metavar="L",
        help="Length of the unloaded spring. Without it the distance of the masses is not checked.",
    ),
    click.option(
        "--spring",
        metavar="LAW",
        help="Force of the spring: a formula of r, the name of a law, potential:FORMULA, or table:FILE for measured "
        "rows under a header of extension and force. The options columns=NAME,NAME, units, "
        "cycle, branch and noise=SD of a table follow its name, as in table:FILE?units=mm,N&cycle=last&branch=loading; "
        "see the documentation.",
    ),
    click.option(
        "--gravity", metavar="LAW", help="Gravity: a formula of z with the value 1 at z = 0, or the name of a law."
    ),
    click.option("--set", "settings", metavar="NAME=VALUE", multiple=True, help="Value of a parameter; repeatable."),
)
damper_options = combined(
    click.option(
        "--restitution",
        type=click.FloatRange(0, 1),
        metavar="e",
        help="Coefficient of restitution of the impacts; default: 0, which is plastic.",
    ),
    click.option("--damping", type=click.FloatRange(0), metavar="c", help="Coefficient of the spring's damper."),
    click.option("--drag", type=click.FloatRange(0), metavar="d", help="Drag coefficient of each mass."),
)
loss_options = combined(
    damper_options,
    click.option("--inject", type=float, default=0.0, metavar="EPS", help=f"Speed added at every launch{IN_UNITS}"),
)
start_option = click.option(
    "--start", "hop", metavar="FILE",
    help="Start from a saved orbit. You need one if a launch has several numbers, as on compliant ground.",
)  # fmt: skip
method_option = click.option(
    "--method",
    metavar="NAME",
    help="Equations of the orbit: 'closed form', 'relative', 'half orbit' or 'shooting'; default: the simplest.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
limit_option = click.option(
    "--limit", type=float, metavar="SECONDS", help="Time limit; default: 30 s of processor time."
)


def _limited(context: click.Context, parameter: click.Parameter, seconds: float | None) -> None:
    """Hold all that the command does to a limit of time."""
    from orbits.running import time_limit

    if seconds is not None:
        context.with_resource(time_limit(seconds))


free_limit_option = click.option(
    "--limit", type=float, metavar="SECONDS", help="Time limit; default: none.",
    callback=_limited, expose_value=False,
)  # fmt: skip


workers_option = click.option(
    "--workers", type=click.IntRange(1), metavar="N", help="Number of processes; 1 by default."
)
seed_option = click.option("--seed", type=int, default=0, show_default=True, help="Seed of the sampling.")


tune_option = click.option(
    "--tune", metavar="NAME[=START]", multiple=True,
    help="A parameter to be found, one for each --at; repeatable. The search begins at START, or at the value of "
    "--set.",
)  # fmt: skip


at_option = click.option(
    "--at", "prescribed", metavar="NAME=VALUE", multiple=True,
    help="Prescribed value of a quantity of the orbit, such as period, frequency, alpha, clearance or body_rise; "
    "repeatable.",
)  # fmt: skip


def family_option(text: str) -> Callable:
    """The option that selects a family."""
    return click.option("--family", type=click.IntRange(1), default=1, show_default=True, metavar="N", help=text)


def file_option(flag: str, kind: str, text: str) -> Callable:
    """An option that names a file to write, of a kind that has its own endings; checked before the search."""

    def check(context, parameter, path):
        if path is not None:
            from orbits.continuation import FAMILY_ENDINGS
            from orbits.result import check_file
            from orbits.show import FIGURES

            if kind == "animation":
                from orbits.show import check_animation

                return str(check_animation(path))
            endings = {
                "result": FAMILY_ENDINGS[1:],
                "figure": FIGURES,
                "family": FAMILY_ENDINGS,
                "lines": FAMILY_ENDINGS[:1],
            }
            check_file(path, endings[kind])
        return path

    return click.option(flag, metavar="FILE", help=text, callback=check)


def _checked_folder(context: Any, parameter: Any, folder: str | None) -> str | None:
    if folder is None:
        return None
    from orbits.show import check_folder

    return str(check_folder(folder))


export_option = click.option(
    "--export", metavar="FOLDER", callback=_checked_folder,
    help="Write motion.csv, and model.xml for MuJoCo and Drake, to a folder.",
)  # fmt: skip
plot_option = file_option("--plot", "figure", "Write a figure (.png, .pdf, .svg).")
animate_option = file_option("--animate", "animation", "Write an animation (.gif, or .mp4 with ffmpeg).")


def write(
    result: Any, as_json: bool, plot: str | None = None, animate: str | None = None, save: str | None = None,
    export: str | None = None, silent: bool = False,
) -> None:  # fmt: skip
    """Write the requested files, and unless `silent` print the result as one JSON document or in words."""
    from orbits.io import to_json

    if plot is not None:
        from orbits.show import save_figure

        save_figure(result.plot(), plot)
    if animate is not None:
        with progress("drawing") as report:
            result.animate(animate, progress=report)
    if save is not None:
        result.save(save)
    if export is not None:
        result.export(export)
    if not silent:
        click.echo(to_json(result.document()) if as_json else str(result))


def numbers(option: str, text: str, kind: Callable, separator: str = ",") -> list:
    """The numbers in an option's text; raises `InputError` for anything else."""
    from orbits.errors import InputError, unit_stated

    try:
        return [kind(part) for part in text.split(separator)]
    except ValueError:
        units = next(filter(None, map(unit_stated, text.split(separator))), "")
        raise InputError(f"{option} {text!r} is not a list of numbers, such as 1{separator}2{units}") from None


def one_number(option: str, text: str) -> float:
    """The number in an option's text; raises `InputError` for anything else."""
    from orbits.errors import InputError, unit_stated

    try:
        return float(text)
    except ValueError:
        raise InputError(f"{option} {text!r} is not a number{unit_stated(text)}") from None


def several_families(text: str | None, save: str | None, other: object) -> dict[str, Any]:
    """The argument of `follow` for the numbers of --families; raises `InputError` with options of one family."""
    from orbits.errors import InputError

    if text is None:
        return {}
    if other or str(save).endswith(".jsonl"):
        alone = "--family, --start, --output, --resume, --event and .jsonl files are for one family"
        raise InputError(f"--families {text!r}: {alone}; leave them out")
    return {"families": numbers("--families", text, int)}


def last_values(text: str) -> float | tuple[float, float]:
    """The last value of a parameter that B stands for, or the range of A:B; raises `InputError` for anything else."""
    if ":" not in text:
        return one_number("--to", text)
    first, *last = numbers("--to", text, float, ":")
    if len(last) != 1:
        from orbits.errors import InputError

        raise InputError(f"--to {text!r} is neither a number nor a range A:B")
    return first, last[0]


def event_of(event: str | None, second: str | None) -> tuple[str | dict[str, float], str, float] | None:
    """The event to follow with the second parameter and its last value, from two options; None without them."""
    from orbits.errors import InputError

    if event is None and second is None:
        return None
    if event is None or second is None:
        raise InputError("to follow an event, give both --event EVENT and --second NAME=STOP")
    name, equals, stop = second.partition("=")
    if not equals:
        raise InputError(f"--second {second!r} is not of the form NAME=STOP")
    text, equals, value = event.rpartition("=")
    own = {text.strip(): one_number("--event", value)} if equals else event
    return own, name.strip(), one_number("--second", stop)


def formulas(text: str | None) -> list[str]:
    """The formulas in an option's text, which commas separate outside of parentheses."""
    parts, depth = [""], 0
    for letter in text or "":
        depth += (letter == "(") - (letter == ")")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts if part.strip()]


def swept_members(over: Sequence[str], designs: str | None) -> tuple[dict[str, Any], dict[str, "np.ndarray"] | None]:
    """The ranges of --over by parameter, or the table that --from names; raises `InputError` for neither or both."""
    from orbits.errors import InputError
    from orbits.sweeps import as_numbers, read_designs

    if bool(over) == (designs is not None):
        raise InputError("a sweep needs either --over NAME=RANGE, repeatable, or --from FILE.csv")
    axes: dict[str, object] = {}
    for text in over:
        name, axis = swept_axis("--over", text)
        if name in axes:
            raise InputError(f"--over gives {name!r} twice")
        axes[name] = axis
    if designs is None:
        return axes, None
    return axes, {name: as_numbers(name, column, designs) for name, column in read_designs(designs).items()}


def swept_axis(option: str, text: str) -> tuple[str, Any]:
    """The parameter's name in NAME=RANGE, and the range, the values or the distribution that is stated for it; raises
    `InputError` for anything else."""
    from orbits.errors import InputError

    name, equals, stated = (part.strip() for part in text.partition("="))
    wrong = InputError(f"{option} {text!r} is not of the form NAME=LOW:HIGH or NAME=LOW:HIGH:log")
    if not equals or not name.isidentifier():
        raise wrong
    if found := re.fullmatch(r"norm\(([^,()]+),([^,()]+)\)", stated):
        from scipy.stats import norm

        mean, deviation = numbers(option, ",".join(found.groups()), float)
        if not (math.isfinite(mean) and 0 < deviation < math.inf):
            raise InputError(
                f"{option} {text!r}: the mean must be finite, and the standard deviation must be finite and above 0"
            )
        return name, norm(mean, deviation)
    if ":" not in stated:
        return name, numbers(option, stated, float)
    ends, _, last = stated.rpartition(":")
    logarithmic = last == "log"
    low, *high = numbers(option, ends if logarithmic else stated, float, ":")
    if len(high) != 1:
        raise wrong
    return name, (low, high[0], "log") if logarithmic else (low, high[0])


def computed_by(workers: int | None) -> dict[str, Any]:
    """The options of a sweep that follow from --workers."""
    return {"executor": "processes", "workers": workers} if workers and workers > 1 else {}


def with_first_values(stated: dict[str, Any], axes: dict[str, object], table: Any) -> dict[str, Any]:
    """The options that state a machine, with a value for each swept parameter that has none: a formula needs one."""
    import numpy as np

    from orbits.sweeps import axis_of

    settings = list(stated.get("settings", ()))
    known = {setting.partition("=")[0].strip() for setting in settings}
    known |= {name for name, value in stated.items() if value is not None}
    middle = {name: float(axis_of(name, axis).at(np.array([0.5]))[0]) for name, axis in axes.items()}
    middle |= {name: float(values[0]) for name, values in (table or {}).items()}
    own = ("mass_ratio", "rest_length", "alpha", "damping", "drag")
    settings += [f"{name}={value}" for name, value in middle.items() if name not in known and name not in own]
    return {**stated, "settings": tuple(settings)}


def started(machine: "MachineOfFile", hop: str | None) -> str | None:
    """The orbit's file of --start, for functions that take `start=`; raises `InputError` where it is missing for a
    machine whose launch has several numbers and whose orbits are not found without it."""
    from orbits.errors import InputError
    from orbits.periodic import LinearSearch

    model = machine.model
    if hop is None and model.lands and not (model.one_speed or model.sticks or LinearSearch.finds_families(machine)):
        names = ", ".join(model.launch_unknowns)
        raise InputError(
            f"a launch of this {model.name} has several numbers, {names}: give a saved orbit, --start FILE; in "
            "Python find_all(machine, starts(machine)) finds orbits, and save(FILE) saves one"
        )
    return hop


def launches_of(machine: "MachineOfFile", hop: str | None, alpha: Any) -> Any:
    """The launches of --alpha and --start, for `simulate` and the map: speeds, or the launch of an orbit with its own
    speed or with those; raises `InputError` for neither, and where --start is missing."""
    from orbits.errors import InputError
    from orbits.periodic import LinearSearch, find, start_in_file, unknowns_of_start
    from orbits.returns import ReturnMap

    started(machine, hop)
    if hop is None and alpha is None:
        raise InputError("give a launch: --alpha A, or --start FILE for the launch of a saved orbit")
    found = hop is None and LinearSearch.finds_families(machine)
    if not found and (hop is None or (alpha is not None and machine.model.one_speed)):
        return alpha
    known = unknowns_of_start(machine, find(machine) if hop is None else start_in_file(hop))
    own = known if alpha is None else {**known, "alpha": alpha}
    return own["alpha"] if machine.model.one_speed else {name: own[name] for name in ReturnMap(machine).names}


def write_launches(step: Any, launches: Any, as_json: bool, plot: str | None, alone: bool) -> None:
    """Write the hops of a map from launches of several numbers, as `write` does; and where one launch stands `alone`,
    its multipliers."""
    from orbits.hops import multipliers
    from orbits.io import to_json
    from orbits.show import save_figure

    with progress():
        hops = step(launches)
        lifts = alone and hops.statuses().keys() == {"lifts_off"}
        found = multipliers(step.machine, launches, inject=step.inject) if lifts else None
    if plot is not None:
        save_figure(hops.plot(), plot)
    if as_json:
        click.echo(to_json(hops.document() | ({"multipliers": found.document()} if found else {})))
    else:
        click.echo("\n".join(map(str, filter(None, (hops, found)))))


KEEP = "keep-hopping"
GOALS = (KEEP, "recover", "start-up")
# The options of `orbits control` that belong to some goals, with the argument that each of them is there.
OF_GOALS = {
    "cost": {KEEP: "cost"},
    "speed": {KEEP: "speed"},
    "height": {KEEP: "height"},
    "period": {KEEP: "period"},
    "plastic": {KEEP: "lossless", "recover": "lossless"},
    "short": {"recover": "short"},
    "pumps": {"start-up": "pumps"},
}
NEEDED = {"recover": ("short", "by how much the launch is too slow"), "start-up": ("pumps", "the number of swings")}


def steering_arguments(goal: str, stated: dict[str, Any]) -> dict[str, Any]:
    """The arguments of a function of `problems.steering` in the options of `orbits control`, which are removed from the
    options that state the machine; raises `InputError` for an option of another goal, and for a missing one."""
    from orbits.errors import InputError

    from ..steering import Actuator

    common = {name: stated.pop(name) for name in ("rate", "stroke", "force", "power", "speed_force", "intervals")}
    if (stated_actuator := stated.pop("actuator")) is not None:
        kind, colon, along = stated_actuator.partition(":")
        common["actuator"] = Actuator(along, kind) if colon else Actuator(kind)
    own = {name: stated.pop(name) for name in OF_GOALS}
    own["plastic"] = own["plastic"] or None
    found = {name: value for name, value in common.items() if value is not None}
    for name, value in own.items():
        if value is not None and goal not in OF_GOALS[name]:
            raise InputError(f"--{name} belongs to {' and '.join(OF_GOALS[name])}, not to {goal}: leave it out")
        if value is not None:
            found[OF_GOALS[name][goal]] = False if name == "plastic" else value
    if goal in NEEDED and own[NEEDED[goal][0]] is None:
        raise InputError(f"{goal} needs --{NEEDED[goal][0]}: {NEEDED[goal][1]}")
    return found


def goal(context: click.Context, parameter: click.Parameter, text: str) -> str:
    """What `orbits control` finds: one of `GOALS`, or the earlier name of the first."""
    if text == "hold":
        click.echo(f"'hold' is now called '{KEEP}'", err=True)
        text = KEEP
    return click.Choice(GOALS).convert(text, parameter, context)


def followed_number(goal: str, text: str | None, animate: str | None) -> tuple[str, float] | None:
    """The number of the machine and its last value that NAME:TO stands for; raises `InputError` for anything else."""
    from orbits.errors import InputError

    if text is None:
        return None
    if goal != KEEP:
        raise InputError(f"--follow belongs to {KEEP}, not to {goal}: leave it out")
    if animate is not None:
        raise InputError("--animate draws one motion, not a family: leave out --follow, or --animate")
    name, colon, to = text.partition(":")
    if not colon:
        raise InputError(f"--follow {text!r} is not of the form NAME:TO, such as damping:0.2")
    return name, one_number("--follow", to)


def power_of_two(count: int) -> int:
    """The largest power of 2 up to a number, at least 2."""
    return 2 ** max(1, count.bit_length() - 1)


def launch_speeds(text: str) -> "np.ndarray":
    """The launch speeds that A or A:B:N stands for; raises `InputError` for anything else."""
    import numpy as np

    from orbits.errors import InputError

    try:
        if ":" not in text:
            return np.array([float(text)])
        low, high, count = (kind(part) for kind, part in zip((float, float, int), text.split(":"), strict=True))
    except ValueError:
        count = 0
    if not 2 <= count <= MOST_LAUNCHES or not np.isfinite([low, high]).all():
        bounds = f"from 2 to {MOST_LAUNCHES}"
        raise InputError(f"--alpha {text!r} is neither a number nor a range A:B:N of N launch speeds, {bounds}")
    if not low < high:
        raise InputError(f"--alpha {text!r}: A must be below B")
    return np.linspace(low, high, count)


def diagram_of(
    along: str, span: tuple[float, float], speeds: "np.ndarray", hop: str | None, stated: dict[str, Any],
    requested: dict[str, Any],
) -> "BifurcationDiagram":  # fmt: skip
    """The bifurcation diagram of the stated machine along a parameter, between the ends of its range `span`."""
    from orbits.periodic import start_in_file
    from orbits.returns import DAMPERS_OF_HOPS, INJECT, RESTITUTION, bifurcations

    between = float(speeds[0]), float(speeds[-1])
    known = along in (INJECT, RESTITUTION, *DAMPERS_OF_HOPS)  # without being a parameter of the formulas
    machine = machine_of(**stated, first=None if known else (along, span[0]))
    if (own := started(machine, hop)) is not None and not machine.model.one_speed:
        requested = {**requested, "starts": [start_in_file(own)]}
    with progress() as report:
        return bifurcations(machine, along, span, between, samples=len(speeds), progress=report, **requested)


def proved_curve(
    along: str, span: tuple[float | None, float], family: int, stated: dict[str, Any], **requested: Any
) -> "Proof":
    """The proof that the orbits of the stated machine along a parameter are one curve over its range `span`; raises
    `NoOrbit` where the family ends before."""
    from orbits.continuation import follow
    from orbits.errors import NoOrbit
    from orbits.proof import need_flint

    need_flint()
    start, stop = span
    machine = machine_of(**stated, first=None if start is None else (along, start))
    with progress() as report:
        followed = follow(machine, along, stop, start, family, progress=report)
    if followed.end.kind != "reached":
        raise NoOrbit(f"the family does not reach {along} = {stop:g}: {followed.end.kind}, {followed.end.reason}")
    return followed.prove(machine, continuous=True, **requested)


def machine_of(machine: str | None, *arguments: Any, **stated: Any) -> "MachineOfFile":
    """The machine that the options describe, as in `statement_of`."""
    from ..machines import build

    return build(*statement_of(machine, *arguments, **stated))


def machine_along(along: str, start: float | None, tuned: bool, stated: dict[str, Any]) -> "MachineOfFile":
    """The machine of a family along a parameter from a first value, or along a quantity, which it does not have."""
    from orbits.errors import InputError
    from orbits.periodic import is_quantity
    from orbits.shooting import ENERGY_OF_CYCLE

    if start is None or (along == ENERGY_OF_CYCLE and not tuned):
        return machine_of(**stated)
    with suppress(InputError):  # without a value of the parameter
        if tuned and is_quantity(machine := machine_of(**stated), along):
            return machine
    return machine_of(**stated, first=(along, start))


def statement_of(
    machine: str | None, settings: Sequence[str] = (), first: tuple[str, float] | None = None,
    masses: str | None = None, **stated: str | float | None,
) -> tuple[dict[str, Any], str]:  # fmt: skip
    """The statement of a machine that the options describe, and its source; an option that is not None overrides the
    machine's file.

    masses : of the machine in kg, the upper before the lower; it is then one in SI
    first : name and first value of a parameter to be followed, which replaces what --set says
    """
    from orbits.errors import InputError

    from ..machines import FUNCTIONS, GROUND_PARAMETERS, KINDS, MASSES, SAME_IN_SI, read, si_keys_of

    statement: dict[str, Any] = {"machine": machine or "hopper"}
    where = "the options"
    if machine is not None and machine not in (*KINDS, *FUNCTIONS):
        if not machine.endswith(".toml"):
            known = ", ".join((*KINDS, *FUNCTIONS))
            raise InputError(f"--machine {machine!r} must be a .toml file, or one of {known}")
        statement, where = read(machine), machine
    if masses is not None:
        names = MASSES.get(str(statement.get("machine", "hopper")), MASSES["hopper"])
        if statement.get("machine") in FUNCTIONS and not {*names} <= {*si_keys_of(statement)}:
            raise InputError(
                f"--masses {masses!r}: only hopping machines have them; a {statement['machine']} needs a table [si]"
            )
        if machine == where and "si" not in statement:
            raise InputError(f"--masses {masses!r}: {where} states a machine without units; give it a table [si]")
        if len(each := numbers("--masses", masses, float)) != 2:
            raise InputError(f"--masses {masses!r} is not of the form KG,KG: the upper mass and the lower one")
        statement["si"] = {**statement.get("si", {}), **dict(zip(names, each, strict=True))}
    if first is not None:
        settings = [setting for setting in settings if not sets(setting, first[0])]
    own = {name: value for name, value in stated.items() if value is not None}
    if "stiffness" in own and "si" not in statement and statement.get("machine") not in SAME_IN_SI:
        stated_in = (
            "a machine without units has the stiffness 1; state it in SI, by --masses KG,KG or by [si] in its file"
        )
        raise InputError(f"--stiffness {own['stiffness']:g} is in N/m: {stated_in}")
    values, parameters = named_values(settings, "--set"), dict(statement.get("parameters", {}))
    if first is not None:
        (own if first[0] in ("mass_ratio", "rest_length") else values)[first[0]] = first[1]
    ground = statement.get("ground", {})
    for name, value in (own | values).items():
        if (key := GROUND_PARAMETERS.get(name)) in ground:
            ground[key] = value
            continue
        in_si = "si" in statement and name in si_keys_of(statement) and name not in parameters
        place = statement["si"] if in_si else statement if name in own and name != "stiffness" else parameters
        place[name] = value
    statement["parameters"] = parameters
    return statement, where


def first_scene(family: int = 1, **stated: Any) -> "Scene":
    """The scene of the command line's options; their default is a hopper with a cubic spring. Raises
    `InputError` for a machine that cannot be."""
    from ..explorer import beginning, scene_of_statement
    from ..machines import build

    if not any(value for value in stated.values()):
        return replace(beginning("hopper"), family=family)
    statement, where = statement_of(**stated)
    build(statement, where)
    return scene_of_statement(statement, family)


def named_values(settings: Sequence[str], option: str) -> dict[str, float]:
    """The values by name in the texts of an option that is stated as NAME=VALUE."""
    from orbits.errors import InputError, unit_stated

    values: dict[str, float] = {}
    for setting in settings:
        text, equals, value = setting.partition("=")
        name = text.strip()
        if not equals or not name.isidentifier():
            raise InputError(f"{option} {setting!r} is not of the form NAME=VALUE")
        if name in values:
            raise InputError(f"{option} gives {name!r} two values")
        try:
            values[name] = float(value)
        except ValueError:
            raise InputError(f"{option} {setting!r}: {value!r} is not a number{unit_stated(value)}") from None
    return values


def exact_parameters(settings: Sequence[str], intervals: Sequence[str]) -> dict[str, Any]:
    """The parameters of --set as the decimals that are written, and those of --between as pairs of decimals."""
    found: dict[str, object] = {
        name.strip(): text.strip() for name, _, text in (each.partition("=") for each in settings)
    }
    return found | {name: tuple(bounds) for name, bounds in _bounds(intervals)}


def with_middles(stated: dict[str, Any], intervals: Sequence[str]) -> dict[str, Any]:
    """The options with the midpoints of --between, for which an orbit is found first."""
    return _with_values(stated, {name: (float(low) + float(high)) / 2 for name, (low, high) in _bounds(intervals)})


def with_tuned(stated: dict[str, Any], tune: Sequence[str]) -> tuple[dict[str, Any], tuple[str, ...] | None]:
    """The options with the numbers of --tune, where the search for tuned parameters begins, and their names; None
    without any."""
    names = tuple(text.partition("=")[0].strip() for text in tune)
    values = named_values([text for text in tune if "=" in text], "--tune")
    return _with_values(stated, values), names or None


def _with_values(stated: dict[str, Any], values: dict[str, float]) -> dict[str, Any]:
    """The options that state a machine, with values of parameters in place of those of --set."""
    own: dict[str, object] = {name: values[name] for name in ("mass_ratio", "rest_length") if name in values}
    others = [setting for setting in stated["settings"] if not any(sets(setting, name) for name in values)]
    settings = (f"{name}={value!r}" for name, value in values.items() if name not in own)
    return {**stated, **own, "settings": (*others, *settings)}


def _bounds(intervals: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    from orbits.errors import InputError

    for each in intervals:
        name, _, text = each.partition("=")
        bounds = [part.strip() for part in text.split(":")]
        try:
            finite = len(bounds) == 2 and all(math.isfinite(float(bound)) for bound in bounds)
        except ValueError:
            finite = False
        if not (name.strip() and finite):
            raise InputError(f"--between {each!r} is not of the form NAME=LOW:HIGH, such as beta=0.29:0.31")
        yield name.strip(), bounds


def sets(setting: str, name: str) -> bool:
    """Whether a --set has a value for this name, which another option then replaces."""
    try:
        float(setting.partition("=")[2])
    except ValueError:
        return False
    return setting.partition("=")[0].strip() == name


@contextmanager
def progress(doing: str = "searching") -> Iterator[Callable[[float], None] | None]:
    """Show what is done, the elapsed time and the share done on a terminal, once the first second has passed."""
    if not sys.stderr.isatty():
        yield None
        return
    share, done, began = [0.0], threading.Event(), time.monotonic()

    def show():
        wait = 1.0
        while not done.wait(wait):
            wait = 0.2
            text = f"\r{doing}, {time.monotonic() - began:.0f} s" + (f", {100 * share[0]:.0f}%" if share[0] else "")
            sys.stderr.write(text)
            sys.stderr.flush()
        if wait < 1:
            sys.stderr.write("\r" + " " * 40 + "\r")

    thread = threading.Thread(target=show, daemon=True)
    thread.start()
    logger = logging.getLogger("orbits")
    logger.disabled = True  # its messages are on the line already
    try:
        yield lambda value: share.__setitem__(0, value)
    finally:
        logger.disabled = False
        done.set()
        thread.join()
