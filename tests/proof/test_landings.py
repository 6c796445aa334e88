"""Losses at landing: means of the jerk over all times of landing."""

from flint import arb

from orbits.proof.landings import JerkIntegrals


def test_the_means_of_a_jerk_that_grows():
    """Of 2 + t they are 2 + s/2, 2 + s/3 and 2 + s/4; the jerk varies by 0.06 to either side in each of its parts."""
    jerks, length = JerkIntegrals(), arb(0.125)
    for i in range(20):
        low, high = length * i, length * (i + 1)
        means, jerks = jerks.further(2 + low.union(high), length)
        for s in (low, (low + high) / 2, high):
            assert all(mean.overlaps(2 + s / k) for mean, k in zip(means, (2, 3, 4), strict=True))
        assert all(mean.rad() < 0.3 for mean in means)
