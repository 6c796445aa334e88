"""Chains of masses against the hopper, matrix exponentials in 30 digits, and another integrator."""

import pickle

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from orbits import InputError, NoOrbit, ReturnMap, find, find_all, simulate
from problems import Chain, Hopper

# Rest in mid-contact y1, y2, half the contact and half the flight of two hops of three equal masses.


def rest_and_times(orbit) -> list[float]:
    """Positions of all masses but the lowest at rest in mid-contact, and half the times of contact and flight."""
    middle = orbit(orbit.flight_time + orbit.contact_time / 2)
    return [*middle[:-2:2], orbit.contact_time / 2, orbit.flight_time / 2]


def exactly(masses, stiffnesses, guess) -> list[float]:
    """The hop near a guess, as by `rest_and_times`, from matrix exponentials of linear springs in 30 digits."""
    n = len(masses)
    with mp.workdps(30):
        m, k = [mp.mpf(x) for x in masses], [mp.mpf(x) for x in stiffnesses]

        def generator(count):
            """x' = A x of (positions, speeds, 1) of so many masses, those below at 0."""
            a = mp.zeros(2 * count + 1)
            for i in range(count):
                a[i, count + i] = 1
                a[count + i, 2 * count] = -1
                for j, other in ((i - 1, i - 1), (i, i + 1)):  # spring j joins i and other
                    if 0 <= j < n - 1:
                        a[count + i, i] -= k[j] / m[i]
                        if other < count:
                            a[count + i, other] += k[j] / m[i]
            return a

        standing, flying = generator(n - 1), generator(n)

        def lacking(*v):
            up = mp.expm(standing * v[n - 1]) * mp.matrix([*v[: n - 1], *[0] * (n - 1), 1])
            launch = mp.matrix([*up[: n - 1], 0, *up[n - 1 : 2 * n - 2], 0, 1])
            middle = mp.expm(flying * v[n]) * launch
            return [k[-1] * up[n - 2] - m[-1], *middle[n : 2 * n]]

        return [float(x) for x in mp.findroot(lacking, [mp.mpf(x) for x in guess])]


def assert_closes(orbit, m, upper, lower) -> None:
    """That an orbit of masses `m`, three, with these forces of the springs is a lossless hop by another integrator."""

    def flight(t, x):
        top, low = upper(x[0] - x[2]), lower(x[2] - x[4])
        return [x[1], -1 - top / m[0], x[3], -1 + (top - low) / m[1], x[5], -1 + low / m[2]]

    def contact(t, x):
        return [*flight(t, [*x, 0, 0])[:4]]

    tight = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13}
    landed = solve_ivp(flight, (0, orbit.flight_time), orbit(0.0), **tight).y[:, -1]
    np.testing.assert_allclose(landed, orbit(0.0) * [1, -1, 1, -1, 1, -1], atol=1e-9)
    back = solve_ivp(contact, (0, orbit.contact_time), landed[:4], **tight).y[:, -1]
    np.testing.assert_allclose(back, orbit(0.0)[:4], atol=1e-9)


@pytest.fixture(scope="module")
def three():
    chain = Chain((1.0, 1.0, 1.0))
    return find_all(chain, chain.starts(8.0, 8.0))


class TestThreeMasses:
    @pytest.mark.slow
    def test_every_hop_that_is_found_is_one(self, three):
        assert len(three) == len({round(orbit.alpha, 9) for orbit in three}) == 11
        for orbit in three:
            mine = rest_and_times(orbit)
            assert mine == pytest.approx(exactly((1, 1, 1), (1, 1), mine), rel=1e-11)
            assert orbit.error < 1e-11

    @pytest.mark.slow
    def test_a_cycle_by_another_integrator(self):
        chain = Chain((2.0, 1.0, 0.5), ["sinh(0.3*r)/0.3", "r + b*r**3"], parameters={"b": 0.02})
        orbit = next(o for o in find_all(chain, chain.starts(6.0, 5.0)) if o.admissible)
        assert_closes(orbit, chain.masses, lambda r: np.sinh(0.3 * r) / 0.3, lambda r: r + 0.02 * r**3)


@pytest.mark.parametrize("mass_ratio", [0.2, 1.0, 5.0])
@pytest.mark.parametrize("spring", ["r", "r + 0.3*r**3"])
def test_two_masses_are_the_hopper(mass_ratio, spring):
    hop = find(Hopper(spring, mass_ratio=mass_ratio))
    scale = np.sqrt(1 + mass_ratio)  # of time: the hopper's clock runs with the vibration in flight
    chain = Chain((1 / mass_ratio, 1.0), spring)
    near = {"liftoff": hop.liftoff_extension, "alpha": 1.001 * hop.alpha * scale}
    times = {"duration": hop.flight_time / 2 / scale, "contact_duration": hop.contact_time / 2 / scale}
    orbit = find(chain, start=near | times)
    assert orbit.alpha / scale == pytest.approx(hop.alpha, abs=1e-13)
    assert orbit.flight_time * scale == pytest.approx(hop.flight_time, rel=1e-13)
    assert orbit.contact_time * scale == pytest.approx(hop.contact_time, rel=1e-13)
    assert orbit.family == hop.family
    loss = hop.certificate.loss_coefficient * scale ** (-1 / 3)
    assert orbit.certificate.loss_coefficient == pytest.approx(loss, rel=1e-11)


