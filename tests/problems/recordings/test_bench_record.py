"""The record of a test stand from a file, a data frame or two sequences."""

import numpy as np
import pytest

from orbits import InputError
from problems import springs
from problems.recordings import read_record

R = np.linspace(-6.0, 5.0, 60)
FORCE = R + 0.05 * R**3


@pytest.mark.extra("pandas")
class TestDataFrame:
    """It is read as the file that it would be written to."""

    @pytest.fixture
    def frame(self):
        pandas = pytest.importorskip("pandas")
        return pandas.DataFrame({"time [s]": range(60), "deflection [mm]": R, "force [N]": FORCE})

    def test_is_a_table(self, frame, tmp_path):
        frame.to_csv(tmp_path / "rows.csv", index=False)
        read, framed = (springs.table(source, in_si=True) for source in (tmp_path / "rows.csv", frame))
        assert framed(0.001 * R[1:-1]).tolist() == read(0.001 * R[1:-1]).tolist()
        assert framed(0.003) == pytest.approx(3 + 0.05 * 27, abs=1e-3)
        assert "DataFrame" in framed.text

    def test_may_have_the_extension_as_its_index(self, frame):
        record = read_record(frame.set_index("deflection [mm]"), in_si=True)
        assert record.extensions.tolist() == (0.001 * R).tolist()
        assert (record.forces.tolist(), record.sense) == (FORCE.tolist(), 1.0)

    @pytest.mark.parametrize(
        ("columns", "message"),
        [
            ({"force [N]": "volt"}, "the table of a DataFrame has no column force"),
            ({"force [N]": "force [furlong]"}, "unknown unit 'furlong'"),
        ],
    )
    def test_with_other_names_is_refused(self, frame, columns, message):
        with pytest.raises(InputError, match=message):
            springs.table(frame.rename(columns=columns), in_si=True)

    def test_with_a_hole_is_refused(self, frame):
        frame.loc[7, "force [N]"] = np.nan
        with pytest.raises(InputError, match=r"row 9: .* does not hold two finite numbers"):
            springs.table(frame, in_si=True)


def test_two_sequences_are_two_columns():
    record = read_record((R, FORCE), in_si=False)
    assert (record.extensions.tolist(), record.forces.tolist()) == (R.tolist(), FORCE.tolist())
    assert (record.sense, record.name, record.columns, record.units) == (1.0, "table", "", ("", ""))
    with pytest.raises(InputError, match="two sequences of numbers"):
        read_record(5, in_si=False)


def test_two_sequences_in_stated_units():
    record = read_record((1e3 * R, 1e-3 * FORCE), True, units=("mm", "kN"))
    assert (record.extensions, record.forces) == (pytest.approx(R), pytest.approx(FORCE))
    assert (record.columns, record.units) == ("extension in mm and force in kN", ("m", "N"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"units": ("mm", "N")}, "state in_si=True too"),
        ({"in_si": True, "units": "mm"}, "it is two, that of extension and that of force"),
        ({"in_si": True, "units": ("mm", "N m")}, "mm and N m belong to two kinds of springs"),
        ({"columns": ("a", "b")}, "two sequences have no names"),
        ({"columns": (0, True)}, "it is two"),
    ],
)
def test_options_that_cannot_be(options, message):
    with pytest.raises(InputError, match=message):
        read_record((R, FORCE), **{"in_si": False, **options})
