"""Landings with a speed where the standing foot changes: Housner's block, rimless wheels downhill, and walks."""

import math

import numpy as np
import pytest
from plane import MAPS, linear, rocker, wheel
from scipy.integrate import solve_ivp
from steps import stepping

from orbits import Mechanism, ReturnMap, find, simulate
from orbits.errors import InputError
from orbits.hops import Impacts
from orbits.hops.hand_over import share_left
from orbits.mechanics import Damper, Mass, Spring
from orbits.periodic import hand_over_factors
from problems import springs

MU, KAPPA, A = 1.0, 0.5, 0.3


def downhill(slope: float, share: float = 1.0, spring: str = "phi - theta", damping: float = 0.0) -> Mechanism:
    """The wheel of `plane` on a slope; with the spring on "phi" the inner body swings alone."""
    maps = {"gaps": MAPS["wheel"]["gaps"], "symmetry": MAPS["wheel"]["symmetry"]}
    if spring == "phi":
        maps["symmetry"] = {"theta": "theta - 2*a"}
    hub = Mass("cos(theta - a + slope)", "share/mu", across="sin(theta - a + slope)")
    dampers = [Damper("phi - theta", damping)] if damping else []
    numbers = {"mu": MU, "kappa": KAPPA, "a": A, "share": share, "slope": slope}
    return Mechanism(
        ("phi", "theta"), [Spring(spring), hub, *dampers], inertia={"phi": 1.0, "theta": "(1 - share)/mu"},
        gravity="kappa*mu/share", angles=("phi", "theta"), parameters=numbers, name="wheel", reversor=None, **maps,
    )  # fmt: skip


def block(a: float) -> Mechanism:
    """A solid block of h = 1, b = tan a, with an inner body that swings alone: A = 4/3 M (b^2 + h^2)."""
    b = math.tan(a)
    height, across = "cos(theta) + b*sin(theta)", "sin(theta) - b*cos(theta)"
    return Mechanism(
        ("phi", "theta"), [Spring("phi"), Mass(height, 1.0, across=across)],
        inertia={"phi": 1.0, "theta": "(1 + b**2)/3"}, gravity=1.0, angles=("phi", "theta"), name="block",
        parameters={"b": b}, **MAPS["rocker"],
    )  # fmt: skip


@pytest.mark.parametrize("a", [0.05, 0.3, 0.7])
def test_a_solid_block_loses_what_housner_has(a):
    impacts = Impacts(block(a))
    assert share_left(impacts, np.array([[0.2, 0.1, 0.0, 0.4]])) == pytest.approx(1 - 1.5 * math.sin(a) ** 2, abs=1e-14)


def test_a_block_rocks_with_housners_period_and_decay():
    a, tilt = 1e-3, 0.3e-3  # so slender that the restoring torque is a straight line to 1e-6
    run = simulate(block(a), state=[0.0, 0.0, tilt, 0.0], time=40.0)
    rate = math.sqrt(0.75 / math.hypot(1.0, math.tan(a)))  # sqrt(M g R/A)
    first, *others = [event.time for event in run.events]
    quarter = math.acosh(1 / (1 - tilt / a)) / rate
    assert [first, *np.diff([first, *others])] == pytest.approx([quarter, *[2 * quarter] * len(others)], rel=1e-4)
    a, tilt, left = 0.3, 0.25, 1 - 1.5 * math.sin(0.3) ** 2
    run = simulate(block(a), state=[0.0, 0.0, tilt, 0.0], time=15.0)
    fallen = 2 * (math.cos(tilt - a) - math.cos(a)) / math.cos(a) / (4 / 3 * (1 + math.tan(a) ** 2))
    rates = [abs(event.before[3]) for event in run.events if event.kind == "impact"][:8]
    assert rates == pytest.approx([math.sqrt(fallen) * left**n for n in range(8)], rel=1e-11)


@pytest.mark.parametrize("share", [1.0, 0.8])
def test_a_rimless_wheel_downhill_comes_to_its_closed_form(share):
    slope, left = 0.05, 1 - 2 * share * math.sin(A) ** 2
    run = simulate(downhill(slope, share, "phi"), state=[0.0, 0.0, 1e-3, 0.4], time=200.0)
    gained = 4 * KAPPA * MU * math.sin(A) * math.sin(slope)
    assert run.events[-1].after[3] == pytest.approx(math.sqrt(left**2 * gained / (1 - left**2)), rel=1e-10)
    assert run.legs[-1].stance == run.impacts > 50
    assert abs(run.events[-1].loss) < 1e-10  # gravity adds what the landing loses
    assert run.events[-1].foot == "front foot"
    energies = [event.energy - event.loss for event in run.events]
    assert energies[:-1] == pytest.approx([event.energy for event in run.events[1:]], abs=1e-13)