def launch_of(orbit) -> dict[str, float]:
    """The unknowns of an orbit's launch, of three masses."""
    return dict(zip(("y1", "y1'", "liftoff", "alpha"), orbit(0.0)[:4], strict=True))


class TestSimulation:
    def test_a_hop_comes_back(self, three):
        orbit = next(o for o in three if o.admissible)
        run = simulate(Chain(), launch_of(orbit), hops=2)
        assert run.status == "done"
        # a launch speed known to rounding is a landing known to the cube root of it, see the local law
        np.testing.assert_allclose(run.events[-1].after, orbit(0.0), atol=1e-8)
        assert sum(event.loss for event in run.events) < 1e-15

    def test_beside_it_the_loss_has_the_local_law(self, three):
        """C d^(4/3) dE/dalpha on the side without a bounce; ten times that on the other, as for two masses."""
        orbit = next(o for o in three if abs(o.alpha - 6.3478627438) < 1e-9)
        assert (orbit.certificate.stable_side, orbit.certificate.bounce_side) == (None, "below")
        assert "(10 C below)" in str(orbit)
        for side, factor, impacts in ((1, 1, 1), (-1, 10, 2)):
            for d in (1e-6, 1e-8):
                run = simulate(Chain(), {**launch_of(orbit), "alpha": orbit.alpha + side * d}, hops=1)
                law = factor * orbit.certificate.loss_coefficient * orbit.alpha * d ** (4 / 3)
                assert sum(event.loss for event in run.events) / law == pytest.approx(1, abs=0.03)
                assert sum(event.kind in ("impact", "landing") for event in run.events) == impacts

    def test_what_is_missing_is_named(self):
        with pytest.raises(InputError, match="a mapping of alpha, y1, y1', but it needs 'y1'"):
            simulate(Chain(), {"alpha": 1.0}, hops=1)
        with pytest.raises(InputError, match="has several numbers"):
            simulate(Chain(), 4.0, hops=1)
        with pytest.raises(InputError, match=r"an array .* 3.* of alpha, y1, y1'"):
            ReturnMap(Chain())(4.0)


class TestStarts:
    @pytest.mark.slow
    def test_every_seed_finds_all_of_three_masses(self):
        counts = [len(Chain().starts(8.0, 8.0, seed=seed)) for seed in (1, 2)]
        assert counts == [11, 11]

    def test_bad_starts_are_named(self, three):
        orbit = three[0]
        for start, telling in (
            (5, "it must be an orbit, or a mapping"),
            ({"alpha": "x"}, "start 'alpha' = 'x'"),
            ({"speed": 1.0}, "start has 'speed'"),
            ({"duration": 1e6}, "must lie between 0 and 10000"),
        ):
            with pytest.raises(InputError, match=telling):
                find(Chain(), start=start)
        with pytest.raises(InputError, match="of another machine"):
            find(Chain((1.0, 1.0, 1.0, 1.0)), start=orbit)
        with pytest.raises(NoOrbit, match="not 7"):
            find(Chain(), 7, start=orbit)
        with pytest.raises(InputError, match="a list of starts"):
            find_all(Chain(), orbit)
        with pytest.raises(InputError, match="half_contact"):
            Chain().starts(-1.0, 3.0)


def test_a_chain_does_not_change():
    given = {"k": 2.0}
    chain = Chain(springs="k*r", parameters=given)
    with pytest.raises(TypeError, match="does not support item assignment"):
        chain.parameters["k"] = 3.0
    given["k"] = 4.0
    assert chain.values["k"] == pickle.loads(pickle.dumps(chain)).values["k"] == 2.0
    assert chain.with_values(k=5.0).values["k"] == 5.0


class TestRefusals:
    @pytest.mark.parametrize(
        ("arguments", "telling"),
        [
            ({"masses": (1.0,)}, "from 2 to 12"),
            ({"masses": (1.0, -1.0)}, "m2 = -1"),
            ({"springs": ["r", "r", "r"]}, "joined by 2 springs, not 3"),
            ({"springs": "bilinear"}, "springs 'bilinear' and 'bilinear' are in pieces: a chain takes one such spring"),
            ({"parameters": {"b": 1.0}}, "no spring has a parameter 'b'; the chain has m1, m2, m3"),
            ({"masses": 3}, "a list of masses"),
            ({"springs": "m1*r", "parameters": {"m1": 1.0}}, "'m1' is a mass"),
            ({"restitution": 2.0}, "restitution"),
        ],
    )
    def test_statements(self, arguments, telling):
        with pytest.raises(InputError, match=telling):
            Chain(**arguments)

    def test_a_hop_needs_a_start(self):
        with pytest.raises(NoOrbit, match="give `find` a start"):
            find(Chain())
        with pytest.raises(InputError, match="start has no 'y1'"):
            find(Chain(), start={"alpha": 1.0, "liftoff": 1.0})
        with pytest.raises(InputError, match="2 numbers"):
            Chain().start([1.0], 1.0, 1.0)
