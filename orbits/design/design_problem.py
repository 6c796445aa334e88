"""A design problem: an objective, parameters with bounds, constraints; checked before anything is solved."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError, range_of
from ..model import Machine, Model, check_parameters, free_parameters, refuse_forward, refuse_others
from ..numerics import sobol_points
from ..periodic import OF_RUNS, quantity_names, unknown_quantity
from ..symbolic import Formula, parse
from .design_quantities import extremes_of

# Bounds nearer together than this share of their size are refused: rounding of the parameter changes an orbit as much.
NARROWEST = 1e-9
WIDE = 100.0  # bounds whose ratio is at least this span decades, and the parameter is scaled by its value
_RELATION = re.compile(r"<=|>=|==")
_STRICT = re.compile(r"(?<![<>=])([<>=])(?!=)")
_MIRRORED = {"<=": ">=", ">=": "<=", "==": "=="}


@dataclass(frozen=True)
class Constraint:
    """low <= formula <= high, as stated in `text`; one bound may be infinite, and both are equal for an equation."""

    text: str
    formula: Formula
    low: float
    high: float

    def violation(self, value: float) -> float:
        """The amount by which a value of the formula violates the constraint; 0 where it holds."""
        return max(self.low - value, value - self.high, 0.0)


@dataclass(frozen=True)
class DesignProblem:
    """A checked design problem."""

    text: str  # of the objective
    formula: Formula  # of the objective
    sign: int  # 1 to minimise it, -1 to maximise it
    names: tuple[str, ...]  # of the parameters, with the bounds that follow
    low: tuple[float, ...]
    high: tuple[float, ...]
    constraints: tuple[Constraint, ...]

    @property
    def verb(self) -> str:
        """The sense of the optimisation, "minimise" or "maximise"."""
        return "minimise" if self.sign > 0 else "maximise"

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """The formulas of the objective and of the constraints."""
        return self.formula, *(constraint.formula for constraint in self.constraints)

    @property
    def wide(self) -> np.ndarray:
        """Whether each parameter (k,) has bounds that span decades; its changes are then measured as shares of it."""
        low, high = np.array(self.low), np.array(self.high)
        return (low > 0) & (high >= WIDE * low)

    def theta(self, machine: Machine) -> np.ndarray:
        """The values (k,) of the parameters that a machine has."""
        return np.array([machine.values[name] for name in self.names])

    def where(self, machine: Machine) -> str:
        """The values of the parameters that a machine has, for messages."""
        return ", ".join(f"{name} = {machine.values[name]:.6g}" for name in self.names)

    def sampled(self, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """The first points (count, k) of Sobol's sequence in the unit cube, a power of 2, and the values (count, k)
        there; bounds that span decades are sampled by their logarithm."""
        low, high = np.array(self.low), np.array(self.high)
        places = sobol_points(count, len(low), seed)
        positive = np.where(low > 0, low, 1.0)
        ratio = np.where(self.wide, high / positive, 1.0)
        return places, np.where(self.wide, positive * ratio**places, low + places * (high - low))

    def units(self, theta: np.ndarray) -> np.ndarray:
        """The unit of each parameter at values (k,): the distance between its bounds, or its value."""
        return np.where(self.wide, np.abs(theta), np.subtract(self.high, self.low))

    def change(self, theta: np.ndarray, to: np.ndarray) -> np.ndarray:
        """The change (k,) from values to others: of logarithms where bounds span decades, else as shares of ranges."""
        ratio = np.where(self.wide, to, 1.0) / np.where(self.wide, theta, 1.0)
        return np.where(self.wide, np.log(ratio), np.subtract(to, theta) / np.subtract(self.high, self.low))

    def changed(self, theta: np.ndarray, change: np.ndarray) -> np.ndarray:
        """The values (k,) after a `change` (k,)."""
        return theta + self.units(theta) * np.where(self.wide, np.expm1(np.minimum(change, 700.0)), change)


@dataclass(frozen=True)
class Outputs:
    """The outputs to be expressed for an orbit."""

    formulas: tuple[Formula, ...]  # of quantities and parameters, the objective first
    over: tuple[str, ...]  # names of the parameters that vary
    # Quantities that must be positive on a motion, in addition to the landing jerk, which must be negative.
    demands: tuple[str, ...] = ()

    def quantities(self, model: Model, p: Mapping) -> list[str]:
        """The quantities in use."""
        used = set(self.demands).union(*(formula.names for formula in self.formulas))
        return [name for name in quantity_names(model, p) if name in used and (name not in p or name in OF_RUNS)]

    def extremes(self, model: Model, p: Mapping) -> list[str]:
        """The extremes that the quantities in use are made of."""
        return list(dict.fromkeys(extreme for name in self.quantities(model, p) for extreme in extremes_of(name)))


def design_problem(
    machine: Machine, minimise: str | None, maximise: str | None, over: Mapping, subject_to: Sequence[str],
    known: Sequence[str] | None = None,
) -> DesignProblem:  # fmt: skip
    """The checked problem of the arguments of `optimize`, in formulas of `known` names, None for those of all designs;
    raises `InputError` that states the reason."""
    check_parameters(machine)
    if (minimise is None) == (maximise is None):
        raise InputError("a design minimises or maximises one objective: give one of the two")
    verb, text = ("maximise", maximise) if minimise is None else ("minimise", minimise)
    known = formula_names(machine) if known is None else known
    if not isinstance(text, str):
        raise InputError(f"{verb} = {text!r}; it must be a formula, text such as 'loss_coefficient'")
    formula = smooth_formula(text, known, "the objective", machine)
    if not formula.names:
        raise InputError(f"the objective '{text}' must contain a quantity of the orbit or a parameter of the machine")
    if isinstance(subject_to, str) or not isinstance(subject_to, Sequence):
        raise InputError(f"subject_to = {subject_to!r}; it must be a list of constraints such as 'stroke <= 0.25'")
    low, high = _checked_bounds(machine, over)
    constraints = tuple(parse_constraint(text, known, machine) for text in subject_to)
    _check_conflicts(constraints)
    equations = [constraint.text for constraint in constraints if constraint.low == constraint.high]
    if len(equations) > len(over):
        raise InputError(
            f"{len(equations)} equations for {len(over)} parameters to design, {', '.join(map(repr, equations))}: "
            "leave out equations that follow from others, or design more parameters"
        )
    return DesignProblem(text, formula, 1 if maximise is None else -1, tuple(over), low, high, constraints)


def formula_names(machine: Machine) -> list[str]:
    """The names that a formula of a design may use: quantities of the orbit and parameters of the machine."""
    refuse_forward(machine.model)
    return names_along(machine)


def names_along(machine: Machine) -> list[str]:
    """The names that a formula may use along a family, whose parameters may be tuned: as `formula_names`."""
    quantities = quantity_names(machine.model, machine.values)
    parameters = free_parameters(machine)
    if ambiguous := [name for name in parameters if name in quantities]:
        raise InputError(f"'{ambiguous[0]}' is a quantity of the orbit: rename the formula's parameter")
    return quantities + parameters


def known_formula(text: str, known: Collection[str], what: str, machine: Machine) -> Formula:
    """A formula of known names of a machine; `what` it is begins the error message."""
    formula = parse(text)
    if unknown := sorted(formula.names - set(known)):
        why = unknown_quantity(machine.model, machine.values, unknown[0], known)
        raise InputError(f"{what} '{text}': {why}")
    return formula


def smooth_formula(text: str, known: Collection[str], what: str, machine: Machine) -> Formula:
    """A formula of known names that has second derivatives."""
    formula = known_formula(text, known, what, machine)
    if formula.pieces:
        raise InputError(
            f"{what} '{text}': {formula.pieces[0]} cannot be used in a design, since it has no second derivatives "
            "everywhere; bound it from both sides by constraints instead, or take its square"
        )
    return formula


def parse_constraint(text: str, known: Collection[str], machine: Machine) -> Constraint:
    """A constraint from a text with one or two relations: 'a <= 1', 'a == b', '0.1 <= a <= 0.2'."""
    if not isinstance(text, str):
        raise InputError(f"a constraint must be text such as 'stroke <= 0.25', not {text!r}")
    sides, relations = [side.strip() for side in _RELATION.split(text)], _RELATION.findall(text)
    if _STRICT.search(text) or len(relations) not in (1, 2):
        form = "one of <=, >=, ==, or two <="
        if _STRICT.search(text):
            form = f"a range includes its bounds; write '{_STRICT.sub(lambda sign: sign[0] + '=', text)}'"
        raise InputError(f"the constraint '{text}' is not of the form 'stroke <= 0.25': {form}")
    formulas = [smooth_formula(side, known, f"in the constraint '{text}',", machine) for side in sides]
    numbers = [None if formula.names else float(formula()) for formula in formulas]
    if endless := [i for i, number in enumerate(numbers) if number is not None and not np.isfinite(number)]:
        raise InputError(f"in the constraint '{text}', '{sides[endless[0]]}' is not a finite number")
    constraint = Constraint(text, *_bounded(text, formulas, numbers, relations))
    if constraint.low > constraint.high:
        raise InputError(f"the constraint '{text}' can never hold: {constraint.low:g} lies above {constraint.high:g}")
    return constraint


def _bounded(text, formulas, numbers, relations):
    """The formula that a constraint bounds, one of its sides or the difference of its sides, and the bounds."""
    relation, (left, *_, right) = relations[0], numbers
    if len(relations) == 2:
        if left is None or right is None or relations not in (["<=", "<="], [">=", ">="]):
            raise InputError(f"the constraint '{text}' has two relations; write it as '0.1 <= stroke <= 0.25'")
        return (formulas[1], left, right) if relation == "<=" else (formulas[1], right, left)
    if left is not None and right is not None:
        raise InputError(f"the constraint '{text}' must contain a quantity of the orbit or a parameter of the machine")
    if right is not None:
        formula, bound = formulas[0], right
    elif left is not None:
        formula, bound, relation = formulas[1], left, _MIRRORED[relation]
    else:
        formula, bound = parse(f"({formulas[0].text}) - ({formulas[1].text})"), 0.0
    return formula, -np.inf if relation == "<=" else bound, np.inf if relation == ">=" else bound


def _checked_bounds(machine, over):
    """The lower and the upper bounds of the parameters."""
    if not isinstance(over, Mapping) or not over:
        raise InputError("over must name the parameters to design with their bounds, such as over={'beta': (0, 1)}")
    lows, highs = {}, {}
    refuse_others(machine, over, "to design", free_parameters(machine))
    for name, bounds in over.items():
        low, high = range_of(f"over {name}", bounds)
        wrong = f"the bounds of {name}"
        if high - low <= NARROWEST * max(abs(low), abs(high)):
            raise InputError(f"{wrong}, {low!r} and {high!r}, leave no room: state {name} in the machine instead")
        if low > 0 and not np.isfinite(high / low):
            raise InputError(f"{wrong}, {low!r} and {high!r}, span too many decades for double precision: narrow them")
        lows[name], highs[name] = low, high
    for values in (lows, highs):
        machine.with_values(**values)  # raises the machine's own error
    return tuple(lows.values()), tuple(highs.values())


def _check_conflicts(constraints: Sequence[Constraint]) -> None:
    """Raise `InputError` where two constraints on the same formula leave it no value."""
    for i, constraint in enumerate(constraints):
        for other in constraints[:i]:
            apart = max(constraint.low, other.low) > min(constraint.high, other.high)
            if apart and constraint.formula.tree == other.formula.tree:
                both = f"'{other.text}' and '{constraint.text}'"
                raise InputError(f"the constraints {both} are in conflict: no value meets both")
