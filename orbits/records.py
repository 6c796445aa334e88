"""Many records of one kind as columns, from which single ones are made when they are needed."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any, Generic, TypeVar, overload

import numpy as np

Made = TypeVar("Made")
# Marks a number in a column that does not exist, and is None in a record.
NONE = math.inf


class Records(Sequence[Made], Generic[Made]):
    """Records (m,) of a kind, whose fields by name are columns: arrays (m,) of numbers, arrays (m, n) whose rows are
    tuples in records, and other sequences."""

    def __init__(self, kind: Callable[..., Made], columns: Mapping[str, Any]):
        self.kind, self.columns, self._made = kind, dict(columns), dict[int, Made]()

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    @overload
    def __getitem__(self, i: int) -> Made: ...

    @overload
    def __getitem__(self, i: slice | np.ndarray) -> "Records[Made]": ...

    def __getitem__(self, i):
        """One record, which is made once, or those of a slice or of an array of indices or truth values."""
        if isinstance(i, slice | np.ndarray | list):
            return Records(self.kind, {name: _some(column, i) for name, column in self.columns.items()})
        i = range(len(self))[i]
        if i not in self._made:
            self._made[i] = self.kind(**{name: _single(column[i]) for name, column in self.columns.items()})
        return self._made[i]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence):
            return NotImplemented
        return len(self) == len(other) and all(mine == theirs for mine, theirs in zip(self, other, strict=True))

    __hash__ = None  # type: ignore[assignment]

    def __add__(self, other: Sequence[Made]) -> tuple[Made, ...]:
        """These records and others, as tuples are added."""
        return (*self, *other)

    def __radd__(self, other: Sequence[Made]) -> tuple[Made, ...]:
        return (*other, *self)

    def __repr__(self) -> str:
        return repr(tuple(self))

    def column(self, name: str) -> Any:
        """The column of a field, of the records or of one of their fields; raises `KeyError` for another name."""
        if name in self.columns:
            return self.columns[name]
        return next(each for each in self.columns.values() if type(each) is Records).column(name)

    def replaced(self, **columns: object) -> "Records[Made]":
        """The records with other columns."""
        return Records(self.kind, {**self.columns, **columns})

    @classmethod
    def joined(cls, parts: Sequence["Records[Made]"]) -> "Records[Made]":
        """The records of all parts; there is at least one."""
        columns = {name: _joined_columns([part.columns[name] for part in parts]) for name in parts[0].columns}
        return Records(parts[0].kind, columns) if len(parts) > 1 else parts[0]


def numbers_or_nan(column: np.ndarray) -> np.ndarray:
    """The numbers of a column (m,), NaN for `NONE`."""
    values = np.asarray(column, dtype=float)
    return np.where(values == NONE, np.nan, values)


def _some(column: Any, i: Any) -> Any:
    """Some entries of a column."""
    if isinstance(i, slice) or isinstance(column, np.ndarray | Records):
        return column[i]
    return [column[j] for j in np.arange(len(column))[i].tolist()]


def _single(value: Any) -> Any:
    """An entry of a column as it is in a record."""
    if isinstance(value, np.ndarray):
        return tuple(value.tolist())
    value = value.item() if isinstance(value, np.generic) else value
    return None if value == NONE else value


def _joined_columns(columns: list[Any]) -> Any:
    """The columns of some parts as one."""
    if isinstance(columns[0], np.ndarray):
        return np.concatenate(columns)
    return Records.joined(columns) if isinstance(columns[0], Records) else list(chain.from_iterable(columns))
