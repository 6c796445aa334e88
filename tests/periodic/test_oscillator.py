"""Oscillations of a machine as a problem of curves: equilibria, normal modes, multipliers, and refusals."""

from types import SimpleNamespace

import numpy as np
import pytest

from orbits import InputError, Mechanism, NoOrbit, find
from orbits.curves import started
from orbits.mechanics import Damper, Potential, Spring
from orbits.periodic import oscillation_curve
from orbits.periodic.oscillation_curve import ERROR, MULTIPLIERS, near_rest
from orbits.periodic.oscillator import Oscillator
from problems import Hopper, springs
from tests.free_machines import chain_of_carts, double_pendulum, henon_heiles, pendulum


def test_normal_modes_of_a_double_pendulum():
    """Frequencies squared are 2 - sqrt(2) and 2 + sqrt(2), and the angles are as 1 to plus or minus sqrt(2)."""
    modes = Oscillator(double_pendulum()).modes
    assert np.abs(modes.frequencies**2 - [2 - np.sqrt(2), 2 + np.sqrt(2)]).max() < 1e-14
    assert np.abs(modes.shapes[1] / modes.shapes[0] - [np.sqrt(2), -np.sqrt(2)]).max() < 1e-14
    assert np.abs(modes.shapes.T @ [[2, 1], [1, 1]] @ modes.shapes - np.eye(2)).max() < 1e-14


def test_equilibria_of_a_machine_that_stands():
    """A hopper of mass ratio 0.5 rests where r + 0.1 r**3 = -2; a table of a line as the line."""
    machine = Hopper("cubic", mass_ratio=0.5, rest_length=30, parameters={"beta": 0.1})
    (rest,) = Oscillator(machine).rest
    assert abs(rest + 0.1 * rest**3 + 2) < 1e-14
    rows = np.linspace(-6, 6, 13)
    table = Oscillator(Hopper(springs.table([rows, rows]), mass_ratio=0.5, rest_length=30))
    assert abs(table.rest[0] + 2) < 1e-12


def test_the_multipliers_of_a_chain_are_those_of_its_other_modes():
    """exp(i w_j T) of three carts, whose frequencies are known from the eigenvalues of the stiffness."""
    curve = near_rest(Oscillator(chain_of_carts(1.0, 0.7, 0.4, 0.9)), 1, 1.0)
    (own,) = started(curve, curve.first[None]).own
    frequencies = np.sqrt(np.linalg.eigvalsh([[1.7, -0.7, 0], [-0.7, 1.1, -0.4], [0, -0.4, 1.3]]))
    expected = np.exp(1j * frequencies[1:] * 2 * np.pi / frequencies[0])
    found = own[MULTIPLIERS : MULTIPLIERS + 4] + 1j * own[MULTIPLIERS + 4 :]
    for value in (*expected, *expected.conj()):
        assert np.abs(found - value).min() < 1e-12
    assert own[ERROR] < 1e-13


@pytest.mark.parametrize(("angles", "sign"), [((0.3, 1.1), 1), ((0.7, 0.7), 0), (None, -1)])
def test_collisions_of_multipliers(angles, sign):
    """The discriminant of the sums of multipliers: two pairs on the circle, both at one place, and a quadruple."""
    values = np.exp(1j * np.array(angles)) if angles else np.array([1.2 * np.exp(0.5j), np.exp(0.5j) / 1.2])
    blocks = [np.array([[z.real, z.imag], [-z.imag, z.real]]) for z in values]
    matrix = np.block([[blocks[0], np.zeros((2, 2))], [np.zeros((2, 2)), blocks[1]]])
    base = np.random.default_rng(3).normal(size=(4, 4))
    problem = SimpleNamespace(n=3, others=lambda points: np.array([base @ matrix @ np.linalg.inv(base)]))
    (found,) = oscillation_curve._collisions(problem, [None])
    first, second = values + 1 / values
    assert abs(found - ((first - second) ** 2).real) < 1e-10
    assert sign == 0 or np.sign(found) == sign


@pytest.mark.parametrize(
    ("machine", "options", "error", "text"),
    [
        (henon_heiles(), {}, NoOrbit, "normal mode 1 is resonant: the frequency of another one is 1 times"),
        (Hopper(damping=0.1), {}, NoOrbit, "set the damping to 0"),
        (Mechanism(("u",), [Spring("u"), Damper("u", 0.1)], gap=None, inertia={"u": 1.0}), {}, NoOrbit, "damped"),
        (Mechanism(("u",), [Potential("u**4/4 - u**2/2")], gap=None, inertia={"u": 1.0}), {}, NoOrbit,
         "the equilibrium u = 0 is not stable along normal mode 1"),
        (pendulum(), {"family": 2}, InputError, "the normal modes of this machine are numbered from 1 to 1"),
        (Mechanism(("u",), [Potential("exp(u)")], gap=None, inertia={"u": 1.0}), {}, NoOrbit, "no equilibrium"),
        (henon_heiles(), {"start": {"x": 0.2, "y": 0.05, "duration": 6.3}}, NoOrbit, "start leads to no oscillation"),
        (henon_heiles(), {"start": {"z": 0.2}}, InputError, "start has no 'z'"),
        (henon_heiles(), {"start": {"x'": 0.2}}, InputError, "start has the speed x' and no 'duration'"),
        (henon_heiles(), {"start": {"x": 0.2, "duration": -1}}, InputError, "'duration' = -1; it must be above 0"),
        (pendulum(), {"at": {"energy": 0.0}}, InputError, "an energy is above that at the equilibrium, 0"),
        (pendulum(), {"method": "shooting"}, InputError, "without a method="),
    ],
)  # fmt: skip
def test_refusals(machine, options, error, text):
    with pytest.raises(error, match=text):
        find(machine, **{"at": {"energy": 0.02}, **options})
