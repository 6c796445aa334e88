"""Mechanisms that step: against models written by hand, forces on a slope by hand, and what does not turn back."""

import math

import pytest
from conftest import slow_after
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk
from steps import SINES, TABLE, by_hand, start_of, stepping

from orbits import InputError, Mechanism, check, find
from orbits.mechanics import Mass, Potential, Spring
from problems.laws import springs

TURNED = {"theta": "2*angle - theta", "phi": "2*angle - phi"}
NEXT = {"theta": "theta - 2*angle", "phi": "phi - 2*angle"}
FEET = {"rear foot": "theta", "front foot": "2*angle - theta"}


def walker(*elements, **changes) -> Mechanism:
    """A rimless wheel with an inner body on a spring."""
    stated = {
        "inertia": {"phi": 1.0, "theta": 1.25},
        "parameters": {"angle": 0.3, "weight": 0.5},
        "reversor": TURNED,
        "symmetry": NEXT,
        "gaps": FEET,
    }
    usual = elements or (Spring("phi - theta"), Potential("weight*cos(theta - angle)"))
    return Mechanism(("phi", "theta"), list(usual), **{**stated, **changes})


@pytest.mark.parametrize(
    ("kind", "law", "sine"), [*((kind, "r", False) for kind in TABLE), *((k, law, True) for k, law, _ in SINES)]
)
def test_a_mechanism_has_the_model_that_is_written_by_hand(kind, law, sine):
    angle = 0.3 if sine else 1.0
    hand, own = by_hand(kind, law, sine)(0.8, 0.5, angle), stepping(kind, 0.8, 0.5, angle if sine else None, law)
    p, q, x, u = hand.values, own.values, [0.4, -0.3, 0.2, 0.7], {"liftoff": 0.3, "alpha": 1.1}
    a, b = hand.model, own.model
    assert b.flight.field(x, q, []) == pytest.approx([float(each) for each in a.flight.field(x, p, [])], rel=1e-14)
    assert b.contact.field(x[:2], q, []) == pytest.approx(a.contact.field(x[:2], p, []), rel=1e-14)
    assert a.contact.watch.keys() == b.contact.watch.keys()
    for name, force in a.contact.watch.items():
        assert b.contact.watch[name](x[:2], q, []) == pytest.approx(float(force(x[:2], p, [])), rel=1e-14)
    assert (a.reversor, a.symmetry) == (b.reversor, b.symmetry)
    for one, other in ((a.reversal, b.reversal), (a.relabelling, b.relabelling)):
        assert one.image(x, p) == pytest.approx(other.image(x, q))
    assert a.contact_reversal.image(x[:2], p) == pytest.approx(b.contact_reversal.image(x[:2], q))
    assert b.touchdown(u, q) == pytest.approx(a.touchdown(u, p))
    assert (a.landing_gap is None) == (b.landing_gap is None)
    if a.landing_gap:
        assert b.landing_gap(q) == a.landing_gap(p)


@pytest.mark.parametrize("kind", TABLE)
def test_straight_lines_need_no_integration(kind):
    for (mu, kappa, family), (half, speed, contact) in TABLE[kind].items():
        machine = stepping(kind, mu, kappa)
        assert machine.model.flight.closed_form
        orbit = find(machine, start=start_of(kind, mu, kappa, family))
        assert (orbit.flight_time / 2, orbit.alpha) == pytest.approx((half, speed), rel=0, abs=1e-14 + 1e-15 * half)
        assert orbit.contact_time == pytest.approx(contact, rel=0, abs=1e-13)


def test_two_inner_bodies_step_together():
    """The launch has more unknowns than a speed; the inner bodies take each other's places in no step."""
    turned = {"inner": "2*angle - inner", **TURNED}
    machine = Mechanism(
        ("inner", "phi", "theta"),
        [Spring("phi - theta", "r"), Spring("inner - phi", "2*r + r**3"), Potential("weight*cos(theta - angle)")],
        inertia={"inner": 0.2, "phi": 1.0, "theta": 1.25}, parameters={"angle": 0.3, "weight": 0.5},
        reversor=turned, symmetry={"inner": "inner - 2*angle", **NEXT}, gaps=FEET,
    )  # fmt: skip
    assert check(machine).largest < 1
    assert not machine.model.one_speed


