"""Half cycles of a record, what differs between them, and where a record closes."""

from itertools import pairwise

import numpy as np
import pytest

from problems.recordings.half_cycles import are_whole, half_cycles, joint, offset_between, row_noise


def driven(*turns: float, rows: int = 40) -> np.ndarray:
    """Extensions from turn to turn, with so many rows on each way."""
    ways = [np.linspace(a, b, rows + 1)[1:] for a, b in pairwise(turns)]
    return np.concatenate([[turns[0]], *ways])


def test_a_record_from_rest():
    r = driven(0.0, 3.0, -3.0, 3.0, 0.0)
    halves = half_cycles(r)
    assert [(half.start, half.stop, half.direction) for half in halves] == [
        (0, 41, 1), (41, 81, -1), (81, 121, 1), (121, 161, -1)
    ]  # fmt: skip
    assert [(half.low, half.high) for half in halves] == [(0, 3), (-3, 3), (-3, 3), (0, 3)]
    assert are_whole(halves, r) == [False, True, True, False]


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("sign", [1, -1])
def test_noise_of_the_extension_turns_nothing(noise, sign):
    r = driven(0.0, 3.0, -3.0, 3.0, -3.0, rows=200)
    found = half_cycles(sign * (r + noise * np.random.default_rng(0).normal(size=len(r))))
    assert [half.direction for half in found] == [sign, -sign, sign, -sign]
    assert [half.length for half in found] == pytest.approx([201, 200, 200, 200], abs=12)


def test_cycles_differ_where_the_noise_does_not_explain_it():
    rng, r = np.random.default_rng(1), driven(-3.0, 3.0, -3.0, 3.0)
    first, _, second = half_cycles(r)
    for off, differs in ((0.0, False), (0.05, False), (0.5, True)):
        force = r + 0.1 * r**3 + 0.1 * rng.normal(size=len(r)) + off * (np.arange(len(r)) > 80)
        noise = row_noise(r, force, [first, second])
        assert noise == pytest.approx(0.1, rel=0.35)
        offset = offset_between(r, force, first, second, noise)
        assert (offset.differs, float(np.median(offset.offsets))) == (differs, pytest.approx(off, abs=0.05))


def test_a_short_way_over_to_the_other_branch_is_a_difference():
    r = driven(-3.0, 3.0, -3.0, 3.0)
    first, _, second = half_cycles(r)
    force = r + 0.01 * np.random.default_rng(2).normal(size=len(r))
    force[81:84] -= 0.2
    assert offset_between(r, force, first, second, 0.01).differs


@pytest.mark.parametrize(("slip", "skip", "gap"), [(0.0, 0, 0.0), (0.05, 2, 0.2083), (4.0, None, 0.4953)])
def test_a_record_from_rest_joins_its_end_once_friction_slips(slip, skip, gap):
    """Friction of 0.5 with an elastic way of `slip` before it slips; the gap is the mean of three rows."""
    r = driven(0.0, 3.0, -3.0, 0.0, rows=80)
    friction = np.r_[np.minimum(0.5, 0.5 * r[:81] / (slip or 1e-9)), [-0.5] * 80, [0.5] * 80]
    friction[0] = 0.5 if slip == 0 else 0.0
    found = joint(r, 2 * r + friction, half_cycles(r), 0.0)
    assert found.skip == skip
    assert found.gap == pytest.approx(gap, abs=1e-4)
