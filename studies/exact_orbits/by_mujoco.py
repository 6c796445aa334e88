"""The cases by MuJoCo: bodies with contacts, the step swept.

Contacts are as hard as MuJoCo's manual allows for the step: a time constant of two steps and the largest impedance
(Modeling, "Solver parameters"). The damping ratio is 1, its normal value there, or 30, since a contact that only pushes
leaves 13 percent of the speed of an impact at a ratio of 1. A restitution is stated by the direct form of `solref`, as
in "Restitution", with a stiffness for which an impact takes some thirty steps. Newton's solver works to its last digit.
"""

import math
from collections.abc import Callable
from itertools import pairwise

import mujoco
from scipy.optimize import brentq

from studies.exact_orbits.automaton import Found
from studies.exact_orbits.bodies import bodies_of
from studies.exact_orbits.reader import Case

VERSION = f"MuJoCo {mujoco.__version__}"
# Ways, integrators with damping ratios, with their settings, steps as shares of the time between two samples.
STEPS = (1 / 30, 1 / 100, 1 / 300, 1e-3, 1 / 3000, 1e-4, 1 / 30000)
WAYS = dict.fromkeys(("RK4", "RK4, ratio 30", "implicitfast, ratio 30", "discrete"), STEPS)
HARD = "0.9999 0.9999 0.001 0.5 2"


def damping_of(restitution: float) -> float:
    """The damping ratio of a linear contact that only pushes and leaves this share of the speed."""

    def left(ratio: float) -> float:  # at the first time at which the force vanishes
        root = math.sqrt(1 - ratio**2)
        t = math.atan2(2 * ratio * root, 2 * ratio**2 - 1) / root
        return -math.exp(-ratio * t) * (math.cos(root * t) - ratio / root * math.sin(root * t))

    return brentq(lambda ratio: left(ratio) - restitution, 1e-9, 0.99)


def prepared(case: Case, way: str) -> Callable[[float], Callable[[], Found]] | None:
    """A function of the step that returns the simulation of a case; None where a way is that of another."""
    bodies, (integrator, _, ratio) = bodies_of(case), way.partition(", ratio ")
    ratio = ratio or "1"
    if any(each.inertance for each in bodies.springs):
        raise NotImplementedError("no inerter between trees")
    if bodies.restitution and ratio != "1":
        return None
    start = bodies.start({name: float(x) for name, x in case.at(case["start"]["state"]).items()})
    times = [float(case["start"]["time"]), *(each["time"] for each in case["samples"])]
    names = bodies.joints

    def ready(share: float) -> Callable[[], Found]:
        count, step = round(1 / share), (times[-1] - times[0]) * share / (len(times) - 1)
        if bodies.restitution:
            rate = 1 / (10 * step)
            hard = f'solref="{-(rate**2)!r} {-2 * damping_of(bodies.restitution) * rate!r}"'
        else:
            hard = f'solref="{2 * step!r} {ratio}"'
        text = bodies.model(
            f'integrator="{integrator}" solver="Newton" iterations="100" tolerance="0"', f'{hard} solimp="{HARD}"'
        )
        model = mujoco.MjModel.from_xml_string(text)

        def run() -> Found:
            data, found, warn = mujoco.MjData(model), Found(), mujoco.get_mju_user_warning()
            joints = [model.joint(name) for name in names]
            places, speeds = ([getattr(each, at)[0] for each in joints] for at in ("qposadr", "dofadr"))
            for name, place, speed in zip(names, places, speeds, strict=True):
                data.qpos[place], data.qvel[speed] = start[name]
            mujoco.set_mju_user_warning(lambda text: None)  # in place of a file
            try:
                for i, (a, b) in enumerate(pairwise(times)):
                    model.opt.timestep = (b - a) / count
                    mujoco.mj_step(model, data, nstep=count)
                    values = (dict(zip(names, x.tolist(), strict=True)) for x in (data.qpos[places], data.qvel[speeds]))
                    found.states.append(bodies.state(*values, i))
            finally:
                mujoco.set_mju_user_warning(warn)
            if data.warning.number.any():
                raise ArithmeticError("unstable")
            return found

        return run

    return ready
