"""The quantities of an orbit: their names in tables, and their values for m orbits; `units` has their dimensions."""

from collections.abc import Callable, Collection, Mapping
from typing import Any, NamedTuple

import numpy as np

from ..model import CONTACT_FORCE, STEP_LENGTH, Affine, Model
from ..records import NONE, Records, numbers_or_nan
from ..shooting import Cycles
from ..symbolic import suggest
from ..units import APEX, DIMENSIONS, LENGTH, OF_ANGLES, RISE, Dimension, Units
from .certificate import Certificate
from .extrema_and_zeros import extremes


class OrbitQuantity(NamedTuple):
    """One quantity of an orbit.

    of : (model, cycles) -> the values (m,) of cycles, `NONE` where there is none; None where the certificate has it, or
        a design alone computes it
    words : its name in the table of an orbit; "" where it has no row there
    in_si : whether it is one of the main results in SI
    planar : whether only machines have it that stand in flight, and whose masses have places across
    apart : why no design, prescribed value or formula has it; "" where they have it
    """

    of: Callable[[Model, Cycles], np.ndarray] | None = None
    words: str = ""
    in_si: bool = False
    planar: bool = False
    apart: str = ""


def _period(model: Model, cycles: Cycles) -> np.ndarray:
    """The periods (m,), `NONE` where the contact does not end."""
    contacts = cycles.contact_times
    return np.where(contacts == NONE, NONE, cycles.flight_times + contacts)


def _frequency(model: Model, cycles: Cycles) -> np.ndarray:
    """The hops or steps (m,) per time."""
    return np.where(cycles.contact_times == NONE, NONE, 1 / _period(model, cycles))


def _duty_factor(model: Model, cycles: Cycles) -> np.ndarray:
    """The shares (m,) of the periods that are contact, `NONE` where two points take turns."""
    known = (cycles.contact_times != NONE) & (not model.changes_contact)
    return np.divide(cycles.contact_times, _period(model, cycles), out=np.full(len(cycles), NONE), where=known)


def in_weights(model: Model, p: Mapping, forces: np.ndarray) -> np.ndarray:
    """Contact forces (m,) over the weight that the contact carries, `NONE` where one of the two is not known."""
    weight = model.weight(p)
    return np.full(len(forces), NONE) if weight is None else np.where(forces == NONE, NONE, forces / weight)


def _peak_in_weights(model: Model, cycles: Cycles) -> np.ndarray:
    """The largest contact forces (m,) in weights."""
    forces, contacts = np.full(len(cycles), NONE), cycles.contacts
    if contacts:
        force = Affine((0.0,) * contacts.names.index(CONTACT_FORCE) + (1.0,))
        forces[cycles.with_contact] = extremes(contacts, force)[1]
    return in_weights(model, cycles.p, forces)


def _stroke(model: Model, cycles: Cycles) -> np.ndarray:
    """The range (m,) of the extension over the cycles, `NONE` where the contact does not end."""
    ranges = [extremes(each, model.extension) for each in cycles.flown(model)]
    low, high = (np.reshape(each, (len(ranges), len(cycles), -1)) for each in zip(*ranges, strict=True))
    stroke, these = np.full(len(cycles), NONE), cycles.with_contact
    if cycles.contacts:
        stood = [extremes(each, model.extension, model.embed) for each in cycles.stood(model)]
        least, most = np.min([each[0] for each in stood], axis=0), np.max([each[1] for each in stood], axis=0)
        stroke[these] = np.maximum(high.max((0, 2))[these], most) - np.minimum(low.min((0, 2))[these], least)
    return stroke


def speed_in_flight(model: Model, u: Mapping, p: Mapping, flight_time: Any) -> Any:
    """The mean speed of the centre of mass along the ground in flight from a launch with unknowns `u`; it is constant
    above a free foot."""
    assert model.planar is not None
    launched = model.launch(u, p)
    if model.planar.travel is not None:
        return model.planar.travel(launched, p)
    assert model.planar.across is not None
    landed = model.reversal.image(launched, p)
    return (model.planar.across(landed, p) - model.planar.across(launched, p)) / flight_time


def step_of(model: Model, u: Mapping, p: Mapping) -> Any:
    """The step: without a foot that sticks, by how much the foot that lands is ahead of the one that stood."""
    if model.runs:
        return p[STEP_LENGTH]
    assert model.planar is not None
    assert model.planar.across is not None
    landed = model.reversal.image(model.launch(u, p), p)
    return model.planar.across(landed, p) - model.planar.across(model.relabelling.image(landed, p), p)


def _step(model: Model, cycles: Cycles) -> np.ndarray:
    """The steps (m,)."""
    return np.broadcast_to(step_of(model, cycles.u, cycles.p), len(cycles))


def _speed(model: Model, cycles: Cycles) -> np.ndarray:
    """The speeds (m,) in flight."""
    return np.broadcast_to(speed_in_flight(model, cycles.u, cycles.p, cycles.flight_times), len(cycles))


