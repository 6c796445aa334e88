"""Relations between the fields of a model that follow from mechanics, each of which holds or does not.

y are the positions, v their speeds, a the gap's weights of the positions, d the impact's change of the speeds, M the
inertia: the derivative of the energy's gradient by v. In a plastic impact, M d = m a with a . d = 1, where m is the
impact's mass; in contact the ground holds the gap closed, so that its accelerations are those of flight less d times
the gap's acceleration in flight.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import casadi as ca
import numpy as np

from ..laws.law import Algebraic
from ..model.model import Model, names_of_holding
from ..model.phase import Affine
from ..model.state_formula import StateFormula
from .draws import Draw, Expressions, coordinates, reversor_of

# A relation that is exact holds to this share of its terms: rounding is far below, a mistake in a model far above.
LARGEST_DEVIATION = 1e-8
CENTRE = "centre of mass"


@dataclass(frozen=True)
class Relation:
    """A relation: in words, the fields of the model that it joins, and by which share it does not hold."""

    words: str
    fields: tuple[str, ...]
    deviation: float
    bound: float = LARGEST_DEVIATION

    @property
    def holds(self) -> bool:
        """Whether the deviation is rounding."""
        return self.deviation <= self.bound


def share(residual: Algebraic, *magnitudes: Algebraic) -> float:
    """The largest residual as a share of the largest of the magnitudes; infinite where one is no number."""
    largest = float(np.max(np.abs(residual), initial=0.0))
    size = max((float(np.max(np.abs(each), initial=0.0)) for each in magnitudes), default=1.0)
    if largest == 0:
        return 0.0
    return largest / size if np.isfinite(largest) and np.isfinite(size) and size > 0 else np.inf


def motion(model: Model, draw: Draw) -> Iterator[Relation]:
    """The two fields: their positions, their energy, and how the ground holds the one to make the other."""
    for where, phase, states, field in (
        ("flight", model.flight, draw.x, draw.flown["field"]),
        ("contact", model.contact, draw.y, draw.stood["field"]),
    ):
        at, rates = coordinates(phase)
        words = f"positions in {where} change at their speeds"
        yield Relation(words, (f"{where}.field",), share(field[:, at] - states[:, rates], states))
    embed, d, a = np.asarray(model.embed), draw.held["impact"], _gap_acceleration(model, draw)
    (at, rates), (stood_at, stood_rates) = coordinates(model.flight), coordinates(model.contact)
    differ = embed[np.ix_(at, stood_at)] - embed[np.ix_(rates, stood_rates)]
    mixed = [embed[np.ix_(at, stood_rates)], embed[np.ix_(rates, stood_at)]]
    words = "embed makes positions of positions alone, and speeds of speeds in the same way"
    yield Relation(words, ("embed",), share([*mixed, differ], embed))
    held, stood = draw.held["field"], draw.stood["field"] @ embed.T
    fields: tuple[str, ...] = ("contact.field", "flight.field", "embed", "impact", "gap")
    words = "the ground holds the gap closed: contact.field is flight.field along it"
    along = (
        held
        - (held @ a)[:, None] * d
        - np.einsum("ki,kji->kj", held @ _sticking_rates(model), _sticking_directions(draw))
    )
    yield Relation(words, fields, share(stood - along, held, stood))
    masses, (force, *holding) = _shape_of_masses(draw), _forces_in_contact(model, draw)
    closing, *others = _closing(model, draw)
    unit, by_mass = _force_of_closing(force, closing), ("impact_mass",) if np.ptp(masses) > LARGEST_DEVIATION else ()
    words, fields = "the contact force is in proportion to what closes the gap", ("contact.watch", "flight.field")
    fields += ("embed", "gap", *by_mass)
    deviation = share(force - unit * closing, force) if unit > 0 else np.inf
    yield Relation(words, fields, deviation)
    for held_by, other in zip(holding, others, strict=True):
        words, fields = "the force on what sticks holds it", ("contact.watch", "flight.field", "embed", "sticking")
        yield Relation(words, fields, share(held_by - unit * other, held_by, force))


def energy(model: Model, draw: Draw) -> Iterator[Relation]:
    """The gradients of the energy: along the fields, of each other, and of the changes by impacts."""
    terms = {"flight": draw.flown, "contact": draw.stood}
    works = {where: at["gradient"] * at["field"] for where, at in terms.items()}
    change = {where: share(work.sum(1), work) for where, work in works.items()}
    grows = {where: share(np.maximum(work.sum(1), 0.0), work) for where, work in works.items()}
    damped = max(grows.values()) <= LARGEST_DEVIATION < min(change.values())
    if model.conservative:
        yield Relation("energy is not lost in both phases", ("conservative",), max(change.values()) if damped else 0.0)
    steady = model.conservative and not damped
    for where, fields in (("flight", ("flight_gradient",)), ("contact", ("flight_gradient", "embed"))):
        words = f"energy {'is conserved' if steady else 'does not grow'} in {where}"
        if not model.driven:
            yield Relation(words, (f"{where}.field", *fields), (change if steady else grows)[where])
    hessian = draw.flown["hessian"]
    asymmetry = share(hessian - hessian.swapaxes(1, 2), hessian)
    yield Relation("flight_gradient is the gradient of a function", ("flight_gradient",), asymmetry)
    _, rates = coordinates(model.flight)
    inertia = _inertias(draw.flown, rates)
    least = np.linalg.eigvalsh(inertia).min() if inertia.size and np.isfinite(inertia).all() else np.nan
    yield Relation("the kinetic energy is not below 0", ("flight_gradient",), share(min(least, 0.0), inertia))
    yield from _impact(model, draw)


def _impact(model: Model, draw: Draw) -> Iterator[Relation]:
    """Impacts where the gap is closed."""
    at, rates = coordinates(model.flight)
    if model.sticking:
        yield from _sticking_impact(model, draw)
        return
    direction, mass = draw.held["impact"], draw.held["mass"]
    a, d = np.array(model.gap(draw.p).weights, float)[at], direction[:, rates]
    others = np.delete(direction, rates, axis=1)
    yield Relation("an impact changes speeds alone", ("impact",), share(others, direction))
    yield Relation("along impact the gap's speed changes by 1", ("gap", "impact"), share(d @ a - 1.0, 1.0))
    momentum = np.einsum("kij,kj->ki", _inertias(draw.held, rates), d)
    words = "an impact changes the momentum along the gap alone, by impact_mass"
    fields = ("impact_mass", "impact", "gap", "flight_gradient")
    yield Relation(words, fields, share(momentum - mass * a, momentum, mass * a))
    words, lost = "impact_mass is that of the impact's kinetic energy", (momentum * d).sum(1, keepdims=True)
    yield Relation(words, ("impact_mass", "impact", "flight_gradient"), share(lost - mass, lost, mass))


def _sticking_impact(model: Model, draw: Draw) -> Iterator[Relation]:
    """Impacts that bring the speeds of the gap and of what sticks to 0."""
    at, rates = coordinates(model.flight)
    directions = np.concatenate([draw.held["impact"][:, :, None], _sticking_directions(draw)], axis=2)
    gradients = np.column_stack([np.array(model.gap(draw.p).weights, float)[at], _sticking_rates(model)[rates]])
    others, d = np.delete(directions, rates, axis=1), directions[:, rates]
    yield Relation("an impact changes speeds alone", ("impact", "sticking"), share(others, directions))
    words, off = "along impact the speed of each changes by 1", gradients.T @ d - np.eye(d.shape[2])
    yield Relation(words, ("gap", "impact", "sticking"), share(off, 1.0))
    momentum, masses = _inertias(draw.held, rates) @ d, draw.held["masses"]
    words = "an impact changes the momentum along the gap and what sticks alone, by their masses"
    fields = ("sticking", "impact", "gap", "flight_gradient")
    yield Relation(words, fields, share(momentum - gradients @ masses, momentum))
    off = masses[:, 0, 0] - draw.held["mass"][:, 0]
    yield Relation("impact_mass is the first of the masses", ("impact_mass", "sticking"), share(off, masses))


def _sticking_rates(model: Model) -> np.ndarray:
    """The weights (n, sticks) of the rates of what sticks in a flight state."""
    rows = [model.flight.states.index(f"{name}'") for name in model.sticks]
    return np.eye(len(model.flight.states))[:, rows]


def _sticking_directions(draw: Draw) -> np.ndarray:
    """The directions (N, n, sticks) of what sticks."""
    shape = draw.held["impact"].shape
    return draw.held["directions"].reshape(*shape, -1) if "directions" in draw.held else np.zeros((*shape, 0))


def _forces_in_contact(model: Model, draw: Draw) -> list[np.ndarray]:
    """The contact force (N,) and those on what sticks."""
    return [draw.stood[name][:, 0] for name in ("force", *names_of_holding(model.sticks))]


def _closing(model: Model, draw: Draw) -> list[np.ndarray]:
    """What holds the gap closed (N,) and what sticks at rest, in the unit of the impact's mean mass."""
    held, a = draw.held["field"], _gap_acceleration(model, draw)
    if not model.sticking:
        return [-(held @ a) * _shape_of_masses(draw)]
    opening = np.column_stack([held @ a, held @ _sticking_rates(model)])
    return list(-np.einsum("kij,kj->ik", draw.held["masses"], opening) / draw.held["mass"].mean())


