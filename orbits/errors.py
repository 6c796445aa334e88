"""What can go wrong, in the user's terms: every exception of the toolkit derives from `OrbitsError`."""


class OrbitsError(Exception):
    """Base of all errors raised on purpose; the message says what, where and what to do."""


class InputError(OrbitsError, ValueError):
    """The question is ill posed: a number, formula, file or option that cannot be meant."""


class NoOrbit(OrbitsError):
    """The machine has no such orbit, or none could be certified; the message gives the reason."""


class FlowError(NoOrbit):
    """A motion cannot be carried on: it blows up or stops being a number."""


class OutOfRange(FlowError):
    """A motion needs a law where it is not defined, as outside a measured table."""


class RunsAway(FlowError):
    """A motion goes beyond all bounds."""


class BreaksDown(FlowError):
    """A motion comes to a singularity: its steps vanish or are not numbers."""
