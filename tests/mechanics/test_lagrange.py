"""What is derived from mechanics is what one writes by hand."""

import numpy as np
import pytest

from problems import Chain, Hopper
from tests.consistency.by_hand import written
from tests.consistency.checked_machines import INVERSE_SQUARE, MACHINES

DERIVED = {
    **{name: MACHINES[name] for name in ("cubic", "damped", "juggler", "varying juggler", "damped juggler")},
    "varying": Hopper("tanh(r) + r", INVERSE_SQUARE, 0.7, 20.0),
    "linear": Hopper(),
    "chain of 2": MACHINES["chain of 2"],
    "chain of 4": Chain([1.0, 2.0, 0.7, 1.4], ["r", "r + 0.1*r**3", "sinh(r)"]),
}


@pytest.mark.parametrize("name", DERIVED)
def test_what_follows_from_mechanics_is_what_one_writes_by_hand(name):
    machine, rng = DERIVED[name], np.random.default_rng(3)
    derived, hand = machine.model, written(machine)
    plain = (
        "reversor",
        "embed",
        "extension",
        "contact_speed",
        "launch_unknowns",
        "springs",
        "homotopy",
        "conservative",
    )
    for field in plain:
        assert np.array_equal(getattr(derived, field), getattr(hand, field)), field
    for _ in range(20):
        p = {name: value * rng.uniform(0.5, 1.5) for name, value in machine.values.items()}
        x, y = rng.normal(size=len(hand.flight.states)), rng.normal(size=len(hand.contact.states))
        u = dict(zip(hand.launch_unknowns, np.abs(rng.normal(size=len(hand.launch_unknowns))), strict=True))
        closed = hand.embed @ y

        def values(model, x=x, y=y, u=u, p=p, closed=closed):
            """What each function of a model gives at one state; landings where the gap is closed."""
            apart = model.separation(p)
            yield "flight", model.flight.field(x, p, [])
            yield "contact", [*model.contact.field(y, p, []), model.contact.watch["contact force"](y, p, [])]
            yield "gradient", [*model.flight_gradient(x, p, []), *model.contact_gradient(y, p, [])]
            yield "launch", [*model.launch(u, p), *model.touchdown(u, p), *model.liftoff(u, p, [])]
            yield "landing", model.landing(u, closed, p)
            yield "impact", [*model.impact(x, p), model.impact_mass(x, p)]
            yield "heights", [height(x) for height in model.heights(p).values()]
            yield "distances", [model.gap(p)(x), *([apart(x)] if apart else [])]
            if model.one_speed:
                yield "release", model.release(np.array([0.5, 2.0]), machine.values)

        for (field, found), (_, known) in zip(values(derived), values(hand), strict=True):
            assert np.array(found, float) == pytest.approx(np.array(known, float), rel=1e-13, abs=1e-13), field
        assert derived.heights(p).keys() == hand.heights(p).keys()
