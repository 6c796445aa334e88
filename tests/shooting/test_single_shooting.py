"""The engine on statements of its own: several phases in a row, strange machines, and Ipopt's manners."""

import casadi as ca
import numpy as np
import pytest
from conftest import REFERENCES, machine_of

from orbits import NoOrbit, find
from orbits.model import Arc, Phase, Statement, linear_modes
from orbits.shooting import Shooting, equations_of
from problems import Hopper


def across_contact(model) -> Statement:
    """From rest in mid-contact through lift-off to rest in mid-flight: two phases, three unknowns."""
    force = model.contact.watch["contact force"]
    contact = Arc(
        model.contact,
        start=lambda u, before, p: [u["lowest"], 0.0],
        duration=lambda u, p: u["standing"],
        conditions=lambda u, x, p: [force(x, p, [])],
    )
    flight = Arc(
        model.flight,
        start=lambda u, before, p: [before[0], before[1], 0.0, 0.0],
        duration=lambda u, p: u["flying"],
        conditions=lambda u, x, p: [x[1], x[3]],
    )
    return Statement("cycle", ("lowest", "standing", "flying"), (contact, flight), ("standing", "flying"))


@pytest.mark.parametrize("solver", ["newton", "multiple_shooting"])
@pytest.mark.parametrize("reference", [REFERENCES[2], REFERENCES[4]], ids=["constant", "varying"])
def test_a_phase_sequence_across_lift_off(reference, solver):
    machine = machine_of(reference)
    values = machine.values
    p = np.array(list(values.values()))
    orbit = find(machine)
    lowest = orbit(orbit.flight_time + orbit.contact_time / 2)[0]
    equations = Shooting(across_contact(machine.model), tuple(values))
    guess = np.array([lowest, orbit.contact_time / 2, orbit.flight_time / 2]) * [1.03, 0.98, 1.02]
    u, _ = getattr(equations, solver)(guess, p)
    assert u == pytest.approx([lowest, orbit.contact_time / 2, orbit.flight_time / 2], rel=1e-12)
    flight = equations.evaluate(u, p).trajectories[1]
    assert flight(0.0)[1] == pytest.approx(float(reference["alpha"]), rel=1e-12)


def test_the_unit_of_a_parameter_moves_the_end_as_a_state_does():
    """Of the linear spring k r, in closed form: r = cos(w t) + a/w sin(w t) with w**2 = k."""
    machine = Hopper("k*r + 0*r**3", parameters={"k": 2.25})
    equations, alpha, w = equations_of(machine.model, "relative", tuple(machine.values)), 5.0, 1.5
    found = equations.evaluate_all(np.array([[1.0, alpha]]), np.array([[*machine.values.values()]]), ("k",))
    c, s, t = np.cos(w * alpha), np.sin(w * alpha), alpha
    end, growth = np.array([c + alpha / w * s, alpha * c - w * s]), max(abs(c), abs(s) / w, w * abs(s))
    by_w = np.array([t * (alpha / w * c - s) - alpha / w**2 * s, -alpha * t * s - s - w * t * c])
    unit = growth * np.abs(end).max() / np.abs(by_w / (2 * w)).max()
    assert found.parameter_units == pytest.approx(np.array([[unit]]), rel=1e-10)


def test_derivatives_through_two_phases_and_a_parameter():
    machine = machine_of(REFERENCES[4])
    values = machine.values
    p = np.array(list(values.values()))
    equations = Shooting(across_contact(machine.model), tuple(values))
    u, vary = np.array([-2.0, 1.6, 3.0]), ("beta", "mass_ratio")
    jacobian = equations.evaluate(u, p, vary).jacobian
    step = 1e-6
    for j in range(5):
        moves = [(u.copy(), p.copy()), (u.copy(), p.copy())]
        for sign, (unknowns, parameters) in zip((1, -1), moves, strict=True):
            if j < 3:
                unknowns[j] += sign * step
            else:
                parameters[list(values).index(vary[j - 3])] += sign * step
        ends = [equations.evaluate(*move).residual for move in moves]
        assert jacobian[:, j] == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-6, abs=1e-6)


def bouncing_pendulum() -> tuple[Statement, tuple[str, ...]]:
    """A quarter of a pendulum's swing from the bottom to rest, its amplitude given: unknown speed and time."""
    phase = Phase("swing", ("angle", "rate"), lambda x, p, q: [x[1], -ca.sin(x[0])])
    arc = Arc(
        phase,
        start=lambda u, before, p: [0.0, u["rate"]],
        duration=lambda u, p: u["quarter"],
        conditions=lambda u, x, p: [x[0] - p["amplitude"], x[1]],
    )
    return Statement("pendulum", ("rate", "quarter"), (arc,), ("quarter",)), ("amplitude",)


@pytest.mark.parametrize("solver", ["newton", "multiple_shooting"])
@pytest.mark.parametrize("amplitude", [0.1, 1.5, 3.0])
def test_the_pendulum_has_its_elliptic_period(solver, amplitude):
    from scipy.special import ellipk

    equations = Shooting(*bouncing_pendulum())
    rate = 2 * np.sin(amplitude / 2)
    u, _ = getattr(equations, solver)([1.02 * rate, 0.98 * ellipk(np.sin(amplitude / 2) ** 2)], np.array([amplitude]))
    assert u == pytest.approx([rate, ellipk(np.sin(amplitude / 2) ** 2)], rel=1e-12)


def test_no_solution_is_an_error_in_words():
    statement, parameters = bouncing_pendulum()
    equations = Shooting(statement, parameters)
    with pytest.raises(NoOrbit, match=r"did not converge|becomes? infinite or undefined|no convergence|no solution"):
        equations.multiple_shooting([1.0, 1.0], np.array([40.0]))
    with pytest.raises(NoOrbit, match="did not converge"):
        equations.newton([1.0, 1.0], np.array([40.0]))


def test_parameter_derivatives_of_a_closed_form():
    """cos(w t) and its derivative with respect to the stiffness w^2."""
    phase = Phase(
        "swing",
        ("x", "v"),
        lambda x, p, q: [x[1], -p["k"] * x[0]],
        closed_form=lambda p: linear_modes([[1.0]], [[p["k"]]], [0.0]),
    )
    arc = Arc(phase, lambda u, before, p: [1.0, 0.0], lambda u, p: u["time"], lambda u, x, p: [x[0]])
    equations = Shooting(Statement("swing", ("time",), (arc,), ("time",)), ("k",))
    evaluation = equations.evaluate([1.2], np.array([2.0]), vary=("k",))
    w = np.sqrt(2.0)
    assert evaluation.residual == pytest.approx([np.cos(1.2 * w)], abs=1e-15)
    assert evaluation.jacobian == pytest.approx(
        np.array([[-w * np.sin(1.2 * w), -0.6 / w * np.sin(1.2 * w)]]), rel=1e-13
    )
