"""The result of a fit, of the file that comes with the package: it has noise, spikes and a gap."""

from functools import cache

import numpy as np
import pytest

import tests.recorded_hops as bench
from orbits import NoOrbit, find, simulate, uncertainty
from problems import recordings
from problems.recordings import HopFit
from tests.recorded_hops import NAMES, START, deviations_from_truth


@cache
def fit_of_sample():
    return recordings.fit(START, recordings.SAMPLE, NAMES)


def test_is_of_a_known_leg():
    found = fit_of_sample()
    assert max(map(abs, deviations_from_truth(found).values())) < 3
    assert found.noise == pytest.approx({"body height": 8e-4, "foot height": 8e-4, "ground force": 6.0}, rel=0.15)
    assert found.offsets == pytest.approx({"body height": 0.035, "foot height": 0.012}, abs=2e-4)


def test_leaves_out_its_spikes():
    found = fit_of_sample()
    times, used = found.samples["foot height"][[1, 4]]
    assert times[used == 0].tolist() == [2.16]
    assert 2.6 in found.samples["ground force"][1][found.samples["ground force"][4] == 0]
    assert len(times) == 252


def test_gives_a_machine_like_any_other():
    found = fit_of_sample()
    assert found.machine.values["foot_mass"] == found.values["foot_mass"]
    assert find(found.lossless).admissible
    with pytest.raises(NoOrbit, match="damped"):
        find(found.machine)
    spread = uncertainty(found.lossless, found, samples=64)
    assert spread.deviation["alpha"] == pytest.approx(spread.linear["alpha"], rel=0.2)
    assert simulate(found.machine, 1.5, hops=3).launches[1:] == pytest.approx(
        simulate(START.with_values(**bench.TRUTH), 1.5, hops=3).launches[1:], rel=0.02
    )


def test_prints_saves_and_loads(tmp_path):
    found = fit_of_sample()
    text = str(found)
    assert "hopper fitted to" in text
    assert "252, 1 left out" in text
    assert str(HopFit.load(found.save(tmp_path / "fit.json"), START)) == text
    table = found.table()
    assert set(table["phase"]) == {"flight", "contact"}
    rms = np.concatenate([table[name] for name in table if name.startswith("residual")])
    assert np.nanmean(rms) == pytest.approx(1.0, abs=0.1)
