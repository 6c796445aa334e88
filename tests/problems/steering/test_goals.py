"""Goals of an actuated machine: their costs against the limit of small damping, energy, and other integrators."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import slow_after
from scipy.integrate import solve_ivp, trapezoid
from scipy.linalg import expm

from orbits import InputError, NoOrbit, find, find_all, simulate, starts
from orbits.hops import Impacts
from orbits.mechanics import Damper
from problems import Actuated, Actuator, Chain, HeavyHand, Hopper, Juggler, chain_hand, steering


def test_a_damped_hopper_is_kept_hopping(driven_hopper):
    machine = Hopper(damping=0.01)
    assert driven_hopper.violation <= 1e-8
    assert driven_hopper.error <= 1e-8
    assert steering.missed(machine, driven_hopper) <= 1e-8
    done, positive = steering.work(machine, driven_hopper)
    t = np.linspace(0, driven_hopper.legs[0].duration, 20001)
    stretching = driven_hopper.legs[0].path(t) @ [0, 1, 0, -1, 0, *[0] * (len(driven_hopper.legs[0].path.names) - 5)]
    s = np.linspace(0, driven_hopper.legs[1].duration, 20001)
    lost = trapezoid(stretching**2, t) + trapezoid(driven_hopper.legs[1].path(s)[:, 1] ** 2, s)
    assert done == pytest.approx(0.01 * lost, rel=1e-6)  # work in, dissipation out
    assert positive >= done


def hop_slopes(orbit, counts):
    """What the linear hopper misses at its lossless hop, by the flow's matrix exponentials, linearised in the launch
    speed, the displacement of the spring's end there, the two durations, the damping and the 40 rates; (6, 45)."""
    force, speed = np.array([1.0, 0, -1, 0, -1]), np.array([0.0, 1, 0, -1, 0])

    def step(kept, time, c):
        """What an interval does to the kept ones of (y1, y1', y2, y2', u) and to (1, w)."""
        pull = force + c * speed
        a = np.zeros((7, 7), dtype=complex)
        a[0, 1] = a[2, 3] = a[4, 6] = 1
        a[1, :5], a[3, :5], a[[1, 3], 5] = -pull / 2, pull / 2, -0.5
        return expm(a[np.ix_(kept, kept)] * time)

    def misses(q):
        v, u, first, second, c, *rates = q
        x = start = np.array([1 + u - c * v, v, 0, 0, u])
        air = step(np.arange(7), first / counts[0], c)
        for rate in rates[: counts[0]]:
            x = (air @ [*x, 1, rate])[:5]
        landing = [x[2], x[3], force @ x + c * speed @ x - 1]
        y, ground = x[[0, 1, 4]], step(np.array([0, 1, 4, 5, 6]), second / counts[1], c)
        for rate in rates[counts[0] :]:
            y = (ground @ [*y, 1, rate])[:3]
        return np.array([*landing, *(y - start[[0, 1, 4]])])

    at = np.array([orbit.alpha, 0.0, orbit.flight_time, orbit.contact_time, 0.0, *[0.0] * 40])
    assert np.abs(misses(at)).max() < 1e-12
    return np.array([misses(at + 1e-30j * row).imag * 1e30 for row in np.eye(45)]).T


def least_effort(slopes, weights):
    """The least effort over the square of the damping, the effort being rates @ weights @ rates (40, 40)."""
    directions, sizes, _ = np.linalg.svd(slopes[:, :4])
    others = directions[:, np.append(sizes, [0, 0]) < 1e-9].T  # what neither start nor durations can mend
    root = np.linalg.cholesky(weights).T
    least = np.linalg.lstsq(others @ slopes[:, 5:] @ np.linalg.inv(root), others @ slopes[:, 4], rcond=None)[0]
    return float(least @ least)


