"""Motions through impacts and contacts, hop after hop, and the multiplier of an orbit among them."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .arcs import Flown
    from .flyer import Flyer
    from .hand_over import landed
    from .hop_statuses import hops_of_speeds, hops_of_states, stand
    from .hysteresis import Branches
    from .impacts import CAP, FASTEST_LAUNCH, LIFTOFF_ORDER, STATUS, STATUSES, Impacts, impacts_of, injected
    from .launch_section import LaunchSection
    from .lossless_hops import CROSSINGS, LosslessHops, angles_left, is_crossing
    from .multiplier import multiplier, slope_of_hop, tangential_landing, through_contact
    from .multipliers import EnergyLoss, HopMultipliers, HopsDerivative, derivative_of_hops, multipliers
    from .points_of_contact import LIFTS_OFF
    from .schedule import Inputs
    from .simulated import Leg, Simulation, index_of_legs, rows_of_legs, run_in_units, times_within
    from .simulation import simulate

__all__ = [*public_names(__name__)]
