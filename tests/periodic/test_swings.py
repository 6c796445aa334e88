"""Swings from hold to hold against closed forms, and what they refuse."""

import numpy as np
import pytest

from orbits import InputError, Mechanism, NoOrbit, Swing, SwingFamily, find, find_all, follow, simulate, sweep
from orbits.mechanics import Grip, Mass, Spring
from problems import brachiator

TURNED = {"x": "-x", "y": "-y"}


def carts(**changes):
    """Two carts between walls on linear springs, held at -a and a - 2, which let go at once."""
    stated = {
        "places": {"x": "-a", "y": "a - 2"}, "release": {"a": (0.0, 3.0)}, "step": "2*a",
        "clearance": "4 - (x + y)**2", "longest": 4.0,
    }  # fmt: skip
    springs = [Spring("x", "k*r"), Spring("x - y", "r"), Spring("y", "k*r")]
    return Mechanism(
        ("x", "y"), springs, gap=None, inertia={"x": 1.0, "y": 1.0}, parameters={"k": 0.5}, reversor=TURNED,
        grip=Grip(**{**stated, **changes}),
    )  # fmt: skip


def test_carts_swing_in_one_normal_mode():
    """Both come to the middle at once only in the mode in which they move together, of the frequency sqrt(k)."""
    (swing,) = find_all(carts())
    assert swing.a == pytest.approx(1.0, rel=1e-14)
    assert swing.half_swing == pytest.approx(np.pi / 2 / np.sqrt(0.5), rel=1e-14)
    assert swing.rates == pytest.approx([np.sqrt(0.5)] * 2, rel=1e-13)
    assert swing.mean_speed == pytest.approx(np.sqrt(0.5) * 2 / np.pi, rel=1e-13)
    assert swing.smallest_grip_force is None
    assert swing.energy_drift < 1e-14
    family = follow(carts(), "k", (0.5, 2.0), at=[1.0])
    assert family.end.kind == "reached"
    assert np.abs(family.column("half_swing") * np.sqrt(family.column("k")) - np.pi / 2).max() < 1e-13
    assert (family.column("error") < 1e-13).all()
    (event,) = family.events
    assert (event.kind, event.point["k"]) == ("value", 1.0)


def test_a_cart_alone_has_only_its_time():
    grip = Grip({"x": "-1"}, {}, "2", "1 - x*x", 4.0)
    machine = Mechanism(
        ("x",),
        [Spring("x", "k*r")],
        gap=None,
        inertia={"x": 1.0},
        parameters={"k": 4.0},
        reversor={"x": "-x"},
        grip=grip,
    )
    assert find(machine).half_swing == pytest.approx(np.pi / 4, rel=1e-14)


def test_a_swing_that_passes_what_it_takes_hold_of():
    """Where the distance is stated as one that falls first, it is least in mid-swing."""
    swing = find(carts(clearance="(x + y)**2 - 4"))
    assert swing.clearance == pytest.approx(-4.0, rel=1e-13)
    assert not swing.admissible
    assert "(inadmissible)" in str(swing)


@pytest.fixture(scope="module")
def family():
    return follow(brachiator(), "arm_mass", (0.25, 0.15))


def test_two_families_meet_at_a_fold(family):
    """The branch comes back to 0.25 at the slower swing that a search finds, and searches beside the fold agree."""
    assert [event.kind for event in family.events] == ["fold"]
    fold = family.events[0].point
    for sign, count in ((1, 2), (-1, 0)):
        beside = find_all(brachiator(arm_mass=fold["arm_mass"] + sign * 1e-3))
        assert sum(abs(swing.angle - fold["angle"]) < 0.2 for swing in beside) == count
    slower = find_all(brachiator())[1]
    back = family.start(len(family) - 1)
    assert family.column("arm_mass")[-1] == 0.25
    assert back == pytest.approx(slower.start, rel=1e-10)