@pytest.mark.parametrize("kind", ["displacement", "force"])
def test_the_law_of_small_damping(kind):
    """Its coefficient is a least-norm problem: a force beside a spring of stiffness 1 does what its end does, and its
    effort is the integral of the square of a polygon."""
    orbit, counts = find(Hopper()), (25, 15)  # shares of 40 intervals by duration
    lengths = np.repeat(np.divide([orbit.flight_time, orbit.contact_time], counts), counts)
    weights = np.diag(lengths)
    if kind == "force":
        after = np.tril(np.ones((40, 40))) * lengths  # of all rates on the force at the end of each interval
        before = np.vstack([np.zeros((1, 40)), after[:-1]])
        weights = sum(each.T @ np.diag(lengths / 6) @ each for each in (before, after, before + after))
    tiny = steering.keep_hopping(Hopper(damping=1e-5), actuator=Actuator(kind=kind), start=orbit)
    assert tiny.cost == pytest.approx(least_effort(hop_slopes(orbit, counts), weights) * 1e-10, rel=1e-7)


def test_the_juggler_costs_what_the_hopper_does(driven_hopper):
    """They are one system under constant gravity (section 7)."""
    assert steering.keep_hopping(Juggler(damping=0.01)).cost == pytest.approx(driven_hopper.cost, rel=1e-9)


def test_the_spring_s_end_starts_from_zero(driven_hopper):
    """Moved together with the motion it would cost the same, and the masses would seem as far apart as one likes."""
    long = steering.keep_hopping(Hopper(damping=0.01, rest_length=8.0))
    assert long.cost == pytest.approx(driven_hopper.cost, rel=1e-9)
    for control in (driven_hopper, long):
        moved = [leg.path.row("u") for leg in control.legs]
        assert control.legs[0].path(0.0)[4] == pytest.approx(0, abs=1e-12)
        assert max(np.abs(row[:, 0]).max() for row in moved) < 0.1
    run, orbit = steering.rerun(Hopper(damping=0.01, rest_length=8.0), long), find(Hopper(rest_length=8.0))
    assert run.smallest_separation == pytest.approx(orbit.certificate.smallest_separation, abs=0.1)
    with pytest.raises(NoOrbit, match=r"no motion|no convergence|collapses"):
        steering.keep_hopping(Hopper(damping=0.01, rest_length=3.0))  # on the lossless orbit the masses meet


def test_another_machine_starts_from_an_answer(driven_hopper):
    orbit = find(Hopper())
    near = steering.keep_hopping(Hopper(damping=0.0102), start=orbit, guess=driven_hopper)
    cold = steering.keep_hopping(Hopper(damping=0.0102), start=orbit)
    assert near.cost == pytest.approx(cold.cost, rel=1e-9)
    assert near.iterations < cold.iterations


@pytest.mark.slow
def test_a_plastic_landing_costs_less_and_each_cost_is_least_in_its_own(driven_hopper):
    machine = Hopper(damping=0.01)
    plastic = steering.keep_hopping(machine, lossless=False)
    assert plastic.cost < driven_hopper.cost
    assert plastic.legs[0].path(plastic.legs[0].duration)[3] < -1e-3
    run = steering.rerun(machine, plastic)
    assert [event.kind for event in run.events][:1] == ["landing"]
    assert run.events[0].loss > 0
    assert steering.missed(machine, plastic) <= 1e-8
    peak = steering.keep_hopping(machine, cost="peak")
    rates = [max(np.abs(leg.inputs.row("w")).max() for leg in found.legs) for found in (driven_hopper, peak)]
    assert rates[1] == pytest.approx(peak.parameters["peak"], rel=1e-6)
    assert rates[1] < 0.999 * rates[0]
    assert peak.cost == peak.parameters["peak"]
    least = steering.keep_hopping(machine, cost="work", rate=0.1)
    assert least.cost == steering.work(machine, least)[1] < steering.work(machine, driven_hopper)[1]
    assert steering.keep_hopping(machine, cost="work", rate=0.1, lossless=False).cost < least.cost


