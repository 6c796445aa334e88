"""Optimal control: closed forms, energy, the same machine simulated open loop, and how failures are named."""

from dataclasses import replace

import casadi as ca
import mpmath as mp
import numpy as np
import pytest
from conftest import slow_after
from scipy.integrate import solve_ivp, trapezoid
from scipy.linalg import expm

from orbits import InputError, NoOrbit, find, simulate, steer
from orbits.control import Guess, Input, Stage
from orbits.model import Phase
from orbits.simulation.impacts import Impacts
from problems import Actuated, Chain, Hopper, Juggler, steering

CART = Phase("cart", ("x", "v"), lambda x, p, q: [x[1], p["f"]])
EFFORT = {"running": lambda x, p, q: p["f"] ** 2}
AT_REST = {"start": lambda x, before, p: x, "end": lambda x, p: [x[0] - 1, x[1]]}
STRAIGHT = [Guess(1.0, lambda t: [t, 1.0])]


def cart(intervals=4, duration=(1.0, 1.0), degree=1, low=-np.inf, high=np.inf, **stage) -> Stage:
    return Stage(CART, intervals, duration, {"f": Input(low, high, degree)}, **{**AT_REST, **EFFORT, **stage})


def test_least_effort_from_rest_to_rest():
    found = steer([cart()], guess=STRAIGHT)
    assert found.cost == pytest.approx(12, abs=1e-10)
    t = np.linspace(0, 1, 50)
    assert found.legs[0].inputs(t)[:, 0] == pytest.approx(6 - 12 * t, abs=1e-9)
    assert found.legs[0].path(t)[:, 0] == pytest.approx(t**2 * (3 - 2 * t), abs=1e-11)


@pytest.mark.parametrize("intervals", [2, 5, 16])
def test_constant_inputs_cost_their_closed_form(intervals):
    """The middles of N intervals have the variance (1 - 1/N^2)/12."""
    found = steer([cart(intervals, degree=0)], guess=STRAIGHT)
    assert found.cost == pytest.approx(12 / (1 - intervals**-2), abs=1e-9)


def test_brachistochrone():
    """The heading turns evenly on a cycloid: one interval would be enough."""
    slide = Phase(
        "slide", ("x", "y", "v"), lambda x, p, q: [x[2] * ca.sin(p["a"]), x[2] * ca.cos(p["a"]), ca.cos(p["a"])]
    )
    goal = 2 - np.sin(2), 1 - np.cos(2)
    stage = Stage(
        slide, 10, (0.1, 20.0), {"a": Input(degree=1)},
        lambda x, before, p: x, lambda x, p: [x[0] - goal[0], x[1] - goal[1]], running=lambda x, p, q: 1.0,
    )  # fmt: skip
    found = steer([stage], guess=[Guess(3.0, lambda t: [t / 3, t / 2, t / 2], {"a": 0.7})])
    assert found.cost == pytest.approx(2, abs=1e-10)
    t = np.linspace(0, 2, 40)
    assert found.legs[0].path(t)[:, :2] == pytest.approx(np.column_stack([t - np.sin(t), 1 - np.cos(t)]), abs=1e-8)


def bounce(height: float, restitution: float) -> Stage:
    ball = Phase("ball", ("y", "v"), lambda x, p, q: [x[1], p["f"] - 1])
    thrust = {"inputs": {"f": Input(degree=1)}, **EFFORT}
    blow = lambda x, before, p: [x[0], x[1] + p["e"] * before[1]]  # noqa: E731
    up = Stage(ball, 3, (0.1, 9.0), start=blow, end=lambda x, p: [x[0] - height, x[1]], **thrust)
    on = lambda x, before, p: [a - b for a, b in zip(x, before, strict=True)]  # noqa: E731
    down = Stage(ball, 3, (0.1, 9.0), start=on, end=lambda x, p: [x[0]], **thrust)
    guess = [Guess(1.5, lambda t: [t, 1.0 - t]), Guess(1.5, lambda t: [1 - t, -t])]
    return steer([up, down], {"e": restitution}, guess=guess)


