"""What is done for many at once, against the same one by one: motions to their zeros, contacts to their ends, functions
at many points, statements at many points, sensitivities column by column."""

import casadi as ca
import numpy as np
import pytest
from conftest import REFERENCES, machine_of

from orbits import FlowError, OutOfRange, ReturnMap, find, simulate
from orbits.elementwise import Rows
from orbits.flow import first_zero
from orbits.impacts import Impacts
from orbits.jets import variations
from orbits.shooting import Shooting, joined
from orbits.statements import equations_of
from problems import Hopper, springs

RANGE = np.linspace(-3, 3, 13)
MACHINES = {
    "cubic": Hopper("cubic", rest_length=30),
    "sinh in gravity": Hopper("sinh", "1/(1 + z/60)**2", rest_length=12),
    "a pole": Hopper("r/(1 - r/4)", rest_length=30),
    "bilinear": Hopper("bilinear", rest_length=30),
    "bilinear where it lifts off": Hopper(springs.bilinear(gap=1.0), rest_length=30),
    "end stops": Hopper("end_stops", rest_length=30),
    "a short table": Hopper(springs.table((RANGE, RANGE + 0.1 * RANGE**3)), rest_length=30),
}


@pytest.mark.parametrize("name", MACHINES)
def test_flights_to_their_landings(name):
    rules, rng = Impacts(MACHINES[name]), np.random.default_rng(7)
    x = rng.normal(0, 2.5, (60, 4))
    x[:, 2] = np.abs(x[:, 2])
    if "table" in name:
        x = x[np.abs(x[:, 0] - x[:, 2]) < 3]
    times, rows, failed = rules.flight.first_zeros(x, rules.p, rules.gap, 40.0)
    for i, start in enumerate(x):
        try:
            path, _ = rules.flight.run(start, rules.p, 40.0, stop=first_zero(rules.gap))
        except FlowError as error:
            reason = error
        else:
            reason = None
        assert type(failed.get(i)) is type(reason)
        if reason:
            continue
        if path.times[-1] < 40.0:
            assert times[i] == pytest.approx(path.times[-1], rel=1e-9, abs=1e-11)
            assert rows[i] == pytest.approx(path.end, rel=1e-8, abs=1e-8)
        else:
            assert np.isnan(times[i])


@pytest.mark.parametrize("name", MACHINES)
def test_contacts_to_their_ends(name):
    rules = Impacts(MACHINES[name])
    speeds = np.linspace(0.05, 6, 40)
    standing = np.column_stack([np.full(40, rules.launch(speeds)[0, 0] * 0.9), -speeds])
    status, ends = rules.stand_all(standing)
    for start, how, end in zip(standing, status, ends, strict=True):
        path, expected, _ = rules.stand(start)
        assert how == expected
        if how == "lifts_off":
            assert end == pytest.approx(path.end[:2], rel=1e-9, abs=1e-9)


def test_a_lift_off_on_a_break_is_not_lost():
    """The force vanishes where the law breaks: rounding on either side must not hide the sign's change."""
    rules = Impacts(MACHINES["bilinear where it lifts off"])
    hops = ReturnMap(rules.machine)(np.linspace(0.05, 3, 400))
    assert set(hops.status) <= {"lifts_off", "rests"}
    for alpha, how in list(zip(hops.alpha, hops.status, strict=True))[::40]:
        run = simulate(rules.machine, alpha, hops=2)
        assert (len(run.launches) > 1) == (how == "lifts_off")


@pytest.mark.parametrize(("extension", "speed"), [(0.5, 0.0), (0.5, 1.0), (0.5, -1.0)])
def test_a_start_on_a_break(extension, speed):
    """Of a bilinear spring, at rest too: against a start one rounding beside."""
    rules = Impacts(Hopper("bilinear", rest_length=30, parameters={"gap": 0.5, "ratio": 3.0}))
    x = np.array([[3 + extension, speed, 3.0, 0.0]])
    beside = x + np.array([[1e-13, 0, 0, 0]])
    one, two = (rules.flight.first_zeros(start, rules.p, rules.gap, 60.0) for start in (x, beside))
    assert one[0] == pytest.approx(two[0], rel=1e-10)
    assert one[1] == pytest.approx(two[1], rel=1e-9)
    path, _ = rules.flight.run(x[0], rules.p, 60.0, stop=first_zero(rules.gap))
    assert path.times[-1] == pytest.approx(one[0][0], rel=1e-12)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_start_on_the_range_s_end(side):
    """Inward it is followed, outward refused."""
    rules = Impacts(MACHINES["a short table"])
    starts = np.array([[20.0 + 3 * side, side * speed, 20.0, 0.0] for speed in (-1.0, 1.0)])
    failed = rules.flight.first_zeros(starts, rules.p, rules.gap, 0.5)[2]
    assert isinstance(failed[1], OutOfRange)
    assert 0 not in failed
    with pytest.raises(OutOfRange, match="outside the law's range"):
        rules.flight.run(starts[1], rules.p, 0.5)


