"""Functions of laws: those of Python are traced anew each time, and none of them is a closure that pickle refuses."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from orbits import find
from problems import Hopper
from problems.laws import springs


def test_numpy_functions_in_a_python_law():
    assert find(Hopper(springs.function(lambda r, b: np.sinh(b * r) / b, b=0.5))).alpha == pytest.approx(
        find(Hopper("sinh", parameters={"b": 0.5})).alpha, rel=1e-14
    )


def test_a_function_is_read_anew_each_time():
    """What a function closes over may have changed since the last time."""
    stiffening = 0.2
    law = lambda r: r + stiffening * r**3  # noqa: E731
    before = find(Hopper(law)).alpha
    stiffening = 0.5
    assert find(Hopper(law)).alpha == pytest.approx(2.7218099551244222, rel=1e-13) != before


def test_a_function_without_a_name_to_import_is_refused_by_pickle():
    law = replace(springs.linear(), expression=lambda x, p, q: x)
    with pytest.raises((pickle.PicklingError, AttributeError), match="lambda"):
        pickle.dumps(law)
