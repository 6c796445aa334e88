"""Where a fit begins."""

import numpy as np
import pytest

import tests.recorded_hops as bench
from orbits import simulate
from problems import Hopper
from problems.recordings.channels import channels_of
from problems.recordings.hop_guess import hop_time, motion_of, starts_of
from problems.recordings.hop_program import FREE, LAUNCH
from tests.recorded_hops import START, three_hops

CHANNELS = {name: channels_of(START)[name] for name in ("body height", "ground force")}


@pytest.mark.parametrize("since", [0.0, 0.15, 0.31])
def test_the_best_start_is_near_the_motion(since):
    """The record begins at the launch, in the first flight, or in the first contact."""
    times, channels = three_hops()
    later = times >= since
    found = starts_of(START, CHANNELS, times[later], [channels[name][later] for name in CHANNELS], [True, False])[0]
    hop = hop_time(simulate(START.with_values(**bench.TRUTH), 1.5, hops=1))
    assert found.launched == pytest.approx(0.0, abs=0.06 * hop)
    assert hop_time(found.run) * found.factor == pytest.approx(hop, rel=0.05)


def test_a_motion_has_the_parts_of_the_simulation():
    run = simulate(Hopper(damping=0.01), 8.0, hops=2)
    motion = motion_of(run, 3.0, 3.0, 3.0 + run.end, first=LAUNCH)
    assert [part.begins for part in motion.parts] == [LAUNCH, *(event.kind for event in run.events[:-1])]
    assert motion.edges[1:] == pytest.approx([3.0 + event.time for event in run.events])
    part, nodes = motion.parts[0], motion.nodes[0]
    assert nodes == pytest.approx(run(np.arange(part.intervals) / part.intervals * run.events[0].time))


def test_a_motion_may_begin_and_end_anywhere():
    run = simulate(Hopper(damping=0.01), 8.0, hops=2)
    landing, liftoff = (event.time for event in run.events[:2])
    motion = motion_of(run, 0.0, 0.5 * landing, 0.5 * (landing + liftoff))
    assert [(part.begins, part.contact) for part in motion.parts] == [(FREE, False), ("landing", True)]
    assert motion.nodes[0][0] == pytest.approx(run(0.5 * landing))
    assert motion_of(run, 0.0, run.end + 1, run.end + 2) is None
