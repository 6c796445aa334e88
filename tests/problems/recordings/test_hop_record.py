"""Records of hops: their columns, units, missing samples and motions."""

import numpy as np
import pytest

from orbits import InputError
from orbits.units import STANDARD_GRAVITY
from problems import hopper_in_si
from problems.recordings.channels import channels_of
from problems.recordings.hop_record import read_hops

CHANNELS = channels_of(hopper_in_si(12.0, 2.0, stiffness=1e4, rest_length=0.5))


@pytest.mark.parametrize(
    ("header", "channel", "scale"),
    [
        ("Body height [mm]", "body height", 1e-3),
        ("foot_z_m", "foot height", 1.0),
        ("v_body (m/s)", "body speed", 1.0),
        ("hip acceleration [g]", "body acceleration", STANDARD_GRAVITY),
        ("foot [mm/s]", "foot speed", 1e-3),
        ("toe acc [m/s²]", "foot acceleration", 1.0),
        ("GRF [kN]", "ground force", 1e3),
        ("Fz_N", "ground force", 1.0),
        ("leg length (cm)", "spring length", 1e-2),
        ("spring compression [mm]", "spring length", -1e-3),
        ("COM height [m]", "centre of mass height", 1.0),
    ],
)
def test_a_column_is_known_by_its_words_and_its_unit(header, channel, scale, tmp_path):
    (tmp_path / "hop.csv").write_text(f"t [ms],{header},temperature [C]\n0,1,20\n10,2,20\n20,-3,20\n")
    (record,) = read_hops(tmp_path / "hop.csv", CHANNELS, True)
    assert record.times.tolist() == pytest.approx([0.0, 0.01, 0.02])
    assert record.values[channel].tolist() == pytest.approx([scale, 2 * scale, -3 * scale])
    assert record.unused == ("temperature [C]",)


def test_units_may_stand_below_names_and_numbers_have_decimal_commas(tmp_path):
    text = "# a stand\nZeit;body height;foot height\ns;mm;mm\n0,5;1,5;\n1,0;;2,5\n1,5;nan;3,5\n"
    (tmp_path / "hop.csv").write_text(text)
    (record,) = read_hops(tmp_path / "hop.csv", CHANNELS, True)
    assert record.times.tolist() == [0.5, 1.0, 1.5]
    np.testing.assert_allclose(record.values["body height"], [1.5e-3, np.nan, np.nan])
    np.testing.assert_allclose(record.values["foot height"], [np.nan, 2.5e-3, 3.5e-3])


def test_a_time_that_goes_back_begins_another_motion():
    source = {"time [s]": [0, 1, 2, 0, 1], "foot height [m]": [1, 2, 3, 4, 5]}
    first, second = read_hops(source, CHANNELS, True)
    assert first.values["foot height"].tolist() == [1, 2, 3]
    assert (second.times.tolist(), second.name) == ([0, 1], "record, motion 2")


def test_columns_and_units_may_be_stated():
    source = {"T": [0, 1], "A": [2, 3], "B": [4, 5]}
    (record,) = read_hops(
        source, CHANNELS, True, {"time": "T", "foot height": "B"}, {"time": "ms", "foot height": "mm"}
    )
    assert record.times.tolist() == [0, 1e-3]
    assert {name: values.tolist() for name, values in record.values.items()} == {"foot height": [4e-3, 5e-3]}


@pytest.mark.extra("pandas")
def test_a_data_frame_and_a_list_of_records():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"t [s]": [0.0, 1.0], "foot height [m]": [1.0, np.nan]})
    assert [record.name for record in read_hops([frame, frame], CHANNELS, True)] == ["DataFrame", "DataFrame"]


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ({"foot height [m]": [1, 2]}, "no column of times"),
        ({"time [s]": [1, 2], "volt": [1, 2]}, "no channel of this machine, which are body height"),
        ({"time [s]": [1, 2], "foot height": [1, 2]}, "'foot height' has no unit"),
        ({"time [s]": [1, 2], "foot height [N]": [1, 2]}, "no channel of this machine"),
        ({"time [s]": [1, 1], "foot height [m]": [1, 2]}, "two rows have the time 1"),
        ({"time [s]": [1, np.nan], "foot height [m]": [1, 2]}, "the time of row 2 is missing"),
        ({"time [s]": [1, 2], "foot height [m]": [1, 2], "toe z [mm]": [1, 2]}, "two columns may be the foot height"),
        ({"time [s]": [1, 2], "foot height [m]": ["a", 2]}, "columns of numbers"),
        ([], "no record"),
        (5, "source = 5"),
    ],
)
def test_refuses_what_lacks_something(source, message):
    with pytest.raises(InputError, match=message):
        read_hops(source, CHANNELS, True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2\n3,4\n", "no header with a time and a channel"),
        ("time [s],foot height [m]\n", "a header and no rows"),
        ("time [s],foot height [m]\n1,x\n", "row 2: '1,x' does not hold finite numbers"),
    ],
)
def test_refuses_a_file(text, message, tmp_path):
    (tmp_path / "hop.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_hops(tmp_path / "hop.csv", CHANNELS, True)


def test_a_machine_without_units_takes_none():
    with pytest.raises(InputError, match="has a unit, but this machine has none"):
        read_hops({"time": [0, 1], "foot height [m]": [1, 2]}, CHANNELS, False)


def test_refuses_a_stated_column_that_is_missing():
    with pytest.raises(InputError, match="no column 'Z9'"):
        read_hops({"time [s]": [0, 1], "foot height [m]": [1, 2]}, CHANNELS, True, {"foot height": "Z9"})


def test_columns_of_text_are_not_used():
    source = {"time [s]": [0, 1], "foot height [m]": [1, 2], "remark": ["a", "b"]}
    (record,) = read_hops(source, CHANNELS, True)
    assert record.unused == ("remark",)
