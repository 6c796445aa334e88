"""Branches of hops whose launches are several numbers, with and without a statement of their hops."""

import numpy as np
import pytest
from columns import hop_of

from orbits import InputError, NoOrbit, ReturnMap, bifurcations
from orbits.curves import Event
from orbits.returns.hop_tracer import FlownTracer
from orbits.returns.launch_cycles import MapsAlong
from problems import Hopper, chain_hand


def test_without_a_statement_of_the_hops_too():
    maps = MapsAlong(Hopper(), "inject", 0.066, 0.078, 0.0, 1000)
    tracer = FlownTracer(maps, (4.3, 5.0), 1, ())
    launch = ReturnMap(Hopper(), inject=0.066).fixed_points(4.5, 4.6)[0].alpha
    events = [item for item in tracer.trace(tracer.start(np.array([[launch]]), 0.066), 1) if isinstance(item, Event)]
    assert [event.kind for event in events] == ["flip"]
    assert events[0].point.value == pytest.approx(0.071587384137, abs=1e-11)
    first = FlownTracer(maps, (4.3, 5.0), 2, ()).start_beside_flip(events[0].point)
    assert first.alphas == pytest.approx(ReturnMap(Hopper(), inject=first.value)(first.alphas).next[::-1], rel=1e-9)


@pytest.mark.slow
def test_a_pair_of_multipliers_crosses_the_unit_circle():
    machine, orbit = hop_of("chain_hand")
    shares = []
    diagram = bifurcations(machine, "inject", (0.02, 0.03), (2.5, 3.2), starts=[orbit], progress=shares.append)
    (event,) = diagram.events
    branch = diagram.branches[event.branch]
    assert event.kind == "Neimark-Sacker"
    at = int(np.argmin(np.abs(branch.values - event.value)))
    launch, spectrum = branch.launches[at, 0], branch.spectra[at] @ [1, 1j]
    h, step = 1e-4, ReturnMap(machine, inject=event.value)
    around = step(launch + h * np.array([-2, -1, 1, 2])[:, None, None] * np.eye(3)).next
    slopes = ((around[0] - 8 * around[1] + 8 * around[2] - around[3]) / (12 * h)).T
    moduli = np.sort(np.abs(np.linalg.eigvals(slopes)))
    assert np.abs(moduli - 1).min() <= 1e-6
    assert np.sort(np.abs(spectrum)) == pytest.approx(moduli, abs=1e-6)
    assert step(launch).next == pytest.approx(launch, rel=1e-10)
    assert "a pair of multipliers exp(+-i 2.7" in event.note
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert "Neimark-Sacker" in str(diagram)
    assert diagram.plot().figure


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "give starts="), ({"starts": [(6.3, -1.2, 1.0)], "attractor": 5}, "attractor = 5"),
    ],
)  # fmt: skip
def test_refusals(options, message):
    with pytest.raises(InputError, match=message):
        bifurcations(chain_hand((1, 1, 1)), "inject", (0.01, 0.02), (2.5, 3.2), **options)
    with pytest.raises(InputError, match=r"starts = \[\]; it must be a list of launches"):
        bifurcations(chain_hand((1, 1, 1)), "inject", (0.01, 0.02), (2.5, 3.2), starts=[])
    with pytest.raises(InputError, match="leave starts out"):
        bifurcations(Hopper(), "inject", (0.01, 0.02), (4.4, 4.7), starts=[4.5])


def test_starts_that_lead_nowhere_are_said_to_and_nothing_of_other_hops():
    machine, orbit = hop_of("chain_hand")
    with pytest.raises(NoOrbit, match=r"to hops that come back: inject = -0\.01 removes energy"):
        bifurcations(machine, "inject", (-0.02, -0.01), (2.5, 3.2), starts=orbit, sections=2)
