"""Machines whose spring has hysteresis, against SciPy's integrator with events, closed forms and areas of loops."""

from itertools import pairwise, takewhile

import numpy as np
import pytest
from conftest import slow_after
from scipy.integrate import quad, solve_ivp

from orbits import (
    InputError,
    NoOrbit,
    ReturnMap,
    Simulation,
    existence,
    find,
    find_all,
    follow,
    multiplier,
    optimize,
    pareto,
    simulate,
    starts,
    sweep,
    uncertainty,
)
from problems import Chain, Hopper, Juggler, hopper_in_si, springs

TIGHT = {"rtol": 1e-13, "atol": 1e-13, "method": "DOP853"}
CUBIC = {"beta": 0.3}
SPRINGS = {
    "friction": springs.hysteretic("r + 0.05", "r - 0.05"),
    "one side": springs.hysteretic("r + 0.3*r**2/(1 + r**2)", "r"),
    "lossy": springs.lossy("r + beta*r**3", loss_factor=0.02, **CUBIC),
}


def force(law, rate: float, r: float) -> float:
    """The force of the branch for the sign of a rate."""
    return float((law.extending if rate > 0 else law.shortening)(r))


def integrated_hop(law, alpha: float, mass_ratio: float) -> tuple[float, list[float], float]:
    """The next launch speed of a plastic hopper, the extensions at its launch, reversals, landing and lift-off, and the
    speed of its landing, by DOP853 from event to event."""
    M, rho = mass_ratio, find_liftoff(law)
    x, turns, side = np.array([rho, alpha, 0.0, 0.0]), [rho], 1.0

    def flight(t, x):
        f = force(law, side, x[0] - x[2])
        return [x[1], (-M * f - 1) / (1 + M), x[3], (f - 1) / (1 + M)]

    def contact(t, y):
        return [y[1], (-M * force(law, side, y[0]) - 1) / (1 + M)]

    def event(function, direction=0.0):
        function.terminal, function.direction = True, direction
        return function

    # Off the ground, where the gap is zero itself, by less than the integration's error.
    x = solve_ivp(flight, (0, 1e-2), x, **TIGHT).y[:, -1]
    gap, turning = event(lambda t, x: x[2], -1.0), event(lambda t, x: x[1] - x[3])
    while True:
        ended = solve_ivp(flight, (0, 100.0), x, events=[gap, turning], **TIGHT)
        x = ended.y[:, -1]
        turns.append(x[0] - x[2])
        if len(ended.t_events[0]):
            break
        side = -side
        x = solve_ivp(flight, (0, 1e-4), x, **TIGHT).y[:, -1]
    y, landed = x[[0, 1]], x[3]
    side = np.sign(y[1])
    pressing, stopping = event(lambda t, y: 1 - force(law, side, y[0])), event(lambda t, y: y[1])
    while True:
        ended = solve_ivp(contact, (0, 100.0), y, events=[pressing, stopping], **TIGHT)
        y = ended.y[:, -1]
        turns.append(y[0])
        if len(ended.t_events[0]):
            return y[1], turns, landed
        side = -side
        y = solve_ivp(contact, (0, 1e-4), y, **TIGHT).y[:, -1]


def find_liftoff(law) -> float:
    """The extension at which the branch of the growing extension carries the foot."""
    from scipy.optimize import brentq

    return brentq(lambda r: float(law.extending(r)) - 1, 0.0, 3.0, xtol=1e-15)


@pytest.mark.parametrize("name", slow_after(2, SPRINGS))
def test_a_hop_is_that_of_another_integrator_and_loses_the_area_between_the_branches(name):
    law, alpha, M = SPRINGS[name], 4.7, 0.5
    following, turns, landed = integrated_hop(law, alpha, M)
    run = simulate(Hopper(law, mass_ratio=M), alpha, hops=1)
    assert run.launches[-1] == pytest.approx(following, abs=2e-10)
    places = [run(0.0), *(event.before for event in run.events)]
    assert [x[0] - x[2] for x in places] == pytest.approx(turns, abs=2e-9)
    # The forces are those of the branch, and while it presses the ground carries what the spring does not pull.
    t = np.linspace(0.0, run.end, 57)[1:-1]
    x = run(t)
    (pulled,) = run.spring_forces(t).values()
    branch = [force(law, rate, r) for rate, r in zip(x[:, 1] - x[:, 3], x[:, 0] - x[:, 2], strict=True)]
    assert pulled == pytest.approx(branch, abs=1e-12)
    assert run.contact_force(t) == pytest.approx(np.where(run.in_contact(t), 1 - pulled, 0.0), abs=1e-12)
    # The work of the half width between the reversals, by SciPy's quadrature, and what the landing takes.
    areas = [abs(quad(lambda r: float(law.extending(r) - law.shortening(r)) / 2, a, b)[0]) for a, b in pairwise(turns)]
    loss = M * sum(areas) + (1 + M) / 2 * M * landed**2
    assert (1 + M) / 2 * (alpha**2 - following**2) == pytest.approx(loss, abs=1e-8)
    assert ReturnMap(Hopper(law, mass_ratio=M)).upkeep(alpha).energy == pytest.approx(loss, abs=1e-8)


