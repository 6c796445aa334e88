"""Curves of folds in two parameters: where a family's orbits begin to exist."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..errors import InputError, NoOrbit, finite_number
from ..model.machine import Machine
from ..periodic.certified import Solved
from ..periodic.fold_statement import fold_statement
from ..running.exclusive import exclusive
from ..shooting.formulations import columns
from ..shooting.single_shooting import shooting_equations
from .checkpoint import collect_family
from .curve import Curve, CurvePoints, check_followed, machine_at, tuned_at
from .family import Family
from .follow import bounds_of, start_tracer
from .point import Point
from .step_control import Options, StepControl, checked_options

# At a fold the parameter changes by less than this share when the launch speed doubles.
STEEPEST = 1e-3


class _FoldCurve(Curve):
    """The curve of folds; its points are orbits of the machine at values of two parameters."""

    def __init__(self, machine: Machine, along: str, across: str, method: str, span: float):
        super().__init__(machine, across, method, span)
        self.folded = self.names.index(along)
        # The unit of a parameter that passes zero is its first value, or 1 when the first value is zero.
        self.least = 0.1 * abs(self.parameters[self.folded]) or 1.0
        self.equations = shooting_equations(fold_statement(self.equations_of_orbits.statement, along), self.names)

    def parameters_at(self, xs: np.ndarray) -> np.ndarray:
        values = super().parameters_at(xs)
        values[:, self.folded] = xs[:, -2]
        return values

    def size(self, x: np.ndarray) -> np.ndarray:
        """The unknowns as on any curve, their directions for a change of alpha by its size, the folding parameter."""
        n, index = len(names := self.equations_of_orbits.statement.unknowns), names.index("alpha")
        size = super().size(np.concatenate([x[..., :n], x[..., -1:]], axis=-1))
        directions = np.delete(size[..., :-1], index, axis=-1) / size[..., [index]]
        folded = np.maximum(np.abs(x[..., -2:-1]), self.least)
        return np.concatenate([size[..., :-1], directions, folded, size[..., -1:]], axis=-1)

    def varied(self, p: np.ndarray) -> dict[str, float]:
        return {**super().varied(p), self.names[self.folded]: float(p[self.folded])}

    def solutions(self, points: CurvePoints) -> tuple[Solved, np.ndarray]:
        """As on any curve, with the errors measured across the family that folds: along it only the orbit changes."""
        names, xs = self.equations_of_orbits.statement.unknowns, points.xs
        us, ps = xs[:, : len(names)], self.parameters_at(xs)
        evaluation = self.equations_of_orbits.evaluate_all(us, ps, (self.names[self.folded],))
        by_name = dict(zip(self.equations.statement.unknowns, xs.T, strict=False))
        closing = columns([*(1.0 if name == "alpha" else by_name[f"d{name}"] for name in names), 0.0])
        return self._solved(us, ps, evaluation), closing


@exclusive
def follow_fold(
    machine: Machine,
    fold: Point,
    along: str,
    across: str,
    stop: float,
    *,
    at: Sequence[float] = Options.at,
    longest: float = Options.longest,
    most: int = Options.most,
    step_control: StepControl = Options.step_control,
    method: str | None = None,
    output: str | Path | None = None,
) -> Family:
    """Follow the fold of a family in `along` as a second parameter goes to `stop`: a curve in two parameters.

    machine, method : as the family was followed with; method None for the simplest
    fold : the point of a "fold" event of that family
    along, across : names of the parameter that folds, and of the second one
    stop : last value of the parameter `across`
    at, longest, most, step_control, output : as in `follow`

    Returns a `Family` along `across`, whose points have the value of `along` too (`column`); its "fold" events are
    cusps. Raises `InputError` for a piecewise law and for invalid arguments, and `NoOrbit` where `fold` is not a fold.
    Source: the extended system of `fold_statement`.

    >>> from orbits import follow, follow_fold
    >>> from problems import Hopper
    >>> spring = Hopper("r + b*r**3 + d*r**5", rest_length=30.0, parameters={"b": 0.0, "d": 0.0})
    >>> fold = next(event.point for event in follow(spring, "b", -0.02).events if event.kind == "fold")
    >>> folds = follow_fold(spring, fold, "b", "d", 1e-6)
    >>> round(float(folds.column("b")[-1]), 6), folds.end.kind
    (-0.010732, 'reached')
    """
    check_followed(machine, across)
    if along == across:
        raise InputError(f"the fold in '{along}' is followed along another parameter")
    if isinstance(fold, Point) and tuned_at(machine, fold, along):
        raise InputError("folds of families with tuned numbers are located, and not followed")
    machine, method = machine_at(machine, fold, along, method)
    start, stop = machine.values[across], finite_number("stop", stop)
    bounds_of(across, start, stop)
    curve = _FoldCurve(machine, along, across, method, abs(stop - start))
    names, tangent = curve.equations_of_orbits.statement.unknowns, np.array(fold.tangent[:-1])
    alpha = tangent[names.index("alpha")]
    if not abs(fold.tangent[-1]) * fold.u[names.index("alpha")] < STEEPEST * abs(alpha) * max(abs(fold.value), 1e-3):
        raise NoOrbit(f"this point is no fold: {along} changes along its family")
    direction = [d / alpha for name, d in zip(names, tangent, strict=True) if name != "alpha"]
    x = np.array([*fold.u, *direction, fold.value, start])
    options = checked_options(at=at, longest=longest, most=most, step_control=step_control)
    return collect_family(start_tracer(curve, x, start, start, stop, options), output=output)
