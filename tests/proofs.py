"""Shared by the tests of proofs: a reference, the conditions of a motion, enclosures, distances tried alone, and saved
proofs that are changed."""

from contextlib import suppress
from decimal import Decimal
from fractions import Fraction

from conftest import REFERENCES

from orbits.check_statement import statement_of
from orbits.proof import attraction

CUBIC = REFERENCES[2]
CONDITIONS = {"clearance", "separation", "contact_force", "contact_end"}


def meets(enclosure, value, error="0"):
    """Whether an enclosure meets a decimal that is known to an error."""
    value, error = Fraction(str(value)), Fraction(error)
    return Fraction(enclosure.low) <= value + error and value - error <= Fraction(enclosure.high)


def overlap(first, second):
    return Decimal(first.low) <= Decimal(second.high) and Decimal(second.low) <= Decimal(first.high)


def not_proved(proof):
    return {name for name, verdict in proof.conditions.items() if verdict != "proved"}


def within(monkeypatch, *distances):
    """Have these distances tried alone."""
    monkeypatch.setattr(attraction, "_distances", lambda coefficient: [Fraction(each) for each in distances])


def restated(document):
    """A saved proof that was changed, with the statement of its data, where these have one."""
    with suppress(Exception):
        return document | {"statement": statement_of(document)}
    return document
