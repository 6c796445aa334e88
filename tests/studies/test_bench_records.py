"""Random records of test stands: alpha within three stated deviations, or a refusal that names the choice."""

import numpy as np
import pytest

from studies.bench_records import main, random_stand


@pytest.mark.slow
def test_quick_records(capsys):
    found = main(4, seed=1, quick=True)
    assert {each.verdict for each in found} <= {"within", "refused", "no orbit"}
    assert sum(each.verdict == "within" for each in found) >= 3
    assert "median deviation of alpha" in capsys.readouterr().out


def test_friction_of_a_stand_slips_at_its_force():
    """On the last loading the force is that of the spring and the friction, whatever came before."""
    rng = np.random.default_rng(0)
    stand = next(each for each in iter(lambda: random_stand(rng), None) if each.kind == "friction")
    x, force = stand._replace(turns=[-stand.amplitude, stand.amplitude], is_sine=False).measured(50)
    assert force[-1] == pytest.approx(stand.elastic(x[-1]) + stand.friction)
