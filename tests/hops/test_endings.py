"""How hops end, in the map and in simulations alike, against an independent integration (DOP853) and closed forms."""

import numpy as np
import pytest
from conftest import slow_after
from scipy.integrate import solve_ivp

from orbits import InputError, NoOrbit, ReturnMap, multiplier, simulate
from orbits.flow.vector_field import FlowControl
from orbits.hops import STATUSES, Impacts
from problems import Hopper, Juggler
from problems.laws.springs import table

TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "dense_output": True}


def integrated(machine, alpha: float) -> tuple[str, np.ndarray]:
    """The first hop of a plastic machine with M = 1 under constant gravity, by another integrator: how its contact
    ends, and the contact state there."""
    force, c, d = (lambda r: float(machine.spring(r))), machine.damping, machine.drag
    if machine.kind == "hopper":
        load, excess = 1.0, c
        rho = machine.model.release(np.array([alpha]), machine.values)[0]
        start, gap = [rho, alpha, 0.0, 0.0], lambda t, x: x[2]

        def flight(t, x):
            tension = force(x[0] - x[2]) + c * (x[1] - x[3])
            return [x[1], -(tension + d * x[1] + 1) / 2, x[3], (tension - 1 - d * x[3]) / 2]

        def contact(t, y):
            return [y[1], -(force(y[0]) + (c + d) * y[1] + 1) / 2]
    else:
        load, excess = 0.0, c
        rho = machine.model.release(np.array([alpha]), machine.values)[0]
        start, gap = [rho, alpha, rho, alpha], lambda t, x: x[0] - x[2]

        def flight(t, x):
            return [x[1], -d * x[1] - 1, x[3], -force(x[2]) - (c + d) * x[3] - 1]

        def contact(t, y):
            return [y[1], -(force(y[0]) + (c + 2 * d) * y[1]) / 2 - 1]

    def pressing(t, y):
        return load - force(y[0]) - excess * y[1]

    def far(t, x):
        return 1e3 - np.abs(x).max()

    gap.terminal = pressing.terminal = far.terminal = True
    gap.direction = pressing.direction = far.direction = -1
    x = solve_ivp(flight, (0, 0.05), start, **TIGHT).y[:, -1]  # off the ground, where the gap starts as a zero itself
    while True:
        run = solve_ivp(flight, (0.0, 200.0), x, events=[gap, far], **TIGHT)
        x = run.y[:, -1]
        if len(run.t_events[1]):
            return "collapses", x[[0, 1]]
        if machine.kind == "hopper":
            x[2], x[3] = 0.0, 0.0
        else:
            x[[1, 3]] = x[[1, 3]].mean()
        if pressing(0, x[[0, 1]]) >= 0:
            break
        x = solve_ivp(flight, (0, 1e-3), x, **TIGHT).y[:, -1]
    run = solve_ivp(contact, (0, 100.0), x[[0, 1]], events=[pressing, far], **TIGHT)
    return ("stays" if run.status == 0 else "leaves" if len(run.t_events[0]) else "collapses"), run.y[:, -1]


ELSEWHERE = [
    (Hopper("r - 0.1*r**3 + 0.001*r**5"), 2.358080625394515),
    (Hopper("r - 0.05*r**3"), 2.890671399870905),
    (Juggler("r - 0.05*r**3", damping=0.3, drag=0.1), 1.8735558987050396),
]


@pytest.mark.parametrize(("machine", "alpha"), ELSEWHERE)
def test_a_contact_may_end_where_no_launch_does(machine, alpha):
    """Springs whose force does not rise all the way let go elsewhere: the simulation flies on from the very state."""
    how, end = integrated(machine, alpha)
    assert how == "leaves"
    hops, run = ReturnMap(machine)(alpha), simulate(machine, alpha, hops=1)
    assert hops.status == "leaves_elsewhere"
    assert np.isnan(hops.next)
    assert run.status == "done"
    assert np.isnan(run.launches[-1])
    event = run.events[-1]
    assert event.after[[0, 1]] == pytest.approx(end, rel=1e-7)
    np.testing.assert_array_equal(event.before, event.after)
    assert event.loss == 0
    on = simulate(machine, alpha, time=run.end + 1.0)
    assert on.status == "done"
    if not machine.damped:
        energies = [Impacts(machine).energy(x) for x in on(np.linspace(event.time, on.events[-1].time, 20))]
        assert np.ptp(energies[:2]) < 1e-12 * abs(energies[0])


@pytest.mark.parametrize(
    "machine",
    slow_after(3, [
        Hopper("r - 0.1*r**3 + 0.001*r**5"), Hopper("r - 0.05*r**3"), Juggler("r - 0.05*r**3", damping=0.3, drag=0.1),
        Juggler("r - 0.02*r**3"), Hopper("r + 0.1*r**3", damping=0.2), Hopper("sinh(0.3*r)/0.3", drag=0.05),
    ]),
)  # fmt: skip
def test_contacts_end_as_integrated_independently(machine):
    for alpha in np.random.default_rng(5).uniform(1.0, 4.0, 3):
        hops = ReturnMap(machine)(alpha)
        if hops.status == "no_launch":
            continue
        how, end = integrated(machine, alpha)
        assert hops.status in {"leaves": ["lifts_off", "leaves_elsewhere"], "stays": ["rests"]}.get(how, [how])
        if hops.status == "lifts_off":
            assert float(hops.next) == pytest.approx(end[1], rel=1e-8)
        run = simulate(machine, alpha, hops=1)
        assert run.status == ("done" if how == "leaves" else hops.status)
        if how == "leaves":
            assert run.events[-1].before[[0, 1]] == pytest.approx(end, rel=1e-7, abs=1e-9)


