"""Derivatives of quantities by the parameters of a machine, against differences of neighbouring orbits."""

import numpy as np
import pytest
from designs import CUBIC, VARYING

from orbits import find, quantities, sensitivities
from problems import Juggler


@pytest.mark.parametrize(
    ("machine", "family"),
    [(CUBIC, 1), (CUBIC, 2), (VARYING, 1), (Juggler("r + b*r**3", mass_ratio=0.7, parameters={"b": 0.2}), 1)],
)
def test_sensitivities_are_those_of_neighbouring_orbits(machine, family):
    orbit = find(machine, family)
    names = ["b", "mass_ratio"]
    exact = sensitivities(machine, orbit, names)
    for name in names:
        h, rows = 1e-3 * machine.values[name], []
        for s in (-2, -1, 1, 2):
            near = machine.with_values(**{name: machine.values[name] + s * h})
            rows.append(np.array(list(quantities(near, find(near, family)).values())))
        slopes = (rows[0] - 8 * rows[1] + 8 * rows[2] - rows[3]) / (12 * h)
        for quantity, slope in zip(exact, slopes, strict=True):
            assert exact[quantity][name] == pytest.approx(slope, rel=1e-7, abs=1e-8), quantity
