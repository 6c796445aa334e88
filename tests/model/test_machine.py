"""Machines stand in one line, and come back from a pickle as they were, in another process too."""

import pickle
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from dataclasses import dataclass
from multiprocessing import get_context
from types import SimpleNamespace

import numpy as np
import pytest

from orbits import InputError, ReturnMap, find, follow
from problems import Actuated, Chain, HeavyHand, Hopper, Juggler, hopper_in_si, juggler_in_si
from problems.laws import gravity, springs

ROWS = ([-20.0, -10.0, -1.0, 0.0, 1.0, 10.0, 20.0], [-30.0, -14.0, -1.0, 0.0, 1.0, 14.0, 30.0])


def saturating(r, b):
    return (1 - np.exp(-b * r)) / b


@dataclass(frozen=True)
class Named(Hopper):
    """A user's own machine, in a module."""

    label: str = "mine"


MACHINES = {
    "Hopper(spring='r')": lambda: Hopper(),
    "Hopper(spring='r + beta*r**3', beta=0.3, mass_ratio=0.5)": lambda: Hopper(
        "r + beta*r**3", mass_ratio=0.5, parameters={"beta": 0.3}
    ),
    "Hopper(spring='saturating', gravity='1/(1 + z/R)**2', b=0.2, R=50.0, rest_length=10.0)": lambda: Hopper(
        springs.function(saturating, b=0.2), "1/(1 + z/R)**2", rest_length=10.0, parameters={"R": 50.0}
    ),
    "Hopper(spring='<lambda>', b=0.5, damping=0.01)": lambda: Hopper(
        springs.function(lambda r, b: r + b * r**3, b=0.5), damping=0.01
    ),
    "Hopper(spring='<lambda>', gravity='<lambda>', H=90.0, rest_length=9.0)": lambda: Hopper(
        springs.function(lambda r: r + 0.1 * abs(r), breakpoints=(0.0,)),
        gravity.function(lambda z, H: 1 - z / H, H=90.0),
        rest_length=9,
    ),
    "Juggler(spring='potential:r**2/2 + b*r**4/4', b=0.1, restitution=0.3)": lambda: Juggler(
        "potential:r**2/2 + b*r**4/4", parameters={"b": 0.1}, restitution=0.3
    ),
    "HeavyHand(spring='r')": lambda: HeavyHand(),
    "Hopper(spring='bilinear', ratio=3.0, gap=0.5)": lambda: Hopper("bilinear"),
    "Hopper(spring='end_stops', gap=3.0, stop=20.0)": lambda: Hopper("end_stops"),
    "Hopper(spring='table:table (noise not known, 7 rows are too few)')": lambda: Hopper(springs.table(ROWS)),
    "Actuated(machine=Hopper(spring='r', damping=0.01)": lambda: Actuated(Hopper(damping=0.01)),
    "Chain(b=0.1, masses=(1.0, 2.0, 1.0), springs='r + b*r**3')": lambda: Chain(
        (1, 2, 1), "r + b*r**3", parameters={"b": 0.1}
    ),
    "Chain(masses=(1.0, 1.0, 1.0), springs=('r', '2*r'), restitution=0.5)": lambda: Chain(
        springs=["r", "2*r"], restitution=0.5
    ),
    "hopper in SI, spring 8000*r + c*r**3, gravity 1/(1 + z/body_radius)**2: body_mass = 60 kg": lambda: hopper_in_si(
        60.0, 3.0, force="8000*r + c*r**3", parameters={"c": 2e6}, rest_length=0.8, body_radius=250.0
    ),
    "hopper in SI, spring table:table": lambda: hopper_in_si(
        60.0, 3.0, force=springs.table((np.array(ROWS[0]) / 100, np.array(ROWS[1]) * 100))
    ),
    "juggler in SI, spring stiffness*r": lambda: juggler_in_si(0.3, 0.27, stiffness=8.8),
    "Named(spring=Law('r'), gravity=Law('1'), mass_ratio=2.0": lambda: Named(mass_ratio=2.0),
}


@pytest.mark.parametrize("told", MACHINES)
def test_machines(told):
    machine = MACHINES[told]()
    assert repr(machine) == told or (repr(machine).startswith(told) and "\n" not in repr(machine))
    assert "0x" not in repr(machine)
    model = machine.model  # what is built must not be pickled
    for again in (pickle.loads(pickle.dumps(machine)), deepcopy(machine), MACHINES[told]()):
        assert again == machine
        assert type(again) is type(machine)
        assert repr(again) == repr(machine)
        assert list(again.values.items()) == list(machine.values.items())
        assert again.describe() == machine.describe()
        assert again.model is model  # it shares all that has been built
    assert len(pickle.dumps(machine)) < 6000


def solved(machine):
    """What a child process finds and hands back, with its own copy of what it was handed."""
    return machine, find(machine), ReturnMap(machine)([4.4, 4.6])


@pytest.mark.slow
def test_other_processes():
    """A pool of spawned processes, which share nothing with this one, gives the answers of this one."""
    machines = [MACHINES[told]() for told in MACHINES if any(word in told for word in CHILDREN)]
    assert len(machines) == len(CHILDREN)
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        answers = list(pool.map(solved, machines, chunksize=len(machines)))
    for machine, (sent, orbit, hops) in zip(machines, answers, strict=True):
        assert sent == machine
        assert sent.model is machine.model
        own = find(machine)
        assert abs(orbit.alpha - own.alpha) <= orbit.error + own.error
        assert (orbit.family, orbit.machine, orbit.admissible) == (own.family, own.machine, own.admissible)
        assert hops.next == pytest.approx(ReturnMap(machine)([4.4, 4.6]).next, rel=1e-12, nan_ok=True)


# Machines whose laws are a formula, Python functions, a potential, pieces, and a table in SI.
CHILDREN = ("c*r**3", "b=0.2, R=50.0", "potential", "'bilinear'", "in SI, spring table:table")


def test_what_is_no_machine_is_refused_by_its_missing_parts():
    bare = SimpleNamespace(model=Hopper().model, values=Hopper().values)
    with pytest.raises(InputError, match="it has no 'units'; it has no 'describe'"):
        find(bare)
    with pytest.raises(InputError, match="it has no 'with_values'"):
        follow(SimpleNamespace(**vars(bare), units=None, describe=dict), "mass_ratio", 2.0)
    with pytest.raises(InputError, match="model: it is a str, not a Model"):
        ReturnMap(SimpleNamespace(**{**vars(bare), "model": "hopper"}, units=None, describe=dict))