def test_a_bouncing_ball_is_kept_at_height():
    """Against the least effort between two states, in closed form, at the best durations and landing speed."""
    height, e = mp.mpf("1.3"), mp.mpf("0.6")

    def effort(rise, gain, time):
        return 4 * (3 * rise**2 - 3 * rise * gain * time + (gain * time) ** 2) / time**3

    def cost(first, second, speed):
        up = effort(height + first**2 / 2 - e * speed * first, first - e * speed, first)
        return up + effort(second**2 / 2 - height, second - speed, second)

    found = bounce(float(height), float(e))
    slope = lambda *u: [mp.diff(cost, u, order) for order in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]  # noqa: E731
    best = mp.findroot(slope, (*found.durations.tolist(), 1.6))
    assert found.cost == pytest.approx(float(cost(*best)), abs=1e-9)
    assert found.durations == pytest.approx([float(best[0]), float(best[1])], abs=1e-8)
    assert found.legs[1].path(found.durations[1])[1] == pytest.approx(-float(best[2]), abs=1e-8)


def test_what_stays_positive_does_so_between_intervals():
    """Bryson and Denham: with x <= 1/9 the least integral of f^2 is 8/(9 * 1/9), reached along the bound."""
    turn = {"start": lambda x, before, p: [x[0], x[1] - 1], "end": lambda x, p: [x[0], x[1] + 1]}
    room = {"room": lambda x, p, q: 1 / 9 - x[0]}
    guess = [Guess(1.0, lambda t: [0.0, 1 - 2 * t])]
    found = steer([cart(9, path=room, **turn)], guess=guess)
    assert found.cost == pytest.approx(8, abs=1e-8)
    assert found.violation <= 1e-9
    coarse = steer([cart(4, path=room, **turn)], guess=guess)  # the touch is inside an interval
    assert coarse.rounds > 1
    assert coarse.violation <= 1e-9
    t = np.linspace(0, 1, 2001)
    assert coarse.legs[0].path(t)[:, 0].max() <= 1 / 9 + 1e-9


def test_intervals_are_halved_until_the_cost_stays():
    """Constant inputs cost 12/(1 - 1/N^2)."""
    found = steer([cart(2, degree=0)], guess=STRAIGHT, refine=1e-4)
    n = len(found.legs[0].inputs.steps)
    assert found.cost == pytest.approx(12 / (1 - n**-2), abs=1e-8)
    assert found.coarseness == pytest.approx((1 - n**-2) / (1 - 4 * n**-2) - 1, rel=1e-4)
    assert found.coarseness <= 1e-4 < 4 * found.coarseness
    assert np.isnan(steer([cart(2, degree=0)], guess=STRAIGHT).coarseness)
    with pytest.raises(InputError, match="no input 'zzz'"):
        found.schedule("zzz")


@pytest.mark.parametrize("scale", [1e-14, 1e-7, 1e6])
def test_a_cost_is_least_in_any_unit(scale):
    """Not only where it is of order one: the input of the closed form comes out of each."""
    found = steer([cart(running=lambda x, p, q: scale * p["f"] ** 2)], guess=STRAIGHT)
    assert found.cost == pytest.approx(12 * scale, rel=1e-10)
    assert found.legs[0].inputs(0.2)[0] == pytest.approx(6 - 12 * 0.2, abs=1e-7)


@pytest.mark.slow
def test_steps_are_halved_until_they_agree():
    pendulum = Phase("pendulum", ("a", "v"), lambda x, p, q: [x[1], p["f"] - 9 * ca.sin(x[0])])
    swing = {"inputs": {"f": Input(degree=2)}, "start": lambda x, before, p: x, **EFFORT}
    stage = Stage(pendulum, 4, (6.0, 6.0), end=lambda x, p: [x[0] - np.pi, x[1]], **swing)
    guess = [Guess(6.0, lambda t: [0.3 * t * np.sin(3 * t), np.cos(3 * t)])]
    found = steer([stage], guess=guess)
    assert found.rounds > 1
    assert found.error <= 1e-9
    assert found.violation <= 1e-9
    finer = steer([stage], guess=guess, tolerance=1e-12)
    assert finer.cost == pytest.approx(found.cost, rel=1e-9)


