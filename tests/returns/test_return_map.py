"""The return map against stored values, 45-digit arithmetic, its local law, the simulator and differences."""

import json

import numpy as np
import pytest
from conftest import DATA, slow_after

from orbits import InputError, NoOrbit, ReturnMap, find, multiplier, simulate, time_limit
from problems import Hopper, Juggler, hopper_in_si, rimless_wheel
from studies.oracle import landed

STORED = json.loads((DATA / "return_map.json").read_text(encoding="utf-8"))
ALPHA = 4.493409457909064


@pytest.mark.parametrize("stored", STORED, ids=lambda s: f"M={s['mass_ratio']},alpha={s['alpha']}")
def test_stored_values(stored):
    hops = ReturnMap(Hopper(mass_ratio=float(stored["mass_ratio"])))(float(stored["alpha"]))
    assert hops.loss == pytest.approx(float(stored["loss"]), rel=1e-13)
    assert hops.impacts == stored["impacts"]
    assert hops.status == stored["status"]
    if stored["next"]:
        assert hops.next == pytest.approx(float(stored["next"]), abs=1e-13)
    else:
        assert np.isnan(hops.next)


@pytest.mark.parametrize("mass_ratio", slow_after(3, [1e-3, 0.1, 1.0, 10.0, 1e3]))
def test_the_loss_beside_a_lossless_orbit(mass_ratio):
    """Relative accuracy falls with the distance only as rounding of the launch speed makes it."""
    distances = np.array([side * 10.0**-k for side in (1, -1) for k in range(1, 13)])
    alphas = ALPHA + distances
    hops = ReturnMap(Hopper(mass_ratio=mass_ratio))(alphas)
    for alpha, distance, loss, impacts in zip(alphas, distances, hops.loss, hops.impacts, strict=True):
        expected, count = landed(alpha, mass_ratio)
        assert loss == pytest.approx(expected, rel=1e-13 + 1e-15 / abs(distance))
        assert impacts == count


@pytest.mark.parametrize(
    "machine",
    [
        Hopper(), Hopper(mass_ratio=0.05), Juggler(mass_ratio=3.0), Hopper("sinh(0.3*r)/0.3"),
        Hopper("r + 0.02*r**2"), Hopper("bilinear", parameters={"ratio": 2.0}), Juggler("r + 0.05*r**3"),
        Hopper("r", "1/(1 + z/R)**2", rest_length=12.0, parameters={"R": 200.0}),
    ],
    ids=lambda m: f"{m.kind} {m.spring.text} {m.gravity.text} {m.mass_ratio:g}".replace(" ", "_"),
)  # fmt: skip
def test_the_local_law(machine):
    """alpha* + d goes to alpha* + d - C d**(4/3), ten times as much is lost on the other side, with one bounce more."""
    orbit = find(machine)
    c, side = orbit.certificate.loss_coefficient, 1 if orbit.certificate.bounce_side == "below" else -1
    d = np.array([1e-5, 1e-6])
    for sign, factor, impacts in ((side, 1.0, 1), (-side, 10.0, 2)):
        hops = ReturnMap(machine)(orbit.alpha + sign * d)
        lost = hops.loss / (orbit.alpha + hops.next)  # alpha - next
        assert hops.impacts.tolist() == [impacts] * 2
        exponent = np.log(lost[0] / lost[1]) / np.log(10)
        assert exponent == pytest.approx(4 / 3, abs=0.02)
        measured = 2 * lost / (factor * c * d ** (4 / 3))  # extrapolated in the next power, d**(1/3)
        limit = (10 ** (1 / 3) * measured[1] - measured[0]) / (10 ** (1 / 3) - 1) / 2
        assert limit == pytest.approx(1.0, rel=0.02)


def test_lossless_hops_do_not_drift_however_many():
    """Losses below half a unit in the last place vanish, and the root of a rounded square is the number itself.

    So beside a lossless orbit a hop gives back every launch speed to the last bit, and so does a million of them.
    """
    alpha = find(Hopper()).alpha + 8.9e-16 * np.arange(-50, 50)
    assert (ReturnMap(Hopper())(alpha).next == alpha).all()


class TestInjection:
    EPS = 0.071587384137

    def test_the_pair_and_where_its_upper_one_loses_stability(self):
        low, high = ReturnMap(Hopper(), inject=self.EPS).fixed_points(4, 6)
        assert low.alpha == pytest.approx(4.481341946645, abs=1e-11)
        assert high.alpha == pytest.approx(4.541763272853, abs=1e-11)
        assert multiplier(Hopper(), high.alpha) == high.multiplier == pytest.approx(-1, abs=1e-9)
        step, d = ReturnMap(Hopper(), inject=self.EPS), 1e-5
        for point in (low, high):
            (before, after) = step(point.alpha + np.array([-d, d])).next
            assert point.multiplier == pytest.approx((after - before) / (2 * d), rel=1e-5)


def test_lossless_fixed_points_are_those_of_find():
    found = ReturnMap(Hopper()).fixed_points(1, 12)
    assert [point.alpha for point in found] == [find(Hopper(), n).alpha for n in (1, 2, 3)]
    assert {(point.kind, point.multiplier) for point in found} == {("lossless", None)}


