"""What a design is asked for: an objective, parameters with bounds, constraints; checked before anything is solved."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError, finite_number
from ..model.machine import check_parameters
from ..model.model import Model, Units
from ..symbolic.formula import Formula, parse, suggest
from .quantities import quantity_names

# Bounds that are nearer together, as a share of their size, are one: rounding in a motion is no less.
NARROWEST = 1e-9
# Bounds whose ratio is so large span decades.
WIDE = 100.0
_RELATION = re.compile(r"<=|>=|==")


@dataclass(frozen=True)
class Constraint:
    """low <= formula <= high, as stated in `text`; one of the bounds may be infinite, or both the same."""

    text: str
    formula: Formula
    low: float
    high: float

    def excess(self, value: float) -> float:
        """By how much a value breaks it; 0 where it holds."""
        return max(self.low - value, value - self.high, 0.0)


@dataclass(frozen=True)
class DesignProblem:
    """A checked question.

    text, formula : of the objective
    sign : 1 to minimise it, -1 to maximise it
    names, low, high : the parameters and their bounds
    """

    text: str
    formula: Formula
    sign: int
    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    constraints: tuple[Constraint, ...]

    @property
    def verb(self) -> str:
        return "minimise" if self.sign > 0 else "maximise"

    @property
    def wide(self) -> np.ndarray:
        """Which parameters' bounds span decades, (k,): their changes count as shares of their values."""
        low, high = np.array(self.low), np.array(self.high)
        return (low > 0) & (high >= WIDE * low)

    def units(self, theta: np.ndarray) -> np.ndarray:
        """What counts as one unit of each parameter at values (k,): the way between its bounds, or its value."""
        return np.where(self.wide, np.abs(theta), np.subtract(self.high, self.low))

    def within(self, theta: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """The bounds within a reach (1 is all the way, or a decade) of values (k,)."""
        factor, step = 1 + 9 * reach, reach * np.subtract(self.high, self.low)
        low = np.where(self.wide, theta / factor, theta - step)
        high = np.where(self.wide, theta * factor, theta + step)
        return np.maximum(self.low, low), np.minimum(self.high, high)


@dataclass(frozen=True)
class Outputs:
    """What is to be expressed of an orbit.

    formulas : of quantities and parameters, the objective first
    over : names of the parameters that vary
    demands : quantities that must be positive on a motion, beside the landing jerk, which must be negative
    """

    formulas: tuple[Formula, ...]
    over: tuple[str, ...]
    demands: tuple[str, ...] = ()

    def words(self, model: Model, p: Mapping) -> list[str]:
        """The quantities in use."""
        used = set(self.demands).union(*(formula.names for formula in self.formulas)) - p.keys()
        return [name for name in quantity_names(model, p) if name in used]


def design_problem(machine, minimise, maximise, over, subject_to) -> DesignProblem:
    """The question in its checked form; raises `InputError` that names what cannot be meant."""
    check_parameters(machine)
    if (minimise is None) == (maximise is None):
        raise InputError("a design minimises or maximises one objective: give one of the two")
    verb = "minimise" if minimise is not None else "maximise"
    text = minimise if minimise is not None else maximise
    words = words_of(machine)
    if not isinstance(text, str):
        raise InputError(f"{verb} = {text!r}; an objective is a formula, text such as 'loss_coefficient'")
    formula = smooth_of(text, words, "the objective")
    if not formula.names:
        raise InputError(f"the objective '{text}' says nothing of the orbit or the machine")
    if isinstance(subject_to, str) or not isinstance(subject_to, Sequence):
        raise InputError(f"subject_to = {subject_to!r}; it is a list of constraints such as 'stroke <= 0.25'")
    names, low, high = _parameter_bounds(machine, over)
    constraints = tuple(constraint_of(text, words) for text in subject_to)
    _agree(constraints)
    equations = [constraint.text for constraint in constraints if constraint.low == constraint.high]
    if len(equations) > len(names):
        raise InputError(
            f"{len(equations)} equations for {len(names)} parameters to design, {', '.join(map(repr, equations))}: "
            "leave out those that follow from others, or design more parameters"
        )
    return DesignProblem(text, formula, 1 if minimise is not None else -1, names, low, high, constraints)


def words_of(machine) -> list[str]:
    """What a formula of a design may use: quantities of the orbit and parameters of the machine."""
    model, p = machine.model, machine.values
    if set(model.launch_unknowns) - {"liftoff", "alpha"}:
        raise InputError(
            f"a {model.name} cannot be designed: its launch has more unknowns than the lift-off extension and the speed"
        )
    quantities = quantity_names(model, p)
    parameters = [name for name in p if name != model.homotopy]
    if both := [name for name in parameters if name in quantities]:
        raise InputError(f"'{both[0]}' is a quantity of the orbit: call the formula's parameter something else")
    return quantities + parameters


def formula_of(text, words: Sequence[str], what: str) -> Formula:
    """A formula of known words; `what` it is, for a complaint."""
    formula = parse(text)
    if unknown := sorted(formula.names - set(words)):
        raise InputError(f"{what} '{text}': unknown quantity '{unknown[0]}'{suggest(unknown[0], words)}")
    return formula


def smooth_of(text, words: Sequence[str], what: str) -> Formula:
    """A formula as `formula_of`, that has second derivatives."""
    formula = formula_of(text, words, what)
    if formula.pieces:
        raise InputError(
            f"{what} '{text}': {formula.pieces[0]} is a law in pieces and cannot be designed with: it has no second "
            "derivatives everywhere; bound it from both sides by constraints instead, or take its square"
        )
    return formula


def constraint_of(text, words: Sequence[str]) -> Constraint:
    """A constraint from a text with one or two relations: 'a <= 1', 'a == b', '0.1 <= a <= 0.2'."""
    if not isinstance(text, str):
        raise InputError(f"a constraint is text such as 'stroke <= 0.25', not {text!r}")
    sides, relations = _RELATION.split(text), _RELATION.findall(text)
    if not relations or len(sides) > 3 or len(relations) != len(sides) - 1:
        raise InputError(f"the constraint '{text}' is not of the form 'stroke <= 0.25': one of <=, >=, ==, or two <=")
    formulas = [smooth_of(side.strip(), words, f"in the constraint '{text}',") for side in sides]
    fixed = [not formula.names for formula in formulas]
    for side, formula, constant in zip(sides, formulas, fixed, strict=True):
        if constant and not np.isfinite(float(formula())):
            raise InputError(f"in the constraint '{text}', '{side.strip()}' is not a finite number")
    if len(sides) == 3:
        if not (fixed[0] and fixed[2]) or len(set(relations)) > 1 or relations[0] == "==":
            raise InputError(f"the constraint '{text}' has two relations: it is of the form '0.1 <= stroke <= 0.25'")
        low, high = (float(formulas[i]()) for i in ((0, 2) if relations[0] == "<=" else (2, 0)))
        middle = formulas[1]
    else:
        left, right = formulas
        if all(fixed):
            raise InputError(f"the constraint '{text}' says nothing of the orbit or the machine")
        if fixed[1]:
            middle, bound, relation = left, float(right()), relations[0]
        elif fixed[0]:
            middle, bound, relation = right, float(left()), {"<=": ">=", ">=": "<="}.get(relations[0], "==")
        else:
            middle, bound, relation = parse(f"({left.text}) - ({right.text})"), 0.0, relations[0]
        low = -np.inf if relation == "<=" else bound
        high = np.inf if relation == ">=" else bound
    if low > high:
        raise InputError(f"the constraint '{text}' can never hold: {low:g} lies above {high:g}")
    return Constraint(text, middle, low, high)


def _parameter_bounds(machine, over) -> tuple[tuple[str, ...], tuple[float, ...], tuple[float, ...]]:
    if not isinstance(over, Mapping) or not over:
        raise InputError("over names the parameters to design with their bounds: over={'beta': (0, 1)}")
    lows, highs = [], []
    free = free_of(machine)
    for name, bounds in over.items():
        if name not in machine.values or name == machine.model.homotopy:
            raise InputError(f"the machine has no parameter '{name}' to design{suggest(str(name), free)}")
        try:
            low, high = bounds
        except (TypeError, ValueError):
            raise InputError(f"over {name} = {bounds!r}; give its bounds, (low, high)") from None
        low, high = (finite_number(f"a bound of {name}", bound) for bound in (low, high))
        if not low < high:
            raise InputError(
                f"the bounds of {name} are in conflict: its lower bound {low:g} is not below the upper, {high:g}"
            )
        if high - low <= NARROWEST * max(abs(low), abs(high)):
            raise InputError(
                f"the bounds of {name}, {low!r} and {high!r}, leave no room: state {name} in the machine instead"
            )
        lows.append(low)
        highs.append(high)
    for values in (lows, highs):
        machine.with_values(**dict(zip(over, values, strict=True)))  # which says what cannot be
    return tuple(over), tuple(lows), tuple(highs)


def free_of(machine) -> list[str]:
    """The parameters that may be varied: in SI a machine's own follow from its masses and lengths."""
    fixed = {machine.model.homotopy} | ({"mass_ratio", "rest_length"} if machine.units else set())
    return [name for name in machine.values if name not in fixed]


def _agree(constraints: Sequence[Constraint]):
    """Raises `InputError` where two constraints bound the same formula from both sides of nothing."""
    for i, one in enumerate(constraints):
        for other in constraints[:i]:
            if one.formula.tree == other.formula.tree and max(one.low, other.low) > min(one.high, other.high):
                raise InputError(
                    f"the constraints '{other.text}' and '{one.text}' are in conflict: no value meets both"
                )


def units_of(machine) -> Units:
    """What a formula's numbers are in: SI where the machine was stated so, else the machine's own units."""
    return machine.units or Units(1.0, 1.0, 1.0)
