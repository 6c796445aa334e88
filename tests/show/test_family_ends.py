"""The ends of families in figures."""

import pytest

from orbits import follow
from orbits.show.family_ends import ends_of
from problems import Hopper

CUBIC = Hopper("cubic", rest_length=30.0, parameters={"beta": 0.3})


def entries(axes) -> dict[str, tuple[list[float], list[float]]]:
    """The entries of the legend with the places of their curves or marks."""
    return {
        name: tuple(map(list, line.get_data())) for line, name in zip(*axes.get_legend_handles_labels(), strict=True)
    }


def test_both_ends_are_marked_and_named():
    family = follow(CUBIC, "beta", (-0.02, 1.0))
    shown = entries(family.plot())
    assert set(shown) == {"motions", "no motions", "fold", "collapse", "goes on without bound", "end of the range"}
    for name, point in (("goes on without bound", family[0]), ("end of the range", family[-1])):
        assert shown[name] == ([point.value], [point.alpha])
    assert {place: end.kind for place, end in ends_of(family).items()} == {
        0: "escaped",
        len(family.in_order()) - 1: "reached",
    }


def test_a_family_that_begins_at_its_start_has_one_end():
    family = follow(CUBIC, "beta", 0.35, longest=0.5)
    assert [*ends_of(family)] == [len(family) - 1]
    assert entries(family.plot())["end of the range"] == ([0.35], [pytest.approx(family[-1].alpha)])
    assert "no motions" not in entries(family.plot())


def test_what_ends_without_a_name_of_its_own_is_marked_too():
    family = follow(CUBIC, "beta", 1.0, most=3)
    assert "stopped" in entries(family.plot())
