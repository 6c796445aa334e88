"""What a machine of two masses is stated by, and what the models of hopper and juggler share.

Under constant gravity the spring's extension moves alone, r'' = -F(r): F is the spring's force plus a constant load (0
for the hopper, the hand's weight 1 for the juggler), and F = 1 at lift-off. The other coordinate is thrown upward at
speed alpha under unit gravity, so half the flight takes the time alpha, and an orbit is a root of r'(alpha) = 0: a
problem in two states (section 8 of the paper, for a linear spring).
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Self, cast

import numpy as np
from numpy.typing import ArrayLike

from orbits.errors import InputError, NoOrbit
from orbits.io import one_line
from orbits.model.closed_form import Oscillator, ThrownOscillator
from orbits.model.model import Guesses, Model, Reduction, Search, as_derived
from orbits.model.phase import Affine, Arc, Phase, Pieces, Statement
from orbits.symbolic.exclusive import exclusive, exclusive_property
from orbits.symbolic.formula import suggest

from .features import (
    NO_FEATURES,
    features,
    features_of_many,
    reaches_of_many,
    unit_of_length,
    units_of_length,
    with_reach,
)
from .gravity import as_gravity
from .launch import FASTEST, Liftoff, lowest_launch_speed, lowest_launch_speeds
from .laws import Key, Law, Parameters, Scalars, coefficient_of_restitution, from_key, number, stated, values_and_slopes
from .springs import as_spring

# Beyond these bounds one of the two masses is lost in rounding, or the lengths of lift-off overflow or vanish.
MASS_RATIOS, STIFFNESSES = (1e-12, 1e12), (1e-12, 1e12)
# Bounds of the spacing of launch speeds where a search for orbits begins, in multiples of their scale. It follows the
# finer of the lengths over which the spring and, passed several times as fast, gravity vary.
SPACINGS, AT_SPEED = (0.02, 0.1), 0.2
# The fastest of them, too, where gravity, a narrow feature or many bends make fast flights long to integrate.
FASTEST_IN_DETAIL = 30.0
# A spring that bends the other way more often may have several orbits in a family; a hardening spring that softens
# first does it three times. So may one that bends there and back within a length below this share of the unit.
MOST_BENDS, UNBENT = 3, 0.4
DAMPERS = ("damping", "drag")
OWN_PARAMETERS = ("mass_ratio", "rest_length", *DAMPERS)


class Stated:
    """A machine that is printed and pickled as it was stated, without the model that is built from that."""

    def __getstate__(self) -> dict[str, Any]:
        """The fields of the machine; its laws are pickled as what they were made from."""
        told = {each.name: getattr(self, each.name) for each in fields(cast(Any, self))}
        return {name: dict(value) if isinstance(value, MappingProxyType) else value for name, value in told.items()}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        self._keep(**state)

    def _keep(self, **checked: Any) -> None:
        """Store fields as they were checked, mappings so that nobody can change them."""
        for name, value in checked.items():
            object.__setattr__(self, name, MappingProxyType(dict(value)) if isinstance(value, Mapping) else value)


class TwoMasses(Stated):
    """What machines of two masses have in common, dimensionless or in SI."""

    rest_length: float | None
    restitution: float
    damping: float
    drag: float

    @property
    def damped(self) -> bool:
        """Whether the machine loses energy otherwise than by impacts."""
        return self.damping > 0 or self.drag > 0

    def _keep_common(self) -> None:
        """Keep length and losses as numbers; raises `InputError` that names what they cannot be."""
        length = self.rest_length if self.rest_length is None else number("rest_length", self.rest_length, low=0)
        self._keep(rest_length=length, restitution=coefficient_of_restitution(self.restitution))
        for name in DAMPERS:
            self._keep(**{name: number(name, getattr(self, name))})
            if getattr(self, name) < 0:
                raise InputError(f"{name} = {getattr(self, name):g} is below 0: it would drive the machine")

    def _described(self: Any, spring: str, laws_in: str) -> dict[str, Any]:
        """The machine as JSON-ready data, with its spring in words."""
        return {
            "machine": self.kind,
            "spring": spring,
            "gravity": self.gravity.text,
            "mass_ratio": self.mass_ratio,
            "rest_length": self.rest_length,
            "restitution": self.restitution,
            **({name: getattr(self, name) for name in DAMPERS} if self.damped else {}),
            "parameters": {name: self.parameters[name] for name in stated(self.parameters)},
            "laws_in": laws_in,
        }


@dataclass(frozen=True, repr=False)
class TwoMassMachine(TwoMasses):
    """Two masses, a spring and gravity, in the units of the machine's module.

    spring : a law of `problems.springs`, a formula of the extension r, a law's name, "table:FILE",
        "potential:FORMULA", or a Python function
    gravity : likewise a law of the height z, as a ratio to gravity at the ground; both are kept as a `Law`
    mass_ratio : M = m2/m1, above 0
    rest_length : of the spring; None for long enough that the masses never meet, which constant gravity allows
    restitution : of the impacts, 0 <= e <= 1; a lossless orbit is the same for every value
    damping : of the damper beside the spring, force over speed, from 0
    drag : force over speed on each mass, against its motion, from 0
    parameters : values of the formulas' other names
    """

    spring: Any = "r"
    gravity: Any = "1"
    mass_ratio: float = 1.0
    rest_length: float | None = None
    restitution: float = 0.0
    damping: float = 0.0
    drag: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)

    kind = ""
    # A machine with units is a `units.MachineInSI`.
    units = None

    @exclusive
    def __post_init__(self) -> None:
        self._keep(mass_ratio=number("mass_ratio", self.mass_ratio, *MASS_RATIOS))
        self._keep_common()
        spring, gravity = self._laws()
        self._keep(spring=spring, gravity=gravity, parameters={**spring.parameters, **gravity.parameters})
        if self.rest_length is None and self.varying_gravity:
            high = "the upper mass is as high as its coordinate and the rest length together"
            raise InputError(f"gravity '{gravity.text}' varies with height, and {high}: give the rest length")

    def _laws(self) -> tuple[Law, Law]:
        """The two laws, each with its own parameters; raises `InputError` for unknown, reserved and ambiguous names."""
        if not isinstance(self.parameters, Mapping):
            raise InputError(f"parameters = {self.parameters!r}; they are a mapping of names to numbers")
        given = {name: number(name, value) for name, value in self.parameters.items()}
        spring, gravity = as_spring(self.spring, given, shared=True), as_gravity(self.gravity, given, shared=True)
        known = {**spring.parameters, **gravity.parameters}
        if taken := [name for name in (*OWN_PARAMETERS, "gravity_share") if name in known or name in given]:
            raise InputError(f"'{taken[0]}' is the machine's own name; call the formula's parameter something else")
        if unknown := [name for name in given if name not in known]:
            raise InputError(f"neither formula has a parameter '{unknown[0]}'{suggest(unknown[0], stated(known))}")
        for name in spring.parameters.keys() & gravity.parameters.keys():
            if spring.parameters[name] != gravity.parameters[name]:
                raise InputError(f"spring and gravity both have a parameter '{name}' with different values; rename one")
        return spring, gravity

    @exclusive_property
    def model(self) -> Model:
        """The phases and orbits of the machine; machines that differ only in numbers share it."""
        return self.build(*self.keys, self.rest_length is not None, self.damped)

    @property
    def varying_gravity(self) -> Key | None:
        """The key of the gravity law, None where gravity is constant."""
        key = self.gravity.key
        return key if key.degree() > 0 else None

    @property
    def keys(self) -> tuple[Key, Key | None]:
        """The keys of the spring and of `varying_gravity`, each with how far an integration step may go along it."""
        spring, gravity = self.spring.key, self.varying_gravity
        p = {**self.parameters, "rest_length": self.rest_length or 0.0}
        return with_reach(spring, spring, p), gravity and with_reach(gravity, spring, p)

    @staticmethod
    def build(spring: Key, gravity: Key | None, has_length: bool, damped: bool) -> Model:
        """The model from the keys of the laws (None: constant gravity), and whether there is a length, a damping."""
        raise NotImplementedError

    @property
    def values(self) -> dict[str, float]:
        """Every parameter of the model by name."""
        values = {"mass_ratio": self.mass_ratio}
        if self.rest_length is not None:
            values["rest_length"] = self.rest_length
        values |= self.parameters
        if self.damped:
            values |= {name: getattr(self, name) for name in DAMPERS}
        if self.model.homotopy:
            values[self.model.homotopy] = 1.0
        return values

    def with_values(self, **values: float) -> Self:
        """The same machine with other values of mass_ratio, rest_length, damping, drag or the formulas' parameters.

        Raises `InputError` for an unknown name.
        """
        own: dict[str, Any] = {name: values.pop(name) for name in OWN_PARAMETERS if name in values}
        return replace(self, parameters={**self.parameters, **values}, **own)

    def __repr__(self) -> str:
        laws = {"spring": self.spring.text, "gravity": self.gravity.text}
        own = {name: self.parameters[name] for name in stated(self.parameters)}
        told = {**laws, **own, **self.__getstate__(), **laws}
        plain = {each.name: each.default for each in fields(self)} | {"spring": None, "parameters": self.parameters}
        shown = {name: value for name, value in told.items() if name not in plain or value != plain[name]}
        return one_line(self, shown)

    def describe(self) -> dict[str, Any]:
        """The machine as JSON-ready data."""
        return self._described(self.spring.text, "units of the machine")


def spring_pieces(key: Key, coordinate: tuple[float, ...]) -> Pieces | None:
    """The smooth pieces of a spring law's key, for a phase whose state gives the extension by these weights."""
    return Pieces(coordinate, *key.pieces, "extension") if key.pieces else None


