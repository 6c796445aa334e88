"""The arcs and the unknowns of hops that come back, which follow from the impacts of each."""

import pytest

from orbits.check_statement import Word
from orbits.proof.hops.hop_word import HopWord


def test_the_names_of_a_hop_and_of_several():
    one, bouncing, pair = HopWord((1,)), HopWord((2,)), HopWord((2, 1))
    assert (one.launches, one.times) == (("alpha",), ["flight_time", "contact_time"])
    assert bouncing.times == ["flight_time_1", "flight_time_2", "contact_time"]
    assert pair.launches == ("alpha", "alpha_2")
    assert pair.times == ["flight_time_1_1", "flight_time_1_2", "contact_time_1", "flight_time_2", "contact_time_2"]
    assert [pair.following(hop) for hop in range(2)] == ["alpha_2", "alpha"]
    assert [each.bounces for each in (one, bouncing, pair)] == [False, True, True]


@pytest.mark.parametrize("impacts", [(1,), (3,), (1, 1), (2, 1, 12)])
def test_both_programs_read_the_same_word(impacts):
    """Whose names are in any order."""
    word = HopWord(impacts)
    names = sorted({"liftoff", *word.launches, *word.times})
    hops = zip(word.launches, word.flights, word.contacts, strict=True)
    assert Word.of_names(names).hops == tuple(hops)