def _mean_speed(model: Model, cycles: Cycles) -> np.ndarray:
    """The steps (m,) over the periods."""
    contacts = cycles.contact_times
    return np.where(contacts == NONE, NONE, _step(model, cycles) / (cycles.flight_times + contacts))


OF_LOSS = ("loss_coefficient", "robustness")
VARIATIONAL = ("landing_sensitivity", *OF_LOSS)  # these need the variation of the flight with alpha
FRICTION_LEFT = "friction_left"  # the stated friction less that which is needed
ACCURACY = "it is the accuracy of an orbit, not a property of its motion"
OF_LOOP = "it is a loss on the spring's measured loop: sweeps and families have it as a column, designs do not"
NOT_BY_SPEED = "it is a derivative by the launch speed, but a launch of this machine has several unknowns"
# In the order of every table; there is one of the "rises", and one of the "apexes", for each height of the machine.
QUANTITIES: dict[str, OrbitQuantity] = {
    "alpha": OrbitQuantity(lambda model, cycles: cycles.u["alpha"], "alpha", True),
    "flight_time": OrbitQuantity(lambda model, cycles: cycles.flight_times, "flight time", True),
    "contact_time": OrbitQuantity(lambda model, cycles: cycles.contact_times, "contact time", True),
    "period": OrbitQuantity(_period, "period", True),
    "frequency": OrbitQuantity(_frequency, in_si=True),
    "duty_factor": OrbitQuantity(_duty_factor, in_si=True),
    "liftoff_extension": OrbitQuantity(
        lambda model, cycles: model.liftoff_extension(cycles.u, cycles.p), "lift-off extension", True
    ),
    "stroke": OrbitQuantity(_stroke, in_si=True),
    "admissible": OrbitQuantity(
        apart="it is a verdict: designs are always motions, and a sweep has the column status instead"
    ),
    "error": OrbitQuantity(apart=ACCURACY),
    "residual": OrbitQuantity(apart=ACCURACY),
    "energy_drift": OrbitQuantity(apart=ACCURACY),
    "family": OrbitQuantity(apart="it is a count: choose it by the argument family"),
    "clearance": OrbitQuantity(words="clearance", in_si=True),
    "smallest_separation": OrbitQuantity(words="smallest separation", in_si=True),
    "rises": OrbitQuantity(words="rise of"),
    "apexes": OrbitQuantity(),
    "smallest_contact_force": OrbitQuantity(words="smallest contact force"),
    "largest_contact_force": OrbitQuantity(words="largest contact force", in_si=True),
    "peak_force_in_weights": OrbitQuantity(_peak_in_weights, in_si=True),
    "largest_spring_force": OrbitQuantity(),
    "landing_jerk": OrbitQuantity(words="landing jerk"),
    "landing_sensitivity": OrbitQuantity(),
    "loss_coefficient": OrbitQuantity(words="loss coefficient C"),
    "loss_error": OrbitQuantity(apart=ACCURACY),
    "robustness": OrbitQuantity(),
    "loop_energy": OrbitQuantity(in_si=True, apart=OF_LOOP),
    "alpha_noise": OrbitQuantity(apart=ACCURACY),
    "alpha_per_noise": OrbitQuantity(apart=ACCURACY),
    "friction_needed": OrbitQuantity(planar=True),
    "friction_left": OrbitQuantity(planar=True),
    "smallest_stance_force": OrbitQuantity(planar=True),
}
# Those of machines that move on along the ground with each landing, whose lossless motions have no cost of transport.
OF_RUNS: dict[str, OrbitQuantity] = {
    "step": OrbitQuantity(_step, "step", True),
    "speed": OrbitQuantity(_speed, "speed in flight", True),
    "mean_speed": OrbitQuantity(_mean_speed, "mean speed", True),
}
PLANAR = tuple(name for name, each in QUANTITIES.items() if each.planar)
OF_CERTIFICATE = tuple(name for name in QUANTITIES if name in Certificate.__dataclass_fields__)
CERTIFIED = tuple(name for name in OF_CERTIFICATE if name not in PLANAR)
# The quantities of the motion that every result has, from which others follow.
OF_MOTION = ("alpha", "flight_time", "contact_time", "liftoff_extension")
# The quantities that a design may use, besides those of heights, and those computed for m orbits together.
DESIGNED = tuple(name for name, each in QUANTITIES.items() if not each.apart and name not in ("rises", "apexes"))
OF_MANY = tuple(name for name in DESIGNED if QUANTITIES[name].of or name in OF_CERTIFICATE)


def dimension_of(name: str) -> Dimension | str:
    """The dimension of a quantity, or its name where that decides; one of heights is a length."""
    known = {**dict.fromkeys(QUANTITIES, ()), **DIMENSIONS}
    return name if name in OF_ANGLES else known.get(name, LENGTH)


