"""Shared by the tests of sweeps: machines with the ranges of their parameters."""

from problems import Hopper, Juggler, hopper_in_si

LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 2e6}, rest_length=0.8)
GRAVITY = Hopper("cubic", "1/(1 + z/R)**2", rest_length=15.0, parameters={"R": 200.0})
CASES = {
    "cubic": (Hopper("cubic", rest_length=9.0), {"beta": (0.0, 1.0), "mass_ratio": (0.2, 5.0, "log")}, 1),
    "family 3": (Hopper("cubic"), {"beta": (0.0, 0.2)}, 3),
    "softening": (Hopper("cubic", rest_length=20.0), {"beta": (-0.02, 0.01)}, 1),
    "linear": (Hopper(), {"mass_ratio": (0.1, 10.0, "log"), "rest_length": (3.0, 12.0)}, 2),
    "juggler": (Juggler("sinh", parameters={"b": 0.3}), {"b": (0.01, 0.6), "mass_ratio": (0.5, 2.0)}, 1),
    "varying gravity": (GRAVITY, {"R": (60.0, 400.0), "beta": (0.0, 0.5)}, 1),
    "saturating": (
        Hopper("tanh(b*r)/b + c*r", parameters={"b": 0.2, "c": 0.0}),
        {"b": (0.1, 0.8), "c": (0.0, 0.05)},
        1,
    ),
    "SI": (LEG, {"k": (2000.0, 20000.0), "b": (0.0, 4e6), "body_mass": (40.0, 90.0)}, 1),
}
