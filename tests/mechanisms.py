"""Shared by the tests of mechanics: legs of two masses, and whether two orbits are the same motion."""

import pytest

from orbits import Mechanism
from orbits.mechanics import Mass, Spring
from orbits.periodic import LinearSearch
from orbits.periodic.linear_hops import LinearHop

MASSES = [Mass("body", "m1"), Mass("foot", "m2")]
VALUES = {"m1": 2.0, "m2": 0.5, "k": 3.0}
LEG = Spring("body - foot", "k*r")


def leg(*elements, **more) -> Mechanism:
    """A body and a foot with these elements beside their masses."""
    given = {"gap": "foot", "parameters": VALUES, **more}
    return Mechanism(coordinates=("body", "foot"), elements=[*MASSES, *elements], **given)


def same(a, b, rel=1e-13):
    """Whether two orbits are the same motion."""
    for name in ("alpha", "flight_time", "contact_time", "liftoff_extension"):
        assert getattr(a, name) == pytest.approx(getattr(b, name), rel=rel), name
    assert a.certificate.loss_coefficient == pytest.approx(b.certificate.loss_coefficient, rel=1e-9)
    assert a.admissible == b.admissible


def machine(*elements, **more) -> Mechanism:
    """A body and a foot on a spring with these elements beside."""
    masses = [Mass("body", "m1"), Mass("foot", "m2")]
    given = {"coordinates": ("body", "foot"), "elements": [*masses, LEG, *elements], "gap": "foot"}
    return Mechanism(**{**given, "parameters": VALUES, **more})


def linear_hops(
    inertia, stiffness, load, gap, half_contact: float, half_flight: float, seed: int = 0, signs=1
) -> list[LinearHop]:
    """The lossless hops of a linear mechanism up to these half times."""
    search = LinearSearch((inertia, stiffness, load), gap, signs)
    for _ in search.batches(half_contact, half_flight, seed):
        pass
    return search.hops