def spring_reach(key: Key, coordinate: tuple[float, ...]) -> tuple[tuple[tuple[float, ...], float], ...]:
    """How far an integration step may go along the extension, given by these weights, as a phase's `reaches`."""
    return ((coordinate, key.reach),) if key.reach < math.inf else ()


def straight_line(key: Key, p: Mapping[str, float]) -> tuple[float, float]:
    """Stiffness k and zero r0 of a straight-line law k (r - r0) at parameter values `p`."""
    law = from_key(key, p)
    value, slope = law.with_slope(0.0)
    if not STIFFNESSES[0] < slope < STIFFNESSES[1]:
        bounds = f"stiffness lies between {STIFFNESSES[0]:g} and {STIFFNESSES[1]:g}"
        never = "it never reaches a lift-off that can be computed"
        raise InputError(f"spring '{law.text}' has stiffness {slope:g}: {never}; {bounds}")
    return float(slope), -float(value) / float(slope)


def half_angle(family: int) -> float:
    """The root of b = tan b for a family n; the iteration b = n pi + atan(b) contracts to it."""
    b = (family + 0.5) * np.pi
    for _ in range(60):
        b, before = family * np.pi + np.arctan(b), b
        if b == before:
            break
    return float(b)


@lru_cache(maxsize=64)
def relative_phase(spring: Key, load: float) -> Phase:
    """The motion r'' = -(phi(r) + load) of a spring law's key, in closed form where the law is a straight line."""

    def oscillator(p):
        k, zero = straight_line(spring, p)
        return Oscillator(k, zero - load / k)

    def rates(x, p, q):
        return [x[1], -(spring.expression(x[0], p, q) + load)]

    pieces, closed = spring_pieces(spring, (1.0, 0.0)), oscillator if spring.degree() == 1 else None
    return Phase("flight", ("r", "r'"), rates, pieces=pieces, closed_form=closed, reaches=spring_reach(spring, (1.0,)))


