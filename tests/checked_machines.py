"""Machines that are checked, of every kind and with every kind of element."""

from orbits import Mechanism
from orbits.mechanics import Ground, Inerter, Mass, Spring
from problems import (
    Actuated,
    Chain,
    Hopper,
    Juggler,
    alternating_hopper,
    chain_hand,
    hopper_in_si,
    inerter_hopper,
    juggler_in_si,
    knee_hopper,
    plate_hopper,
    rimless_wheel,
    rocking_block,
    runner,
    shuttle,
)
from problems.laws import springs

INVERSE_SQUARE = "1/(1 + z/90)**2"
MACHINES = {
    "hopper": Hopper(),
    "cubic": Hopper("r + 0.3*r**3", mass_ratio=2.0, rest_length=20.0, restitution=0.3),
    "varying": Hopper("tanh(r) + r", INVERSE_SQUARE, 0.7, 20.0),
    "in pieces": Hopper(springs.bilinear(ratio=2.0), rest_length=20.0),
    "damped": Hopper("r + 0.1*r**3", damping=0.1, drag=0.03),
    "lossy": Hopper(springs.lossy("r + 0.1*r**3", loss_factor=0.1)),
    "juggler": Juggler(mass_ratio=3.0, rest_length=9.0),
    "varying juggler": Juggler("r + 0.2*r**3", INVERSE_SQUARE, 2.0, 20.0),
    "damped juggler": Juggler("r", mass_ratio=3.0, damping=0.1, drag=0.05),
    "chain of 2": Chain([1.0, 2.0], "r + r**3"),
    "chain of 3": Chain([1.0, 2.0, 0.7], ["r", "r + 0.1*r**3"]),
    "actuated": Actuated(Hopper("r + 0.1*r**3", mass_ratio=2.0)),
    "actuated juggler": Actuated(Juggler("r", INVERSE_SQUARE, 1.0, 20.0)),
    "in SI": hopper_in_si(10.0, 1.0, stiffness=1e4, rest_length=0.5),
    "juggler in SI": juggler_in_si(1.0, 0.2, force="k*r + b*r**3", parameters={"k": 900.0, "b": 4e4}),
    "actuated in SI": Actuated(hopper_in_si(10.0, 1.0, stiffness=1e4, rest_length=0.5)),
    "inerter": inerter_hopper("r + 0.1*r**3", body_mass=1.3, rest_length=20.0),
    "inerter in SI": inerter_hopper(
        "k*r", body_mass=60.0, foot_mass=3.0, inertance=20.0, surface_gravity=9.81, parameters={"k": 5e3}, in_si=True
    ),
    "bent inerter": Mechanism(  # the extension at lift-off depends on the launch speed
        ("a", "b"),
        [Mass("a", 1.0), Mass("b", 1.0), Inerter("a - b + (a - b)**2/10", 0.3), Spring("a - b", "r")],
        gap="b",
        gravity=1.0,
    ),
    "knee": knee_hopper(link=0.5),  # its inertia depends on the angle
    "plate": plate_hopper(),
    "hand of a chain": chain_hand(),
    "yielding ground": Hopper(ground=Ground(mass=2.0, spring=5.0)),
    "soil in SI": hopper_in_si(
        60.0, 3.0, stiffness=8000.0, ground=Ground(20.0, "k*r + b*r**3"), parameters={"k": 2e5, "b": 1e9}
    ),
    "wheel": rimless_wheel(angle=0.3, spring="r + r**3"),
    "wheel in SI": rimless_wheel(2.0, 0.4, 8, 0.5, 0.6, 20.0),
    "wheel on a slope": rimless_wheel(2.0, 0.4, 8, 0.5, 0.6, 20.0, slope=0.05),
    "rocking block": rocking_block(angle=0.3, spring="r + r**3"),
    "shuttle": shuttle(angle=0.3, spring="r + r**3"),
    "runner": runner(),
    "two feet": alternating_hopper(rest_length=45.0),
}
