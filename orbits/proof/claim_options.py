"""Options of the comparison of an orbit's numbers with the proved ones."""

from typing import NamedTuple


class ClaimOptions(NamedTuple):
    """How near the numbers of a claim are to the proved ones."""

    errors_of_alpha: float = 2.0  # error of alpha that is allowed, as a multiple of its own bound
    roundings: float = 8 * 2.0**-52  # share of alpha that is allowed in addition, a few units of the last place
    share_of_others: float = 1e-11  # share of other numbers that is allowed, as they are correct to some roundings
    # Multiple of the error of alpha that is allowed in other numbers in addition: an orbit bounds no errors of theirs.
    errors_of_others: float = 1e3
    # Widest box of a run with tuned numbers, as a share of the unknowns: its equations are ill-conditioned.
    share_of_runs: float = 2.0**-34
    roundings_of_map: float = 512 * 2.0**-52  # share of a fixed point of the map that is allowed
    share_of_slope: float = 1e-6  # share of the multiplier of a hop that is allowed
    share_of_flip: float = 1e-9  # share of a range to which a period doubling is located


CLAIMS = ClaimOptions()
