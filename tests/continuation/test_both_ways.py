"""Families that go both ways from their start, against closed forms and against the two ways alone."""

from dataclasses import replace

import numpy as np
import pytest

from orbits import Family, InputError, follow, follow_event
from orbits.running import TimeOver
from problems import Hopper, hopper_in_si

ALPHA = 4.493409457909064  # the root of alpha = tan(alpha)
LEG = hopper_in_si(60.0, 3.0, stiffness=8000.0, rest_length=0.8)
CUBIC = Hopper("cubic", rest_length=30.0, parameters={"beta": 0.3})


def test_the_masses_of_a_linear_leg():
    """alpha is its root times m2 g/k over sqrt(m2/(k (1 + M)))."""
    family = follow(LEG, "foot_mass", (0.5, 4.0), at=[1.0, 3.5])
    mass = family.column("foot_mass")
    assert mass[[0, -1]].tolist() == [0.5, 4.0]
    assert 3.0 in mass.tolist()
    assert (np.diff(mass) > 0).all()
    units = mass * 9.80665 / 8000 / np.sqrt(mass / (8000 * (1 + mass / 60)))
    assert family.column("alpha") == pytest.approx(ALPHA * units, rel=1e-13)
    assert (family.beginning.kind, family.beginning.reason) == ("reached", "foot_mass = 0.5")
    assert (family.end.kind, family.end.reason) == ("reached", "foot_mass = 4")
    assert [(each.kind, family[each.after].value) for each in family.events] == [("value", 1.0), ("value", 3.5)]
    assert "beginning" in str(family)
    assert follow(LEG, "foot_mass", 4.0).beginning is None


def test_the_ways_are_those_that_are_followed_alone():
    whole = follow(CUBIC, "beta", (-0.02, 1.0), at=[-0.005])
    back, onward = follow(CUBIC, "beta", (1.0, -0.02), at=[-0.005]), follow(CUBIC, "beta", (-0.02, 1.0))
    assert [each.kind for each in whole.events] == ["value", "fold", "collapse", "value"]
    assert (whole.beginning.kind, whole.end.kind) == ("escaped", "reached")
    assert whole == back.__class__(  # the order of the ways is turned, and nothing else
        whole.name, whole.machine, whole.points, whole.events, onward.end, whole.settings, whole.versions
    )
    fold = whole.events[1]
    assert fold.point.value == pytest.approx(-0.0106952149164040, rel=1e-12)
    assert whole[fold.after].alpha > fold.point.alpha > whole[fold.after + 1].alpha
    for each in (whole.events[0], whole.events[3]):
        assert whole[each.after].value == each.point.value == -0.005
    x = np.array([[*point.u, point.value] for point in whole])
    tangents = np.array([point.tangent for point in whole])
    assert ((np.diff(x, axis=0) * tangents[:-1]).sum(axis=1) > 0).all()


def test_of_a_start_at_a_bound_there_is_one_way():
    for bounds, last in (((0.3, 0.4), 0.4), ((0.4, 0.3), 0.4), ((0.2, 0.3), 0.2)):
        family = follow(CUBIC, "beta", bounds, longest=0.5)
        assert (family[0].value, family[-1].value, family.beginning) == (0.3, last, None)


def test_it_goes_along_a_quantity_and_from_a_stated_start():
    family = follow(CUBIC, "period", (8.0, 12.0), tune="beta", longest=0.3)
    assert family.column("flight_time")[[0, -1]] + family.column("contact_time")[[0, -1]] == pytest.approx([8.0, 12.0])
    assert abs(family.column("beta") - 0.3).min() < 1e-13
    stated = follow(CUBIC, "beta", (0.1, 0.5), start=0.2, longest=0.5)
    assert stated.column("beta")[[0, -1]].tolist() == [0.1, 0.5]
    assert 0.2 in stated.column("beta").tolist()


def test_its_file_has_the_whole(tmp_path):
    path, seen = tmp_path / "family.jsonl", []
    family = follow(CUBIC, "beta", (0.2, 0.4), output=path, progress=seen.append)
    assert Family.load(path, CUBIC) == family
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)


def test_what_was_stopped_goes_on_at_both_ends(tmp_path):
    short = follow(CUBIC, "beta", (0.2, 0.4), most=4)
    assert (short.beginning.kind, short.end.kind, len(short)) == ("stopped", "stopped", 7)
    path = tmp_path / "family.jsonl"
    longer = follow(CUBIC, "beta", (0.2, 0.4), resume=short, output=path)
    assert [longer[i].value for i in (0, -1)] == [0.2, 0.4]
    assert (longer.beginning.kind, longer.end.kind) == ("reached", "reached")
    assert (np.diff(longer.column("beta")) > 0).all()
    assert longer.settings["start"] == 0.3
    assert Family.load(path, CUBIC) == longer
    assert follow(CUBIC, "beta", (0.2, 0.4), resume=longer).points == longer.points
    wider = follow(CUBIC, "beta", (0.1, 0.4), resume=replace(short, end=longer.end))
    assert wider.points[-1] == short.points[-1]
    assert wider[0].value == 0.1


def test_a_family_interrupted_on_its_way_ahead_goes_back_once_it_is_resumed():
    late = [True]

    def watched(orbit) -> float:
        if late[0] and orbit.machine["parameters"]["beta"] > 0.5:
            raise TimeOver("it takes long")
        return 1.0

    part = follow(CUBIC, "beta", (0.1, 1.0), watch={"watched": watched})
    assert (part[0].value, part.end.kind, part.beginning.kind) == (0.3, "interrupted", "interrupted")
    late[0] = False
    whole = follow(CUBIC, "beta", (0.1, 1.0), watch={"watched": watched}, resume=part)
    assert [whole[i].value for i in (0, -1)] == [0.1, 1.0]
    assert (np.diff(whole.column("beta")) > 0).all()


def test_a_start_outside_is_refused():
    for bounds in ((0.5, 4.0), (-1.0, 0.2)):
        with pytest.raises(InputError, match=r"beta starts at 0\.3, which is not between them: give bounds around it"):
            follow(CUBIC, "beta", bounds)
    with pytest.raises(InputError, match="choose another stop"):
        follow(CUBIC, "beta", (0.3, 0.3))
    with pytest.raises(InputError, match="is not a finite number"):
        follow(CUBIC, "beta", (0.1, None))


def test_an_event_is_followed_both_ways():
    machine = Hopper("r + beta*r**3", rest_length=9.0, parameters={"beta": 0.2})
    family = follow(machine, "beta", -0.006)
    touch = follow_event(family, "masses touch", "rest_length", (8.8, 9.2), longest=0.2)
    lengths = touch.column("rest_length")
    assert lengths[[0, -1]].tolist() == [8.8, 9.2]
    assert (np.diff(lengths) > 0).all()
    assert touch.column("smallest_separation") == pytest.approx(0.0, abs=1e-12)
    for last, place in ((8.8, 0), (9.2, -1)):
        alone = follow_event(family, "masses touch", "rest_length", last, longest=0.2)
        assert touch.column("beta")[place] == pytest.approx(alone.column("beta")[-1], rel=1e-11)
