"""Records in columns against the same records one by one."""

import pickle
from dataclasses import dataclass

import numpy as np

from orbits.records import NONE, Records, numbers_or_nan


@dataclass(frozen=True)
class Inner:
    number: float | None
    words: tuple[str, ...]


@dataclass(frozen=True)
class Outer:
    place: tuple[float, ...]
    inner: Inner


def records(numbers: list[float]) -> Records[Outer]:
    inner = Records(Inner, {"number": np.array(numbers), "words": [(f"{number:g}",) for number in numbers]})
    return Records(Outer, {"place": np.outer(numbers, [1.0, 2.0]), "inner": inner})


def test_single_records_and_parts():
    made = [Outer((number, 2 * number), Inner(number, (f"{number:g}",))) for number in (1.0, 2.0, 3.0)]
    found = records([1.0, 2.0, 3.0])
    assert found == made
    assert made == list(found)
    assert tuple(made) == found
    assert found[-1] is found[2]
    assert found[1:] == made[1:] != found
    assert found[::-1] == made[::-1]
    assert Records.joined([found[:1], found[1:2], found[2:]]) == made
    assert pickle.loads(pickle.dumps(found)) == made
    assert found.replaced(place=np.zeros((3, 2)))[1].place == (0.0, 0.0)


def test_numbers_that_do_not_exist():
    found = records([1.0, NONE])
    assert found[1].inner.number is None
    np.testing.assert_array_equal(numbers_or_nan(found.column("number")), [1.0, np.nan])


def test_records_are_added_like_tuples():
    records = Records(complex, {"real": np.array([1.0, 2.0]), "imag": np.array([3.0, 4.0])})
    assert records[:1] + records[1:] == (1 + 3j, 2 + 4j)
    assert (5j,) + records == (5j, 1 + 3j, 2 + 4j)  # noqa: RUF005
