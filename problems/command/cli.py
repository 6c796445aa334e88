"""The `orbits` command. Heavy imports wait until they are needed, so that --help and errors are quick."""

import atexit
import gc
import json
import os
import sys
import time
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from . import options

if TYPE_CHECKING:
    from orbits.returns import Hops, ReturnMap

EXAMPLES = """\b
Examples:
  orbits find
      the paper's hopper: alpha = tan(alpha)
  orbits find --family 3 --mass-ratio 0.5    a higher hop
  orbits find --spring "r + beta*r**3" --set beta=0.3
      a spring of your own
  orbits find --spring tanh --set b=0.2 --plot hop.png
  orbits find --spring "k*r" --tune k=1 --at frequency=0.1
      the stiffness of a hopper with this frequency
  orbits find --spring table:rows.csv --json
      a measured spring, in the machine's units
  orbits find --gravity "1/(1 + z/R)**2" --set R=150 --rest-length 20
  orbits find --machine rover.toml --animate hop.gif
      a machine in SI units
  orbits find --rest-length 9 --export hop
      the motion and a model for MuJoCo and Drake
  orbits find --machine wheel --set inertia_ratio=1 --set gravity_ratio=0.5
      it walks; also rocker and shuttle
  orbits prove --spring cubic --set beta=0.3 --rest-length 8
  orbits prove --spring cubic --between beta=0.299:0.301 --rest-length 8
  orbits prove --spring cubic --along beta --from 0 --to 1 --rest-length 30
  orbits check-proof proof.json
      verify a saved proof by a second program
  orbits follow --spring cubic --along beta --from 0 --to 5 --at 0.5,1,2
  orbits follow --spring cubic --along beta --from 0 --to -0.02 \\
      --plot fold.png
  orbits follow --spring cubic --tune beta=0.3 --along period --to 14
  orbits follow --spring tanh --along b --from 0.1 --to 1 --family 2 \\
      --output tanh.jsonl
  orbits map --alpha 3:12:10000 --plot map.png
      the return map of launch speeds
  orbits map --alpha 4.3:5:400 --along inject --from 0 --to 0.15 \\
      --plot flips.png
  orbits simulate --alpha 4.6 --hops 8 --inject 0.01
      with every impact located
  orbits check --machine rover.toml
      the equations against the statement of the machine
  orbits optimize leg.toml --plot best.png
      the best design, for the problem in [design] of the file
  orbits explore --spring cubic --set beta=0.3 --rest-length 8
      an interactive page in the browser
  orbits sweep --spring cubic --over beta=0:1 --over mass_ratio=0.1:10:log \\
      --samples 1000 --output hops.csv
  orbits existence --spring cubic --along beta=-0.02:0.1 \\
      --across rest_length=6:20 --colour alpha --plot where.png
  orbits find --masses 60,3 --rest-length 0.8 --spring "8000*r + 2e6*r**3"
      a leg in SI: kg, N of m, m
  orbits find --masses 60,3 --rest-length 0.8 --stiffness 8000
      a linear spring: N/m
  orbits uncertainty --spring cubic --over "beta=norm(0.3,0.02)" --indices \\
      --plot spread.png
  orbits control keep-hopping --damping 0.01
      the least effort that keeps a damped machine hopping
  orbits control recover --short 0.1
      back to the lossless launch speed in one hop
  orbits control keep-hopping --damping 0.01 --actuator "force:y1 - y2" \\
      --force 0.5
  orbits sweep --machine soft.toml --start hop.json \\
      --over ground_stiffness=40:60 --samples 100
  orbits control keep-hopping --follow damping:0.2
      all such motions, from the lossless hop on
  orbits control start-up --pumps 2 --stroke 2
      from rest in contact onto the lossless hop

\b
Completion by the shell, from a line in its start file:
  eval "$(_ORBITS_COMPLETE=bash_source orbits)"
      in ~/.bashrc; zsh_source in ~/.zshrc
  _ORBITS_COMPLETE=fish_source orbits | source
      in ~/.config/fish/config.fish
"""
# Garbage is collected after this number of new objects, more than a short command makes.
GARBAGE_THRESHOLD = 200_000
# A map of more launches is printed as a summary.
LONGEST_TABLE = 100
# The number of orbits drawn small above the figure of a family.
THUMBNAILS = 6


@click.group(epilog=EXAMPLES, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="persistent-orbits", prog_name="orbits")
def orbits() -> None:
    """Motions of hopping and juggling machines that lose no energy, although their collisions are plastic.

    The force of a spring is a formula of its extension r, and gravity is a formula of the height z. Every other name
    in a formula is a parameter; --set states its value. The unit of length is the foot's weight over the stiffness.
    With --masses, or with a table [si] in its file, a machine is in SI, and its masses are parameters too.
    """


