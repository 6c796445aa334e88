"""Spring and gravity laws: values by other means, smoothness where it is promised, refusals where it is due."""

import itertools

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from orbits import InputError, NoOrbit, OutOfRange, find
from problems import Hopper, Juggler, hopper_in_si
from problems.laws import gravity, springs

R = np.linspace(-2.5, 2.5, 41)
BY_HAND = {
    "linear": lambda r: r,
    "cubic": lambda r: r + 0.3 * r**3,
    "quintic": lambda r: r + 0.1 * r**5,
    "tanh": lambda r: np.tanh(0.2 * r) / 0.2,
    "sinh": lambda r: np.sinh(0.5 * r) / 0.5,
    "toda": lambda r: -np.expm1(-0.2 * r) / 0.2,
    "morse": lambda r: (np.exp(-0.05 * r) - np.exp(-0.1 * r)) / 0.05,
    "bilinear": lambda r: np.where(r < 0.5, r, 0.5 + 3 * (r - 0.5)),
    "end_stops": lambda r: np.where(np.abs(r) < 3, r, np.sign(r) * (3 + 20 * (np.abs(r) - 3))),
    "air": lambda r: 5 / 1.4 * (1 - (1 + r / 5) ** -1.4),
    "belleville": lambda r: r * ((4 + r) * (4 + r / 2) + 16) / 32,
    "rubber": lambda r: 10 / 3 * ((1 + r / 10) - (1 + r / 10) ** -2.0),
}


@pytest.mark.parametrize("name", springs.NAMED)
def test_named_springs(name):
    law = springs.NAMED[name]()
    assert law(R) == pytest.approx(BY_HAND[name](R), rel=1e-14, abs=1e-14)
    value, slope = law.with_slope(0.0)
    assert value == pytest.approx(0, abs=1e-15)
    assert slope == pytest.approx(1, rel=1e-14)
    step = 1e-6
    assert law.with_slope(R + 0.01)[1] == pytest.approx(
        (law(R + 0.01 + step) - law(R + 0.01 - step)) / (2 * step), rel=1e-7
    )


@pytest.mark.parametrize("name", springs.NAMED)
def test_every_named_spring_hops_with_its_defaults(name):
    orbit = find(Hopper(springs.NAMED[name](), rest_length=30))
    assert orbit.family == 1
    assert orbit.admissible
    assert orbit.error < 1e-12


@pytest.mark.parametrize("name", gravity.NAMED)
def test_named_gravity(name):
    law = gravity.NAMED[name]()
    assert law(0.0) == 1
    expected = {"constant": 1.0, "inverse_square": 1.01**-2, "linear": 0.99, "exponential": np.exp(-0.01)}[name]
    assert law(10.0) == pytest.approx(expected, rel=1e-14)


def test_one_law_five_ways():
    """A formula, a potential, a Python function, a function with a declared breakpoint, and a fine table."""
    r = np.linspace(-6, 3, 400)
    laws = [
        springs.formula("r + beta*r**3", beta=0.3),
        springs.potential("r**2/2 + beta*r**4/4", beta=0.3),
        springs.function(lambda r, beta: r + beta * r**3, beta=0.3),
        springs.function(lambda r, beta: r + beta * r**2 * ca.fabs(r) * ca.sign(r), breakpoints=(0.0,), beta=0.3),
        springs.table((r, r + 0.3 * r**3)),
    ]
    alphas = [find(Hopper(law)).alpha for law in laws]
    assert alphas == pytest.approx([2.936459188494196478] * 5, rel=1e-12)


def test_numpy_functions_in_a_python_law():
    assert find(Hopper(springs.function(lambda r, b: np.sinh(b * r) / b, b=0.5))).alpha == pytest.approx(
        find(Hopper("sinh", parameters={"b": 0.5})).alpha, rel=1e-14
    )


def test_an_undeclared_kink_is_found_by_the_steps():
    """A bilinear force in one expression, its break unknown to the toolkit, against the declared one."""
    declared = find(Hopper(springs.bilinear(ratio=3.0, gap=0.5)))
    single = springs.function(lambda r: r + 2 * ca.fmax(0, r - 0.5))
    orbit = find(Hopper(single))
    assert orbit.alpha == pytest.approx(declared.alpha, abs=max(orbit.error, 1e-12))


