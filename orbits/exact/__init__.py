"""The subject of a theorem, exactly: the stated text as expressions, the mechanics that they state, and the equations
of an orbit. Numbers are rational here, and bounds are decimals."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .bounds import Enclosure as Enclosure
    from .claim import BY_EQUATIONS, CONTACT_DURATION, FLIGHT_DURATION, Claim, claim_of
    from .decimals import decimal_text
    from .exact_mechanics import (
        Column,
        ExactMechanics,
        LoneExtension,
        Scale,
        nearest_power_of_two,
        parameter_of,
        place_of,
    )
    from .jets import statement_of_folds, statement_of_jets
    from .outward_decimals import (
        bounds_of_fractions,
        enclosure_of,
        lower_decimal,
        radius_of,
        upper_decimal,
        upper_fraction,
    )
    from .refusal import NOT_ACROSS, TooLong, Undecided, Unproved, check_proof_time
    from .stated import Bounds, Decimals, StatedMachine, exact_bounds, exact_values, range_text, stated_machine
    from .statement import ExactArc, ExactStatement, HalfOrbit, unknown

__all__ = [*public_names(__name__)]
