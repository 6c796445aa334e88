"""A chain: N masses in a column joined by springs, of which the lowest lands plastically.

Units: whatever the masses, the springs' forces and their extensions are stated in, with gravity 1. Flight state
(y1, y1', ..., yN, yN'), from the top, positions counted from the unstretched column with its lowest mass on the ground;
r_i = y_i - y_{i+1} is the extension of spring i with force phi_i, and in flight

    m_i y_i'' = phi_{i-1}(r_{i-1}) - phi_i(r_i) - m_i,

in contact the same with y_N = 0, until the lowest spring carries the lowest mass, phi_{N-1}(y_{N-1}) = m_N. A lossless
hop is its own mirror image in time, from rest in mid-contact to rest in mid-flight. For N = 2 the chain is the hopper
with mass ratio m2/m1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from orbits import find, follow
from orbits.errors import FlowError, InputError, NoOrbit
from orbits.flow.flow import flow_of
from orbits.io import one_line
from orbits.model.model import Model, as_derived
from orbits.model.phase import Affine, Phase
from orbits.symbolic.exclusive import exclusive, exclusive_property

from .launch import Liftoff
from .laws import Key, Law, Parameters, Scalars, coefficient_of_restitution, from_key, number
from .machine import Stated
from .springs import as_spring

MOST_MASSES = 12
# The springs' own laws are brought in along this parameter, from 0 to 1.
LAW_SHARE = "share_of_the_springs_own_law"
# The longest step along it, as a share, and the most points: hops that need more are left out.
LONGEST_LAW_STEP, MOST_LAW_POINTS = 0.1, 100
# Newton's method starts together from this many quasi-random pairs of phase times, takes this many steps, and is
# repeated until so many batches in a row bring no new root.
BATCH, NEWTON_STEPS, IDLE_BATCHES = 1024, 60, 4
# Roots closer than this, as a share of the times, are one; the largest residual of one is a share of 1 + the weight.
SAME_ROOT, LARGEST_RESIDUAL = 1e-7, 1e-9
# Of phase times, as a share of the longest; shorter hops have shrunk to nothing, a root for many contacts.
SHORTEST_PHASE = 1e-3


@dataclass(frozen=True, repr=False)
class Chain(Stated):
    """N masses in a column joined by N - 1 springs.

    masses : (N,), from the top, N from 2 to 12
    springs : a spring as in `TwoMassMachine`, for all, or (N - 1,) of them, from the top; smooth, parameters in common
    restitution : of the impacts of the lowest mass, 0 <= e <= 1
    parameters : values of the formulas' names
    """

    masses: Sequence[float] = (1.0, 1.0, 1.0)
    springs: Any = "r"
    restitution: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)

    units = None
    rest_length = None

    @exclusive
    def __post_init__(self) -> None:
        if np.ndim(self.masses) != 1 or not isinstance(self.parameters, Mapping):
            told = "a list of masses, from the top, and a mapping of its springs' parameters"
            raise InputError(f"a chain is told by {told}")
        masses = tuple(number(f"m{i}", m, low=0) for i, m in enumerate(self.masses, 1))
        if not 2 <= len(masses) <= MOST_MASSES:
            raise InputError(f"a chain has from 2 to {MOST_MASSES} masses, not {len(masses)}")
        coefficient_of_restitution(self.restitution)
        given = self.springs if isinstance(self.springs, list | tuple) else [self.springs] * (len(masses) - 1)
        if len(given) != len(masses) - 1:
            raise InputError(f"{len(masses)} masses are joined by {len(masses) - 1} springs, not {len(given)}")
        springs = tuple(as_spring(law, self.parameters, shared=True) for law in given)
        if piecewise := [law.text for law in springs if law.pieces]:
            raise InputError(f"spring '{piecewise[0]}' is piecewise; a chain takes smooth ones")
        parameters = self._common_parameters(springs, _mass_names(len(masses)))
        for name, value in (("masses", masses), ("springs", springs), ("parameters", parameters)):
            object.__setattr__(self, name, value)

    def _common_parameters(self, springs: tuple[Law, ...], masses: tuple[str, ...]) -> dict[str, float]:
        """The parameters of all springs; raises `InputError` for unknown, reserved and ambiguous names."""
        known = {name: value for law in springs for name, value in law.parameters.items()}
        if unknown := [name for name in self.parameters if name not in known]:
            raise InputError(f"no spring has a parameter '{unknown[0]}'; the chain has {', '.join([*masses, *known])}")
        if taken := [name for name in known if name in masses]:
            raise InputError(f"'{taken[0]}' is a mass; call the formula's parameter something else")
        if any(law.parameters[name] != known[name] for law in springs for name in law.parameters):
            raise InputError("two springs have a parameter of one name with different values; rename one")
        return known

    @exclusive_property
    def model(self) -> Model:
        """The phases and orbits of the chain; chains that differ only in numbers share it."""
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

    def __repr__(self) -> str:
        texts = tuple(law.text for law in self.springs)
        springs = texts if len(set(texts)) > 1 else texts[0]
        bounces = {"restitution": self.restitution} if self.restitution else {}
        return one_line(self, {**self.parameters, "masses": self.masses, "springs": springs, **bounces})

    def describe(self) -> dict[str, Any]:
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

        Raises `NoOrbit` when the motion from there cannot be followed.
        """
        rest = np.zeros(2 * len(self.masses) - 2)
        if np.shape(positions) != (len(self.masses) - 1,):
            raise InputError(f"positions = {positions!r}; they are {len(self.masses) - 1} numbers, from the top")
        rest[::2] = positions
        flow, p = flow_of(self.model.contact, tuple(self.values)), list(self.values.values())
        try:
            path, _ = flow.run(rest, p, number("half_contact", half_contact, low=0))
        except FlowError as error:
            raise NoOrbit(f"the contact cannot be followed from rest at {positions}: {error}") from None
        liftoff = dict(zip(self.model.contact.states, path.end[: len(rest)].tolist(), strict=True))
        return self._launch(liftoff, half_contact, number("half_flight", half_flight, low=0))

    def starts(self, half_contact: float, half_flight: float, seed: int = 0) -> list[dict[str, float]]:
        """Starts for `find_all`: the hops with phase times up to these.

        For linear springs they are those of `linear_orbits`. Other springs are brought in step by step, from the linear
        ones with their slopes at rest, and each hop is followed. Hops that end on the way are left out, as are hops
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
        return [led for start in starts if (led := _led_to_own_laws(straight, start))]

    def _launch(self, liftoff: Mapping[str, float], half_contact: float, half_flight: float) -> dict[str, float]:
        """The unknowns of half an orbit from the state at lift-off by name."""
        above = len(self.masses) - 1  # the mass above the lowest, whose extension and speed tell the lift-off
        own = {"liftoff": liftoff[f"y{above}"], "alpha": liftoff[f"y{above}'"]}
        others = {name: liftoff[name] for name in self.model.launch_unknowns if name not in own}
        return {**own, **others, "duration": half_flight, "contact_duration": half_contact}


def _blend(law: Law, slope: float) -> Law:
    """A law that goes from a straight line to a spring's own as the parameter `LAW_SHARE` goes from 0 to 1."""

    def mixed(x, p, q):
        return p[LAW_SHARE] * law.expression(x, p, q) + (1 - p[LAW_SHARE]) * slope * x

    return Law(law.text, "r", mixed, {**law.parameters, LAW_SHARE: 0.0})