def test_a_law_without_a_series():
    moving = {"start": lambda x, before, p: [x[0], x[1] - 0.2], "end": lambda x, p: [x[0] - 1, x[1] - 0.2]}
    drag = Phase("drag", ("x", "v"), lambda x, p, q: [x[1], p["f"] - ca.fabs(x[1]) * x[1]])
    stage = Stage(drag, 10, (2.0, 2.0), {"f": Input(degree=1)}, **moving, **EFFORT)
    found = steer([stage], guess=[Guess(2.0, lambda t: [t / 2, 0.5])])
    smooth = Phase("drag", ("x", "v"), lambda x, p, q: [x[1], p["f"] - x[1] ** 2])
    other = steer([Stage(smooth, 10, (2.0, 2.0), {"f": Input(degree=1)}, **moving, **EFFORT)], guess=found)
    assert found.cost == pytest.approx(other.cost, rel=1e-9)


def test_a_cost_at_the_end():
    """Far and gently: f = 1 - t, for a cost of -1/6."""
    far = {"end": lambda x, p: [], "final": lambda x, p: -x[0], "running": lambda x, p, q: p["f"] ** 2 / 2}
    found = steer([cart(**far)], guess=STRAIGHT)
    assert found.cost == pytest.approx(-1 / 6, abs=1e-10)
    assert found.legs[0].inputs(0.3)[0] == pytest.approx(0.7, abs=1e-8)


def test_free_parameters_and_final_costs():
    """Least largest force: full ahead and full back, 4 = largest force times time squared."""
    stage = cart(
        8, degree=0, running=lambda x, p, q: 0.0, final=lambda x, p: p["most"],
    )  # fmt: skip
    bounded = Stage(
        CART, 8, (1.0, 1.0), {"f": Input(lambda p: -p["most"], lambda p: p["most"])}, stage.start, stage.end,
        final=stage.final,
    )  # fmt: skip
    found = steer([bounded], guess=STRAIGHT, free={"most": (0.0, np.inf)})
    assert found.parameters["most"] == pytest.approx(4, abs=1e-8)


@pytest.mark.parametrize(
    ("stage", "words"),
    [
        (lambda: cart(duration=(0.0, 1.0)), "is above 0"),
        (lambda: cart(duration=(2.0, 1.0)), "bounds conflict"),
        (lambda: cart(low=1.0, high=-1.0), "input 'f' lies between 1 and -1: bounds conflict"),
        (lambda: cart(intervals=0), "from 1"),
        (lambda: cart(degree=-1), "from 0"),
        (lambda: cart(running=lambda x, p, q: p["price"]), "asks for 'price'"),
        (lambda: cart(intervals="a"), "intervals = 'a'"),
        (
            lambda: Stage(Phase("cart", ("x", "time"), lambda x, p, q: [x[1], 1]), 4, (1.0, 1.0)),
            "'time' is a column of the motion's table already; rename",
        ),
        (lambda: replace(cart(), inputs={"running cost": Input()}), "'running cost' is a column"),
        (lambda: cart(intervals=np.inf), "intervals = inf"),
        (lambda: cart(duration=2.0), "a lowest and a highest number, not 2.0"),
        (
            lambda: Stage(Phase("cart", ("x", "v"), lambda x, p, q: [x[1]]), 4, (1.0, 1.0)),
            "the field of the cart gives 1 rates for 2 states",
        ),
    ],
)
def test_what_cannot_be_meant(stage, words):
    with pytest.raises(InputError, match=words):
        steer([stage()], guess=STRAIGHT)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"parameters": {"f": 1.0}}, "both an input and a parameter"),
        ({"parameters": {"k": 1.0}, "free": {"k": (0, 1)}}, "has a value and is left free"),
        ({"free": {"k": (1, 0)}}, "parameter 'k' lies between 1 and 0"),
        ({"parameters": {"k": np.nan}}, "not a finite number"),
        ({"parameters": {"k": None}}, "parameter 'k' = None"),
        ({"free": {"k": 1}}, "parameter 'k': bounds are a lowest and a highest number, not 1"),
        ({"tolerance": 1e-16}, "tolerance = 1e-16; rounding allows for 1e-13"),
        ({"tolerance": 0}, "tolerance = 0"),
        ({"refine": 1e-10}, "above the tolerance"),
        ({"guess": None}, "guess = None; it is a Guess for each stage"),
        ({"guess": [Guess(1.0, lambda t: [t, 1.0], {"g": 1.0})]}, "of an input 'g': it has none such"),
        ({"guess": []}, "the guess has 0 stages"),
        ({"guess": [Guess(1.0, lambda t: [t])]}, "the guess of the cart is not 2 numbers, x, v"),
    ],
)
def test_what_cannot_be_asked(arguments, words):
    with pytest.raises(InputError, match=words):
        steer([cart()], **{"guess": STRAIGHT, **arguments})


