"""Solutions that are certified together, against each alone."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from orbits import find
from orbits.continuation.corrector import correct_all
from orbits.continuation.curve import Curve
from problems import Hopper


def test_whole_flights_certified_together():
    """Of models without a reversor, two parts of each flight in turn: against half of each by time reversal."""
    machine = Hopper("cubic", rest_length=4.0, parameters={"beta": 0.3})
    object.__setattr__(machine, "model", replace(machine.model, reversor=None, reduction=None))
    ratios = [0.7, 1.0, 3.0, 8.0]  # of the first the masses meet
    mirrored = [find(Hopper("cubic", mass_ratio=M, rest_length=4.0, parameters={"beta": 0.3}), 2) for M in ratios]
    curve, row = Curve(machine, "mass_ratio", "shooting", 10.0), np.eye(5)[4]
    xs = np.array(
        [[o.liftoff_extension, o.alpha, o.flight_time, 0.0, M] for o, M in zip(mirrored, ratios, strict=True)]
    )
    ats, error = curve.certify_all(correct_all(curve, xs, np.tile(row, (4, 1)), xs[:, 4], np.tile(row, (4, 1))))
    assert error is None
    for at, orbit in zip(ats, mirrored, strict=True):
        assert at.point.alpha == pytest.approx(orbit.alpha, rel=1e-12)
        assert at.point.flight_time == pytest.approx(orbit.flight_time, rel=1e-12)
        assert at.point.contact_time == pytest.approx(orbit.contact_time, rel=1e-12)
        mine, theirs = asdict(at.point.certificate), asdict(orbit.certificate)
        for name in ("family", "stable_side", "bounce_side", "violations"):
            assert mine[name] == theirs[name], name
        for name in ("clearance", "smallest_separation", "largest_contact_force", "landing_jerk", "loss_coefficient"):
            assert mine[name] == pytest.approx(theirs[name], rel=1e-7, abs=1e-10), name
