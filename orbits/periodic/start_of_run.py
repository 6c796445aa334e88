"""Where the search for a run begins: the vertical hop of the machine, with the lateral rates that fit it best.

Beside a vertical hop, small lateral places and rates obey linear equations, and have to satisfy more conditions than
there are of them. Where a machine is near one with runs near its hop, the direction in which the conditions change
least is nearly that of the runs; it is scaled to the prescribed quantity. Runs begin exactly at designs at which that
change vanishes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..errors import FlowError, NoOrbit
from ..model import STEP_LENGTH
from ..shooting import Shooting, vector
from .certification import Solved
from .tuned_orbits import OF_STEPS, Tuning, prescribed_value, solve_tuned


class RunStartOptions(NamedTuple):
    """Where the search for a run begins, and along which speeds it goes."""

    slow_share: float = 0.1  # of the launch speed, at which a run begins where no quantity says how fast it is
    unmoved_share: float = 1e-9  # of the largest derivatives: conditions with smaller ones do not change with a motion
    shares: int = 30  # steps at most in which the multiple of the direction is found
    same_share: float = 1e-14  # of it, to which it is found
    faster: float = 1.25  # ratio of two speeds at which runs are searched for one with a prescribed quantity
    speeds: int = 40  # their number


RUN_START = RunStartOptions()


def run_along_speeds(machine: Any, tuning: Tuning, starts: Sequence[Mapping[str, float]]) -> Solved:
    """The run with prescribed quantities that do not say how fast it is: on the family of runs that begins near the
    first start that leads to a run, the first one that has the quantities as the speed grows; raises `NoOrbit` where
    there is none. The starts are unknowns of half orbits by name.

    Beside the vertical hop the speed determines the runs, while other quantities hardly change with it.
    """
    name, value = next((name, value) for name, value in tuning.values.items() if value is not None)
    rest = {each: None for each in tuning.values if each != name}

    def run(speed: float, known: Mapping[str, float]) -> dict[str, float]:
        """The unknowns of the run of a speed to which a known one leads, by name."""
        found = solve_tuned(machine, replace(tuning, values={"speed": speed, **rest}), known)
        return dict(zip(found.equations.statement.unknowns, found.us[0].tolist(), strict=True))

    no_run, reason = f"no run with {name} = {value:.6g} is found near the vertical hop", None
    for start in starts:
        stand, speed = (prescribed_value(machine, each, start) for each in (name, "speed"))
        try:
            known = run(speed, start)
            break
        except (NoOrbit, FlowError) as error:
            reason = reason or error
    else:
        raise NoOrbit(f"{no_run}: {reason}")
    last, ended = stand, "faster runs are not searched"
    for _ in range(RUN_START.speeds):
        here = prescribed_value(machine, name, known)
        if (here - value) * (last - value) <= 0:
            return solve_tuned(machine, tuning, known)
        last = here
        try:
            known = run(RUN_START.faster * speed, known)
        except (NoOrbit, FlowError) as error:
            ended = str(error)
            break
        speed *= RUN_START.faster
    went = f"{name} goes from {stand:.6g} to {last:.6g} as the speed goes from 0 to {speed:.6g}"
    raise NoOrbit(f"{no_run}: {went}; {ended}")


def run_start(machine: Any, equations: Shooting, hop: Mapping[str, float], at: Mapping[str, float]) -> dict[str, float]:
    """The unknowns of a half orbit by name, with the step, where the search for a run begins; without dimensions.

    machine : without dimensions, with a coordinate that sticks
    equations : those of its runs with tuned parameters; the last ones are those of prescribed quantities
    hop : the unknowns of its vertical hop, those of `Mechanism.upright`
    at : values of quantities of the run; "speed", "mean_speed" or "step" says how fast it is

    Raises `NoOrbit` where the conditions do not change with any lateral motion.
    """
    model, p = machine.model, {**dict.fromkeys(equations.parameters, 0.0), **machine.values, STEP_LENGTH: 0.0}
    own = (*model.half_unknowns, STEP_LENGTH)
    u = {name: hop.get(name, 0.0) for name in own}
    known, unknowns = {**p, **u}, equations.statement.unknowns
    vary = () if STEP_LENGTH in unknowns else (STEP_LENGTH,)
    jacobian = equations.evaluate([known[name] for name in unknowns], vector(p), vary).jacobian
    unknowns = (*unknowns, *vary)
    jacobian = jacobian[: len(jacobian) - sum(name not in machine.values for name in equations.parameters)]
    upright, lateral = ([unknowns.index(name) for name in own if (name in hop) == each] for each in (True, False))
    # The conditions that no vertical motion changes are those of the lateral one.
    across = np.abs(jacobian[:, upright]).max(1) <= RUN_START.unmoved_share * np.abs(jacobian).max()
    direction = np.linalg.svd(jacobian[across][:, lateral])[2][-1]
    moved = dict(zip([unknowns[i] for i in lateral], direction.tolist(), strict=True))

    def at_share(share: float) -> dict[str, float]:
        """The unknowns at a multiple of the direction."""
        return {**u, **{name: share * change for name, change in moved.items()}}

    prescribed = [(each, value) for each, value in at.items() if each in OF_STEPS]
    (name, value), *_ = [*prescribed, ("speed", RUN_START.slow_share * abs(u["alpha"]))]
    share = first = 1e-6  # the speed is nearly linear in the angles
    for _ in range(RUN_START.shares):
        near = at_share(share)
        if not (found := float(OF_STEPS[name].of(model, near, {**p, STEP_LENGTH: near[STEP_LENGTH]}))):
            if share != first:
                raise NoOrbit(f"{name} = {value:g} is too small for double precision: prescribe a value farther from 0")
            raise NoOrbit(f"the {model.name} does not move along the ground near its vertical hop: give a start")
        share, last = share * value / found, share
        if abs(share - last) <= RUN_START.same_share * abs(share):
            break
    return at_share(share)
