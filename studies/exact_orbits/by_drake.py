"""The cases by Drake: bodies with contacts, by its discrete solver and by its integrators with error control.

Contacts are points. The discrete solvers are SAP, with a stiffness beyond that which it can resolve, so that it takes
its limit of rigid contact, and the default one, "lagged", as stiff as it converges. With error control contacts at rest
sink in by the accuracy; CENIC is Drake's integrator for contact, and a Runge-Kutta scheme its default one. A landing
leaves no rebound, by a large dissipation, or little, by the default one.
"""

import logging
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np
from pydrake.geometry import DefaultProximityProperties, SceneGraphConfig
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import LinearSpringDamper, RevoluteSpring
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, EventStatus

from orbits.show.springs_for_drake import Springs
from studies.exact_orbits.automaton import Found
from studies.exact_orbits.blocks import Block
from studies.exact_orbits.bodies import APART, Bodies, bodies_of
from studies.exact_orbits.reader import Case

VERSION = f"Drake {version('drake')}"
# Ways with their settings: steps as shares of the time between two samples, or accuracies.
WAYS = dict.fromkeys(("SAP", "lagged"), (1 / 30, 1 / 100, 1 / 300, 1e-3, 1 / 3000, 1e-4))
WAYS |= dict.fromkeys(("CENIC", "RK3", "RK3, default dissipation"), (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8))
SCHEMES = {"CENIC": "cenic", "RK3": "runge_kutta3", "RK3, default dissipation": "runge_kutta3"}
RIGID = {"SAP": 1e12, "lagged": 1e6}  # stiffness, in weights over a length
PATIENCE = 2.0  # seconds of processor time
PLASTIC, DEFAULT = 1e4, 50.0  # dissipation of Hunt and Crossley, s/m


def prepared(case: Case, way: str) -> Callable[[float], Callable[[], Found]]:
    """A function of the step or of the accuracy that returns the simulation of a case."""
    bodies = bodies_of(case)
    if bodies.restitution:
        raise NotImplementedError("no constant restitution")
    if any(each.inertance for each in bodies.springs):
        raise NotImplementedError("no inerter between bodies")
    start = bodies.start({name: float(x) for name, x in case.at(case["start"]["state"]).items()})
    begin, samples = float(case["start"]["time"]), [each["time"] for each in case["samples"]]
    logging.getLogger("drake").setLevel(logging.ERROR)

    def ready(setting: float) -> Callable[[], Found]:
        step = 0.0
        if way in RIGID:
            step = (samples[-1] - begin) / len(samples) * setting
        stiffness = bodies.weight * RIGID.get(way, 1 / setting)
        diagram, plant = _built(bodies, step, stiffness, way)
        simulator = Simulator(diagram)
        if way not in RIGID:
            ApplySimulatorConfig(
                SimulatorConfig(integration_scheme=SCHEMES[way], accuracy=setting, max_step_size=0.1, start_time=begin),
                simulator,
            )

        def run() -> Found:
            context, found = simulator.get_mutable_context(), Found()
            context.SetTime(begin)
            own = plant.GetMyMutableContextFromRoot(context)
            joints = {name: plant.GetJointByName(name).position_start() for name in bodies.joints}
            places, speeds = np.zeros((2, plant.num_positions()))
            for name, at in joints.items():
                places[at], speeds[at] = start[name]
            plant.SetPositions(own, places)
            plant.SetVelocities(own, speeds)
            simulator.Initialize()
            end = process_time() + PATIENCE

            def wait(context: Context) -> EventStatus:
                if process_time() > end:
                    raise TimeoutError(f"more than {PATIENCE:g} s")
                return EventStatus.DidNothing()

            simulator.set_monitor(wait)
            for i, time in enumerate(samples):
                simulator.AdvanceTo(time)
                vectors = plant.GetPositions(own), plant.GetVelocities(own)
                found.states.append(bodies.state(*({name: x[at] for name, at in joints.items()} for x in vectors), i))
            return found

        return run

    return ready


def _built(bodies: Bodies | Block, step: float, stiffness: float, way: str) -> tuple[Diagram, MultibodyPlant]:
    builder = DiagramBuilder()
    plant, scene = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=step, contact_model="point", discrete_contact_approximation="sap" if way == "SAP" else "lagged"
        ),
        builder,
    )
    rough = 5.0 if isinstance(bodies, Block) else 0.0
    friction = {"static_friction": rough, "dynamic_friction": rough}
    contact = DefaultProximityProperties(
        point_stiffness=stiffness, hunt_crossley_dissipation=DEFAULT if "default" in way else PLASTIC,
        **friction,
    )  # fmt: skip
    scene.set_config(SceneGraphConfig(default_proximity_properties=contact))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "model.xml"
        path.write_text(bodies.model(), encoding="utf-8")
        Parser(plant).AddModels(path)
        curved = _add_springs(plant, bodies)
        plant.Finalize()
        if curved:
            springs = builder.AddSystem(Springs(plant, path))
            builder.Connect(plant.get_state_output_port(), springs.get_input_port())
            builder.Connect(springs.get_output_port(), plant.get_applied_generalized_force_input_port())
    return builder.Build(), plant


def _add_springs(plant: MultibodyPlant, bodies: Bodies | Block) -> bool:
    """Add linear springs as Drake's own; whether there are others, which are then all computed in Python."""
    if any(len(each.cubics) > 1 or any(each.cubics[0].coefficients[1:]) for each in bodies.springs):
        return True
    for each in bodies.springs:
        below = plant.GetBodyByName(each.below) if each.below else plant.world_body()
        above, (place, (stiffness, *_), _) = plant.GetBodyByName(each.above), each.cubics[0]
        ends = below, [0, 0, -APART], above, [0, 0, 0]
        plant.AddForceElement(LinearSpringDamper(*ends, APART + place, stiffness, each.damping))
    for joint in (plant.GetJointByName("rotor"),) if getattr(bodies, "rotor", 0) else ():
        plant.AddForceElement(RevoluteSpring(joint, 0.0, 1.0))
    return False