def launches(model: Model, draw: Draw) -> Iterator[Relation]:
    """The launch set: where the contact force vanishes."""
    if not model.derived:
        u, launch = draw.free["u"], draw.free["launch"]
        words, off = "liftoff is the extension at launch", model.extension(launch) - u[:, 0]
        yield Relation(words, ("extension", "embed"), share(off, u))
    if draw.released:
        words, size = "the contact force vanishes at the launches of release", draw.released["slopes"][:, 0]
        off = share(draw.released["force"], size * draw.length, draw.stood["force"])
        yield Relation(words, ("release", "contact.watch"), off)


def reversal(model: Model, draw: Draw) -> Iterator[Relation]:
    """Time reversal turns motions into motions."""
    if model.reversor is None:
        return
    signs, (at, rates) = reversor_of(model), coordinates(model.flight)
    words = "the reversor gives a speed the sign that its position has not"
    yield Relation(words, ("reversor",), share(signs[at] + signs[rates], 1.0))
    own = ("reversor", "reversor_shift") if model.reversor_shift else ("reversor",)
    both = (*own, "symmetry", "symmetry_shift") if model.symmetry else own
    for where, names, field, back in (
        ("flight", (*own, "flight.field"), draw.flown, draw.mirrored),
        ("contact", (*both, "contact.field", "embed"), draw.stood, draw.mirrored_contact),
    ):
        mirror = signs if where == "flight" else np.array(model.mirror)
        residual = back["field"] * mirror + field["field"]
        yield Relation(f"the reversor turns motions in {where} back", names, share(residual, field["field"]))
    if model.plain:
        return
    p, embed = draw.p, np.asarray(model.embed, float)
    there = model.relabelling.after(model.reversal)(draw.y @ embed.T, p)
    words, off = "the reversor of the contact keeps the gap closed", there - model.contact_reversal(draw.y, p) @ embed.T
    yield Relation(words, (*both, "embed"), share(off, there))
    image, closes = model.reversal.of(model.gap(p), p), model.landing_gap(p) if model.landing_gap else model.gap(p)
    apart = [*np.subtract(image.weights, closes.weights), image.offset - closes.offset]
    names = (*own, "landing_gap") if model.landing_gap else own
    yield Relation("the gap at landing is the image of the gap", names, share(apart, image.weights))
    words, force = "the force on the point that landed is the image of the contact force", draw.stood["force"]
    off = draw.mirrored_contact["force"] - draw.stood.get("landed", force)
    yield Relation(words, (*both, "contact.watch"), share(off, force))


