"""The number of a design problem that moves: a bound of a constraint or of a parameter, or a further parameter."""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..model import Machine, free_parameters
from ..symbolic import parse, suggest
from .design_problem import Constraint, DesignProblem
from .tuned_machine import tuned_numbers

# The unit of a further parameter is the way that it goes, or this share of its size if that is more: second derivatives
# are differences over small shares of it.
LEAST_WAY = 0.1
LONGEST_WAY = 1e100  # of a bound, in ranges of its parameter, or of a constraint: its square is a number


@dataclass(frozen=True)
class Moving:
    """The number that moves.

    text : the constraint or the bound as stated, or the name of the parameter
    begin, end : its first and last values
    constraint : the index of the constraint, and `sides` whether its lower and its upper bound move; None for no
        constraint
    parameter : the index of the parameter whose bound moves, its lower one for `sides` (True, False); None for none.
        The number of a machine has both
    """

    text: str
    begin: float
    end: float
    constraint: int | None = None
    parameter: int | None = None
    sides: tuple[bool, bool] = (False, False)

    @property
    def label(self) -> str:
        """What stands before the number: "stroke <=" or the name of the parameter."""
        return self.text if self.of_machine else self.text.rsplit(" ", 1)[0]

    @property
    def of_machine(self) -> bool:
        """Whether it is a parameter of the machine."""
        return self.constraint is None and self.parameter is None

    def value(self, s: float) -> float:
        """The number at a share of its way."""
        return (self.end if s else self.begin) if s in (0.0, 1.0) else self.begin + s * (self.end - self.begin)

    def at(self, problem: DesignProblem, value: float) -> DesignProblem:
        """The problem with this value of the number, without that of a parameter of the machine."""
        if self.of_machine or value == self.begin:
            return problem
        if self.constraint is not None:
            old = problem.constraints[self.constraint]
            moved = zip(self.sides, (old.low, old.high), strict=True)
            low, high = (value if moves else bound for moves, bound in moved)
            new = Constraint(_bounded_text(old.formula.text, low, high), old.formula, low, high)
            i = self.constraint
            return replace(problem, constraints=(*problem.constraints[:i], new, *problem.constraints[i + 1 :]))
        bounds = [[*problem.low], [*problem.high]]
        bounds[self.sides.index(True)][self.parameter or 0] = value
        return replace(problem, low=tuple(bounds[0]), high=tuple(bounds[1]))

    def as_bound(self, problem: DesignProblem) -> tuple[DesignProblem, int, int | None]:
        """The problem in which the number is the bound of a constraint, the index of that, and the index of a parameter
        whose own bounds on these sides give way to it, None for none.

        A bound of a parameter is then one of a formula; a further parameter is designed too, by an equation.
        """
        if self.constraint is not None:
            return problem, self.constraint, None
        if self.of_machine:
            least, most = sorted((self.begin, self.end))
            room = max(0.5 * (LEAST_WAY * max(abs(least), abs(most)) - (most - least)), 0.0)
            bounds = (*problem.low, least - room), (*problem.high, most + room)
            problem = replace(problem, names=(*problem.names, self.text), low=bounds[0], high=bounds[1])
        index = -1 if self.parameter is None else self.parameter
        low, high = (self.begin if moves else far for moves, far in zip(self.sides, (-np.inf, np.inf), strict=True))
        further = Constraint(self.text, parse(problem.names[index]), low, high)
        count = len(problem.constraints)
        return replace(problem, constraints=(*problem.constraints, further)), count, index


def _bounded_text(text: str, low: float, high: float) -> str:
    """A constraint in words."""
    if low == high:
        return f"{text} == {low:.9g}"
    below, above = f"{low:.9g} <= " if np.isfinite(low) else "", f" <= {high:.9g}" if np.isfinite(high) else ""
    return f"{text} >= {low:.9g}" if not above else f"{below}{text}{above}"


def moving_number(problem: DesignProblem, machine: Machine, what: str, end: float) -> Moving:
    """The number that a text names: a constraint of a problem, "k <= 5000" for the bound of a designed parameter, or a
    further parameter of the machine; raises `InputError` where it names none.
    """
    plain = lambda text: "".join(str(text).split())  # noqa: E731
    for i, each in enumerate(problem.constraints):
        if plain(what) == plain(each.text):
            finite = np.isfinite([each.low, each.high])
            if each.low < each.high and finite.all():
                raise InputError(f"'{what}' has two bounds: state it as two constraints, one for each, and follow one")
            sides, bound = (bool(finite[0]), bool(finite[1])), each.low if finite[0] else each.high
            if abs(end - bound) > LONGEST_WAY:
                raise InputError(f"to = {end:g}; the bound of a constraint can be moved by at most {LONGEST_WAY:g}")
            return Moving(each.text, bound, end, constraint=i, sides=sides)
    for i, (name, low, high) in enumerate(zip(problem.names, problem.low, problem.high, strict=True)):
        for bound, relation, sides in ((low, ">=", (True, False)), (high, "<=", (False, True))):
            if plain(what) == f"{name}{relation}{bound:g}":
                if not (end < high if sides[0] else end > low):
                    raise InputError(f"'{what}' to {end:g} leaves no room between the bounds {low:g} and {high:g}")
                if abs(end - bound) > LONGEST_WAY * (high - low):
                    raise InputError(f"to = {end:g}; a bound can be moved by at most {LONGEST_WAY:g} times its range")
                return Moving(f"{name} {relation} {bound:g}", bound, end, parameter=i, sides=sides)
        if what == name:
            both = f"'{name} >= {low:g}' or '{name} <= {high:g}'"
            raise InputError(f"'{name}' is a design parameter: follow one of its bounds, {both}, or another parameter")
    if what in tuned_numbers(machine):
        raise InputError(f"'{what}' is tuned: follow a prescribed quantity, or another parameter")
    if what in (names := free_parameters(machine)):
        machine.with_values(**{what: end})  # raises the machine's own error
        return Moving(what, machine.values[what], end, sides=(True, True))
    if isinstance(what, str) and what.isidentifier() and machine.units is not None:
        machine.with_values(**{what: end})  # raises the machine's own error
    known = suggest(what, [*(each.text for each in problem.constraints), *names])
    raise InputError(f"the design has no constraint, bound or parameter '{what}'{known}")
