"""Wrong closed forms and reductions of a model are named."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import slow_after

from tests.consistency.checked_machines import MACHINES, at, named


def of_reduction(reduction):
    """What may be wrong of a reduction, one part of it in each case."""
    (arc,) = reduction.statement.arcs
    yield {"complete": lambda *given: 1.01 * reduction.complete(*given)}
    yield {"complete": lambda times, c, u, p: reduction.complete(1.01 * times, c, u, p)}
    yield {"gap_slope": lambda times, dz, p: -reduction.gap_slope(times, dz, p)}
    yield {"gap_slope": lambda times, dz, p: 1.01 * reduction.gap_slope(times, dz, p)}
    yield {"reversor": (1, 1)}
    arcs = [
        {"start": lambda u, before, p: [1.01 * u["liftoff"], u["alpha"]]},
        {"duration": lambda u, p: 1.01 * u["alpha"]},
        {"conditions": lambda u, x, p: [x[1] - 0.01]},
        {"guard": lambda u, x, p, q: [arc.guard(u, x, p, q)[0] + 0.01]},
        {"phase": replace(arc.phase, field=at(arc.phase.field, 1, 1.01))},
    ]
    for changes in arcs:
        yield {"statement": replace(reduction.statement, arcs=(replace(arc, **changes),))}
    if reduction.exact:
        yield {"exact": lambda family, p: ({**reduction.exact(family, p)[0], "alpha": 4.5}, 1e-15)}
        yield {"exact": lambda family, p: (reduction.exact(family, p)[0], -1.0)}


@pytest.mark.parametrize("kind", slow_after(2, ["hopper", "cubic", "juggler"]))
def test_wrong_short_cuts_are_named(kind):
    machine = MACHINES[kind]
    model = machine.model
    for i, changes in enumerate(of_reduction(model.reduction)):
        (part,) = changes
        if part == "statement" and changes["statement"].arcs[0].phase is not model.reduction.statement.arcs[0].phase:
            part = "phase"
        wrong = replace(model, reduction=replace(model.reduction, **changes))
        assert named(machine, wrong) == (f"reduction.{part}",), i
    if model.flight.closed_form is None:
        return
    form = model.flight.closed_form
    faster = lambda p: replace(form(p), squares=1.01 * form(p).squares)  # noqa: E731
    wrong = replace(model, flight=replace(model.flight, closed_form=faster))
    assert named(machine, wrong) == ("flight.closed_form",)
    stood = model.contact.closed_form
    wrong_parts = {"squares": np.array([1.01]), "loads": np.ones(1), "watch": {"contact force": ((1.0, 0.0), 0.0)}}
    for name, part in wrong_parts.items():
        form = lambda p, name=name, part=part: replace(stood(p), **{name: part})  # noqa: E731
        contact = replace(model.contact, closed_form=form)
        assert named(machine, replace(model, contact=contact)) == ("contact.closed_form",)
