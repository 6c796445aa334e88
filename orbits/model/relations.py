"""What follows from mechanics about the fields of a model, each as a relation that holds or does not.

y are the positions, v their speeds, a the gap's weights of the positions, d the impact's change of the speeds, M the
inertia: the derivative of the energy's gradient by v. In a plastic impact, M d = m a with a . d = 1, where m is the
impact's mass; in contact the ground holds the gap closed, so that its accelerations are those of flight less d times
the gap's acceleration in flight.
"""

from collections.abc import Callable, Iterator
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from .draws import Draw, coordinates, reversor_of, signs_in_contact
from .model import Model
from .phase import Affine

# What holds in exact arithmetic does so to this share of the terms: rounding is far below, a slip of the pen far above.
LARGEST_DEVIATION = 1e-8
CENTRE = "centre of mass"


class Relation(NamedTuple):
    """Something that follows: in words, the fields of the model that it joins, and by which share it does not hold."""

    words: str
    fields: tuple[str, ...]
    deviation: float
    bound: float = LARGEST_DEVIATION

    @property
    def holds(self) -> bool:
        """Whether the deviation is rounding."""
        return self.deviation <= self.bound


def share(residual: Any, *magnitudes: Any) -> float:
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
    embed, d, a = np.asarray(model.embed), np.asarray(model.impact(draw.p)), _gap_acceleration(model, draw)
    (at, rates), (stood_at, stood_rates) = coordinates(model.flight), coordinates(model.contact)
    mixed = np.concatenate([embed[np.ix_(at, stood_rates)].ravel(), embed[np.ix_(rates, stood_at)].ravel()])
    yield Relation("embed makes no positions of speeds, nor speeds of positions", ("embed",), share(mixed, embed))
    differ = embed[np.ix_(at, stood_at)] - embed[np.ix_(rates, stood_rates)]
    yield Relation("embed makes speeds of speeds as it makes positions of positions", ("embed",), share(differ, embed))
    held, stood = draw.held["field"], draw.stood["field"] @ embed.T
    fields: tuple[str, ...] = ("contact.field", "flight.field", "embed", "impact", "gap")
    words = "the ground holds the gap closed: contact.field is flight.field along it"
    yield Relation(words, fields, share(stood - (held - np.outer(held @ a, d)), held, stood))
    force, closing = draw.stood["force"][:, 0], -(held @ a)
    unit = _force_of_closing(force, closing)
    words = "the contact force is in proportion to what closes the gap"
    fields = ("contact.watch", "flight.field", "embed", "gap")
    deviation = share(force - unit * closing, force) if unit > 0 else np.inf
    yield Relation(words, fields, deviation)


def energy(model: Model, draw: Draw) -> Iterator[Relation]:
    """The gradients of the energy: along the fields, of each other, and of what impacts change."""
    kept, grows = _powers(draw)
    damped = _loses(draw)
    if model.conservative:
        yield Relation("energy is not lost in both phases", ("conservative",), max(kept.values()) if damped else 0.0)
    steady = model.conservative and not damped
    for where, gradient in (("flight", "flight_gradient"), ("contact", "contact_gradient")):
        words = f"energy {'is conserved' if steady else 'does not grow'} in {where}"
        yield Relation(words, (f"{where}.field", gradient), (kept if steady else grows)[where])
    embed, hessian = np.asarray(model.embed), draw.flown["hessian"]
    words = "contact_gradient is flight_gradient on the ground"
    fields = ("flight_gradient", "contact_gradient", "embed")
    yield Relation(words, fields, share(draw.held["gradient"] @ embed - draw.stood["gradient"], draw.held["gradient"]))
    asymmetry = share(hessian - hessian.swapaxes(1, 2), hessian)
    yield Relation("flight_gradient is the gradient of a function", ("flight_gradient",), asymmetry)
    _, rates = coordinates(model.flight)
    inertia = hessian[np.ix_(range(len(hessian)), rates, rates)]
    least = np.linalg.eigvalsh(inertia).min() if inertia.size and np.isfinite(inertia).all() else np.nan
    yield Relation("the kinetic energy is not below 0", ("flight_gradient",), share(min(least, 0.0), inertia))
    yield from _impact(model, draw, inertia)


def _powers(draw: Draw) -> tuple[dict[str, float], dict[str, float]]:
    """The largest power by phase, as a share of its terms, and the largest above 0."""
    terms = {"flight": draw.flown, "contact": draw.stood}
    works = {where: at["gradient"] * at["field"] for where, at in terms.items()}
    kept = {where: share(work.sum(1), work) for where, work in works.items()}
    return kept, {where: share(np.maximum(work.sum(1), 0.0), work) for where, work in works.items()}


