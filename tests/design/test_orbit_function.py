"""An orbit as a function of CasADi: its derivatives are those of neighbouring orbits, and Ipopt finds with it the
optima that `optimize` finds."""

import casadi as ca
import numpy as np
import pytest
from conftest import slow_after

from orbits import InputError, NoOrbit, find, find_all, optimize, orbit_function, sensitivities, starts
from problems import (
    Chain,
    HeavyHand,
    Hopper,
    hopper_in_si,
    knee_hopper,
    plate_hopper,
    rimless_wheel,
    rocking_block,
    shuttle,
    springs,
)  # fmt: skip

CUBIC = Hopper("r + beta*r**3", mass_ratio=0.5, rest_length=10, parameters={"beta": 0.3})
LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 5000.0, "b": 1e6}, rest_length=0.8)
ROWS = np.linspace(-14, 14, 97)
MEASURED = springs.table((ROWS, ROWS + 0.02 * ROWS**3), noise=0, scale="b", shift="d")
SHARES = np.array([0.03, 0.2, 0.45, 0.7, 0.9, 1.2])  # of the period, in both halves of flight and contact


def first(machine):
    return find(machine)


def of_plate(machine):
    return next(hop for hop in find_all(machine, starts(machine, 3, 3)) if hop.admissible)


def of_chain(machine):
    return find_all(machine, machine.starts(5, 5))[0]


MACHINES = {
    "cubic": (CUBIC, ["beta", "mass_ratio"], first),
    "linear": (Hopper(), "mass_ratio", first),
    "in SI": (LEG, ["k", "b", "foot_mass"], first),
    "knee": (knee_hopper(), ["stiffness", "link"], first),
    "plate": (plate_hopper(), ["plate_stiffness", "m3"], of_plate),
    "chain": (Chain((1, 1, 1)), ["m1", "m2"], of_chain),
    "corner": (Hopper("bilinear", mass_ratio=0.5, rest_length=12), ["gap", "ratio"], first),
    "table": (Hopper(MEASURED, mass_ratio=0.5, rest_length=10, parameters={"b": 1.2, "d": 0.1}), ["b", "d"], first),
    "heavy hand": (HeavyHand("cubic", parameters={"beta": 0.1}), ["beta"], first),
    "gravity": (
        Hopper("cubic", "1/(1 + z/R)**2", rest_length=20, parameters={"beta": 0.1, "R": 150.0}), ["beta", "R"], first
    ),
    "wheel": (rimless_wheel(inertia_ratio=0.7, gravity_ratio=0.5, angle=0.3), ["angle", "inertia_ratio"], first),
    "block": (rocking_block(2.0, 0.1, 0.3, 0.3, 0.3, 20.0), ["half_width", "stiffness"], first),
    "shuttle": (shuttle(inertia_ratio=1.0, gravity_ratio=0.5), ["inertia_ratio"], first),
}  # fmt: skip


def slopes_by_differences(function, arguments, i, step):
    """Derivatives of all results by an argument, by differences of order four of re-solved orbits."""
    columns = []
    for j in range(len(arguments[i])):
        h, rows = step * max(abs(arguments[i][j]), 0.1), []
        for s in (-2, -1, 1, 2):
            moved = [each.copy() for each in arguments]
            moved[i][j] += s * h
            rows.append(np.concatenate([np.array(each).ravel("F") for each in function(*moved)]))
        columns.append((rows[0] - 8 * rows[1] + 8 * rows[2] - rows[3]) / (12 * h))
    return np.array(columns).T


# The quicker of them run always.
KINDS = [
    pytest.param(kind, marks=[pytest.mark.slow] if kind in ("plate", "gravity", "knee", "table", "block") else [])
    for kind in MACHINES
]


@pytest.mark.parametrize("kind", slow_after(4, KINDS))
def test_derivatives_are_those_of_neighbouring_orbits(kind):
    machine, over, find_one = MACHINES[kind]
    orbit = find_one(machine)
    t = SHARES * orbit.period
    function = orbit_function(machine, over, orbit, times=len(t))
    theta = np.array([machine.values[name] for name in ([over] if isinstance(over, str) else over)])
    launch, durations, states = function(theta, t)
    assert np.array(states) == pytest.approx(orbit(t).T)
    assert np.array(durations).ravel() == pytest.approx([orbit.flight_time, orbit.contact_time])
    assert float(launch[1]) == pytest.approx(orbit.alpha)
    blocks = [np.array(each) for each in function.jacobian()(theta, t, launch, durations, states)]
    for i, exact in enumerate((np.vstack(blocks[::2]), np.vstack(blocks[1::2]))):
        expected = slopes_by_differences(function, [theta, t], i, 1e-4 if i == 0 else 1e-5)
        size = np.maximum(1.0, np.abs(expected).max(axis=1, keepdims=True))
        assert np.abs(exact - expected).max() == pytest.approx(0, abs=3e-8 * size.max())


