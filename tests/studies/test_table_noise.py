"""The deviation that an orbit states for the noise of a measured spring, against the orbits of the laws themselves."""

import numpy as np
import pytest

from studies.table_noise import main


@pytest.mark.slow
def test_alpha_is_within_the_stated_deviations(capsys):
    """Of normal numbers 99.7 % are within three deviations and 68 % within one."""
    off = np.array([each.off for each in main(30, seed=1)])
    assert np.mean(off < 3) >= 0.97
    assert 0.6 < np.mean(off < 1) < 0.8
    assert "3 deviations" in capsys.readouterr().out