def _led_to_own_laws(straight: Chain, start: dict[str, float]) -> dict[str, float] | None:
    """The start of the hop to which one of the straight springs leads, None where that ends on the way."""
    try:
        orbit = find(straight, start=start)
        family = follow(straight, LAW_SHARE, 1.0, orbit=orbit, longest=LONGEST_LAW_STEP, most=MOST_LAW_POINTS)
    except NoOrbit:
        return None
    return dict(zip(straight.model.half_unknowns, family[-1].u, strict=True)) if family.end.kind == "reached" else None


def _mass_names(count: int) -> tuple[str, ...]:
    return tuple(f"m{i}" for i in range(1, count + 1))


class _ChainEquations:
    """The functions of a chain's model, see `Model` for their arguments."""

    def __init__(self, springs: tuple[Key, ...]):
        self.springs, self.count = springs, len(springs) + 1
        self.masses, self.lowest = _mass_names(self.count), f"m{self.count}"
        self.states = tuple(f"y{i}{dot}" for i in range(1, self.count + 1) for dot in ("", "'"))
        # The mass above the lowest gives the lift-off, so that its states have the names of the unknowns there.
        own = {f"y{self.count - 1}": "liftoff", f"y{self.count - 1}'": "alpha"}
        self.launched = tuple(own.get(name, name) for name in self.states[:-2])

    def _moving(self, x: Scalars, p: Parameters, q: Scalars) -> list[tuple[Any, Any, Any]]:
        """(m, velocity, upward force) of each mass, in contact without the lowest."""
        positions = [*x[::2], 0.0][: self.count]
        pulls = [
            spring.expression(upper - lower, p, q)
            for spring, upper, lower in zip(self.springs, positions[:-1], positions[1:], strict=True)
        ]
        forces = [up - down - p[m] for m, up, down in zip(self.masses, [0, *pulls], [*pulls, 0], strict=True)]
        return [(p[m], v, force) for m, v, force in zip(self.masses, x[1::2], forces, strict=False)]

    def field(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        return [rate for m, v, force in self._moving(x, p, q) for rate in (v, force / m)]

    def gradient(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        return [part for m, v, force in self._moving(x, p, q) for part in (-force, m * v)]

    def contact_force(self, x: Scalars, p: Parameters, q: Scalars) -> Any:
        return p[self.lowest] - self.springs[-1].expression(x[-2], p, q)

    def liftoff(self, u: Parameters, p: Parameters, q: Scalars) -> Any:
        return self.springs[-1].expression(u["liftoff"], p, q) - p[self.lowest]

    def touchdown(self, u: Parameters, p: Parameters) -> list[Any]:
        return [sign * u[name] for name, sign in zip(self.launched, (1, -1) * (self.count - 1), strict=True)]

    def heights(self, p: Parameters) -> dict[str, Affine]:
        eye, whole = np.eye(2 * self.count), sum(p[m] for m in self.masses)
        masses = {f"mass {i + 1}": Affine(tuple(eye[2 * i])) for i in range(self.count)}
        centre = sum(p[m] * eye[2 * i] for i, m in enumerate(self.masses)) / whole
        return {**masses, "centre of mass": Affine(tuple(centre))}

    def release(self, alpha: ArrayLike, p: Mapping[str, float]) -> np.ndarray:
        if self.count > 2:
            raise InputError("a launch of a chain is more than a speed: give the flight state")
        liftoff = Liftoff(1.0 - p[self.lowest], "the weight of the lowest mass")
        return np.full(np.shape(alpha), liftoff.extension(from_key(self.springs[-1], p)))

    @staticmethod
    def guess(family: int, p: Mapping[str, float]) -> dict[str, float]:
        raise NoOrbit("the hops of a chain have no family numbers: give `find` a start, as Chain.starts makes them")


@lru_cache(maxsize=64)
def _chain_model(springs: tuple[Key, ...]) -> Model:
    """The model of the keys of the springs' laws, from the top."""
    equations, count = _ChainEquations(springs), len(springs) + 1
    eye, above = np.eye(2 * count), 2 * count - 4  # the state of the mass above the lowest
    others = tuple(name for name in equations.launched if name not in ("liftoff", "alpha"))
    model = Model(
        name=f"chain of {count} masses",
        flight=Phase("flight", equations.states, equations.field),
        contact=Phase("contact", equations.states[:-2], equations.field, {"contact force": equations.contact_force}),
        launch=lambda u, p: [*(u[name] for name in equations.launched), 0.0, 0.0],
        launch_unknowns=("liftoff", "alpha", *others),
        liftoff=equations.liftoff,
        landing=lambda u, x, p: [x[-2], x[-1], x[above] - u["liftoff"]],
        reversor=(1, -1) * count,
        release=equations.release,
        touchdown=equations.touchdown,
        embed=np.eye(2 * count, 2 * count - 2),
        flight_gradient=equations.gradient,
        contact_gradient=equations.gradient,
        extension=Affine(tuple(eye[above] - eye[-2])),
        gap=lambda p: Affine(tuple(eye[-2])),
        separation=lambda p: None,
        heights=equations.heights,
        impact_mass=lambda p: p[equations.lowest],
        impact=lambda p: eye[-1],
        contact_speed=Affine(tuple(eye[above + 1, : 2 * count - 2])),
        violations={
            "gap": "lowest mass below ground",
            "pull": "the ground would have to pull",
            "separation": "the masses pass through each other",
            "end": "contact: the springs collapse, the lowest mass never lifts off again",
        },
        springs=tuple((f"mass {i + 2}", f"mass {i + 1}") for i in range(count - 1)),
        guess=equations.guess,
    )
    return as_derived(model)


def linear_orbits(
    masses: Sequence[float], stiffnesses: Sequence[float], half_contact: float, half_flight: float, seed: int = 0
) -> list[tuple[float, float, np.ndarray]]:
    """Half the time of contact, of flight, and the flight state (2 N,) at lift-off, of the roots for linear springs.

    masses, stiffnesses : (N,), (N - 1,), from the top
    half_contact, half_flight : the longest that are looked for
    seed : of the quasi-random pairs of times from which Newton's method starts, until they find nothing new; for long
        chains another seed may find some more

    From rest each vibration mode is a cosine, so that the speeds at lift-off are a linear function of the positions
    there, both by the contact before lift-off and by the flight after it. The lowest spring carries the lowest mass,
    which gives one position; that the two speeds of each mass agree for all masses above it gives the others. Two
    equations in the two times are left: the two speeds of that mass agree, and the lowest mass has none (Pankov 2021,
    section 1).
    """
    from scipy.stats import qmc

    modes = _ChainModes(np.array(masses, dtype=float), np.array(stiffnesses, dtype=float))
    longest = np.array([number("half_contact", half_contact, 0, 1e4), number("half_flight", half_flight, 0, 1e4)])
    pairs, roots, idle = qmc.Sobol(2, seed=seed), np.zeros((0, 2)), 0
    while idle < IDLE_BATCHES:
        times = modes.roots(pairs.random(BATCH) * longest, longest)
        times = times[(times > SHORTEST_PHASE * longest).all(1) & (times <= longest).all(1)]
        before = len(roots)
        for pair in times:
            if not len(roots) or np.abs(roots - pair).max(1).min() > SAME_ROOT * pair.max():
                roots = np.vstack([roots, pair])
        idle = idle + 1 if len(roots) == before else 0
    if not len(roots):
        return []
    roots = roots[np.lexsort(roots.T[::-1])]
    states = np.stack(modes.liftoffs(roots)[:2], axis=2).reshape(len(roots), -1)
    # The mass above the lowest one rises at lift-off, or else the lowest would be pushed into the ground.
    return [(*times.tolist(), state) for times, state in zip(roots, states, strict=True) if state[-3] > 0]


class _ChainModes:
    """The vibration modes of a linear chain of N masses in flight and in contact."""

    def __init__(self, masses: np.ndarray, stiffnesses: np.ndarray):
        self.masses, self.liftoff = masses, masses[-1] / stiffnesses[-1]
        tension = np.diff(np.eye(len(masses)), axis=0)
        stiffness = tension.T @ (stiffnesses[:, None] * tension)
        square, modes = np.linalg.eigh(stiffness / np.sqrt(np.outer(masses, masses)))
        self.flight_frequencies, self.flight_modes = np.sqrt(np.maximum(square, 0.0)), modes / np.sqrt(masses)[:, None]
        self.flight_frequencies[0] = 0.0  # the mode in which all masses fall together
        upper = masses[:-1]
        square, modes = np.linalg.eigh(stiffness[:-1, :-1] / np.sqrt(np.outer(upper, upper)))
        self.contact_frequencies, self.contact_modes = np.sqrt(square), modes / np.sqrt(upper)[:, None]
        self.equilibrium = -np.linalg.solve(stiffness[:-1, :-1], upper)

    def liftoffs(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions (m, N) at lift-off for half times (m, 2) of contact and flight, the speeds (m, N) there by the
        flight after it, and the speeds (m, N - 1) by the contact before it."""
        masses, n = self.masses, len(self.masses) - 1
        last = n - 1  # the mass above the lowest, whose position at lift-off is known
        contact, flight = times[:, :1], times[:, 1:]
        # Speeds by the contact: before @ x + before_rest. Speeds by the flight: after @ x + after_rest.
        rates = -self.contact_frequencies * np.tan(self.contact_frequencies * contact)
        before = np.zeros((len(times), n, n + 1), dtype=times.dtype)
        before[:, :, :n] = (self.contact_modes * rates[:, None]) @ self.contact_modes.T * masses[:n]
        before_rest = -before[:, :, :n] @ self.equilibrium
        rates = self.flight_frequencies * np.tan(self.flight_frequencies * flight)
        after = (self.flight_modes * rates[:, None]) @ self.flight_modes.T * masses
        after_rest = self.flight_modes[:, 0] * (self.flight_modes[:, 0] @ masses) * flight
        x = np.zeros((len(times), n + 1), dtype=times.dtype)
        x[:, last] = self.liftoff
        difference = before[:, :last] - after[:, :last]
        right = after_rest[:, :last] - before_rest[:, :last] - difference[:, :, last] * x[:, [last]]
        square = difference[:, :, :last]
        regular = np.isfinite(square).all((1, 2)) & (np.linalg.det(square) != 0)
        square = np.where(regular[:, None, None], square, np.eye(last))
        x[:, :last] = np.where(regular[:, None], np.linalg.solve(square, right[..., None])[..., 0], np.nan)
        return x, (after @ x[..., None])[..., 0] + after_rest, (before @ x[..., None])[..., 0] + before_rest

    def residual(self, times: np.ndarray) -> np.ndarray:
        """Residuals (m, 2) at lift-off: the two speeds' difference of the mass above the lowest, the lowest's speed."""
        _, after, before = self.liftoffs(times)
        return np.stack([after[:, -2] - before[:, -1], after[:, -1]], axis=1)

    def roots(self, times: np.ndarray, longest: np.ndarray) -> np.ndarray:
        """The roots (r, 2) to which Newton's method converges from half times (m, 2), with complex-step derivatives."""
        farthest = 0.5 / self.flight_frequencies.max()  # less than a period, with which the equations repeat
        with np.errstate(all="ignore"):  # times that come to a pole of the tangents are dropped
            for _ in range(NEWTON_STEPS):
                (a, c), (b, d) = (self.residual(times + 1e-30j * unit).imag.T * 1e30 for unit in np.eye(2))
                f, g = self.residual(times).T
                change = np.stack([b * g - d * f, c * f - a * g], axis=1) / (a * d - b * c)[:, None]
                times = times + np.clip(change, -farthest, farthest)
                times = times[np.isfinite(times).all(1) & (np.abs(times) < 2 * longest).all(1)]
            residual = self.residual(times)
        return times[(np.abs(residual) < LARGEST_RESIDUAL * (1 + self.masses.sum())).all(1)]
