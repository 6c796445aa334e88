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

from orbits import find, follow
from orbits.errors import FlowError, InputError, NoOrbit
from orbits.flow.flow import flow_of
from orbits.model.model import Model
from orbits.model.phase import Affine, Phase

from .laws import Key, Law, from_key, number, parameter_names
from .liftoff import Liftoff
from .springs import NAMED, as_spring

MOST_MASSES = 12
# Roots closer than this, as a share of the times, are one; and hops shorter than that share of the longest have shrunk
# to nothing, which is a root for many contacts.
SAME_TIMES, SMALLEST = 1e-7, 1e-3
# Quasi-random pairs of times taken together, and batches without a new root after which there is none left; steps of
# Newton's method.
BATCH, IDLE, NEWTON = 1024, 4, 60
# The parameter along which springs are brought in, the longest step, as a share, and the most steps.
BENT, LEADING, MOST_CONTINUATION_POINTS = "share_of_the_springs_own_law", 0.1, 100


@dataclass(frozen=True)
class Chain:
    """N masses in a column joined by N - 1 springs.

    masses : (N,), from the top, N from 2 to 12
    springs : a spring as in `TwoMassMachine`, for all, or (N - 1,) of them, from the top; smooth, parameters in common
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
        if np.ndim(self.masses) != 1 or not isinstance(self.parameters, Mapping):
            raise InputError(
                "a chain is told by a list of masses, from the top, and a mapping of its springs' parameters"
            )
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
            has = ", ".join([*_mass_names(len(masses)), *known])
            raise InputError(f"no spring has a parameter '{unknown[0]}'; the chain has {has}")
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
        return _chain_model(tuple(law.key for law in self.springs))

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
        along = flow_of(self.model.contact, tuple(self.values))
        try:
            path, _ = along.run(rest, list(self.values.values()), number("half_contact", half_contact, low=0))
        except FlowError as error:
            raise NoOrbit(f"the contact cannot be followed from rest at {positions}: {error}") from None
        named = dict(zip(self.model.flight.states, path.end[: len(rest)].tolist(), strict=False))
        return self._launch(named, half_contact, number("half_flight", half_flight, low=0))

    def starts(self, half_contact: float, half_flight: float, seed: int = 0) -> list[dict[str, float]]:
        """Starts for `find_all`: the hops with phase times up to these.

        For linear springs they are those of `linear_orbits`. Other springs are brought in step by step, from the linear
        ones with their slopes at rest, and each hop is followed; those that end on the way are left out, as are hops
        that no linear one leads to.
        """
        slopes = [float(law.with_slope(0.0)[1]) for law in self.springs]
        for law, slope in zip(self.springs, slopes, strict=True):
            number(f"the slope of spring '{law.text}' at rest", slope, low=0)
        names = self.model.flight.states
        starts = [
            self._launch(dict(zip(names, state.tolist(), strict=True)), contact, flight)
            for contact, flight, state in linear_orbits(self.masses, slopes, half_contact, half_flight, seed)
        ]
        if all(law.key.degree() == 1 for law in self.springs):
            return starts
        straight = Chain(self.masses, [_blend(law, slope) for law, slope in zip(self.springs, slopes, strict=True)])
        led = []
        for start in starts:
            try:
                family = follow(
                    straight,
                    BENT,
                    1.0,
                    orbit=find(straight, start=start),
                    longest=LEADING,
                    most=MOST_CONTINUATION_POINTS,
                )
            except NoOrbit:
                continue
            if family.end.kind == "reached":
                led.append(dict(zip(self.model.half_unknowns, family[-1].u, strict=True)))
        return led

    def _launch(self, named: Mapping, half_contact: float, half_flight: float) -> dict[str, float]:
        above = len(self.masses) - 1  # the mass above the lowest, whose extension and speed tell the lift-off
        own = {"liftoff": named[f"y{above}"], "alpha": named[f"y{above}'"]}
        others = {name: named[name] for name in self.model.launch_unknowns if name not in own}
        return {**own, **others, "duration": half_flight, "contact_duration": half_contact}


def _blend(law: Law, slope: float) -> Law:
    """A law that goes from a straight line to a spring's own as the parameter `BENT` goes from 0 to 1."""
    own = law.expression
    return Law(
        law.text, "r", lambda x, p, q: p[BENT] * own(x, p, q) + (1 - p[BENT]) * slope * x, {**law.parameters, BENT: 0.0}
    )