@pytest.mark.parametrize(
    ("stage", "words"),
    [
        (lambda: cart(low=-1.0, high=1.0), "no motion meets the conditions.*input 'f' of stage 1 is at its bounds"),
        (lambda: cart(duration=(0.1, 9.0), running=lambda x, p, q: 1.0), r"stage 1 \(cart\) collapses"),
        (lambda: cart(end=lambda x, p: [x[0] - 1, x[0] - 2]), "the condition at the end of stage 1"),
        (lambda: cart(end=lambda x, p: [], running=lambda x, p, q: -x[0]), "no lower bound"),
        (lambda: cart(duration=(0.1, np.inf), running=lambda x, p, q: -1.0), "no lower bound"),
        (lambda: cart(duration=(1.0, np.inf)), r"stage 1 \(cart\) runs away"),
        (lambda: cart(running=lambda x, p, q: ca.sqrt(x[0] - 3)), "stop being numbers"),
        (lambda: cart(degree=0, running=lambda x, p, q: ca.fabs(p["f"])), "no convergence.*the conditions hold"),
        (lambda: cart(1, degree=0), "more conditions than inputs can meet"),
        (lambda: cart(path={"half": lambda x, p, q: 0.5 - x[0]}), "'half'|the condition at the end"),
    ],
)
def test_what_has_no_answer(stage, words):
    with pytest.raises(NoOrbit, match=words):
        steer([stage()], guess=STRAIGHT)


@pytest.fixture(scope="module")
def kept():
    """The damped hopper, kept hopping."""
    return steering.keep_hopping(Hopper(damping=0.01))


def test_a_damped_hopper_is_kept_hopping(kept):
    machine = Hopper(damping=0.01)
    assert kept.violation <= 1e-8
    assert kept.error <= 1e-8
    assert steering.missed(machine, kept) <= 1e-8
    done, positive = steering.work(machine, kept)
    t = np.linspace(0, kept.legs[0].duration, 20001)
    stretching = kept.legs[0].path(t) @ [0, 1, 0, -1, 0, *[0] * (len(kept.legs[0].path.names) - 5)]
    s = np.linspace(0, kept.legs[1].duration, 20001)
    lost = trapezoid(stretching**2, t) + trapezoid(kept.legs[1].path(s)[:, 1] ** 2, s)
    assert done == pytest.approx(0.01 * lost, rel=1e-6)  # work in, dissipation out
    assert positive >= done


def test_the_law_of_small_damping():
    """Its coefficient is a least-norm problem: the flow of a linear spring by matrix exponentials, linearised at the
    lossless hop in the start, the durations, the 40 rates and the damping."""
    orbit = find(Hopper())
    counts = (25, 15)  # shares of 40 intervals by duration
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

    times = orbit.flight_time, orbit.contact_time
    at = np.array([orbit.alpha, 0.0, *times, 0.0, *[0.0] * 40])
    assert np.abs(misses(at)).max() < 1e-12
    slopes = np.array([misses(at + 1e-30j * row).imag * 1e30 for row in np.eye(45)]).T
    directions, sizes, _ = np.linalg.svd(slopes[:, :4])
    others = directions[:, np.append(sizes, [0, 0]) < 1e-9].T  # what neither start nor durations can mend
    lengths = np.repeat(np.divide(times, counts), counts)
    least = np.linalg.lstsq(others @ slopes[:, 5:] / np.sqrt(lengths), others @ slopes[:, 4], rcond=None)[0]
    tiny = steering.keep_hopping(Hopper(damping=1e-5), orbit=orbit)
    assert tiny.cost == pytest.approx(float(least @ least) * 1e-10, rel=1e-7)


def test_the_juggler_costs_what_the_hopper_does(kept):
    """They are one system under constant gravity (section 7)."""
    assert steering.keep_hopping(Juggler(damping=0.01)).cost == pytest.approx(kept.cost, rel=1e-9)


