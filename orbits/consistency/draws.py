"""A model at a few random states, launches and parameters, as arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..errors import OrbitsError, OutOfRange
from ..model.model import Model
from ..model.phase import Phase
from .shapes import WATCHED_FORCE

# States and launches of a draw. States lie so far around a launch, in units of the extension there and of the unit of
# speed; the smallest are for laws that are not defined far from it.
STATES, LAUNCHES, SPREADS, SEED = 12, 3, (1.0, 0.3, 0.1), 20250101
# Where the laws are not defined so far from it, positions are drawn nearer.
SHRINKINGS = (1.0, 0.1, 1e-2, 1e-3, 1e-4)
NEWTON_STARTS, NEWTON_STEPS_TO_LIFTOFF = (0.0, 0.1, -0.1, 1.0, -1.0, 10.0, -10.0), 40


@dataclass(frozen=True)
class Draw:
    """A model at one draw of its parameters p: arrays with a row for each of N states or L launches.

    x, y : flight states (N, n) and contact states (N, m)
    flown, held, stood : values by name at x, in flight at the embedded y, and in contact at y
    mirrored, mirrored_contact : the same at the mirror images of x and y under the reversor
    roots : unknowns of launches (L, k) with values there, and whether `release` gives them or they are the zeros of
        `liftoff`; empty where there are none
    launched : values at these launches and at their mirror images
    free : any unknowns (L, k) of launches, with values there
    length : the unit of extensions
    numbers, graphs : the parameters as a vector, and the expressions that gave these values
    """

    p: Mapping[str, float]
    x: np.ndarray
    y: np.ndarray
    flown: Mapping[str, np.ndarray]
    held: Mapping[str, np.ndarray]
    stood: Mapping[str, np.ndarray]
    mirrored: Mapping[str, np.ndarray]
    mirrored_contact: Mapping[str, np.ndarray]
    launched: Mapping[str, np.ndarray]
    roots: Mapping[str, np.ndarray]
    free: Mapping[str, np.ndarray]
    length: float
    numbers: np.ndarray
    graphs: "Graphs"


class Graphs:
    """The expressions of a model as CasADi functions of states, unknowns, parameters and the data of a piece."""

    def __init__(self, model: Model, names: tuple[str, ...]):
        self.model, self.rng = model, np.random.default_rng(SEED)
        self.positions, self.speeds = coordinates(model.flight)
        p, n, m = ca.SX.sym("p", len(names)), len(model.flight.states), len(model.contact.states)
        known = dict(zip(names, ca.vertsplit(p), strict=True)) if names else {}
        x, y, u = ca.SX.sym("x", n), ca.SX.sym("y", m), ca.SX.sym("u", len(model.launch_unknowns))
        of_u = dict(zip(model.launch_unknowns, ca.vertsplit(u), strict=True))
        q, stood = (ca.SX.sym("q", each.pieces.size if each.pieces else 0) for each in (model.flight, model.contact))
        flight, contact = (ca.vertsplit(x), known, _split(q)), (ca.vertsplit(y), known, _split(stood))
        field, gradient = (ca.vertcat(*each(*flight)) for each in (model.flight.field, model.flight_gradient))
        tension = ca.SX(model.tension(*flight)) if model.tension else ca.SX(0)
        liftoff, launch = ca.SX(model.liftoff(of_u, known, _split(q))), ca.vertcat(*model.launch(of_u, known))
        landing = ca.vertcat(*model.landing(of_u, ca.vertsplit(x), known))
        u_of_liftoff = u[model.launch_unknowns.index("liftoff")]
        self.flight = Expressions(
            [x, p, q],
            {
                "field": field,
                "gradient": gradient,
                "slopes": ca.jacobian(field, x),
                "hessian": ca.jacobian(gradient, x),
                "tension": tension,
                "tension slopes": ca.jacobian(tension, x),
                "impact": ca.vertcat(*model.impact(ca.vertsplit(x), known)),
                "mass": ca.SX(model.impact_mass(ca.vertsplit(x), known)),
            },
        )
        self.contact = Expressions(
            [y, p, stood],
            {
                "field": ca.vertcat(*model.contact.field(*contact)),
                "gradient": ca.vertcat(*model.contact_gradient(*contact)),
                "force": ca.SX(model.contact.watch[WATCHED_FORCE](*contact)),
            },
        )
        self.launch = Expressions(
            [u, p, q],
            {
                "launch": launch,
                "touchdown": ca.vertcat(*model.touchdown(of_u, known)),
                "liftoff": liftoff,
                "slope": ca.jacobian(liftoff, u_of_liftoff),
            },
        )
        self.landing = Expressions([ca.vertcat(u, x), p], {"landing": landing, "slopes": ca.jacobian(landing, x)})
        self.names, self.kept = names, dict[str, Any]()
        self.pieces = self.piece_functions((model.flight, model.contact))

    def piece_functions(self, phases: Sequence[Phase]) -> list[ca.Function | None]:
        """Of each phase the function p -> (breakpoints, data) of its pieces, None where it has none."""
        p = ca.SX.sym("p", len(self.names))
        known = dict(zip(self.names, ca.vertsplit(p), strict=True)) if self.names else {}
        return [
            ca.Function("pieces", [p], [ca.densify(each) for each in _table(phase, known)]) if phase.pieces else None
            for phase in phases
        ]

    def draw(self, p: Mapping[str, float]) -> Draw:
        """The values at one draw of the parameters; raises `OutOfRange` where none are numbers."""
        numbers, free = np.array(list(p.values())), self._unknowns()
        roots = self._launches(free.copy(), p, numbers)
        extensions = roots["u"][:, self.model.launch_unknowns.index("liftoff")] if roots else np.zeros(0)
        length = float(np.abs(extensions).max(initial=0.0)) or 1.0
        about = roots["launch"].mean(0) if roots else np.zeros(len(self.model.flight.states))
        about[self.speeds] = 0.0
        signs, embed = reversor_of(self.model), np.asarray(self.model.embed, dtype=float)
        of_contact, down = signs_in_contact(self.model, signs), np.linalg.pinv(embed)
        for shrunk in SHRINKINGS:
            size = np.ones(len(about))
            size[self.positions] = length * shrunk
            spread = np.resize(SPREADS, STATES)[:, None] * size
            x = about + spread * self.rng.standard_normal((STATES, len(about)))
            y = x[self.rng.permutation(STATES)] @ down.T
            flights = [self.in_flight(each, numbers) for each in (x, x * signs, y @ embed.T)]
            contacts = [self.in_contact(each, numbers) for each in (y, y * of_contact)]
            fine = [np.isfinite(each["field"]).all(1) for each in (*flights, *contacts)]
            good, also = fine[0] & fine[1], fine[2] & fine[3] & fine[4]
            if good.sum() > 1 and also.sum() > 1:
                break
        else:
            raise OutOfRange(f"the model '{self.model.name}' gives no numbers near a launch")
        flown, mirrored = ({name: v[good] for name, v in each.items()} for each in flights[:2])
        held, stood, back = ({name: v[also] for name, v in each.items()} for each in (flights[2], *contacts))
        launched = self._at_launches(roots, numbers, signs, down) if roots else {}
        unknowns = {"u": free, **self._launch(free, numbers)}
        return Draw(
            p, x[good], y[also], flown, held, stood, mirrored, back, launched, roots, unknowns, length, numbers, self
        )

    def in_flight(self, x: np.ndarray, p: np.ndarray) -> dict[str, np.ndarray]:
        """Values in flight at states (N, n), not numbers outside the range of a law in pieces."""
        return self.flight(x, p, self.piece_data(self.model.flight, self.pieces[0], x, p))

    def in_contact(self, y: np.ndarray, p: np.ndarray) -> dict[str, np.ndarray]:
        """Values in contact at states (N, m)."""
        return self.contact(y, p, self.piece_data(self.model.contact, self.pieces[1], y, p))

    @staticmethod
    def piece_data(phase: Phase, function: ca.Function | None, states: np.ndarray, p: np.ndarray) -> np.ndarray:
        """The data (N, nq) of the pieces of a phase that hold states (N, n), NaN outside of all."""
        if function is None or phase.pieces is None:
            return np.zeros((len(states), 0))
        breaks, data = (np.array(each) for each in function(p))
        place = states @ np.array(phase.pieces.coordinate)
        index = np.clip(np.searchsorted(breaks.ravel(), place, "right") - 1, 0, len(data) - 1)
        inside = (place >= breaks.min()) & (place <= breaks.max())
        return np.where(inside[:, None], data[index], np.nan)

    def _unknowns(self) -> np.ndarray:
        """Unknowns (L, k) of launches, some below 0, but for the launch speed."""
        k, alpha = len(self.model.launch_unknowns), self.model.launch_unknowns.index("alpha")
        u = self.rng.uniform(0.5, 1.5, (LAUNCHES, k)) * np.where(self.rng.uniform(size=k) < 0.5, -1, 1)
        u[:, alpha] = np.abs(u[:, alpha])
        return u

    def _launches(self, u: np.ndarray, p: Mapping[str, float], numbers: np.ndarray) -> dict[str, np.ndarray]:
        """Unknowns (L, k) of launches by `release` or as zeros of `liftoff`, from others, with the values there; none
        where there are none."""
        model = self.model
        at, alpha = model.launch_unknowns.index("liftoff"), model.launch_unknowns.index("alpha")
        released = np.zeros(0)
        if model.one_speed:
            try:
                released = np.asarray(model.release(u[:, alpha], p), dtype=float)
            except OrbitsError:
                released = np.zeros(0)
        if released.size:
            u[:, at] = released
        else:
            u = self._zeros_of_liftoff(u, at, numbers)
        u = u[np.isfinite(u).all(1)]
        if not len(u):
            return {}
        launch = self._launch(u, numbers)
        return {"u": u, "released": np.full(len(u), bool(released.size)), **launch}

    def _launch(self, u: np.ndarray, p: np.ndarray) -> dict[str, np.ndarray]:
        first = self.launch(u, p, np.zeros((len(u), self.launch.sizes[2])))
        data = self.piece_data(self.model.flight, self.pieces[0], first["launch"], p)
        return self.launch(u, p, data) if self.pieces[0] else first

    def _zeros_of_liftoff(self, u: np.ndarray, at: int, p: np.ndarray) -> np.ndarray:
        """Launches (L, k) at which `liftoff` vanishes, NaN where Newton's method finds none."""
        tries = np.repeat(u, len(NEWTON_STARTS), axis=0)
        tries[:, at] = np.tile(NEWTON_STARTS, len(u))
        with np.errstate(all="ignore"):
            for _ in range(NEWTON_STEPS_TO_LIFTOFF):
                values = self._launch(tries, p)
                step = values["liftoff"][:, 0] / values["slope"][:, 0]
                tries[:, at] -= step
            settled = np.abs(step) <= 1e-12 * (1 + np.abs(tries[:, at]))
        tries[~settled] = np.nan
        sets = tries.reshape(len(u), len(NEWTON_STARTS), -1)
        nearest = np.nan_to_num(np.abs(sets[:, :, at]), nan=np.inf).argmin(1)
        return sets[np.arange(len(u)), nearest]

    def _at_launches(self, roots, p: np.ndarray, signs: np.ndarray, down: np.ndarray) -> dict[str, np.ndarray]:
        """The flight at launches and at their mirror images, where they land, and the contact from which they come."""
        launch = roots["launch"]
        landing = self.landing(np.hstack([roots["u"], launch * signs]), p)
        flight, contact = self.in_flight(launch, p), self.in_contact(launch @ down.T, p)
        back = self.in_flight(launch * signs, p)
        return {
            "field": flight["field"],
            "slopes": back["slopes"],
            "gradient": back["gradient"],
            "force": contact["force"],
            "landing": landing["landing"],
            "landing slopes": landing["slopes"],
        }


