"""The best design of a machine: parameters and lossless orbit solved together, certified, with what holds the optimum.

What may be asked for are formulas of the words of an orbit's document, and of the machine's parameters. Derivatives of
these by the parameters are exact, and offered on their own.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import InputError, NoOrbit, OrbitsError
from ..io import write_json
from ..model.machine import check_parameters
from ..periodic.find import find
from ..periodic.orbit import Orbit
from ..symbolic import interrupts
from .local import Active, Infeasible, LocalOptimum, Unbounded, local_optimum
from .problem import DesignProblem, Outputs, design_problem, formula_of, free_of, units_of, words_of
from .program import design_point
from .quantities import locate, parts_of, quantity_names

# Starts that are tried, when none are asked for and the first leads to no optimum.
OTHERS = 3


class Nowhere(NoOrbit):
    """No start leads to an optimum."""


@dataclass(frozen=True)
class Start:
    """One of the starts: the parameters it began with, the objective that it led to or the reason why to none."""

    parameters: Mapping[str, float]
    objective: float | None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Design:
    """The best design found; numbers in the machine's units, in SI for a machine stated so.

    machine : with the best parameters
    orbit : its certified lossless orbit
    parameters : their values
    verb, text, objective : "minimise" or "maximise", what, and its value
    quantities : the values of all that the question names
    active : constraints, bounds and demands that hold the optimum where it is
    idle : parameters that nothing asked for depends on; they are as the start had them
    kkt : largest violation of the optimality conditions: the slope of the Lagrangian as a share of the objective over
        each parameter's range, by the implicit function theorem at the certified orbit, and of the constraints
    starts : all that were tried
    seconds : wall time
    pair : both objectives, of a design on a front
    """

    machine: object
    orbit: Orbit
    parameters: Mapping[str, float]
    verb: str
    text: str
    objective: float
    quantities: Mapping[str, float]
    active: tuple[Active, ...]
    idle: tuple[str, ...]
    kkt: float
    starts: tuple[Start, ...]
    seconds: float
    pair: tuple[float, float] | None = None

    def document(self) -> dict:
        """The design as the JSON document of the command line."""
        return {
            "verb": self.verb,
            "objective": {"formula": self.text, "value": self.objective},
            "parameters": dict(self.parameters),
            "quantities": dict(self.quantities),
            "active": [{"text": active.text, "multiplier": active.multiplier} for active in self.active],
            "idle": list(self.idle),
            "kkt": self.kkt,
            "starts": [
                {"parameters": dict(s.parameters), "objective": s.objective, "reason": s.reason} for s in self.starts
            ],
            "units": "SI" if self.orbit.units else "units of the machine",
            "seconds": self.seconds,
            "orbit": self.orbit.document(),
        }

    def __str__(self) -> str:
        lines = [f"{self.verb} {self.text}: {self.objective:.12g}" + (" (SI)" if self.orbit.units else "")]
        lines += [f"  {name:<24}{value:.12g}" for name, value in self.parameters.items()]
        lines += [f"  {name:<24}{value:.12g}" for name, value in self.quantities.items() if name not in self.parameters]
        lines += [f"  {'held by':<24}{a.text}   (gains {a.multiplier:.4g} per unit)" for a in self.active]
        lines += [f"  {'without effect':<24}{name}" for name in self.idle]
        good = sum(start.objective is not None for start in self.starts)
        lines.append(f"  {'optimality':<24}{self.kkt:.1e}")
        lines.append(f"  {'starts':<24}{good} of {len(self.starts)} led to an optimum, {self.seconds:.2f} s")
        lines += [f"  {'a start led to none':<24}{s.reason}" for s in self.starts if s.objective is None]
        return "\n".join([*lines, "", str(self.orbit)])

    def save(self, path) -> Path:
        """Write the document to a JSON file; returns the path."""
        return write_json(self.document(), path, "design")


def optimize(
    machine,
    *,
    minimise: str | None = None,
    maximise: str | None = None,
    over: Mapping[str, tuple[float, float]],
    subject_to: Sequence[str] = (),
    family: int = 1,
    starts: int | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Design:
    """The parameters of a machine whose lossless orbit is best.

    machine : as in `find`; its own parameters are the first start, where they lie within the bounds
    minimise, maximise : one of them, a formula of the orbit's quantities and the machine's parameters
    over : bounds of the parameters to choose
    subject_to : constraints, as "stroke <= 0.25", "loss_coefficient <= 2*alpha", "0.1 <= centre_of_mass_rise <= 0.2"
    starts, seed : how many starts, those after the first from Sobol's sequence; None for one, and others only where
        that leads to no optimum
    progress : called with the share of the way done

    All numbers are in the machine's units, or in SI where the machine was stated in SI; there the parameters of a
    formula in SI are designed in SI. The orbit is always held to be a motion. The optimum is local: the best of those
    that the starts lead to.
    Raises `InputError` for a question that cannot be meant, and `NoOrbit` with the reason when no start leads to an
    optimum: constraints met nowhere near, with what is lacking; an orbit that escapes; a contact that collapses.
    """
    with interrupts.deferred():
        brief = design_problem(machine, minimise, maximise, over, subject_to)
        return searched(machine, brief, family, starts, seed, progress)


def searched(machine, brief: DesignProblem, family: int, starts: int | None, seed: int, progress=None) -> Design:
    """The best that so many starts lead to; for None the first, or others where that leads to none."""
    points = starts_of(machine, brief, 1 if starts is None else starts, seed)
    try:
        return best_from(machine, brief, family, points, progress)
    except Unbounded:
        raise
    except NoOrbit as error:
        if starts is not None:
            raise
        first = error
    try:
        best = best_from(machine, brief, family, starts_of(machine, brief, 1 + OTHERS, seed)[1:], progress)
    except NoOrbit as error:
        raise _worst([first, error]) from None
    return replace(best, starts=(Start(points[0], None, str(first)), *best.starts))


def best_from(machine, brief: DesignProblem, family: int, points: Sequence[Mapping], progress=None) -> Design:
    """The best that starts lead to; a start is parameters by name, with an "orbit" if one is known."""
    began = time.perf_counter()
    ends: list[LocalOptimum | OrbitsError] = []
    tried = []
    for i, point in enumerate(points):
        interrupts.check()
        values = {name: point[name] for name in brief.names}
        try:
            there = machine.with_values(**values)
            end = local_optimum(there, point.get("orbit") or find(there, family), brief)
            tried.append(Start(values, end.objective * brief.sign))
        except InputError:
            raise
        except OrbitsError as error:
            end = error
            tried.append(Start(values, None, str(error)))
        ends.append(end)
        if progress:
            progress((i + 1) / len(points))
    found = [end for end in ends if isinstance(end, LocalOptimum)]
    # That an objective has no bound is concluded from one way of going; an optimum is certified.
    if not found:
        raise _worst([end for end in ends if isinstance(end, OrbitsError)])
    best = min(found, key=lambda end: end.objective)
    return Design(
        machine=best.machine,
        orbit=best.orbit,
        parameters={name: best.machine.values[name] for name in brief.names},
        verb=brief.verb,
        text=brief.text,
        objective=best.objective * brief.sign,
        quantities=best.quantities,
        active=best.active,
        idle=best.idle,
        kkt=best.kkt,
        starts=tuple(tried),
        seconds=time.perf_counter() - began,
    )


def starts_of(machine, brief: DesignProblem, count, seed) -> list[dict]:
    """The machine's own parameters, if they lie within the bounds, and further ones spread between these."""
    for name, value, least in (("starts", count, 1), ("seed", seed, 0)):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
            raise InputError(f"{name} = {value!r}; it is a whole number from {least}")
    low, high = np.array(brief.low), np.array(brief.high)
    own = np.array([machine.values[name] for name in brief.names])
    points = [own if ((low <= own) & (own <= high)).all() else 0.5 * (low + high)]
    if count > 1:
        from scipy.stats import qmc  # it takes longer to import than most designs to solve

        drawn = qmc.Sobol(len(low), seed=seed).random(1 << (int(count) - 2).bit_length() if count > 2 else 1)
        # Bounds that span decades are spread by their logarithm.
        wide = brief.wide
        spread = low + drawn * (high - low)
        safe = np.where(low > 0, low, 1.0)
        points += list(np.where(wide, safe * (np.where(wide, high / safe, 1.0)) ** drawn, spread)[: count - 1])
    return [dict(zip(brief.names, point.tolist(), strict=True)) for point in points]


