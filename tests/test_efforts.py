"""What computations take, counted: iterations of kernels, evaluations of balls, programs of Ipopt.

Clocks are too unsteady for that, and a search that still ends where it should may have become much longer.
"""

from collections import Counter

import numpy as np
import pytest
from carts import STRAIGHT, cart
from recorded import known

from orbits import NoOrbit, ReturnMap, find, follow, optimize, prove, simulate, steer, sweep
from orbits.balls import BallProgram
from orbits.symbolic import Kernel, Minimiser
from problems import Chain, Hopper, hopper_in_si

SLACK = 0.05  # rounding may differ, and with it a few of the numbers a little


@pytest.fixture
def counts(monkeypatch) -> Counter:
    """The counts of what is computed in this process."""
    found = Counter()

    def counted(owner, name, what, size):
        function = getattr(owner, name)

        def call(self, *arguments, **options):
            found[what] += size(arguments)
            return function(self, *arguments, **options)

        monkeypatch.setattr(owner, name, call)

    counted(Kernel, "code_for", "iterations of kernels", lambda arguments: int(arguments[0]))
    counted(BallProgram, "__call__", "evaluations of balls", lambda arguments: 1)
    counted(Minimiser, "__call__", "programs of Ipopt", lambda arguments: 1)
    return found


def hopper(spring="r + b*r**3", b=0.3, **more):
    """A hopper with one parameter."""
    return Hopper(spring, parameters={"b": b}, rest_length=more.pop("rest_length", 20.0), **more)


def infeasible(function, *arguments, **options):
    """Call a function that finds nothing."""
    with pytest.raises(NoOrbit):
        function(*arguments, **options)


LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 2e6}, rest_length=0.8)
FORCE = ["largest_contact_force <= 2800"]
ONE, SPEED = {"k": (4e3, 5e3)}, ["alpha >= 3"]
TWO = {"k": (4e3, 2e4), "b": (1e5, 1e7)}
EFFORTS = {
    "find": lambda: find(hopper(), 2),
    "find by integration of all": lambda: find(hopper(gravity="1/(1 + z/150)**2")),
    "find with many bends": lambda: find(hopper("r + b*sin(3*r)", 0.2)),
    "find in pieces": lambda: find(Hopper("bilinear", rest_length=20.0, parameters={"ratio": 2.5})),
    "follow through a fold": lambda: follow(hopper(b=-0.009, rest_length=30.0), "b", -0.02, most=30),
    "follow to a limit": lambda: follow(hopper("tanh(b*r)/b", 0.1), "b", 0.9),
    "simulate": lambda: simulate(hopper(restitution=0.3, damping=0.01), 3.5, hops=4),
    "return map": lambda: ReturnMap(hopper(), inject=0.03)(np.linspace(1.0, 6.0, 200)),
    "fixed points": lambda: ReturnMap(hopper(), inject=0.03).fixed_points(2.5, 3.5),
    "sweep": lambda: sweep(hopper(), {"b": (0.01, 1.0)}, 50, seed=3),
    "sweep under gravity that varies": lambda: sweep(hopper(gravity="1 + 0.01*z"), {"b": (0.0, 1.0)}, 20, seed=3),
    "optimize": lambda: optimize(LEG, minimise="stroke", over={"k": (4e3, 2e4)}, subject_to=FORCE),
    "optimize over two parameters": lambda: optimize(LEG, maximise="alpha", over=TWO, subject_to=FORCE),
    "optimize beyond what can be met": lambda: infeasible(optimize, LEG, minimise="stroke", over=ONE, subject_to=SPEED),
    "prove an interval": lambda: prove(find(hopper()), parameters={"b": ("0.3", "0.3001")}),
    "steer": lambda: steer([cart()], guess=STRAIGHT),
    "chain": lambda: simulate(Chain(), {"y1": 0.5, "y1'": 3.0, "liftoff": 1.0, "alpha": 4.0}, time=15.0),
}  # fmt: skip


LONG = ("follow to a limit", "prove an interval")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in LONG else ()) for name in EFFORTS]
)
def test_efforts(name, counts):
    EFFORTS[name]()  # what is known of laws and machines from before is not counted
    counts.clear()
    EFFORTS[name]()
    assert dict(counts) == pytest.approx(known("efforts", name, dict(sorted(counts.items()))), rel=SLACK, abs=1.0)