def test_what_is_no_launch_speed_in_an_array_is_said_of_it_alone():
    wrong = np.array([[4.6, np.nan], [-1.0, 0.0], [np.inf, 2.0]])
    hops, good = ReturnMap(Hopper())(wrong), ReturnMap(Hopper())([4.6, 2.0])
    assert hops.status.tolist() == [["lifts_off", "invalid"], ["invalid", "invalid"], ["invalid", "rests"]]
    assert hops.next[[0, 2], [0, 1]] == pytest.approx(good.next, abs=0, nan_ok=True)
    assert np.isnan(hops.next[hops.status == "invalid"]).all()
    assert hops.document()["alpha"][1] is None
    assert ReturnMap(Hopper())([np.nan]).status == ["invalid"]


@pytest.mark.parametrize(
    "machine",
    [
        Hopper(), Hopper(mass_ratio=10.0), Hopper("r + 0.1*r**3", rest_length=20.0), Juggler(), Hopper("bilinear"),
        Hopper(restitution=0.5), Hopper(damping=0.03, drag=0.02), Juggler("r + 0.1*r**3", damping=0.02),
        Hopper("r", "1/(1 + z/R)**2", rest_length=20.0, parameters={"R": 80.0}),
    ],
)  # fmt: skip
def test_map_and_simulation_agree(machine):
    for alpha in (2.0, 4.0, 4.6, 7.0):
        hops, run = ReturnMap(machine)(alpha), simulate(machine, alpha, hops=1)
        impacts = [event for event in run.events if event.kind != "lift-off"]
        assert len(impacts) == hops.impacts
        assert run.status == ("done" if hops.status == "lifts_off" else hops.status)
        if run.status == "done":
            assert run.launches[-1] == pytest.approx(float(hops.next), rel=1e-11)


@pytest.mark.slow
def test_a_simulation_ends_where_the_map_is_undecided():
    machine = Hopper(restitution=0.9)
    run = simulate(machine, 6.498522512839427, hops=1)
    assert run.status == str(ReturnMap(machine)(6.498522512839427).status) == "undecided"
    assert run.events[-1].kind == "landing"
    assert simulate(machine, 2.0, hops=1).status == "done"
    # Of a start in flight the map tells nothing.
    assert simulate(machine, state=run(1.0), hops=1).status != "undecided"


def test_what_cannot_be_meant():
    with pytest.raises(InputError, match="alpha = -1; launch speeds must be above 0"):
        ReturnMap(Hopper())(-1.0)
    with pytest.raises(InputError, match="is not a machine"):
        ReturnMap(3)
    with pytest.raises(InputError, match="cap = 0"):
        ReturnMap(Hopper(), cap=0)
    with pytest.raises(InputError, match="damping = -1 is below 0"):
        Hopper(damping=-1.0)
    with pytest.raises(NoOrbit, match="damped machine loses energy"):
        find(Hopper(damping=0.1))
    assert ReturnMap(Hopper(mass_ratio=1e3), cap=10)(3.4).status == "cap"


def test_the_smallest_separation_of_a_hop():
    """The contact of the linear hopper with equal masses swings about r = -1, from the launch at r = 1 of speed `next`:
    its lowest extension is -1 - sqrt(4 + 2 next**2)."""
    machine, speeds = Hopper(rest_length=5.0), np.array([4.25, 4.6, 8.0])
    step = ReturnMap(machine)
    lowest = -1 - np.sqrt(4 + 2 * step(speeds).next ** 2)
    assert step.smallest_separation(speeds) == pytest.approx(5.0 + lowest, rel=1e-12)
    assert step.smallest_separation(3.0) > 0
    assert np.isnan(step.smallest_separation(0.0))
    assert ReturnMap(Hopper()).smallest_separation(4.6) is None
    metre = hopper_in_si(1.0, 1.0, stiffness=9.81, surface_gravity=9.81, rest_length=5.0)
    speed = 1.01 * find(metre).alpha
    lowest = -1 - np.sqrt(4 + ReturnMap(metre)(speed).next ** 2 / 9.81)
    assert ReturnMap(metre).smallest_separation(speed) == pytest.approx(5.0 + lowest, rel=1e-9)
    for point in ReturnMap(machine, inject=0.03).fixed_points(4, 5):
        assert point.smallest_separation == pytest.approx(4 - np.sqrt(4 + 2 * (point.alpha - 0.03) ** 2), rel=1e-9)


def test_a_search_among_hops_without_end_says_so():
    """A wheel rolls down a slope of 0.08: each hop has as many impacts as the map allows, 10,000."""
    wheel = rimless_wheel(1.0, 1.0, 8, inertia=1.5, body_inertia=1.0, stiffness=50.0, slope=0.08)
    with pytest.raises(NoOrbit, match=r"more than 0.3 s.*10000 impacts; give it a smaller cap"), time_limit(0.3):
        ReturnMap(wheel).fixed_points(0.2, 4.0)
