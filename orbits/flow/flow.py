"""The flow map of a phase with exact derivatives, as a piecewise polynomial that is accurate throughout each step.

A phase may state its flow in closed form. Otherwise Taylor series of order 28 of the field's expression graph are used
or, where an operation of the graph has none, Cooper and Verner's Runge-Kutta method of order 8. The error controls the
step size, never the caller. Steps end on the breakpoints of a piecewise field.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ..errors import FlowError
from ..model.phase import Affine, Phase
from ..symbolic import interrupts
from . import zero_crossing
from .breakpoints import StopTest, check_start, describe, integrate
from .dynamics import PhaseDynamics
from .taylor import TaylorStepper
from .trajectory import Trajectory
from .vector_field import TAYLOR_ORDER

# A share of the duration that does not count as a step of its own in closed form, since it is rounding.
STEP_ROUNDING = 1e-12


@lru_cache(maxsize=64)
def flow_of(phase: Phase, parameters: tuple[str, ...]) -> "Flow":
    """The flow of a phase, kept for the next call with the same phase."""
    return Flow(phase, parameters)


class Flow(PhaseDynamics):
    """The flow map of one phase; `parameters` names the entries of the parameter vectors (np,) that it takes."""

    def run(
        self,
        start: ArrayLike,
        p: ArrayLike,
        duration: float = np.inf,
        seeds: np.ndarray | None = None,
        parameter_seeds: np.ndarray | None = None,
        stop: StopTest | None = None,
    ) -> tuple[Trajectory, np.ndarray]:
        """The motion from `start` (n,) for a `duration`, or until `stop` ends it.

        p : parameter vector (np,)
        seeds : derivatives (n, columns) of the start with respect to whatever the caller varies
        parameter_seeds : derivatives (np, columns) of the parameters with respect to the same
        stop : (coefficients (m, rows, K + 1), steps (m,)) -> (step, time in it) to stop at, or None

        Returns the motion and the derivatives (n, columns) of its end at fixed duration, without columns where there
        are no seeds. Raises `FlowError` when the motion blows up, leaves the range of a piecewise field or is not a
        number.
        """
        x, p = np.array(start, dtype=float), np.asarray(p, dtype=float)
        if self.phase.closed_form and (parameter_seeds is None or not parameter_seeds.any()):
            return self._run_in_closed_form(x, p, duration, seeds, stop)
        return integrate(self, x, p, duration, seeds, parameter_seeds, stop)

    def _run_in_closed_form(self, start, p, duration: float, seeds, stop: StopTest | None):
        """Polynomials of the exact flow, each from the exact state at its start, so that no error accumulates."""
        check_start(self, start, p, duration)
        form = self._closed_form(p)
        control, step = self.control, 1.0 / np.sqrt(form.square)  # The series has long converged at this step.
        count = int(np.clip(np.ceil(duration / step * (1 - STEP_ROUNDING)), 1, control.max_steps))
        block = control.look_ahead if stop else count
        blocks, halt, end = [], None, duration
        for first in range(0, count, block):
            interrupts.check()
            times = step * np.arange(first, min(first + block, count))
            c = form.series(form.state(start, times), TAYLOR_ORDER)
            if stop and (halt := stop(c, np.minimum(step, duration - times))):
                c, end = c[: halt[0] + 1], times[halt[0]] + halt[1]
            blocks.append(c)
            if halt:
                break
        if not halt and count * step < duration * (1 - STEP_ROUNDING):
            raise FlowError(f"the {self.phase.name} takes too many steps, at {describe(self, start)}")
        c = np.concatenate(blocks)
        times = np.append(step * np.arange(len(c)), end)
        variations = np.zeros((self.size, 0)) if seeds is None else form.transition(end) @ seeds
        return Trajectory(times, c, (*self.phase.states, *form.watch)), variations

    def _closed_form(self, p: np.ndarray):
        """The exact flow at parameters (np,)."""
        assert self.phase.closed_form is not None
        return self.phase.closed_form(dict(zip(self.parameters, p, strict=True)))

    until_zero = zero_crossing.until_zero

    def first_zeros(
        self,
        starts: ArrayLike,
        p: np.ndarray,
        quantity: Affine,
        limit: ArrayLike,
        skip: ArrayLike = 0,
        rising: bool = False,
        over: tuple[Affine, int] | None = None,
    ) -> tuple[np.ndarray, np.ndarray, dict[int, FlowError]]:
        """When an affine function of the rows first changes its sign on motions from states (m, n), and where.

        p : parameters (np,) of all
        limit : times (m,) by which that must happen
        skip : orders (m,) of the zeros at the start, which are divided out exactly
        rising : count only changes from minus to plus
        over : another affine function and a number: a motion on which that function has changed its sign so often
            never has the zero. It is only used for motions that take Taylor steps together.

        Returns times (m,), NaN where it does not happen in time and infinity where it never will; the rows (m, rows)
        at these times; and by index the `FlowError` of each motion that breaks off before.
        """
        starts = np.asarray(starts, dtype=float)
        skip, limit = (np.broadcast_to(values, len(starts)) for values in (skip, limit))
        search = zero_crossing.ZeroSearch(self, starts, p, quantity, limit, skip, rising, over)
        if self.phase.closed_form:
            search.in_closed_form(self._closed_form(p))
        elif isinstance(stepper := self.stepper(0), TaylorStepper):
            search.by_taylor_steps(stepper)
        else:
            search.one_by_one(np.arange(len(starts)), starts, np.zeros(len(starts)))
        return search.times, search.rows, search.failed
