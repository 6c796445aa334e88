"""Arguments of the wrong kind, as an array where a text or a truth value stands, are refused by one sentence."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import orbits
from orbits import InputError, Mechanism, ReturnMap, Sweep, follow, follow_event, prove, simulate, sweep
from orbits.mechanics import Mass, Spring
from orbits.running.arguments import checks_of
from problems import Hopper, inerter_hopper, springs, steering

CUBIC = Hopper("cubic", parameters={"beta": 0.3})
EMPTY, NUMBER, HUGE = np.zeros(0), np.array(np.nan), 10**400


def test_only_the_outermost_call_is_checked():
    def function(machine: Hopper, name: str, other: str | None = None, *, flag: bool = False, progress: object = None):
        return None

    check = checks_of(function)
    check((CUBIC, "x"), {"other": None, "flag": np.bool_(True), "progress": [].append})
    check((CUBIC,), {"name": "x", "progress": None})
    for arguments, options, message in (
        ((3, "x"), {}, "'int' is not a machine such as"),
        ((CUBIC, EMPTY), {}, "name = array.* it must be text"),
        ((CUBIC, "x", np.array("x")), {}, "other = .*; it must be text"),
        ((CUBIC, "x"), {"flag": EMPTY}, "flag = array.* it must be True or False"),
        ((CUBIC, "x"), {"progress": lambda: 0}, "it must be a function of the share that is done"),
    ):
        with pytest.raises(InputError, match=message):
            check(arguments, options)


CALLS = {
    "a truth value": lambda: follow(CUBIC, "beta", 0.4, multipliers=EMPTY),
    "a parameter": lambda: orbits.bifurcations(Hopper(), EMPTY, (0.02, 0.03), (4.3, 5.0)),
    "a machine": lambda: orbits.uncertainty(EMPTY, {"beta": (0.1, 0.2)}),
    "a report": lambda: sweep(CUBIC, {"beta": [0.1]}, progress=lambda: 0),
    "values": lambda: follow(CUBIC, "beta", 0.4, at=NUMBER),
    "prescribed values": lambda: orbits.find(CUBIC, tune="beta", at=EMPTY),
    "stages": lambda: orbits.steer(["r"], guess=[]),
    "parameters of stages": lambda: orbits.steer([], 3, guess=[]),
    "a branch point": lambda: orbits.follow_branch_points(EMPTY, "rest_length", [3.75]),
    "periods": lambda: orbits.bifurcations(Hopper(), "inject", (0.02, 0.03), (4.3, 5.0), periods=NUMBER),
    "a list of values": lambda: orbits.existence(CUBIC, "beta", (0.1, 0.2), "rest_length", NUMBER),
    "numbers of values": lambda: orbits.existence(CUBIC, "beta", (0.1, 0.2), "rest_length", [6.0], samples=EMPTY),
    "workers": lambda: sweep(CUBIC, {"beta": [0.1]}, workers=EMPTY),
    "an executor": lambda: sweep(CUBIC, {"beta": [0.1]}, executor=EMPTY),
    "a client": lambda: sweep(CUBIC, {"beta": [0.1]}, client=EMPTY),
    "a family": lambda: sweep(CUBIC, {"beta": [0.1]}, family=EMPTY),
    "an outcome": lambda: sweep(CUBIC, {"beta": [0.1]}, outcome=EMPTY),
    "a store": lambda: sweep(CUBIC, {"beta": [0.1]}, store=NUMBER),
    "a file": lambda: Sweep.load(NUMBER),
    "objectives": lambda: orbits.pareto(CUBIC, minimise=[[]], over={"beta": (0.1, 0.2)}),
    "a launch": lambda: simulate(CUBIC, {1: 2}, hops=1),
    "a state": lambda: simulate(CUBIC, state=HUGE, hops=1),
    "a time": lambda: simulate(CUBIC, 4.0, time=HUGE),
    "axes": lambda: ReturnMap(Hopper(), 0.03).plot(4.0, 5.0, axes=EMPTY),
    "a figure": lambda: ReturnMap(Hopper(), 0.03).plot(4.0, 5.0, axes=Figure()),
    "marks": lambda: ReturnMap(Hopper(), 0.03).plot(4.0, 5.0, fixed_points=EMPTY, samples=10),
    "a guess": lambda: steering.keep_hopping(Hopper(damping=0.01), guess=EMPTY),
    "positions": lambda: orbits.start_from_rest(inerter_hopper(), [HUGE], 1.0, 4.0),
    "an exact number": lambda: orbits.prove_fixed_point(Hopper(), 4.6, HUGE),
    "units": lambda: springs.fit(([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]), "k*r", in_si=EMPTY),
    "a name that is no name": lambda: springs.fit(([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]), "nan*r"),
    "a gap": lambda: Mechanism(("a", "b"), [Spring("a - b", "r"), Mass("a", 1.0), Mass("b", 1.0)], gap=-np.inf),
    "no gap": lambda: Mechanism(("a", "b"), [Spring("a - b", "r"), Mass("a", 1.0), Mass("b", 1.0)], gap=EMPTY),
}  # fmt: skip


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: follow(CUBIC, 3, 0.4), "along = 3; it must be the name of a parameter"),
        (lambda: orbits.find(CUBIC, method=3), "method = 3; it must be one of closed form"),
        (lambda: orbits.optimize(CUBIC, minimise=[], over={"beta": (0.1, 0.2)}), "it must be a formula"),
        (lambda: orbits.orbit_at(CUBIC, None, "beta"), "a branch must begin at the `point`"),
    ],
)
def test_what_is_no_array_is_refused_in_the_words_of_the_function(call, words):
    with pytest.raises(InputError, match=words):
        call()


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_a_value_of_another_kind_is_refused(call):
    with pytest.raises(InputError):
        call()


def test_results_refuse_arrays(softening_family, driven_hopper, tmp_path):
    family, machine = softening_family, Hopper("cubic", rest_length=30.0)
    for call in (
        lambda: driven_hopper.follow(EMPTY, 0.02),
        lambda: follow_event(family, EMPTY, "mass_ratio", 1.2),
        lambda: follow_event(family, "fold", EMPTY, 1.2),
        lambda: family.save(NUMBER),
        lambda: family.page(tmp_path / "x.html", machine=EMPTY),
        lambda: prove(orbits.orbit_at(machine, family.points[0], "beta"), machine=EMPTY),
    ):
        with pytest.raises(InputError):
            call()
