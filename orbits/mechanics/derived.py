"""The whole `Model` of a mechanism, derived from its mechanics."""

from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError
from ..laws import Parameters
from ..model import (
    CONTACT_FORCE,
    HOLDING_FORCE,
    LANDED_FORCE,
    LANDED_HOLDING,
    NORMAL_FORCE,
    STEP_LENGTH,
    TANGENTIAL_FORCE,
    Model,
    search_of_steps,
)
from ..running import exclusive
from .carried_weight import carried_weight
from .coordinates import Coordinates
from .elements import Force, Spring, expressions_of, names_in
from .lagrange import mechanics_of
from .linear import Linear, LinearEquations
from .lone_extension import launch_of
from .parts import Parts
from .stepping import refuse_uneven
from .sticking import refuse_places
from .structure import Structure
from .terms import GRAVITY_SHARE, Gravity


class RandomStates(NamedTuple):
    """Where forces are compared."""

    states: int = 4
    same: float = 1e-9  # share of all forces to which sums agree


AT_RANDOM = RandomStates()


@exclusive
@lru_cache(maxsize=64)
def derived_model(structure: Structure) -> Model:
    """The model of a mechanism; raises `InputError` where it is not a mechanism."""
    s, parts = structure, _parts_of(structure)
    mechanics, gap, steps = parts.mechanics, parts.gap, parts.steps
    if mechanics.conservative:
        _needs_odd_tables(s)
    launch = launch_of(mechanics, parts.alone, parts.words["liftoff"], dict(s.rest).get(parts.launched, 0.0))
    linear = Linear.of(mechanics, steps, parts.reactions) if mechanics.gap.height is None else None
    # The motion of one extension alone leads to orbits where nothing damps or drives it. Under gravity that varies it
    # is the motion in the scene of the guess only, so that there is a guess and no reduction.
    moves_alone = launch is not None and launch.reduction and mechanics.conservative and not s.actuators and not steps
    still = launch if moves_alone and not mechanics.gravity.varies else None
    exact: tuple[Any, Any] = (linear.flight, linear.contact) if linear else (None, None)
    if linear and still and parts.alone:  # by the extension in the fewest operations, so with the least rounding
        exact = partial(parts.alone.flight, still.relative), partial(parts.alone.contact, still.relative)
    model = Model(
        name=s.name,
        flight=parts.flight(exact[0]),
        contact=parts.contact(exact[1]),
        launch_unknowns=parts.launch_unknowns,
        **parts.maps(mechanics.conservative and not s.actuators),
        release=launch.relative.release if launch else parts.no_release,
        embed=parts.embed,
        flight_gradient=parts.flight_gradient,
        extension=parts.extension,
        extension_offset=parts.extension_offset,
        gap=lambda p: gap,
        lands=s.gap is not None,
        relative=launch.relative if launch and moves_alone else None,
        separation=parts.separation,
        heights=parts.heights,
        impact_mass=parts.impact_mass,
        impact=parts.impact,
        violations={name: text for name, text in parts.words.items() if name != "liftoff" and text},
        springs=parts.drawn,
        homotopy=GRAVITY_SHARE if mechanics.gravity.varies else None,
        conservative=mechanics.conservative and not s.actuators,
        driven=any(isinstance(element, Force) for element in s.elements),
        hysteretic=parts.hysteretic,
        reduction=still.reduction if still else None,
        tension=parts.tension if parts.counted else None,
        spring_forces=parts.spring_forces(),
        liftoff_slope=launch.liftoff_slope if launch else None,
        search=launch.relative.search if launch and mechanics.conservative else None,
        rest=parts.rest if s.rest else None,
        knees=parts.knees if s.knees else None,
        planar=parts.reactions.planar if parts.reactions else None,
        sticks=tuple(dict(s.sticks)),
        height=parts.height,
        grazes=s.grazes,
        segments=parts.segments,
        sticking=parts.sticking if s.sticks else None,
        weight=carried_weight(mechanics, stepping=steps is not None and not s.sticks),
        fixed=(STEP_LENGTH,) if len(s.sticks) > len(s.anywhere) else (),
    )
    if steps and launch and model.search:
        # Families are counted by turns where mid-flight turns no place over, and by zeros of the extension where it
        # turns all of them.
        usual, counted = launch.relative.search, len({*steps.reversor.signs}) == 1 and steps.reversible
        model = replace(model, search=(lambda p: search_of_steps(model, usual(p), p)) if counted else None)
    return model


