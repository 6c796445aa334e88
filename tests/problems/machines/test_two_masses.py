"""Machines of two masses: numbers that change share a model."""

import pytest
from conftest import REFERENCES, machine_of
from families import GOLDEN

from orbits import InputError, find


def test_a_machine_with_other_values_shares_its_model():
    machine = machine_of(REFERENCES[2])
    other = machine.with_values(beta=1.0, mass_ratio=3.0)
    assert other.model is machine.model
    assert find(other).alpha == pytest.approx(GOLDEN[1.0], rel=1e-13)
    assert machine.values["beta"] == 0.3
    with pytest.raises(InputError, match="has a parameter 'gamma'"):
        machine.with_values(gamma=1.0)
