"""The branch and the cycle of a record: against the law that its force was made from."""

import numpy as np
import pytest
from conftest import slow_after

from orbits import InputError, find
from problems import hopper_in_si, springs
from problems.recordings import choose, read_record

STIFFNESS, FRICTION, NOISE = 1500.0, 6.0, 0.05
BODY, FOOT, GRAVITY = 0.6, 0.3, 9.80665
# Of a linear spring, whatever its offset: the first root of alpha = tan(alpha), in SI.
ALPHA = 4.493409457909064 * GRAVITY * np.sqrt(FOOT * (1 + FOOT / BODY) / STIFFNESS)
EQUAL, ONE, PART = [0.03, -0.03] * 3 + [0.0], [0.03, -0.03, 0.0], [0.03, -0.03, 0.015]
GROWING = [sign * size for size in np.linspace(0.006, 0.03, 5) for sign in (1, -1)] + [0.0]


def driven(turns, rows: int = 60) -> np.ndarray:
    ways = [np.linspace(a, b, rows + 1)[1:] for a, b in zip([0.0, *turns], turns, strict=False)]
    return np.concatenate([[0.0], *ways])


def rubbed(r: np.ndarray, stiffness: float = 2e4) -> np.ndarray:
    """The force of a spring beside dry friction, which gives way with a stiffness before it slips (Jenkins)."""
    friction, found = 0.0, []
    for step in np.diff(r, prepend=r[0]):
        friction = float(np.clip(friction + stiffness * step, -FRICTION, FRICTION))
        found.append(friction)
    return STIFFNESS * r + np.array(found)


def record_of(turns, drift: float = 0.0):
    """Extensions and forces; the drift is that from the first row to the last."""
    r = driven(turns)
    noise = NOISE * np.random.default_rng(3).normal(size=len(r))
    return r, rubbed(r) + noise + drift * np.linspace(0, 1, len(r))


def hop(record, **options):
    return find(hopper_in_si(BODY, FOOT, force=springs.table(record, in_si=True, **options)))


@pytest.mark.parametrize(
    ("turns", "branch"),
    slow_after(
        2,
        [
            *[(EQUAL, "loading"), (GROWING, "mean"), (ONE, "loading"), (PART, "loading"), (EQUAL, "unloading")],
            *[(EQUAL, "mean"), (GROWING, "loading"), (GROWING, "unloading"), (ONE, "mean"), (PART, "mean")],
        ],
    ),
)
def test_every_branch_has_the_alpha_of_the_spring(turns, branch):
    """Of equal and of growing cycles, of one cycle from rest and of one with part of a second loading."""
    orbit = hop(record_of(turns), branch=branch)
    assert orbit.alpha == pytest.approx(ALPHA, rel=5e-3)
    assert abs(orbit.alpha - ALPHA) < 3 * orbit.certificate.alpha_noise


def test_the_text_says_what_was_used_and_what_was_left_out():
    law = springs.table(record_of(EQUAL), in_si=True, branch="loading")
    begins = "table:table (rows 242 to 301 of 421, cycle 3 of 3, virgin rows 1 to 61 left out, loading, "
    assert law.text.startswith(begins + "60 rows smoothed, noise 0.0")
    assert law.text in " ".join(str(find(hopper_in_si(BODY, FOOT, force=law))).split())
    loop = springs.loop(record_of(PART), in_si=True)
    assert "rows 62 to 121 of 181, cycle 1 of 1, virgin rows 1 to 61 left out, unloading" in loop.text


@pytest.mark.parametrize(
    ("cycle", "rows"),
    [
        (None, "rows 242 to 301 of 421, cycle 3 of 3"),
        (2, "rows 122 to 181 of 421, cycle 2 of 3"),
        (1, "rows 1 to 61 of 421, cycle 1 of 3"),
        ("all", "rows 122 to 181 and 242 to 301 of 421, cycles 2 to 3 of 3"),
        ("mean", "rows 122 to 181 and 242 to 301 of 421, mean of cycles 2 to 3 of 3"),
    ],
)
def test_a_cycle_is_chosen(cycle, rows):
    chosen = choose(read_record(record_of(EQUAL), False), "loading", cycle)
    assert chosen.note.startswith(rows)


class TestDrift:
    """2 N over three cycles of a record."""

    RECORD = record_of(EQUAL, drift=2.0)

    @pytest.mark.parametrize("cycle", [None, "mean", "all"])
    def test_cycles_that_differ_are_refused(self, cycle):
        with pytest.raises(InputError, match=r'its 3 cycles differ by up to .* choose one, cycle="last"'):
            springs.table(self.RECORD, in_si=True, branch="unloading", cycle=cycle)

    @pytest.mark.slow
    def test_it_is_reported_and_counts(self):
        orbit = hop(self.RECORD, branch="unloading", cycle="last")
        assert "drift 0.58 N a cycle" in str(orbit)  # 2 N in 3.5 cycles, and the noise
        assert abs(orbit.alpha - ALPHA) < 3 * orbit.certificate.alpha_noise
        plain = hop(record_of(EQUAL), branch="unloading")
        assert orbit.certificate.alpha_noise > 3 * plain.certificate.alpha_noise


@pytest.mark.parametrize(
    ("turns", "options", "message"),
    [
        (EQUAL, {}, 'is a loop: .* name one, branch="loading"'),
        (EQUAL, {"branch": "loading", "cycle": 4}, "cycle = 4: table has cycles 1 to 3"),
        (EQUAL, {"branch": "loading", "cycle": "first"}, "one of last, mean, all"),
        ([-0.03, -0.02], {"branch": "unloading"}, "no cycle has the whole branch of unloading: .* or cycle=1"),
    ],
)
def test_what_cannot_be_chosen_is_named(turns, options, message):
    with pytest.raises(InputError, match=message):
        springs.table(record_of(turns), in_si=True, **options)


def test_sweeps_in_one_direction_are_pooled_unless_they_differ():
    r = np.tile(np.linspace(-5.0, 5.0, 21), 3)
    force = r + 0.05 * np.random.default_rng(4).normal(size=63)
    assert "63 rows smoothed" in springs.table((r, force)).text
    drifting = force + np.repeat([0.0, 0.5, 1.0], 21)
    with pytest.raises(InputError, match=r'its 3 sweeps differ .* choose one, cycle="last"'):
        springs.table((r, drifting))
    assert "rows 44 to 63 of 63, sweep 3 of 3" in springs.table((r, drifting), cycle="last").text
    with pytest.raises(InputError, match="in no order: leave cycle out"):
        springs.table((r[np.random.default_rng(5).permutation(63)], force), cycle="last")
