"""The fit of a machine to recorded hops."""

from dataclasses import replace

import numpy as np
import pytest

import tests.recorded_hops as bench
from orbits import InputError, NoOrbit, simulate
from problems import Hopper, hopper_in_si, recordings, springs
from tests.recorded_hops import NAMES, START, deviations_from_truth, three_hops


@pytest.mark.parametrize(
    "channels",
    [
        ("body height", "foot height"),
        ("ground force", "spring length"),
        pytest.param(("body acceleration", "foot acceleration"), marks=pytest.mark.slow),
        pytest.param(("body speed", "foot speed", "ground force"), marks=pytest.mark.slow),
    ],
)
def test_finds_the_leg_that_hopped(channels):
    """It is within three deviations of the truth, and these are small."""
    found = recordings.fit(START, bench.record(*three_hops(), channels, 0.01), NAMES)
    assert max(map(abs, deviations_from_truth(found).values())) < 3
    assert all(found.deviations[name] < 0.05 * bench.TRUTH[name] for name in NAMES)
    assert (found.lack, found.inseparable) == ("", ())
    assert [part.begins for part in found.parts][:4] == ["launch", "landing", "lift-off", "landing"]


def test_without_noise_finds_it_exactly():
    record = bench.record(*bench.hops(1.5, 1, 250.0), ("body height", "foot height"), 1e-9)
    found = recordings.fit(START, record, NAMES)
    assert found.values == pytest.approx(bench.TRUTH, rel=1e-5)


@pytest.mark.slow
def test_deviations_are_those_of_many_records():
    """Over records that differ by their noise, the squares of the deviations from the truth have mean 1."""
    hop = bench.hops(1.5, 1, 250.0)
    records = (bench.record(*hop, ("body height", "ground force"), 0.02, seed) for seed in range(12))
    off = [[*deviations_from_truth(recordings.fit(START, each, NAMES)).values()] for each in records]
    assert np.abs(off).max() < 3.5
    assert np.mean(np.square(off), axis=0) == pytest.approx(np.ones(4), abs=0.75)


def test_motions_of_one_file_are_fitted_together(tmp_path):
    parts = [bench.record(*bench.hops(speed, 1, 250.0), ("body height", "foot height"), 0.01) for speed in (1.4, 1.1)]
    both = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    rows = np.column_stack([*both.values()])
    np.savetxt(tmp_path / "two.csv", rows, delimiter=",", header=",".join(both), comments="")
    found = recordings.fit(START, tmp_path / "two.csv", NAMES)
    assert {part.motion for part in found.parts} == {1, 2}
    assert max(map(abs, deviations_from_truth(found).values())) < 3
    with pytest.raises(InputError, match="record = 3"):
        found.plot(record=3)


def test_a_late_clock_is_an_unknown():
    times, channels = three_hops()
    record = bench.record(times, channels, ("body height", "foot height", "ground force"), 0.01)
    record["ground force [N]"][3:] = record["ground force [N]"][:-3]
    record["ground force [N]"][:3] = np.nan
    found = recordings.fit(START, record, NAMES, delays=("ground force",))
    assert found.delays["ground force"] == pytest.approx(3 / 250, abs=1e-4)
    assert max(map(abs, deviations_from_truth(found).values())) < 3.5


@pytest.mark.slow
def test_restitution_and_the_friction_of_a_guide_are_unknowns():
    leg = replace(START.with_values(**bench.TRUTH), restitution=0.3, drag=3.0)
    run = simulate(leg, 1.5, hops=3)
    t = np.arange(0.0, run.end, 0.002)
    rng, (body, foot) = np.random.default_rng(3), run(t)[:, [0, 2]].T
    record = {"t [s]": t, "body height [mm]": 1e3 * body + rng.normal(0, 0.3, len(t))}
    record |= {"foot height [mm]": 1e3 * foot + rng.normal(0, 0.3, len(t))}
    unknown = (*NAMES, "drag", "restitution")
    found = recordings.fit(replace(START, restitution=0.2), record, unknown)
    assert max(map(abs, deviations_from_truth(found, {**bench.TRUTH, "drag": 3.0, "restitution": 0.3}).values())) < 3
    assert found.machine.restitution == found.values["restitution"]


def test_a_machine_without_units():
    run, rng = simulate(Hopper(mass_ratio=0.4, damping=0.05), 6.0, hops=3), np.random.default_rng(1)
    t = np.linspace(0.0, run.end, 300)
    record = {"time": t} | {
        name: run(t)[:, i] + rng.normal(0, 0.02, len(t)) for name, i in (("body height", 0), ("foot height", 2))
    }
    found = recordings.fit(Hopper(mass_ratio=0.5, damping=0.04), record, ("mass_ratio", "damping"))
    assert max(map(abs, deviations_from_truth(found, {"mass_ratio": 0.4, "damping": 0.05}).values())) < 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"unknown": ("kk",)}, "no parameter 'kk'; did you mean 'k'"),
        ({"unknown": ()}, "name the parameters to fit"),
        ({"unknown": ("k", "k")}, "occurs twice"),
        ({"noise": {"body speed": 1.0}}, "noise: the record has no channel 'body speed'"),
        ({"noise": {"body height": 0.0}}, "noise of body height = 0"),
        ({"offsets": ("foot",)}, "offsets: the record has no channel 'foot'"),
        ({"delays": ("body height", "foot height")}, "leave one channel out"),
        ({"machine": hopper_in_si(3.0, 1.5, force=springs.table(springs.SAMPLE, in_si=True))}, "fit a formula"),
    ],
)
def test_refuses(change, message):
    arguments = {"machine": START, "unknown": ("k", "b")} | change
    record = bench.record(*three_hops(), ("body height", "foot height"), 0.01)
    with pytest.raises(InputError, match=message):
        recordings.fit(source=record, **arguments)


def test_refuses_a_record_of_few_samples():
    record = {name: values[:4] for name, values in bench.record(*three_hops(), ("body height",), 0.01).items()}
    with pytest.raises(InputError, match="4 samples for 2 parameters: at least 18 are needed"):
        recordings.fit(START, record, ("k", "b"))


@pytest.mark.slow
def test_refuses_a_record_of_another_machine():
    record = bench.record(*three_hops(), ("body height", "foot height"), 0.01)
    record["foot height [m]"] *= 1000
    with pytest.raises(NoOrbit, match="check the units and the signs"):
        recordings.fit(START, record, ("k", "b"))


@pytest.mark.parametrize(
    ("value", "message"), [(0.5, "the same in all rows"), (np.nan, "the same in all rows"), (1e13, "check its unit")]
)
def test_refuses_a_channel_that_shows_no_hop(value, message):
    record = bench.record(*three_hops(), ("body height", "foot height"), 0.01)
    record["foot height [m]"][:] = value
    with pytest.raises(InputError, match=message):
        recordings.fit(START, record, ("k", "b"))