class TestLaunches:
    def test_a_strong_damper_takes_a_slow_launch_back(self):
        """The jerk of the foot is (alpha + c y1'')/2 with y1'' = -1: below alpha = c it does not leave the ground."""
        machine = Hopper(damping=1.0)
        hops = ReturnMap(machine)([0.2, 0.999, 1.001, 3.0])
        assert hops.status.tolist() == ["no_launch", "no_launch", "rests", "rests"]
        assert hops.impacts.tolist() == [0, 0, 1, 1]
        for call in (lambda: simulate(machine, 0.5, hops=1), lambda: simulate(machine, 0.5, time=1.0)):
            with pytest.raises(InputError, match=r"alpha = 0\.5 is not a launch"):
                call()
        with pytest.raises(NoOrbit, match="is not a launch"):
            multiplier(machine, 0.5)

    def test_a_branch_that_ends_takes_no_other_launch_with_it(self):
        """r - r^3/20 falls to -1.72 at its turn, r = -2.58: above alpha = (1 + 1.72)/0.6 = 4.54 nothing balances."""
        machine = Hopper("r - 0.05*r**3", damping=0.6)
        turn = -np.sqrt(20 / 3)
        fastest = (1 - (turn - 0.05 * turn**3)) / 0.6
        hops = ReturnMap(machine)([3.0, fastest - 1e-6, fastest + 1e-6, 8.0])
        assert hops.status.tolist()[2:] == ["no_launch"] * 2
        extension = machine.model.release(np.array([3.0, fastest - 1e-6, fastest + 1e-6]), machine.values)
        assert extension[0] == pytest.approx(min(r.real for r in np.roots([-0.05, 0, 1, 0.8]) if r.real > turn))
        assert extension[1] == pytest.approx(turn, abs=5e-3)
        assert np.isnan(extension[2])

    def test_an_injection_may_take_all_the_speed(self):
        hops, run = ReturnMap(Hopper(), inject=-10)(4.6), simulate(Hopper(), 4.6, hops=1, inject=-10)
        assert hops.status == run.status == "rests"
        assert np.isnan(hops.next)
        assert float(hops.loss) == float(ReturnMap(Hopper())(4.6).loss)


class TestStatuses:
    def table(self, low: float, high: float):
        return table((np.linspace(low, high, 41),) * 2)

    def same(self, machine, alpha: float, **more) -> str:
        """The status of map and simulation, which are the same."""
        hops, run = ReturnMap(machine, **more)(alpha), simulate(machine, alpha, hops=1, **more)
        assert run.status == ("done" if hops.status in ("lifts_off", "leaves_elsewhere") else hops.status)
        assert str(hops.status) in (*STATUSES, "lifts_off")
        return str(hops.status)

    def test_a_table_ends_in_flight_and_in_contact(self):
        assert self.same(Hopper(self.table(-9.0, 3.0)), 4.6) == "out_of_range"  # stretched to 4.7
        run = simulate(Hopper(self.table(-5.5, 9.0)), 5.5, hops=1)  # pressed to -6.5 or so
        assert run.status == ReturnMap(Hopper(self.table(-5.5, 9.0)))(5.5).status == "out_of_range"
        assert "leaves the law's range" in run.reason
        assert run.document()["reason"] == run.reason

    @pytest.mark.slow
    def test_carried_off_and_collapsed(self):
        far = {"rest_length": 5.0, "parameters": {"R": 5.0}}
        assert self.same(Hopper("r", "1/(1 + z/R)**2", **far), 9.0) == "carried_off"
        # compressed it carries no more than M/b = 0.5 of the weight 1 + M of the whole
        assert self.same(Hopper("tanh", mass_ratio=0.1, parameters={"b": 0.2}), 3.0) == "collapses"
        assert self.same(Hopper("r - 0.05*r**3", mass_ratio=0.3), 8.0) == "collapses"

    def test_a_motion_of_too_many_steps_is_lost(self, monkeypatch):
        monkeypatch.setattr("orbits.flow.flow.Flow.control", FlowControl(max_steps=2000))
        run = simulate(Hopper(), 2e3, hops=1)
        assert run.status == "lost"
        assert "too many steps" in run.reason
        assert ReturnMap(Hopper())(2e3).status == "lifts_off"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: simulate(Hopper(), 4.0, hops=1, inject=np.nan), "inject = nan is not a finite number"),
        (lambda: simulate(Hopper(), 4.0, hops=1, inject="x"), "inject = 'x' is not a finite number"),
        (lambda: simulate(Hopper(), "x", hops=1), "x is not a saved orbit"),
        (lambda: simulate(Hopper(), 4.0, hops="x"), "hops = 'x'; it must be a number of lift-offs"),
        (lambda: simulate(Hopper(), 4.0, time="x"), "time = 'x'; it must be a number above 0"),
        (lambda: simulate(Hopper(), 4.0, time=np.nan), "time = nan; it must be a number above 0"),
        (lambda: simulate(Hopper(), 4.0, hops=1, cap="x"), "cap = 'x'; it must be a number of impacts, at least 1"),
        (lambda: simulate(Hopper(), state="x", hops=1), "state = 'x'; it must be 4 numbers"),
        (lambda: ReturnMap(Hopper(), inject="x"), "inject = 'x' is not a finite number"),
        (lambda: ReturnMap(Hopper())("x"), "alpha = 'x'; launch speeds must be numbers"),
        (lambda: multiplier(Hopper(), "x"), "alpha = 'x' is not a finite number"),
        (lambda: multiplier(Hopper(), -1), "alpha = -1; a launch speed must be above 0"),
        (lambda: multiplier(Hopper(), np.nan), "alpha = nan is not a finite number"),
    ],
)
def test_what_cannot_be_meant(call, words):
    with pytest.raises(InputError, match=words):
        call()