def geometry(model: Model, draw: Draw) -> Iterator[Relation]:
    """Which states are positions, which are speeds, and where the gap is closed."""
    _, rates = coordinates(model.flight)
    p, embed, gap = draw.p, np.asarray(model.embed, float), model.gap(draw.p)
    positions = {"gap": gap, "extension": model.extension, "separation": model.separation(p)}
    for name, function in positions.items():
        if function:
            slopes = _values_and_slopes(function, draw)[:, 1:]
            off = share(slopes[:, rates], slopes) + (0.0 if slopes.any() else np.inf)
            yield Relation(f"{name} is a position", (name,), off)
    risen = np.array([_values_and_slopes(height, draw)[:, 1:] for height in model.heights(p).values()])
    yield Relation("heights are positions", ("heights",), share(risen[:, :, rates], risen))
    closed = np.array(gap.weights, float) @ embed
    yield Relation("embedded states have a closed gap", ("gap", "embed"), share(closed, embed))
    yield Relation("the gap is closed where all coordinates are 0", ("gap",), share(gap.offset))
    if model.flight.pieces and model.contact.pieces:
        own, flown = (np.array(each.coordinate, float) for each in (model.contact.pieces, model.flight.pieces))
        words, fields = "the pieces in contact are those in flight", ("contact.pieces", "flight.pieces", "embed")
        yield Relation(words, fields, share(flown @ embed - own, own))
    if model.rest:
        rest = np.asarray(model.rest(p), float)
        words = "at rest the gap is closed and no speed is left"
        yield Relation(words, ("rest", "gap"), share([gap(rest), *rest[rates]], 1.0))