@pytest.mark.parametrize("lossless", [True, False])
def test_an_answer_is_the_motion_of_the_machine_written_out(driven_hopper, lossless):
    """By another integrator, from the equations of motion with the damper and the moved end."""
    c = 0.01
    found = driven_hopper if lossless else steering.keep_hopping(Hopper(damping=c), lossless=False)
    assert [leg.inputs.coefficients.shape[1:] for leg in found.legs] == [(1, 1)] * 2  # of one input, constant
    times, rates = found.schedule("w")
    aloft = found.durations[0]

    def field(t, x, w, flies):
        pull = (x[0] - x[2] - x[4] + c * (x[1] - x[3])) / 2
        return [x[1], -pull - 0.5, x[3], pull - 0.5, w] if flies else [x[1], -pull - 0.5, 0, 0, w]

    x = start = found.legs[0].path(0.0)[:5]
    for begin, end, w in zip(times[:-1], times[1:], rates["w"], strict=True):
        if begin == pytest.approx(aloft):
            assert x[2] == pytest.approx(0, abs=1e-9)
            assert x[3] <= 1e-9
            x = [x[0], x[1], 0.0, 0.0, x[4]]  # the foot is stopped
        flies = begin < aloft * (1 - 1e-9)
        x = solve_ivp(field, (begin, end), x, "DOP853", args=(w, flies), rtol=1e-12, atol=1e-13).y[:, -1]
    assert x == pytest.approx(start, abs=1e-8)


@pytest.mark.slow
def test_a_start_from_rest():
    """The actuator's work is the energy of the lossless hop, and the machine hops on by itself."""
    machine = Hopper()
    found = steering.start_up(machine, 2, rate=4.0, stroke=3.0)
    impacts, orbit = Impacts(machine), find(machine)
    energies = [impacts.energy(x) for x in (orbit(0.0), [-1.0, 0.0, 0.0, 0.0])]
    assert steering.work(machine, found)[0] == pytest.approx(energies[0] - energies[1], rel=1e-9)
    assert found.violation <= 1e-8
    assert steering.missed(machine, found) <= 1e-8
    run = steering.rerun(machine, found, hops=3)
    assert run.launches == pytest.approx(orbit.alpha, abs=1e-8)
    heights = [leg.path(np.linspace(0, leg.duration, 500))[:, 2] for leg in found.legs]
    assert np.abs(np.concatenate(heights)).max() <= 3 + 1e-8
    with pytest.raises(NoOrbit, match="no motion meets the conditions"):
        steering.start_up(machine, 1, stroke=0.5)


@pytest.mark.parametrize(
    ("question", "words"),
    slow_after(
        3,
        [
            (lambda: steering.keep_hopping(Hopper(damping=0.05), stroke=0.05), "'room to pull' of stage 1"),
            (lambda: steering.start_up(Hopper(), 1, stroke=0.5), "'room to push' of stage 1"),
            (lambda: steering.keep_hopping(Hopper(damping=0.01), intervals=2), "more conditions than inputs can meet"),
            (lambda: steering.keep_hopping(Hopper(damping=0.01), intervals=3), "no convergence|no motion"),
        ],
    ),
)
def test_what_an_actuator_cannot_do(question, words):
    with pytest.raises(NoOrbit, match=words):
        question()


@pytest.mark.slow
@pytest.mark.parametrize("short", slow_after(2, [-0.3, 0.01, 0.3]))
def test_landing_as_it_likes_costs_no_more(short):
    """A lossless landing is one of those; and from the answer for another launch nothing cheaper is found."""
    orbit, machine = find(Hopper()), Hopper()
    bound, free = (steering.recover(machine, short, lossless=one, start=orbit) for one in (True, False))
    assert free.cost <= bound.cost * (1 + 1e-9)
    assert free.legs[0].path(free.legs[0].duration)[3] <= 0
    near = steering.recover(machine, short * 1.1, lossless=False, start=orbit)
    again = steering.recover(machine, short, lossless=False, start=orbit, guess=near)
    assert free.cost == pytest.approx(again.cost, rel=1e-6)
    assert steering.missed(machine, free) <= 1e-8