@orbits.command("find", epilog="Exit code: 0 found, 1 no such orbit or an inadmissible one, 2 bad input.")
@options.machine_options
@options.family_option("Number of the family, from 1. A higher family oscillates more often in flight.")
@options.method_option
@options.start_option
@options.tune_option
@options.at_option
@click.option("--all", "every", is_flag=True, help="Find all orbits of the family, or all swings of a brachiator.")
@click.option("--allow-inadmissible", is_flag=True, help="Exit with 0 even if the orbit is not a motion.")
@options.limit_option
@options.json_option
@click.option("--explain", is_flag=True, help="Print which steps were not needed for this machine.")
@options.plot_option
@options.animate_option
@options.file_option("--save", "result", "Save the orbit (.json), for Orbit.load.")
@options.export_option
def find_command(
    family: int, method: str | None, hop: str | None, tune: tuple[str, ...], prescribed: tuple[str, ...],
    every: bool, allow_inadmissible: bool, limit: float | None, as_json: bool, explain: bool, plot: str | None,
    animate: str | None, save: str | None, export: str | None, **stated: Any,
) -> None:  # fmt: skip
    """Find one lossless orbit and certify it. With --tune and --at, parameters of the machine are found too.

    Of a brachiator it finds the fastest swing. With --all and --json the document of the first orbit has those of all
    orbits under the key all.
    """
    from orbits.errors import InputError
    from orbits.io import to_json
    from orbits.periodic import Oscillation, Swing, find, find_all, grip_of

    from ..machines import build, search

    stated_family = click.get_current_context().get_parameter_source("family") is not ParameterSource.DEFAULT
    stated, tuned = options.with_tuned(stated, tune)
    statement, where = options.statement_of(**stated)
    machine, own = build(statement, where), search(statement, where)
    requested = family if stated_family or not (hop or grip_of(machine)) else None
    start, tune_of = options.started(machine, hop) or own.get("start"), tuned or own.get("tune")
    at = options.named_values(prescribed, "--at") or own.get("at")
    with options.progress() as report:
        if every:
            if start or tune_of or at:
                raise InputError("--all searches the machine as it is stated: leave out --start, --tune and --at")
            found = find_all(machine, family=requested, method=method, progress=report, limit=limit)
        else:
            found = (
                find(machine, requested, method=method, progress=report, limit=limit, start=start, tune=tune_of, at=at),
            )
    orbit: Any = found[0]
    if isinstance(orbit, Oscillation) and (animate or export or explain):
        raise InputError("--animate, --export and --explain are for hops, not for oscillations")
    if isinstance(orbit, Swing) and (export or explain):
        raise InputError("--export and --explain are for hops, not for swings")
    if every and as_json:
        click.echo(to_json({**orbit.document(), "all": [each.document() for each in found]}))
    options.write(orbit, as_json, plot, animate, save, export, silent=every and as_json)
    for each in found[1:] if not as_json else ():
        click.echo(str(each))
    if explain and not as_json:
        from orbits.tables import wrapped

        click.echo("  what this machine did not need:")
        for line in orbit.skipped:
            click.echo("\n".join(wrapped(line, indent="      ", onward="        ")))
    if not orbit.admissible and not allow_inadmissible:
        raise click.exceptions.Exit(1)


@orbits.command("prove", epilog="Exit code: 0 proved, 1 not proved or no such orbit, 2 bad input.")
@options.machine_options
@options.family_option("Number of the family, as in find.")
@options.start_option
@click.option(
    "--between",
    "intervals",
    metavar="NAME=LOW:HIGH",
    multiple=True,
    help="Interval of a parameter, between two decimals; repeatable.",
)
@click.option("--digits", type=click.IntRange(1, 300), metavar="N", help="Digits to enclose; default: about 18.")
@click.option("--loss", is_flag=True, help="Enclose the loss coefficient too.")
@click.option(
    "--attraction", is_flag=True, help="Prove that the orbit attracts the launches above it, up to a distance."
)
@click.option(
    "--inject", metavar="EPS", help="Prove a fixed point of the return map with this speed added at every launch."
)
@click.option("--near", type=float, metavar="ALPHA", help="With --inject: a launch speed near the fixed point.")
@click.option("--along", metavar="NAME", help="Prove the family along a parameter as one curve, with its folds.")
@click.option(
    "--from", "start", type=float, metavar="A", help="First value of the parameter; default: the value of --set."
)
@click.option("--to", "stop", type=float, metavar="B", help="Last value of the parameter.")
@options.tune_option
@options.at_option
@options.limit_option
@options.json_option
@options.file_option("--save", "result", "Save the proof (.json).")
def prove_command(
    family: int, hop: str | None, intervals: tuple[str, ...], digits: int | None, loss: bool, attraction: bool,
    inject: str | None, near: float | None, along: str | None, start: float | None, stop: float | None,
    tune: tuple[str, ...], prescribed: tuple[str, ...], limit: float | None, as_json: bool, save: str | None,
    **stated: Any,
) -> None:  # fmt: skip
    """Prove by interval arithmetic that a lossless orbit exists, that no other is nearby, and that it is a motion.

    With --inject and --near, prove a fixed point of the return map instead, and whether it is stable.

    --set, --between and --at state exact decimals; every other number is the shortest decimal of its float. With
    --between the theorem holds for each value of a parameter between two decimals. With --along the theorem says that
    the orbits between two values of a parameter form one curve. The parameters of --tune are unknowns of the theorem.
    This command needs python-flint: pip install 'persistent-orbits[proof]'.
    """
    from orbits.errors import InputError
    from orbits.exact import BY_EQUATIONS
    from orbits.periodic import find
    from orbits.proof import prove
    from orbits.returns import prove_fixed_point

    if (inject is None) != (near is None) or ((loss or attraction) and inject is not None):
        raise InputError("give --inject EPS and --near ALPHA together, and leave out --loss and --attraction")
    if (tune or prescribed) and (inject is not None or along is not None):
        raise InputError("--tune and --at are for one orbit: leave out --along and --inject")
    if hop is not None and (inject is not None or along is not None):
        raise InputError("--start is for one orbit: leave out --along and --inject")
    exact = options.exact_parameters(stated["settings"], intervals)
    if along is not None or start is not None or stop is not None:
        if along is None or stop is None or intervals or loss or attraction or inject is not None:
            others = "--between, --loss, --attraction, --inject"
            raise InputError(f"--along NAME needs --to B and may have --from A; leave out {others}")
        proof = options.proved_curve(along, (start, stop), family, stated, digits=digits, limit=limit)
    elif inject is not None and near is not None:
        machine = options.machine_of(**options.with_middles(stated, intervals))
        proof = prove_fixed_point(machine, near, inject, digits=digits, parameters=exact, limit=limit)
    else:
        stated, tuned = options.with_tuned(stated, tune)
        machine = options.machine_of(**options.with_middles(stated, intervals))
        at = options.named_values(prescribed, "--at")
        with options.progress() as report:
            first = options.started(machine, hop)
            orbit = find(
                machine, None if first else family, start=first, progress=report, limit=limit, tune=tuned, at=at or None
            )
        exact = {name: value for name, value in exact.items() if name not in (tuned or ())}
        decimals = {name: options.exact_parameters(prescribed, ())[name] for name in at if name in BY_EQUATIONS}
        proof = prove(
            orbit, digits, parameters=exact, loss=loss, attraction=attraction, at=decimals or None, limit=limit
        )
    options.write(proof, as_json, save=save)
    if not proof.proved:
        raise click.exceptions.Exit(1)


