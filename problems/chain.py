"""A chain: N masses in a column joined by springs, of which the lowest lands plastically.

Units: whatever the masses, the springs' forces and their extensions are stated in, with gravity 1. Flight state
(y1, y1', ..., yN, yN'), from the top, positions counted from the unstretched column with its lowest mass on the ground;
r_i = y_i - y_{i+1} is the extension of spring i with force phi_i, and in flight

    m_i y_i'' = phi_{i-1}(r_{i-1}) - phi_i(r_i) - m_i,

in contact the same with y_N = 0, until the lowest spring carries the lowest mass, phi_{N-1}(y_{N-1}) = m_N. A lossless
hop is its own mirror image in time, from rest in mid-contact to rest in mid-flight. For N = 2 it is the hopper's, its
mass ratio m2/m1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from orbits.errors import FlowError, InputError, NoOrbit
from orbits.flow import flow
from orbits.model import Affine, Model, Phase

from .laws import Key, Law, number, parameter_names
from .relative import liftoff_extension
from .springs import NAMED, as_spring

MOST_MASSES = 12
# Roots closer than this, as a share of the times, are one; and hops shorter than that share of the longest have shrunk
# to nothing, which is a root for many contacts.
SAME, SMALLEST = 1e-7, 1e-3


@dataclass(frozen=True)
class Chain:
    """N masses in a column joined by N - 1 springs.

    masses : (N,), from the top, N from 2 to 12
    springs : a spring as in `Machine`, for all, or (N - 1,) of them, from the top; smooth, with parameters in common
    restitution : of the impacts of the lowest mass, 0 <= e <= 1
    parameters : values of the formulas' names
    """

    masses: Sequence[float] = (1.0, 1.0, 1.0)
    springs: object = "r"
    restitution: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)

    units = None
    rest_length = None

    def __post_init__(self):
        masses = tuple(number(f"m{i}", m, low=0) for i, m in enumerate(self.masses, 1))
        if not 2 <= len(masses) <= MOST_MASSES:
            raise InputError(f"a chain has from 2 to {MOST_MASSES} masses, not {len(masses)}")
        if not 0 <= number("restitution", self.restitution) <= 1:
            raise InputError(f"restitution = {self.restitution:g} is out of bounds; it lies between 0 and 1")
        given = self.springs if isinstance(self.springs, list | tuple) else [self.springs] * (len(masses) - 1)
        if len(given) != len(masses) - 1:
            raise InputError(f"{len(masses)} masses are joined by {len(masses) - 1} springs, not {len(given)}")
        springs = tuple(self._spring(law) for law in given)
        known = {name: value for law in springs for name, value in law.parameters.items()}
        if unknown := [name for name in self.parameters if name not in known]:
            raise InputError(f"no spring has a parameter '{unknown[0]}'; they have {', '.join(known) or 'none'}")
        if taken := [name for name in known if name in _mass_names(len(masses))]:
            raise InputError(f"'{taken[0]}' is a mass; call the formula's parameter something else")
        if any(law.parameters[name] != known[name] for law in springs for name in law.parameters):
            raise InputError("two springs have a parameter of one name with different values; rename one")
        object.__setattr__(self, "masses", masses)
        object.__setattr__(self, "springs", springs)
        object.__setattr__(self, "parameters", known)

    def _spring(self, law) -> Law:
        names = parameter_names(law, "r", NAMED)
        spring = as_spring(law, {name: self.parameters[name] for name in self.parameters.keys() & names})
        if spring.pieces:
            raise InputError(f"spring '{spring.text}' is piecewise; a chain takes smooth ones")
        return spring

    @cached_property
    def model(self) -> Model:
        """The engine's view of the chain; chains that differ only in numbers share it."""
        return _model(tuple(law.key for law in self.springs))

    @property
    def values(self) -> dict[str, float]:
        """Every parameter of the model by name: the masses, then the springs' parameters."""
        return {**dict(zip(_mass_names(len(self.masses)), self.masses, strict=True)), **self.parameters}

    def with_values(self, **values: float) -> "Chain":
        """The same chain with other values of m1, ..., mN or of the springs' parameters."""
        names = _mass_names(len(self.masses))
        masses = tuple(values.get(name, mass) for name, mass in zip(names, self.masses, strict=True))
        rest = {name: value for name, value in values.items() if name not in names}
        return replace(self, masses=masses, parameters={**self.parameters, **rest})

    def describe(self) -> dict:
        """The chain as JSON-ready data."""
        texts = [law.text for law in self.springs]
        return {
            "machine": f"chain of {len(self.masses)} masses",
            "spring": texts[0] if len(set(texts)) == 1 else "; ".join(texts),
            "gravity": "1",
            "mass_ratio": None,
            "rest_length": None,
            "restitution": float(self.restitution),
            "parameters": self.values,
            "laws_in": "units of the machine",
        }

    def start(self, positions: Sequence[float], half_contact: float, half_flight: float) -> dict[str, float]:
        """What `find` starts from: unknowns by name, from a guess of the rest in mid-contact and of the two times.

        positions : (N - 1,), of all masses but the lowest, at rest in mid-contact
        """
        rest = np.zeros(2 * len(self.masses) - 2)
        if np.shape(positions) != (len(self.masses) - 1,):
            raise InputError(f"positions = {positions!r}; they are {len(self.masses) - 1} numbers, from the top")
        rest[::2] = positions
        along = flow(self.model.contact, tuple(self.values))
        try:
            path, _ = along.run(rest, list(self.values.values()), number("half_contact", half_contact, low=0))
        except FlowError as error:
            raise NoOrbit(f"the contact cannot be followed from rest at {positions}: {error}") from None
        named = dict(zip(self.model.flight.states, path.end[: len(rest)].tolist(), strict=False))
        return self._launch(named, half_contact, number("half_flight", half_flight, low=0))

    def starts(self, half_contact: float, half_flight: float, count: int = 500, seed: int = 0) -> list[dict]:
        """Starts near all lossless hops with phase times up to these that are found from so many quasi-random pairs.

        They are exact for linear springs (`linear_orbits`); others are taken by their slopes at rest.
        """
        slopes = [float(law.with_slope(0.0)[1]) for law in self.springs]
        for law, slope in zip(self.springs, slopes, strict=True):
            number(f"the slope of spring '{law.text}' at rest", slope, low=0)
        found = linear_orbits(self.masses, slopes, half_contact, half_flight, count, seed)
        names = self.model.flight.states
        return [
            self._launch(dict(zip(names, state.tolist(), strict=True)), contact, flight)
            for contact, flight, state in found
        ]

    def _launch(self, named: Mapping, half_contact: float, half_flight: float) -> dict[str, float]:
        above = len(self.masses) - 1  # the mass above the lowest, whose extension and speed tell the lift-off
        own = {"liftoff": named[f"y{above}"], "alpha": named[f"y{above}'"]}
        others = {name: named[name] for name in self.model.launch_unknowns if name not in own}
        return {**own, **others, "duration": half_flight, "contact_duration": half_contact}


