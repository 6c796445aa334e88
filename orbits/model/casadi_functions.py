"""The functions of a model as CasADi functions of vectors, in the units of its machine.

Nothing is derived here: they are the vector fields, gaps, forces, impacts and maps of the `Model`. The energy is the
integral of its gradient, since a law of a spring need not have a potential in closed form.
"""

from collections.abc import Mapping
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..laws import Algebraic, Scalars
from ..numerics import GAUSS_PLACES, GAUSS_WEIGHTS
from ..units import ENERGY, FORCE, LENGTH, TIME, Dimension, Units
from .model import CONTACT_FORCE, LANDED_FORCE, Model
from .phase import Phase, Pieces, weighted_sum


class FunctionOptions(NamedTuple):
    """The quadrature of the energy, and where a law in pieces counts as smooth."""

    panels: int = 32  # of ten Gauss points each, on the straight way from rest
    derivatives: int = 5  # order of the highest derivative that is compared on both sides of a breakpoint
    same: float = 1e-7  # the coefficients of a table's polynomials are rounded by a smaller share than this


def dimension_of_watched(name: str) -> Dimension | str:
    """The dimension of a force that a phase watches; the contact force of a gap that is an angle is a torque."""
    return "smallest_contact_force" if name in (CONTACT_FORCE, LANDED_FORCE) else FORCE