def amplitudes(run) -> list[float]:
    """The extensions at the reversals of the first flight, without their signs."""
    reversals = takewhile(lambda event: event.kind == "reversal", run.events)
    return [abs(event.before[0] - event.before[2]) for event in reversals]


def test_amplitudes_of_free_flight_are_those_of_the_closed_forms():
    share = np.pi / 2 * 0.05
    run = simulate(Hopper(springs.lossy("r", loss_factor=0.05)), 9.0, hops=1)
    extensions = amplitudes(run)
    assert len(extensions) >= 4
    ratios = [b / a for a, b in pairwise(extensions)]
    assert ratios == pytest.approx([np.sqrt((1 - share) / (1 + share))] * len(ratios), abs=1e-12)
    # Dry friction takes twice the half width in each half oscillation.
    run = simulate(Hopper(springs.hysteretic("r + 0.05", "r - 0.05")), 9.0, hops=1)
    extensions = amplitudes(run)
    assert len(extensions) >= 4
    assert -np.diff(extensions) == pytest.approx([0.1] * (len(extensions) - 1), abs=1e-12)


def test_a_spring_that_sticks_falls_as_one_body():
    machine = Hopper(springs.hysteretic("r + 3", "r - 3"), mass_ratio=0.5)  # lifts off at r = -2
    run = simulate(machine, 2.0, hops=1)
    turned, landed = run.events[:2]
    assert (turned.kind, landed.kind, run.status) == ("reversal", "landing", "rests")
    t = np.linspace(turned.time, landed.time, 9)
    assert np.ptp(run(t)[:, 0] - run(t)[:, 2]) < 1e-13
    whole = turned.before[2] + turned.before[3] * (t - t[0]) - (t - t[0]) ** 2 / (2 * 1.5)
    assert np.abs(run(t)[:, 2] - whole).max() < 1e-12
    (pulled,) = run.spring_forces(t[:-1]).values()  # nothing pulls on what falls freely
    assert np.abs(pulled).max() < 1e-12
    # Nothing moves any more, for the whole time.
    still = simulate(machine, 2.0, time=40.0)
    assert (still.status, still.end) == ("done", 40.0)
    assert np.abs(still(39.0) - still(40.0)).max() < 1e-12


def test_a_file_of_a_simulation_has_the_forces_of_the_branches(tmp_path):
    law = springs.lossy("k*r", loss_factor=0.03, k=2000.0)
    of_each = [(SPRINGS["friction"], 4.7), (springs.hysteretic("r + 3", "r - 3"), 2.0)]
    machines = [(Hopper(own, mass_ratio=0.5), speed) for own, speed in of_each]
    for i, (machine, speed) in enumerate([*machines, (hopper_in_si(2.0, 1.0, force=law), 1.2)]):
        run = simulate(machine, speed, hops=1)
        again = Simulation.load(run.save(tmp_path / f"{i}.json"), machine)
        assert [leg.branch for leg in again.legs] == [leg.branch for leg in run.legs]
        t = np.linspace(0, run.end, 40)
        for name, force in run.forces(t).items():
            np.testing.assert_array_equal(again.forces(t)[name], force)


@pytest.mark.parametrize(
    "machine",
    [
        Hopper(SPRINGS["one side"], damping=0.02),
        Hopper(SPRINGS["lossy"], gravity="1/(1 + z/R)**2", rest_length=10.0, parameters={"R": 60.0}),
        Juggler(springs.lossy("r", loss_factor=0.01)),
        Hopper(SPRINGS["friction"], restitution=0.7),  # with the launch beside each, since rounding may decide its end
    ],
)
@pytest.mark.slow
def test_the_map_is_that_of_simulated_hops_and_its_slope_that_of_differences(machine):
    step, speeds = ReturnMap(machine), np.linspace(0.8, 6.0, 7)
    hops = step(speeds)
    assert {"lifts_off", "rests"} <= {*hops.status.tolist()}
    for i, alpha in enumerate(speeds.tolist()):
        run = simulate(machine, alpha, hops=1)
        assert (run.status == "done") == (hops.status[i] == "lifts_off")
        assert run.impacts == hops.impacts[i]
        if run.status == "done":
            assert hops.next[i] == pytest.approx(run.launches[-1], abs=1e-12)
            assert hops.loss[i] == pytest.approx(alpha**2 - run.launches[-1] ** 2, abs=1e-11)
    alpha, h = float(speeds[hops.status == "lifts_off"][0]) + 0.01, 1e-5
    low, high = step(np.array([alpha - h, alpha + h])).next
    assert multiplier(machine, alpha) == pytest.approx((high - low) / (2 * h), rel=1e-6)


