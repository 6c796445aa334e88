"""Scrambled points of Sobol's sequence, which fill a cube evenly.

They are the points of `scipy.stats.qmc.Sobol`, whose import takes longer than most designs take to solve. The direction
numbers are those of S. Joe and F. Kuo, SIAM Journal on Scientific Computing 30, 2008. They are scrambled by random
lower triangular matrices and a random shift (J. Matousek, Journal of Complexity 14, 1998).
"""

from functools import lru_cache

import numpy as np

from ..errors import InputError
from .roots import Array

BITS_OF_POINT = 30
# For each dimension after the first the primitive polynomial modulo 2, its coefficients as bits, and the first
# direction numbers, the number of which is its degree.
DIRECTIONS = (
    (3, (1,)),
    (7, (1, 3)),
    (11, (1, 3, 1)),
    (13, (1, 1, 1)),
    (19, (1, 1, 3, 3)),
    (25, (1, 3, 5, 13)),
    (37, (1, 1, 5, 5, 17)),
    (41, (1, 1, 5, 5, 5)),
    (47, (1, 1, 7, 11, 19)),
    (55, (1, 1, 5, 1, 1)),
    (59, (1, 1, 1, 3, 11)),
    (61, (1, 3, 5, 5, 31)),
    (67, (1, 3, 3, 9, 7, 49)),
    (91, (1, 1, 1, 15, 21, 21)),
    (97, (1, 3, 1, 13, 27, 49)),
)


def sobol_points(count: int, dimensions: int, seed: int, first: int = 0) -> Array:
    """Points (count, dimensions) of the scrambled sequence in the unit cube, from the one of index `first` on."""
    if dimensions > 1 + len(DIRECTIONS):
        from scipy.stats import qmc

        return qmc.Sobol(dimensions, seed=seed).random_base2((first + count - 1).bit_length())[first : first + count]
    if first + count > 2**BITS_OF_POINT:
        raise InputError(f"Sobol's sequence has {2**BITS_OF_POINT} points, fewer than {first + count}")
    columns, shift = _scrambled(dimensions, seed)
    index = np.arange(first, first + count)
    index ^= index >> 1  # a Gray code, in which neighbours differ in one bit
    points = np.tile(shift, (count, 1))
    for bit in range(int(index.max(initial=0)).bit_length()):
        points[(index >> bit & 1).astype(bool)] ^= columns[:, bit]
    return points * 2.0**-BITS_OF_POINT


def _unscrambled(dimensions: int) -> Array:
    """Direction numbers (dimensions, bits), integers below 2**bits, whose highest bit is worth 1/2."""
    rows = [[1] * BITS_OF_POINT]
    for polynomial, numbers in DIRECTIONS[: dimensions - 1]:
        row, degree = [*numbers], len(numbers)
        for k in range(degree, BITS_OF_POINT):
            number = row[k - degree]
            for power in range(1, degree + 1):
                if polynomial >> (degree - power) & 1:
                    number ^= row[k - power] << power
            row.append(number)
        rows.append(row)
    return np.array(rows) << np.arange(BITS_OF_POINT - 1, -1, -1)


@lru_cache(maxsize=8)
def _scrambled(dimensions: int, seed: int) -> tuple[Array, Array]:
    """The direction numbers (dimensions, bits), each multiplied, as a vector of bits modulo 2, by the lower triangular
    matrix of its dimension, and the shift (dimensions,)."""
    rng = np.random.default_rng(seed)
    powers = 2 ** np.arange(BITS_OF_POINT)
    shift = rng.integers(2, size=(dimensions, BITS_OF_POINT), dtype=np.uint32) @ powers
    matrices = np.tril(rng.integers(2, size=(dimensions, BITS_OF_POINT, BITS_OF_POINT), dtype=np.uint32))
    matrices[:, np.arange(BITS_OF_POINT), np.arange(BITS_OF_POINT)] = 1
    bits = _unscrambled(dimensions)[..., None] >> np.arange(BITS_OF_POINT - 1, -1, -1) & 1
    return (np.einsum("drk,dck->dcr", matrices, bits) % 2) @ powers[::-1], shift
