"""Files that results are written to: their names checked, their contents as JSON, and the version that wrote them; and
the one line in which a result tells what it is."""

import json
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from .errors import InputError

try:
    __version__ = version("persistent-orbits")
except PackageNotFoundError:  # the sources are used without being installed
    __version__ = "unknown"


def in_words(values: Mapping[str, Any]) -> list[str]:
    """The values as name=value, numbers with all their digits."""
    plain = {name: value.item() if isinstance(value, np.generic) else value for name, value in values.items()}
    return [f"{name}={value!r}" for name, value in plain.items()]


def one_line(result: Any, values: Mapping[str, Any]) -> str:
    """A result in one line: its type, and some of its values by name."""
    return f"{type(result).__name__}({', '.join(in_words(values))})"


def fields_in_line(result: Any, *names: str) -> str:
    """A result in one line: its type, and those of its attributes."""
    return one_line(result, {name: getattr(result, name) for name in names})


def to_json(value: Any) -> str:
    """JSON in one line, each float with all the digits that bring it back to the last bit.

    Mappings, sequences and NumPy arrays are taken; NaN and infinity raise `InputError`, since JSON has no number for
    them.
    """
    try:
        return json.dumps(value, allow_nan=False, ensure_ascii=True, default=_plain)
    except ValueError as error:
        raise InputError(f"a number that is not finite has no place in a result: {error}") from None


def _plain(value: Any) -> Any:
    """What `json` does not know, as what it knows."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{value!r} cannot be written as JSON")


def write_json(document: Mapping, path: str | Path, what: str) -> Path:
    """Write a document to a JSON file and return its path; `what` it is goes into the `InputError` when that fails."""
    path = Path(path)
    try:
        path.write_text(to_json(document) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"the {what} cannot be saved to {path}: {error}") from None
    return path


def check_ending(path: str | Path, endings: tuple[str, ...]) -> Path:
    """The path of a file to write; raises `InputError` when its ending is none of those given."""
    path = Path(path)
    if endings and path.suffix.lower() not in endings:
        raise InputError(f"'{path}' cannot be written: its name needs an ending, {' or '.join(endings)}")
    return path


def check_path(path: str | Path, endings: tuple[str, ...]) -> Path:
    """The path of a file to write, with one of the endings if any are given; raises `InputError` where its ending or
    its folder rules that out."""
    path = check_ending(path, endings)
    if not path.parent.is_dir():
        raise InputError(f"'{path}' cannot be written: there is no folder '{path.parent}'")
    return path
