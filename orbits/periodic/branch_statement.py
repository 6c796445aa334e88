"""The statement of a branch point: where a lateral motion near the vertical hop of a machine begins to close with it.

To first order the lateral states d of a motion near the hop obey d' = A(y) d, with A the derivative of their rates by
themselves at the states y of the hop, which they do not change. Half an orbit has 2 k lateral unknowns at its launch,
and 2 k + s homogeneous conditions: s forces along the ground vanish at lift-off, and k places vanish in mid-flight and
in mid-contact each. So a solution other than 0 exists where s + 1 numbers of the machine have certain values. There a
branch of runs meets that of their mirror images in the hop: a pitchfork (Golubitsky and Schaeffer 1985, chapter VI).
"""

from collections.abc import Callable, Mapping
from functools import lru_cache

import casadi as ca

from ..laws import Algebraic, Parameters, Scalars
from ..model import Arc, Model, Phase, Statement, names_of_holding, weighted_sum
from ..shooting import half_contact, half_flight


@lru_cache(maxsize=64)
def whole_hop_statement(hop: Model) -> Statement:
    """Half an orbit of the model of the vertical hop, with both of its phases."""
    times = ("duration", "contact_duration")
    return Statement("vertical hop", (*hop.launch_unknowns, *times), (half_flight(hop), half_contact(hop)), times)


@lru_cache(maxsize=64)
def branch_statement(model: Model, hop: Model, tuned: tuple[str, ...]) -> Statement:
    """Half a vertical hop with a lateral motion near it; the parameters for which that exists are unknowns, one more
    than there are coordinates that stick.

    The lateral unknowns of a launch have the length 1. Of a coordinate that sticks the place in mid-flight is left
    free: it is half of the step.
    """
    base, beside = whole_hop_statement(hop), BesideVerticalHop(model, hop)
    flight, contact = base.arcs
    phases = [beside.phase(each) for each in (model.flight, model.contact)]

    def mid_flight(u: Mapping, x: Scalars, p: Parameters) -> list[Algebraic]:
        length = sum(u[name] * u[name] for name in beside.unknowns) - 1
        return [*flight.conditions(u, x[: len(flight.phase.states)], p), *beside.places(model.flight, x), length]

    def mid_contact(u: Mapping, x: Scalars, p: Parameters) -> list[Algebraic]:
        return [*contact.conditions(u, x[: len(contact.phase.states)], p), *beside.places(model.contact, x)]

    arcs = (
        Arc(
            phases[0],
            start=lambda u, before, p: beside.launch(u, p),
            duration=flight.duration,
            conditions=mid_flight,
            guard=lambda u, x, p, q: [*flight.guard(u, x, p, q), *beside.forces(u, p)],
        ),
        Arc(
            phases[1],
            start=lambda u, before, p: beside.touchdown(u, p),
            duration=contact.duration,
            conditions=mid_contact,
        ),
    )
    own = base.unknowns[: -len(base.durations)]
    return Statement("branch point", (*own, *beside.unknowns, *base.durations, *tuned), arcs, base.durations, tuned)


class BesideVerticalHop:
    """The motions of a model near its vertical `hop`: its states, followed by the lateral ones to first order."""

    def __init__(self, model: Model, hop: Model):
        self.model, self.hop = model, hop
        self.unknowns = tuple(name for name in model.launch_unknowns if name not in hop.launch_unknowns)

    def lateral(self, phase: Phase) -> list[int]:
        """The numbers of the lateral states of a phase of the model."""
        own = self.hop.flight.states if phase is self.model.flight else self.hop.contact.states
        return [i for i, name in enumerate(phase.states) if name not in own]

    def phase(self, phase: Phase) -> Phase:
        """A phase of the model near the hop."""
        lateral, hop = self.lateral(phase), self.hop.flight if phase is self.model.flight else self.hop.contact

        def field(x: Scalars, p: Parameters, q: Scalars) -> list[Algebraic]:
            rates = self.first_order(phase, lambda whole: [phase.field(whole, p, q)[i] for i in lateral], x)
            return [*hop.field(x[: len(hop.states)], p, q), *rates]

        return Phase(phase.name, (*hop.states, *(phase.states[i] for i in lateral)), field)

    def first_order(self, phase: Phase, function: Callable, x: Scalars) -> list[Algebraic]:
        """The values, to first order, of functions of a phase's state that the mirror turns over."""
        lateral, count = self.lateral(phase), len(x) - len(self.lateral(phase))
        symbols, own = ca.SX.sym("lateral", len(lateral)), iter(x)
        turned = dict(zip(lateral, ca.vertsplit(symbols), strict=True))
        values = ca.vertcat(*function([turned[i] if i in turned else next(own) for i in range(len(x))]))
        slopes = ca.substitute(ca.jacobian(values, symbols), symbols, ca.SX.zeros(len(lateral)))
        return ca.vertsplit(ca.densify(slopes @ ca.vertcat(*x[count:])))

    def places(self, phase: Phase, x: Scalars) -> list[Algebraic]:
        """The lateral places of a phase, except those of coordinates that stick."""
        names = [phase.states[i] for i in self.lateral(phase)]
        each = zip(names, x[len(x) - len(names) :], strict=True)
        return [place for name, place in each if not name.endswith("'") and name not in self.model.sticks]

    def launch(self, u: Mapping, p: Parameters) -> list[Algebraic]:
        """The state in flight at lift-off."""
        contact = self.lateral(self.model.contact)
        released = [u.get(self.model.contact.states[i], 0.0) for i in contact]
        rows = self.model.embed[self.lateral(self.model.flight)][:, contact].tolist()
        return [*self.hop.launch(u, p), *(weighted_sum(row, released) for row in rows)]

    def touchdown(self, u: Mapping, p: Parameters) -> list[Algebraic]:
        """The state in contact after a landing, the image of that at lift-off."""
        each = ((self.model.contact.states[i], self.model.mirror[i]) for i in self.lateral(self.model.contact))
        return [*self.hop.touchdown(u, p), *(sign * u[name] if name in u else 0.0 for name, sign in each)]

    def forces(self, u: Mapping, p: Parameters) -> list[Algebraic]:
        """The forces along the ground at lift-off."""
        contact, names = self.model.contact, names_of_holding(self.model.sticks)
        hop = self.hop.contact_reversal.image(self.hop.touchdown(u, p), p)
        x = [*hop, *(u.get(contact.states[i], 0.0) for i in self.lateral(contact))]
        return self.first_order(contact, lambda whole: [contact.watch[name](whole, p, []) for name in names], x)

    def speed(self, u: Mapping, p: Parameters) -> Algebraic:
        """The speed of the centre of mass along the ground in flight."""
        assert self.model.planar is not None
        travel = self.model.planar.travel
        assert travel is not None
        return self.first_order(self.model.flight, lambda whole: [travel(whole, p)], self.launch(u, p))[0]
