"""A vector field as an expression graph, one step of its flow as an expression, and the bounds on all steps."""

from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..numerics import Array
from ..symbolic import Reach, has_taylor_series, kinks_of, reaches_of, taylor_coefficients


class TaylorOptions(NamedTuple):
    """The orders of Taylor series in time, and the lengths of steps that are chosen by them."""

    order: int = 28  # high, as it makes few and long steps, and each step costs a fixed amount besides its series
    # Of laws with many pieces, whose steps are as short as their pieces.
    order_on_pieces: int = 16
    many_pieces: int = 32
    # Of a step in equations that other solvers differentiate, at a cost that grows with its square. On a mesh a fifth
    # finer than steps of the order above, whose last terms are below a tenth of rounding, it leaves a few roundings.
    step_order: int = 20
    # Where the series of one sensitivity for each state take more than this, machines of all values share a kernel.
    many_products: int = 25_000
    # The parts of a step where its defect is measured; the last one is its end.
    measured: tuple[float, ...] = (0.25, 0.5, 0.75, 1.0)
    # A step is cut where its piece ends, but to no shorter share of its length: it would be no step.
    shortest_cut: float = 1e-12
    truncation: float = 1e-17  # error of a step relative to the state: a tenth of the rounding error of the sum
    # Relative to the state: a step of a larger one leads beyond what the series can describe. Rounding is far smaller.
    largest_defect: float = 1e-10
    # A bound that a state at rest needs, since its series has no last terms to choose a step by.
    longest_step: float = 1e9
    unbounded: float = 1e30  # no bound is set for a coordinate that may go farther
    shortest_bound: float = 1e-14  # no bound makes a step shorter than this: places and times are rounded to as much
    # Where fewer steps are left of the duration, the last two share it evenly, so that none is tiny.
    shared_steps: float = 1.5
    tried_lengths: int = 8  # lengths of a step on a piece that are tried, each half of the one before
    # Of Newton's method to the end of a piece: it converges quadratically, as the speed changes by less than half.
    steps_to_end: int = 7
    settled_share: float = 1e-9  # a smaller last change of a share is followed by none
    rounded_change: float = 1e-16  # of a coordinate, relative to it
    # Up to this degree the terms of a watched function are bounded together, the others one by one.
    bound_degree: int = 6


TAYLOR = TaylorOptions()


class FlowControl(NamedTuple):
    """Bounds on the steps of a motion, by whatever stepper, and how many of them are taken in one call."""

    shortest_step: float = 1e-15  # a step shorter than this, relative to the time, is a singularity of the vector field
    max_steps: int = 50_000  # steps after which a motion is given up, some seconds, far more than any that ends
    max_calls: int = 10_000  # calls, of one or more steps each, after which a search of motions together ends
    runaway: float = 1e20  # a state with a component larger than this has run away
    singular_step: float = 1e-3  # a state runs away to infinity in longer steps, in shorter ones into a singularity
    look_ahead: int = 12  # steps of one call while a stop is searched for, which are most of an oscillation
    max_block: int = 512  # most steps of one call while an event is sought, which bounds the memory that it takes
    together: int = 4096  # most steps of each of the motions that are followed together for stated times
    rounding: float = 1e-14  # the rest of a duration is dropped when it is less than this share of it
    same_time: float = 1e-15  # times that differ by a smaller share of a duration are one


FLOW_CONTROL = FlowControl()


def rows_used(seeds: Array) -> tuple[int, ...]:
    """The rows of parameter seeds (..., np, columns) that are not zero."""
    return tuple(np.asarray(seeds.any((*range(seeds.ndim - 2), -1))).nonzero()[0].tolist())


