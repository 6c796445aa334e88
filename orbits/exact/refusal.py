"""What is said where a proof does not succeed, or takes too long; it is no error but a result."""

from ..running import time_limit


class Unproved(Exception):
    """Something could not be proved; the message says what and why. It never leaves the package."""


class TooLong(Unproved):
    """The time that a proof may take is over."""


def check_proof_time() -> None:
    """Raise `TooLong` where the time is over."""
    try:
        time_limit.check_time()
    except time_limit.TimeOver as over:
        raise TooLong(str(over)) from None