def test_a_damped_wheel_steps_as_another_integrator_has_it():
    slope, damping, left = 0.1, 0.05, math.cos(2 * A)

    def rates(t, y):
        phi, v, theta, w = y
        torque = phi - theta + damping * (v - w)
        return [v, -torque, w, MU * (KAPPA * math.sin(theta - A + slope) + torque)]

    def front(t, y):
        return 2 * A - y[2]

    def rear(t, y):
        return y[2] + (1.0 if t < 1e-3 else 0.0)

    front.terminal = rear.terminal = True
    front.direction = rear.direction = -1
    y, now, times = np.array([0.05, 0.1, 1e-3, 0.5]), 0.0, []
    start = y.copy()
    for _ in range(6):
        found = solve_ivp(rates, (0, 50), y, "DOP853", events=[front, rear], rtol=1e-13, atol=1e-15)
        y, now = found.y[:, -1].copy(), now + found.t[-1]
        y[3] *= left
        shift = -2 * A if len(found.t_events[0]) else 2 * A if y[3] < 0 else 0.0
        y += [shift, 0.0, shift, 0.0]
        times.append(now)
    run = simulate(downhill(slope, damping=damping), state=start, time=now + 0.01)
    assert [event.time for event in run.events] == pytest.approx(times, abs=1e-10)
    assert run.events[-1].after == pytest.approx(y, abs=1e-10)
    assert run.legs[-1].stance >= 4


def test_hand_overs_lose_by_the_power_law_of_their_series():
    machine = wheel(MU, KAPPA, A)
    orbit, steps = find(machine), ReturnMap(machine)
    late, early = hand_over_factors(math.cos(2 * A))
    c = orbit.certificate.loss_coefficient / late
    assert (late, early) == pytest.approx((1.2134693, 29.0474004), abs=1e-7)
    for side, factor in ((-1, late), (1, early)):
        d = np.array([1e-6, 1e-7])
        ratios = steps(orbit.alpha + side * d).loss / (2 * orbit.alpha * c * d ** (4 / 3))
        shrinks = 10 ** (1 / 3)  # the next term of the law is by the cube root of the distance
        assert (shrinks * ratios[1] - ratios[0]) / (shrinks - 1) == pytest.approx(factor, rel=4e-3)


@pytest.mark.slow
@pytest.mark.parametrize("machine", [wheel(MU, KAPPA, A), rocker(MU, KAPPA, A)], ids=["wheel", "rocker"])
def test_the_map_is_what_simulations_have(machine):
    alpha = find(machine).alpha
    launches = alpha + np.array([-1e-6, 1e-5])
    hops = ReturnMap(machine)(launches)
    for launch, following, impacts, status in zip(launches, hops.next, hops.impacts, hops.status, strict=True):
        run = simulate(machine, launch, hops=1)
        assert run.impacts == impacts
        assert run.status == {"lifts_off": "done"}.get(str(status), status)
        assert run.launches[-1] == pytest.approx(following, abs=1e-9) or status != "lifts_off"


def test_a_step_back_has_no_next_launch():
    machine = wheel(MU, KAPPA, A)
    hop = ReturnMap(machine)(0.05)
    run = simulate(machine, 0.05, hops=1)
    assert (hop.status, run.events[-1].foot) == ("leaves_elsewhere", "front foot")
    assert np.isnan([run.launches[-1], hop.next]).all()
    assert run.legs[-1].stance == sum({"front foot": 1, "rear foot": -1}[event.foot] for event in run.events[:-1])


def test_landings_without_a_law_end_the_motion():
    nearly, unstated = linear("wheel", MU, KAPPA), stepping("wheel", MU, KAPPA, A)
    alpha = find(nearly).alpha
    assert ReturnMap(nearly)([alpha, alpha + 1e-4]).status.tolist() == ["lifts_off", "rattles"]
    run = simulate(unstated, 0.35, hops=1)
    assert run.status == "unstated"
    assert "Mass(across=)" in run.reason
    assert np.isnan(run.events[-1].loss)
    with pytest.raises(InputError, match="a wheel must have the restitution 0"):
        simulate(wheel(MU, KAPPA, A, restitution=0.3), 0.35, hops=1)
    with pytest.raises(InputError, match="to another, but a spring with hysteresis"):
        simulate(wheel(MU, KAPPA, A, law=springs.lossy("r", loss_factor=0.01)), 0.35, hops=1)
    with pytest.raises(InputError, match="to another, but a schedule"):
        simulate(wheel(MU, KAPPA, A), 0.35, hops=1, schedule=([0.0, 1.0], {"kappa": [0.5]}))


@pytest.mark.slow
def test_a_slope_pays_for_the_losses_of_a_walk():
    steps = ReturnMap(downhill(1e-6, 0.8))
    lossless = find(wheel(MU, KAPPA, A, share=0.8)).alpha
    launches = lossless - np.array([7e-6, 1.6e-6, 1e-7])
    assert np.sign(steps(launches).next - launches).tolist() == [-1, 1, -1]  # two fixed points
    run = simulate(steps.machine, launches[1], hops=1)
    gained = 0.5 * (run.launches[1] ** 2 - run.launches[0] ** 2)
    # The extension at lift-off is that of the launch, so that the energies differ by those of the speeds.
    assert -sum(event.loss for event in run.events) == pytest.approx(gained, abs=1e-14)
    # The difference from what gravity adds in one step is lost.
    assert run.legs[-1].stance == 1
    assert 0 < gained < 2 * KAPPA * math.sin(A) * math.sin(1e-6)
