"""The rows of a measured spring from a file, a data frame or two sequences."""

from pathlib import Path
from typing import Any

import numpy as np

from orbits.errors import InputError, true_or_false

from .measured import read_table, short, text_of


def measured_columns(source: Any, in_si: bool) -> tuple[np.ndarray, np.ndarray, float, str]:
    """Extensions and forces (n,) in the order of the rows, -1.0 where these count compression, else 1.0, and a name.

    source : a file's name, a `pandas.DataFrame`, whose columns are named as those of a file, or two sequences
    in_si : as in `springs.table`

    Raises `InputError` for anything else.
    """
    in_si = true_or_false("in_si", in_si)
    if isinstance(source, str | Path):
        path = Path(source)
        pairs, sense = read_table(path, text_of(path), in_si)
        return *_numbers(pairs, short(path.name)), sense, short(path.name)
    if hasattr(source, "to_csv"):
        has_names = any(name is not None for name in source.index.names)
        pairs, sense = read_table(Path("of a DataFrame"), source.to_csv(index=has_names), in_si)
        return *_numbers(pairs, "DataFrame"), sense, "DataFrame"
    return *_numbers(source, "table"), 1.0, "table"


def _numbers(source: Any, label: str) -> tuple[np.ndarray, np.ndarray]:
    """Extensions and forces (n,) of two sequences; raises `InputError` for anything else."""
    try:
        r, force = (np.asarray(column, dtype=float) for column in source)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{label}: a table is two sequences of numbers, extensions and forces") from None
    if r.ndim != 1 or not r.size or r.shape != force.shape or not (np.isfinite(r).all() and np.isfinite(force).all()):
        raise InputError(f"{label}: extensions and forces must be two finite lists of one length, with rows")
    if max(np.abs(r).max(initial=0), np.abs(force).max(initial=0)) > 1e100:
        raise InputError(f"{label}: extensions or forces too large to compute with; they lie below 1e100")
    return r, force
