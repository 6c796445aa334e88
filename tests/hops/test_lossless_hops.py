"""Multipliers of many lossless hops from their halves, against those of each hop by its own motion."""

import numpy as np
import pytest
from columns import hop_of

from orbits import InputError, find, multipliers
from orbits.hops import CROSSINGS, LosslessHops, angles_left, is_crossing
from orbits.shooting import half_orbit, shooting_equations, vector
from problems import Hopper, runner


def solved(machine, orbit):
    """The names of the unknowns of half an orbit, a solution, its parameters, and the equations there."""
    equations, bare = shooting_equations(half_orbit(machine.model), tuple(machine.values)), orbit.dimensionless()
    known = machine.model.launch_at(bare.flight.coefficients[0, :, 0].tolist())
    known |= {"duration": bare.flight_time / 2, "contact_duration": bare.contact_time / 2}
    us, ps = np.array([[known[name] for name in equations.statement.unknowns]]), vector(machine.values)[None]
    return equations.statement.unknowns, us, ps, equations.evaluate_all(us, ps)


@pytest.mark.parametrize("kind", ["column", "cubic column", "plate", pytest.param("chain_hand", marks=pytest.mark.slow),
                                  pytest.param("runner", marks=pytest.mark.slow)])  # fmt: skip
def test_derivatives_are_those_of_the_hop_that_is_followed(kind):
    """The hop follows flight and contact from the launch on, with the landing and the lift-off that it finds."""
    if kind == "runner":
        orbit = find(runner(foot_mass=0.1, rest_length=3.7), tune=("inertia", "hip_stiffness"), at={"speed": 0.4})
        machine = orbit.source
    else:
        machine, orbit = hop_of(kind)
    expected, at = multipliers(machine, orbit), solved(machine, orbit)
    hops = LosslessHops(machine)
    (found,), (others,) = hops.derivatives(*at), hops.others(*at)
    assert np.abs(found - expected.matrix).max() <= 1e-12 * np.abs(expected.matrix).max()
    rest = np.delete(expected.values, np.abs(expected.values - 1).argmin())
    assert np.sort_complex(np.linalg.eigvals(others)) == pytest.approx(np.sort_complex(rest), abs=1e-10)


def test_crossings_are_zeros_of_their_test_functions():
    angle = np.exp(1j * np.array([1.0, -1.0]))
    rotation = np.array([[angle[0].real, -angle[0].imag], [angle[0].imag, angle[0].real]])
    at = {"multiplier 1": np.diag([1.0, 0.5]), "flip": np.diag([-1.0, 0.5]), "Neimark-Sacker": rotation}
    for kind, test in CROSSINGS.items():
        inside, on, outside = (test(size * at[kind][None])[0] for size in (0.9, 1.0, 1.1))
        assert on == pytest.approx(0.0, abs=1e-15)
        assert inside * outside < 0
        assert is_crossing(kind, at[kind])
    assert not is_crossing("Neimark-Sacker", np.diag([2.0, 0.5]))
    traces = [2 - 2 * np.cos(1.0), -0.5, -0.5]
    assert angles_left(np.array([rotation, np.diag([2.0, 0.5]), np.diag([-2.0, -0.5])])) == pytest.approx(traces)


def test_the_multiplier_of_a_launch_speed_crosses_nothing():
    with pytest.raises(InputError, match="one speed, so its lossless hops have one multiplier"):
        LosslessHops(Hopper())