def linear_orbits(
    masses, stiffnesses, half_contact: float, half_flight: float, seed: int = 0
) -> list[tuple[float, float, np.ndarray]]:
    """Half the time of contact, of flight, and the flight state (2 N,) at lift-off, of the roots for linear springs.

    masses, stiffnesses : (N,), (N - 1,), from the top
    half_contact, half_flight : the longest that are looked for
    seed : of the quasi-random pairs of times from which Newton's method starts, until they find nothing new; of long
        chains another seed may find some more

    From rest each vibration mode is a cosine, so that the speeds at lift-off are a linear function of the positions
    there, by the contact before and by the flight after it. The lowest spring carries the lowest mass, which gives one
    position; that both speeds agree for all masses above it gives the others. What is left are two equations in the two
    times alone: both speeds of that mass agree, and the lowest one has none (Pankov 2021, section 1).
    """
    from scipy.stats import qmc

    chain = _LinearChain(np.array(masses, dtype=float), np.array(stiffnesses, dtype=float))
    longest = np.array([number("half_contact", half_contact, 0, 1e4), number("half_flight", half_flight, 0, 1e4)])
    pairs, found, idle = qmc.Sobol(2, seed=seed), np.zeros((0, 2)), 0
    while idle < IDLE:
        times = chain.roots(pairs.random(BATCH) * longest, longest)
        times = times[(times > SMALLEST * longest).all(1) & (times <= longest).all(1)]
        before = len(found)
        for pair in times:
            if not len(found) or np.abs(found - pair).max(1).min() > SAME_TIMES * pair.max():
                found = np.vstack([found, pair])
        idle = idle + 1 if len(found) == before else 0
    if not len(found):
        return []
    found = found[np.lexsort(found.T[::-1])]
    after = np.stack(chain.lifted(found)[:2], axis=2).reshape(len(found), -1)
    # else the lowest mass would be pushed into the ground
    return [(*times.tolist(), state) for times, state in zip(found, after, strict=True) if state[-3] > 0]


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

    def lifted(self, times):
        """Positions and speeds (m, N) at lift-off for half times (m, 2) of contact and flight, the speeds by the flight
        after it, and those (m, N - 1) by the contact before."""
        m, n, upper = self.weights, self.size - 1, self.size - 2
        contact, flight = times[:, :1], times[:, 1:]
        upward = -self.contact * np.tan(self.contact * contact)
        before = np.zeros((len(times), n, n + 1), dtype=times.dtype)
        before[:, :, :n] = (self.standing * upward[:, None]) @ self.standing.T * m[:n]
        start = -before[:, :, :n] @ self.rest
        after = (self.modes * (self.flight * np.tan(self.flight * flight))[:, None]) @ self.modes.T * m
        thrown = self.modes[:, 0] * (self.modes[:, 0] @ m) * flight
        x = np.zeros((len(times), n + 1), dtype=times.dtype)
        x[:, upper] = m[-1] / self.k[-1]
        apart = before[:, :upper] - after[:, :upper]
        right = thrown[:, :upper] - start[:, :upper] - apart[:, :, upper] * x[:, [upper]]
        square = apart[:, :, :upper]
        sound = np.isfinite(square).all((1, 2)) & (np.linalg.det(square) != 0)
        square = np.where(sound[:, None, None], square, np.eye(upper))
        x[:, :upper] = np.where(sound[:, None], np.linalg.solve(square, right[..., None])[..., 0], np.nan)
        return x, (after @ x[..., None])[..., 0] + thrown, (before @ x[..., None])[..., 0] + start

    def residual(self, times):
        """What is left (m, 2) at lift-off: the two speeds of the mass above the lowest, and that of the lowest."""
        _, after, before = self.lifted(times)
        return np.stack([after[:, -2] - before[:, -1], after[:, -1]], axis=1)

    def roots(self, times, longest) -> np.ndarray:
        """The roots (r, 2) to which Newton's method comes from half times (m, 2)."""
        farthest = 0.5 / self.flight.max()  # less than a period, since the equations repeat with it
        with np.errstate(all="ignore"):  # what comes to a pole of the tangents is left out
            for _ in range(NEWTON):
                (a, c), (b, d) = (self.residual(times + 1e-30j * unit).imag.T * 1e30 for unit in np.eye(2))
                f, g = self.residual(times).T
                change = np.stack([b * g - d * f, c * f - a * g], axis=1) / (a * d - b * c)[:, None]
                times = times + np.clip(change, -farthest, farthest)
                times = times[np.isfinite(times).all(1) & (np.abs(times) < 2 * longest).all(1)]
            left = self.residual(times)
        return times[(np.abs(left) < 1e-9 * (1 + self.weights.sum())).all(1)]


def _mass_names(count: int) -> tuple[str, ...]:
    return tuple(f"m{i}" for i in range(1, count + 1))


@lru_cache(maxsize=64)
def _chain_model(springs: tuple[Key, ...]) -> Model:
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

    def field(x, p, q):
        """Of flight, or of contact, where the lowest mass is not among the states."""
        positions = [*x[::2], 0.0][:count]
        pairs = zip(x[1::2], forces(positions, p, q), names, strict=False)
        return [rate for speed, force, m in pairs for rate in (speed, force / p[m])]

    def gradient(x, p, q):
        positions = [*x[::2], 0.0][:count]
        pairs = zip(x[1::2], forces(positions, p, q), names, strict=False)
        return [part for speed, force, m in pairs for part in (-force, p[m] * speed)]

    def heights(p):
        whole = sum(p[m] for m in names)
        masses = {f"mass {i + 1}": Affine(tuple(eye[2 * i])) for i in range(count)}
        return {**masses, "centre of mass": Affine(tuple(sum(p[m] * eye[2 * i] for i, m in enumerate(names)) / whole))}

    def no_numbers(family, p):
        raise NoOrbit("the hops of a chain have no family numbers: give `find` a start, as Chain.starts makes them")

    def lifted(p):
        return Liftoff(1.0 - p[names[-1]], "the weight of the lowest mass").extension(from_key(springs[-1], p))

    def release(alpha, p):
        if count > 2:
            raise InputError("a launch of a chain is more than a speed: give the flight state")
        return np.full(np.shape(alpha), lifted(p))

    own = {f"y{count - 1}": "liftoff", f"y{count - 1}'": "alpha"}
    launched = states[:-2]
    return Model(
        name=f"chain of {count} masses",
        flight=Phase("flight", states, field),
        contact=Phase(
            "contact",
            launched,
            field,
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
        flight_gradient=gradient,
        contact_gradient=gradient,
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