def test_a_reversor_may_flip_some_places_and_not_others():
    """A hopper beside a Duffing oscillator q'' = -(w q + q^3) that nothing drives: q passes 0 in mid-flight and in
    mid-contact, so that its period is the cycle's (amplitude and motion by elliptic functions)."""
    masses = [Mass("y", 1.0), Mass("z", 1.0), Spring("y - z", "r + 0.3*r**3")]
    hop = find(Mechanism(("y", "z"), masses, gap="z", counts="y - z", launch="y"))
    cycle = hop.flight_time + hop.contact_time
    w = 0.8 * (2 * math.pi / cycle) ** 2
    period = lambda a: 4 * ellipk(a * a / (2 * (w + a * a))) / math.sqrt(w + a * a)  # noqa: E731
    size = brentq(lambda a: period(a) - cycle, 1e-3, 10.0, xtol=1e-15)
    rate, m = math.sqrt(w + size**2), size**2 / (2 * (w + size**2))
    sn, cn, dn, _ = ellipj(rate * hop.contact_time / 2 - ellipk(m), m)
    both = Mechanism(
        ("y", "q", "z"), [*masses, Spring("q", "w*r + r**3")], gap="z", counts="y - z", launch="y",
        inertia={"q": 1.0}, parameters={"w": w}, reversor={"q": "-q"},
    )  # fmt: skip
    assert both.model.reversor == (1, -1, -1, 1, 1, -1)
    start = {"liftoff": hop.liftoff_extension, "alpha": 1.01 * hop.alpha, "q": 0.95 * size * cn, "q'": 0.25}
    times = {"duration": hop.flight_time / 2, "contact_duration": hop.contact_time / 2}
    orbit = find(both, start=start | times)
    assert (orbit.alpha, orbit.flight_time) == pytest.approx((hop.alpha, hop.flight_time), rel=1e-13)
    assert orbit(0.0).tolist()[2:4] == pytest.approx([size * cn, -size * rate * sn * dn], rel=1e-11)
    assert orbit(hop.flight_time / 2)[2] == pytest.approx(0.0, abs=1e-13)
    assert orbit(hop.flight_time).tolist()[2:4] == pytest.approx([-size * cn, -size * rate * sn * dn], rel=1e-11)
    assert orbit.admissible


def test_the_forces_on_both_feet_on_a_slope():
    """A wheel on a slope s: about each foot, the moment of the weight and of the spring."""
    angle, slope, weight = 0.3, 0.1, 2.0
    machine = walker(
        Spring("phi - theta", "3*r"), Potential("weight*cos(theta - angle - slope)"),
        parameters={"angle": angle, "slope": slope, "weight": weight}, reversor=None,
    )  # fmt: skip
    model, p = machine.model, machine.values
    assert model.reversor is None
    assert model.landing_gap(p).at([0.0, 0.0, 0.25, 0.0]) == pytest.approx(2 * angle - 0.25)
    for r in (-0.4, 0.0, 0.7):
        opens = -weight * math.sin(-angle - slope) - 3 * r  # about the front foot
        landed = weight * math.sin(angle - slope) + 3 * r  # about the rear one
        forces = [force([r, 0.9], p, []) for force in model.contact.watch.values()]
        assert forces == pytest.approx([opens, landed], rel=1e-14)
    assert check(machine).largest < 1