def linear_orbits(
    masses, stiffnesses, half_contact: float, half_flight: float, count: int, seed: int
) -> list[tuple[float, float, np.ndarray]]:
    """Half the time of contact, of flight, and the flight state (2 N,) at lift-off, of the roots for linear springs.

    masses, stiffnesses : (N,), (N - 1,), from the top
    half_contact, half_flight : the longest that are looked for
    count, seed : of the quasi-random pairs of times from which Newton's method starts

    From rest each vibration mode is a cosine, so that the speeds at lift-off are a linear function of the positions
    there, by the contact before and by the flight after it. The lowest spring carries the lowest mass, which gives one
    position; that both speeds agree for all masses above it gives the others. What is left are two equations in the two
    times alone: both speeds of that mass agree, and the lowest one has none (Pankov 2021, section 1).
    """
    from scipy.optimize import root
    from scipy.stats import qmc

    chain = _LinearChain(np.array(masses, dtype=float), np.array(stiffnesses, dtype=float))
    found: list[tuple[float, float, np.ndarray]] = []
    longest = np.array([half_contact, half_flight])
    for times in qmc.Sobol(2, seed=seed).random(1 << (int(count) - 1).bit_length())[:count] * longest:
        answer = root(lambda t: chain.residual(*t), times, tol=1e-14)
        if not np.abs(answer.fun).max() < 1e-9 * (1 + chain.weights.sum()):
            continue
        times, known = answer.x, [np.array(pair[:2]) for pair in found]
        inside = (times > SMALLEST * longest).all() and (times <= longest).all()
        if inside and not any(np.abs(times - other).max() < SAME * times.max() for other in known):
            state = np.column_stack(chain.lifted(*times)[:2]).ravel()
            if state[-3] > 0:  # else the lowest mass would be pushed into the ground
                found.append((*times.tolist(), state))
    return sorted(found, key=lambda pair: pair[:2])


