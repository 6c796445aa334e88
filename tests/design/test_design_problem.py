"""Design problems: a constraint however it is written, and what is refused before anything is solved."""

import pytest
from designs import CUBIC, RANGE
from scipy.optimize import brentq

from orbits import InputError, find, optimize, quantities


@pytest.mark.parametrize("text", ["stroke - 7 >= 0", "0 <= 2*(stroke - 7)", "stroke/7 >= 1"])
def test_a_constraint_means_the_same_however_it_is_written(text):
    """Against b = 0.17580..., the root of stroke = 7 that a bracketing method finds from orbits found anew."""

    def stroke(b):
        machine = CUBIC.with_values(b=b)
        return quantities(machine, find(machine), ["stroke"])["stroke"]

    best = optimize(CUBIC, minimise="alpha", over={"b": RANGE}, subject_to=[text], starts=1)
    assert best.parameters["b"] == pytest.approx(brentq(lambda b: stroke(b) - 7, 0.1, 0.3, xtol=1e-12), rel=1e-9)
    assert best.kkt < 1e-9


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"over": {"b": (1.0, 0.5)}}, "over b = (1, 0.5); low must be below high"),
        ({"over": {"mass_ration": (0, 1)}}, "no parameter 'mass_ration' to design; did you mean 'mass_ratio'"),
        ({"over": {}}, "over must name the parameters"),
        ({"over": {"b": 3}}, "over b = 3; it must be a pair"),
        ({"over": {"mass_ratio": (-1, 1)}}, "mass_ratio = -1 is out of bounds"),
        ({"minimise": "strok"}, "unknown quantity 'strok'; did you mean 'stroke'"),
        ({"minimise": "alpha +"}, "is missing here"),
        ({"minimise": None}, "one of the two"),
        ({"maximise": "alpha"}, "one of the two"),
        ({"subject_to": ["stroke < 3"]}, "write 'stroke <= 3'"),
        ({"subject_to": ["A > 0.02"]}, "a range includes its bounds; write 'A >= 0.02'"),
        ({"subject_to": ["1 < stroke <= 2"]}, "write '1 <= stroke <= 2'"),
        ({"subject_to": ["stroke = 3"]}, "write 'stroke == 3'"),
        ({"subject_to": ["stroke"]}, "one of <=, >=, ==, or two <="),
        ({"subject_to": ["stroke <= forse"]}, "unknown quantity 'forse'"),
        ({"subject_to": ["stroke <= 3", "stroke >= 4"]}, "'stroke <= 3' and 'stroke >= 4' are in conflict"),
        ({"subject_to": ["4 <= stroke <= 3"]}, "can never hold"),
        ({"subject_to": ["1 <= 3"]}, "must contain a quantity"),
        ({"subject_to": "stroke <= 3"}, "a list of constraints"),
        ({"starts": 0}, "starts = 0"),
        ({"starts": 2, "seed": -1}, "seed = -1; it must be a whole number from 0"),
        ({"starts": 2, "seed": 1.5}, "seed = 1.5"),
        ({"starts": 2, "seed": "a"}, "seed = 'a'"),
        ({"minimise": 3}, "minimise = 3; it must be a formula"),
        ({"minimise": "3"}, "'3' must contain a quantity of the orbit"),
        ({"minimise": "abs(b - 1)"}, "abs cannot be used in a design"),
        ({"subject_to": ["sign(alpha - 1) >= 0"]}, "sign cannot be used in a design"),
        ({"subject_to": ["alpha <= 1/0"]}, "'1/0' is not a finite number"),
        ({"subject_to": ["b == 0.5", "2*b == 1"]}, "2 equations for 1 parameters to design"),
        ({"over": {"b": (0.3, 0.3 + 1e-13)}}, "leave no room"),
        ({"over": {"b": (1e-320, 0.3)}}, "span too many decades"),
        ({"over": {"rest_length": (15, 30)}}, "'alpha' and the constraints do not depend on rest_length"),
        ({"family": 0}, "family = 0"),
    ],
)
def test_ill_posed_problems_are_refused(options, words):
    with pytest.raises(InputError) as error:
        optimize(CUBIC, **{"minimise": "alpha", "over": {"b": RANGE}, **options})
    assert words in str(error.value)
