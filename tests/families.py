"""Shared by the tests of families: known values of the cubic spring, and the events of a kind."""

from conftest import PROVED, middle

from orbits import Family

GOLDEN = {float(beta): middle(hop["alpha"]) for beta, hop in PROVED["cubic"].items()}
FOLD, FOLD_ALPHA = (middle(PROVED["fold"][name]) for name in ("beta", "alpha"))


def events(family: Family, kind: str) -> list:
    return [event.point for event in family.events if event.kind == kind]