class _LinearChain:
    """The modes of a linear chain in contact and in flight."""

    def __init__(self, masses: np.ndarray, stiffnesses: np.ndarray):
        self.weights, self.k = masses, stiffnesses
        n, tension = len(masses), np.diff(np.eye(len(masses)), axis=0)
        self.stiffness = tension.T @ (stiffnesses[:, None] * tension)
        square, modes = np.linalg.eigh(self.stiffness / np.sqrt(np.outer(masses, masses)))
        self.flight, self.modes = np.sqrt(np.maximum(square, 0.0)), modes / np.sqrt(masses)[:, None]
        self.flight[0] = 0.0  # all together, falling
        inner = self.stiffness[:-1, :-1] / np.sqrt(np.outer(masses[:-1], masses[:-1]))
        square, modes = np.linalg.eigh(inner)
        self.contact, self.standing = np.sqrt(square), modes / np.sqrt(masses[:-1])[:, None]
        self.rest = -np.linalg.solve(self.stiffness[:-1, :-1], masses[:-1])
        self.size = n

    def speeds(self, contact: float, flight: float):
        """Matrices and offsets of the speeds at lift-off as functions of the positions (N,) there: by the contact
        before, of all masses but the lowest, and by the flight after it, of all."""
        m, n = self.weights, self.size - 1
        upward = -self.contact * np.tan(self.contact * contact)
        before = np.zeros((n, n + 1))
        before[:, :n] = (self.standing * upward) @ self.standing.T * m[:n]
        after = (self.modes * (self.flight * np.tan(self.flight * flight))) @ self.modes.T * m
        return before, -before[:, :n] @ self.rest, after, self.modes[:, 0] * (self.modes[:, 0] @ m) * flight

    def lifted(self, contact: float, flight: float):
        """Positions and speeds (N,) at lift-off, by the flight after it, and speeds by the contact."""
        before, start, after, thrown = self.speeds(contact, flight)
        x, upper = np.zeros(self.size), self.size - 2
        x[upper] = self.weights[-1] / self.k[-1]
        apart = before[:upper] - after[:upper]
        x[:upper] = np.linalg.solve(apart[:, :upper], thrown[:upper] - start[:upper] - apart @ x)
        return x, after @ x + thrown, before @ x + start

    def residual(self, contact: float, flight: float) -> np.ndarray:
        """What is left at lift-off: the two speeds of the mass above the lowest, and that of the lowest."""
        try:
            _, after, before = self.lifted(contact, flight)
        except np.linalg.LinAlgError:
            return np.full(2, np.inf)
        return np.array([after[-2] - before[-1], after[-1]])


def _mass_names(count: int) -> tuple[str, ...]:
    return tuple(f"m{i}" for i in range(1, count + 1))


