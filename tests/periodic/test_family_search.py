"""All orbits of a family, orbits of laws with narrow features, and refusals, against facts and scipy's integrator."""

import numpy as np
import pytest

import studies.search
from orbits import InputError, NoOrbit, find, find_all
from orbits.errors import MESSAGES
from orbits.model import Search
from orbits.periodic.family_search import SEARCH, Lateness
from problems import Chain, Hopper, Juggler, knee_hopper, shuttle
from studies.search import Case


def test_both_orbits_beside_a_fold_are_found():
    """At beta = -0.005 one lies before the fold and one after it, toward the barrier."""
    machine = Hopper("cubic", parameters={"beta": -0.005})
    orbits = find_all(machine)
    assert [orbit.alpha for orbit in orbits] == pytest.approx([4.743231, 9.924044], abs=1e-6)
    assert [orbit.known_in_family for orbit in orbits] == [2, 2]
    assert find(machine).alpha == pytest.approx(orbits[0].alpha, rel=1e-13)
    near = find_all(machine.with_values(beta=-0.0106952149), fastest=20)
    assert [orbit.alpha for orbit in near] == pytest.approx([5.832224] * 2, abs=1e-3)
    assert len(find_all(machine, fastest=6.0)) == 1


@pytest.mark.slow
def test_the_lowest_is_found_where_gravity_wiggles():
    """When gravity's variation is brought in, the orbit under constant gravity becomes the fourth of its family."""
    machine = Hopper("r", "1 + A*sin(z/l)", rest_length=10, parameters={"A": 0.9, "l": 1.0})
    orbit = find(machine, 2)
    assert orbit.alpha == pytest.approx(5.7719, abs=1e-4)
    assert orbit.known_in_family >= 4
    case = Case(machine, 2, lambda r: r, lambda z: 1 + 0.9 * np.sin(z), 0.2)
    assert case.holds(orbit.alpha, orbit.flight_time / 2)
    assert case.scanned(orbit.alpha)[0] == pytest.approx(orbit.alpha, rel=1e-3)


def test_a_narrow_peak_where_the_force_is_nearly_flat_is_found():
    """About r = 27 the force comes near to zero: the lateness is above it within 0.015 of the launch speed. Source: the
    integrals of the energy, by Gauss quadrature on both sides of lift-off."""
    law, p = "r + be*r**3 + de*r**5", {"be": -0.002702, "de": 1.8363e-6}
    orbits = find_all(Juggler(law, rest_length=200.0, parameters=p))
    assert [orbit.alpha for orbit in orbits] == pytest.approx([4.6057274, 14.03084402, 14.04497305], abs=1e-8)
    assert {orbit.known_in_family for orbit in orbits} == {3}


def test_fast_launches_of_a_force_that_wiggles_are_resolved():
    """The turning points of fast flights pass a wave of the force within 1.3 of the launch speed. Source: as above."""
    machine = Hopper("tanh(0.1417*r)/0.1417 + 0.3512*sin(0.5939*r)", mass_ratio=3.239, rest_length=600)
    orbits = find_all(machine, family=3, fastest=55.0)
    assert [orbit.alpha for orbit in orbits] == pytest.approx(
        [53.0870024, 53.23528423, 54.40796583, 54.68372521], abs=1e-7
    )


def test_an_orbit_beside_falls_of_another_kind_is_found():
    """Family 2 of this shuttle begins beside launches after which it falls over without its turn, in a range of speeds
    narrower than the samples. Source: the family followed from a gravity ratio of 1."""
    machine = shuttle(inertia_ratio=1.72, gravity_ratio=1.773, spring="asinh(1.646*r)/1.646")
    orbit = find(machine, 2)
    assert orbit.alpha == pytest.approx(1.27675455967, abs=2e-11)
    assert orbit.family == 2


def test_a_search_that_is_stopped_counts_no_orbits(monkeypatch, caplog):
    monkeypatch.setattr("orbits.periodic.family_search.SEARCH", SEARCH._replace(launches=400))
    (orbit,) = find_all(Hopper("cubic"), fastest=1e4)
    assert orbit.known_in_family is None
    assert "family 1 may have more orbits than the 1 found: the search was stopped after" in caplog.text


def test_the_cells_of_many_are_those_of_each_alone():
    """With two orbits, again two, none beside a fold, and none at all."""
    machines = [Hopper("cubic", parameters={"beta": beta}) for beta in (-0.005, -1e-3, -0.0108, -0.1)]
    names, model = tuple(machines[0].values), machines[0].model
    ps, searches = np.array([list(m.values.values()) for m in machines]), [m.model.search(m.values) for m in machines]
    together = Lateness(model, "relative", names, ps, 1, searches).cells()
    for i, cells in enumerate(together):
        (alone,) = Lateness(model, "relative", names, ps[i : i + 1], 1, searches[i : i + 1]).cells()
        (two, _) = Lateness(model, "relative", names, ps[[i, 0]], 1, [searches[i], searches[0]]).cells()
        assert (cells.cells == two.cells).all()
        assert (cells.abouts == two.abouts).all()
        assert cells[2:] == two[2:]
        assert cells.cells == pytest.approx(alone.cells, rel=1e-12)
        assert cells[2:] == alone[2:]
    assert [len(cells.cells) for cells in together] == [2, 2, 0, 0]


