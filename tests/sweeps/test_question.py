"""Questions of sweeps that are refused at once."""

import pytest
from scipy.stats import norm

from orbits import InputError, sweep
from problems import Hopper


@pytest.mark.parametrize(
    ("arguments", "options", "said"),
    [
        (({"beta": (0, 1)}, 5), {"family": 0}, "family = 0"),
        (({"beta": (0, 1)}, 5), {"family": [1, 1]}, "different"),
        (({"beta": (0, 1)}, 5), {"quantities": "period"}, "are a list"),
        (({"beta": (0, 1)}, 5), {"quantities": ["perod"]}, "unknown quantity 'perod'"),
        (({"beta": (0, 1)}, 5), {"quantities": ["alpha"]}, "column of every answer"),
        (({"beta": (0, 1)}, 5), {"outcome": "hop"}, "outcome = 'hop'"),
        (({"beta": (0, 1)}, 5), {"outcome": "map"}, "a launch speed"),
        (({"beta": (0, 1)}, 5), {"outcome": "fixed_points"}, "between"),
        (({"beta": (0, 1)}, 5), {"between": (4, 5)}, "between"),
        (({"mass_ratio": (-1.0, 1.0)}, 5), {}, "mass_ratio"),
        (({"mass_ratio": norm(1.0, 1.0)}, 50), {}, "member .* mass_ratio"),
    ],
)
def test_what_cannot_be_asked_is_refused_at_once(arguments, options, said):
    with pytest.raises(InputError, match=said):
        sweep(Hopper("cubic"), *arguments, **options)
