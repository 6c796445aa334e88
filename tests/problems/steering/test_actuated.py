"""A machine whose spring's end is moved: its energy changes by the actuator's work."""

import numpy as np
import pytest
from scipy.integrate import trapezoid

from orbits import InputError, Mechanism, simulate
from orbits.hops import Impacts
from orbits.mechanics import Damper, Mass, Spring
from problems import Actuated, Actuator, Chain, Hopper, springs, steering
from problems.laws import as_spring


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
        ((times[::-1], {"w": rates}), "finite and increase"),
        ((times, {"w": rates[1:]}), "11 values for 13 times"),
    ):
        with pytest.raises(InputError, match=words):
            simulate(machine, 5.0, time=6.0, schedule=schedule)


TWO = {"gap": "foot", "gravity": 0.5}
MASSES = [Mass("body", 2.0), Mass("foot", 2.0)]


def restated(spring="r", c=0.01, **others):
    """The hopper of equal masses, stated by its mechanics in the same units."""
    elements = [*MASSES, Spring("body - foot", spring), Damper("body - foot", "c")]
    return Mechanism(("body", "foot"), elements, parameters={"c": c}, **TWO, **others)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["displacement", "force"])
def test_a_mechanism_is_driven_as_the_hopper_that_it_is(kind):
    one, other = (
        steering.keep_hopping(machine, actuator=Actuator(kind=kind), intervals=20)
        for machine in (Hopper(damping=0.01), restated())
    )
    assert other.cost == pytest.approx(one.cost, rel=1e-8)
    t = np.linspace(0, one.end, 50)
    assert other(np.minimum(t, other.end)) == pytest.approx(one(t), abs=1e-8)
    assert other.work == pytest.approx(one.work, rel=1e-8)


def test_a_force_does_work_along_its_way():
    """The energy of a hop that a force drives from a launch, by the change of the machine's energy."""
    driven = steering.recover(restated(c=0.0), 0.05, actuator=Actuator("body - foot", kind="force"), intervals=20)
    assert driven.states[-1] == "f"
    impacts = Impacts(restated(c=0.0))
    first, last = (impacts.energy(driven(t)[:-1]) for t in (0.0, driven.end))
    assert driven.work[0] == pytest.approx(last - first, abs=1e-8)
    table = driven.table()
    assert table["actuator force"] == pytest.approx(table["f"], abs=1e-15)
    assert table["power"] == pytest.approx(table["f"] * (table["body'"] - table["foot'"]), abs=1e-13)


@pytest.mark.parametrize(
    ("machine", "actuator", "words"),
    [
        (Chain(), Actuator(), r"2 springs.*Actuator\('y1 - y2'\) or Actuator\('y2 - y3'\)"),
        (Chain(), Actuator("y1 - y3"), "no spring has the extension 'y1 - y3'"),
        (Chain(), Actuator("y1 - y4", kind="force"), "there is no coordinate 'y4'; known: y1, y2, y3"),
        (Chain(), Actuator("2", kind="force"), "has no coordinate; there are y1, y2, y3"),
        (Chain(), "y1 - y2", "it must be an Actuator"),
        (Hopper(springs.lossy("r", loss_factor=0.1)), Actuator(), "has hysteresis, which schedules do not support"),
        (restated(as_spring("r + f*r**3", {"f": 0.1})), Actuator(kind="force"), "actuator's own name"),
        (
            Mechanism(("body", "foot"), [*MASSES, Spring("body - foot - e")], actuators={"e": "v"}, **TWO),
            Actuator(),
            "has actuators of its own",
        ),
    ],
)
def test_what_no_actuator_fits(machine, actuator, words):
    with pytest.raises(InputError, match=words):
        Actuated(machine, actuator)


def test_what_is_no_actuator():
    with pytest.raises(InputError, match="must be 'displacement' or 'force'"):
        Actuator(kind={})
    with pytest.raises(InputError, match="must be 'displacement' or 'force'"):
        Actuator("body - foot", kind="torque")
    with pytest.raises(InputError, match="a formula of the coordinates"):
        Actuator(3)