class Symbols:
    """The vectors of a machine as symbols, and its model's functions as expressions of them in the machine's units.

    names : of the parameters that are arguments; a parameter that changes no motion, or that leads to the machine from
        a simpler one, is a number
    named : the parameters by name
    vectors : the symbols "x", "y", "p" and "e", in the units of the machine
    sizes, states, data : of "x" and "y": the units of their entries, these without units, and the data of the piece of
        a law on which they are
    embedded : the contact state as a flight state, without units
    """

    def __init__(self, machine: Any):
        model: Model = machine.model
        fixed = {name: machine.values[name] for name in (model.homotopy, model.gauge) if name}
        self.model, self.names = model, tuple(name for name in machine.values if name not in fixed)
        phases = {"x": model.flight, "y": model.contact}
        self.vectors = {key: ca.SX.sym(key, len(phase.states)) for key, phase in phases.items()}
        self.vectors |= {"p": ca.SX.sym("p", len(self.names)), "e": ca.SX.sym("e")}
        self.named: dict[str, Any] = dict(zip(self.names, ca.vertsplit(self.vectors["p"]), strict=True)) | fixed
        self.units: Units | None = model.units(self.named) if model.units else None
        self.sizes = {key: [self.unit(name) for name in phase.states] for key, phase in phases.items()}
        self.states = {
            key: [part / size for part, size in zip(ca.vertsplit(self.vectors[key]), sizes, strict=True)]
            for key, sizes in self.sizes.items()
        }
        self.data = {key: phase.data(self.states[key], self.named) for key, phase in phases.items()}
        self.embedded = self.onto_flight(self.states["y"])

    def onto_flight(self, y: Scalars) -> list[Algebraic]:
        """A contact state as a flight state."""
        return [weighted_sum(row, y) for row in self.model.embed.tolist()]

    def unit(self, dimension: Dimension | str) -> Algebraic:
        """The unit of a dimension, or of a state of this name."""
        return 1.0 if self.units is None else self.units.of(dimension)

    def function(self, name: str, value: Algebraic, arguments: str = "xp", result: str = "value") -> ca.Function:
        """A function of these vectors, in the units of the machine."""
        entries = ca.vertcat(*value) if isinstance(value, list) else ca.SX(value)
        inputs = [self.vectors[each] for each in arguments]
        return ca.Function(
            name.replace("-", "_").replace(" ", "_"), inputs, [ca.densify(entries)], [*arguments], [result]
        )

    def state(self, name: str, value: Scalars, arguments: str, result: str = "x") -> ca.Function:
        """A function whose value is a state."""
        sized = [part * size for part, size in zip(value, self.sizes[result], strict=True)]
        return self.function(name, sized, arguments, f"{result}_after")

    def rates(self, phase: Phase, of: str) -> ca.Function:
        """The vector field of a phase."""
        time = self.unit(TIME)
        field = phase.field(self.states[of], self.named, self.data[of])
        sized = [rate * size / time for rate, size in zip(field, self.sizes[of], strict=True)]
        return self.function(phase.name, sized, f"{of}p", "rates")

    def in_contact(self, name: str, function: ca.Function) -> ca.Function:
        """A function of the flight state as one of the contact state."""
        y, p = ca.MX.sym("y", len(self.sizes["y"])), ca.MX.sym("p", len(self.names))
        return ca.Function(name, [y, p], [function(self.embedding(y), p)], ["y", "p"], function.name_out())

    @cached_property
    def embedding(self) -> ca.Function:
        """The embedding of contact states into flight states, whose entries have the same units."""
        y = self.vectors["y"]
        return self.function("onto_flight", self.onto_flight(ca.vertsplit(y)), "y", "x_after")

    def flight_guards(self) -> Mapping[str, ca.Function]:
        """What is above 0 during a flight."""
        model, x, length = self.model, self.states["x"], self.unit(LENGTH)
        found = {"landing": (model.height_of if model.grazes else model.landing_gap_of)(self.named)}
        if model.landing_gap is not None:
            found["fall back"] = model.gap(self.named)
        if apart := model.separation(self.named):
            found["separation"] = apart
        return MappingProxyType({name: self.function(name, each.at(x) * length) for name, each in found.items()})

    def contact_guards(self) -> Mapping[str, ca.Function]:
        """What is above 0 during a contact."""
        model, y, length = self.model, self.states["y"], self.unit(LENGTH)
        forces = {"lift-off": CONTACT_FORCE} | ({"step back": LANDED_FORCE} if model.changes_contact else {})
        found = {name: self.watched(model.contact, "y", watched) for name, watched in forces.items()}
        if gap := model.standing_gap(self.named):
            found["standing gap"] = gap.at(y) * length
        if apart := model.separation(self.named):
            found["separation"] = apart.at(self.embedded) * length
        return MappingProxyType({name: self.function(name, value, "yp") for name, value in found.items()})

    def watched(self, phase: Phase, of: str, name: str) -> Algebraic:
        """A force that a phase watches."""
        value = phase.watch[name](self.states[of], self.named, self.data[of])
        return value * self.unit(dimension_of_watched(name))

    def forces(self, phase: Phase, of: str) -> Mapping[str, ca.Function]:
        """The forces of the springs and of the ground in a phase."""
        model, x = self.model, self.states["x"] if of == "x" else self.embedded
        found = {
            name: force(x, self.named, self.data[of]) * self.unit(model.spring_dimensions.get(name, FORCE))
            for name, force in model.spring_forces.items()
        }
        found |= {name: self.watched(phase, of, name) for name in phase.watch}
        # A spring may be called by its extension, which cannot be a function's name.
        each = enumerate(found.items())
        return MappingProxyType({name: self.function(f"force_{i}", value, f"{of}p") for i, (name, value) in each})

    def landed(self, x: Scalars) -> list[Algebraic]:
        """The flight state after an impact in the flight state x, in whose labels the machine stands."""
        model = self.model
        zero = model.sticks if model.runs else ()
        placed = [0.0 if name in zero else part for name, part in zip(model.flight.states, x, strict=True)]
        return model.landed(placed, self.named, self.vectors["e"])

    def resets(self) -> Mapping[str, ca.Function]:
        """The states after events."""
        model, x, label = self.model, self.states["x"], self.model.relabelling
        # The point that lands beside a standing one is caught in the labels of before.
        caught = label.image(self.landed(x), self.named) if model.grazes else self.landed(label.image(x, self.named))
        found = {"landing": self.state("landing", caught, "xpe")}
        if model.landing_gap is not None or model.grazes:
            found["fall back"] = self.state("fall_back", self.landed(x), "xpe")
        found["lift-off"] = self.function("lift_off", self.embedding(self.vectors["y"]), "yp", "x_after")
        if model.changes_contact:
            back = label.inverse.image(self.embedded, self.named)
            found["step back"] = self.state("step_back", back, "yp")
        if model.planar is not None and model.planar.handed_over is not None:
            found["hand-over"] = self.state("hand_over", model.planar.handed_over(x, self.named), "xp")
        return MappingProxyType(found)

    def maps(self) -> dict[str, Any]:
        """The maps between states, and everything else except phases, guards and resets."""
        model, named, x = self.model, self.named, self.states["x"]
        onto = [self.vectors["x"][model.flight.states.index(name)] for name in model.contact.states]
        gradient = model.flight_gradient(x, named, self.data["x"])
        by_energy = [part * self.unit(ENERGY) / size for part, size in zip(gradient, self.sizes["x"], strict=True)]
        standing = x if model.grazes else model.relabelling.image(x, named)
        lost = model.lost_at(standing, named) * self.unit(ENERGY)
        heights = enumerate(model.heights(named).items())
        height = self.unit(LENGTH)
        found: dict[str, Any] = {
            "onto_flight": self.embedding,
            "onto_contact": self.function("onto_contact", onto, "x", "y_after"),
            "energy_gradient": self.function("energy_gradient", by_energy),
            "landing_loss": self.function("landing_loss", lost),
            "heights": MappingProxyType(
                {name: self.function(f"height_{i}", each.at(x) * height) for i, (name, each) in heights}
            ),
            "extension": self.function("extension", model.extension_of(named).at(x) * self.unit("liftoff")),
        }
        if model.reversor is not None:
            back = model.contact_reversal.image(self.states["y"], named)
            found["reversor"] = self.state("reversor", model.reversal.image(x, named), "xp")
            found["contact_reversor"] = self.state("contact_reversor", back, "yp", "y")
        if model.symmetry is not None:
            found["relabelling"] = self.state("relabelling", standing, "xp")
        if model.flight.pieces:
            levels, place = self.levels(model.flight.pieces), weighted_sum(model.flight.pieces.coordinate, x)
            away = [(place - level) * self.unit("liftoff") for level in levels[1:-1]]
            found["breakpoints"] = self.function("breakpoints", away)
        return found

    def levels(self, pieces: Pieces) -> list[Algebraic]:
        """The extensions at which a law continues to its next piece, and the ends of its range."""
        unit, origin = pieces.unit(self.named), pieces.origin(self.named)
        return [(place + origin) / unit for place in pieces.table(self.named)[0]]

    def energy(self, panels: int) -> ca.Function:
        """(x, p) -> the energy: the sum of the work on straight ways, each a column of starts, ends and piece data."""
        model, x, p = self.model, ca.vertcat(*self.states["x"]), self.vectors["p"]
        rest = ca.SX(ca.vertcat(*model.rest(self.named))) if model.rest else ca.SX(ca.DM.zeros(x.numel()))
        ways = self.ways_in_pieces(rest, x, panels) if model.flight.pieces else straight(rest, x, panels)
        data = [ca.densify(ca.SX(ca.horzcat(*each))) for each in zip(*ways, strict=True)]
        listed = ca.Function("ways", [self.vectors["x"], p], data)
        start, end, q = ca.SX.sym("start", x.numel()), ca.SX.sym("end", x.numel()), ca.SX.sym("q", data[2].size1())
        work = ca.SX(0)
        for place, weight in zip(GAUSS_PLACES.tolist(), GAUSS_WEIGHTS.tolist(), strict=True):
            at = ca.vertsplit(start + place * (end - start))
            work += weight * ca.dot(ca.vertcat(*model.flight_gradient(at, self.named, ca.vertsplit(q))), end - start)
        one = ca.Function("work", [start, end, q, p], [work * self.unit(ENERGY)])
        state, values = ca.MX.sym("x", x.numel()), ca.MX.sym("p", len(self.names))
        total = ca.sum2(one.map(len(ways))(*listed(state, values), ca.repmat(values, 1, len(ways))))
        return ca.Function("energy", [state, values], [total], ["x", "p"], ["energy"])

    def ways_in_pieces(self, rest: ca.SX, x: ca.SX, panels: int) -> list[tuple[ca.SX, ca.SX, ca.SX]]:
        """The ways from rest along the extension of a law in pieces, on each piece with its own data, and then at a
        fixed extension."""
        pieces = self.model.flight.pieces
        assert pieces is not None
        weights, rows, levels = ca.DM(pieces.coordinate), pieces.table(self.named)[1], self.levels(pieces)
        first, last, each = ca.dot(weights, rest), ca.dot(weights, x), -(-panels // len(rows))
        along, found = weights / ca.dot(weights, weights), list[tuple[ca.SX, ca.SX, ca.SX]]()
        for i, row in enumerate(rows):
            # The outermost pieces go on beyond the ends of the range.
            low, high = levels[i] if i else -ca.inf, levels[i + 1] if i + 1 < len(rows) else ca.inf
            a, b = (ca.fmin(ca.fmax(place, low), high) for place in (first, last))
            found += straight(rest + (a - first) * along, rest + (b - first) * along, each, row)
        return found + straight(rest + (last - first) * along, x, panels, self.data["x"])

    def smoothness(self, values: Mapping[str, float], options: FunctionOptions) -> int:
        """The number of continuous derivatives at the breakpoints."""
        model, pieces = self.model, self.model.flight.pieces
        assert pieces is not None
        x, along, q = ca.SX.sym("x", len(model.flight.states)), ca.DM(pieces.coordinate), ca.SX.sym("q", pieces.size)
        known = [values[name] for name in self.names]
        derivative = ca.vertcat(*model.flight.field(ca.vertsplit(x), self.named, ca.vertsplit(q)))
        derivatives = [derivative]
        for _ in range(options.derivatives):
            derivatives.append(ca.jtimes(derivatives[-1], x, ca.SX(along)))
        at = ca.Function("derivatives", [x, self.vectors["p"], q], [ca.horzcat(*derivatives)])
        rest = np.array(model.rest(values) if model.rest else np.zeros(x.numel()), dtype=float)
        weights, (_, rows) = np.array(pieces.coordinate), pieces.table(values)
        levels = ca.Function("levels", [self.vectors["p"]], [ca.SX(ca.vertcat(*self.levels(pieces)))])(known)
        found = options.derivatives
        for level, before, after in zip(levels.full()[1:-1, 0], rows[:-1], rows[1:], strict=True):
            place = rest + (level - weights @ rest) * weights / (weights @ weights)
            below, above = (at(place, known, row).full() for row in (before, after))
            jumps = np.abs(above - below) > options.same * np.maximum(np.abs(above), np.abs(below)).max(0)
            found = min(found, int(np.argmax(np.append(jumps.any(0), True))) - 1)
        return found


def straight(start: ca.SX, end: ca.SX, panels: int, data: Scalars = ()) -> list[tuple[ca.SX, ca.SX, ca.SX]]:
    """A straight way in panels, each a start, an end and the data of a piece."""
    places = [start + (i / panels) * (end - start) for i in range(panels)] + [end]
    own = ca.SX(ca.vertcat(*data)) if len(data) else ca.SX(0, 1)
    return [(a, b, own) for a, b in pairwise(places)]
