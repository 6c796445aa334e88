"""The form of the maps of a hand-written machine that steps: signs, shifts, and what follows from both."""

from dataclasses import replace

import numpy as np
import pytest
from steps import by_hand

from orbits.consistency.shapes import malformed
from orbits.model.phase import Affine

WHEEL, SHUTTLE = by_hand("wheel")(1.0, 0.5, 0.3), by_hand("shuttle")(1.0, 0.5, 0.3)
WRONG = [
    ({"reversor": (-1, 1)}, {"reversor": "it has 2 signs, not 4"}),
    ({"symmetry": (1, 1, 2, 1)}, {"symmetry": "(1, 1, 2, 1) are not signs 1 and -1"}),
    ({"symmetry": (1, 1, 1)}, {"symmetry": "it has 3 signs, not 4"}),
    ({"reversor_shift": lambda p: [0.6, 0.0]}, {"reversor_shift": "it has the shape (2,), not (4,)"}),
    ({"symmetry_shift": lambda p: [np.nan] * 4}, {"symmetry_shift": "it has a number that is not finite"}),
    ({"reversor_shift": lambda p: [0.6, 0.0, 0.6, 0.1]}, {"reversor_shift": "it adds to the speed theta'"}),
    ({"reversor": None}, {"reversor_shift": "there is no reversor whose images it moves: state its signs, 1 where it "
                                            "leaves a state as it is"}),
    ({"symmetry": None}, {"symmetry_shift": "there is no symmetry whose images it moves: state its signs, 1 where it "
                                            "leaves a state as it is"}),
    ({"reversor": (1, -1, 1, -1)}, {"reversor_shift": "it takes phi to phi + 0.6, and is not its own inverse"}),
    ({"landing_gap": lambda p: Affine((1.0,))}, {"landing_gap": "it has 1 weights, not 4"}),
    ({"landing_gap": lambda p: 0.6}, {"landing_gap": "it is a float, not an Affine"}),
    ({"feet": ("left", "right", "third")}, {"feet": "it has 3 names, not one or two"}),
    ({"violations": dict.fromkeys(("gap", "pull", "separation", "end", "landed pull"), "no")},
     {"violations": "it has no words for 'landing gap'"}),
    ({"violations": dict.fromkeys(("gap", "pull", "separation", "end", "landing gap"), "no")},
     {"violations": "it has no words for 'landed pull'"}),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "faults"), WRONG)
def test_faults_in_the_maps_of_a_machine_that_steps_are_named(changes, faults):
    found = malformed(replace(WHEEL.model, **changes), WHEEL.values)
    assert {name: found.get(name) for name in faults} == faults
    assert {*found} <= {*faults, "symmetry_shift"}  # without a true reversor, neither does the other map turn back


def test_the_symmetry_after_the_reversor_leads_back_when_done_twice():
    wrong = replace(SHUTTLE.model, symmetry_shift=lambda p: [p["angle"], 0.0, p["angle"], 0.0])
    words = "the symmetry after the reversor takes phi to phi + -0.3, and is not its own inverse"
    assert malformed(wrong, SHUTTLE.values) == {"symmetry_shift": words}


@pytest.mark.parametrize("kind", ["wheel", "rocker", "shuttle"])
def test_machines_that_step_are_well_formed(kind):
    machine = by_hand(kind)(1.0, 0.5, 0.3)
    assert malformed(machine.model, machine.values) == {}
