"""The range of extensions that an orbit needs if it leaves the range of a measured law.

The law is continued by straight lines beyond its ends, with its slopes there. An orbit of that spring shows how far to
measure; it is never returned, since the force there is unknown.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import NoOrbit
from ..flow import OUT_OF_LAW
from ..laws import Law
from ..units import EXTENSION, Message, Quantity
from .orbit import Orbit

INSTANTS = 2001  # of a cycle at which its extension is measured: a message states it with a few digits


def with_needed_range(machine: Any, family: int, search: Callable[[Any], Orbit]) -> Orbit:
    """The orbit of a family that a search finds for a dimensionless machine. Where it leaves the range of the machine's
    law, or none is found in it, the reason also states the range that it needs."""
    law = getattr(machine, "spring", None)
    if not isinstance(law, Law) or law.key.branches or not np.isfinite(law.range()).all():
        return search(machine)
    try:
        orbit = search(machine)
    except NoOrbit as error:
        if (needed := _needed(machine, law, search)) is None:
            raise
        low, high = (Quantity(end, EXTENSION) for end in law.range())
        parts = {"law": law.text, "family": family, "low": low, "high": high, "needed": needed, "error": error.args[0]}
        text = f"spring '{{law}}': a motion of family {{family}} {OUT_OF_LAW}, [{{low:.6g}}, {{high:.6g}}]; {{needed}}"
        raise NoOrbit(Message(text if OUT_OF_LAW in error.args[0] else "{error}; {needed}", **parts)) from None
    outside = [OUT_OF_LAW in violation for violation in orbit.violations]
    if not any(outside) or (needed := _needed(machine, law, search)) is None:
        return orbit
    each = zip(orbit.violations, outside, strict=True)
    reasons = tuple(Message("{why}; {needed}", why=why, needed=needed) if left else why for why, left in each)
    return replace(orbit, certificate=replace(orbit.certificate, violations=reasons))


def _needed(machine: Any, law: Law, search: Callable[[Any], Orbit]) -> Message | None:
    """The extensions of the orbit with the law continued, in words; None where there is no orbit then either."""
    try:
        orbit = search(replace(machine, spring=law.continued()))
    except NoOrbit:
        return None
    end = orbit.flight_time if orbit.contact_time is None else orbit.period
    extensions = orbit(np.linspace(0.0, end, INSTANTS)) @ np.array(machine.model.extension.weights)
    low, high = (Quantity(float(each), EXTENSION) for each in (extensions.min(), extensions.max()))
    return Message("an orbit needs about [{low:.3g}, {high:.3g}]", low=low, high=high)