def test_functions_at_many_points():
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    results = [
        ca.vertcat(x[0] * ca.sin(p[1]), 2.0, ca.if_else(x[1] > 0, x[2] ** 2, ca.exp(x[1])), 0),
        ca.SX(0, 1),
        ca.vertcat(p[0], ca.fmin(x[0], x[1]), ca.atan2(x[0], x[1])),
    ]
    function = ca.Function("f", [x, p], results)
    rng, rows = np.random.default_rng(3), Rows(function)
    for count in (1, 2, 7, 100):
        points, parameters = rng.normal(size=(count, 3)), rng.normal(size=(count, 2))
        for given in (parameters, parameters[:1]):
            found = rows(points, given)
            for i in range(count):
                expected = function(points[i], given[min(i, len(given) - 1)])
                for mine, theirs in zip(found, expected, strict=True):
                    assert mine[i] == pytest.approx(theirs.full().ravel(), rel=1e-15)


def test_sensitivities_with_columns_of_nothing():
    """A field with a constant rate, a parameter that it does not have and one that enters alone."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 3)
    field = ca.Function("f", [x, p], [ca.vertcat(x[1], -x[0] * p[0], p[2]), x[0] * x[1]])
    series, column = variations(field, (0, 1, 2), 20)
    start, values, h, step = np.array([1.0, 0.5, 0.2]), np.array([2.0, 5.0, 0.3]), 0.3, 1e-6
    powers = h ** np.arange(21)

    def end(start, values):
        return powers @ series(start, values)[0].full()[:, :3]

    slopes = series(start, values)[1]
    for i in range(6):
        change = np.eye(6)[i]
        dx = powers @ column(slopes, change[:3], change[3:]).full()
        moved = [end(start + sign * step * change[:3], values + sign * step * change[3:]) for sign in (1, -1)]
        assert dx == pytest.approx((moved[0] - moved[1]) / (2 * step), abs=1e-8)


def cubics(count: int) -> tuple[Shooting, np.ndarray, np.ndarray, list[np.ndarray]]:
    """The equations of cubic springs in varying gravity, `count` points off their orbits, with their parameters, and a
    mesh that is fine enough for all."""
    machine = machine_of(REFERENCES[4])
    equations, orbit = equations_of(machine.model, "half orbit", tuple(machine.values)), find(machine)
    xs = np.array([orbit.liftoff_extension, orbit.alpha, orbit.flight_time / 2, machine.values["beta"]])
    xs = xs * (1 + 1e-3 * np.random.default_rng(5).normal(size=(count, 4)))
    ps = np.tile(list(machine.values.values()), (count, 1))
    ps[:, list(machine.values).index("beta")] = xs[:, 3]
    path = equations.evaluate(xs[0, :3], ps[0], ("beta",)).trajectories[0]
    return equations, xs, ps, [np.linspace(0, 1, 2 * len(path.steps))]


def test_a_statement_at_many_points():
    """On one mesh in one call; on a mesh too coarse, each with the steps it needs."""
    equations, xs, ps, fine = cubics(9)
    for meshes in (fine, [np.linspace(0, 1, 3)]):
        here = equations.evaluate_all(xs[:, :3], ps, ("beta",), meshes)
        halves = joined([here[np.arange(4)], here[np.arange(8, 3, -1)]])
        for i, (x, p) in enumerate(zip(xs, ps, strict=True)):
            one = equations.evaluate(x[:3], p, ("beta",))
            for some in (here[i], halves[i if i < 4 else 12 - i]):
                assert some.residual == pytest.approx(one.residual, abs=1e-12)
                assert some.jacobian == pytest.approx(one.jacobian, rel=1e-11, abs=1e-11)
                assert some.growth == pytest.approx(one.growth, rel=1e-11)
                assert some.trajectories[0].end == pytest.approx(one.trajectories[0].end, abs=1e-12)
        assert list(here.growth) == [here[i].growth for i in range(9)]


def test_a_newton_step_at_once():
    equations, xs, ps, fine = cubics(3)
    rows = np.random.default_rng(6).normal(size=(3, 4))
    levels = np.einsum("mi,mi->m", rows, xs) + 0.01
    there, here = equations.ahead(xs, ps, "beta", fine, rows, levels)
    for i, (x, p) in enumerate(zip(xs, ps, strict=True)):
        one = equations.evaluate(x[:3], p, ("beta",))
        step = np.linalg.solve(np.vstack([one.jacobian, rows[i]]), np.append(-one.residual, 0.01))
        assert there[i] == pytest.approx(x + step, rel=1e-11)
        beta = p.copy()
        beta[p == x[3]] = there[i, 3]
        assert here[i].residual == pytest.approx(equations.evaluate(there[i, :3], beta).residual, abs=1e-11)


def test_a_newton_step_from_where_the_mesh_is_too_coarse():
    """Although it may lead to a motion so short that the mesh serves it."""
    equations, xs, ps, _ = cubics(1)
    for count in (2, 3, 4):
        mesh = [np.linspace(0, 1, count)]
        assert equations.ahead(xs, ps, "beta", mesh, np.eye(4)[[2]], np.array([1e-3])) is None