def relative_reduction(spring: Key, load: float, complete: Callable, gap_slope: Callable) -> Reduction:
    """The reduction of a machine under constant gravity; `complete` and `gap_slope` as in `Reduction`."""
    phase, force = relative_phase(spring, load), spring.expression

    def exact(family: int, p: Mapping[str, float]) -> tuple[dict[str, float], float]:
        """Eq. (12): b = tan b with alpha = b/sqrt(k)."""
        k, zero = straight_line(spring, p)
        b = half_angle(family)
        alpha = b / np.sqrt(k)
        # The error is the residual of sin b = b cos b through its slope b sin b, and one rounding.
        error = abs((np.sin(b) - b * np.cos(b)) / (b * np.sin(b))) / np.sqrt(k) + np.spacing(alpha)
        return {"liftoff": zero + (1 - load) / k, "alpha": alpha}, float(error)

    arc = Arc(
        phase,
        start=lambda u, before, p: [u["liftoff"], u["alpha"]],
        duration=lambda u, p: u["alpha"],
        conditions=lambda u, x, p: [x[1]],
        guard=lambda u, x, p, q: [force(x[0], p, q) + load - 1],
    )
    statement = Statement("relative", ("liftoff", "alpha"), (arc,), ("alpha",))
    return Reduction(statement, (1, -1), complete, gap_slope, exact if phase.closed_form else None)


