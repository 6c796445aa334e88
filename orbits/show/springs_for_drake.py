"""The springs of a model in MJCF, which Drake does not read, for a MultibodyPlant: an exported folder has a copy.

`diagram, plant = plant_with_springs("hop/model.xml")` reads a model with them.
"""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem


class Springs(LeafSystem):
    """Springs of joints, and springs and dampers of fixed tendons, with MuJoCo's polynomials and dead bands; dampers of
    joints are part of the plant.

    plant : finalized, with the joints of the model
    model : the file, "model.xml"
    """

    def __init__(self, plant: MultibodyPlant, model: str | Path):
        super().__init__()
        root, n = ElementTree.parse(model), plant.num_positions()
        rows, springs, dampers = [], [], []
        for each in [*root.findall("worldbody//joint"), *root.findall("tendon/fixed")]:
            lengths = _numbers(each, "springref" if each.tag == "joint" else "springlength", 2)
            springs.append([lengths[0], lengths[-1], *_numbers(each, "stiffness", 3)])
            dampers.append(_numbers(each, "damping", 3) if each.tag == "fixed" else [0.0] * 3)
            parts = [(each.get("name"), 1.0)] if each.tag == "joint" else []
            parts += [(part.get("joint"), float(part.get("coef", "1"))) for part in each if each.tag == "fixed"]
            rows.append(np.zeros(n))
            for name, weight in parts:
                rows[-1][plant.GetJointByName(str(name)).position_start()] += weight
        kept = [i for i, each in enumerate(springs) if any(each[2:]) or any(dampers[i])]
        self.weights = np.reshape([rows[i] for i in kept], (-1, n))
        self.springs, self.dampers = (
            np.reshape([each[i] for i in kept], (len(kept), -1)).T for each in (springs, dampers)
        )
        self.state = self.DeclareVectorInputPort("state", 2 * n)
        self.DeclareVectorOutputPort("force", n, self._write_forces)

    def _write_forces(self, context: Any, output: Any) -> None:
        output.SetFromVector(self.forces(np.asarray(self.state.Eval(context))))

    def forces(self, state: np.ndarray) -> np.ndarray:
        """The generalized forces (n,) of positions and velocities (2n,)."""
        place, rate = np.reshape(state, (2, -1)) @ self.weights.T
        low, high, a, b, c = self.springs
        x = np.maximum(place - high, 0.0) + np.minimum(place - low, 0.0)
        d, e, f = self.dampers
        return -(x * (a + x * (b + x * c)) + rate * (d + abs(rate) * (e + abs(rate) * f))) @ self.weights

    def energy(self, positions: np.ndarray) -> float:
        """The potential energy of the springs at positions (n,)."""
        low, high, a, b, c = self.springs
        place = self.weights @ positions
        x = np.maximum(place - high, 0.0) + np.minimum(place - low, 0.0)
        return float((x**2 * (a / 2 + x * (b / 3 + x * c / 4))).sum())


def _numbers(node: ElementTree.Element, name: str, count: int) -> list[float]:
    """The numbers of an attribute, whose last ones may be missing: 0, or, of a length, the first one again."""
    found = [float(each) for each in node.get(name, "0").split()]
    return found + [found[0] if count == 2 else 0.0] * (count - len(found))


def plant_with_springs(model: str | Path, time_step: float = 0.0) -> tuple[Diagram, MultibodyPlant]:
    """A diagram of a plant and its springs; a `time_step` of 0 is Drake's continuous plant."""
    builder, plant = DiagramBuilder(), MultibodyPlant(time_step)
    Parser(plant).AddModels(Path(model))
    plant.Finalize()
    springs = Springs(plant, model)
    for system in (plant, springs):
        builder.AddSystem(system)
    builder.Connect(plant.get_state_output_port(), springs.get_input_port())
    builder.Connect(springs.get_output_port(), plant.get_applied_generalized_force_input_port())
    return builder.Build(), plant
