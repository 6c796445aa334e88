"""What a user writes, in the order of the documentation; lines that end in `# wrong` are mistakes, one each."""

from collections.abc import Sequence
from pathlib import Path

import orbits
import problems
from orbits import (
    Family,
    Mechanism,
    NoOrbit,
    Orbit,
    Point,
    ReturnMap,
    Simulation,
    bifurcations,
    find,
    find_all,
    follow,
    multipliers,
    optimize,
    pareto,
    prove,
    simulate,
    sweep,
    uncertainty,
)
from orbits.control import hold
from orbits.mechanics import Ground, Mass, Spring
from problems import Actuator, Chain, Hopper, gravity, hopper_in_si, juggler_in_si, rimless_wheel, springs, steering


def speeds(orbits: Sequence[Orbit]) -> list[float]:
    return [orbit.alpha for orbit in orbits]


leg = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 2e6}, rest_length=0.8)
soft = hopper_in_si(14.0, 1.8, force=springs.table(springs.SAMPLE, in_si=True), rest_length=0.62)
juggler = juggler_in_si(0.2923, 0.2657, stiffness=8.8, surface_gravity=0.18)
rover = Hopper(springs.air(length=9.0), gravity.inverse_square(R=500.0), rest_length=9.0)
on_plate = Hopper("cubic", 0.5, ground=Ground(mass=2.0, spring=100.0))  # wrong
on_plate = Hopper("cubic", "1", 0.5, ground=Ground(mass=2.0, spring=100.0))
hopper_in_si("60", 3.0, stiffness=8000.0)  # wrong
hopper_in_si(60.0, 3.0, stifness=8000.0)  # wrong
Hopper(spring=3.0)  # wrong
Chain(masses="1, 1, 1")  # wrong
springs.cubic(beta="0.3")  # wrong
springs.cubik(beta=0.3)  # wrong

orbit = find(leg, family=2)
found: list[float] = speeds([*find_all(leg), orbit])
width: float = orbit.certificate.error
lost = orbit.certificate.loss_coefficient
if lost is not None:
    print(2 * lost)
print(2 * orbit.certificate.loss_coefficient)  # wrong
print(orbit.loss_coefficient)  # wrong
print(orbit.alhpa)  # wrong
print(orbit.certificate.clearence)  # wrong
orbit.save(3)  # wrong
again: Orbit = Orbit.load("orbit.json")
path: Path = orbit.save("orbit.json")
find(leg, famly=2)  # wrong
find("hopper")  # wrong

family = follow(Hopper("cubic"), "beta", 5.0, start=0.0)
first: Point = family.points[0]
print(first.clearance, first.period, family.end.reason, [event.kind for event in family.events])
print(first.clearence)  # wrong
print(family.poins)  # wrong
print(family.end.reasn)  # wrong
print([event.kin for event in family.events])  # wrong
follow(Hopper("cubic"), 0.3, 5.0)  # wrong


def widest(each: Family) -> float:
    return max(point.alpha for point in each)


step = ReturnMap(Hopper(), inject=0.03)
low, high = step.fixed_points(4, 5)
print(step([2.0, 4.0]).next, high.multiplier, step.basin(4, 5))
print(step([2.0, 4.0]).following)  # wrong
print(high.multiplyer)  # wrong
print(step.fixed_pionts(4, 5))  # wrong
ReturnMap(Hopper(), inject="0.03")  # wrong

run: Simulation = simulate(Hopper(restitution=0.3), 4.6, hops=3)
print(run.status, run.impacts, run.end, [event.time for event in run.events])
print(run.statuses)  # wrong
simulate(Hopper(), 4.6, hop=3)  # wrong

best = optimize(leg, minimise="k", over={"k": (2000.0, 20000.0)}, subject_to=["centre_of_mass_rise <= 0.04"])
print(best.orbit.alpha, best.follow("centre_of_mass_rise <= 0.04", 0.05).slopes)
print(best.orbit.alfa)  # wrong
print(best.follow("centre_of_mass_rise <= 0.04", 0.05).slope)  # wrong
front = pareto(leg, minimise=("k", "smallest_separation"), over={"k": (2000.0, 20000.0)})
print(front.designs[0].objectiv)  # wrong
many = sweep(Hopper("cubic", rest_length=9.0), {"beta": (0.0, 1.0)}, samples=100)
print(many.statuses, uncertainty(leg, {"k": 240.0}).linear)
print(many.status)  # wrong
proof = prove(orbit)
print(proof.statement, proof.proved)
print(proof.proven)  # wrong

try:
    driven = steering.keep_hopping(Hopper(damping=0.01), actuator=Actuator(), speed=4.6)
    print(driven.cost, driven.follow("damping", 0.02).at(0.01).cost)
except NoOrbit as error:
    print(error)
print(driven.costs)  # wrong
print(driven.follow("damping", 0.02).cost)  # wrong
steering.keep_hopping(Hopper(damping=0.01), spead=4.6)  # wrong

masses = [Mass("body", 60.0), Mass("foot", 3.0)]
own = Mechanism(("body", "foot"), [*masses, Spring("body - foot", "k*r")], gap="foot", parameters={"k": 8000.0})
Mechanism(("body", "foot"), masses, gap=["foot"])  # wrong
Spring("body - foot", ["k*r"])  # wrong
walk = find(rimless_wheel(mass=2.0, length=0.4, spokes=8, inertia=0.4, body_inertia=0.4, stiffness=20.0))
print(multipliers(own, walk).values, bifurcations(Hopper(), "inject", (0.0, 0.1), (4.0, 5.0)))
print(hold(walk, "torque").gains, orbits.__version__)
print(orbits.fnd)  # wrong
print(orbits.Mechanism.name, problems.Hoper)  # wrong