@orbits.command("check-proof", epilog="Exit code: 0 verified, 1 not verified, 2 bad input, 3 a fault of the program.")
@click.argument("file")
@click.option(
    "--limit",
    type=click.FloatRange(0, min_open=True),
    metavar="SECONDS",
    help="Limit of processor time; default: 600 s.",
)
@options.json_option
def check_proof_command(file: str, limit: float | None, as_json: bool) -> None:
    """Verify a saved proof of an orbit, or of periodic hops, by a second program that reads only this file.

    The program prints the theorem that it has verified. It writes the words itself, from the numbers of the file.
    """
    from traceback import format_exc

    from orbits.errors import InputError
    from orbits.io import read_file, read_sealed
    from orbits.proof import need_flint

    need_flint()
    from orbits.check_returns import check_saved
    from orbits.check_statement import LIMIT, OutOfTime, statement_of
    from orbits.tables import wrapped

    document = read_file(file, f"'{file}' is not a saved proof", read_sealed)
    began = time.perf_counter()
    try:
        reasons = check_saved(document, limit or LIMIT)
        statement = None if reasons else statement_of(document)
    except OutOfTime:
        late = f"'{file}' is neither verified nor refused within {limit or LIMIT:g} s of processor time"
        raise InputError(f"{late}: allow more by --limit") from None
    except Exception:
        click.echo(f"{format_exc()}orbits: the second program failed; please report it with the file", err=True)
        raise click.exceptions.Exit(3) from None
    seconds = time.perf_counter() - began
    verdict = {"verified": not reasons, "reasons": reasons, "statement": statement, "seconds": seconds}
    notes = [*(f"not verified: {reason}" for reason in reasons), *([statement] if statement else [])]
    words = ["NOT VERIFIED" if reasons else "verified", *(x for note in notes for x in wrapped(note, indent="  "))]
    click.echo(json.dumps(verdict) if as_json else "\n".join(words))
    if reasons:
        raise click.exceptions.Exit(1)


# Columns of the table of a map's hops.
COLUMNS_OF_HOPS = {"alpha": "launch speed", "next": "next", "loss": "loss"}