def _loses(draw: Draw) -> bool:
    """Whether energy is lost in both phases, and grows in none."""
    kept, grows = _powers(draw)
    return max(grows.values()) <= LARGEST_DEVIATION < min(kept.values())


def _impact(model: Model, draw: Draw, inertia: np.ndarray) -> Iterator[Relation]:
    at, rates = coordinates(model.flight)
    gap, direction = np.array(model.gap(draw.p).weights, float), np.asarray(model.impact(draw.p), float)
    mass, a, d = float(model.impact_mass(draw.p)), gap[at], direction[rates]
    others = np.delete(direction, rates)
    yield Relation("an impact changes speeds alone", ("impact",), share(others, direction))
    yield Relation("along impact the gap's speed changes by 1", ("gap", "impact"), share(a @ d - 1.0, 1.0))
    momentum = inertia @ d
    words = "an impact changes the momentum along the gap alone, by impact_mass"
    fields = ("impact_mass", "impact", "gap", "flight_gradient")
    yield Relation(words, fields, share(momentum - mass * a, momentum, mass * a))
    words, lost = "impact_mass is that of the impact's kinetic energy", momentum @ d
    yield Relation(words, ("impact_mass", "impact", "flight_gradient"), share(lost - mass, lost, mass))


def launches(model: Model, draw: Draw) -> Iterator[Relation]:
    """The launch set: where the contact force and the gap's acceleration vanish, and its mirror image, where it
    lands."""
    yield from _any_launch(model, draw)
    if not draw.roots:
        return
    roots, at, a = draw.roots, draw.launched, _gap_acceleration(model, draw)
    source = "release" if roots["released"][0] else "liftoff"
    if source == "release":
        off = share(roots["liftoff"], roots["slope"] * draw.length)
        yield Relation("liftoff vanishes at the launches of release", ("liftoff", "release"), off)
    words = f"the gap has no acceleration at the launches of {source}"
    yield Relation(words, (source, "launch", "flight.field", "gap"), share(at["field"] @ a, at["field"]))
    words, forces = f"the contact force vanishes at the launches of {source}", draw.stood["force"]
    yield Relation(words, (source, "launch", "contact.watch", "embed"), share(at["force"], forces))
    yield from _landing(model, draw)


def _any_launch(model: Model, draw: Draw) -> Iterator[Relation]:
    """What holds of launches with any unknowns, also where the contact force would not vanish."""
    u, launch, touchdown = draw.free["u"], draw.free["launch"], draw.free["touchdown"]
    named = dict(zip(model.launch_unknowns, u.T, strict=True))
    embed, gap, scale = np.asarray(model.embed, float), model.gap(draw.p), float(np.abs(u).max())
    down, mirrored = np.linalg.pinv(embed), ("reversor",) if model.reversor else ()
    yield Relation("a launch has a closed gap", ("launch", "gap"), share(gap(launch), scale))
    speeds = launch @ _gap_acceleration(model, draw)
    yield Relation("a launch has no gap speed", ("launch", "gap"), share(speeds, scale))
    yield Relation(
        "a launch is a contact state", ("launch", "embed"), share(launch @ (down.T @ embed.T) - launch, scale)
    )
    words, fields = "touchdown is the mirror image of launch", ("touchdown", "launch", "embed", *mirrored)
    yield Relation(words, fields, share(touchdown @ embed.T - launch * reversor_of(model), scale))
    speed, alpha = model.contact_speed, named["alpha"]
    words, fields = "contact_speed is alpha at launch", ("contact_speed", "launch", "embed")
    yield Relation(words, fields, share(speed(launch @ down.T) - alpha, alpha))
    words, fields = "contact_speed is -alpha at touchdown", ("contact_speed", "touchdown")
    yield Relation(words, fields, share(speed(touchdown) + alpha, alpha))
    words, fields = "liftoff is the extension at launch", ("extension", "launch")
    yield Relation(words, fields, share(model.extension(launch) - named["liftoff"], scale))
    states = {name: model.flight.states.index(name) for name in named if name in model.flight.states}
    if states:
        off = np.array([launch[:, place] - named[name] for name, place in states.items()])
        yield Relation("a launch has the states that it is told", ("launch",), share(off, scale))