@lru_cache(maxsize=64)
def _model(springs: tuple[Key, ...]) -> Model:
    count = len(springs) + 1
    names, states = _mass_names(count), tuple(f"y{i}{d}" for i in range(1, count + 1) for d in ("", "'"))
    eye = np.eye(2 * count)
    above = count - 2  # of the mass over the lowest

    def tensions(positions, p, q):
        return [
            spring.expression(upper - lower, p, q)
            for spring, upper, lower in zip(springs, positions[:-1], positions[1:], strict=True)
        ]

    def forces(positions, p, q):
        """On every mass, upwards."""
        pulls = tensions(positions, p, q)
        return [up - down - p[m] for m, up, down in zip(names, [0, *pulls], [*pulls, 0], strict=True)]

    def flight(x, p, q):
        pairs = zip(x[1::2], forces(x[::2], p, q), names, strict=True)
        return [rate for speed, force, m in pairs for rate in (speed, force / p[m])]

    def contact(x, p, q):
        pairs = zip(x[1::2], forces([*x[::2], 0.0], p, q), names, strict=False)
        return [rate for speed, force, m in pairs for rate in (speed, force / p[m])]

    def flight_gradient(x, p, q):
        pairs = zip(x[1::2], forces(x[::2], p, q), names, strict=True)
        return [part for speed, force, m in pairs for part in (-force, p[m] * speed)]

    def contact_gradient(x, p, q):
        pairs = zip(x[1::2], forces([*x[::2], 0.0], p, q), names, strict=False)
        return [part for speed, force, m in pairs for part in (-force, p[m] * speed)]

    def heights(p):
        whole = sum(p[m] for m in names)
        masses = {f"mass {i + 1}": Affine(tuple(eye[2 * i])) for i in range(count)}
        return {**masses, "centre of mass": Affine(tuple(sum(p[m] * eye[2 * i] for i, m in enumerate(names)) / whole))}

    def no_numbers(family, p):
        raise NoOrbit("the hops of a chain have no family numbers: give `find` a start, as Chain.starts makes them")

    def lifted(p):
        from .laws import from_key

        return liftoff_extension(from_key(springs[-1], p), 1.0 - p[names[-1]], "the weight of the lowest mass")

    def release(alpha, p):
        if count > 2:
            raise InputError("a launch of a chain is more than a speed: give the flight state")
        return np.full(np.shape(alpha), lifted(p))

    own = {f"y{count - 1}": "liftoff", f"y{count - 1}'": "alpha"}
    launched = states[:-2]
    return Model(
        name=f"chain of {count} masses",
        flight=Phase("flight", states, flight),
        contact=Phase(
            "contact",
            launched,
            contact,
            {"contact force": lambda x, p, q: p[names[-1]] - springs[-1].expression(x[2 * above], p, q)},
        ),
        launch=lambda u, p: [*(u[own.get(name, name)] for name in launched), 0.0, 0.0],
        launch_unknowns=("liftoff", "alpha", *(name for name in launched if name not in own)),
        liftoff=lambda u, p, q: springs[-1].expression(u["liftoff"], p, q) - p[names[-1]],
        landing=lambda u, x, p: [x[-2], x[-1], x[2 * above] - u["liftoff"]],
        reversor=(1, -1) * count,
        release=release,
        touchdown=lambda u, p: [
            -u[own.get(name, name)] if name.endswith("'") else u[own.get(name, name)] for name in launched
        ],
        embed=np.eye(2 * count, 2 * count - 2),
        flight_gradient=flight_gradient,
        contact_gradient=contact_gradient,
        extension=Affine(tuple(eye[2 * above] - eye[-2])),
        gap=lambda p: Affine(tuple(eye[-2])),
        separation=lambda p: None,
        heights=heights,
        impact_mass=lambda p: p[names[-1]],
        impact=lambda p: eye[-1],
        contact_speed=Affine(tuple(eye[2 * above + 1, : 2 * count - 2])),
        violations={
            "gap": "lowest mass below ground",
            "pull": "the ground would have to pull",
            "separation": "the masses pass through each other",
            "end": "contact: the springs collapse, the lowest mass never lifts off again",
        },
        springs=tuple((f"mass {i + 2}", f"mass {i + 1}") for i in range(count - 1)),
        guess=no_numbers,
    )
