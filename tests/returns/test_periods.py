"""The periods that attract, against the known flips, folds and crisis of the linear hopper, and the map itself."""

import numpy as np
import pytest

from orbits import InputError, PeriodDiagram, period_diagram
from problems import Chain, Hopper

LAUNCHES = (4.2, 5.4)


@pytest.fixture(scope="module")
def diagram():
    """At M = 1: fixed points up to 0.0716, period two up to 0.1134, chaos with windows up to 0.1388."""
    over = {"inject": (0.05, 0.15), "mass_ratio": (1.0, 1.5)}
    return period_diagram(Hopper(), over, LAUNCHES, samples=(5, 2), starts=(4.52,), hops=512)


def test_periods_at_equal_masses(diagram):
    assert diagram.values.tolist() == pytest.approx([0.05, 0.075, 0.1, 0.125, 0.15])
    assert diagram.period()[0].tolist() == [1, 2, 2, 0, -1]
    assert diagram.status[0, :, 0].tolist()[:4] == ["periodic", "periodic", "periodic", "chaotic"]
    assert diagram.exponents[0, 3, 0] > 0.05
    assert not diagram.several.any()


def test_two_periods_attract_side_by_side():
    """Between the fold of period four at 0.11155 and the flip of period two at 0.11343."""
    over = {"mass_ratio": (0.999, 1.001), "inject": (0.1, 0.1119)}
    found = period_diagram(Hopper(), over, (4.4, 4.7), samples=(2, 2), starts=(4.52, 4.4926), hops=4096)
    assert sorted(found.periods[1, 1].tolist()) == [2, 4]
    assert found.several.tolist() == [[False, False], [True, True]]
    assert "different periods" in str(found)


def test_table_and_file(diagram, tmp_path):
    table = diagram.table()
    assert [*table][:3] == ["inject", "mass_ratio", "start"]
    assert {len(column) for column in table.values()} == {10}
    assert table["period"][:3].tolist() == [1, 2, 2]
    again = PeriodDiagram.load(diagram.save(tmp_path / "periods.json"))
    assert str(again) == str(diagram)
    assert (again.status == diagram.status).all()
    assert np.array_equal(again.launches, diagram.launches, equal_nan=True)
    assert (tmp_path / "periods.json").stat().st_size < 20_000


@pytest.mark.parametrize(
    ("over", "options", "message"),
    [
        ({"inject": (0.0, 0.1)}, {}, "two parameters"),
        ({"inject": (0.0, 0.1), "colour": (0.0, 1.0)}, {}, "no parameter 'colour'"),
        (
            {"inject": (0.0, 0.1), "mass_ratio": (1.0, 1.1)},
            {"inject": 0.1},
            "already states inject: leave it out",
        ),
        ({"inject": (0.1, 0.0), "mass_ratio": (1.0, 1.1)}, {}, "low must be below high"),
        ({"inject": (0.0, 0.1), "mass_ratio": 1.0}, {}, "a pair"),
        ({"inject": (0.0, 0.1), "mass_ratio": (1.0, 1.1)}, {"starts": (-1.0,)}, "above 0"),
        ({"inject": (0.0, 0.1), "mass_ratio": (1.0, 1.1)}, {"starts": 4.5}, "a list of launch speeds"),
        ({"inject": (0.0, 0.1), "mass_ratio": (1.0, 1.1)}, {"hops": 20}, "it must be at least 64"),
    ],
)
def test_what_is_refused(over, options, message):
    with pytest.raises(InputError, match=message):
        period_diagram(Hopper(), over, LAUNCHES, **options)


def test_launches_of_several_numbers_are_refused():
    with pytest.raises(InputError, match="has several numbers"):
        period_diagram(Chain((1.0, 1.0, 1.0), ("r", "r")), {"inject": (0.0, 0.1), "mass": (1.0, 1.1)}, LAUNCHES)
