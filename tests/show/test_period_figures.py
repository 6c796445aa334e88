"""Pictures in the plane of two parameters: a colour for each period, and curves of bifurcations over them."""

import numpy as np

from orbits import PeriodDiagram
from orbits.continuation import End
from orbits.model import machine_in_words
from orbits.returns import BifurcationCurve
from orbits.returns.bifurcation_curve import PlaceOnCurve
from problems import Hopper
from tests.legibility import faults

WORDS = machine_in_words(Hopper())


def test_periods_with_a_curve():
    status = np.array([["periodic", "periodic", "chaotic"], ["periodic", "longer", "rests"]], dtype=object)[..., None]
    periods = np.array([[1, 2, 0], [1, 0, 0]])[..., None]
    launches = np.where(status == "rests", np.nan, 4.5)
    numbers = (4.5,), status, periods, launches, np.full(periods.shape, np.nan), 16, 512
    axes_of = np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0])
    axes = PeriodDiagram("inject", "mass_ratio", WORDS, *axes_of, *numbers).plot()
    events = (PlaceOnCurve("turn", (0.2, 2.0), (4.5,)),)
    own = (1,), np.array([[0.1, 1.0], [0.2, 2.0]]), np.array([[4.5], [4.6]]), events, End("reached", "")
    BifurcationCurve("flip", "inject", "mass_ratio", WORDS, *own).plot(axes)
    labels = axes.get_legend_handles_labels()[1]
    assert labels == ["no hops go on", "chaotic", "no period up to 16", "period 1", "period 2", "flip, fixed points"]
    assert axes.collections[0].get_array().reshape(2, 3).tolist() == [[3, 4, 1], [3, 2, 0]]
    assert not faults(axes.figure)
    alone = BifurcationCurve("flip", "inject", "mass_ratio", WORDS, *own).plot()
    assert alone.get_xlabel() == "injection"
    assert not faults(alone.figure)
