"""What is said where a proof does not succeed; it is no error but an answer."""


class Unproved(Exception):
    """Something could not be proved; the message says what and why. It never leaves the package."""
