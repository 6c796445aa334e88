"""The numbers that an orbit claims, compared with the proved ones."""

from math import isfinite

from flint import arb

from ..balls import Motion, ball_of_fraction
from ..exact import Claim
from .claim_options import CLAIMS
from .proved_existence import ProvedExistence


def wrong_numbers(found: ProvedExistence, claim: Claim) -> list[str]:
    """The reasons why the orbit's alpha and times are wrong, in words."""
    reasons = list[str]()
    error = CLAIMS.errors_of_alpha * claim.error + CLAIMS.roundings * abs(claim.alpha)
    balls = found.balls
    if not isfinite(error) or not (balls["alpha"] + arb(0, error)).overlaps(arb(claim.alpha)):
        claimed = f"the orbit states {claim.alpha!r} with an error of {claim.error:.1e}"
        reasons.append(f"alpha: {claimed}, and lies outside the enclosure {found.unknowns['alpha']}")
    tuned = {name: claim.unknowns[name] for name in claim.tuned}
    others = {"flight_time": claim.flight_time, "contact_time": claim.contact_time, **tuned}
    for name, value in others.items():
        if name in balls and value is not None and not _agrees(balls[name], value, claim):
            reasons.append(f"{name}: the orbit states {value!r}, outside the enclosure {found.unknowns[name]}")
    return reasons


def _agrees(ball: arb, claimed: float, claim: Claim) -> bool:
    """Whether an enclosed number agrees with an orbit's, within the orbit's error."""
    error = CLAIMS.share_of_others * max(abs(claimed), claim.alpha * 1e-3) + CLAIMS.errors_of_others * claim.error
    return isfinite(error) and isfinite(claimed) and bool((ball + arb(0, error)).overlaps(arb(claimed)))


def wrong_places(found: ProvedExistence, flight: Motion, claim: Claim) -> list[str]:
    """The reasons why the orbit's extension at lift-off and coordinates in mid-flight are wrong, in words."""
    mechanics = found.half.mechanics
    places = [
        place * ball_of_fraction(mechanics.scale.length) for place in flight.passage.finish[: 2 * mechanics.size : 2]
    ]
    ends = dict(zip(mechanics.stated.coordinates, places, strict=True))
    claimed = {f"{name} in mid-flight": (ends[name], value) for name, value in claim.places.items() if name in ends}
    if claim.liftoff_extension is not None:
        counted = flight.chain([mechanics.counts] * len(flight.leg.rates), 0)
        claimed["liftoff_extension"] = flight.first(counted, 0), claim.liftoff_extension
    wrong = [(name, value) for name, (ball, value) in claimed.items() if not _agrees(ball, value, claim)]
    return [f"{name}: the orbit states {value!r}, which is wrong" for name, value in wrong]
