"""What a record cannot say: it is said, with what would say it, and no number stands for it."""

import re

import numpy as np
import pytest

import tests.recorded_hops as bench
from orbits import InputError
from problems import recordings
from tests.recorded_hops import NAMES, START, deviations_from_truth, fit_of_heights, three_hops


def test_names_what_is_not_separated():
    """Heights do not change with all masses and forces multiplied by one number."""
    found = fit_of_heights()
    assert found.inseparable == (("body_mass", *NAMES),)
    assert found.remedy == "the ground force would separate them"
    assert re.search(r"\n  k +not separated\n", str(found))
    assert not np.isfinite([*found.deviations.values()]).any()


def test_is_no_distribution():
    found = fit_of_heights()
    with pytest.raises(InputError, match="does not separate body_mass and foot_mass"):
        found.distributions()


def test_a_further_channel_separates_them():
    record = bench.record(*three_hops(), ("body height", "foot height", "ground force"), 0.01)
    found = recordings.fit(START, record, ("body_mass", *NAMES))
    truth = {"body_mass": bench.BODY, **bench.TRUTH}
    assert max(map(abs, deviations_from_truth(found, truth).values())) < 3