@orbits.command(
    "follow",
    epilog="Exit code: 0 followed to its end; 1 no such orbit, or the curve was lost or took too long; 2 bad input.",
)
@options.machine_options
@options.family_option("Number of the family, as in find.")
@click.option(
    "--along",
    required=True,
    metavar="NAME",
    help="The parameter: one of a law, mass_ratio or rest_length; in SI also a mass, stiffness or surface_gravity. "
    "With --tune, a quantity of the orbits: period, frequency, alpha, .... With energy, the oscillations on the "
    "standing foot are followed.",
)
@click.option(
    "--from", "start", type=float, metavar="A", help="First value of the parameter; default: the value of --set."
)
@click.option(
    "--to", "stop", required=True, metavar="B|A:B",
    help="Last value of the parameter, or a range, which is followed both ways from the first value.",
)  # fmt: skip
@options.tune_option
@click.option("--at", metavar="V1,V2,...", help="Values of the parameter to hit exactly.")
@click.option(
    "--longest", type=float, default=0.02, show_default=True, help="Largest spacing of points, as a share of the range."
)
@options.start_option
@click.option("--method", metavar="NAME", help="As in find.")
@click.option("--stop-inadmissible", is_flag=True, help="End where the orbits cease to be motions.")
@click.option("--multipliers", is_flag=True, help="Locate where multipliers cross the unit circle.")
@options.free_limit_option
@options.json_option
@options.plot_option
@options.file_option("--output", "lines", "Write each point as it is found (.jsonl), to load or to resume from.")
@options.file_option("--save", "family", "Save the whole family: .csv, .nc or .jsonl.")
@click.option("--resume", metavar="FILE", help="Continue from the end of a family written by --output or --save.")
@click.option(
    "--event",
    metavar="EVENT",
    help="Follow an event of the family along --second instead: a kind, such as fold or 'masses touch'; a formula "
    "with its value, such as clearance=0.1; or 'extremum of alpha'.",
)
@click.option("--second", metavar="NAME=STOP", help="The second parameter, which goes from its own value to STOP.")
@click.option("--families", metavar="N1,N2,...", help="Follow several families, in one table and figure.")
def follow_command(
    family: int, along: str, start: float | None, stop: str, tune: tuple[str, ...], at: str | None, longest: float,
    hop: str | None, method: str | None, stop_inadmissible: bool, multipliers: bool, as_json: bool, plot: str | None,
    output: str | None, save: str | None, resume: str | None, event: str | None, second: str | None,
    families: str | None, **stated: Any,
) -> None:  # fmt: skip
    """Follow a family of orbits along a parameter, past folds, to its end.

    It can also follow several families, or an event of a family in two parameters.
    """
    from orbits.continuation import Family, follow

    values = options.numbers("--at", at, float) if at else []
    before = None if resume is None else Family.load(resume)
    stated, tuned = options.with_tuned(stated, tune)
    machine = options.machine_along(along, start, bool(tuned), stated)
    first = options.started(machine, hop) if before is None else None
    of_event = options.event_of(event, second)
    several = options.several_families(families, save, family > 1 or output or resume or of_event or hop)
    with options.progress() as report:
        followed: Any = follow(
            machine, along, options.last_values(stop), first or start, family, at=values, longest=longest,
            method=method, stop_inadmissible=stop_inadmissible, multipliers=multipliers,
            output=None if of_event else output, resume=before, progress=report, tune=tuned, **several,
        )  # fmt: skip
    if of_event:
        from orbits.continuation import follow_event

        followed = follow_event(followed, *of_event, longest=longest, output=output)
    if plot is not None:
        from orbits.continuation import orbit_at
        from orbits.show import plot_family, save_figure, spread, thumbnails

        if several or not (of_event or isinstance(followed, Family)):
            axes = followed.plot()
        elif of_event:
            axes = plot_family(followed, quantity=along)
        else:
            method = followed.settings["method"]
            small = [(point, orbit_at(machine, point, along, method)) for point in spread(followed, THUMBNAILS)]
            axes = thumbnails(plot_family(followed), followed, small)
        save_figure(axes, plot)
    options.write(followed, as_json, save=save)
    curves = [*followed.families.values()] if several else [followed]
    ends = {end.kind for each in curves for end in (getattr(each, "beginning", None), each.end) if end}
    if {"stuck", "interrupted"} & ends or (several and followed.missing):
        raise click.exceptions.Exit(1)


@orbits.command("map", epilog="Exit code: 0 done, even if hops come to rest; 2 bad input.")
@options.machine_options
@options.loss_options
@click.option("--alpha", metavar="A|A:B:N", help=f"A launch speed, or N launch speeds from A to B{options.IN_UNITS}")
@options.start_option
@options.free_limit_option
@options.json_option
@options.file_option("--plot", "figure", "Write a figure of the map from A to B (.png, .pdf, .svg).")
@click.option("--cobweb", type=float, metavar="A0", help="Draw the hops from this launch speed into the figure.")
@click.option(
    "--basins", is_flag=True, help="Find where the launches from A to B lead, and what share of them leads there."
)
@click.option("--all", "whole", is_flag=True, help=f"Print every launch, even if there are more than {LONGEST_TABLE}.")
@click.option("--cap", type=click.IntRange(1), default=2000, show_default=True, help="Bound on the impacts in one hop.")
@click.option(
    "--along",
    metavar="NAME",
    help="Follow the map's fixed points between A and B along inject, restitution, damping or another parameter.",
)
@click.option("--from", "start", type=float, metavar="V", help="First value of the parameter.")
@click.option("--to", "stop", type=float, metavar="W", help="Last value of the parameter.")
@click.option(
    "--attractor", type=click.IntRange(0), metavar="N", help="Number of values at which to compute the attractor."
)
@options.file_option("--save", "result", "Save the diagram: .json, or its points as .csv.")
def return_map(
    alpha: str | None, hop: str | None, inject: float, as_json: bool, plot: str | None, cobweb: float | None,
    whole: bool, basins: bool, cap: int, along: str | None, start: float | None, stop: float | None,
    attractor: int | None, save: str | None, **stated: Any,
) -> None:  # fmt: skip
    """Map launch speeds to the next launch speeds, with the losses and impacts in between.

    With --along, follow the fixed points of the map and its hops of period two along a parameter, with their folds and
    flips. With --basins, find which share of the launches leads to each attracting hop. If a launch has several
    numbers, the map starts from the saved orbit of --start and prints its multipliers; --alpha replaces the orbit's
    launch speed.
    """
    from orbits.errors import InputError
    from orbits.io import to_json
    from orbits.returns import ReturnMap
    from orbits.show import save_figure

    speeds = None if alpha is None else options.launch_speeds(alpha)
    if along is not None:
        if cobweb is not None or whole or basins or start is None or stop is None or speeds is None or len(speeds) < 2:
            raise InputError(
                "--along needs --from V, --to W and a range --alpha A:B:N; leave out --cobweb, --all and --basins"
            )
        settings = {"inject": inject, "cap": cap, "attractor": attractor}
        diagram = options.diagram_of(along, (start, stop), speeds, hop, stated, settings)
        options.write(diagram, as_json, plot, save=save)
        return
    if any(each is not None for each in (start, stop, attractor)) or (save is not None and not basins):
        raise InputError("--from, --to and --attractor need --along NAME, and --save needs --along NAME or --basins")
    machine = options.machine_of(**stated)
    if basins:
        others = cobweb is not None or whole or hop is not None
        options.write(_basins(ReturnMap(machine, inject, cap), speeds, others), as_json, plot, save=save)
        return
    launches = options.launches_of(machine, hop, speeds)
    if not machine.model.one_speed:
        if cobweb is not None or whole:
            raise InputError("--cobweb and --all are for maps of launch speeds: a launch has several numbers here")
        options.write_launches(ReturnMap(machine, inject, cap), launches, as_json, plot, speeds is None)
        return
    speeds = launches if speeds is not None else options.launch_speeds(repr(launches))
    if not 0 < speeds[0] < float("inf"):
        raise InputError(f"--alpha {alpha}; launch speeds must be above 0")
    if plot is not None:
        if len(speeds) < 2:
            raise InputError(f"--plot needs a range, --alpha A:B:N, not --alpha {alpha}")
    elif cobweb is not None:
        raise InputError("--cobweb is drawn into a figure: give --plot FILE too")
    if cobweb is not None and not 0 < cobweb < float("inf"):
        raise InputError(f"--cobweb {cobweb:g}; a launch speed must be above 0")
    step = ReturnMap(machine, inject, cap)
    with options.progress():
        hops = step(speeds)
        if plot is not None:
            save_figure(step.plot(float(speeds[0]), float(speeds[-1]), start=cobweb), plot)
    if as_json:
        click.echo(to_json(hops.document()))
    elif len(speeds) > LONGEST_TABLE and not whole:
        click.echo(f"{hops}\n  --all prints each, --json all as one document")
    else:
        _print_hops(step, hops)


