"""Questions of sweeps that are refused at once."""

import numpy as np
import pytest
from scipy.stats import norm

from orbits import InputError, sweep
from problems import Hopper, plate_hopper


@pytest.mark.parametrize(
    ("arguments", "options", "said"),
    [
        (({"beta": (0, 1)}, 5), {"family": 0}, "family = 0"),
        (({"beta": (0, 1)}, 5), {"family": [1, 1]}, "different"),
        (({"beta": (0, 1)}, 5), {"quantities": ["perod"]}, "unknown quantity 'perod'"),
        (
            ({"beta": (0, 1)}, 5),
            {"quantities": ["error/2"]},
            "no quantity 'error' here: it is the accuracy of an orbit",
        ),
        (({"beta": (0, 1)}, 5), {"outcome": "hop"}, "outcome = 'hop'"),
        (({"beta": (0, 1)}, 5), {"outcome": "map"}, "a launch speed"),
        (({"beta": (0, 1)}, 5), {"outcome": "fixed_points"}, "between"),
        (({"beta": (0, 1)}, 5), {"between": (4, 5)}, "between"),
        (({"beta": (0, 1)}, 5), {"method": "newton"}, "method = 'newton'"),
        (({"beta": (0, 1)}, 5), {"method": "closed form"}, "a linear spring"),
        (({"beta": (0, 1)}, 5), {"method": "shooting", "start": {"alpha": 3.0}}, "leave out"),
        *(
            (({"beta": (0, 1)}, 5), {"outcome": "fixed_points", "between": between}, said)
            for between, said in (
                (4.0, r"between = 4.0; it must be a pair \(low, high\)"),
                ((), r"between = \(\); it"),
                ("45", "between = '45'"),
                ((4.0, 5.0, 6.0), "it must be a pair"),
                ((5.0, 4.0), r"between = \(5, 4\); low must be below high"),
                ((4.0, 4.0), "low must be below high"),
                ((4.0, "b"), "between = 'b'"),
            )
        ),
        (({"beta": (0, 1)}, 5), {"outcome": "map", "quantities": ["period"]}, "no families and no quantities"),
        (({"alpha": (3, 4)}, 5), {"outcome": "map", "family": 2}, "no families and no quantities"),
        (({"alpha": (3, 4)}, 5), {}, "no parameter 'alpha'"),
        (({"beta": (0, 1)}, 5), {"quantities": ["period", "period"]}, "'period' appears twice in quantities"),
        (({"beta": (0, 1)}, 5), {"family": []}, "family = "),
        (({"mass_ratio": (-1.0, 1.0)}, 5), {}, "mass_ratio"),
        (({"mass_ratio": norm(1.0, 1.0)}, 50), {}, "member .* mass_ratio"),
    ],
)
def test_what_cannot_be_asked_is_refused_at_once(arguments, options, said):
    with pytest.raises(InputError, match=said):
        sweep(Hopper("cubic"), *arguments, **options)


@pytest.mark.parametrize(
    ("over", "options"),
    [
        ({"alpha": (0.0, 6.4)}, {"outcome": "map"}),
        ({"m3": (0.9, 1.1)}, {"outcome": "fixed_points", "between": (3.0, 5.0)}),
    ],
)
def test_the_return_map_is_not_swept_where_a_launch_is_more_than_a_speed(over, options):
    """Three speeds are no launch of three numbers."""
    said = f"outcome = '{options['outcome']}': a launch of a hopper on a plate has several numbers; sweep its orbits"
    with pytest.raises(InputError, match=said):
        sweep(plate_hopper(), over, 3, **options)


@pytest.mark.parametrize("kind", [tuple, list, np.array])
def test_launch_speeds_may_be_an_array(kind):
    found = sweep(Hopper(), {"mass_ratio": [0.5, 1.0]}, outcome="fixed_points", between=kind([4.0, 5.0]))
    assert set(found["status"]) == {"certified"}
