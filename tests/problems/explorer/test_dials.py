"""Sliders: their ends, scales and units."""

import pytest

from problems.explorer.dials import dials_of
from problems.explorer.fields import shown_fields
from tests.problems.explorer.scenes import IN_SI, SCENES, given


@given
def test_sliders_end_where_there_is_no_such_machine(scene):
    machine = scene.build()
    dials = dials_of(machine, scene)
    assert {dial.name for dial in dials} - {"restitution"} <= {*scene.numbers}
    for dial in dials if scene.steps else dials[:-1]:
        assert dial.low <= dial.value <= dial.high
        assert not dial.factors or dial.low > 0
        for end in (dial.low, dial.high):
            if scene.steps:
                scene.with_numbers(**{dial.name: end}).build()
            else:
                machine.with_values(**{dial.name: end})
    shown = {dial["name"]: dial for dial in shown_fields(scene.with_numbers(mass_ratio=1e6), dials, False)["dials"]}
    assert "mass_ratio" not in shown or shown["mass_ratio"]["high"] == 1e6


def test_machines_that_step_have_spokes_in_whole_numbers_and_no_restitution():
    dials = {dial.name: dial for dial in dials_of(SCENES["wheel"].build(), SCENES["wheel"])}
    assert {name for name, dial in dials.items() if dial.whole} == {"spokes"}
    assert (dials["spokes"].low, dials["length"].unit) == (3, "m")
    assert dials["inertia"].low == pytest.approx(2.0 * 0.4**2, rel=1e-3)  # that of its mass about the foot
    assert dials["length"].high == pytest.approx(0.5, rel=2e-3)
    assert "restitution" not in dials


def test_scales_go_by_factors_and_have_their_units():
    dials = {dial.name: dial for dial in dials_of(IN_SI.build(), IN_SI)}
    assert [name for name, dial in dials.items() if not dial.factors] == ["restitution"]
    assert (dials["k"].low, dials["k"].high, dials["k"].unit) == (800.0, 80000.0, "N/m")
    cubic = {dial.name: dial for dial in dials_of(SCENES["cubic"].build(), SCENES["cubic"])}
    assert not cubic["beta"].factors
    assert cubic["beta"].low < 0 < 1 < cubic["beta"].high