def _basins(step: "ReturnMap", speeds: Any, others: bool) -> Any:
    """The basins between the first and the last of some launch speeds; raises `InputError` with other options."""
    from orbits.errors import InputError

    if others or speeds is None or len(speeds) < 2:
        raise InputError("--basins needs a range --alpha A:B:N; leave out --cobweb, --all and --start")
    with options.progress() as report:
        return step.basins(float(speeds[0]), float(speeds[-1]), progress=report)


def _print_hops(step: "ReturnMap", hops: "Hops") -> None:
    """Print each hop of a map in a line of its own."""
    from orbits.tables import number_text, text_table, wrapped

    heads = [f"{name} ({hops.units[key]})" if hops.units else name for key, name in COLUMNS_OF_HOPS.items()]
    columns = [hops.document()[name] for name in (*COLUMNS_OF_HOPS, "impacts", "status")]
    rows = zip(*columns, strict=True)
    texts = [
        [*(number_text(x, "", n) for x, n in zip(row, (12, 12, 9), strict=False)), *map(str, row[3:])] for row in rows
    ]
    click.echo("\n".join(text_table(texts, [*heads, "impacts", "status"])))
    speeds = hops.alpha
    if len(speeds) <= LONGEST_TABLE and (separations := step.smallest_separation(speeds)) is not None:
        for speed in speeds[separations <= 0]:
            text = f"{step.machine.model.violations['separation']} in the hop from {speed:.12g}"
            click.echo("\n".join(wrapped(text, onward="    ")))


@orbits.command("simulate", epilog="Exit code: 0 done, even if the machine comes to rest; 2 bad input.")
@options.machine_options
@options.loss_options
@click.option("--alpha", type=float, metavar="A", help=f"Launch speed at the first lift-off{options.IN_UNITS}")
@options.start_option
@click.option("--hops", type=click.IntRange(1), metavar="N", help="End after N lift-offs.")
@click.option("--cap", type=click.IntRange(1), default=2000, show_default=True, help="Bound on the impacts in one hop.")
@click.option("--time", "end", type=options.POSITIVE, metavar="T", help=f"End at this time{options.IN_UNITS}")
@options.free_limit_option
@options.json_option
@options.plot_option
@options.animate_option
@options.export_option
def simulate_command(
    alpha: float | None, hop: str | None, hops: int | None, end: float | None, cap: int, inject: float, as_json: bool,
    plot: str | None, animate: str | None, export: str | None, **stated: Any,
) -> None:  # fmt: skip
    """Simulate the machine from a launch, through every impact and contact."""
    from orbits.hops import simulate

    machine = options.machine_of(**stated)
    launch = options.launches_of(machine, hop, alpha)
    run = simulate(machine, launch, hops=hops, time=float("inf") if end is None else end, inject=inject, cap=cap)
    options.write(run, as_json, plot, animate, export=export)


@orbits.command("check", epilog="Exit code: 0 all compared relations hold; 2 one of them does not, or bad input.")
@options.machine_options
@options.damper_options
@options.start_option
@options.json_option
def check_command(hop: str | None, as_json: bool, **stated: Any) -> None:
    """Check the derived equations of a machine against its statement: forces, impacts, energies, and an integration by
    DOP853.

    The command names the relations that it could not compare, and why.
    """
    from orbits.checks import check

    options.write(check(options.machine_of(**stated), start=hop), as_json)


