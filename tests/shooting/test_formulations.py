"""The statements of an orbit: whole flights against half ones, the contact force, and methods that are refused."""

import dataclasses

import numpy as np
import pytest
from columns import column
from conftest import REFERENCES, machine_of, slow_after

from orbits import InputError, NoOrbit, find
from orbits.shooting import half_orbit
from orbits.shooting.formulations import contact_force_row, whole_flight
from problems import Hopper
from problems.laws import springs


@pytest.mark.parametrize(
    "machine",
    slow_after(
        1,
        [
            Hopper("r", rest_length=20.0),
            machine_of(REFERENCES[4]),
            Hopper(springs.bilinear(ratio=2.0), rest_length=20.0),
        ],
    ),
    ids=["linear", "varying", "in pieces"],
)
def test_a_model_without_a_reversor_is_unfolded(machine):
    """The whole flight with the energy's gradient added to the field, against half of it by time reversal."""
    mirrored = find(machine)
    object.__setattr__(machine, "model", dataclasses.replace(machine.model, reversor=None, reduction=None))
    whole = find(machine, method="shooting")
    assert whole.alpha == pytest.approx(mirrored.alpha, rel=1e-12)
    assert whole.flight_time == pytest.approx(mirrored.flight_time, rel=1e-12)
    assert whole.family == 1
    assert whole.certificate.clearance == mirrored.certificate.clearance
    assert abs(whole.certificate.unfolding) < 1e-12
    assert whole.certificate.loss_coefficient == pytest.approx(mirrored.certificate.loss_coefficient, rel=1e-8)
    assert whole.contact_time == pytest.approx(mirrored.contact_time, rel=1e-12)
    assert whole.certificate.largest_contact_force == pytest.approx(mirrored.certificate.largest_contact_force)
    assert whole.certificate.smallest_contact_force == mirrored.certificate.smallest_contact_force
    t = np.linspace(0, whole.period, 101)
    assert whole(t) == pytest.approx(mirrored(t), abs=1e-10)
    with pytest.raises(InputError, match="needs a reversor"):
        find(machine, method="half orbit")
    with pytest.raises(InputError, match="needs a model with a reversor"):
        half_orbit(machine.model)


def test_the_direct_statement_is_degenerate_and_the_unfolded_one_is_not():
    """Height and speed of the foot at landing depend on the launch speed alone, so they cannot fix the flight time."""
    from orbits.shooting import shooting_equations

    machine = Hopper("r", rest_length=20.0)
    orbit = find(machine)
    values = machine.values
    equations = shooting_equations(whole_flight(machine.model), tuple(values))
    evaluation = equations.evaluate([1.0, orbit.alpha, orbit.flight_time, 0.0], np.array(list(values.values())))
    singular = np.linalg.svd(evaluation.jacobian[1:3, 1:3], compute_uv=False)
    assert singular[-1] < 1e-12 * singular[0]
    assert np.linalg.cond(evaluation.jacobian) < 1e6


def test_bad_methods():
    with pytest.raises(InputError, match="method = 'newton'; it must be one of"):
        find(Hopper(), method="newton")
    with pytest.raises(InputError, match="'closed form' needs a linear spring"):
        find(Hopper("cubic"), method="closed form")
    with pytest.raises(InputError, match="'relative' needs two masses and constant gravity"):
        find(Hopper("r", "exp(-z/50)", rest_length=10), method="relative")


def test_methods_are_refused_by_name():
    with pytest.raises(InputError, match="it must be one of closed form, relative"):
        find(machine_of(REFERENCES[0]), method="ipopt")


def test_the_row_of_the_contact_force_is_the_force():
    machine = Hopper("r + 0.1*r**3", mass_ratio=2.0)
    contact, row = find(machine).contact, contact_force_row(machine.model.contact)
    t = np.linspace(0.0, contact.times[-1], 9)
    rows = contact(t)
    assert row(rows) == pytest.approx(rows[:, contact.names.index("contact force")], abs=0.0)
    extension = rows[:, 0]  # the foot stands: weights 1 and 2, less what the spring pulls up
    assert row(rows) == pytest.approx(1.0 - extension - 0.1 * extension**3, abs=1e-12)


def test_a_damped_machine_whose_launch_is_more_than_a_speed_has_no_equations():
    machine = column(damping=0.1)
    start = {**dict.fromkeys(("liftoff", "alpha", "y1", "y1'", "duration", "contact_duration"), 1.0), "unfolding": 0.0}
    with pytest.raises(
        NoOrbit, match="a column has no reversor, for example since it has a damper: where a launch has"
    ):
        find(machine, start=start)