class TestTable:
    def test_is_monotone_and_twice_differentiable_between_noisy_rows(self):
        rng = np.random.default_rng(3)
        r = np.sort(rng.uniform(-5, 5, 40))
        force = np.cumsum(rng.exponential(1.0, 40)) - 12
        law = springs.table((r, force), noise=0)
        fine = np.linspace(r[0], r[-1], 20001)
        assert law(r) == pytest.approx(force, rel=1e-12, abs=1e-12)
        assert np.diff(law(fine)).min() > -1e-12
        _, rows = law.pieces[1]({})
        for row, after in itertools.pairwise(rows):
            piece = np.polynomial.Polynomial(row[1:])
            for order, factor in enumerate((1, 1, 2)):
                end = (piece.deriv(order) if order else piece)(after[0] - row[0])
                assert end == pytest.approx(factor * after[1 + order], rel=1e-9, abs=1e-9)

    def test_turns_where_the_data_turns(self):
        r = np.linspace(-4, 4, 9)
        force = np.array([-2.0, -3, -2.5, -1, 0, 1.5, 1.5, 2, 4])
        fine = springs.table((r, force))(np.linspace(-4, 4, 4001))
        assert fine.min() == pytest.approx(-3, abs=1e-12)
        flat = springs.table((r, force))(np.linspace(1, 2, 50))
        assert flat == pytest.approx(1.5, abs=1e-12)

    def test_converges_with_the_rows(self):
        errors = []
        for count in (20, 40, 80):
            r = np.linspace(-3, 3, count)
            fine = np.linspace(-2, 2, 999)
            errors.append(np.abs(springs.table((r, np.sinh(r)))(fine) - np.sinh(fine)).max())
        assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > 3.5  # a cubic spline's order is 4

    def test_rows_in_any_order_and_repeated(self, tmp_path):
        path = tmp_path / "bench.csv"
        path.write_text("force,deflection\n2,2\n-3,-3\n1,1.0\n\n0,0\n-1,-1\n1.2,1\n0.8,1\n4,4\n")
        law = springs.table(path)
        assert law.range() == (-3, 4)
        assert law(1.0) == pytest.approx(1.0)
        assert law(2.0) == pytest.approx(2.0)

    def test_refuses_to_extrapolate(self):
        law = springs.table((np.arange(-3.0, 4), np.arange(-3.0, 4)))
        with pytest.raises(OutOfRange, match=r"outside the law's range, \[-3, 3\]"):
            law(3.1)

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "no rows"),
            ("r,f\n", "no rows"),
            ("r,f\n1,1\n2,2\n2,3\n", "at least 4"),
            ("r,f\n1,1\n2,two\n3,3\n4,4\n", "row 3"),
            ("r,f\n1\n2,2\n3,3\n4,4\n", "row 2"),
            ("r,f\n1,nan\n2,2\n3,3\n4,4\n", "finite"),
        ],
    )
    def test_bad_files(self, tmp_path, text, message):
        (tmp_path / "bench.csv").write_text(text)
        with pytest.raises(InputError, match=message):
            springs.table(tmp_path / "bench.csv")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: springs.tanh(b=-1), "b = -1 is out of bounds"),
        (lambda: springs.cubic(beta=float("nan")), "beta = nan"),
        (lambda: springs.formula("r + beta*r**3"), "'beta' without a value"),
        (lambda: springs.formula("r", beta=1.0), "does not use 'beta'"),
        (lambda: springs.function(lambda r: float(r)), "no finite value"),
        (lambda: springs.function(lambda r: r if r > 0 else 2 * r), "without if"),
        (lambda: springs.function(lambda r: {}["rubber"]), "KeyError: 'rubber'"),
        (lambda: springs.formula("r + c*v", c=0.1), "depends on the extension r alone.*damping"),
        (lambda: springs.formula("1/tanh(r/L) - L/r", L=2.0), "0/0 at r = 0; its limit there is about 0,.*table"),
        (lambda: gravity.formula("sin(z)/z"), "0/0 at z = 0; its limit there is about 1,.* without that division$"),
        (lambda: gravity.function(lambda z: np.sin(z) / z), "0/0 at z = 0; its limit there is about 1,"),
        (
            lambda: springs.function(lambda r, b: 1 / np.tanh(b * r) - 1 / (b * r), b=2.0),
            "0/0 at r = 0; its limit.*table",
        ),
        (lambda: springs.as_spring("r + b*r**3", {"b": 0.1, "c": 1.0}), "no parameter 'c'; known: b"),
        (lambda: springs.as_spring("cubic", {"bta": 0.1}), "no parameter 'bta'; did you mean 'beta'"),
        (lambda: springs.as_spring(springs.cubic(), {"k": 0.1}), "no parameter 'k'"),
        (lambda: gravity.as_gravity("inverse_square", {"H": 9.0}), "no parameter 'H'; known: R"),
        (lambda: springs.function(lambda r: ca.vertcat(r, r)), "2 values"),
        (lambda: gravity.formula("2 - z"), "must be 1 at z = 0"),
        (lambda: find(Hopper("log(r)")), "no force at rest"),
        (lambda: Hopper("cubic", parameters={"bta": 1.0}), "has a parameter 'bta'; did you mean 'beta'"),
        (lambda: Hopper("cubci"), "'cubci' without a value|unknown"),
        (lambda: Hopper("r", mass_ratio=0), "mass_ratio = 0 is out of bounds"),
        (lambda: Hopper("r", restitution=1.5), "restitution = 1.5"),
        (lambda: Hopper("r", rest_length=-1), "rest_length = -1"),
        (lambda: Hopper("r", gravity="exp(-z/9)"), "give the rest length"),
        (lambda: Hopper("r*mass_ratio", parameters={"mass_ratio": 2.0}), "machine's own name"),
        (lambda: Hopper(3), "not int"),
    ],
)
def test_bad_laws_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: find(Hopper("tanh(r)")), "lifts off cleanly|leaves the ground"),
        (lambda: find(Hopper("tanh(1.9*r)/1.9")), r"largest tension 0.5263"),
        (lambda: find(Hopper("r - 0.5*r**3")), r"largest tension 0.5443"),
    ],
)
def test_springs_that_cannot_lift_the_foot(make, message):
    with pytest.raises(NoOrbit, match=message):
        make()