@orbits.command("optimize", epilog="Exit code: 0 found, 1 no such design (with the reason), 2 bad input.")
@click.argument("file", metavar="FILE.toml")
@options.start_option
@options.free_limit_option
@options.json_option
@options.file_option("--plot", "figure", "Write a figure of the best orbit, or of the front (.png, .pdf, .svg).")
@options.file_option("--save", "result", "Save the design (.json), or the front (.json, .csv).")
def optimize_command(file: str, hop: str | None, as_json: bool, plot: str | None, save: str | None) -> None:
    """Find the best design of a machine, or a Pareto front of two objectives, for the problem in its file.

    In addition to the machine the file has a table [design]. It states minimise, a formula or a list of two formulas
    for a front, or it states maximise. It may also state subject_to, a list of constraints, and tune, at, family,
    starts, seed and points. The table [design.over] has the bounds of each parameter, such as k = [1e3, 1e5].
    """
    from orbits.design import Front, optimize as best_design, pareto
    from orbits.errors import InputError
    from orbits.show import save_figure

    from ..machines import build, design, read

    statement = read(file)
    machine, problem = build(statement, file), design(statement, file)
    front = isinstance(problem.get("minimise"), tuple)
    problem["start"] = options.started(machine, hop)
    with options.progress() as report:
        try:
            found = (pareto if front else best_design)(machine, **problem, progress=report)
        except InputError as error:
            raise InputError(f"{file}: {error}") from None
    if plot is not None:
        save_figure(found.plot() if isinstance(found, Front) else found.orbit.plot(), plot)
    options.write(found, as_json, save=save)


@orbits.command(
    "sweep", epilog="Exit code: 0 done, even if some members have no orbit; 1 no member has an orbit; 2 bad input."
)
@options.machine_options
@click.option(
    "--over",
    multiple=True,
    metavar="NAME=RANGE",
    help="A parameter and its range: LOW:HIGH, LOW:HIGH:log, V1,V2,... or norm(MEAN,SD); repeatable.",
)
@click.option("--from", "designs", metavar="FILE.csv", help="A table of the members, with a column for each parameter.")
@click.option(
    "--samples", type=int, metavar="N", help="Number of members; on a grid, the number of values in each range."
)
@click.option(
    "--sampling", metavar="WAY",
    help="How to choose the members: grid, sobol, lhs or random; default: grid if values are listed, else sobol.",
)  # fmt: skip
@options.seed_option
@click.option("--family", "families", default="1", show_default=True, metavar="N1,N2,...", help="Numbers of families.")
@options.start_option
@options.method_option
@options.tune_option
@options.at_option
@click.option("--quantities", metavar="A,B,...", help="Further columns: quantities of the orbit, or formulas of them.")
@click.option(
    "--outcome", default="find", show_default=True, metavar="find|map|fixed_points",
    help="What to compute: orbits, next launch speeds, or fixed points of the return map.",
)  # fmt: skip
@click.option("--between", metavar="A:B", help="Launch speeds between which to search for fixed points.")
@click.option("--store", metavar="FILE", help="SQLite file to which each member is written as soon as it is done.")
@click.option("--resume", is_flag=True, help="Continue the store if it exists.")
@options.workers_option
@options.free_limit_option
@options.json_option
@options.file_option("--output", "result", "Write the members: .csv, .nc, .parquet or .json.")
@options.plot_option
def sweep_command(
    over: tuple[str, ...], designs: str | None, samples: int | None, sampling: str | None, seed: int, families: str,
    hop: str | None, method: str | None, tune: tuple[str, ...], prescribed: tuple[str, ...], quantities: str | None,
    outcome: str, between: str | None, store: str | None, resume: bool, workers: int | None, as_json: bool,
    output: str | None, plot: str | None, **stated: Any,
) -> None:  # fmt: skip
    """Find the orbits of many machines, over ranges of their parameters."""
    from orbits.errors import InputError
    from orbits.sweeps import sweep

    axes, table = options.swept_members(over, designs)
    if table is not None and samples is not None:
        raise InputError("--samples draws members, but --from lists them: leave one out")
    if resume and store is None:
        raise InputError("--resume continues a store: give --store FILE too")
    stated, tuned = options.with_tuned(stated, tune)
    machine = options.machine_of(**options.with_first_values(stated, axes, table))
    result = sweep(
        machine, axes if table is None else None, samples if table is None else table, sampling=sampling, seed=seed,
        family=options.numbers("--family", families, int), quantities=options.formulas(quantities), outcome=outcome,
        between=None if between is None else tuple(options.numbers("--between", between, float, ":")),
        store=store, resume=resume, start=options.started(machine, hop), method=method, tune=tuned,
        at=options.named_values(prescribed, "--at") or None, **options.computed_by(workers),
    )  # fmt: skip
    options.write(result, as_json, plot, save=output)
    if not result.found:
        raise click.exceptions.Exit(1)


@orbits.command("existence", epilog="Exit code: 0 done; 1 no member has an orbit; 2 bad input.")
@options.machine_options
@click.option("--along", required=True, metavar="NAME=LOW:HIGH[:log]", help="The parameter within each row.")
@click.option(
    "--across", required=True, metavar="NAME=RANGE",
    help="The parameter that differs between rows: LOW:HIGH, LOW:HIGH:log or V1,V2,...",
)  # fmt: skip
@options.family_option("Number of the family, as in find.")
@options.start_option
@click.option(
    "--samples", default="100", show_default=True, metavar="N[,M]", help="Numbers of values along and across."
)
@click.option("--quantities", metavar="A,B,...", help="Further columns: quantities of the orbit, or formulas of them.")
@click.option("--both-ways", is_flag=True, help="Locate boundaries between the rows too.")
@click.option("--colour", metavar="QUANTITY", help="Colour the figure by a quantity.")
@options.workers_option
@options.free_limit_option
@options.json_option
@options.file_option("--output", "result", "Write the diagram (.json, .nc), or its rows (.csv).")
@options.plot_option
def existence_command(
    along: str, across: str, family: int, hop: str | None, samples: str, quantities: str | None, both_ways: bool,
    colour: str | None, workers: int | None, as_json: bool, output: str | None, plot: str | None, **stated: object,
) -> None:  # fmt: skip
    """Find where orbits exist in the plane of two parameters, and where they are motions."""
    from orbits.errors import InputError
    from orbits.show import save_figure
    from orbits.sweeps import existence

    row, between = options.swept_axis("--along", along)
    column, values = options.swept_axis("--across", across)
    if not isinstance(between, tuple) or not isinstance(values, tuple | list):
        raise InputError(
            f"--along {along!r} must be NAME=LOW:HIGH, and --across {across!r} NAME=LOW:HIGH or NAME=V1,V2,..."
        )
    machine = options.machine_of(**options.with_first_values(stated, {row: between, column: values}, None))
    requested, counts = options.formulas(quantities), options.numbers("--samples", samples, int)
    if colour is not None and colour not in requested:
        requested.append(colour)
    diagram = existence(
        machine, row, between, column, values, family, samples=counts[0] if len(counts) == 1 else tuple(counts),
        both_ways=both_ways, quantities=requested, start=options.started(machine, hop), **options.computed_by(workers),
    )  # fmt: skip
    options.write(diagram, as_json, save=output)
    if plot is not None:
        save_figure(diagram.plot(colour), plot)
    if not diagram.grid.found:
        raise click.exceptions.Exit(1)


