"""The contacts of solved orbits: from landing up to mid-contact or, where nothing mirrors it, up to lift-off."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import FlowError, OutOfRange
from ..flow.flow import Flow, flow_of
from ..flow.trajectory import Trajectories, Trajectory
from ..flow.zero_crossing import first_zero
from ..model.model import Model
from ..model.phase import Affine, Phase
from .solution import columns

# The quantity that every contact phase watches: the force that the contact exerts, which ends it where it vanishes.
CONTACT_FORCE = "contact force"


def contact_force_row(contact: Phase) -> Affine:
    """The contact force as a function of the rows of a trajectory in contact: its states, then what is watched."""
    row = (*contact.states, *contact.watch).index(CONTACT_FORCE)
    return Affine((0.0,) * row + (1.0,))


def follow_contacts(model: Model, u: Mapping, p: Mapping, limits: np.ndarray) -> dict[str, Any]:
    """The contacts after the lossless landings of orbits: the fields, by name, that `Cycles` adds to a `Solution`.

    u, p : unknowns and parameters by name, (m,) each
    limits : times (m,) within which a contact has to end; where the launch has several speeds, mid-contact is at that
        time
    """
    flow, starts, ps = flow_of(model.contact, tuple(p)), columns(model.touchdown(u, p)), columns(p.values())
    # A mirrored contact is followed until its speed vanishes. Otherwise the force ends it, whose zero at landing does
    # not count.
    end = (model.contact_speed, 0) if model.reversor else (contact_force_row(model.contact), 1)
    done, contacts = flow.until_zero(starts, ps, *end) if model.one_speed else (np.zeros(0, int), None)
    if contacts and len(done) == len(starts) and (contacts.ends < limits).all():
        return {"with_contact": done, "contacts": contacts, "without_contact": {}}
    found = {int(i): contacts[j] for j, i in enumerate(done) if contacts.ends[j] < limits[i]} if contacts else {}
    reasons: dict[int, str] = {}
    for i in sorted({*range(len(starts))} - found.keys()):
        contact = _single_contact(model, flow, starts[i], ps[i], limits[i], end)
        if isinstance(contact, str):
            reasons[i] = contact
        else:
            found[i] = contact
    order = sorted(found)
    return {
        "with_contact": np.array(order, int),
        "contacts": Trajectories.of([found[i] for i in order]) if found else None,
        "without_contact": reasons,
    }


def _single_contact(
    model: Model, flow: Flow, start: np.ndarray, p: np.ndarray, limit: float, end: tuple[Affine, int]
) -> Trajectory | str:
    """The contact from one state, or the reason why it does not end."""
    stop = first_zero(*end) if model.one_speed else None
    try:
        path, _ = flow.run(start, p, limit, stop=stop)
    except FlowError as error:
        return f"contact: {error}" if isinstance(error, OutOfRange) else model.violations["end"]
    return model.violations["end"] if stop and not path.times[-1] < limit else path
