"""Intervals between decimals: what lies in them, and their width."""

import math
from decimal import Decimal

import pytest

from orbits.exact import Enclosure


def test_what_lies_in_an_enclosure():
    enclosure = Enclosure("1.25", "1.50")
    for value in ("1.25", 1.25, Decimal("1.3"), "1.50", 1.5):
        assert value in enclosure
    for value in ("1.2499999999999999999999999", math.nextafter(1.5, 2), Decimal(2), -1.3, math.inf):
        assert value not in enclosure
    assert enclosure.width == 0.25
    assert enclosure.document() == {"low": "1.25", "high": "1.50"}


def test_a_width_beyond_the_precision_of_decimals():
    """Decimals subtract with 28 digits by themselves."""
    assert Enclosure("1." + "0" * 50, "1." + "0" * 49 + "1").width == pytest.approx(1e-50, rel=1e-9)
