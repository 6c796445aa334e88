"""What a kind of machine is to the engine: its phases, and what makes a motion of them a lossless orbit."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..io import fields_in_line
from .phase import Affine, Arc, Phase, Statement
from .state_formula import StateFormula

# Two links of the same length with a knee between them: the names of the heights that they join, lower (None for the
# ground) and upper, and the length of each.
Knee: TypeAlias = tuple[str | None, str, float]


class Search(NamedTuple):
    """How to search for all orbits of a family.

    scale : of launch speeds: for a hopper the inverse root of the spring's slope at rest
    spacing, fastest : of the launch speeds where the search begins, and the last of them for family 1, in multiples of
        the scale
    single : whether the laws bend so seldom that the orbit to which the guess leads is taken for the lowest
    pace : the scale of times over that of launch speeds
    by_speed : whether the extension at lift-off depends on the launch speed
    """

    scale: float
    spacing: float
    fastest: float
    single: bool
    pace: float = 1.0
    by_speed: bool = False


@dataclass(frozen=True, eq=False)
class Reduction:
    """A reduced statement of the same orbit, in coordinates in which fewer states are integrated.

    statement : with the unknowns "liftoff" and "alpha", which are also its two states at lift-off, and with one arc,
        the first half flight
    reversor : sign of each of its states under time reversal
    complete : (times (N,), coefficients (N, n, K + 1), u, p) -> Taylor coefficients of all flight states; `u` and `p`
        have one value for each of the N steps
    gap_slope : (times (m,), dz (n, m), p) -> derivatives (m,) of the gap by alpha, from those of the reduced states, dz
    exact : (family, p) -> (u, error of alpha) where the solution is known in closed form, else None
    """

    statement: Statement
    reversor: tuple[int, ...]
    complete: Callable
    gap_slope: Callable
    exact: Callable | None = None


@dataclass(frozen=True, eq=False)
class Model:
    """A kind of machine whose plastic contact can be lossless; its functions take the parameters as a mapping `p`.

    A lossless cycle is a flight from the launch set to its image under the reversor, then a contact back to the launch
    set. Energy is conserved in each phase; only its gradient is needed, so that the potential need not be known in
    closed form. The unknowns are a mapping `u`: "liftoff" and "alpha" are the value and the speed of the coordinate
    that is launched, and further unknowns of a launch have the names of flight states. The functions launch, touchdown,
    gap, separation, impact_mass and impact are called for m orbits at once, with arrays (m,) in `u`, `x` and `p`, and
    with CasADi's expressions; so they must not branch on these values.

    flight, contact : the two phases; the contact watches a quantity named "contact force"
    launch_unknowns, launch : names of the unknowns of a launch; (u, p) -> flight state at lift-off
    liftoff : (u, p, q) -> expression that vanishes where sustained contact ends
    landing : (u, x, p) -> three expressions that vanish at a lossless landing
    reversor : sign of each flight state under time reversal; None where the model has no reversor
    release : (alpha (m,), p) -> extensions (m,) at lift-off with these launch speeds
    liftoff_slope : (u, p) -> derivative of the extension at lift-off by the launch speed; None where it does not depend
        on that
    touchdown : (u, p) -> contact state after a lossless landing
    embed : matrix (n, m) that turns contact states (m,) into flight states (n,)
    flight_gradient, contact_gradient : (x, p, q) -> gradient of the energy in that phase
    extension : affine function of the flight state whose stationary points count the family
    gap : p -> height of the contact point above what it lands on, an affine function of the flight state
    separation : p -> smallest distance within the machine, which must stay positive, a function of the flight state,
        `Affine` or a `StateFormula`; None where it is not stated
    heights : p -> such functions by name, for plots and rises; first the masses, the upper before the lower. Gap and
        separation are the difference of two of them, or of one and the ground, up to a constant, which may be the size
        of solid parts for the separation
    violations : messages for the four conditions of a motion: the "gap" closes in flight, the contact would have to
        "pull", the "separation" vanishes, the contact does not "end"
    springs : pairs of names of the heights, lower and upper, between which springs are drawn; None is the ground
    knees : p -> (lower, upper, length) of pairs of such names between which a knee joins two links of this length, in
        the unit of the heights; None where there is none
    impact_mass : (x, p) -> twice the energy that a plastic impact in the flight state x loses, over the square of the
        gap's speed: 1 / (dg M^-1 dg) for an inertia matrix M and the gap's gradient dg, both of which may vary with x
    impact : (x, p) -> direction, a list of n, in which an impact changes the flight state x: M^-1 dg on the speeds,
        scaled so that along it the gap's speed changes by 1
    contact_speed : the contact coordinate that becomes the launch speed
    guess : (family, p) -> a launch and the "duration" of the half flight, with the parameter `homotopy` at 0; None
        where it follows from `relative`, or where the families are searched at once, for which `search` and `release`
        suffice
    relative : the `Relative` motion under constant gravity, from which a guess follows; None where there is none
    conservative : whether flight and contact conserve the energy
    driven : whether a force may add energy to a machine that is not conservative
    homotopy : name of the parameter that leads from the machine of the guess (0) to this one (1); None where they are
        the same
    reduction : the reduced statement that the machine allows; None where there is none
    tension : (x, p, q) -> force of the spring in a flight state; None where it is not stated
    units : p -> `Units` of a machine that is stated in SI, whose parameters are in SI; None for a dimensionless one
    gauge : name of a parameter that only sets the units and changes no motion; None where there is none
    search : p -> `Search`; None for a model whose families are not searched for all of their orbits
    rest : p -> flight state at rest in contact, with the springs unloaded, from which a simulation counts the energy;
        None where all of its coordinates are 0
    derived : whether the model was derived, so that its parts cannot contradict each other, see `as_derived`; other
        models are checked once before they are used (`orbits.check` checks more)
    """

    name: str
    flight: Phase
    contact: Phase
    launch: Callable
    liftoff: Callable
    landing: Callable
    reversor: tuple[int, ...] | None
    release: Callable
    touchdown: Callable
    embed: np.ndarray
    flight_gradient: Callable
    contact_gradient: Callable
    extension: Affine
    gap: Callable
    separation: Callable
    heights: Callable
    impact_mass: Callable
    impact: Callable
    contact_speed: Affine
    violations: Mapping[str, str]
    springs: tuple[tuple[str | None, str], ...]
    guess: Callable | None = None
    launch_unknowns: tuple[str, ...] = ("liftoff", "alpha")
    homotopy: str | None = None
    conservative: bool = True
    reduction: Reduction | None = None
    tension: Callable | None = None
    units: Callable | None = None
    gauge: str | None = None
    search: Callable | None = None
    relative: Any = None
    liftoff_slope: Callable | None = None
    rest: Callable | None = None
    knees: Callable | None = None
    driven: bool = False
    # What `dataclasses.replace` makes of a model has to be looked at again.
    derived: bool = field(default=False, init=False)

    def __repr__(self) -> str:
        return fields_in_line(self, "name")

    def rises(self, p: Mapping[str, Any]) -> dict[str, Affine | StateFormula]:
        """The heights, by the name of the quantity that says how far each rises above its value at lift-off."""
        return {f"{name.replace(' ', '_')}_rise": height for name, height in self.heights(p).items()}

    @property
    def launched(self) -> tuple[str, str]:
        """Names of the flight states that are "liftoff" and "alpha" at lift-off."""
        place = int(np.flatnonzero(self.contact_speed.weights)[0])
        speed = int(np.flatnonzero(self.embed[:, place] == 1.0)[0])
        return self.flight.states[speed - 1], self.flight.states[speed]

    def launch_at(self, x: Iterable[float]) -> dict[str, float]:
        """The unknowns of the launch, by name, whose flight state at lift-off is `x`."""
        own = dict(zip(self.flight.states, x, strict=False))
        own |= dict(zip(("liftoff", "alpha"), [own[name] for name in self.launched], strict=True))
        return {name: own[name] for name in self.launch_unknowns}

    def liftoff_extension(self, u: Mapping[str, Any], p: Mapping[str, Any]) -> Any:
        """The extension at lift-off with unknowns `u`: numbers, arrays (m,) or expressions."""
        return self.extension.at(self.launch(u, p))

    @property
    def is_guessed(self) -> bool:
        """Whether a family has a guess, from which its orbit is solved for."""
        return bool(self.guess or self.relative)

    @property
    def half_unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns of half an orbit: those of the launch, and half the time of each phase that is shot."""
        return (*self.launch_unknowns, "duration", *(() if self.one_speed else ("contact_duration",)))

    @property
    def one_speed(self) -> bool:
        """Whether its speed alone fixes a launch; that speed then first vanishes again in mid-contact."""
        return len(self.launch_unknowns) == 2