@dataclass(frozen=True, eq=False)
class VectorField:
    """A vector field as an SX function (x, p) -> (x', watched quantities), and the two symbols x and p; p are the
    parameters, followed by the data of a smooth piece. `coordinate`, `unit` and `origin` are those of `Pieces`.
    """

    field: ca.Function
    x: ca.SX
    p: ca.SX
    coordinate: tuple[float, ...] = ()
    unit: ca.SX | float = 1.0
    origin: ca.SX | float = 0.0
    data: int = 0
    order: int = TAYLOR.order  # of its Taylor series

    @property
    def size(self) -> int:
        """Number of states n."""
        return self.x.numel()

    @cached_property
    def reaches(self) -> list[Reach]:
        """How far a step may lead along coordinates of the state, as functions of the symbols x and p."""
        return reaches_of(ca.Function("rates", [self.x, self.p], [self.field(self.x, self.p)[0]]), self.x, self.p)

    @cached_property
    def kinks(self) -> ca.SX:
        """What vanishes where a kink of the field is, functions of the symbols x and p."""
        return kinks_of(ca.Function("rates", [self.x, self.p], [self.field(self.x, self.p)[0]]), self.x, self.p)

    @cached_property
    def place(self) -> ca.Function:
        """The coordinate of a state that is compared with breakpoints, a function (x, parameters)."""
        place = ca.dot(ca.DM(self.coordinate), self.x) * self.unit - self.origin
        return ca.Function("place", [self.x, self.p[: self.p.numel() - self.data]], [place])

    @cached_property
    def has_many_products(self) -> bool:
        """Whether the field is smooth and its sensitivities take many products of series."""
        products = self.field.jac_sparsity(0, 0).nnz() * self.size * TAYLOR.order * (TAYLOR.order + 1) // 2
        return not self.coordinate and self.has_series and products > TAYLOR.many_products

    @cached_property
    def drift(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Which states (n,) drift, and the derivatives (n, n) of the rates by them; None without any.

        Only rates of such states depend on them, with constant derivatives whose powers vanish: so does a place along
        the ground in flight, and its speed.
        """
        slopes = ca.jacobian(self.field(self.x, self.p)[0], self.x)
        entries = list(zip(*slopes.sparsity().get_triplet(), ca.vertsplit(ca.SX(slopes.nz[:])), strict=True))
        drifting = np.full(self.size, not self.coordinate)
        others = [j for _, j, slope in entries if not slope.is_constant()]
        while others:
            drifting[others] = False
            others = [j for i, j, _ in entries if drifting[j] and not drifting[i]]
        matrix = np.zeros((self.size, self.size))
        for i, j, slope in entries:
            matrix[i, j] = float(slope) if drifting[j] else 0.0
        some = drifting.any() and not np.linalg.matrix_power(matrix, self.size).any()
        return (drifting, matrix) if some else None

    @cached_property
    def has_series(self) -> bool:
        """Whether every operation of the field has a Taylor series."""
        return has_taylor_series(self.field)

    @cached_property
    def step(self) -> ca.Function:
        """One step of length h, a function (x, h, p) -> x for equations that other solvers differentiate."""
        h = ca.SX.sym("h")
        if not self.has_series:
            return ca.Function("step", [self.x, h, self.p], [runge_kutta_step(self, self.x, h)])
        series = taylor_coefficients(self.field, self.x, self.p, TAYLOR.step_order)
        end = series[: self.size, :] @ symbolic_powers(h, TAYLOR.step_order)
        return ca.Function("step", [self.x, h, self.p], [end])


def symbolic_powers(h: ca.SX, order: int) -> ca.SX:
    """The powers (order + 1,) of a symbol, from 0 on."""
    return ca.vertcat(ca.SX(1), *accumulate([h] * order, lambda power, h: h * power))


def runge_kutta_step(graph: VectorField, x: ca.SX, h: ca.SX) -> ca.SX:
    """The state after one Runge-Kutta step of order 8 and length `h` from `x`."""
    stages, weights = _cooper_verner()
    rates = ca.SX(graph.size, 0)  # of the state, one column for each stage
    for count, row in enumerate(stages):
        place = x + h * (rates @ ca.sparsify(ca.DM(row[:count])))
        rates = ca.horzcat(rates, graph.field(place, graph.p)[0])
    return x + h * (rates @ ca.sparsify(ca.DM(weights)))


def _cooper_verner() -> tuple[np.ndarray, np.ndarray]:
    """Stage matrix (11, 11) and weights (11,) of the explicit order-8 method.

    Cooper and Verner, "Some explicit Runge-Kutta methods of high order", SIAM J. Numer. Anal. 9 (1972).
    """
    s = np.sqrt(21.0)
    a = np.zeros((11, 11))
    a[1, :1] = 1 / 2
    a[2, :2] = 1 / 4, 1 / 4
    a[3, :3] = 1 / 7, -(7 + 3 * s) / 98, (21 + 5 * s) / 49
    a[4, :4] = (11 + s) / 84, 0, (18 + 4 * s) / 63, (21 - s) / 252
    a[5, :5] = (5 + s) / 48, 0, (9 + s) / 36, (-231 + 14 * s) / 360, (63 - 7 * s) / 80
    a[6, :6] = (10 - s) / 42, 0, (-432 + 92 * s) / 315, (633 - 145 * s) / 90, (-504 + 115 * s) / 70, (63 - 13 * s) / 35
    a[7, :7] = 1 / 14, 0, 0, 0, (14 - 3 * s) / 126, (13 - 3 * s) / 63, 1 / 9
    a[8, :8] = 1 / 32, 0, 0, 0, (91 - 21 * s) / 576, 11 / 72, -(385 + 75 * s) / 1152, (63 + 13 * s) / 128
    a[9, [0, 4, 5, 6]] = 1 / 14, 1 / 9, -(733 + 147 * s) / 2205, (515 + 111 * s) / 504
    a[9, 7:9] = -(51 + 11 * s) / 56, (132 + 28 * s) / 245
    a[10, 4:7] = (-42 + 7 * s) / 18, (-18 + 28 * s) / 45, -(273 + 53 * s) / 72
    a[10, 7:10] = (301 + 53 * s) / 72, (28 - 28 * s) / 45, (49 - 7 * s) / 18
    return a, np.array([9, 0, 0, 0, 0, 0, 0, 49, 64, 49, 9]) / 180