def distances(model: Model, draw: Draw) -> Iterator[Relation]:
    """Gap, separation, extension and knees lie between heights."""
    p, (at, rates) = draw.p, coordinates(model.flight)
    sampled = {name: _values_and_slopes(height, draw) for name, height in model.heights(p).items()}
    masses = [each for name, each in sampled.items() if name != CENTRE]
    pairs = [*masses, *(upper - lower for upper, lower in combinations(masses, 2))]
    words, gap = "the gap is between two of the heights, or one and the ground", _values_and_slopes(model.gap(p), draw)
    off = min(_apart(gap, each) for each in pairs)
    levered = not {*model.gap(p).weights} <= {0.0, 1.0, -1.0}  # as "2*foot - plate"
    if model.derived and (levered or not model.plain):  # an angle that has opened is no height
        words, slopes = "the gap is a sum of multiples of the heights", gap[:, 1:]
        known = (each[:, 1:] for each in np.stack(masses, axis=1))
        off = max(share(own - own @ np.linalg.pinv(of) @ of, own) for own, of in zip(slopes, known, strict=True))
    yield Relation(words, ("gap", "heights"), off)
    if (apart := model.separation(p)) and not model.sticks:  # in the plane it is no difference of heights
        words = "the separation is at most that of two of the heights, or of one and the ground"
        if model.derived:  # a mechanism may count its coordinates from anywhere
            words = "the separation changes as that of two of the heights, or of one and the ground"
        most = min(_apart(_values_and_slopes(apart, draw), each, most=not model.derived) for each in pairs)
        yield Relation(words, ("separation", "heights"), most)
    ends = [sampled[upper] - (sampled[lower] if lower else 0.0) for lower, upper in model.springs]
    if ends and not model.derived:
        words = "the extension is that between the ends of one of the springs"
        least = min(_apart(_values_and_slopes(model.extension, draw), each) for each in ends)
        yield Relation(words, ("extension", "heights", "springs"), least)
    for lower, upper, length in model.knees(p) if model.knees else ():
        by = np.abs(sampled[upper] - (sampled[lower] if lower else 0.0))[:, 0]
        words = "a knee's ends are at most its two links apart"
        yield Relation(words, ("knees", "heights"), share(np.maximum(by - 2 * length, 0.0), 2 * length))
    if CENTRE in sampled:
        yield from _centre_of_mass(np.array(masses), sampled[CENTRE], _inertias(draw.flown, rates), at)


def _values_and_slopes(function: Affine | StateFormula, draw: Draw) -> np.ndarray:
    """The values (N, 1 + n) of a function of the flight state at the states of a draw, before its slopes there."""
    if isinstance(function, Affine):
        slopes = np.tile(np.array(function.weights, float), (len(draw.x), 1))
        return np.column_stack([function(draw.x), slopes])
    x = ca.SX.sym("x", draw.x.shape[1])
    value = function.at(ca.vertsplit(x))
    return Expressions([x, ca.SX(0, 1)], {"seen": ca.horzcat(value, ca.jacobian(value, x)).T})(draw.x, {})["seen"]


def _apart(function: np.ndarray, between: np.ndarray, most: bool = False) -> float:
    """By how much a function of the state differs from the distance of two heights: in its slopes and, with `most`,
    by how much its value is above."""
    (value, *slopes), (distance, *own) = function.T, between.T
    above = share(np.maximum(value - distance, 0.0), value, distance) if most else 0.0
    return max(share(np.subtract(slopes, own), own), above)


