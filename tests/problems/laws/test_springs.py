"""Named springs by other means, and tables: smoothness where it is promised, refusals where it is due."""

import itertools
import pickle

import numpy as np
import pytest

from orbits import InputError, find
from orbits.errors import OutOfRange
from problems import Hopper, hopper_in_si, rimless_wheel
from problems.laws import springs

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


# The parameters with a unit of length, with its power.
LENGTHS = {"beta": -2, "delta": -4, "a": -1, "b": -1, "gap": 1, "length": 1, "height": 1, "thickness": 1}
BODY, FOOT, STIFFNESS, GRAVITY = 60.0, 3.0, 8000.0, 9.80665
LENGTH, TIME = FOOT * GRAVITY / STIFFNESS, np.sqrt(FOOT / STIFFNESS / (1 + FOOT / BODY))


def in_si(name):
    """A named law with a stiffness in N/m and lengths in m, which without units has its defaults."""
    sizes = {key: x * LENGTH ** LENGTHS[key] for key, x in springs.NAMED[name]().parameters.items() if key in LENGTHS}
    return springs.NAMED[name](stiffness=STIFFNESS, **sizes)


@pytest.mark.parametrize("name", springs.NAMED)
def test_named_springs_have_their_stiffness_in_si(name):
    """Forces are those by hand in units of the foot's weight and of this over the stiffness, and so is the hop."""
    law = in_si(name)
    assert law.with_slope(0.0)[1] == pytest.approx(STIFFNESS, rel=1e-14)
    assert law(R * LENGTH) == pytest.approx(BY_HAND[name](R) * FOOT * GRAVITY, rel=1e-13, abs=1e-12)
    leg = hopper_in_si(BODY, FOOT, force=law, rest_length=30 * LENGTH)
    plain = find(Hopper(springs.NAMED[name](), mass_ratio=FOOT / BODY, rest_length=30.0))
    orbit = find(leg)
    assert orbit.alpha == pytest.approx(plain.alpha * LENGTH / TIME, rel=1e-12)
    assert orbit.flight_time == pytest.approx(plain.flight_time * TIME, rel=1e-12)
    assert orbit(0.5 * orbit.flight_time) == pytest.approx(
        plain(0.5 * plain.flight_time) * LENGTH * np.array([1, 1 / TIME, 1, 1 / TIME]), rel=1e-10, abs=1e-10
    )
    units = {"beta": "1/m^2", "delta": "1/m^4", **dict.fromkeys("ab", "1/m"), "stiffness": "N/m"}
    for key in law.parameters.keys() & {*LENGTHS, "stiffness"} - ({"beta"} if name == "quintic" else set()):
        assert leg.units_of_parameters()[key] == units.get(key, "m")
        if key != "stiffness":
            with pytest.raises(InputError, match=f"a spring of stiffness 8000 needs .*{key} .* in SI"):
                springs.NAMED[name](stiffness=STIFFNESS)


@pytest.mark.parametrize("name", ["linear", "bilinear", "end_stops"])
def test_a_stiffness_by_its_earlier_name(name):
    own = {} if name == "linear" else {"gap": 0.01}
    law = springs.NAMED[name](k=STIFFNESS, **own)
    assert law.parameters["k"] == STIFFNESS
    assert law(R).tolist() == springs.NAMED[name](stiffness=STIFFNESS, **own)(R).tolist()
    with pytest.raises(InputError, match="stiffness = 2 and k = 1 are one parameter: leave k out"):
        springs.NAMED[name](k=1.0, stiffness=2.0, **own)


def test_a_machine_states_the_stiffness_of_its_law():
    """By its argument, as for a linear spring, or among the parameters."""
    law = springs.air(stiffness=STIFFNESS, length=0.2)
    stated = {"stiffness": STIFFNESS, "parameters": {"length": 0.2}}
    for leg in (
        hopper_in_si(60.0, 3.0, force="air", **stated),
        hopper_in_si(60.0, 3.0, force="air", parameters={"length": 0.2, "stiffness": STIFFNESS}),
        hopper_in_si(60.0, 3.0, force=law.text, parameters=dict(law.parameters)),
    ):
        assert leg == hopper_in_si(60.0, 3.0, force=law)
        assert leg.with_values(stiffness=9000.0).spring.with_slope(0.0)[1] == pytest.approx(9000.0)
    with pytest.raises(InputError, match=r"stiffness = 8000, but the spring '2.* has the slope 16000 at rest: .*name"):
        hopper_in_si(60.0, 3.0, force="2*stiffness*r", parameters={"stiffness": STIFFNESS})
    with pytest.raises(InputError, match="has stiffness 16000 N/m at rest, not 8000"):
        hopper_in_si(60.0, 3.0, force="2*stiffness*r", stiffness=STIFFNESS)


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


SI_ROWS = springs.table(springs.SAMPLE, in_si=True)


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Hopper(SI_ROWS), r"is in m and N, but this machine has no units: .*hopper_in_si"),
        (lambda: rimless_wheel(spring=SI_ROWS), r"is in m and N, but this machine has no units"),
        (
            lambda: hopper_in_si(60.0, 3.0, force=springs.air()),
            r"slope 1 at rest.* in SI: state its stiffness in N/m \(stiffness=8000.0\) and its lengths in m",
        ),
        (lambda: hopper_in_si(60.0, 3.0, force="tanh"), r"as a formula it is 'stiffness\*\(tanh\(b\*r\)/b\)'"),
        (
            lambda: hopper_in_si(60.0, 3.0, force=springs.bilinear()),
            r"in SI: state its stiffness in N/m \(stiffness=8000.0\) and its lengths in m$",
        ),
    ],
)
def test_a_law_of_other_units_is_refused(build, words):
    with pytest.raises(InputError, match=words):
        build()
    again = pickle.loads(pickle.dumps(hopper_in_si(3.0, 1.5, force=SI_ROWS, rest_length=0.3)))
    assert again.with_values(body_mass=4.0).spring.in_si