def as_derived(model: Model) -> Model:
    """A model that was just made, marked as `derived`: its fields follow from mechanics, or tests hold them so."""
    object.__setattr__(model, "derived", True)
    return model


def reparametrised(model: Any, own: Callable[[Mapping[str, Any]], Mapping[str, Any]], **changes: Any) -> Any:
    """A model whose parameters are functions `own`, p -> parameters of the model given, of other parameters."""

    def at(place: int, function: Any) -> Any:
        """A function whose argument at this place is the parameters."""
        return function and (lambda *given: function(*given[:place], own(given[place]), *given[place + 1 :]))

    def moved(phase: Phase) -> Phase:
        pieces = phase.pieces and replace(phase.pieces, table=at(0, phase.pieces.table))
        watch = {name: at(1, function) for name, function in phase.watch.items()}
        return replace(
            phase, field=at(1, phase.field), watch=watch, pieces=pieces, closed_form=at(0, phase.closed_form)
        )

    def travelled(arc: Arc, phase: Phase) -> Arc:
        places = {"start": 2, "duration": 1, "conditions": 2, "guard": 2}
        return replace(arc, phase=phase, **{name: at(place, getattr(arc, name)) for name, place in places.items()})

    reduction = model.reduction
    if reduction:
        arcs = tuple(travelled(arc, moved(arc.phase)) for arc in reduction.statement.arcs)
        statement, places = replace(reduction.statement, arcs=arcs), {"complete": 3, "gap_slope": 2, "exact": 1}
        changed = {name: at(place, getattr(reduction, name)) for name, place in places.items()}
        reduction = replace(reduction, statement=statement, **changed)
    functions = {name: at(place, getattr(model, name)) for name, place in PARAMETERS_AT.items()}
    relative = model.relative and replace(model.relative, own=own)
    phases = {"flight": moved(model.flight), "contact": moved(model.contact)}
    found = replace(model, **functions, **phases, reduction=reduction, relative=relative, **changes)
    return as_derived(found) if model.derived else found


# Which argument of a model's functions is the parameters.
PARAMETERS_AT = {
    **dict.fromkeys(("gap", "separation", "heights", "search", "rest", "knees"), 0),
    **dict.fromkeys(("launch", "liftoff", "release", "touchdown", "guess", "impact_mass", "impact"), 1),
    "liftoff_slope": 1,
    **dict.fromkeys(("flight_gradient", "contact_gradient", "tension"), 1),
    "landing": 2,
}
