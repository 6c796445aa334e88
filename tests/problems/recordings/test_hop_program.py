"""The nonlinear program of recorded hops."""

import numpy as np
import pytest

import tests.recorded_hops as bench
from orbits import simulate
from problems.recordings.channels import channels_of
from problems.recordings.hop_guess import motion_of, sizes_of
from problems.recordings.hop_program import LAUNCH, HopProgram, Samples, Unknowns
from tests.recorded_hops import NAMES, START, three_hops

TRUE = START.with_values(**bench.TRUTH)
CHANNELS = tuple(channels_of(START)[name] for name in ("body height", "foot speed", "ground force"))


@pytest.fixture(scope="module")
def program():
    """That of the true motion, with weights of the inverse of a hundredth of the sizes."""
    times, channels = three_hops()
    run = simulate(TRUE, 1.5, hops=3)
    motion = motion_of(run, 0.0, 0.0, run.end, first=LAUNCH)
    inside = times < run.end
    values = [channels[channel.name][inside] for channel in CHANNELS]
    sizes = sizes_of(values)
    zeros = np.zeros(inside.sum(), int)
    samples = [Samples(zeros, times[inside], own, zeros + 100 / size) for own, size in zip(values, sizes, strict=True)]
    unknowns = Unknowns(
        TRUE,
        NAMES,
        CHANNELS,
        (True, False, False),
        (False, False, True),
        tuple(sizes.tolist()),
        tuple(bench.TRUTH.values()),
    )
    return HopProgram(unknowns, [motion], samples)


def test_the_true_motion_solves_it(program):
    z = program.guess(np.zeros(1), np.zeros(1))
    off, _ = program.residuals(z)
    sizes = program.unknowns.sizes
    assert max(np.nanmax(np.abs(own)) / size for own, size in zip(off, sizes, strict=True)) < 1e-6
    found = program.solve(z, program.samples)
    assert found.kind == "minimum"
    assert program.solution(found.x).values == pytest.approx(bench.TRUTH, rel=1e-5)


def test_slopes_are_differences_of_simulations(program):
    """The heights, and the instant of the first landing, by the stiffness from the same launch speed."""
    slopes, edges = program.slopes(program.guess(np.zeros(1), np.zeros(1)), program.samples)
    column, step = NAMES.index("k"), 1e-4
    runs = [simulate(TRUE.with_values(k=bench.STIFFNESS * (1 + sign * step)), 1.5, hops=3) for sign in (1, -1)]
    (first, own), weight = program.order[0], program.samples[0].weights[0]
    assert first == 0  # the heights in flight
    times = program.samples[0].times[own]
    high, low = (run(times)[:, 0] for run in runs)
    before = times < min(run.events[0].time for run in runs)
    expected = -weight * (high - low) / (2 * step)
    assert slopes[: len(own), column][before] == pytest.approx(expected[before], rel=1e-4, abs=1e-4)
    landings = [run.events[0].time for run in runs]
    assert edges[1, column] == pytest.approx((landings[0] - landings[1]) / (2 * step), rel=1e-4)


def test_errors_of_edges_follow_the_noise(program):
    z = program.guess(np.zeros(1), np.zeros(1))
    parameters, (errors,) = program.errors(z, program.samples)
    fewer, (less,) = program.errors(z, [each._replace(weights=10 * each.weights) for each in program.samples])
    events = slice(1, -1)
    assert (errors[events] > 0).all()
    assert less[events] == pytest.approx(errors[events] / 10, rel=0.05)
    assert errors[-1] == 0.0  # the end of the record
    assert fewer == pytest.approx(parameters / 10, rel=0.05)
