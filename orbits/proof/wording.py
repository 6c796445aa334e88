"""The theorem in words."""

from typing import Any


def statement_of(case: Any) -> str:
    return "TODO"