@pytest.mark.slow
def test_the_fallback_is_a_search():
    """Under constant gravity this spring does not come back, in falling gravity it does."""
    p = {"a": 0.3, "R": 20.0}
    machine = Hopper("r*exp(a*r)", "1/(1 + z/R)**2", rest_length=10, parameters=p)
    orbit = find(machine)
    assert orbit.known_in_family == 2  # of 29,000 launches up to 30 the lateness changes its sign between no others
    case = Case(machine, 1, lambda r: r * np.exp(0.3 * r), lambda z: 1 / (1 + z / 20) ** 2, 1.0)
    assert case.holds(orbit.alpha, orbit.flight_time / 2)


def test_a_refusal_says_what_was_searched():
    machine = Hopper("cubic", parameters={"beta": -0.0108})
    with pytest.raises(NoOrbit, match=r"does not come back.*; a search from launch speed 0\.001 to 1e\+04 finds none"):
        find(machine)
    with pytest.raises(NoOrbit, match="to 20 finds none"):
        find_all(machine, fastest=20)


@pytest.mark.parametrize("method", ["closed form", "relative"])
def test_no_orbit_beyond_the_fastest_launch(method):
    with pytest.raises(NoOrbit):
        find_all(Hopper(rest_length=20), fastest=2.0, method=method)
    assert len(find_all(Hopper(rest_length=20), fastest=5.0, method=method)) == 1


def test_a_search_that_is_stopped_says_so(monkeypatch):
    monkeypatch.setattr("orbits.periodic.family_search.SEARCH", SEARCH._replace(launches=10))
    with pytest.raises(NoOrbit, match=r"found none so far; it is not complete: it was stopped after \d+ launches"):
        find_all(Hopper("cubic", parameters={"beta": -0.01069521492}), fastest=30)


def test_a_refusal_says_a_remedy_once(monkeypatch):
    machine, reason = Hopper("cubic"), "the solve for family 1 ended on an orbit of family 2; try another method"

    def refused(*_, **__):
        raise NoOrbit(reason)

    monkeypatch.setattr("orbits.periodic.family_orbits.certified_orbit", refused)
    with pytest.raises(NoOrbit) as raised:
        find(machine)
    assert str(raised.value).count("try another method") == 1
    assert "a search from launch speed" in str(raised.value)
    assert len(str(raised.value)) <= MESSAGES.longest


def test_progress_of_a_search():
    shares = []
    machine = Hopper("cubic", parameters={"beta": -0.005})
    assert len(find_all(machine, progress=shares.append)) == 2
    assert shares == [0.0, 0.5]
    find_all(machine, [{"alpha": 4.7, "liftoff": 1.0, "duration": 4.7}] * 2, progress=shares.append)
    assert shares[2:] == [0.0, 0.5]


def test_what_cannot_be_searched():
    with pytest.raises(InputError, match="not both"):
        find_all(Hopper(), [], family=1)
    with pytest.raises(InputError, match="give family="):
        find_all(Hopper(), {"alpha": 4.5})
    with pytest.raises(InputError, match=r"find_all\(machine, starts\(machine\)\) finds its hops"):
        find_all(Chain(masses=(1, 1, 1)), family=1)
    with pytest.raises(InputError, match="a family must be a whole number"):
        find_all(Hopper(), family=0)
    with pytest.raises(InputError, match="fastest"):
        find_all(Hopper("cubic"), fastest=-1.0)


@pytest.mark.slow
def test_random_bumps_and_wiggles_against_a_scan():
    counts = studies.search.main(1, 4, family_count=3)
    assert counts.pop("families") == {"whole": 3}
    for found in counts.values():
        assert found.keys() <= {"lowest", "none, as scanned"}
    assert counts["bumps"]["lowest"] == 1
    assert counts["wiggles"]["lowest"] >= 2


class Given(Lateness):
    """A lateness that is a function of the launch speed up to 59.37, beyond which no turn comes."""

    def __init__(self, function):
        self.function, self.family, self.reduction = function, 1, None
        self.searches, self.scales = [Search(1.0, 0.1, 100.0, True)], np.ones(1)

    def _values(self, alphas, which):
        with np.errstate(invalid="ignore"):
            late = np.where(alphas < 59.37, self.function(alphas), SEARCH.latest_turn * (1 + alphas))
        return late, np.zeros(len(alphas), int)


def test_flights_that_break_off_are_no_orbits():
    """A lateness that jumps over zero is passed over; one that crosses it as a logarithm or as a root is not, however
    near to where it ends."""
    (cells,) = Given(lambda a: -1 - 0.1 * a).cells()
    assert not len(cells.cells)
    for function, root in (
        (lambda a: -1 - 0.06 * np.log(59.37 - a), 59.37 - np.exp(-1 / 0.06)),
        (lambda a: -1 + 0.008 * (59.37 - a) ** -0.25, 59.37 - 0.008**4),
        (lambda a: -100 * (a - 59.359), 59.359),
    ):
        (cells,) = Given(function).cells()
        assert ((cells.cells[:, 0] <= root) & (root <= cells.cells[:, 1])).sum() == 1


@pytest.mark.slow
def test_a_knee_that_is_straightened_is_no_orbit():
    """Beyond a launch speed the knee of a flight becomes straight, where its equation of motion ends."""
    machine = knee_hopper(link=0.25, stiffness=20.0, rest_angle=1.8, body_mass=6.0, foot_mass=1.0).dimensionless()
    p = machine.values
    lateness = Lateness(machine.model, "half orbit", tuple(p), np.array([[*p.values()]]), 1, [machine.model.search(p)])
    (cells,) = lateness.cells()
    assert len(cells.cells) == 1
    assert np.isnan(lateness(np.array([43.7]))[1][0])
    assert find(machine).known_in_family == 1
