"""Numbers as they are stated: a decimal that is written, a number of Python, and one of NumPy."""

import numpy as np
from proofs import overlap

from orbits import find, prove
from problems import Hopper


class TestExactNumbers:
    def test_a_numeral_is_the_decimal_that_is_written(self):
        by_name = find(Hopper("r + b*r**3", rest_length=10, parameters={"b": 0.1}))
        written = prove(find(Hopper("r + 0.1*r**3", rest_length=10)), 25, motion=False)
        stated = prove(by_name, 25, motion=False, parameters={"b": "0.1"})
        binary = prove(by_name, 25, motion=False, parameters={"b": "0.1000000000000000055511151231257827"})
        assert all(each.proved and each.alpha.width < 1e-25 for each in (written, stated, binary))
        assert overlap(written.alpha, stated.alpha)
        assert overlap(written.alpha, prove(by_name, 25, motion=False).alpha)
        assert not overlap(written.alpha, binary.alpha)

    def test_numbers_of_numpy_are_numbers(self, cubic_hop):
        exactly, numpy = (
            prove(cubic_hop, parameters={"beta": kind(0.3)}, motion=False) for kind in (float, np.float64)
        )
        assert numpy.alpha == exactly.alpha
