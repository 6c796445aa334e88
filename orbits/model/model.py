"""The engine's description of a kind of machine: its phases, and the conditions of a lossless orbit."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np

from ..errors import InputError, NoOrbit
from ..io import fields_in_line
from ..laws import Algebraic, Parameters, Scalars
from ..units import APEX, RISE, Dimension
from .phase import Affine, Phase, weighted_sum
from .planar import NORMAL_FORCE, TANGENTIAL_FORCE, Planar
from .relative import Reduction, Relative
from .state_formula import StateFormula
from .symmetry import Shift, SignedShift

# Two links of the same length with a knee between them: the names of the heights that they join, lower (None for the
# ground) and upper, and the length of each.
Knee: TypeAlias = tuple[str | None, str, float]
# The quantity that the contact of every model watches, which opens where it vanishes.
CONTACT_FORCE = "contact force"
# The quantity that a contact of two points watches besides: the force on the one that has just landed.
LANDED_FORCE = "contact force of the landed point"
# The quantity that a contact with a coordinate that sticks watches besides: the force of the ground along it.
HOLDING_FORCE = "holding force"
# The same on the point that has landed, of a machine that stands on two points and sticks to both.
LANDED_HOLDING = "holding force of the landed point"
# The parameter that says by how much such a coordinate moves on from one contact to the next.
STEP_LENGTH = "step"


@dataclass(frozen=True, eq=False)
class Model:
    """A kind of machine whose plastic contact can be lossless; its functions take the parameters as a mapping `p`.

    A lossless cycle is a flight from the launch set to its image under the reversor, then a contact back to the launch
    set; where there is a `symmetry`, of the machine with other labels, so that another point of it opens next. Energy
    is conserved in each phase; only its gradient is needed, so that the potential need not be known in closed form. The
    unknowns are a mapping `u`: "liftoff" and "alpha" are the value and the speed of the coordinate that is launched,
    and further unknowns of a launch have the names of contact states. The functions gap, separation, impact_mass,
    impact, and the contact force are called for m orbits together, with arrays (m,) in `x` and `p`, and with CasADi's
    expressions; so they must not branch on these values. A speed has the name of its coordinate with an apostrophe. The
    launch, lift-off, the landing and the energy in contact follow from the fields, see the methods.

    flight, contact : the two phases; the contact watches a quantity named "contact force", which vanishes at lift-off,
        and where coordinates stick the "holding force" on each, which does so too.
        Where one point lands and another opens, that is the force on the latter, and the contact also watches the
        force on the former, the "contact force of the landed point", which is its image under the contact's reversor
    launch_unknowns : names of the unknowns of a launch: "liftoff", "alpha", and the contact states except the value and
        the speed of the one coordinate that these two are; contact states without speeds are 0 at lift-off
    reversor : sign of each flight state under time reversal; None where the model has no reversor
    release : (alpha (m,), p) -> extensions (m,) at lift-off with these launch speeds
    liftoff_slope : (u, p) -> derivative of the extension at lift-off by the launch speed; None where it does not depend
        on that
    embed : matrix (n, m) that turns contact states (m,) into flight states (n,)
    flight_gradient : (x, p, q) -> gradient of the energy in flight
    extension : affine function of the flight state whose stationary points count the family
    extension_offset : p -> what has to be added to `extension`, so that it is 0 where the spring is unloaded; None for
        nothing
    gap : p -> height of the contact point above what it lands on, a sum of coordinates of the flight state
    lands : whether there is such a gap. Without one the two phases are the same, and all motions are oscillations
    separation : p -> smallest distance within the machine, which must stay positive, a function of the flight state,
        `Affine` or a `StateFormula`; None where it is not stated
    heights : p -> such functions by name, for plots and rises; first the masses, the upper before the lower. Gap and
        separation are the difference of two of them, or of one and the ground, up to a constant, which may be the size
        of solid parts for the separation
    violations : messages for the four conditions of a motion: the "gap" closes in flight, the contact would have to
        "pull", the "separation" vanishes, the contact does not "end"; where another point lands than opens, also for
        the "landing gap" that closes early in flight, the same in contact, the "standing gap", which is optional, the
        landed point that would have to pull, the "landed pull", and, where that is judged, a standing one that lifts,
        the "stance"
    springs : pairs of names of the heights, lower and upper, between which springs are drawn; None is the ground
    knees : p -> (lower, upper, length) of pairs of such names between which a knee joins two links of this length, in
        the unit of the heights; None where there is none
    impact_mass : (x, p) -> twice the energy that a plastic impact in the flight state x loses, over the square of the
        gap's speed: 1 / (dg M^-1 dg) for an inertia matrix M and the gap's gradient dg; both may vary with x. Where
        coordinates stick, and here and in `impact`, it is that of an impact without speeds of these
    impact : (x, p) -> direction, a list of n, in which an impact changes the flight state x: M^-1 dg on the speeds,
        scaled so that along it the gap's speed changes by 1
    relative : the relative motion under constant gravity, from which guesses of launches follow, with the parameter
        `homotopy` at 0; None where families are searched directly, for which `search` and `release` suffice
    conservative : whether flight and contact conserve the energy
    driven : whether a force may add energy to a machine that is not conservative
    hysteretic : weights (n,) of the rate of the spring with hysteresis in the flight state, None without one; the
        phases have the mean law of such a spring, and simulations and return maps its branches
    homotopy : name of the parameter that leads from the machine of the guess (0) to this one (1); None where they are
        the same
    reduction : the reduced statement that the machine allows; None where there is none
    tension : (x, p, q) -> force of the spring in a flight state; None where it is not stated
    spring_forces : by name, (x, p, q) -> the force of each spring in a flight state
    spring_dimensions : the dimensions of those "forces" that are torques, or whose dimension is not known, by name
    units : p -> `Units` of a machine that is stated in SI, whose parameters are in SI; None for a dimensionless one
    gauge : name of a parameter that only sets the units and changes no motion; None where there is none
    search : p -> `Search`; None for a model whose families are not searched for all of their orbits
    fixed : names of parameters that have one value only
    rest : p -> flight state at rest in contact, with the springs unloaded, from which a simulation counts the energy;
        None where all of its coordinates are 0
    reversor_shift : p -> what the reversor adds to each flight state after it changed the signs; None for nothing
    symmetry : sign of each flight state in the relabelling after a landing, which names the contact that opens next as
        the first one. None where the same contact opens again
    symmetry_shift : p -> what the relabelling adds to each flight state after that; None for nothing
    planar : the ground under a machine whose masses move along it too, whose flight and contact watch the forces of the
        ground; None for other machines
    landing_gap : p -> height of the point that lands, the image of `gap` under the reversor; None where that is `gap`
    feet : names of the point that opens and of the one that lands; empty where they have none
    sticks : names of the coordinates that are at rest in contact besides the gap. Where nothing depends on their
        places, they are 0 there and move on by the parameter "step" from one contact to the next; otherwise their
        places are contact states without speeds, and unknowns of a launch
    height : p -> the height of the contact point where `gap` is a coordinate with which it vanishes; None where it is
        `gap`
    segments : the weights (n,) of the flight states in the angles of limbs, by name
    grazes : whether the reversor turns `gap` over, so that the height vanishes in mid-flight too
    weight : p -> the weight that the contact carries, that of all that rises with the gap while no spring is strained;
        None where that is not known
    sticking : (x, p) -> the directions in which an impact changes the flight state x per unit of speed of each of
        these; the masses (1 + sticks, 1 + sticks) of the speeds of the gap and of these; and the impulses across and
        along the ground per speed of these. None where nothing sticks
    """

    name: str
    flight: Phase
    contact: Phase
    reversor: tuple[int, ...] | None
    release: Callable
    embed: np.ndarray
    flight_gradient: Callable
    extension: Affine
    gap: Callable[[Parameters], Affine]
    separation: Callable
    heights: Callable[[Parameters], Mapping[str, Affine | StateFormula]]
    impact_mass: Callable
    impact: Callable
    violations: Mapping[str, str]
    springs: tuple[tuple[str | None, str], ...]
    relative: Relative | None = None
    launch_unknowns: tuple[str, ...] = ("liftoff", "alpha")
    homotopy: str | None = None
    conservative: bool = True
    reduction: Reduction | None = None
    tension: Callable | None = None
    spring_forces: Mapping[str, Callable] = field(default_factory=dict)
    spring_dimensions: Mapping[str, Dimension] = field(default_factory=dict)
    units: Callable | None = None
    gauge: str | None = None
    search: Callable | None = None
    liftoff_slope: Callable | None = None
    rest: Callable | None = None
    knees: Callable | None = None
    driven: bool = False
    fixed: tuple[str, ...] = ()
    hysteretic: tuple[float, ...] | None = None
    reversor_shift: Shift | None = None
    symmetry: tuple[int, ...] | None = None
    symmetry_shift: Shift | None = None
    landing_gap: Callable[[Parameters], Affine] | None = None
    extension_offset: Callable[[Parameters], Algebraic] | None = None
    planar: Planar | None = None
    feet: tuple[str, ...] = ()
    sticks: tuple[str, ...] = ()
    sticking: Callable | None = None
    weight: Callable = lambda p: None
    lands: bool = True
    height: Callable[[Parameters], StateFormula] | None = None
    grazes: bool = False
    segments: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def __repr__(self) -> str:
        return fields_in_line(self, "name")

    def of_heights(self, p: Parameters) -> dict[str, tuple[Affine | StateFormula, bool]]:
        """The quantities of heights by name: each is the largest value of a height in flight, and is counted from that
        at lift-off where the second entry is true, as of a rise, or else from the ground, as of an apex.

        Heights are those above the ground where a separation is stated, which needs the lengths of the machine.
        """
        known = [RISE, *([APEX] if self.separation(p) is not None else [])]
        heights = [(name.replace(" ", "_"), height) for name, height in self.heights(p).items()]
        return {f"{name}{end}": (height, end == RISE) for end in known for name, height in heights}

    @cached_property
    def _place(self) -> int:
        """The number of the contact state that is "liftoff" at lift-off; the next one is "alpha"."""
        names = self.contact.states
        pairs = enumerate(pairwise(names))
        return next(i for i, (y, v) in pairs if v == f"{y}'" and y not in self.launch_unknowns)

    @cached_property
    def contact_speed(self) -> Affine:
        """The speed of the contact that is the launch speed at lift-off, a function of the contact state."""
        return Affine(tuple(float(i == self._place + 1) for i in range(len(self.contact.states))))

    @cached_property
    def launched(self) -> tuple[str, str]:
        """Names of the flight states that are "liftoff" and "alpha" at lift-off."""
        speed = int(np.flatnonzero(self.embed[:, self._place + 1] == 1.0)[0])
        return self.flight.states[speed - 1], self.flight.states[speed]

    @cached_property
    def _unknown_states(self) -> list[str | None]:
        """The unknown of a launch that each contact state is, None for a state that is 0."""
        own = {self._place: "liftoff", self._place + 1: "alpha"}
        each = enumerate(self.contact.states)
        return [own.get(i, name if name in self.launch_unknowns else None) for i, name in each]

    @property
    def launch_places(self) -> dict[str, int]:
        """The number of the contact state that each unknown of a launch is, by name, in the order of the unknowns."""
        places = {name: i for i, name in enumerate(self._unknown_states) if name}
        return {name: places[name] for name in self.launch_unknowns}

    def _released(self, u: Parameters) -> list[Algebraic]:
        """The contact state at lift-off."""
        return [u[name] if name else 0.0 for name in self._unknown_states]

    @cached_property
    def plain(self) -> bool:
        """Whether time reversal flips all speeds and no place, and the same contact opens again."""
        usual = (None, tuple(-1 if name.endswith("'") else 1 for name in self.flight.states))
        return self.symmetry is None and self.landing_gap is None and self.reversor in usual

    @cached_property
    def reversal(self) -> SignedShift:
        """The reversor R of the flight; raises `InputError` for a model without one."""
        if self.reversor is None:
            raise InputError("half an orbit needs a model with a reversor")
        return SignedShift(self.reversor, self.reversor_shift)

    @cached_property
    def relabelling(self) -> SignedShift:
        """The relabelling S after a landing."""
        return SignedShift(self.symmetry or (1,) * len(self.flight.states), self.symmetry_shift)

    @cached_property
    def contact_reversal(self) -> SignedShift:
        """The reversor Rc = S R of the contact, of contact states; without a reversor, that of a damped machine."""
        if self.reversor is None:
            return SignedShift(tuple(-1 if name.endswith("'") else 1 for name in self.contact.states))
        whole = self.relabelling.after(self.reversal)
        signs = tuple(int(whole.signs[i]) for i in np.abs(self.embed).argmax(0))
        if whole.shift is None:
            return SignedShift(signs)
        own = [next(i for i, row in enumerate(self.embed) if np.array_equal(row, unit)) for unit in np.eye(len(signs))]
        return SignedShift(signs, lambda p: [whole.shifts(p)[i] for i in own])

    @property
    def mirror(self) -> tuple[int, ...]:
        """The sign of each contact state under the contact's reversor."""
        return self.contact_reversal.signs

    @cached_property
    def turns_midway(self) -> bool:
        """Whether the extension is stationary in mid-flight, since the reversor leaves it as it is."""
        weights = self.extension.weights
        return self.reversor is None or weights == tuple(w * s for w, s in zip(weights, self.reversor, strict=True))

    def landing_gap_of(self, p: Parameters) -> Affine:
        """The gap that closes at landing."""
        return (self.landing_gap or self.gap)(p)

    def standing_gap(self, p: Parameters) -> Affine | None:
        """The `landing_gap` as a function of the contact state, which stays open in contact; None where the same gap
        lands that opens, and where it does not move in contact."""
        if self.landing_gap is None:
            return None
        gap = self.landing_gap(p)
        weights = np.array(gap.weights) @ self.embed
        return Affine(tuple(weights.tolist()), gap.offset) if weights.any() else None

    @cached_property
    def changes_contact(self) -> bool:
        """Whether another point lands than opens, so that two stand in contact."""
        return LANDED_FORCE in self.contact.watch

    @property
    def standing_points(self) -> list[tuple[str, str, str, bool]]:
        """The points on which the ground's forces are known: the phase in which each stands, the names of the forces
        across and along the ground, and whether both vanish where the phase begins."""
        if self.planar is None:
            return []
        whole = NORMAL_FORCE, TANGENTIAL_FORCE
        flying = [("flight", *whole, False)] if self.planar.stands else []
        if LANDED_HOLDING not in self.contact.watch:
            return [*flying, ("contact", *whole, bool(self.sticks))]
        # What lands begins without a force, and the image of its motion is that of what opens.
        opens, lands = (CONTACT_FORCE, HOLDING_FORCE), (LANDED_FORCE, LANDED_HOLDING)
        return [*flying, ("contact", *opens, False), ("contact", *lands, True)]

    def share_left(self, x: Scalars, p: Parameters) -> Algebraic:
        """The share rho of the gap's speed that a hand-over leaves at a landing in the flight state x, in the labels
        after it: all rates y' become y' - (1 - rho) g' D, with D the direction of impacts; NaN where it is unknown."""
        if self.planar is None or self.planar.handed_over is None:
            return np.nan
        # A hand-over is linear in the rates: of those in the direction of impacts, whose gap has the speed 1.
        kicks = zip(self.flight.states, x, self.impact(x, p), strict=True)
        kicked = [kick if name.endswith("'") else place for name, place, kick in kicks]
        after = self.planar.handed_over(self.relabelling.inverse.image(kicked, p), p)
        return weighted_sum(self._gap_speed(p), after)

    def _gap_speed(self, p: Parameters) -> list[Algebraic]:
        """The weights (n,) of the gap's speed."""
        weights, states = self.gap(p).weights, self.flight.states
        return [weights[states.index(name[:-1])] if name.endswith("'") else 0.0 for name in states]

    def mid_contact(self, p: Parameters) -> Affine:
        """The function of the contact state that first vanishes in mid-contact where a speed fixes the launch: the
        launched place less its centre where time reversal flips it, else its speed."""
        place = self._place
        if self.mirror[place] > 0:
            return self.contact_speed
        weights = tuple(float(i == place) for i in range(len(self.contact.states)))
        return Affine(weights, -0.5 * self.contact_reversal.shifts(p)[place])

    @cached_property
    def _rows(self) -> list[list[float]]:
        return self.embed.tolist()

    def launch(self, u: Parameters, p: Parameters) -> list[Algebraic]:
        """The flight state (n,) at lift-off with unknowns `u`."""
        released = self._released(u)
        return [weighted_sum(row, released) for row in self._rows]

    def touchdown(self, u: Parameters, p: Parameters) -> list[Algebraic]:
        """The contact state (m,) after a lossless landing: the mirror image of the launch."""
        return self.contact_reversal.image(self._released(u), p)

    def liftoff(self, u: Parameters, p: Parameters, q: Scalars) -> list[Algebraic]:
        """The forces of the contact in a launch, which vanish where sustained contact ends."""
        names = CONTACT_FORCE, *names_of_holding(self.sticks)
        return [self.contact.watch[name](self._released(u), p, q) for name in names]

    def speeds_of_landing(self, x: Scalars, p: Parameters) -> list[Algebraic]:
        """The speeds of the gap and of what sticks in a flight state x, which a landing brings to 0."""
        own = [x[self.flight.states.index(f"{name}'")] for name in self.sticks]
        return [weighted_sum(self._gap_speed(p), x), *own]

    def landed(self, x: Scalars, p: Parameters, restitution: Algebraic = 0.0) -> list[Algebraic]:
        """The flight state after a landing in the flight state x, plastic or with a restitution of the gap, in the
        labels of before."""
        directions = [self.impact(x, p), *(self.sticking(x, p)[0] if self.sticking else ())]
        first, *others = self.speeds_of_landing(x, p)
        speeds = [(1 + restitution) * first, *others]
        return [value - weighted_sum(each, speeds) for value, *each in zip(x, *directions, strict=True)]

    def lost_at(self, x: Scalars, p: Parameters) -> Algebraic:
        """The energy that a plastic landing in the flight state x loses."""
        speeds = self.speeds_of_landing(x, p)
        masses = self.sticking(x, p)[1] if self.sticking else [[self.impact_mass(x, p)]]
        return 0.5 * weighted_sum([weighted_sum(row, speeds) for row in masses], speeds)

    def impulses(self, x: Scalars, p: Parameters) -> list[Algebraic]:
        """The impulses across and along the ground that a plastic landing in the flight state x takes away."""
        masses = self.sticking(x, p)[2] if self.sticking else [[self.impact_mass(x, p)]]
        return [weighted_sum(row, self.speeds_of_landing(x, p)) for row in masses]

    def landing(self, u: Parameters, x: Scalars, p: Parameters) -> list[Algebraic]:
        """The expressions that vanish at a lossless landing in state x: the gap, its speed and its acceleration.

        Where the contact has one coordinate, the last follows from the launched coordinate, whose value is as at
        lift-off. This condition replaces it also where a law is in pieces, as the piece that holds is not known here.
        """
        weights, states, of_speed = self.gap(p).weights, self.flight.states, self._gap_speed(p)
        closed = [weighted_sum(weights, x), weighted_sum(of_speed, x)]
        if self.one_speed or self.flight.pieces:
            return [*closed, x[states.index(self.launched[0])] - u["liftoff"]]
        return [*closed, weighted_sum(of_speed, self.flight.field(x, p, []))]

    def contact_gradient(self, x: Scalars, p: Parameters, q: Scalars) -> list[Algebraic]:
        """The gradient (m,) of the energy in the contact state x, that of the flight on the ground."""
        gradient = self.flight_gradient([weighted_sum(row, x) for row in self._rows], p, q)
        return [weighted_sum(column, gradient) for column in zip(*self._rows, strict=True)]

    def launch_at(self, x: Iterable[float]) -> dict[str, float]:
        """The unknowns of the launch, by name, whose flight state at lift-off is `x`."""
        own = dict(zip(self.flight.states, x, strict=False))
        own |= dict(zip(("liftoff", "alpha"), [own[name] for name in self.launched], strict=True))
        return {name: own[name] for name in self.launch_unknowns}

    def liftoff_extension(self, u: Parameters, p: Parameters) -> Algebraic:
        """The extension at lift-off with unknowns `u`: numbers, arrays (m,) or expressions."""
        return self.extension_of(p).at(self.launch(u, p))

    def extension_of(self, p: Parameters) -> Affine:
        """The extension of a spring with these parameters."""
        if self.extension_offset is None:
            return self.extension
        return replace(self.extension, offset=self.extension.offset + self.extension_offset(p))

    @property
    def is_guessed(self) -> bool:
        """Whether a family has a guess, from which its orbit is solved for; that of machines that step is linear."""
        return self.relative is not None or (not self.plain and self.search is not None)

    @property
    def half_unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns of half an orbit: those of the launch, and half the time of each phase that is shot."""
        return (*self.launch_unknowns, "duration", *(() if self.one_speed else ("contact_duration",)))

    @property
    def one_speed(self) -> bool:
        """Whether its speed alone fixes a launch; in mid-contact `mid_contact` then first vanishes again."""
        return len(self.launch_unknowns) == 2 and not self.sticks

    @property
    def runs(self) -> bool:
        """Whether the parameter "step" moves it on."""
        return STEP_LENGTH in self.fixed

    def height_of(self, p: Parameters) -> Affine | StateFormula:
        """The height of the contact point."""
        return (self.height or self.gap)(p)

    @property
    def moves_on(self) -> bool:
        """Whether each landing takes the machine on along the ground, by a foot that sticks or a next one that is not a
        mirror image of the last."""
        steps = self.planar is not None and not self.plain and min(self.relabelling.signs) > 0
        return bool(self.sticks) or steps


def names_of_holding(sticks: Iterable[str]) -> list[str]:
    """The names of the forces on coordinates that stick: "holding force", of several with the name of each."""
    names = list(sticks)
    return [HOLDING_FORCE] if len(names) == 1 else [f"{HOLDING_FORCE} along {name}" for name in names]


def refuse_hysteresis(model: Model) -> None:
    """Raise `NoOrbit` for a model whose spring has hysteresis: its phases are those of the mean law."""
    if model.hysteretic:
        instead = "`upkeep` of its return map says what keeps it hopping" if model.one_speed else "simulate it"
        raise NoOrbit(
            "a spring with hysteresis loses energy on every hop and has no lossless orbit: "
            f"{instead}, or use its `.mean`, the law midway between its branches"
        )


def refuse_one_way(model: Model) -> None:
    """Raise `NoOrbit` for a model that steps, and whose motions are not turned back."""
    if model.symmetry and model.reversor is None:
        why = model.violations.get("none") or "its motion is not turned back in time"
        raise NoOrbit(f"no lossless step of a {model.name} is found: {why}; it can be simulated by `simulate`")


def refuse_steps(model: Model, what: str) -> None:
    """Raise `InputError` for a model that steps, which `what` does not follow."""
    if not model.plain:
        steps = f"a {model.name} moves on with each landing" if model.sticks else ""
        steps = steps or f"a {model.name} steps from one point of contact to another"
        raise InputError(f"{steps}, but {what} needs a contact that opens where it closed: use `find` and `follow`")


def refuse_forward(model: Model) -> None:
    """Raise `InputError` for a model whose foot sticks, where parameters would be varied and none tuned."""
    if model.sticks:
        raise InputError(
            f"a {model.name} has no orbits near this one unless a parameter is tuned: use "
            "sweep(..., tune=..., at=...), follow(..., tune=...) or optimize(..., tune=..., at=...)"
        )


def reparametrised(model: Model, own: Callable[[Parameters], Parameters], **changes: object) -> Model:
    """A model whose parameters are functions `own`, p -> parameters of the model, of other parameters."""

    def of_own(function: object, data: int = 0) -> Any:
        """A function whose last argument is the parameters, or the last except for the `data` of a piece."""
        if not callable(function):
            return function

        def called(*arguments: Any) -> Any:
            place = len(arguments) - 1 - data
            return function(*arguments[:place], own(arguments[place]), *arguments[place + 1 :])

        return called

    def moved(phase: Phase) -> Phase:
        if pieces := phase.pieces:
            of_pieces = (of_own(function) for function in (pieces.table, pieces.unit, pieces.origin))
            pieces = replace(pieces, **dict(zip(("table", "unit", "origin"), of_pieces, strict=True)))
        watch = {name: of_own(function, 1) for name, function in phase.watch.items()}
        closed_form = of_own(phase.closed_form)
        return replace(phase, field=of_own(phase.field, 1), watch=watch, pieces=pieces, closed_form=closed_form)

    def functions(part: Any) -> dict[str, Any]:
        """The functions of an object, those with the data of a piece among them."""
        each = {one.name: getattr(part, one.name) for one in fields(part)}
        own = {name: value for name, value in each.items() if callable(value) and not isinstance(value, Affine)}
        return {name: of_own(function, int(name in WITH_DATA)) for name, function in own.items()}

    reduction, relative = model.reduction, model.relative
    if reduction:
        arcs = (replace(arc, phase=moved(arc.phase), **functions(arc)) for arc in reduction.statement.arcs)
        statement = replace(reduction.statement, arcs=tuple(arcs))
        changes["reduction"] = replace(reduction, statement=statement, **functions(reduction))
    if relative:
        changes["relative"] = replace(relative, own=own)
    if model.planar:
        changes["planar"] = replace(model.planar, **functions(model.planar))
    phases = {"flight": moved(model.flight), "contact": moved(model.contact)}
    changes["spring_forces"] = {name: of_own(force, 1) for name, force in model.spring_forces.items()}
    return replace(model, **{**functions(model), **phases, **changes})


# The functions whose last argument is the data of a piece, after the parameters.
WITH_DATA = ("flight_gradient", "tension", "guard")
