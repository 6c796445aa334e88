"""The equations of the machines of the paper, and of a chain, written by hand, against those that are derived.

M is the mass ratio, c the damping, d the drag, phi the force of the spring and gamma the gravity, as a share of that at
the ground; energies are in units of m1 g times a length.
"""

import numpy as np
import pytest
from checked_machines import INVERSE_SQUARE, MACHINES

from problems import Chain, Hopper

DERIVED = {
    **{name: MACHINES[name] for name in ("cubic", "damped", "juggler", "varying juggler", "damped juggler")},
    "varying": Hopper("tanh(r) + r", INVERSE_SQUARE, 0.7, 20.0),
    "linear": Hopper(),
    "chain of 2": MACHINES["chain of 2"],
    "chain of 4": Chain([1.0, 2.0, 0.7, 1.4], ["r", "r + 0.1*r**3", "sinh(r)"]),
}


def of_two_masses(machine, x, y, p):
    """M, c, d, and functions of the places: phi, gamma at the ground, and gamma a rest length above."""
    force, gravity, length = machine.spring.expression, machine.varying_gravity, p.get("rest_length", 0.0)
    ground = lambda z: 1 + p["gravity_share"] * (gravity.expression(z, p, []) - 1) if gravity else 1.0  # noqa: E731
    numbers = p["mass_ratio"], p.get("damping", 0.0), p.get("drag", 0.0)
    return *numbers, lambda r: force(r, p, []), ground, lambda z: ground(length + z)


def hopper(machine, x, y, p):
    """Sections 3 and 4: body and foot."""
    M, c, d, phi, gamma, above = of_two_masses(machine, x, y, p)
    pull = phi(x[0] - x[2]) + c * (x[1] - x[3])
    yield (
        "flight",
        [
            *(x[1], -(M * (pull + d * x[1]) + above(x[0])) / (1 + M)),
            *(x[3], (pull - gamma(x[2]) - d * x[3]) / (1 + M)),
        ],
    )
    yield "contact", [y[1], -(M * (phi(y[0]) + (c + d) * y[1]) + above(y[0])) / (1 + M)]
    yield "force", [1 - phi(y[0]) - c * y[1]]
    tension = phi(x[0] - x[2])
    yield (
        "gradient",
        [
            *(M * tension + above(x[0]), (1 + M) * x[1]),
            *(M * (gamma(x[2]) - tension), (1 + M) * M * x[3]),
        ],
    )
    yield "impact", [0.0, 0.0, 0.0, 1.0, M * (1 + M)]


def juggler(machine, x, y, p):
    """Sections 5 and 6: ball and hand."""
    M, c, d, phi, _, above = of_two_masses(machine, x, y, p)
    share = M / (1 + M)
    held = phi(x[2]) + (c + d) * x[3]
    yield "flight", [x[1], -M * d * x[1] - above(x[0]), x[3], -held - above(x[2])]
    yield "contact", [y[1], -share * (phi(y[0]) + (c + 2 * d) * y[1]) - above(y[0])]
    yield "force", [-(phi(y[0]) + (c + (1 - M) * d) * y[1]) / (1 + M)]
    yield "gradient", [above(x[0]), x[1], M * (phi(x[2]) + above(x[2])), M * x[3]]
    yield "impact", [0.0, share, 0.0, share - 1, share]


def chain(machine, x, y, p):
    """Masses on springs, from the top, under gravity 1; the lowest lands."""
    masses, laws = [p[f"m{i + 1}"] for i in range(len(machine.masses))], [law.expression for law in machine.springs]

    def forces(places):
        """On each mass, between the springs above and below it."""
        pulls = [law(a - b, p, []) for law, a, b in zip(laws, places, places[1:], strict=False)]
        return [above - below - m for above, below, m in zip([0.0, *pulls], [*pulls, 0.0], masses, strict=True)]

    flown, stood = forces(x[::2]), forces([*y[::2], 0.0])
    yield "flight", [part for v, f, m in zip(x[1::2], flown, masses, strict=True) for part in (v, f / m)]
    yield "contact", [part for v, f, m in zip(y[1::2], stood, masses, strict=False) for part in (v, f / m)]
    yield "force", [-stood[-1]]
    yield "gradient", [part for v, f, m in zip(x[1::2], flown, masses, strict=True) for part in (-f, m * v)]
    yield "impact", [*[0.0] * (len(x) - 1), 1.0, masses[-1]]


@pytest.mark.parametrize("name", DERIVED)
def test_what_follows_from_mechanics_is_what_one_writes_by_hand(name):
    machine, rng = DERIVED[name], np.random.default_rng(3)
    model, by_hand = machine.model, {"hopper": hopper, "juggler": juggler}.get(getattr(machine, "kind", ""), chain)
    for _ in range(20):
        p = {name: value * rng.uniform(0.5, 1.5) for name, value in machine.values.items()}
        x, y = rng.normal(size=len(model.flight.states)), rng.normal(size=len(model.contact.states))
        derived = {
            "flight": model.flight.field(x, p, []),
            "contact": model.contact.field(y, p, []),
            "force": [model.contact.watch["contact force"](y, p, [])],
            "gradient": model.flight_gradient(x, p, []),
            "impact": [*model.impact(x, p), model.impact_mass(x, p)],
        }
        for part, known in by_hand(machine, x, y, p):
            assert np.array(derived[part], float) == pytest.approx(np.array(known, float), rel=1e-13, abs=1e-13), part