def test_a_swing_is_saved_and_read(tmp_path, family):
    swing = find(brachiator(), start={"angle": 1.2, "half_swing": 1.9})
    again = Swing.load(swing.save(tmp_path / "swing.json"), brachiator())
    assert again.document() == swing.document()
    assert (again(np.linspace(0, 9, 7)) == swing(np.linspace(0, 9, 7))).all()
    assert find(brachiator(arm_mass=0.26), start=again).angle == pytest.approx(1.24, abs=0.02)
    whole = SwingFamily.load(family.save(tmp_path / "family.json"))
    assert (whole.column("angle") == family.column("angle")).all()
    assert str(whole) == str(family)
    assert {"angle", "half_swing", "rates", "step", "mean_speed", "violations"} <= swing.document().keys()


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"places": {"x": "-1", "y": "-1"}, "release": {}, "step": "2"}, "release has no numbers"),
        ({"release": {"a": (0.0, 1.0), "b": (0.0, 1.0)}}, "release has a, b; 2 coordinates"),
        ({"clearance": "1 - x*x", "places": {"x": "-a"}}, "coordinate 'y' needs a place"),
        ({"places": {"x": "-a", "z": "a"}}, "no coordinate 'z'"),
        ({"step": "2*c"}, "'2\\*c' has 'c'"),
        ({"clearance": "a - x"}, "'a - x' has 'a'"),
        ({"longest": "x"}, "'x' has 'x'"),
    ],
)
def test_refused_grips(changes, why):
    with pytest.raises(InputError, match=why):
        carts(**changes)


def test_a_grip_needs_a_machine_without_a_gap():
    with pytest.raises(InputError, match="gap=None, and a reversor"):
        Mechanism(
            ("x", "y"), [Mass("x", 1.0), Mass("y", 1.0), Spring("x - y", "r")], gap="y",
            grip=Grip({"x": "-a", "y": "0"}, {"a": (0.0, 1.0)}, "a", "1 - x*x", 4.0),
        )  # fmt: skip
    with pytest.raises(InputError, match="must be a Grip"):
        Mechanism(("x",), [Spring("x", "r")], gap=None, inertia={"x": 1.0}, grip="x")


@pytest.mark.parametrize(
    ("clearance", "telling"),
    [("1", "has none of the coordinates x, y"), ("1 - x*x", "does not vanish"), ("x + y + 2", "at its mirror image")],
)
def test_a_clearance_vanishes_where_both_grips_hold(clearance, telling):
    with pytest.raises(InputError, match=telling):
        carts(clearance=clearance)


def test_what_swings_do_not_take():
    machine = brachiator()
    for options in ({"family": 2}, {"method": "shooting"}, {"tune": "arm_mass", "at": {"mean_speed": 0.4}}):
        with pytest.raises(InputError, match="need no tuned number"):
            find(machine, **options)
    with pytest.raises(InputError, match="need no tuned number"):
        find_all(machine, 3)
    with pytest.raises(InputError, match="start has angle; a swing has the unknowns"):
        find(machine, start={"angle": 1.0})
    with pytest.raises(InputError, match="start has alpha; a swing has"):
        find(machine, start={"alpha": 1.0})
    with pytest.raises(NoOrbit, match="leads to no swing"):
        find(machine, start={"angle": 0.9, "half_swing": 0.01})
    with pytest.raises(InputError, match="without watch="):
        follow(machine, "arm_mass", 0.3, watch={"a": lambda orbit: 0.0})
    for option in ({"family": 7}, {"multipliers": True}):
        with pytest.raises(InputError, match=f"without {next(iter(option))}="):
            follow(machine, "arm_mass", 0.3, **option)
    with pytest.raises(InputError, match="choose another stop"):
        follow(machine, "arm_mass", 0.25)
    with pytest.raises(InputError, match="no parameter 'arm'"):
        follow(machine, "arm", 0.25)
    for refused in (lambda: simulate(machine, 1.0), lambda: sweep(machine, {"arm_mass": (0.2, 0.3)})):
        with pytest.raises(InputError, match="swings from hold to hold"):
            refused()


def test_other_numbers_have_no_swing():
    with pytest.raises(NoOrbit, match="has no swing with a from 2 to 3"):
        find(carts(release={"a": (2.0, 3.0)}))
