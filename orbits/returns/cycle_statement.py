"""Hops that repeat themselves as boundary value statements: their equations, and those of their bifurcations.

A cycle of hops with known numbers of impacts is a sequence of arcs: in each hop one flight up to each of its impacts,
after all of which but the last the machine leaves at once, and a contact. Where a parameter is a further unknown there
is one equation more: at a flip or a fold the multiplier is -1 or 1, and at a border a hop is about to have another
number of impacts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ..laws.law import Algebraic, Parameters, Scalars
from ..model.model import CONTACT_FORCE, Model
from ..model.phase import Arc, Phase, Statement
from ..periodic.fold_statement import fold_statement
from ..units import LIFTOFF_SPEED
from .hops_along import INJECT
from .periodic_launch import MULTIPLIER_AT

LEAVES_OR_STAYS, GRAZES, LOSSLESS = "leaves", "grazes", "lossless"  # the kinds of borders


@dataclass(frozen=True)
class Border:
    """Where a hop is about to have another number of impacts.

    hop, impact : the indices of the hop in the cycle and of the impact in the hop
    kind : "leaves" (after the impact the contact force vanishes, between a bounce and sustained contact), "grazes" (the
        foot grazes the ground in the flight before that impact), or "lossless" (the hop is a lossless one, which has a
        bounce on one side)
    """

    hop: int
    impact: int
    kind: str = LEAVES_OR_STAYS

    def in_words(self) -> str:
        if self.kind == LOSSLESS:
            return f"hop {self.hop + 1} is lossless"
        if self.kind == GRAZES:
            return f"the foot grazes the ground before impact {self.impact + 1} of hop {self.hop + 1}"
        return f"the contact force vanishes after impact {self.impact + 1} of hop {self.hop + 1}"


def names_of(name: str, hop: int) -> str:
    """The name of an unknown in a hop; in the first it is the name itself."""
    return f"{name}_{hop + 1}" if hop else name


def pressing(model: Model, x: Scalars, p: Parameters) -> Algebraic:
    """The contact force after a plastic impact in the flight state x."""
    return force_in_contact(model, contact_state(model, model.landed(x, p)), p)


def force_in_contact(model: Model, x: Scalars, p: Parameters) -> Algebraic:
    """The contact force in the contact state x."""
    return model.contact.watch[CONTACT_FORCE](x, p, model.contact.data(x, p))


def contact_state(model: Model, x: Scalars) -> list[Algebraic]:
    """The contact state that a flight state with closed gap is: some of its entries."""
    units = np.eye(model.embed.shape[1]).tolist()
    return [x[model.embed.tolist().index(unit)] for unit in units]


def gap_speed(model: Model, x: Scalars, p: Parameters) -> Algebraic:
    """The speed of the gap in the flight state x."""
    return model.speeds_of_landing(x, p)[0]


@lru_cache(maxsize=64)
def cycle_statement(model: Model, impacts: tuple[int, ...], border: Border | None = None) -> Statement:
    """The statement of a cycle of hops with these numbers of impacts, of a model whose launch is a speed.

    The unknowns are the extension and the speed of each launch, and the times of all flights and contacts. With a
    `border` there is one condition more than unknowns, so that a parameter has to be another unknown.
    """
    unknowns, durations, arcs = list[str](), list[str](), list[Arc]()
    for hop, count in enumerate(impacts):
        own = [names_of(name, hop) for name in ("liftoff", "alpha")]
        following = names_of("alpha", (hop + 1) % len(impacts))
        unknowns += own
        here = border if border and border.hop == hop else None
        if here and here.kind == LOSSLESS:
            durations.append(names_of("half_flight", hop))
            arcs.append(_lossless_hop(model, own, following, durations[-1]))
            continue
        times = [names_of(f"flight_{i + 1}", hop) for i in range(count)]
        if here and here.kind == GRAZES:
            times.insert(here.impact, names_of("graze", hop))
        durations += [*times, names_of("contact", hop)]
        for i, time in enumerate(times):
            ends = here if here and here.impact == i else None
            arcs.append(
                _flight_of_hop(model, own if i == 0 else None, time, ends, i > 0 and times[i - 1].startswith("graze"))
            )
        arcs.append(_contact(model, following, durations[-1]))
    return Statement("cycle of hops", (*unknowns, *durations), tuple(arcs), tuple(durations))


def _flight_of_hop(model: Model, launch: Sequence[str] | None, time: str, border: Border | None, flies_on: bool) -> Arc:
    """A flight up to the ground: from a launch with unknowns of these names, else from an impact, or without one where
    the machine `flies_on` after a graze."""

    def start(u: Parameters, before: Scalars, p: Parameters) -> list[Algebraic]:
        if launch:
            return model.launch(_launch_of(u, launch), p)
        return list(before) if flies_on else model.landed(before, p)

    def conditions(u: Parameters, x: Scalars, p: Parameters) -> list[Algebraic]:
        closed = [model.gap(p).at(x)]
        if border is None:
            return closed
        return [*closed, gap_speed(model, x, p) if border.kind == GRAZES else pressing(model, x, p)]

    guard = (lambda u, x, p, q: model.liftoff(_launch_of(u, launch), p, q)) if launch else (lambda u, x, p, q: [])
    return Arc(_without_closed_form(model.flight), start, lambda u, p: u[time], conditions, guard)


def _launch_of(u: Parameters, names: Sequence[str]) -> dict[str, Algebraic]:
    """The unknowns of a launch by the names that the model has for them."""
    return dict(zip(("liftoff", "alpha"), (u[name] for name in names), strict=True))


def _lossless_hop(model: Model, launch: Sequence[str], following: str, time: str) -> Arc:
    """Half the flight of a lossless hop, after which the next launch is faster by the injection alone."""

    def conditions(u: Parameters, x: Scalars, p: Parameters) -> list[Algebraic]:
        return [*model.reversal.fixed(x, p), u[launch[1]] + injected_speed(model, p) - u[following]]

    return Arc(
        _without_closed_form(model.flight),
        start=lambda u, before, p: model.launch(_launch_of(u, launch), p),
        duration=lambda u, p: u[time],
        conditions=conditions,
        guard=lambda u, x, p, q: model.liftoff(_launch_of(u, launch), p, q),
    )


def injected_speed(model: Model, p: Parameters) -> Algebraic:
    """What is added to the speed of a launch, without units."""
    return p[INJECT] / (model.units(p).of(LIFTOFF_SPEED) if model.units else 1.0)


def _contact(model: Model, following: str, time: str) -> Arc:
    """A contact after an impact, up to the launch whose speed has this name."""

    def start(u: Parameters, before: Scalars, p: Parameters) -> list[Algebraic]:
        return contact_state(model, model.landed(before, p))

    def conditions(u: Parameters, x: Scalars, p: Parameters) -> list[Algebraic]:
        return [force_in_contact(model, x, p), model.contact_speed.at(x) + injected_speed(model, p) - u[following]]

    return Arc(_without_closed_form(model.contact), start, lambda u, p: u[time], conditions)


@lru_cache(maxsize=64)
def _without_closed_form(phase: Phase) -> Phase:
    """A phase without its closed form: many motions are integrated together, and with derivatives by parameters."""
    return replace(phase, closed_form=None) if phase.closed_form else phase


@lru_cache(maxsize=64)
def bifurcation_statement(model: Model, impacts: tuple[int, ...], event: str | Border, along: str) -> Statement:
    """The statement of the bifurcations of cycles in a parameter, which is their last unknown: "fold", "flip" or a
    `Border`. Raises `InputError` where the pieces of a law move with the parameter, but at a `Border`."""
    if isinstance(event, Border):
        base = cycle_statement(model, impacts, event)
        return replace(base, name="border of the cycle of hops", unknowns=(*base.unknowns, along), tuned=(along,))
    doubled = fold_statement(cycle_statement(model, impacts), along)
    *others, last = doubled.arcs

    def conditions(u: Parameters, x: Scalars, p: Parameters) -> list[Algebraic]:
        # The last derivative is that of the speed after the cycle less that before it, which is 1.
        *equations, change = last.conditions(u, x, p)
        return [*equations, change + 1.0 - MULTIPLIER_AT[event]]

    return replace(doubled, name=f"{event} of the cycle of hops", arcs=(*others, replace(last, conditions=conditions)))