def _landing(model: Model, draw: Draw) -> Iterator[Relation]:
    """Where `landing` vanishes near the mirror image of a launch, the gap, its speed and its acceleration do."""
    gap, at = np.array(model.gap(draw.p).weights, float), draw.launched
    a, launch, mirrored = _gap_acceleration(model, draw), draw.roots["launch"], ("reversor",) if model.reversor else ()
    scale = max(float(np.abs(launch).max()), draw.length) * np.abs(at["landing slopes"]).max(initial=0.0)
    words, fields = "landing vanishes at the mirror image of launch", ("landing", "launch", *mirrored)
    yield Relation(words, fields, share(at["landing"], scale))
    independent, gaps, accelerations = 0.0, 0.0, 0.0
    for rows, slopes in zip(at["landing slopes"], at["slopes"], strict=True):
        if not np.isfinite(rows).all() or np.linalg.matrix_rank(rows) < 3:
            independent = np.inf
            continue
        within = np.linalg.pinv(rows) @ rows
        both = np.array([gap, a])
        gaps = max(gaps, share(both - both @ within, both))
        acceleration = a @ slopes
        accelerations = max(accelerations, share(acceleration - acceleration @ within, acceleration))
    yield Relation("the three expressions of landing are independent", ("landing",), independent)
    yield Relation("where landing vanishes the gap is closed and at rest", ("landing", "gap"), gaps)
    if model.conservative and not _loses(draw):
        words = "where landing vanishes the gap has no acceleration"
        yield Relation(words, ("landing", "flight.field", "gap", *mirrored), accelerations)


def reversal(model: Model, draw: Draw) -> Iterator[Relation]:
    """Time reversal turns motions into motions."""
    if model.reversor is None:
        return
    signs, (at, rates) = reversor_of(model), coordinates(model.flight)
    words = "the reversor gives a speed the sign that its position has not"
    yield Relation(words, ("reversor",), share(signs[at] + signs[rates], 1.0))
    for where, names, field, back in (
        ("flight", ("reversor", "flight.field"), draw.flown, draw.mirrored),
        ("contact", ("reversor", "contact.field", "embed"), draw.stood, draw.mirrored_contact),
    ):
        mirror = signs if where == "flight" else signs_in_contact(model, signs)
        residual = back["field"] * mirror + field["field"]
        yield Relation(f"the reversor turns motions in {where} back", names, share(residual, field["field"]))


def geometry(model: Model, draw: Draw) -> Iterator[Relation]:
    """Gap, extension, separation, heights and springs are positions, and fit together."""
    at, rates = coordinates(model.flight)
    _, rates_in_contact = coordinates(model.contact)
    p, embed, gap = draw.p, np.asarray(model.embed, float), model.gap(draw.p)
    heights, apart = model.heights(p), model.separation(p)
    positions = {"gap": gap, "extension": model.extension, **({"separation": apart} if apart else {})}
    for name, affine in positions.items():
        weights = np.array(affine.weights, float)
        yield Relation(
            f"{name} is a position", (name,), share(weights[rates], weights) + share(0.0 if weights.any() else np.inf)
        )
    weights = np.array([height.weights for height in heights.values()], float)
    yield Relation("heights are positions", ("heights",), share(weights[:, rates], weights))
    speed = np.array(model.contact_speed.weights, float)
    words = "contact_speed is the rate of a position"
    yield Relation(
        words, ("contact_speed",), share(np.delete(speed, rates_in_contact), speed) + share(model.contact_speed.offset)
    )
    closed = np.array(gap.weights, float) @ embed
    yield Relation("embedded states have a closed gap", ("gap", "embed"), share(closed, embed) + share(gap.offset))
    if model.flight.pieces and model.contact.pieces:
        own, flown = (np.array(each.coordinate, float) for each in (model.contact.pieces, model.flight.pieces))
        words, fields = "the pieces in contact are those in flight", ("contact.pieces", "flight.pieces", "embed")
        yield Relation(words, fields, share(flown @ embed - own, own))
    masses = {name: height for name, height in heights.items() if name != CENTRE}
    differences = [(b, c) for b, c in combinations(masses.values(), 2)]
    plain = [(b, None) for b in masses.values()]
    words = "the gap is between two of the heights, or one and the ground"
    yield Relation(words, ("gap", "heights"), min(_apart(gap, *pair) for pair in (*plain, *differences)))
    if apart:
        words = "the separation is at most that of two of the heights, or of one and the ground"
        most = min(_apart(apart, *pair, most=True) for pair in (*plain, *differences))
        yield Relation(words, ("separation", "heights"), most)
    if model.springs:
        pairs = [(heights[upper], heights[lower] if lower else None) for lower, upper in model.springs]
        words = "the extension is that between the ends of one of the springs"
        least = min(_apart(model.extension, *pair) for pair in pairs)
        yield Relation(words, ("extension", "heights", "springs"), least)
    if CENTRE in heights:
        yield from _centre_of_mass(masses, heights[CENTRE], draw.flown["hessian"], at, rates)