class TwoMassEquations:
    """What the functions of a model of two masses are made of; a machine adds its own, see `Model` for their arguments.

    spring, gravity : keys of the laws, None where gravity is constant
    damped : whether there is a damper beside the spring, or drag on the masses
    """

    threshold: Liftoff

    def __init__(self, spring: Key, gravity: Key | None, damped: bool):
        self.spring, self.gravity, self.damped = spring, gravity, damped
        self.force = spring.expression

    def pull(self, z: Any, p: Parameters) -> Any:
        """Gravity ratio at height z; its share over constant gravity is a parameter to follow orbits along."""
        return 1 + p["gravity_share"] * (self.gravity.expression(z, p, []) - 1) if self.gravity else 1.0

    def weight(self, z: Any, p: Parameters) -> Any:
        """Gravity ratio where a mass of coordinate `z` is that is a rest length above its zero."""
        return self.pull(p.get("rest_length", 0.0) + z, p)

    def dampers(self, p: Parameters) -> tuple[Any, Any]:
        """Coefficients of the damper beside the spring and of the drag on each mass."""
        return (p["damping"], p["drag"]) if self.damped else (0.0, 0.0)

    def liftoff_damping(self, p: Parameters) -> Any:
        """Coefficient of the force at lift-off per launch speed."""
        return self.dampers(p)[0]

    def liftoff(self, u: Parameters, p: Parameters, q: Scalars) -> Any:
        return self.force(u["liftoff"], p, q) + self.liftoff_damping(p) * u["alpha"] - (1 - self.threshold.load)

    def release(self, alpha: ArrayLike, p: Parameters) -> np.ndarray:
        return self.threshold.extensions_at(from_key(self.spring, p), self.liftoff_damping(p), alpha)

    def guess(self, family: int, p: dict[str, float]) -> dict[str, float]:
        """Lift-off extension, launch speed and half flight time under constant gravity."""
        if self.damped:
            raise NoOrbit("a damped machine loses energy on every hop: it has no lossless orbit, but a return map")
        law = from_key(self.spring, p)
        extension = self.threshold.extension(law)
        slopes = law.with_slope([extension, law.rest()])[1]
        scale = 1 / np.sqrt(slopes[np.isfinite(slopes)].max())  # a law has a slope at lift-off, if not at rest
        phase, what = relative_phase(self.spring, self.threshold.load), f"spring '{law.text}'"
        alpha = lowest_launch_speed(phase, p, extension, family, scale, what)
        return {"liftoff": extension, "alpha": alpha, "duration": alpha}

    def guesses(self, family: int, p: Mapping[str, np.ndarray]) -> Guesses:
        """`guess` of many machines with parameters (m,) by name, as in `Model`."""
        extension, alpha = np.full((2, len(next(iter(p.values())))), np.nan)
        own, single = np.zeros((2, len(alpha)), bool)
        if self.spring.pieces is None:
            extension = self.threshold.extensions(self.spring, p)
            own, single = self._own_and_single(p)
            own &= np.isfinite(extension)
        refused = dict[int, NoOrbit]()
        if len(rows := np.flatnonzero(own)):
            those = {name: values[rows] for name, values in p.items()}
            alpha[rows], errors = self._launch_speeds(family, those, extension[rows])
            refused = {int(rows[i]): error for i, error in errors.items()}
        found = {"liftoff": extension, "alpha": alpha, "duration": alpha}
        return Guesses(found, own, single, refused)

    def _launch_speeds(
        self, family: int, p: Mapping[str, np.ndarray], extension: np.ndarray
    ) -> tuple[np.ndarray, dict[int, NoOrbit]]:
        """The lowest launch speeds (m,) of machines with extensions (m,) at lift-off, and by index why one has none."""
        _, slopes = values_and_slopes(self.spring, p, np.column_stack([extension, np.zeros(len(extension))]))
        if self.spring.degree() == 1:
            return half_angle(family) / np.sqrt(slopes[:, 0]), {}
        scales = 1 / np.sqrt(np.where(np.isfinite(slopes), slopes, -np.inf).max(axis=1))
        phase, what = relative_phase(self.spring, self.threshold.load), f"spring '{self.spring.text}'"
        return lowest_launch_speeds(phase, p, extension, family, scales, what)

    def _own_and_single(self, p: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Which of many machines (m,) take integration steps as far as this model lets them, and which have no feature
        for which `search` looks for several orbits."""
        units = units_of_length(self.spring, p)
        lengths, bends = features_of_many(self.spring, self.spring, p)
        single = (bends <= MOST_BENDS) & ((bends <= 1) | (lengths >= UNBENT * units))
        own = reaches_of_many(self.spring, lengths, bends, units) == self.spring.reach
        if self.gravity:
            lengths, bends = features_of_many(self.gravity, self.spring, p)
            single &= bends <= 1
            own &= reaches_of_many(self.gravity, lengths, bends, units) == self.gravity.reach
        return own, single

    def search(self, p: Parameters) -> Search:
        """How to search for all orbits of a family."""
        spring, gravity, unit = self.spring, self.gravity, unit_of_length(self.spring, p)
        in_spring, around = features(spring, unit, p), features(gravity, unit, p) if gravity else NO_FEATURES
        finest = min(in_spring.length, AT_SPEED * around.length) / unit
        wavy = in_spring.bends > MOST_BENDS or around.bends > 1
        bump = in_spring.bends > 1 and in_spring.length < UNBENT * unit
        single = not (wavy or bump)
        # Where gravity varies or steps are kept short, the fastest flights would take most of the search's time.
        fastest = FASTEST if single and not gravity and spring.reach == math.inf else FASTEST_IN_DETAIL
        return Search(float(np.sqrt(unit)), float(np.clip(finest, *SPACINGS)), fastest, single)


def two_mass_model(machine: Any, states: tuple[str, ...], extension: Affine, **own: Any) -> Model:
    """The model of a machine's equations; `own` is what only this machine has.

    states : their names, the four in flight before the two in contact
    """
    spring, load, constant = machine.spring, machine.threshold.load, not (machine.gravity or machine.damped)
    reduction = relative_reduction(spring, load, machine.complete, machine.gap_slope) if constant else None
    # The relative motion in closed form, without varying gravity or damping, gives both phases theirs.
    swing: Any = reduction.statement.arcs[0].phase.closed_form if reduction else None
    closed = (lambda p: ThrownOscillator(swing(p), machine.mix(p), machine.apart(p))) if swing else None
    standing, watch = machine.contact_oscillator if swing else None, {"contact force": machine.contact_force}
    in_flight, in_contact = spring_pieces(spring, extension.weights), spring_pieces(spring, (1.0, 0.0))
    fine = machine.gravity and machine.gravity.reach < math.inf
    heights = tuple(((0.0,) * i + (1.0,), machine.gravity.reach) for i in (0, 2)) if fine else ()
    flown, stood = (spring_reach(spring, weights) for weights in (extension.weights, (1.0,)))
    model = Model(
        flight=Phase(
            "flight", states[:4], machine.flight, pieces=in_flight, closed_form=closed, reaches=flown + heights
        ),
        contact=Phase("contact", states[4:], machine.contact, watch, in_contact, standing, stood + heights[:1]),
        liftoff=machine.liftoff,
        reversor=None if machine.damped else (1, -1, 1, -1),
        release=machine.release,
        touchdown=lambda u, p: [u["liftoff"], -u["alpha"]],
        flight_gradient=machine.flight_gradient,
        contact_gradient=machine.contact_gradient,
        extension=extension,
        separation=lambda p: Affine(extension.weights, p["rest_length"]) if "rest_length" in p else None,
        heights=machine.heights,
        contact_speed=Affine((0.0, 1.0)),
        guess=machine.guess,
        guesses=None if machine.damped else machine.guesses,
        homotopy="gravity_share" if machine.gravity else None,
        conservative=not machine.damped,
        reduction=reduction,
        search=None if machine.damped else machine.search,
        **own,
    )
    return as_derived(model)


def thrown(times: np.ndarray, count: int, u: Mapping[str, float]) -> np.ndarray:
    """Coefficients (N, 2, count) of the coordinate thrown up at lift-off and its speed, in steps from `times` (N,)."""
    rows = np.zeros((len(times), 2, count))
    rows[:, 0, 0] = u["liftoff"] + times * (u["alpha"] - times / 2)
    rows[:, 0, 1] = rows[:, 1, 0] = u["alpha"] - times
    rows[:, 0, 2], rows[:, 1, 1] = -0.5, -1.0
    return rows
