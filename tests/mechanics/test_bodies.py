"""Bodies and joints as machines state them; what simulators make of them is in `tests/show/test_simulators.py`."""

from dataclasses import replace

import pytest

from orbits import InputError, Mechanism
from orbits.mechanics import Body, Inerter, Joint, Mass, Outline, Spring, bodies_of
from problems import Chain, rimless_wheel

TWO = Mechanism(
    ("body", "foot"), [Mass("body + length", "m"), Mass("foot", 1.0), Spring("body - foot")], gap="foot",
    parameters={"m": 2.0, "length": 0.7}, heights={"hip joint": "body + length", "toe": "foot"},
)  # fmt: skip
UP = Joint("up", "up", "body")


def test_a_column_of_masses():
    body, foot = bodies_of(TWO, TWO.values)
    assert (body.name, body.joints, body.mass, body.place) == (
        "hip_joint",
        [Joint("hip_joint_up", "up", "body")],
        "m",
        (0.0, 0.7),
    )
    assert (foot.name, foot.place) == ("toe", (0.0, 0.0))
    chain = Chain((1, 2, 3)).mechanism
    assert [each.name for each in bodies_of(chain, chain.values)] == ["mass_1", "mass_2", "mass_3"]
    stated = replace(TWO, bodies=[Body("one", [UP], "m")])
    assert bodies_of(stated, stated.values) == (Body("one", [UP], "m"),)


@pytest.mark.parametrize(
    "elements",
    [
        [Mass("2*body", 1.0), Mass("foot", 1.0)],
        [Mass("body + foot", 1.0), Mass("foot", 1.0)],
        [Mass("body", 1.0), Mass("foot", 1.0), Inerter("body - foot", 1.0)],
        [Mass("body", 1.0), Mass("body + 1", 1.0), Mass("foot", 1.0)],
    ],
)
def test_what_is_no_column(elements):
    machine = Mechanism(("body", "foot"), [*elements, Spring("body - foot")], gap="foot")
    with pytest.raises(InputError, match="mechanism is not a column of masses"):
        bodies_of(machine, machine.values)
    plain = Mechanism(("body", "foot"), [Spring("body - foot")], gap="foot", inertia={"body": 1.0, "foot": 1.0})
    with pytest.raises(
        InputError, match=r"mechanism states an inertia, .* give its bodies and their joints, bodies=\[Body"
    ):
        bodies_of(plain, plain.values)


def test_small_angles_have_no_bodies():
    assert rimless_wheel(inertia_ratio=1.0, gravity_ratio=0.5).bodies == ()


@pytest.mark.parametrize(
    ("bodies", "message"),
    [
        (["hip"], "list of Body with lists of Joint"),
        ([Body("hip", UP, "m")], "joints = .* it must be a list"),
        ([Body("hip", [Joint(None, "up", "body")], -1.0), Body(3, [UP], 1.0)], "3 cannot name"),
        ([Body("hip", [UP], "m", carrier="trunk")], "its carrier 'trunk' is not in the list before it"),
        ([Body("hip", [Joint("up", "sideways", "body")], "m")], "no axis 'sideways'; known: across"),
        ([Body("hip", [UP], "bdy")], "'bdy' has 'bdy'; did you mean 'body'"),
        ([Body("hip", [UP], 1.0), Body("toe", [UP], 1.0)], "'up' cannot name.* one of the joints"),
        ([Body("the hip", [UP], 1.0)], "'the hip' cannot name"),
        ([Body("world", [UP], 1.0)], "'world' cannot name"),
        ([Body(None, [UP], 1.0)], "bodies: None cannot name"),
        ([Body("hip", [Joint("up", [0, 0, 1], "body")], 1.0)], r"no axis \[0, 0, 1\]"),
        ([Body("hip", [UP], 1.0, centre=0.5)], "the centre 0.5 is not a pair"),
        ([Body("hip", [UP], 1.0, centre=(0, 0, 1))], r"the centre \(0, 0, 1\) is not a pair"),
        ([Body("hip", [UP], 1.0, place="up")], "the place 'up' is not a pair"),
        ([Body("hip", [UP], None)], "None in body 'hip' must be a formula"),
        ([Body("hip", [Joint("up", "up", None)], 1.0)], "None in body 'hip' must be a formula"),
        ([Body("hip", [UP], 1.0, outlines=["x"])], "'x' is not an Outline"),
        ([Body("hip", [UP], 1.0, outlines=[Outline("leg", ["ab", 3])])], "the point of 'leg' 'ab' is not a pair"),
        ([Body("hip", [UP], 1.0, outlines=[Outline("leg", [(0, 1)], repeat="n")])], "'n' has 'n'"),
    ],
)
def test_what_is_misbuilt(bodies, message):
    with pytest.raises(InputError, match=message):
        replace(TWO, bodies=bodies)