def test_a_function_is_read_anew_each_time():
    """What a function closes over may have changed since the last time."""
    stiffening = 0.2
    law = lambda r: r + stiffening * r**3  # noqa: E731
    before = find(Hopper(law)).alpha
    stiffening = 0.5
    assert find(Hopper(law)).alpha == pytest.approx(2.7218099551244222, rel=1e-13) != before


def test_laws_are_not_mixed_up():
    r = np.linspace(-9, 9, 7)
    for make, message in (
        (lambda: Hopper(gravity.linear(kappa=-1.0)), "is a law of z, not a spring"),
        (lambda: Hopper(gravity=springs.table((r, 1 + 0 * r))), "is a law of r, not gravity"),
        (lambda: Juggler("r", "exp(-z/50)"), "give the rest length"),
        (lambda: hopper_in_si(60, 3, stiffness=8e3).with_values(mass_ratio=0.5), "in SI follows from its masses"),
        (lambda: springs.table(5), "two sequences"),
        (lambda: springs.table((r, r, r)), "two sequences"),
        (lambda: springs.table(([], [])), "two finite lists of one length, with rows"),
        (lambda: Hopper(parameters=[1]), "mapping of names"),
        (lambda: Hopper(parameters=None), "mapping of names"),
        (lambda: find(object()), "is no machine"),
    ):
        with pytest.raises(InputError, match=message):
            make()


def test_a_body_radius_is_a_parameter_in_metres_beside_a_force_law_of_any_names():
    machine = hopper_in_si(
        60, 3, force="k*r + R*r**3", rest_length=0.8, body_radius=250.0, parameters={"k": 8e3, "R": 2e6}
    )
    assert machine.parameters == {"k": 8e3, "R": 2e6, "body_radius": 250.0}
    assert machine.describe()["laws_in"] == "SI"


def test_a_narrow_quotient_is_not_leapt_over():
    """Half the flight takes the time alpha, and ends where the extension turns: by SciPy in steps that see the bump."""
    force = lambda r: r + 0.5 / (1 + ((r + 3) / 0.1) ** 40)  # noqa: E731
    orbit = find(Hopper(force))
    start = [orbit.liftoff_extension, orbit.alpha]
    rates = lambda t, x: [x[1], -force(x[0])]  # noqa: E731
    half = solve_ivp(rates, (0, orbit.alpha), start, method="DOP853", rtol=1e-12, atol=1e-12, max_step=0.002)
    assert half.y[1, -1] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    "machine", [Hopper("air", rest_length=20), Hopper("rubber"), Hopper("r", "inverse_square", rest_length=9)]
)
def test_steps_along_laws_with_a_pole_are_not_bounded(machine):
    assert {key.reach for key in machine.keys if key} == {np.inf}