def _apart(affine: Affine, upper: Affine, lower: Affine | None, most: bool = False) -> float:
    """By how much a function of the state differs from the distance of two heights: in its weights and, with `most`,
    by how much its value is above."""
    weights = np.array(upper.weights, float) - np.array(lower.weights if lower else 0.0, float)
    between = upper.offset - (lower.offset if lower else 0.0)
    above = share(max(affine.offset - between, 0.0), affine.offset, between) if most else 0.0
    return max(share(np.array(affine.weights) - weights, weights), above)


def _centre_of_mass(masses: dict, centre: Affine, hessian: np.ndarray, at: list[int], rates: list[int]):
    """The mean of the masses' heights by what they weigh in the kinetic energy of a motion of all together."""
    weights = np.array([height.weights for height in masses.values()], float)[:, at]
    shift, *_ = np.linalg.lstsq(weights, np.ones(len(weights)), rcond=None)
    rank = np.linalg.matrix_rank(weights)
    yield Relation("the heights tell the masses apart", ("heights",), np.inf if rank < min(weights.shape) else 0.0)
    if rank < len(at) or np.abs(weights @ shift - 1).max() > LARGEST_DEVIATION:
        return
    momentum = hessian[0][np.ix_(rates, rates)] @ shift
    if not momentum @ shift > 0:
        return
    mean = momentum / (momentum @ shift)
    parts, *_ = np.linalg.lstsq(weights.T, mean, rcond=None)
    offset = parts @ np.array([height.offset for height in masses.values()], float)
    off = max(share(np.array(centre.weights)[at] - mean, mean), share(centre.offset - offset, offset, centre.offset))
    yield Relation("the centre of mass is where the kinetic energy says", ("heights", "flight_gradient"), off)


def forces(model: Model, draw: Draw) -> Iterator[Relation]:
    """The spring's force and the contact force have one unit, and the spring's is a function of the extension."""
    closing = -(draw.held["field"] @ _gap_acceleration(model, draw))
    unit, mass = _force_of_closing(draw.stood["force"][:, 0], closing), float(model.impact_mass(draw.p))
    told = mass / unit if unit > 0 and mass > 0 else None  # the unit of energy over those of force and length
    what = ("contact.watch", "impact_mass", "flight.field", "gap", "embed")
    if model.units and told and (units := model.units(draw.p)).energy:
        stated = units.force * units.length / units.energy
        words = "the contact force is in the unit that units say"
        yield Relation(words, ("units", *what), share(told / stated - 1.0, 1.0))
    if model.tension is None:
        return
    at, rates = coordinates(model.flight)
    slopes = draw.flown["tension slopes"].reshape(len(draw.x), -1)[:, [*at, *rates]]
    along = np.array(model.extension.weights, float)[[*at, *rates]]
    own = slopes @ along / max(along @ along, np.finfo(float).tiny)
    words = "the tension is a function of the extension"
    yield Relation(words, ("tension", "extension"), share(slopes - np.outer(own, along), slopes))
    stiffness = draw.flown["hessian"][np.ix_(range(len(slopes)), at, at)]
    shape = np.outer(along[: len(at)], along[: len(at)])
    size = (stiffness * shape).sum((1, 2)) / max((shape**2).sum(), np.finfo(float).tiny)
    if share(stiffness - size[:, None, None] * shape, stiffness) > LARGEST_DEVIATION:
        return  # something else than the spring stores energy
    factor = _force_of_closing(size, own)
    words, fields = "the tension is in proportion to the stiffness", ("tension", "flight_gradient", "extension")
    yield Relation(words, fields, share(size - factor * own, size) if factor > 0 else np.inf)
    if told:
        words = "tension and contact force have one unit"
        yield Relation(words, (*fields, *what), share(told - factor, factor))


def _gap_acceleration(model: Model, draw: Draw) -> np.ndarray:
    """Weights (n,) of the gap's acceleration in the rates of the flight state."""
    return _rates_of(model, np.array(model.gap(draw.p).weights, float))


def _rates_of(model: Model, weights: np.ndarray) -> np.ndarray:
    """The weights (n,) of the rate of a position with weights (n,)."""
    at, rates = coordinates(model.flight)
    found = np.zeros(len(weights))
    found[rates] = weights[at]
    return found


def _force_of_closing(force: np.ndarray, closing: np.ndarray) -> float:
    """The factor that makes the one the other, best on the whole; 0 where there is nothing to compare."""
    with np.errstate(all="ignore"):
        return float(np.nan_to_num((force @ closing) / (closing @ closing), posinf=0.0, neginf=0.0))


# Every kind of relation, as a function of a model and a draw.
MECHANICS: tuple[Callable[[Model, Draw], Iterator[Relation]], ...] = (
    motion, energy, launches, reversal, geometry, forces,
)  # fmt: skip