@pytest.mark.parametrize("beyond", [0.0, 1e-13])
def test_a_tangential_landing_after_reversals_has_no_multiplier(beyond):
    """A loop of almost no width: the hop lands as the lossless one of its mean law, where slopes have no digits."""
    machine = Hopper(springs.lossy("r", loss_factor=1e-12))
    with pytest.raises(NoOrbit, match="the landing is tangential"):
        multiplier(machine, find(Hopper()).alpha + beyond)


def test_what_is_injected_keeps_the_machine_hopping():
    machine = Hopper(springs.lossy("r", loss_factor=0.005))
    need = ReturnMap(machine).upkeep(4.55)
    (high,) = ReturnMap(machine, inject=need.inject).fixed_points(4.54, 4.56, samples=50)
    assert high.alpha == pytest.approx(4.55, abs=1e-12)
    run = simulate(machine, 4.55, hops=3, inject=need.inject)
    assert run.launches[1] == pytest.approx(4.55, abs=1e-12)
    added = -next(event.loss for event in run.events if event.kind == "lift-off")
    assert added == pytest.approx(need.energy, abs=1e-12)
    with pytest.raises(NoOrbit, match="ends with 'rests': there is no next launch"):
        ReturnMap(machine).upkeep(2.0)


def test_a_machine_of_more_than_one_speed_is_simulated():
    """A chain of two masses is the hopper, in other units of time."""
    law, unit = springs.lossy("r", loss_factor=0.02), np.sqrt(2)
    hop = simulate(Hopper(law), 4.7, hops=1)
    chain = simulate(Chain((1.0, 1.0), law), 4.7 * unit, hops=1)
    assert chain.launches / unit == pytest.approx(hop.launches, abs=1e-12)
    assert chain.end * unit == pytest.approx(hop.end, abs=1e-11)


def test_no_lossless_orbit_of_it_is_looked_for():
    machine = Hopper(SPRINGS["lossy"])
    start = {"liftoff": 0.8, "alpha": 2.9, "duration": 2.9}
    for refused in (
        lambda: find(machine),
        lambda: find(machine, start=start),
        lambda: find_all(machine, [start]),
        lambda: follow(machine, "beta", 0.5),
        lambda: starts(machine.stated(), 3.0, 3.0),
        lambda: find_all(machine),
        lambda: sweep(machine, {"beta": [0.2, 0.3]}),
        lambda: existence(machine, "beta", (0.2, 0.3), "mass_ratio", [1.0], samples=2),
        lambda: uncertainty(machine, {"beta": (0.2, 0.3)}, samples=4),
        lambda: optimize(machine, minimise="alpha", over={"beta": (0.2, 0.3)}),
        lambda: pareto(machine, minimise=("alpha", "flight_time"), over={"beta": (0.2, 0.3)}),
    ):
        with pytest.raises(
            NoOrbit, match=r"a spring with hysteresis loses energy on .*`upkeep` of its return map says .*`\.mean`,"
        ):
            refused()
    assert find(Hopper(SPRINGS["lossy"].mean)).alpha == find(Hopper("cubic")).alpha
    with pytest.raises(InputError, match=r"has 2 springs with hysteresis, but only one can be followed"):
        simulate(Chain(springs=springs.lossy("r", loss_factor=0.1)), {"alpha": 4.0}, hops=1)
    with pytest.raises(InputError, match="its spring has hysteresis, which excludes a schedule"):
        simulate(machine, 4.0, hops=1, schedule=([0.0, 1.0], {"beta": [0.3]}))


def test_branches_that_cross_are_refused_where_the_spring_turns():
    machine = Hopper(springs.hysteretic("r", "r - h", h=0.1)).with_values(h=-0.1)
    with pytest.raises(InputError, match="the branches of the spring with hysteresis cross"):
        simulate(machine, 4.0, hops=1)
