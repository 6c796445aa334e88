"""Where the search for a run begins: the vertical hop of the machine, with the lateral rates that fit it best.

Beside a vertical hop, small lateral places and rates obey linear equations, and have to satisfy more conditions than
there are of them. Where a machine is near one with runs beside its hop, the direction in which the conditions change
least is nearly that of the runs; it is scaled to the asked quantity. Where exactly runs begin is another question: they
do at designs at which that change vanishes.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import NoOrbit
from ..model.model import STEP_LENGTH
from ..shooting.formulations import half_orbit, vector
from ..shooting.single_shooting import shooting_equations

# The share of the launch speed at which a run begins where no quantity says how fast it is.
SLOW_SHARE = 0.1


def run_start(machine: Any, hop: Mapping[str, float], at: Mapping[str, float] | None = None) -> dict[str, float]:
    """The unknowns of a half orbit by name, with the step, where the search for a run begins; without dimensions.

    machine : without dimensions, with a coordinate that sticks
    hop : the unknowns of its vertical hop, those of `Mechanism.upright`
    at : values of quantities of the run, of which "speed", "mean_speed" or "step" says how fast it is

    Raises `NoOrbit` where the conditions do not change with any lateral motion.
    """
    model, p = machine.model, {**machine.values, STEP_LENGTH: 0.0}
    names = tuple(p)
    equations = shooting_equations(half_orbit(model), names)
    unknowns = equations.statement.unknowns
    u = {name: hop.get(name, 0.0) for name in unknowns}
    jacobian = equations.evaluate([u[name] for name in unknowns], vector(p), (STEP_LENGTH,)).jacobian
    lateral = [i for i, name in enumerate((*unknowns, STEP_LENGTH)) if name not in hop]
    # The conditions that no vertical motion changes are those of the lateral one.
    own = [i for i in range(len(unknowns)) if i not in lateral]
    across = np.abs(jacobian[:, own]).max(1) <= 1e-9 * np.abs(jacobian).max()
    direction = np.linalg.svd(jacobian[across][:, lateral])[2][-1]
    moved = dict(zip([(*unknowns, STEP_LENGTH)[i] for i in lateral], direction.tolist(), strict=True))
    period = 2 * (u["duration"] + u["contact_duration"])
    by_one = {
        "speed": float(model.planar.travel(model.launch({**u, **moved, "liftoff": u["liftoff"]}, p), p)),
        STEP_LENGTH: moved[STEP_LENGTH],
        "mean_speed": moved[STEP_LENGTH] / period,
    }
    fastest = {"speed": SLOW_SHARE * abs(u["alpha"])}
    name, value = next(((each, (at or {})[each]) for each in by_one if each in (at or {})), next(iter(fastest.items())))
    if not by_one[name]:
        raise NoOrbit(f"the {model.name} does not move along the ground beside its vertical hop: give a start")
    return {**u, **{each: value / by_one[name] * change for each, change in moved.items()}}