def _centre_of_mass(masses: np.ndarray, centre: np.ndarray, inertia: np.ndarray, at: list[int]) -> Iterator[Relation]:
    """The mean of the masses' heights by their weights in the kinetic energy of a motion of all together."""
    heights, slopes = masses[:, :, 0].T[:, :, None], masses[:, :, 1:][:, :, at].swapaxes(0, 1)
    rank = np.linalg.matrix_rank(slopes).min()
    apart = rank == min(slopes.shape[1:])
    yield Relation("the heights tell the masses apart", ("heights",), 0.0 if apart else np.inf)
    shift = np.linalg.pinv(slopes) @ np.ones((slopes.shape[1], 1))
    if rank < len(at) or np.abs(slopes @ shift - 1).max() > LARGEST_DEVIATION:
        return
    momentum = inertia @ shift
    total = shift.swapaxes(1, 2) @ momentum
    if not (total > 0).all():
        return
    mean = momentum / total
    height = (np.linalg.pinv(slopes.swapaxes(1, 2)) @ mean).swapaxes(1, 2) @ heights
    value, slopes_of_centre = centre[:, :1], centre[:, 1:][:, at, None]
    off = max(share(slopes_of_centre - mean, mean), share(value - height[:, :, 0], value, masses[:, :, 0]))
    yield Relation("the centre of mass is where the kinetic energy says", ("heights", "flight_gradient"), off)


def forces(model: Model, draw: Draw) -> Iterator[Relation]:
    """The spring's force and the contact force have one unit, and the spring's is a function of the extension."""
    unit = _force_of_closing(draw.stood["force"][:, 0], _closing(model, draw)[0])
    mass = float(draw.held["mass"].mean())
    scale = mass / unit if unit > 0 and mass > 0 else None  # the unit of energy over those of force and length
    what = ("contact.watch", "impact_mass", "flight.field", "gap", "embed")
    if model.units and scale and (units := model.units(draw.p)).energy:
        stated = units.force * units.length / units.energy
        words = "the contact force is in the unit that units say"
        yield Relation(words, ("units", *what), share(scale / stated - 1.0, 1.0))
    if model.tension is None:
        return
    at, rates = coordinates(model.flight)
    slopes = draw.flown["tension slopes"][:, [*at, *rates]]
    along = np.array(model.extension.weights, float)[[*at, *rates]]
    own = slopes @ along / max(along @ along, np.finfo(float).tiny)
    words = "the tension is a function of the extension"
    yield Relation(words, ("tension", "extension"), share(slopes - np.outer(own, along), slopes))
    inertia, stiffness = (draw.flown["hessian"][:, of][:, :, of] for of in (rates, at))
    if share(inertia - inertia[0], inertia) > LARGEST_DEVIATION or (model.homotopy and draw.p[model.homotopy]):
        return  # links that turn, and gravity that varies, have a part in the stiffness
    shape = np.outer(along[: len(at)], along[: len(at)])
    size = (stiffness * shape).sum((1, 2)) / max((shape**2).sum(), np.finfo(float).tiny)
    if share(stiffness - size[:, None, None] * shape, stiffness) > LARGEST_DEVIATION:
        return  # something else than the spring stores energy
    factor = _force_of_closing(size, own)
    words, fields = "the tension is in proportion to the stiffness", ("tension", "flight_gradient", "extension")
    yield Relation(words, fields, share(size - factor * own, size) if factor > 0 else np.inf)
    if scale:
        words = "tension and contact force have one unit"
        yield Relation(words, (*fields, *what), share(scale - factor, factor))


def _inertias(values: Mapping[str, np.ndarray], rates: list[int]) -> np.ndarray:
    """The inertia matrices at flight states."""
    return values["hessian"][:, rates][:, :, rates]


def _shape_of_masses(draw: Draw) -> np.ndarray:
    """How the impact's mass varies with the state where the gap is closed, about 1."""
    masses = draw.held["mass"][:, 0]
    mean = masses.mean()
    return masses / mean if np.isfinite(masses).all() and mean else np.ones(len(masses))


def _gap_acceleration(model: Model, draw: Draw) -> np.ndarray:
    """Weights (n,) of the gap's acceleration in the rates of the flight state."""
    (at, rates), weights = coordinates(model.flight), np.array(model.gap(draw.p).weights, float)
    found = np.zeros(len(weights))
    found[rates] = weights[at]
    return found


def _force_of_closing(force: np.ndarray, closing: np.ndarray) -> float:
    """The factor that makes the one the other, best on the whole; 0 where there is nothing to compare."""
    with np.errstate(all="ignore"):
        return float(np.nan_to_num((force @ closing) / (closing @ closing), posinf=0.0, neginf=0.0))


# Every kind of relation, as a function of a model and a draw.
MECHANICS: tuple[Callable[[Model, Draw], Iterator[Relation]], ...] = (
    motion, energy, launches, reversal, geometry, distances, forces,
)  # fmt: skip
