"""What is accepted as a machine: missing and malformed parts are named, and a wrong model is refused at every use."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from orbits import InputError, ReturnMap, check, follow, simulate
from orbits.errors import InconsistentModel
from problems import Hopper
from tests.consistency.checked_machines import with_model


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("model", "hopper", "it is a str, not a Model"),
        ("values", [1.0], "it is a list, not a mapping"),
        ("values", {"mass_ratio": np.nan}, "is no finite number"),
        ("units", 3.0, "neither Units nor None"),
        ("describe", None, "describe"),
        ("describe", lambda: {}, "it says no 'machine'"),
        ("with_values", None, "with_values"),
        ("with_values", lambda **values: Hopper("cubic"), "does not give the same machine"),
        ("restitution", 1.5, "does not lie between 0 and 1"),
        ("rest_length", "long", "neither a length nor None"),
    ],
)
def test_a_malformed_part_of_a_machine_is_named(name, value, text):
    machine = with_model(Hopper(), Hopper().model)
    setattr(machine, name, value)
    with pytest.raises(InputError, match=text) as error:
        check(machine)
    assert name in str(error.value)


def test_every_missing_part_of_a_machine_is_named():
    machine = SimpleNamespace(model=replace(Hopper().model), values=Hopper().values)
    with pytest.raises(InputError) as error:
        check(machine)
    for name in ("with_values", "describe", "units", "restitution", "rest_length"):
        assert f"{name}" in str(error.value)


def test_every_use_of_a_wrong_model_is_refused():
    machine = Hopper("r + 0.3*r**3", rest_length=20.0)
    model = replace(machine.model, impact_mass=lambda x, p: -machine.model.impact_mass(x, p))
    wrong = with_model(machine, model)
    for use in (
        lambda: ReturnMap(wrong),
        lambda: simulate(wrong, 3.0, hops=1),
        lambda: follow(wrong, "mass_ratio", 2.0),
    ):
        with pytest.raises(InconsistentModel, match="impact_mass"):
            use()