class Expressions:
    """Named expressions, called with points (N, size) and one vector of parameters."""

    def __init__(self, symbols: list[ca.SX], results: Mapping[str, ca.SX]):
        self.shapes = {name: result.shape for name, result in results.items()}
        self.sizes = [symbol.numel() for symbol in symbols]
        self.maps = dict[int, ca.Function]()
        self.function = ca.Function("graph", symbols, [ca.densify(result) for result in results.values()])

    def __call__(self, points: np.ndarray, p: np.ndarray, *data: np.ndarray) -> dict[str, np.ndarray]:
        count = len(points)
        shared = np.repeat(p[:, None], count, axis=1)
        if count not in self.maps:
            self.maps[count] = self.function.map(count)
        found = self.maps[count](points.T, shared, *(each.T for each in data))
        found = found if isinstance(found, tuple) else (found,)
        values = {}
        for (name, (rows, columns)), each in zip(self.shapes.items(), found, strict=True):
            array = np.array(each).reshape(rows, count, columns).swapaxes(0, 1)
            values[name] = array[:, :, 0] if columns == 1 else array
        return values


def _split(vector: ca.SX) -> list[ca.SX]:
    return ca.vertsplit(vector) if vector.numel() else []


def _table(phase: Phase, known: Mapping[str, Any]) -> tuple[ca.SX, ca.SX]:
    """Breakpoints and data of the pieces of a phase as expressions."""
    assert phase.pieces is not None
    breaks, rows = phase.pieces.table(known)
    data = ca.vertcat(*[ca.horzcat(*row) for row in rows]) if phase.pieces.size else ca.SX(len(rows), 0)
    return ca.SX(ca.vertcat(*breaks)), ca.SX(data)


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


def signs_in_contact(model: Model, signs: np.ndarray) -> np.ndarray:
    """The signs (m,) of the contact states under time reversal."""
    return signs[np.abs(np.asarray(model.embed)).argmax(0)]
