"""Roots: existence, uniqueness, refusals and interval parameters, of equations with known roots."""

import pytest
from ball_systems import algebraic, clock_of, equations_of, oscillator
from flint import arb, ctx

from orbits.balls import FIRST_BITS, prove_root
from orbits.exact import Unproved


@pytest.fixture(autouse=True)
def first_bits():
    with ctx.workprec(FIRST_BITS):
        yield


def test_a_quarter_turn_of_an_oscillator():
    """From 0 to its turn at 2: the speed is 2, the duration pi / 2."""
    root = prove_root(oscillator(lambda u, x, p: [x[0] - 2, x[1]]), [2.0000001, 1.5707963], 60)
    with ctx.workprec(300):
        expected = [arb(2), arb.pi() / 2]
    assert all(ball.contains(value) for ball, value in zip(root.box, expected, strict=True))
    assert all(float(ball.rad()) < 2.0**-59 for ball in root.box)
    assert 0 < float(root.unique_within([arb(1)] * len(root.box))) < 1
    passage = root.evaluated.passages[0]
    assert passage.finish[0].contains(arb(2))
    assert passage.finish[1].contains(arb(0))


@pytest.mark.parametrize("bits", [60, 200, 700])
def test_a_square_root_to_many_bits(bits):
    root = prove_root(algebraic(lambda w, p: w**2 - 2), [1.4142135], bits)
    with ctx.workprec(2 * bits):
        assert root.box[0].contains(arb(2).sqrt())
        assert root.box[0].rad() < arb(2) ** (1 - bits)


@pytest.mark.parametrize("bits", [60, 200])
def test_an_unknown_that_is_exactly_zero(bits):
    """Its enclosure shrinks as long as one lets it."""
    equations = clock_of(
        ("w", "z"), lambda u, p: [0], lambda u, p: 1, lambda u, x, p: [u["w"] ** 2 - 2, 3 * u["z"] + u["z"] ** 3]
    )
    root = prove_root(equations, [1.4142135, 0.0], bits)
    assert root.box[1].contains(0)
    with ctx.workprec(2 * bits):
        assert root.box[0].contains(arb(2).sqrt())
        assert all(ball.rad() < arb(2) ** (1 - bits) for ball in root.box)


@pytest.mark.parametrize("distance", [2e-3, 2e-5, 2e-7, 2e-9])
def test_no_other_root_is_within_the_radius_of_uniqueness(distance):
    """Of w**2 = (distance / 2)**2, whose roots are so far apart."""
    equations = algebraic(lambda w, p: w**2 - p["half"] ** 2, half=distance / 2)
    root = prove_root(equations, [1.0001 * distance / 2], 60)
    assert root.box[0].overlaps(arb(repr(distance / 2)))
    assert 0 < float(root.unique_within([arb(1)] * len(root.box))) < distance


@pytest.mark.parametrize("shift", [-1e-7, 1e-7])
def test_the_radius_of_uniqueness_is_about_the_middle_of_the_box(shift):
    """Uniqueness is proved on the box about the guess, the largest that is tried; the middle of the final box is
    another place, and the radius about it may not reach beyond."""
    guess = 1.4142135623730951 + shift
    root = prove_root(algebraic(lambda w, p: w**2 - 2), [guess], 60)
    reach = arb(2) ** -20 * (1 + arb(guess))
    middle, radius = root.box[0].mid(), root.unique_within([arb(1)] * len(root.box))
    assert float(radius) == pytest.approx(float(reach), rel=0.1)
    assert middle + radius.mid() <= guess + reach
    assert middle - radius.mid() >= guess - reach


@pytest.mark.parametrize("guess", [0.0, 1e-9, 1.0, 2.0])
@pytest.mark.parametrize(
    "condition",
    [lambda w, p: w**2 + 1, lambda w, p: w**2 + 2.0**-20, lambda w, p: w**2, lambda w, p: (w - 1) ** 2],
    ids=["none", "almost a root", "a double one", "a double one elsewhere"],
)
def test_what_has_no_simple_root_is_not_proved(condition, guess):
    with pytest.raises(Unproved):
        prove_root(algebraic(condition), [guess], 60)


def test_a_guess_far_from_the_root_is_not_proved():
    with pytest.raises(Unproved, match="no box"):
        prove_root(algebraic(lambda w, p: w**2 - 2), [1.42], 60)


def test_an_interval_parameter_is_enclosed_tightly():
    """w**2 = q for each q within a relative 1e-6 of 2."""
    low, high = "1.999998", "2.000002"
    root = prove_root(algebraic(lambda w, p: w**2 - p["q"], q=(low, high)), [1.4142135], 60)
    ends = [arb(low).sqrt(), arb(high).sqrt()]
    for end in [*ends, arb(2).sqrt(), arb("1.9999985").sqrt()]:
        assert root.box[0].contains(end.mid())
    assert 2 * root.box[0].rad() <= 10 * (ends[1] - ends[0])
    assert root.unique_within([arb(1)] * len(root.box)) > 0


def test_an_interval_parameter_of_a_motion():
    """An oscillator of slope q from 0 to its turn at 2: the duration is pi / (2 sqrt q), the speed 2 sqrt q."""
    low, high = "0.9999995", "1.0000005"
    equations = equations_of(
        ("speed", "duration"), ("x", "v"), lambda x, p: [x[1], -p["q"] * x[0]], lambda u, p: [0, u["speed"]],
        lambda u, p: u["duration"],
        lambda u, x, p: [x[0] - 2, x[1]], q=(low, high),
    )  # fmt: skip
    root = prove_root(equations, [2.0, 1.5707963267948966], 60)
    ends = [[2 * arb(q).sqrt(), arb.pi() / (2 * arb(q).sqrt())] for q in (low, "1.0000001", high)]
    for values in ends:
        assert all(ball.contains(value.mid()) for ball, value in zip(root.box, values, strict=True))
    for ball, first, last in zip(root.box, ends[0], ends[-1], strict=True):
        assert 2 * ball.rad() <= 10 * abs(last - first)