def test_the_spring_s_end_starts_from_zero(kept):
    """Moved together with the motion it would cost the same, and the masses would seem as far apart as one likes."""
    long = steering.keep_hopping(Hopper(damping=0.01, rest_length=8.0))
    assert long.cost == pytest.approx(kept.cost, rel=1e-9)
    for control in (kept, long):
        moved = [leg.path.row("u") for leg in control.legs]
        assert control.legs[0].path(0.0)[4] == pytest.approx(0, abs=1e-12)
        assert max(np.abs(row[:, 0]).max() for row in moved) < 0.1
    run, orbit = steering.rerun(Hopper(damping=0.01, rest_length=8.0), long), find(Hopper(rest_length=8.0))
    assert run.smallest_separation == pytest.approx(orbit.certificate.smallest_separation, abs=0.1)
    with pytest.raises(NoOrbit, match=r"no motion|no convergence|collapses"):
        steering.keep_hopping(Hopper(damping=0.01, rest_length=3.0))  # on the lossless orbit the masses meet


def test_another_machine_starts_from_an_answer(kept):
    orbit = find(Hopper())
    near = steering.keep_hopping(Hopper(damping=0.0102), orbit=orbit, guess=kept)
    cold = steering.keep_hopping(Hopper(damping=0.0102), orbit=orbit)
    assert near.cost == pytest.approx(cold.cost, rel=1e-9)
    assert near.iterations < cold.iterations


@pytest.mark.slow
def test_a_plastic_landing_costs_less_and_each_cost_is_least_in_its_own(kept):
    machine = Hopper(damping=0.01)
    plastic = steering.keep_hopping(machine, lossless=False)
    assert plastic.cost < kept.cost
    assert plastic.legs[0].path(plastic.legs[0].duration)[3] < -1e-3
    run = steering.rerun(machine, plastic)
    assert [event.kind for event in run.events][:1] == ["landing"]
    assert run.events[0].loss > 0
    assert steering.missed(machine, plastic) <= 1e-8
    peak = steering.keep_hopping(machine, cost="peak")
    rates = [max(np.abs(leg.inputs.row("w")).max() for leg in found.legs) for found in (kept, peak)]
    assert rates[1] == pytest.approx(peak.parameters["peak"], rel=1e-6)
    assert rates[1] < 0.999 * rates[0]
    assert peak.cost == peak.parameters["peak"]
    least = steering.keep_hopping(machine, cost="work", rate=0.1)
    assert least.cost == steering.work(machine, least)[1] < steering.work(machine, kept)[1]
    assert steering.keep_hopping(machine, cost="work", rate=0.1, lossless=False).cost < least.cost


def test_little_damping_costs_its_square_whatever_the_landing():
    """Cost over c^2 is analytic in c: what it tends to, from moderate c, is what tiny c cost."""
    orbit = find(Hopper())
    cost = lambda c: steering.keep_hopping(Hopper(damping=c), lossless=False, orbit=orbit).cost / c**2  # noqa: E731
    limit = 2 * cost(1e-3) - cost(2e-3)
    assert [cost(1e-6), cost(1e-7)] == pytest.approx([limit, limit], rel=1e-5)
    assert cost(1e-8) == pytest.approx(limit, rel=1e-3)
    free = steering.keep_hopping(Hopper(), lossless=False, orbit=orbit)
    assert free.cost < 1e-20
    assert free.durations == pytest.approx([float(orbit.flight_time), float(orbit.contact_time)], abs=1e-9)


@pytest.mark.parametrize("lossless", [True, False])
def test_an_answer_is_the_motion_of_the_machine_written_out(kept, lossless):
    """By another integrator, from the equations of motion with the damper and the moved end."""
    c = 0.01
    found = kept if lossless else steering.keep_hopping(Hopper(damping=c), lossless=False)
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


def test_a_varying_gravity_and_a_hard_spring():
    machine = Hopper("cubic", "1/(1+z/R)**2", rest_length=20, damping=0.01, parameters={"beta": 0.05, "R": 150.0})
    found = steering.keep_hopping(machine)
    assert found.violation <= 1e-8
    assert steering.missed(machine, found) <= 1e-8


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
    [
        (lambda: steering.keep_hopping(Hopper(damping=0.05), stroke=0.05), "'room to pull' of stage 1"),
        (lambda: steering.start_up(Hopper(), 1, stroke=0.5), "'room to push' of stage 1"),
        (lambda: steering.keep_hopping(Hopper(damping=0.01), intervals=2), "more conditions than inputs can meet"),
        (lambda: steering.keep_hopping(Hopper(damping=0.01), intervals=3), "no convergence|no motion"),
    ],
)
def test_what_an_actuator_cannot_do(question, words):
    with pytest.raises(NoOrbit, match=words):
        question()


