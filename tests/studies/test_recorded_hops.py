"""Random recorded hops: the truth is within the stated deviations."""

import numpy as np
import pytest

from studies.recorded_hops import main


@pytest.mark.slow
def test_the_truth_is_within_the_deviations(tmp_path, capsys):
    off = main(["--quick", "--seed", "5", "--output", str(tmp_path)])
    assert off.shape == (4, 4)
    assert np.abs(off).max() < 3
    assert "4 of 4 records are fitted" in capsys.readouterr().out
    assert (tmp_path / "recorded_hops.png").stat().st_size > 10_000