def test_it_has_the_quantities_and_their_derivatives():
    texts = ["stroke", "largest_contact_force/flight_time"]
    function = orbit_function(CUBIC, ["beta"], quantities=texts)
    assert function.name_out() == ["launch", "durations", "quantities"]
    theta, expected = ca.MX.sym("theta"), sensitivities(CUBIC, 1, ["beta"], texts)
    results = function(theta)[2]
    values, slopes = ca.Function("both", [theta], [results, ca.jacobian(results, theta)])(0.3)
    assert np.array(values).ravel() == pytest.approx([expected.at[text] for text in texts], rel=1e-12)
    assert np.array(slopes).ravel() == pytest.approx([expected[text]["beta"] for text in texts], rel=1e-9)


class TestWithinOtherProblems:
    @pytest.mark.slow
    def test_ipopt_finds_the_optimum_of_optimize(self):
        """The least contact force at a rise of the centre of mass."""
        over, wanted = {"k": (3e3, 9e3), "b": (0.0, 2e6)}, "centre_of_mass_rise == 0.04"
        best = optimize(LEG, minimise="largest_contact_force", over=over, subject_to=[wanted])
        theta = ca.MX.sym("theta", 2)
        size = ca.DM([1e3, 1e6])
        found = orbit_function(LEG, [*over], quantities=["largest_contact_force", "centre_of_mass_rise"])(theta * size)
        problem = {"x": theta, "f": found[2][0] / 1e3, "g": found[2][1]}
        quiet = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": 1e-9}
        solver = ca.nlpsol("s", "ipopt", problem, {**quiet, "ipopt.hessian_approximation": "exact"})
        solution = solver(x0=[5.0, 1.0], lbx=[3.0, 0.0], ubx=[9.0, 2.0], lbg=0.04, ubg=0.04)
        assert solver.stats()["return_status"] == "Solve_Succeeded"
        assert float(solution["f"]) * 1e3 == pytest.approx(best.objective, rel=1e-6)

    def test_a_state_is_put_where_it_is_wanted(self):
        """Newton's method of CasADi on the mass ratio: the foot at a height at mid-flight."""
        theta = ca.MX.sym("theta")
        _, durations, _ = orbit_function(CUBIC, "mass_ratio", times=1)(theta, 1.0)
        height = orbit_function(CUBIC, "mass_ratio", times=1)(theta, durations[0] / 2)[2][2]
        wanted = find(CUBIC.with_values(mass_ratio=0.7)).state_mid_flight[2]
        root = ca.rootfinder("root", "newton", {"x": theta, "g": height - float(wanted)})
        assert float(root(x0=0.5)["x"]) == pytest.approx(0.7, rel=1e-9)


class TestRefusals:
    def test_a_fold_is_not_passed(self):
        function = orbit_function(Hopper("cubic", rest_length=30), "beta", find(Hopper("cubic", rest_length=30)))
        with pytest.raises(RuntimeError, match="cannot be followed to beta"):
            function(-0.02)

    @pytest.mark.parametrize(
        ("arguments", "options", "words"),
        [
            (("gamma",), {}, "no parameter 'gamma'"),
            (([],), {}, "must name the parameters"),
            ((["beta", "beta"],), {}, "each once"),
            (("beta",), {"times": -1}, "times"),
            (("beta",), {"quantities": "height"}, "unknown quantity 'height'"),
        ],
    )
    def test_bad_input(self, arguments, options, words):
        with pytest.raises(InputError, match=words):
            orbit_function(CUBIC, *arguments, **options)

    def test_machines_that_lose_energy(self):
        with pytest.raises(NoOrbit, match="hysteresis loses energy on every hop"):
            orbit_function(Hopper(springs.lossy("r", loss_factor=0.1)), "loss_factor")
        with pytest.raises(InputError, match=r"a hopper has no reversor: .* the second must be its mirror"):
            orbit_function(Hopper(damping=0.1), "damping")