@pytest.mark.parametrize("lossless", slow_after(1, [True, False]))
def test_a_short_launch_is_brought_back(lossless):
    machine, short = Hopper(), 0.1
    found = steering.recover(machine, short, lossless=lossless)
    run = steering.rerun(machine, found, hops=1)
    alpha = find(machine).alpha
    assert found.violation <= 1e-8
    assert run.launches == pytest.approx(alpha, abs=1e-8)
    assert simulate(machine, alpha - short, hops=1).launches[-1] < alpha - 2 * short  # by itself it falls away


@pytest.mark.parametrize(
    ("question", "words"),
    [
        (lambda: steering.keep_hopping(Hopper(), cost="money"), "'effort', 'work' or 'peak'"),
        (lambda: steering.keep_hopping(Hopper(), cost="work"), "largest rate"),
        (lambda: steering.keep_hopping(Hopper(), rate=-1.0), "a bound of the actuator must be above 0"),
        (lambda: steering.keep_hopping(Hopper(), intervals=1), "from 2"),
        (lambda: steering.keep_hopping(Hopper(restitution=0.5), lossless=False), "a free landing must be plastic"),
        (lambda: steering.start_up(Hopper(), 0), "from 1"),
        (lambda: steering.start_up(Hopper(), np.nan), "pumps = nan"),
        (lambda: steering.keep_hopping(Hopper(), intervals=np.inf), "intervals = inf"),
        (lambda: steering.keep_hopping(Hopper(), rate="a"), "rate = 'a'"),
        (lambda: steering.keep_hopping(Chain()), "has 2 springs: name the extension"),
        (lambda: steering.recover(Hopper(), None), "short = None"),
        (lambda: steering.recover(Hopper(), 5.0), "leaves no launch speed"),
        (lambda: steering.start_up(HeavyHand(), 2), "limit of mechanisms"),
        (lambda: Actuated(3), "whose end can be moved"),
        (lambda: Actuated(Hopper("r + u*r**3", parameters={"u": 1.0})), "actuator's own name"),
    ],
)
def test_what_no_actuator_does(question, words):
    with pytest.raises(InputError, match=words):
        question()


@pytest.mark.slow
@pytest.mark.parametrize("end", ["hand - y3", "y3"])
def test_a_hand_of_two_masses_keeps_throwing(end):
    """The work is what the damper takes away, whichever spring is driven."""
    machine = chain_hand((1.0, 1.0, 1.0))
    damped = replace(
        machine, elements=[*machine.elements, Damper("hand", "c")], parameters={**machine.parameters, "c": 1e-3}
    )
    (orbit,) = find_all(machine, starts(machine, 4, 4))
    kept = steering.keep_hopping(damped, actuator=Actuator(end), start=orbit, intervals=20)
    assert steering.missed(damped, kept) <= 1e-9
    t = np.linspace(0, kept.end, 20001)
    assert kept.work[0] == pytest.approx(1e-3 * trapezoid(kept(t)[:, 3] ** 2, t), rel=1e-3)


@pytest.mark.slow
def test_least_work_is_found_at_the_rates_that_reach_it():
    """Down to the least peak of the rate; below it, the reason says what to widen."""
    machine = Hopper(damping=0.01)
    peak = steering.keep_hopping(machine, cost="peak").cost
    shares, works = [[], []], []
    for rate, own in zip((0.1, 1.1 * peak), shares, strict=True):
        works.append(steering.keep_hopping(machine, cost="work", rate=rate, progress=own.append).cost)
        assert own == sorted(own)
        assert own[-1] == 1.0
    assert works[0] < works[1]
    with pytest.raises(NoOrbit, match="widen a bound"):
        steering.keep_hopping(machine, cost="work", rate=0.9 * peak)
