"""Feedback that holds a hop at which an actuator keeps a machine, by changes of the actuator's rate.

The actuator's own state, the displacement of a spring's end or the force, is one state more of what is measured and fed
back, and one number more of a launch.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from orbits.control import HOLDING, Cycle, HeldLimits, Hold, hold_cycle, limits_in
from orbits.errors import InputError
from orbits.mechanics import value_of
from orbits.model import Affine
from orbits.running import exclusive
from orbits.units import TIME, Units, without_units

from .actuated import Actuated

if TYPE_CHECKING:
    from .driven import Driven


@exclusive
def held_hop(driven: "Driven", *, delay: float = 0.0, limits: HeldLimits, **options: Any) -> Hold:
    """The feedback of `Driven.hold`, see there."""
    if not driven.periodic or [leg.phase for leg in driven.legs] != ["flight", "contact"]:
        raise InputError("hold needs a periodic hop, such as keep_hopping returns")
    actuated, bare = driven.actuated, driven.dimensionless()
    own, units = bare.actuated, actuated.units
    rate = own.actuator.rate
    times, inputs = bare.schedule(rate)
    sizes = _sizes_of_hop(bare)
    dimensions = own.dimensions
    flight, contact = bare.durations.tolist()
    kind = "force's rate" if own.actuator.is_force else "displacement's rate"
    unit = float(sizes.of(dimensions[rate]))
    cycle = Cycle(own, rate, bare(0.0), flight, contact, times, inputs[rate], kind, sizes, unit, own.moved)
    names = {"rate": rate, "stroke": "way", "force": "actuator force", "speed": "speed"}
    of = {name: 1.0 if units is None else float(units.of(dimensions[at])) for name, at in names.items()}
    of["power"] = of["force"] * of["speed"] if units else 1 / float(value_of(own.drive.energy_unit, {}, own.still))
    second = 1.0 if units is None else float(units.of(TIME))
    with without_units(units):
        return hold_cycle(
            cycle, actuated, str(own.actuator.along), limits, limits_in(limits, of), delay=delay / second, **options
        )


def _sizes_of_hop(bare: "Driven") -> Units:
    """The units of a hop without units: its highest gap, its period over 2 pi and its mean contact force."""
    own: Actuated = bare.actuated
    t = np.linspace(0.0, bare.end, HOLDING.instants)
    gap = own.model.gap(own.values)
    assert isinstance(gap, Affine)
    length, weight = float(gap(bare(t)).max()), float(bare.motion.contact_force(t[:-1]).mean())
    state, angles = own.actuator.state, own.stated().si_units.angles
    return Units(length, bare.end / (2 * np.pi), weight, weight * length, angles, ((state, own.dimensions[state]),))
