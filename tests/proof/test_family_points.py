"""The points of a family, proved in passing and by processes."""

import dataclasses

import pytest

from orbits import InputError, follow
from problems import Hopper


@pytest.fixture(scope="module")
def machine():
    return Hopper("cubic", rest_length=8.0)


@pytest.fixture(scope="module")
def family(machine):
    return follow(machine, "beta", stop=0.1, longest=0.25)


@pytest.mark.slow
def test_the_points_of_a_family(machine, family):
    some = dataclasses.replace(family, points=family.points[::4])
    proofs = some.prove(machine)
    assert len(proofs) == len(some) > 2
    for point, proof in zip(some, proofs, strict=True):
        assert proof.proved
        assert proof.family == point.family
        assert abs(float(proof.alpha.low) - point.alpha) < 1e-14


@pytest.mark.slow
def test_processes_prove_the_same(machine, family):
    def told(proofs):
        return [dataclasses.replace(proof, seconds=0.0) for proof in proofs]

    short = dataclasses.replace(family, points=family.points[:2])
    assert told(short.prove(machine, motion=False, workers=2)) == told(short.prove(machine, motion=False))


def test_under_gravity_that_varies():
    machine = Hopper("r", "exp(-z/H)", rest_length=20.0, parameters={"H": 90.0})
    family = follow(machine, "mass_ratio", stop=1.05, longest=1.0)
    assert all(proof.proved for proof in dataclasses.replace(family, points=family.points[:2]).prove(machine))


@pytest.mark.slow
def test_another_machine_is_not_proved(family):
    other = Hopper("r + 1.001*beta*r**3", rest_length=8.0, parameters={"beta": 0.0})
    points = [point for point in family.points if point.value > 0.01][:2]
    assert not any(proof.proved for proof in dataclasses.replace(family, points=tuple(points)).prove(other))
    with pytest.raises(InputError, match="no parameter 'beta'"):
        family.prove(Hopper())