@orbits.command("uncertainty", epilog="Exit code: 0 done, 1 no such orbit, 2 bad input.")
@options.machine_options
@click.option(
    "--over",
    multiple=True,
    required=True,
    metavar="NAME=RANGE",
    help="An uncertain parameter and its distribution: norm(MEAN,SD), LOW:HIGH or LOW:HIGH:log; repeatable.",
)
@click.option("--samples", type=int, default=1024, show_default=True, metavar="N", help="Number of members.")
@options.seed_option
@options.family_option("Number of the family, as in find.")
@options.start_option
@click.option("--quantities", metavar="A,B,...", help="Further rows: quantities of the orbit, or formulas of them.")
@click.option("--indices", is_flag=True, help="Print Sobol's indices too: which parameter causes the spread.")
@options.workers_option
@options.free_limit_option
@options.json_option
@options.file_option("--output", "result", "Write the quantities: .json, .csv, .nc or .parquet.")
@options.file_option("--plot", "figure", "Write a figure of the distribution of --quantity, or of the indices.")
@click.option("--quantity", metavar="A", help="Quantity that the figure shows; default: alpha.")
def uncertainty_command(
    over: tuple[str, ...], samples: int, seed: int, family: int, hop: str | None, quantities: str | None, indices: bool,
    workers: int | None, as_json: bool, output: str | None, plot: str | None, quantity: str | None, **stated: object,
) -> None:  # fmt: skip
    """Find how uncertain the quantities of an orbit are if parameters are uncertain.

    It prints the mean and the standard deviation of each quantity over the members that are motions, and the standard
    deviation to first order.
    """
    from orbits.errors import InputError
    from orbits.io import to_json
    from orbits.show import save_figure
    from orbits.sweeps import uncertainty

    if quantity is not None and plot is None:
        raise InputError("--quantity selects what a figure shows: give --plot FILE too, or use --quantities")
    axes, _ = options.swept_members(over, None)
    machine = options.machine_of(**options.with_first_values(stated, axes, None))
    requested = options.formulas(quantities)
    if quantity is not None and quantity not in requested:
        requested.append(quantity)
    found = uncertainty(
        machine, axes, requested, family=family, samples=samples, seed=seed,
        start=options.started(machine, hop), **options.computed_by(workers),
    )  # fmt: skip
    shares = found.sweep.sensitivity(seed=seed, samples=options.power_of_two(samples)) if indices else None
    if output is not None:
        found.save(output)
    if plot is not None:
        save_figure((found if shares is None else shares).plot(quantity), plot)
    if as_json:
        click.echo(to_json(found.document() | ({} if shares is None else {"indices": shares.document()})))
    else:
        click.echo("\n".join(map(str, filter(None, (found, shares)))))


