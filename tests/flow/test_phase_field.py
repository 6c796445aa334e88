"""The field of a phase in pieces at states and parameters, against the formulas of its pieces."""

import numpy as np
import pytest

from orbits.flow.phase_field import PhaseField
from orbits.model import Phase, Pieces

PIECES = Pieces((1.0, 0.0), 2, lambda p: ([-9.0, p["g"], 9.0], [[1.0, 0.0], [p["b"], 0.7]]), "r", lambda p: p["u"])
FIELD = PhaseField(
    Phase("flight", ("r", "v"), lambda x, p, q: [x[1], -q[1] - q[0] * x[0]], pieces=PIECES), ("b", "g", "u", "unused")
)
P = np.array([2.0, 0.6, 1.5, 3.0])  # the breakpoint is at r = 0.6/1.5


def test_rates_are_those_of_the_piece_of_each_state():
    states = np.array([[-1.0, 0.2], [0.399, 0.3], [0.401, -0.4], [4.0, 1.0]])
    r, v = states.T
    force = np.where(r < 0.4, r, 0.7 + 2.0 * r)
    assert FIELD.field(states, P)[0] == pytest.approx(np.column_stack([v, -force]), rel=1e-15)
    assert FIELD.pieces_of(states, P[None]).tolist() == [0, 0, 1, 1]
    assert FIELD.rates(states[3], FIELD.data(states[3:], P)[0]) == pytest.approx([1.0, -8.7], rel=1e-15)


def test_jumps_and_the_range():
    assert FIELD.jumps(P) == pytest.approx([0.4])
    closed = PhaseField(FIELD.phase, FIELD.parameters)  # the force is continuous where (b - 1) r = -0.7
    assert closed.jumps(np.array([0.5, 1.4, 1.0, 0.0])) == []
    assert FIELD.breaks == 3
    assert "[-6, 6], at 7" in str(FIELD.out_of_range(P, np.array([7.0, 0.0])))
    assert FIELD.first_pieces(np.array([[0.4, 1.0], [0.4, -1.0], [7.0, 0.0]]), P[None]).tolist() == [2, 1, 3]