@pytest.mark.parametrize("kind", slow_after(1, [*TABLE]))
def test_a_law_in_pieces_is_taken_where_it_is_odd(kind):
    rows = [-2.0, -1.0, 0.0, 1.0, 2.0], [-3.0, -1.2, 0.0, 1.2, 3.0]
    for law in (springs.end_stops(gap=0.1, stop=2.0), springs.table(rows, noise=0)):
        machine = stepping(kind, 0.8, 0.4, 0.3, law)
        assert check(machine).largest < 1
    for law in (springs.bilinear(), springs.table((rows[0], [-2.9, *rows[1][1:]]), noise=0)):
        with pytest.raises(InputError, match="is not odd, and its extension changes its sign on a step"):
            _ = stepping(kind, 0.8, 0.4, 0.3, law).model


@pytest.mark.parametrize(
    ("change", "telling"),
    [
        ({"reversor": {"theta": "2*theta"}}, "reversor of 'theta': '2\\*theta' must be the coordinate"),
        ({"reversor": {"theta": "phi"}}, "swap two coordinates, use their sum and their difference"),
        ({"reversor": {"phi": "phi + angle"}}, "reversor of 'phi': applied twice, it must lead back to 'phi'"),
        ({"reversor": {"thet": "theta"}}, "reversor: there is no coordinate 'thet'; did you mean 'theta'"),
        ({"symmetry": {"theta": "theta - theta**2"}}, "symmetry of 'theta'"),
        ({"symmetry": {"theta": "theta - angle"}}, "the gap that lands to gap 'theta'"),
        ({"symmetry": {"theta": "theta - 2*angle"}}, "motions in contact are not reversed by the reversor and the"),
        ({"gaps": {"rear": "theta", "front": "angle - theta"}}, "gap 'front' = 'angle - theta' is not the image of"),
        ({"gaps": {"rear": "theta", "front": "theta*phi"}}, "gap 'front' = 'theta\\*phi' is not the image of"),
        ({"gaps": {**FEET, "third": "phi"}}, "a machine that steps must have two gaps"),
        ({"gaps": {}}, "gap = '', gaps = {}: state either gap=, or gaps= by name"),
        ({"gap": "phi"}, "gap = 'phi', gaps = .*: state either gap=, or gaps="),
        ({"reversor": {"theta": "2*angle - theta"}}, "not reversed by the reversor, because of the spring 'r'"),
        ({"inertia": [[1.0, "0.1*theta"], ["0.1*theta", 1.25]]}, "by the reversor, because of the inertia"),
    ],
)  # fmt: skip
def test_what_does_not_step_is_refused(change, telling):
    with pytest.raises(InputError, match=telling):
        _ = walker(**change).model


@pytest.mark.parametrize(
    ("elements", "telling"),
    [
        ((Spring("phi - theta"), Potential("weight*cos(theta - angle) + 0.1*theta")), "Potential.*reversor=None"),
        (
            (Spring("phi - theta", "r + r**2"), Potential("weight*cos(theta - angle)")),
            r"the spring 'r \+ r\*\*2' along 'phi - theta': give a spring whose extension changes its sign an odd law",
        ),
        (
            (Spring("phi - theta"), Spring("phi", "0.1*r"), Potential("weight*cos(theta - angle)")),
            r"the spring '0\.1\*r' along 'phi'",
        ),
    ],
)
def test_forces_that_are_not_turned_are_named(elements, telling):
    with pytest.raises(InputError, match=telling):
        _ = walker(*elements).model


@pytest.mark.parametrize("law", slow_after(1, ["r", "r + r**3"]))
def test_decimals_in_maps_and_forces_are_exact(law):
    """An inner angle that is counted from 0.1 beside its rest, and gravity about an angle that is a decimal."""
    shifted = walker(
        Spring("phi - theta - 0.1", law), Potential("weight*cos(theta - 0.3)"),
        reversor={"theta": "0.6 - theta", "phi": "0.6 + 0.2 - phi"}, gaps={"rear foot": "theta"},
        symmetry={"theta": "theta - 0.6", "phi": "phi - 0.6"}, parameters={"weight": 0.5},
    )  # fmt: skip
    usual = walker(Spring("phi - theta", law), Potential("weight*cos(theta - angle)"))
    assert find(shifted).alpha == pytest.approx(find(usual).alpha, rel=1e-13)