@orbits.command("control", epilog="Exit code: 0 found, 1 no such motion (with the reason), 2 bad input.")
@click.argument("goal", metavar=f"[{'|'.join(options.GOALS)}]", callback=options.goal)
@options.machine_options
@options.damper_options
@options.family_option("Number of the family, as in find.")
@options.start_option
@click.option(
    "--actuator",
    metavar="EXTENSION|force:DISTANCE",
    help="The extension of the spring whose end moves, or a force and the distance along which it acts, such as "
    "'force:y1 - y2'; default: the end of the only spring.",
)
@click.option("--rate", type=options.POSITIVE, metavar="W", help=f"Largest rate of the actuator{options.IN_UNITS}")
@click.option(
    "--stroke", type=options.POSITIVE, metavar="U", help=f"Largest displacement of the actuator{options.IN_UNITS}"
)
@click.option("--force", type=options.POSITIVE, metavar="F", help=f"Largest force of the actuator{options.IN_UNITS}")
@click.option("--power", type=options.POSITIVE, metavar="P", help=f"Largest power of the actuator{options.IN_UNITS}")
@click.option(
    "--speed-force",
    type=(options.POSITIVE, options.POSITIVE),
    metavar="V0 F0",
    help=f"For a motor: the speed above which it cannot drive, and its largest force at rest{options.IN_UNITS}",
)
@click.option(
    "--intervals",
    type=click.IntRange(1),
    metavar="N",
    help="Number of intervals of constant rate; default: 40, or 20 in each half swing of start-up.",
)
@click.option(
    "--cost", metavar="effort|work|peak", help=f"{options.KEEP}: what to minimise; default: effort. Work needs --rate."
)
@click.option("--speed", type=options.POSITIVE, metavar="V", help=f"{options.KEEP}: the launch speed{options.IN_UNITS}")
@click.option(
    "--height",
    type=options.POSITIVE,
    metavar="H",
    help=f"{options.KEEP}: the rise of the centre of mass in flight{options.IN_UNITS}",
)
@click.option(
    "--period",
    type=options.POSITIVE,
    metavar="T",
    help=f"{options.KEEP}: the duration of flight and contact together{options.IN_UNITS}",
)
@click.option(
    "--plastic", is_flag=True, help=f"{options.KEEP}, recover: the foot may land with a speed, which is lost."
)
@click.option("--short", type=float, metavar="V", help="recover: by how much the launch is too slow.")
@click.option("--pumps", type=click.IntRange(1), metavar="N", help="start-up: number of swings before lift-off.")
@click.option(
    "--follow",
    metavar="NAME:TO",
    help=f"{options.KEEP}: follow the family of motions to this value of a number, such as damping:0.2, or speed:5 "
    "with --speed.",
)
@options.free_limit_option
@options.json_option
@options.plot_option
@options.animate_option
@options.file_option("--save", "result", "Write the motion (.json, to load), or its states, inputs and forces (.csv).")
def control_command(
    goal: str, family: int, hop: str | None, as_json: bool, plot: str | None, animate: str | None, save: str | None,
    follow: str | None, **stated: Any,
) -> None:  # fmt: skip
    """Find a motion of locally least effort for a machine with an actuator.

    The actuator moves the end of a spring, or it exerts a force. keep-hopping keeps a damped machine hopping. recover
    returns a machine from a launch that is too slow to its lossless hop, in one hop. start-up brings a machine from
    rest in contact onto its lossless hop.
    """
    from .. import steering

    wanted, along = options.steering_arguments(goal, stated), options.followed_number(goal, follow, animate)
    functions: dict[str, Any] = {options.KEEP: steering.keep_hopping, "recover": steering.recover}
    functions["start-up"] = steering.start_up
    machine = options.machine_of(**stated)
    with options.progress() as report:
        first = options.started(machine, hop)
        found = functions[goal](machine, family=family, start=first, progress=report, **wanted)
        found = found.follow(*along) if along else found
    options.write(found, as_json, plot, animate, save)


@orbits.command("explore", epilog="Exit code: 0 ended by Ctrl-C, 2 bad input.")
@options.machine_options
@options.family_option("Number of the family, as in find.")
@click.option("--no-browser", is_flag=True, help="Serve the page without opening a browser.")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=5007,
    show_default=True,
    help="Port of the page; 0 for any free port.",
)
def explore_command(family: int, no_browser: bool, port: int, **stated: object) -> None:
    """Show a hop or a step on a page with sliders, in the browser: the moving machine, its family and its return map.

    The page is served to this computer only, and needs no network.
    """
    from ..explorer import prepare

    prepare()  # it imports the solver while this process imports Bokeh
    from ..explorer import run

    run(options.first_scene(family, **stated), port, not no_browser, click.echo)


def main() -> None:
    """Run the command; an error is one message and an exit code, never a traceback."""
    # Searches for garbage, while modules are imported and once more at the end, take a sixth of a short command.
    gc.set_threshold(GARBAGE_THRESHOLD)
    atexit.register(gc.freeze)
    try:
        code = orbits.main(prog_name="orbits", standalone_mode=False) or 0
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        code = 0
    except click.ClickException as error:
        code = _failed(_with_unit(error.format_message()), error.exit_code)
    except (click.Abort, KeyboardInterrupt) as error:
        reason = str(error.__cause__ or error)  # click makes its own of an interrupt
        code = _failed(": ".join(filter(None, ("interrupted", reason))), 130)
    except BrokenPipeError:
        sys.stderr.close()  # the reader of the output has closed it
        code = 0
    except OSError as error:  # of standard output: those of files are bad input
        from orbits.io import remedy

        _leave_output()
        code = _failed(f"the output cannot be written: {error}; {remedy('write it elsewhere', error)}", 2)
    except MemoryError:
        code = _failed("there is not enough memory: state fewer launches, hops or points", 1)
    except Exception as error:
        from orbits.errors import InputError, OrbitsError
        from orbits.running import TimeOver

        if isinstance(error, OrbitsError | TimeOver):
            code = _failed(str(error), 2 if isinstance(error, InputError) else 1)
        else:
            code = _failed(f"internal error, please report it: {type(error).__name__}: {error}", 1)
    sys.exit(code)


def _with_unit(message: str) -> str:
    """The message about a value of an option, with what to do about a unit after its number."""
    from orbits.errors import unit_stated

    value, number, _ = message.partition(" is not a valid float")
    text = value.rpartition("'")[0].rpartition("'")[2]
    return f"{value} is not a number{unit_stated(text)}" if number else message


def _failed(message: str, code: int) -> int:
    from orbits.errors import shortened
    from orbits.tables import wrapped

    message = shortened(message)
    try:
        click.echo("\n".join(wrapped(f"orbits: {message}", onward="  ")), err=True)
        if "--json" in sys.argv:
            click.echo(json.dumps({"error": message, "exit_code": code}))
    except OSError:
        _leave_output()
    return code


def _leave_output() -> None:
    """Write no more to standard output, which cannot take it; the rest is not tried again at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.__stdout__.fileno())  # type: ignore[union-attr]


if __name__ == "__main__":
    main()
