"""A model at a few random states, launches and parameters, as arrays."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..errors import OrbitsError, OutOfRange
from ..laws.law import Algebraic
from ..model.model import CONTACT_FORCE, LANDED_FORCE, Model, names_of_holding
from ..model.phase import Phase
from ..model.symmetry import SignedShift
from ..symbolic.calls import MappedFunction

# States and launches of a draw. States lie this far around a launch, in units of the extension there and of the unit of
# speed; the smallest are for laws that are not defined far from it.
STATES, LAUNCHES, SPREADS, SEED = 12, 3, (1.0, 0.3, 0.1), 20250101
# Where the laws are not defined so far from it, positions are drawn nearer.
SHRINKINGS = (1.0, 0.1, 1e-2, 1e-3, 1e-4)
ByName = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Draw:
    """A model at one draw of its parameters p: arrays with a row for each of N states or L launches.

    x, y : flight states (N, n) and contact states (N, m)
    flown, held, stood : values by name at x, in flight at the embedded y, and in contact at y
    mirrored, mirrored_contact : the same at the mirror images of x and y under the reversor
    released : unknowns "u" (L, 2) of launches by `release`, with values there; empty where there are none
    free : any unknowns "u" (L, k) of launches, with values there
    length : the unit of extensions
    graphs : the expressions that gave these values
    """

    p: Mapping[str, float]
    x: np.ndarray
    y: np.ndarray
    flown: ByName
    held: ByName
    stood: ByName
    mirrored: ByName
    mirrored_contact: ByName
    released: ByName
    free: ByName
    length: float
    graphs: "Graphs"


class Expressions:
    """Named expressions, called with points (N, size), with parameters and with the data of pieces (N, nq)."""

    def __init__(self, symbols: Sequence[ca.SX], results: Mapping[str, ca.SX]):
        self.names, dense = tuple(results), [ca.densify(result) for result in results.values()]
        self.function = MappedFunction(ca.Function("expressions", symbols, dense))

    def __call__(self, points: np.ndarray, p: Mapping[str, float], *data: np.ndarray) -> dict[str, np.ndarray]:
        found = self.function(points, np.array(list(p.values()), float)[None], *data)
        arrays = (each[:, :, 0] if each.shape[2] == 1 else each for each in found)
        return dict(zip(self.names, arrays, strict=True))


class Graphs:
    """The expressions of a model as functions of states, unknowns, parameters and the data of a piece."""

    def __init__(self, model: Model, names: tuple[str, ...]):
        self.model, self.rng = model, np.random.default_rng(SEED)
        self.positions, self.speeds = coordinates(model.flight)
        p, known = named(names)
        (x, xs), (y, ys), (u, us) = map(named, (model.flight.states, model.contact.states, model.launch_unknowns))
        (q, qs), (r, rs) = (named(range(data_count(phase))) for phase in (model.flight, model.contact))
        flight, contact = ([*xs.values()], known, [*qs.values()]), ([*ys.values()], known, [*rs.values()])
        field, gradient = (ca.vertcat(*each(*flight)) for each in (model.flight.field, model.flight_gradient))
        tension = ca.SX(model.tension(*flight) if model.tension else 0)
        in_flight = {
            "field": field, "gradient": gradient, "hessian": ca.jacobian(gradient, x), "tension": tension,
            "tension slopes": ca.jacobian(tension, x).T, "impact": ca.vertcat(*model.impact(*flight[:2])),
            "mass": ca.SX(model.impact_mass(*flight[:2])),
        }  # fmt: skip
        if model.sticking:
            directions, masses = model.sticking(*flight[:2])
            in_flight |= {"directions": ca.horzcat(*(ca.vertcat(*each) for each in directions))}
            in_flight |= {"masses": ca.vertcat(*(ca.horzcat(*row) for row in masses))}
        in_contact: dict[str, ca.SX] = {
            "field": ca.vertcat(*model.contact.field(*contact)),
            "gradient": ca.SX(ca.vertcat(*model.contact_gradient(*contact))),
            "force": ca.SX(model.contact.watch[CONTACT_FORCE](*contact)),
        }
        for name in names_of_holding(model.sticks):
            in_contact[name] = ca.SX(model.contact.watch[name](*contact))
        if landed := model.contact.watch.get(LANDED_FORCE):
            in_contact["landed"] = ca.SX(landed(*contact))
        force = ca.vertcat(*map(ca.SX, model.liftoff(us, known, contact[2])))
        at_launch = {
            "launch": ca.SX(ca.vertcat(*model.launch(us, known))),
            "force": force,
            "slopes": ca.jacobian(force, u).T,
        }
        self.flight, self.contact = Expressions([x, p, q], in_flight), Expressions([y, p, r], in_contact)
        self.launch = Expressions([u, p, r], at_launch)

    def draw(self, p: Mapping[str, float]) -> Draw:
        """The values at one draw of the parameters; raises `OutOfRange` where none are numbers."""
        model, free = self.model, self._unknowns()
        released = self._released(free[:, 1], p)
        length = float(np.abs(released["u"][:, 0]).max() if released else 0.0) or 1.0
        about = np.array(model.rest(p) if model.rest else np.zeros(len(model.flight.states)), dtype=float)
        about = released["launch"].mean(0) if released else about
        about[self.speeds] = 0.0
        embed, mirror = np.asarray(model.embed, dtype=float), SignedShift(tuple(map(int, reversor_of(model))))
        mirror = model.reversal if model.reversor else mirror
        for shrunk in SHRINKINGS:
            size = np.ones(len(about))
            size[self.positions] = length * shrunk
            spread = np.resize(SPREADS, STATES)[:, None] * size
            x = about + spread * self.rng.standard_normal((STATES, len(about)))
            y = x[self.rng.permutation(STATES)] @ np.linalg.pinv(embed).T
            flights = [self.in_flight(each, p) for each in (x, mirror(x, p), y @ embed.T)]
            contacts = [self.in_contact(each, p) for each in (y, model.contact_reversal(y, p))]
            fine = [np.isfinite(each["field"]).all(1) for each in (*flights, *contacts)]
            good, also = fine[0] & fine[1], fine[2] & fine[3] & fine[4]
            if good.sum() > 1 and also.sum() > 1:
                break
        else:
            raise OutOfRange(f"the model '{model.name}' gives no numbers near a launch")
        flown, mirrored = ({name: v[good] for name, v in each.items()} for each in flights[:2])
        held, stood, back = ({name: v[also] for name, v in each.items()} for each in (flights[2], *contacts))
        unknowns = {"u": free, **self._launch(free, p)}
        return Draw(p, x[good], y[also], flown, held, stood, mirrored, back, released, unknowns, length, self)

    def in_flight(self, x: np.ndarray, p: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Values by name in flight at states (N, n), not numbers outside the range of a law in pieces."""
        return self.flight(x, p, data_of_pieces(self.model.flight, x, p))

    def in_contact(self, y: np.ndarray, p: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Values by name in contact at states (N, m)."""
        return self.contact(y, p, data_of_pieces(self.model.contact, y, p))

    def _unknowns(self) -> np.ndarray:
        """Unknowns (L, k) of launches, some below 0, but for the launch speed."""
        k = len(self.model.launch_unknowns)
        u = self.rng.uniform(0.5, 1.5, (LAUNCHES, k)) * np.where(self.rng.uniform(size=k) < 0.5, -1, 1)
        u[:, 1] = np.abs(u[:, 1])
        return u

    def _released(self, alpha: np.ndarray, p: Mapping[str, float]) -> dict[str, np.ndarray]:
        """The launches by `release` with speeds (L,)."""
        found = np.zeros(0)
        if self.model.one_speed:
            with suppress(OrbitsError):
                found = np.asarray(self.model.release(alpha, p), dtype=float)
        good = np.isfinite(found)
        u = np.column_stack([found[good], alpha[good]]) if good.any() else np.zeros((0, 2))
        return {"u": u, **self._launch(u, p)} if len(u) else {}

    def _launch(self, u: np.ndarray, p: Mapping[str, float]) -> dict[str, np.ndarray]:
        blank = self.launch(u, p, np.zeros((len(u), data_count(self.model.contact))))
        stood = blank["launch"] @ np.linalg.pinv(np.asarray(self.model.embed, dtype=float)).T
        return self.launch(u, p, data_of_pieces(self.model.contact, stood, p))


def named(names: Sequence[object]) -> tuple[ca.SX, dict[str, Algebraic]]:
    """A vector of symbols, and these by name."""
    vector = ca.SX.sym("x", len(names))
    return vector, dict(zip(map(str, names), ca.vertsplit(vector) if names else [], strict=True))


def data_count(phase: Phase) -> int:
    """The number of data values of a piece of a phase."""
    return phase.pieces.size if phase.pieces else 0


def data_of_pieces(phase: Phase, states: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
    """The data (N, nq) of the pieces of a phase that hold states (N, n), NaN outside of all."""
    if phase.pieces is None:
        return np.zeros((len(states), 0))
    breaks, data = (np.asarray(each, float) for each in phase.pieces.table(p))
    place = phase.pieces.place(states, p)
    index = np.clip(np.searchsorted(breaks, place, "right") - 1, 0, len(data) - 1)
    inside = (place >= breaks[0]) & (place <= breaks[-1])
    return np.where(inside[:, None], data[index], np.nan)


def coordinates(phase: Phase) -> tuple[list[int], list[int]]:
    """Places of the positions that have a speed, and of their speeds, whose names end with an apostrophe."""
    states = phase.states
    pairs = [(i, states.index(f"{name}'")) for i, name in enumerate(states) if f"{name}'" in states]
    return [i for i, _ in pairs], [j for _, j in pairs]


def reversor_of(model: Model) -> np.ndarray:
    """The signs (n,) of the flight states under time reversal; of a model without a reversor, -1 for speeds."""
    if model.reversor:
        return np.array(model.reversor, dtype=float)
    return np.array([-1.0 if name.endswith("'") else 1.0 for name in model.flight.states])
