"""The figures of driven machines and of disturbances."""

import numpy as np
import pytest
from legibility import faults


@pytest.mark.slow
def test_figures(driven_hopper, driven_leg):
    axes = driven_hopper.plot()
    _, end, rate = axes.figure.axes
    assert {text.get_text() for text in rate.get_legend().get_texts()} == {"body", "foot", "centre of mass", "contact"}
    t = np.linspace(0, driven_hopper.end, 2001)
    assert end.lines[0].get_xydata()[:, 1] == pytest.approx(driven_hopper(t)[:, 4])
    assert rate.patches[0].get_data().values == pytest.approx(driven_hopper.schedule("w")[1]["w"])
    shown = driven_leg.plot()
    labels = [one.get_ylabel().replace("\n", " ") for one in shown.figure.axes]
    assert labels == ["height (m)", "spring's end (m)", "its rate (m/s)"]
    assert shown.figure.axes[-1].get_xlabel() == "time (s)"
    off = driven_leg.simulate(2, damping=5.5)
    axes = off.plot()
    assert axes.figure.axes[1].lines[0].get_xydata()[:, 1] == pytest.approx(off.launch_errors)
    assert axes.figure.axes[1].get_ylabel().replace("\n", " ") == "launch speed off by (m/s)"
    assert "undisturbed" in [text.get_text() for text in axes.figure.axes[1].get_legend().get_texts()]
    for one in (driven_hopper.plot(), shown, axes, driven_hopper.simulate(4, launch_error=-0.1).plot()):
        assert not faults(one.figure)
