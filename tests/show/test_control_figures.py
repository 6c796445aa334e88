"""The figures of motions that optimal control has found."""

import numpy as np
import pytest
from carts import HALF
from legibility import faults
from looks import check_looks


@pytest.mark.slow
def test_the_figure(steered_relay):
    axes = steered_relay.plot()
    states, inputs = axes.figure.axes
    assert states is axes
    assert [text.get_text() for text in states.get_legend().get_texts()] == ["x", "v", "heat"]
    assert [text.get_text() for text in inputs.get_legend().get_texts()] == ["f", "g"]
    assert [text.get_text() for text in states.texts] == ["cart", "sled"]
    curves = {line.get_label(): line.get_xydata() for line in states.lines}
    heat = curves["heat"][np.isfinite(curves["heat"][:, 1])]
    assert heat[0] == pytest.approx([HALF, 0], abs=1e-9)  # the cart has none
    assert heat[-1] == pytest.approx([1, HALF], abs=1e-9)
    assert inputs.get_xlabel() == "time"
    assert not faults(axes.figure)
    check_looks("control", axes.figure)