def absent_quantities(model: Model, p: Mapping) -> dict[str, str]:
    """Why orbits of a model have no quantity of a name, in words, by these names."""
    why, planar = {name: each.apart for name, each in QUANTITIES.items() if each.apart}, model.planar
    why |= {} if model.tension else {"largest_spring_force": f"a {model.name} states no force of one spring"}
    why |= {} if model.one_speed else dict.fromkeys(VARIATIONAL, NOT_BY_SPEED)
    if model.separation(p) is None:
        why["smallest_separation"] = (
            "the machine states no length, such as rest_length, from which the separation of its masses follows"
        )
        apexes = (f"{name.removesuffix(RISE)}{APEX}" for name in model.of_heights(p))
        why |= dict.fromkeys(
            apexes, "the machine states no length, such as rest_length, from which the heights of its masses follow"
        )
    if model.weight(p) is None:
        why["peak_force_in_weights"] = f"the weight on the contact of a {model.name} is not known"
    why |= {"duty_factor": f"two points of a {model.name} take turns on the ground"} if model.changes_contact else {}
    if planar is None:
        why |= dict.fromkeys(PLANAR, f"a {model.name} states no places of its masses along the ground")
    elif not planar.stands:
        why["smallest_stance_force"] = f"no part of a {model.name} stands on the ground in flight"
    if planar is not None and not planar.friction:
        why[FRICTION_LEFT] = "the machine states no friction of the ground"
    why |= {"clearance": f"a point of a {model.name} passes the ground in mid-flight"} if model.grazes else {}
    why |= {} if model.moves_on else dict.fromkeys(OF_RUNS, f"a {model.name} does not move on along the ground")
    return why


def beyond_model(machine: Any) -> dict[str, Callable[[float], float]]:
    """The quantities that follow from more of a machine than its model has, by name, each of the launch speed of an
    orbit; they are computed for one orbit after the other. They raise `NoOrbit` where the orbit has none."""
    return {"loop_energy": lambda alpha: machine.on_loop(alpha).energy} if getattr(machine, "of_loop", False) else {}


def quantity_names(model: Model, p: Mapping) -> list[str]:
    """The quantities of a model's orbits: the names of all formulas, designs, prescribed values and columns."""
    absent = absent_quantities(model, p)
    return [*(name for name in (*DESIGNED, *OF_RUNS) if name not in absent), *model.of_heights(p)]


def unknown_quantity(model: Model, p: Mapping, name: str, known: Collection[str]) -> str:
    """Why a name is not one of the `known` ones, in words: the machine's orbits do not have the quantity, it is not
    computed there, or no quantity has this name."""
    if why := absent_quantities(model, p).get(name):
        return f"no quantity '{name}' here: {why}"
    if name in quantity_names(model, p):
        return f"'{name}' is not available here; choose one of {', '.join(known)}"
    return f"unknown quantity '{name}'{suggest(name, known)}"


def motion_numbers(model: Model, cycles: Cycles) -> dict[str, np.ndarray]:
    """The quantities `OF_MOTION` (m,) of cycles by name, `NONE` where there is none."""
    return {name: of(model, cycles) for name in OF_MOTION if (of := QUANTITIES[name].of)}


def run_numbers(model: Model, cycles: Cycles) -> dict[str, np.ndarray]:
    """The step and the speed (m,) of cycles of a machine that moves on along the ground by name, none of another."""
    return {name: of(model, cycles) for name in ("step", "speed") if model.moves_on and (of := OF_RUNS[name].of)}


def names_of_many(model: Model) -> tuple[str, ...]:
    """The names of the quantities of a model's orbits that are computed for many together, besides those of heights."""
    return (*OF_MANY, *(OF_RUNS if model.moves_on else ()))


def numbers_of(
    model: Model, cycles: Cycles, certificates: Records[Certificate] | None, units: Units | None, names: Collection[str]
) -> dict[str, np.ndarray]:
    """The numbers (m,) of orbits by name, for names that are quantities, also of heights: NaN where an orbit has none,
    and in SI by units (m,)."""
    heights, found = model.of_heights(cycles.p_of_halves), dict[str, np.ndarray]()
    for name in names:
        if name in heights:
            flown = cycles.flown(model)
            height, is_rise = heights[name]
            highest = np.maximum.reduce([extremes(motions, height)[1] for motions in flown])
            highest -= flown[0].series(height, steps=cycles.halves.first)[:, 0] if is_rise else 0.0
            found[name] = highest.reshape(len(cycles), -1).max(axis=1)
        elif name in OF_CERTIFICATE and certificates is not None:
            found[name] = numbers_or_nan(certificates.column(name))
        elif (known := QUANTITIES.get(name) or OF_RUNS.get(name)) and (of := known.of):
            found[name] = numbers_or_nan(of(model, cycles))
    if units:
        found = {name: values * units.of(dimension_of(name)) for name, values in found.items()}
    return found
