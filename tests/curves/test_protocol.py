"""What problems state, and what is found on their curves."""

import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from plane_curves import Formula, circle, found_by, lemniscate, run_of

from orbits.curves import BRANCH, FOLD, End, Event, Test, started
from orbits.curves.protocol import KINDS_OF_END
from orbits.errors import InputError

POINT = SimpleNamespace(value=0.5, cost=2.0)


def test_tangents_have_length_1_and_point_along_the_parameter():
    points = started(Formula(circle), np.array([[0.8, 0.6]]), way=-1.0)
    assert points.tangents[0] == pytest.approx([0.6, -0.8], abs=1e-14)


def test_kinds_of_ends_and_purposes_of_tests_are_known():
    assert all(End(kind).kind == kind for kind in KINDS_OF_END)
    with pytest.raises(InputError, match="cannot end as 'gone'; the ends are reached, closed"):
        End("gone")
    with pytest.raises(InputError, match="test 'top': does = 'asked'; it must be happens, changes or asks"):
        Test("top", FOLD.values, "asked")


def test_an_event_has_the_value_and_cost_of_its_point():
    event = Event("fold", point=POINT)
    assert (event.value, event.cost) == (0.5, 2.0)
    event = Event("enters", value=0.5, text="stroke <=")
    assert repr(event) == "Event(kind='enters', value=0.5, text='stroke <=')"
    assert repr(Event("fold", 3, 1.0)) == "Event(kind='fold', after=3, point=1.0)"
    assert pickle.loads(pickle.dumps(event)) == event != replace(event, value=0.6)
    with pytest.raises(InputError, match=r"an event cannot have the kind 0\.5"):
        Event(0.5, "enters", "stroke <=")
    with pytest.raises(TypeError, match="positional"):
        Event("enters", 0, None, 0.5, 2.0)


@pytest.mark.parametrize(
    ("state", "event"),
    [
        ({"kind": "enters", "value": 0.5, "cost": 2.0, "what": "f"}, Event("enters", value=0.5, cost=2.0, text="f")),
        ({"value": 0.5, "kind": "enters", "text": "k <="}, Event("enters", value=0.5, text="k <=")),
        ({"kind": "fold", "after": 2, "point": POINT}, Event("fold", 2, POINT)),
    ],
)
def test_pickled_events_of_older_versions_are_read(state, event):
    old = Event.__new__(Event)
    old.__setstate__(state)
    assert (old, old.what, old.value) == (event, event.text, 0.5)


def test_branch_points_need_recorded_equations():
    problem = Formula(lemniscate, [BRANCH])
    problem.records = False
    with pytest.raises(InputError, match="set `records = True`"):
        found_by(run_of(problem, (0.3, 0.5), stop=2.0))