@pytest.mark.parametrize("short", slow_after(2, [-0.3, 0.01, -0.1, -0.01, 0.3]))
def test_landing_as_it_likes_costs_no_more(short):
    """A lossless landing is one of those; and from the answer for another launch nothing cheaper is found."""
    orbit, machine = find(Hopper()), Hopper()
    bound, free = (steering.recover(machine, short, lossless=one, orbit=orbit) for one in (True, False))
    assert free.cost <= bound.cost * (1 + 1e-9)
    assert free.legs[0].path(free.legs[0].duration)[3] <= 0
    near = steering.recover(machine, short * 1.1, lossless=False, orbit=orbit)
    again = steering.recover(machine, short, lossless=False, orbit=orbit, guess=near)
    assert free.cost == pytest.approx(again.cost, rel=1e-6)
    assert steering.missed(machine, free) <= 1e-8


@pytest.mark.parametrize("lossless", [True, False])
def test_a_short_launch_is_brought_back(lossless):
    machine, short = Hopper(), 0.1
    found = steering.recover(machine, short, lossless=lossless)
    run = steering.rerun(machine, found, hops=1)
    alpha = find(machine).alpha
    assert found.violation <= 1e-8
    assert run.launches == pytest.approx(alpha, abs=1e-8)
    assert simulate(machine, alpha - short, hops=1).launches[-1] < alpha - 2 * short  # by itself it falls away


def test_driven_energy_and_schedules():
    """Energy changes by the actuator's work, whatever the schedule; a schedule is what it is checked to be."""
    machine = Actuated(Hopper())
    times, rates = np.linspace(0, 6, 13), np.random.default_rng(3).uniform(-0.2, 0.2, 12)
    run = simulate(machine, 5.0, time=6.0, schedule=(times, {"w": rates}))
    done = 0.0
    for i, rate in enumerate(rates):
        t = np.linspace(times[i], times[i + 1], 4001)
        states = run(t)
        done -= rate * trapezoid(states[:, 0] - states[:, 2] - states[:, 4], t)
    impacts = Impacts(machine)
    assert impacts.energy(run(6.0)) - impacts.energy(run(0.0)) == pytest.approx(done, abs=1e-6)
    for schedule, words in (
        ((times, {"v": rates}), "no parameter 'v'"),
        ((times[::-1], {"w": rates}), "finite and rise"),
        ((times, {"w": rates[1:]}), "11 values between 13 times"),
    ):
        with pytest.raises(InputError, match=words):
            simulate(machine, 5.0, time=6.0, schedule=schedule)


@pytest.mark.parametrize(
    ("question", "words"),
    [
        (lambda: steering.keep_hopping(Hopper(), cost="money"), "'effort', 'work' or 'peak'"),
        (lambda: steering.keep_hopping(Hopper(), cost="work"), "largest rate"),
        (lambda: steering.keep_hopping(Hopper(), rate=-1.0), "bound is above 0"),
        (lambda: steering.keep_hopping(Hopper(), intervals=1), "from 2"),
        (lambda: steering.keep_hopping(Hopper(restitution=0.5), lossless=False), "bounces"),
        (lambda: steering.start_up(Hopper(), 0), "from 1"),
        (lambda: steering.start_up(Hopper(), np.nan), "pumps = nan"),
        (lambda: steering.keep_hopping(Hopper(), intervals=np.inf), "intervals = inf"),
        (lambda: steering.keep_hopping(Hopper(), rate="a"), "rate = 'a'"),
        (lambda: steering.keep_hopping(Chain()), "a Chain is no machine whose spring can be moved"),
        (lambda: steering.recover(Hopper(), None), "short = None"),
        (lambda: steering.recover(Hopper(), 5.0), "some of it is to be left"),
        (lambda: Actuated(Hopper("bilinear")), "piecewise"),
        (lambda: Actuated(3), "whose spring can be moved"),
        (lambda: Actuated(Hopper("r + u*r**3", parameters={"u": 1.0})), "actuator's own name"),
    ],
)
def test_what_no_actuator_does(question, words):
    with pytest.raises(InputError, match=words):
        question()