def _worst(errors: Sequence[OrbitsError]) -> OrbitsError:
    """What to say when no start leads to an optimum: the worst kind first, and of constraints the least broken."""
    for kind in (Unbounded, Infeasible):
        if some := [error for error in errors if isinstance(error, kind)]:
            return min(some, key=lambda error: error.size)
    plain = [error for error in errors if isinstance(error, Nowhere)]
    return plain[0] if plain else Nowhere(f"no start within the bounds leads to an optimum: {errors[0]}")


def quantities(machine, orbit: Orbit, names: Sequence[str] | None = None) -> dict[str, float]:
    """Quantities of a machine's orbit, or formulas of them, by what was asked; all that it has for None.

    In the machine's units, or in SI for a machine stated so. Raises `InputError` for an unknown name.
    """
    names = _owned(machine, orbit, names)
    if not names:
        return {}
    asked = Outputs(tuple(formula_of(name, words_of(machine), "the quantity") for name in names), ())
    values = design_point(machine, orbit, asked, units_of(machine)).values
    return dict(zip(names, values.tolist(), strict=False))


def sensitivities(
    machine, orbit: Orbit | int = 1, names: Sequence[str] | None = None, quantities: Sequence[str] | None = None
) -> dict[str, dict[str, float]]:
    """Exact derivatives d(quantity)/d(parameter), as the parameter changes and the orbit stays lossless.

    orbit : one of the machine's own, or the number of its family
    names : of the parameters, all for None; as in `optimize`
    quantities : of the orbit, or formulas of these; all that it has for None

    By the implicit function theorem on the equations of the orbit, with derivatives from their graph. At a fold of the
    family in a parameter they are infinite. Raises `InputError` for an unknown name or another machine's orbit.
    """
    check_parameters(machine)
    words = words_of(machine)
    if not isinstance(orbit, Orbit):
        orbit = find(machine, orbit)
    if names is None:
        names = free_of(machine)
    elif isinstance(names, str):
        raise InputError(f"the names of parameters are a list: ['{names}']")
    machine.with_values(**{name: machine.values[name] for name in names if name in machine.values})
    check_parameters(machine, *names)
    quantities = _owned(machine, orbit, quantities)
    if not quantities or not names:
        return {quantity: {} for quantity in quantities}
    formulas = tuple(formula_of(name, words, "the quantity") for name in quantities)
    with interrupts.deferred():
        slopes = design_point(machine, orbit, Outputs(formulas, tuple(names)), units_of(machine)).slopes
    return {
        quantity: dict(zip(names, row.tolist(), strict=True)) for quantity, row in zip(quantities, slopes, strict=False)
    }


def _owned(machine, orbit: Orbit, names: Sequence[str] | None) -> Sequence[str]:
    """The names asked for, or all that the orbit has, once it is the machine's own."""
    if dict(orbit.machine) != machine.describe():
        raise InputError(f"the orbit is another machine's: {dict(orbit.machine)}")
    if isinstance(names, str):
        raise InputError(f"quantities are a list: ['{names}']")
    if names is not None:
        return list(names)
    model, p = machine.model, machine.values
    every = quantity_names(model, p)
    return [name for name in every if all(locate(model, orbit, p, part) for part in parts_of(name))]
