"""The curve of orbits: the order of its interpolant, and points that are certified together."""

import numpy as np
import pytest

from orbits import NoOrbit, find
from orbits.continuation.corrector import correct, correct_all
from orbits.continuation.curve import Curve, CurvePoint, interpolated
from orbits.periodic.certificate import certify
from problems import Hopper


def test_the_interpolant_has_its_order():
    """Six data of an exponential curve: the error falls with the sixth power."""

    def at(t: float) -> CurvePoint:
        return CurvePoint(np.array([np.exp(t), t]), 0.3 * np.array([np.exp(t), 1.0]), 1.0, None, 0)

    errors = []
    for h in (0.2, 0.1):
        points = interpolated([at(-2 * h), at(-h), at(0.0)], np.array([0.0, 1.0]), np.array([h, -0.5 * h]))
        assert points[:, 1] == pytest.approx([h, -0.5 * h])
        errors.append(np.abs(points[:, 0] - np.exp([h, -0.5 * h])))
    assert 50 < errors[0][0] / errors[1][0] < 100
    assert errors[0][1] < errors[0][0] / 100


def test_points_are_certified_up_to_the_first_that_cannot_be(monkeypatch):
    """Along the curve, although those that were solved together are checked together."""
    curve, row = Curve(Hopper("cubic"), "beta", "relative", 1.0), np.array([0.0, 0.0, 1.0])
    betas = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    guesses = np.array([[1.0, find(Hopper("cubic", parameters={"beta": beta})).alpha, beta] for beta in betas])
    single = {i: correct(curve, guesses[i], row, betas[i], row) for i in (1, 3)}
    others = [0, 2, 4, 5]
    rows = np.tile(row, (4, 1))
    together = correct_all(curve, guesses[others], rows, guesses[others, 2], rows)
    points = [single[i] if i in single else together[others.index(i)] for i in range(6)]
    certified, error = curve.certify_all(points)
    assert error is None
    assert [at.point.value for at in certified] == pytest.approx(betas)
    assert [at.point.alpha for at in certified] == pytest.approx(guesses[:, 1], rel=1e-13)
    assert not any(at.certified for at in points)

    def refusing(model, cases):
        certificates, refused = certify(model, cases)
        wrong = np.flatnonzero(cases.p["beta"] > 0.35)
        return certificates, refused | {i: NoOrbit(f"not {cases.p['beta'][i]:.1f}") for i in wrong.tolist()}

    monkeypatch.setattr("orbits.periodic.certified.certify", refusing)
    certified, error = curve.certify_all(points)
    assert [at.x.tolist() for at in certified] == [at.x.tolist() for at in points[:3]]
    assert str(error) == "not 0.4"
