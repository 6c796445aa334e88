"""Curves of orbits with tuned parameters, along a parameter or along a quantity of the orbits."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..curves import Points
from ..errors import InputError, NoOrbit
from ..model import Machine, check_machine
from ..numerics import solve
from ..periodic import (
    METHOD,
    Orbit,
    absent_quantities,
    check_count,
    errors_of_tuned,
    is_quantity,
    prescribable,
    quantity_names,
    tuned_equations,
    tuned_names,
)
from ..shooting import Shooting, equations_of
from .curve import Curve, check_followed
from .point import Point


class TunedCurve(Curve):
    """The curve of orbits along a parameter, or a quantity that may be prescribed, whose tuned parameters are unknowns;
    its points have their values too.

    x : (n + 1,), a point of the curve, where the changes of the tuned parameters over the span are estimated
    """

    def __init__(self, machine: Machine, along: str, tuned: Sequence[str], span: float, x: np.ndarray):
        self.machine, self.along, self.method, self.span = machine, along, METHOD, span
        self.tuned = tuple(tuned)
        self.equations = self.equations_of_orbits = equations_of_family(machine, METHOD, along, self.tuned)
        self.names = self.equations.parameters
        self.parameters = values_of(machine, self.names)
        self.place = self.names.index(along)
        jacobian, own = self.evaluate(x[None]).jacobian[0], self.equations.own
        changes = solve(jacobian[:, :-1], jacobian[:, -1])[own:] * span
        # The unit of a parameter that passes zero.
        self.least = 0.1 * np.maximum(np.abs(x[own:-1]), np.nan_to_num(np.abs(changes)))

    def bare_size(self, x: np.ndarray) -> np.ndarray:
        own = self.equations_of_orbits.own
        size = super().bare_size(np.concatenate([x[..., :own], x[..., -1:]], axis=-1))
        tuned = np.maximum(np.abs(x[..., own:-1]), self.least)
        return np.concatenate([size[..., :-1], tuned, size[..., -1:]], axis=-1)

    def growth(self, xs: np.ndarray) -> np.ndarray:
        """The sizes (m, t) of the tuned parameters at points (m, n + 1), as multiples of the first ones."""
        return np.abs(xs[:, self.equations.own : -1]) / (10 * self.least)

    def parameters_at(self, xs: np.ndarray) -> np.ndarray:
        return self.equations.with_tuned(xs, super().parameters_at(xs))

    def orbit(self, point: Points) -> Orbit:
        """The whole orbit at a certified point (1), with its tuned parameters but where it does not determine them."""
        orbit = super().orbit(point)
        try:
            errors = errors_of_tuned(*self.solutions(point))
        except NoOrbit:  # such as a run without speed
            return orbit
        return orbit.with_tuned(
            errors, dict.fromkeys(prescribed_along(self.machine, self.along), float(point.values[0]))
        )

    def varied(self, p: np.ndarray) -> dict[str, float]:
        names, places = self.equations.statement.tuned, self.equations.places
        own = super().varied(p) if self.along in self.machine.values else {}
        return {**own, **dict(zip(names, p[places].tolist(), strict=True))}


def prescribed_along(machine: Machine, along: str) -> tuple[str, ...]:
    """The quantities that are prescribed along a family: the one along which it goes, if it is one."""
    return (along,) if is_quantity(machine, along) else ()


def equations_of_family(machine: Machine, method: str, along: str, tuned: tuple[str, ...]) -> Shooting:
    """The equations of the orbits of a family along a name, with tuned parameters if there are any."""
    if tuned:
        return tuned_equations(machine, tuned, prescribed_along(machine, along))
    return equations_of(machine.model, method, tuple(machine.values))


def values_of(machine: Machine, names: Sequence[str]) -> np.ndarray:
    """The values of a machine's parameters of these names, 0 for prescribed quantities."""
    return np.array([machine.values.get(name, 0.0) for name in names])


def checked_tuning(machine: Machine, along: str, tune: Any) -> tuple[str, ...]:
    """The tuned parameters of a family along a name; raises `InputError` where it cannot be followed so."""
    if not isinstance(along, str):
        raise InputError(f"along = {along!r}; it must be the name of a parameter")
    check_machine(machine, "with_values")
    _refuse_along(machine, along)
    if tune is None:
        if is_quantity(machine, along):
            raise InputError(f"'{along}' is a quantity of the orbits: name in tune= the parameter that changes with it")
        check_followed(machine, along)
        if machine.model.sticks:
            check_count(machine, (), ())
        return ()
    tuned = tuned_names(machine, tune)
    if is_quantity(machine, along):
        check_followed(machine, *tuned)
        check_count(machine, tuned, [along])
    else:
        check_followed(machine, along, *tuned)
        if along in tuned:
            raise InputError(f"'{along}' is followed, so it cannot be tuned")
        check_count(machine, tuned, ())
    return tuned


def _refuse_along(machine: Machine, along: str) -> None:
    """Raise `InputError` where a family cannot go along a name, since it names a quantity that gives no equation of
    half an orbit, or that the orbits do not have."""
    if along in machine.values or is_quantity(machine, along):
        return
    if why := absent_quantities(machine.model, machine.values).get(along):
        raise InputError(f"no family goes along '{along}': {why}")
    if along in quantity_names(machine.model, machine.values):
        known = ", ".join(prescribable(machine.model))
        raise InputError(
            f"'{along}' depends on the whole motion and gives no equation of half an orbit: a family with tuned "
            f"parameters can go along {known}; find(machine, tune=..., at={{'{along}': ...}}) finds one orbit"
        )


def curve_at(machine: Machine, along: str, method: str, span: float, tuned: Sequence[str], point: Point) -> Curve:
    """The curve of a machine's orbits along a name, with tuned parameters if there are any, at a point of it."""
    if not tuned:
        return Curve(machine, along, method, span)
    return TunedCurve(machine, along, tuned, span, np.array([*point.u, point.value]))
