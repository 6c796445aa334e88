"""What a worker computes: families in pieces, hops beyond folds, and the map with its basin."""

from dataclasses import replace

import pytest

from orbits import InputError, find, follow
from problems import Hopper, runner

pytest.importorskip("bokeh")

from problems.explorer import beginning
from problems.explorer.results import family_results, hop_results, map_results

pytestmark = pytest.mark.extra("bokeh")
CUBIC = beginning("hopper")


@pytest.mark.slow
def test_a_family_comes_in_pieces_and_is_that_of_follow():
    scene = replace(CUBIC, along="beta")
    pieces = list(family_results(None, scene, -0.5, 2.0))
    assert len(pieces) > 3
    assert "still growing" in pieces[0].text
    assert list(pieces[0].data.events["kind"]) == []
    assert "Upward: to the end of the slider, beta = 2." in pieces[-1].text
    assert "Downward: the launch speed grows without bound" in pieces[-1].text
    assert list(pieces[-1].data.events["kind"])[-2:] == ["end: reached", "end: escaped"]
    assert list(pieces[-1].data.events["value"])[-2:] == [2.0, pieces[-1].values[0]]
    assert sum(kind.startswith("end: ") for kind in pieces[-1].data.events["kind"]) == 2
    values = pieces[-1].values
    assert values[-1] == 2.0
    down = follow(Hopper("cubic", rest_length=8.0), "beta", 2.0)
    for point in (down[0], down[-1]):
        place = pieces[-1].nearest(point.value, point.alpha)
        extension, alpha, duration = pieces[-1].starts[place]
        assert (values[place], alpha) == pytest.approx((point.value, point.alpha), rel=1e-9)
        assert (extension, duration) == pytest.approx((point.liftoff_extension, point.flight_time / 2), rel=1e-9)


def test_a_family_from_the_upper_end_of_its_slider_goes_down():
    *_, family = family_results(None, beginning("hopper", True), 1.9e6, 2e6)
    assert "Downward: to the end of the slider, b = 1.9e+06 N/m^3." in family.text
    assert "Upward" not in family.text


@pytest.mark.slow
def test_a_point_beyond_a_fold_is_come_back_to():
    """Two hops have the same beta < 0: the start tells which is meant, and another slider keeps to its branch."""
    softening = replace(
        beginning("hopper"), numbers={"mass_ratio": 1.0, "rest_length": 30.0, "beta": 0.0}, along="beta"
    )
    *_, family = family_results(None, softening, -0.02, 0.02)
    place = family.nearest(-0.005, 15.0)
    high = family.starts[place][1]
    scene = replace(softening.with_numbers(beta=family.values[place]), start=family.starts[place])
    (result,) = hop_results(None, scene, False)
    assert result.alpha == pytest.approx(high, rel=1e-9)
    (moved,) = hop_results(None, result.scene.with_numbers(rest_length=29.0), False)
    assert moved.alpha == pytest.approx(high, rel=1e-6)  # constant gravity knows no rest length
    (other,) = hop_results(None, replace(scene, start=None), False)
    assert other.alpha < 0.9 * high


def test_a_run_is_that_of_find_and_is_found_again_from_its_start():
    scene = beginning("runner")
    (result,) = hop_results(None, scene, False)
    run = find(runner(), tune=("inertia", "hip_stiffness"), at={"speed": 0.4})
    assert result.alpha == pytest.approx(run.alpha, rel=1e-12)
    assert result.scene.numbers["inertia"] == pytest.approx(run.source.values["inertia"], rel=1e-11)
    assert "path of the hip" in result.data.plane.outlines["name"]
    assert result.data.plane.advance == pytest.approx(run.step, rel=1e-12)
    (again,) = hop_results(None, result.scene, False)
    assert again.scene.start == pytest.approx(result.scene.start, rel=1e-11)
    (moved,) = hop_results(None, result.scene.with_numbers(speed=0.5), False)  # from the start of another speed
    assert dict(moved.rows)["speed in flight"] == "0.5"


def test_where_no_map_can_be_drawn_the_reason_is_stated():
    for scene, words in (
        (replace(beginning("wheel"), numbers={"inertia_ratio": 1.0, "gravity_ratio": 0.5}), "loses nothing"),
        (replace(beginning("wheel"), family=3), "rounding hides such a difference"),
    ):
        with pytest.raises(InputError, match=words):
            next(map_results(None, scene))


def test_the_map_is_drawn_first_and_then_its_basin():
    first, second = map_results(None, replace(beginning("juggler"), launch=4.6))
    assert first.basin is None
    assert first.web.shape[0] == 2
    assert first.web.shape[1] > 4
    assert 0 < second.share < 1
    again = list(map_results(None, replace(beginning("juggler"), launch=4.7)))
    assert len(again) == 1  # another cobweb needs no other basin
    assert (again[0].basin == second.basin).all()
