"""Exceptions of a proof that does not succeed or takes too long, which is a result and not an error."""

from ..running import TimeOver, interrupts

# Why some theorems need a law without pieces.
NOT_ACROSS = "second derivatives cannot be enclosed across the breakpoints of a law in pieces or a table"


class Unproved(Exception):
    """Something could not be proved; the message states it and the reason. It never leaves the package."""


class Undecided(Unproved):
    """Something is left open by enclosures that are too wide: more digits may decide it."""


class TooLong(Unproved):
    """The time limit of a proof is reached."""


def check_proof_time() -> None:
    """Raise `TooLong` where the time limit is reached; a long proof says here that it continues."""
    try:
        interrupts.heed()
    except TimeOver as over:
        raise TooLong(str(over)) from None
