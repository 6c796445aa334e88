"""Several families in one result, against the families alone and closed forms."""

import numpy as np
import pytest
from legibility import faults

from orbits import Families, InputError, NoOrbit, find, follow
from problems import Hopper, hopper_in_si

CUBIC = Hopper("cubic", rest_length=30.0, parameters={"beta": 0.1})
ROOTS = {1: 4.493409457909064, 3: 10.904121659428899}  # of alpha = tan(alpha)


@pytest.fixture(scope="module")
def families():
    return follow(CUBIC, "beta", (0.0, 0.2), families=(1, 3), longest=0.2)


def test_each_is_the_family_alone(families):
    assert [*families] == [1, 3]
    for number in families:
        alone = follow(CUBIC, "beta", (0.0, 0.2), family=number, longest=0.2)
        assert families[number] == alone
        assert families[number][0].alpha == pytest.approx(ROOTS[number], rel=1e-13)  # where the spring is linear
    with pytest.raises(InputError, match="no family 2 among these, 1, 3"):
        families[2]


def test_its_table_has_the_points_of_all(families):
    frame = families.table()
    assert len(frame["alpha"]) == sum(len(families[number]) for number in families)
    assert sorted({*frame["family"].tolist()}) == [1, 3]
    assert frame["beta"][frame["family"] == 3].tolist() == families[3].column("beta").tolist()
    assert "stroke" in families.table(CUBIC)
    text = str(families)
    assert text.startswith("families 1, 3 of hopper")
    assert families.summary()["end of family 3"] == "reached, reached"
    assert max(map(len, text.splitlines())) <= 80


def test_it_is_saved_and_loaded(families, tmp_path):
    assert Families.load(families.save(tmp_path / "families.json")) == families
    rows = np.genfromtxt(families.save(tmp_path / "families.csv"), delimiter=",", names=True, usecols=range(3))
    assert len(rows) == len(families.table()["alpha"])
    assert families.document()["numbers"] == [1, 3]


def test_one_figure_names_them_all(families):
    axes = families.plot("frequency")
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert names == ["family 1", "family 3", "motions", "end of the range"]
    assert not faults(axes.figure)
    curves = {line.get_label(): line for line in axes.lines if len(line.get_xdata()) > 2}
    for number in families:
        assert curves[f"family {number}"].get_ydata() == pytest.approx(families[number].column("frequency"))
    colours = {curves[name].get_color() for name in ("family 1", "family 3")}
    assert len(colours) == 2


def test_a_family_that_is_not_there_says_why():
    """A saturating spring has no family n beyond b = 1/(2 n + 1)."""
    saturating = Hopper("tanh", rest_length=20.0, parameters={"b": 0.18})
    found = follow(saturating, "b", 0.19, families=(1, 2, 3), longest=0.5)
    assert ([*found], [*found.missing]) == ([1, 2], [3])
    assert "has no lossless orbit of family 3" in str(found)
    with pytest.raises(InputError, match=r"no family 3 among these, 1, 2: .*no lossless orbit of family 3"):
        found[3]
    with pytest.raises(NoOrbit, match=r"family 3: .*orbit of family 3.* 4 under constant gravity"):
        follow(saturating, "b", 0.19, families=(3, 4))


def test_what_families_cannot_be_asked_for():
    leg = hopper_in_si(60.0, 3.0, stiffness=8000.0)
    for wrong, words in (
        (3, "families = 3; they must be different"),
        ((1, 1), "different"),
        ((), "different"),
        ((0,), "whole"),
    ):
        with pytest.raises(InputError, match=words):
            follow(leg, "foot_mass", 4.0, families=wrong)
    for other in (
        {"family": 2},
        {"start": find(leg)},
        {"output": "x.jsonl"},
        {"resume": follow(leg, "foot_mass", 3.1)},
    ):
        with pytest.raises(InputError, match="leave out family, start, output and resume"):
            follow(leg, "foot_mass", 4.0, families=(1, 2), **other)