@exclusive
@lru_cache(maxsize=64)
def refuse_points(structure: Structure) -> None:
    """Raise `InputError` where a machine stands on two points whose forces do not add up to those of the ground, as its
    masses need them; compared at random places, rates and numbers."""
    contact, rng = derived_model(structure).contact, np.random.default_rng(0)
    driven = any(isinstance(element, Force) for element in structure.elements)  # which may act on one limb alone
    if driven or LANDED_HOLDING not in contact.watch or NORMAL_FORCE not in contact.watch or contact.pieces:
        return
    sums = {NORMAL_FORCE: (CONTACT_FORCE, LANDED_FORCE), TANGENTIAL_FORCE: (HOLDING_FORCE, LANDED_HOLDING)}
    for _ in range(AT_RANDOM.states):
        p = dict(zip(structure.parameters, rng.uniform(0.3, 0.6, len(structure.parameters)), strict=True))
        x = rng.uniform(0.1, 0.5, len(contact.states)).tolist()
        with np.errstate(all="ignore"):
            seen = {name: float(force(x, p, [])) for name, force in contact.watch.items()}
        size = sum(map(abs, seen.values()))
        if np.isfinite(size) and any(
            abs(seen[n] - seen[a] - seen[b]) > AT_RANDOM.same * size for n, (a, b) in sums.items()
        ):
            raise InputError(
                f"the forces on both points of the {structure.name} do not add up to that of the ground: the gap must "
                "be the height of the point that lands, sticks= must state its place along the ground, and no element "
                "may be fixed to the ground"
            )


@exclusive
@lru_cache(maxsize=64)
def derived_launch(structure: Structure) -> str:
    """The coordinate that is launched."""
    return _parts_of(structure).launched


@exclusive
def linear_equations(structure: Structure, p: Parameters) -> LinearEquations:
    """The matrices of a mechanism whose springs are straight lines; raises `InputError` for another."""
    linear = Linear.of(_parts_of(structure).mechanics)
    if linear is None:
        needed = "linear springs along sums of coordinates, quadratic potentials, constant gravity and inertia"
        raise InputError(f"the {structure.name} is not linear: a linear machine needs {needed}")
    return linear.equations(p)


@exclusive
def refuse_uneven_tables(structure: Structure, p: Parameters) -> None:
    """Raise `InputError` for a law in pieces that a step turns into another one."""
    if _needs_odd_tables(structure):
        refuse_uneven(_parts_of(structure).mechanics, p)


@lru_cache(maxsize=64)
def _needs_odd_tables(structure: Structure) -> bool:
    """Whether a step turns motions back where laws in pieces are odd alone, which is decided once for all numbers."""
    parts = _parts_of(structure)
    return bool(parts.steps and parts.steps.reversible and parts.steps.refuse_forces(parts.mechanics))


def _parts_of(structure: Structure) -> "Parts":
    """The parts of a model. All of them but the laws of the springs are built once for structures that differ in these
    alone."""
    springs = [element for element in structure.elements if isinstance(element, Spring)]
    places = iter(range(len(springs)))
    elements = tuple(replace(e, force=next(places)) if isinstance(e, Spring) else e for e in structure.elements)
    laws = [spring.force for spring in springs]
    own = {name for law in laws for name in law.names} - _names_beside_laws(structure)
    names = tuple(name for name in structure.parameters if name not in own)
    return _parts_without_laws(structure._replace(elements=elements, parameters=names)).with_laws(laws)


def _names_beside_laws(s: Structure) -> set[str]:
    """The names that a structure uses in addition to the laws of its springs."""
    expressions = expressions_of(s)
    if any(map(callable, expressions)):
        return set(s.parameters)  # a function may use any of them
    return {name for value in expressions for name in names_in(value)} | {*s.gravity.names, GRAVITY_SHARE}


@lru_cache(maxsize=64)
def _parts_without_laws(s: Structure) -> "Parts":
    c, gravity = Coordinates.of(s.coordinates, s.actuators, s.parameters), Gravity(s.gravity, s.surface_gravity)
    mechanics = mechanics_of(c, s.elements, s.inertia, s.gap, gravity, dict(s.sticks), s.anywhere)
    refuse_places(c, s, mechanics)
    return Parts.of(s, mechanics)
