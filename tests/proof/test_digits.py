"""How many digits proofs have."""

import mpmath as mp
import pytest

from orbits import find, prove, time_limit
from orbits.exact import Unproved
from orbits.proof.digits import with_enough_digits
from problems import Hopper, runner, springs


@pytest.mark.parametrize(
    ("requested", "needed", "attempts"),
    [
        (None, 18, [18]),
        (None, 25, [18, 30]),
        (None, 50, [18, 30, 60]),
        (None, 90, [18, 30, 60]),
        (20, 90, [20, 40, 80]),
        (200, 500, [200, 300]),
        (300, 500, [300]),
    ],
)
def test_digits_are_doubled_at_most_twice(requested, needed, attempts):
    reached = list[int]()

    def attempt(digits, before):
        assert before == (reached[-1] if reached else None)
        reached.append(digits or 18)
        return reached[-1]

    assert with_enough_digits(attempt, lambda found: found < needed, requested)[0] == attempts[-1]
    assert reached == attempts


def test_what_is_proved_with_fewer_digits_remains():
    def attempt(digits, before):
        if before:
            raise Unproved("no more")
        return 18

    assert with_enough_digits(attempt, lambda found: True, None) == (18, None, ("with 30 digits: no more",))
    with time_limit(1e-9):
        found = with_enough_digits(lambda digits, before: digits or 18, lambda found: True, None)
    assert found[:2] == (18, None)
    assert found[2][0].startswith("with 30 digits: it takes more than")


@pytest.mark.parametrize(("beyond", "digits", "verdict"), [("1e-9", None, "proved"), ("-1e-9", 30, "refuted")])
def test_a_separation_that_comes_near_to_zero(beyond, digits, verdict):
    """In contact the masses of a hop of a linear spring and M = 1 come to r = -1 - sqrt(4 + 2 alpha**2)."""
    with mp.workdps(30):
        alpha = mp.findroot(lambda x: mp.sin(x) - x * mp.cos(x), 4.4934)
        length = mp.nstr(1 + mp.sqrt(4 + 2 * alpha**2) + mp.mpf(beyond), 17)
    proof = prove(find(Hopper("r", rest_length=float(length))), digits)
    assert proof.conditions["separation"] == verdict
    assert proof.digits == 30


@pytest.mark.slow
def test_the_friction_of_a_runner_with_stops():
    machine = runner(0.1, 3.7, spring=springs.end_stops(gap=0.6, stop=1.3))
    proof = prove(find(machine, tune=("inertia", "hip_stiffness"), at={"speed": 0.4}), limit=300)
    assert proof.proved, proof.reasons
    assert (proof.digits, proof.stated["friction"]) == (None, "0.2956")  # needs no more digits than usual
