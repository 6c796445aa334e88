"""Computations for many points in one call against the same one by one: motions to their zeros, contacts to their ends,
functions, statements, Newton steps, and sensitivities column by column."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from conftest import REFERENCES, machine_of
from scipy.integrate import solve_ivp

from orbits import ReturnMap, find, simulate
from orbits.continuation.corrector import correct, correct_all, newton_steps, predict_and_correct
from orbits.continuation.curve import Curve, interpolated
from orbits.errors import FlowError, OutOfRange
from orbits.flow.flow import flow_of
from orbits.flow.vector_field import FlowControl
from orbits.flow.zero_crossing import first_zero, first_zeros, until_zero
from orbits.model.phase import Affine
from orbits.shooting.formulations import equations_of
from orbits.shooting.newton_kernel import NewtonKernel
from orbits.shooting.single_shooting import Shooting, joined
from orbits.simulation.impacts import Impacts
from orbits.symbolic.calls import BufferedFunction, ElementwiseFunction
from orbits.symbolic.taylor_series import variations
from problems import Hopper
from problems.laws import springs

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
    times, rows, failed = first_zeros(rules.flight, x, rules.p, rules.gap, 40.0)
    assert first_zeros(rules.flight, x, rules.p, rules.gap, 40.0, told=False)[2].keys() == failed.keys()
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
    status, ends = rules.sustained_contacts(standing)
    for start, how, end in zip(standing, status, ends, strict=True):
        path, expected, _ = rules.sustained_contact(start)
        assert how == expected
        if how == "lifts_off":
            assert end == pytest.approx(path.end[:2], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", ["cubic", "sinh in gravity"])
def test_motions_up_to_a_zero(name):
    """Motions of few steps and of many, in their order; those that do not get there are left out."""
    rules, rng = Impacts(MACHINES[name]), np.random.default_rng(8)
    p, starts = np.tile(rules.p, (40, 1)), rng.normal(0, 4, (40, 2))
    starts[7] = np.nan
    back = Affine((1.0, 0.0, 0.0))
    for _ in range(2):  # the second time it is known how many steps it takes
        which, motions = until_zero(rules.contact, starts, p, back)
        assert which.tolist() == [i for i in range(40) if i != 7]
        for i, path in zip(which, motions, strict=True):
            one, _ = rules.contact.run(starts[i], rules.p, 100.0, stop=first_zero(back))
            assert path.times[-1] == pytest.approx(one.times[-1], rel=1e-12)
            assert path.end == pytest.approx(one.end, rel=1e-10, abs=1e-10)
    assert motions.counts.min() <= 6 < motions.counts.max()


def test_motions_of_too_many_steps_leave_the_others_alone(monkeypatch):
    """They are left out, and those of fewer are followed together the next time too."""
    monkeypatch.setattr("orbits.flow.flow.Flow.control", FlowControl(max_block=6))
    rules, back = Impacts(MACHINES["cubic"]), Affine((1.0, 0.0, 0.0))
    starts = np.random.default_rng(8).normal(0, 4, (40, 2))
    for _ in range(2):
        which, motions = until_zero(rules.contact, starts, np.tile(rules.p, (40, 1)), back)
        assert 0 < len(which) < 40
        assert motions.counts.max() == 6


def test_a_motion_that_breaks_down_later_still_has_its_zero():
    """A spring with a pole: what comes after the zero within the same block of steps does not matter."""
    rules, back = Impacts(MACHINES["a pole"]), Affine((1.0, 0.0, 0.0))
    starts = np.array([[2.0, -1.0], [2.0, -3.0], [3.5, -20.0], [-1.0, -1.0]])
    which, motions = until_zero(rules.contact, starts, np.tile(rules.p, (4, 1)), back)
    for i, path in zip(which, motions, strict=True):
        one, _ = rules.contact.run(starts[i], rules.p, 100.0, stop=first_zero(back))
        assert path.times[-1] == pytest.approx(one.times[-1], rel=1e-12)
    assert {0, 1} <= set(which.tolist())


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
    one, two = (first_zeros(rules.flight, start, rules.p, rules.gap, 60.0) for start in (x, beside))
    assert one[0] == pytest.approx(two[0], rel=1e-10)
    assert one[1] == pytest.approx(two[1], rel=1e-9)
    path, _ = rules.flight.run(x[0], rules.p, 60.0, stop=first_zero(rules.gap))
    assert path.times[-1] == pytest.approx(one[0][0], rel=1e-12)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_start_on_the_range_s_end(side):
    """Inward it is followed, outward refused."""
    rules = Impacts(MACHINES["a short table"])
    starts = np.array([[20.0 + 3 * side, side * speed, 20.0, 0.0] for speed in (-1.0, 1.0)])
    failed = first_zeros(rules.flight, starts, rules.p, rules.gap, 0.5)[2]
    assert isinstance(failed[1], OutOfRange)
    assert 0 not in failed
    with pytest.raises(OutOfRange, match="leaves the law's range"):
        rules.flight.run(starts[1], rules.p, 0.5)


def test_functions_at_many_points():
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    results = [
        ca.vertcat(x[0] * ca.sin(p[1]), 2.0, ca.if_else(x[1] > 0, x[2] ** 2, ca.exp(x[1])), 0),
        ca.SX(0, 1),
        ca.vertcat(p[0], ca.fmin(x[0], x[1]), ca.atan2(x[0], x[1])),
    ]
    function = ca.Function("f", [x, p], results)
    rng, rows = np.random.default_rng(3), ElementwiseFunction(function)
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
    series = variations(field, (0, 1, 2), 6, 20)
    start, values, h, step = np.array([1.0, 0.5, 0.2]), np.array([2.0, 5.0, 0.3]), 0.3, 1e-6
    powers = h ** np.arange(21)

    def end(start, values):
        return powers @ series(start, values, 0, 0)[0].full()[:, :3]

    slopes = powers @ series(start, values, *np.vsplit(np.eye(6), 2))[1].full()
    for i, dx in enumerate(slopes.reshape(6, 3)):
        change = np.eye(6)[i]
        moved = [end(start + sign * step * change[:3], values + sign * step * change[3:]) for sign in (1, -1)]
        assert dx == pytest.approx((moved[0] - moved[1]) / (2 * step), abs=1e-8)


def cubics(count: int) -> tuple[Shooting, np.ndarray, np.ndarray, int]:
    """The equations of cubic springs in varying gravity, `count` points off their orbits, with their parameters, and
    the steps that the first takes."""
    machine = machine_of(REFERENCES[4])
    equations, orbit = equations_of(machine.model, "half orbit", tuple(machine.values)), find(machine)
    xs = np.array([orbit.liftoff_extension, orbit.alpha, orbit.flight_time / 2, machine.values["beta"]])
    xs = xs * (1 + 1e-3 * np.random.default_rng(5).normal(size=(count, 4)))
    ps = np.tile(list(machine.values.values()), (count, 1))
    ps[:, list(machine.values).index("beta")] = xs[:, 3]
    path = equations.evaluate(xs[0, :3], ps[0], ("beta",)).trajectories[0]
    return equations, xs, ps, len(path.steps)


def assert_same(some, one):
    """Two evaluations of a statement agree, up to the order of their roundings."""
    assert some.residual == pytest.approx(one.residual, abs=1e-12)
    assert some.jacobian == pytest.approx(one.jacobian, rel=1e-11, abs=1e-11)
    assert some.amplification == pytest.approx(one.amplification, rel=1e-11)
    assert some.trajectories[0].end[:4] == pytest.approx(one.trajectories[0].end[:4], abs=1e-12)


def test_a_statement_at_many_points():
    equations, xs, ps, _ = cubics(9)
    here = equations.evaluate_all(xs[:, :3], ps, ("beta",))
    halves = joined([here[np.arange(4)], here[np.arange(8, 3, -1)]])
    assert list(here.amplification) == [here[i].amplification for i in range(9)]
    for i, (x, p) in enumerate(zip(xs, ps, strict=True)):
        one = equations.evaluate(x[:3], p, ("beta",))
        assert_same(here[i], one)
        assert_same(halves[i if i < 4 else 12 - i], one)


def test_newton_steps_of_many_points():
    """In one call and one by one; both lead to where the equations hold to second order."""
    equations, xs, ps, _ = cubics(9)
    rows = np.random.default_rng(6).normal(size=xs.shape)
    targets = np.einsum("mi,mi->m", rows, xs) + 1e-6
    found = newton_steps(equations.evaluate_all(xs[:, :3], ps, ("beta",)), xs, rows, targets)
    there = joined([equations.evaluate_all(x[None], p[None], ("beta",)) for x, p in zip(xs[:, :3], ps, strict=True)])
    steps, directions = newton_steps(there, xs, rows, targets)
    assert found[0] == pytest.approx(steps, rel=1e-10)
    assert found[1] == pytest.approx(directions, rel=1e-10)
    assert np.einsum("mi,mi->m", rows, xs + steps) == pytest.approx(targets, rel=1e-12)
    betas = ps.copy()
    betas[ps == xs[:, 3:]] = (xs + steps)[:, 3]
    after = equations.evaluate_all((xs + steps)[:, :3], betas)
    for i in range(9):
        assert after.residual[i] == pytest.approx(np.zeros(3), abs=30 * np.max(np.abs(steps[i])) ** 2)


def test_motions_of_many_steps_among_others(monkeypatch):
    """Motions of more steps than there is room for are followed by themselves; all come in their order."""
    equations = equations_of(Hopper("cubic").model, "relative", tuple(Hopper("cubic").values))
    us, ps = np.array([[1.0, 4.49], [1.0, 40.0], [0.9, 4.6]]), np.tile(list(Hopper("cubic").values.values()), (3, 1))
    here = equations.evaluate_all(us, ps, ("beta",))
    monkeypatch.setattr("orbits.flow.flow.Flow.control", FlowControl(max_block=8))
    there = equations.evaluate_all(us, ps, ("beta",))
    assert (here.trajectories[0].counts == there.trajectories[0].counts).all()
    assert there.residual == pytest.approx(here.residual, abs=1e-10)
    assert there.jacobian == pytest.approx(here.jacobian, rel=1e-9, abs=1e-9)
    assert there.trajectories[0].finals == pytest.approx(here.trajectories[0].finals, abs=1e-9)
    with pytest.raises(FlowError, match="cannot start"):
        equations.evaluate_all(us * [[1, 1], [1, -1], [1, 1]], ps, ("beta",))


def test_steps_share_the_time_and_are_halved_in_vain():
    """A saturated spring, flat to the last digit where the motion starts: the series does not know what comes after."""
    along = flow_of(Hopper("tanh", parameters={"b": 1.0}).model.reduction.statement.arcs[0].phase, ("b",))
    start, p, duration, count = np.array([-30.0, 4.0]), np.array([1.0]), 12.0, 60
    end, _, _, (taken, tried) = BufferedFunction(along.stepper(0).step_function.mapaccum(count))(
        [*start, duration, 1e9], np.ones((count, 1))
    )
    assert taken.sum() == pytest.approx(duration, rel=1e-15)
    assert end[2, -1] == 0.0
    in_vain = np.flatnonzero((taken == 0) & (tried > 0))
    assert len(in_vain) > 0
    assert (tried[in_vain + 1] <= 0.5 * tried[in_vain]).all()
    assert taken[tried > 0][-1] > 0.2 * taken.max()
    path, _ = along.run(start, p, duration)
    assert path.steps == pytest.approx(taken[taken > 0], rel=1e-12)
    true = solve_ivp(lambda t, x: [x[1], -np.tanh(x[0])], (0, duration), start, "DOP853", rtol=1e-13, atol=1e-13)
    assert end[:2, -1] == pytest.approx(true.y[:, -1], abs=1e-9)
    assert path.end[:2] == pytest.approx(end[:2, -1], abs=1e-12)
    starts = np.array([[-30.0, 4.0], [-20.0, 4.0], [-8.0, 4.0]])
    which, motions = until_zero(along, starts, np.ones((3, 1)), Affine((1.0, 0.0)))
    assert which.tolist() == [0, 1, 2]
    for start, path in zip(starts, motions, strict=True):
        one, _ = along.run(start, p, stop=first_zero(Affine((1.0, 0.0))))
        assert path.times[-1] == pytest.approx(one.times[-1], rel=1e-12)
    assert (motions.steps > 0).all()


@pytest.mark.parametrize("height", [-1e-17, 0.0, 1e-17])
def test_a_zero_before_a_step_in_vain(height):
    """The foot leaves the ground, but for rounding, where a spring with a sharp kink has no series that serves."""
    rules, foot = Impacts(Hopper("r - log(1 + exp(-20*(r + 2)))/10")), Affine((0.0, 0.0, 1.0, 0.0))
    # Without the bound on how far a step may go, steps are taken in vain.
    flight = flow_of(replace(rules.flight.phase, reaches=()), rules.flight.parameters)
    starts = np.array([[r + height, v, height, w] for r in (2.0, 4.0, 6.0) for v in (-2.0, 1.0) for w in (0.3, 2.0)])
    ps = np.tile(rules.p, (len(starts), 1))
    stepper = flight.stepper(0)
    states = np.column_stack([starts, np.full((len(starts), 2), (np.inf, 1e9))])
    assert any(stepper.step_function(z, p)[3][0] == 0 for z, p in zip(states, ps, strict=True))
    times, _, failed = first_zeros(flight, starts, rules.p, foot, 50.0, 1)
    which, motions = until_zero(flight, starts, ps, foot, 1)
    landings = [flight.run(start, rules.p, stop=first_zero(foot, 1))[0].times[-1] for start in starts]
    assert not failed
    assert times == pytest.approx(landings, rel=1e-10)
    assert motions.ends == pytest.approx(np.array(landings)[which], rel=1e-10)


def test_motions_at_rest_and_of_many_steps():
    """What does not move has steps of any length; a motion of a given time ends then, however many steps it takes."""
    along, p = flow_of(Hopper("cubic").model.reduction.statement.arcs[0].phase, ("beta",)), np.array([1.0])
    nothing = np.zeros((2, 0)), np.zeros((1, 0))
    still = along.stepper(0).advance_all(np.zeros((2, 2)), np.ones((2, 1)), np.full(2, 1e10), *nothing)
    assert (still.left == 0).all()
    assert (still.steps > 1e8).all()
    for time in np.random.default_rng(3).uniform(1, 300, 30):
        path, _ = along.run([3.0, 0.0], p, time)
        assert path.times[-1] == time
        assert path.steps.min() > 1e-3


def test_a_step_along_a_curve_at_once():
    """A step in one call, against the interpolant and the corrector that it is made of."""
    curve = Curve(Hopper("cubic"), "beta", "relative", 1.0)
    row = np.array([0.0, 0.0, 1.0])
    ends = [correct(curve, np.array([1.0, 4.49, 0.0]), row, 0.0, row)]
    for beta in (0.01, 0.03, 0.05, 0.08):
        ends.append(correct(curve, ends[-1].x, row, beta, row))
        for value in (None, beta + 0.04):
            end, guess, rests = predict_and_correct(curve, ends[-4:], 0.05, value)
            last = ends[-1]
            measure = last.tangent / curve.size(last.x) ** 2
            level = measure @ last.x + 0.05
            closing, target = (measure, level) if value is None else (row, value)
            assert rests == min(len(ends), 4)
            assert closing @ guess == pytest.approx(target, rel=1e-13)
            if value is None:
                assert guess == pytest.approx(interpolated(ends[-4:], measure, np.array([level]))[0], rel=1e-13)
            one = correct(curve, guess, closing, target, last.tangent)
            assert end.x == pytest.approx(one.x, rel=1e-13)
            # Both tangents, and the growth at this end, are those before the last Newton step.
            assert end.tangent == pytest.approx(one.tangent, rel=1e-8)
            assert end.amplification == pytest.approx(one.amplification, rel=1e-8)


def test_newton_steps_in_lanes_and_one_after_the_other(monkeypatch):
    """Points that need different numbers of steps, some at values of the parameter; and what lanes cannot solve."""
    curve = Curve(machine_of(REFERENCES[4]), "beta", "half orbit", 1.0)
    _, xs, _, _ = cubics(9)
    xs[4] = xs[2] * (1 + 3e-3)
    rows = np.tile(np.eye(4)[3], (9, 1))
    rows[::2] = [0.1, 1.0, 0.0, 0.5]
    levels = np.einsum("mi,mi->m", rows, xs)
    before = np.tile(np.eye(4)[3], (9, 1))
    solve, found = NewtonKernel.__call__, []
    monkeypatch.setattr(NewtonKernel, "__call__", lambda *arguments: found.append(solve(*arguments)) or found[-1])
    lanes = correct_all(curve, xs, rows, levels, before)
    assert found[0].which.tolist() == list(range(9))
    nothing = found[0]._replace(which=np.zeros(0, int))
    monkeypatch.setattr(NewtonKernel, "__call__", lambda *arguments: nothing)
    steps = correct_all(curve, xs, rows, levels, before)
    for one, other, row, level in zip(lanes, steps, rows, levels, strict=True):
        assert one.x == pytest.approx(other.x, rel=1e-13)
        assert one.tangent == pytest.approx(other.tangent, rel=1e-7)
        assert one.branch_test == pytest.approx(other.branch_test, rel=1e-7)
        assert row @ one.x == pytest.approx(level, rel=1e-14)
    assert [point.value for point in lanes[1::2]] == levels[1::2].tolist()
    here, there = lanes[0].evaluation, steps[0].evaluation
    assert np.abs(here.residual).max() < 1e-13
    assert here.jacobian == pytest.approx(there.jacobian, rel=1e-6, abs=1e-7)
    for some, others in zip(here.trajectories[0], there.trajectories[0], strict=True):
        assert some.times[-1] == pytest.approx(others.times[-1], rel=1e-13)
        assert some(0.5 * some.times[-1])[:4] == pytest.approx(others(0.5 * some.times[-1])[:4], abs=1e-12)
    monkeypatch.setattr(NewtonKernel, "__call__", lambda *arguments: found.append(solve(*arguments)) or found[-1])
    xs[3, 2] = -1.0
    with pytest.raises(FlowError, match="cannot start"):
        correct_all(curve, xs, rows, levels, before)
    assert 3 not in found[1].which
