"""Machines with the same words and other equations are told apart, also by the store of a sweep."""

import numpy as np
import pytest

from orbits import InputError, Mechanism, Sweep
from orbits.mechanics import Mass, Spring
from orbits.sweeps.designs import members_of
from orbits.sweeps.question import question_of
from orbits.sweeps.store import Store
from problems import Hopper, gravity, springs

PLACES = np.linspace(-9, 9, 181)


def a_mechanism(foot: str = "m2", spring="r"):
    elements = [Mass("body", "m1"), Mass("foot", foot), Spring("body - foot", spring)]
    return Mechanism(("body", "foot"), elements, "foot", parameters={"m1": 1.0, "m2": 1.0})


@pytest.mark.parametrize(
    "pair",
    [
        tuple(Hopper(springs.table((PLACES, PLACES + c * PLACES**3))) for c in (0.1, 0.1 + 1e-9)),
        tuple(Hopper(springs.function(lambda r, c=c: r + c * r**3)) for c in (0.1, 0.5)),
        tuple(
            Hopper("r", gravity.function(lambda z, c=c: 1 / (1 + z / c) ** 2), rest_length=9.0) for c in (50.0, 500.0)
        ),
        (a_mechanism(), a_mechanism(foot="2*m2")),
    ],
    ids=["table", "function", "gravity", "masses"],
)
def test_the_same_words_of_other_equations_are_refused(tmp_path, pair):
    """A table and a Python function have a name, and a mechanism says its springs: the first machine's numbers are not
    those of the second."""
    first, second = pair
    assert first.describe() == second.describe()
    path, name = tmp_path / "study.db", next(iter(first.values))
    members = members_of({name: (0.5, 2.0)}, 8, "sobol", 0, [name])
    for _ in range(2):  # the equations are recognised
        Store(path, question_of(first, members, 1, (), "find", None)).close()
    with pytest.raises(InputError, match="other equations"):
        Store(path, question_of(second, members, 1, (), "find", None))
    assert Sweep.load(path, first).count == 8
    with pytest.raises(InputError, match="other equations"):
        Sweep.load(path, second)
