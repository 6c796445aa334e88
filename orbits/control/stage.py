"""Stages of an optimal control problem: phases passed once, with their inputs, conditions and costs."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import comb
from numbers import Real

import numpy as np

from ..errors import InputError, whole_number
from ..flow import Flow, flow_of
from ..io import fields_in_line
from ..laws import Algebraic, Parameters
from ..model import Phase

# Name of the length of an interval among the parameters of a phase. The apostrophe keeps it apart from identifiers.
INTERVAL_LENGTH = "interval's length"
# Name of the time since the start of the first stage among the parameters of what is said of the end of a stage.
ELAPSED = "elapsed time"
RUNNING_COST = "running cost"  # the last row of a leg, in the unit of the cost
COLUMNS_OF_CONTROL = (
    "time",
    "stage",
    RUNNING_COST,
)  # of its table, in addition to states and inputs, which have other names


@dataclass(frozen=True)
class Input:
    """A control input: a polynomial on each interval of a stage, which may jump between intervals.

    degree : of the polynomial, at least 0
    low, high : bounds of its Bernstein coefficients, numbers or p -> expression. The input lies within them everywhere,
        and for degrees 0 and 1 these bounds are not more restrictive than bounds of its values
    """

    low: float | Callable[[Parameters], Algebraic] = -np.inf
    high: float | Callable[[Parameters], Algebraic] = np.inf
    degree: int = 0

    @property
    def numbers(self) -> tuple[float, float]:
        """The two bounds, -inf and inf where they are expressions."""
        return -np.inf if callable(self.low) else self.low, np.inf if callable(self.high) else self.high


@dataclass(frozen=True, eq=False)
class Stage:
    """A phase passed through once. Its functions are as in `Phase`, with the inputs by name in `p`, and q empty.

    phase : the `Phase`
    intervals : number of intervals, all of the same length
    duration : bounds (low, high) of the duration, the lower one above 0
    inputs : each `Input` by name
    start : (x, before, p) -> expressions that vanish at the start; `before` is the final state of the previous stage,
        for the first stage that of the last
    end : (x, p) -> expressions that vanish at the end; here, in `final` and in `above`, p has the "elapsed time" too,
        since the start of the first stage
    path : functions (x, p, q) -> expression by name, which are not negative along the stage
    running : (x, p, q) -> the rate of the cost
    final : (x, p) -> the cost at the end
    above : (x, p) -> expressions that are not negative at the end

    Stages compare by identity, since the functions compiled for them are stored for the next call. `steer` raises
    `InputError` for a stage with invalid numbers, bounds or functions.

    >>> from orbits.control import Input, Stage
    >>> from orbits.model import Phase
    >>> cart = Phase("cart", ("x", "v"), lambda x, p, q: [x[1], p["f"]])
    >>> Stage(cart, 4, (0.5, 2), {"f": Input(-1, 1)}, end=lambda x, p: [x[0] - 1, x[1]]).coefficient_names
    ('f[0]',)
    """

    phase: Phase
    intervals: int
    duration: tuple[float, float]
    inputs: Mapping[str, Input] = field(default_factory=dict)
    start: Callable[..., Sequence] = lambda x, before, p: []
    end: Callable[..., Sequence] = lambda x, p: []
    path: Mapping[str, Callable] = field(default_factory=dict)
    running: Callable[..., Algebraic] = lambda x, p, q: 0.0
    final: Callable[..., Algebraic] = lambda x, p: 0.0
    above: Callable[..., Sequence] = lambda x, p: []

    def __repr__(self) -> str:
        return fields_in_line(self, "phase", "intervals", "duration")

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Names of the Bernstein coefficients of all inputs, in their order."""
        return tuple(f"{name}[{k}]" for name, control in self.inputs.items() for k in range(control.degree + 1))

    def input_rows(self) -> dict[str, slice]:
        """The rows of each input among the coefficients of all inputs."""
        ends = np.cumsum([control.degree + 1 for control in self.inputs.values()]).tolist()
        return {name: slice(a, b) for name, a, b in zip(self.inputs, [0, *ends], ends, strict=False)}


@lru_cache(maxsize=64)
def interval_phase(stage: Stage) -> Phase:
    """The phase of a stage over one interval, whose time is the elapsed share of the interval. It has two more states,
    a clock with that share and the running cost, and watches the path expressions."""
    size = len(stage.phase.states)

    def with_inputs(x, p):
        clock, named = x[size], dict(p)
        for name, control in stage.inputs.items():
            d = control.degree
            shapes = [comb(d, k) * clock**k * (1 - clock) ** (d - k) for k in range(d + 1)] if d else [1.0]
            named[name] = sum(p[f"{name}[{k}]"] * shape for k, shape in enumerate(shapes))
        return x[:size], named

    def rates(x, p, q):
        states, named = with_inputs(x, p)
        field = [*stage.phase.field(states, named, q)]
        if len(field) != size:
            raise InputError(f"the field of the {stage.phase.name} gives {len(field)} rates for {size} states")
        length = p[INTERVAL_LENGTH]
        return [*(length * rate for rate in field), 1.0, length * stage.running(states, named, q)]

    watch = {name: lambda x, p, q, of=of: of(*with_inputs(x, p), q) for name, of in stage.path.items()}
    states, pieces = (*stage.phase.states, "clock", "cost"), stage.phase.pieces
    pieces = pieces and replace(pieces, coordinate=(*pieces.coordinate, 0.0, 0.0))
    return Phase(stage.phase.name, states, rates, watch, pieces)


def stage_flow(stage: Stage, names: tuple[str, ...]) -> Flow:
    """The flow of `interval_phase`; its parameters are the problem's, the interval's length and the coefficients."""
    return flow_of(interval_phase(stage), (*names, INTERVAL_LENGTH, *stage.coefficient_names))


def check_stage(number: int, stage: Stage, parameters: Collection[str]) -> None:
    """Raise `InputError` for an invalid stage; `parameters` are the names of the problem's parameters."""
    where = f"stage {number} ({stage.phase.name})"
    if check_range(f"{where}: duration", stage.duration)[0] <= 0:
        raise InputError(f"{where}: the shortest duration is {stage.duration[0]:g}; it must be above 0")
    whole_number(f"{where}: intervals", stage.intervals, "intervals")
    for name in (*stage.phase.states, *stage.inputs):
        if name in COLUMNS_OF_CONTROL:
            raise InputError(f"{where}: '{name}' is a column of the motion's table already; rename the state or input")
    for name, control in stage.inputs.items():
        if name in parameters:
            raise InputError(f"{where}: '{name}' is both an input and a parameter; rename one")
        check_range(f"{where}: input '{name}'", control.numbers)
        whole_number(f"{where}: degree of input '{name}'", control.degree, "powers", 0)


def check_range(what: str, bounds: object) -> tuple[float, float]:
    """The two bounds, in order; raises `InputError`."""
    if not isinstance(bounds, tuple | list) or len(bounds) != 2 or not all(isinstance(one, Real) for one in bounds):
        raise InputError(f"{what}: the bounds must be a lowest and a highest number, not {bounds!r}")
    low, high = bounds
    if not low <= high:
        raise InputError(f"{what}: the lower bound {low:g} is above the upper bound {high:g}")
    return low, high
