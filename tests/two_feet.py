"""Shared by tests of a machine of two feet, of which one swings while the other stands."""

from functools import cache

from scipy.integrate import solve_ivp

from orbits import Mechanism, find
from orbits.mechanics import Mass, Spring

FEET = Mechanism(
    coordinates=("h", "s", "d"),
    elements=[
        Mass("h", 1.0), Mass("s+d", "m"), Mass("s-d", "m"), Spring("h-s-d", "r"), Spring("h-s+d", "r"),
    ],
    gaps={"left": "s+d", "right": "s-d"}, reversor={"d": "-d"}, symmetry={"d": "-d"}, parameters={"m": 2.0}, launch="h",
)  # fmt: skip


@cache
def slowest_step():
    """The orbit with the least launch speed, which satisfies all conditions but those on the swinging foot."""
    launch = {"liftoff": 2.0, "alpha": 4.43, "d": -1.22, "d'": -4.08, "duration": 4.15, "contact_duration": 4.24}
    return find(FEET, start=launch)


def height_in_contact(orbit, t):
    """The height -2 d at times (k,) since landing of the foot that does not stand, with s + d = 0, by DOP853.

    The energies (h'^2 + 4 m d'^2)/2 and (h^2 + (h + 2 d)^2)/2 + h - 2 m d give h'' = -2 h - 2 d - 1 and
    4 m d'' = -2 (h + 2 d) + 2 m. The landing changes the sign of d.
    """
    m, (h, v, _, _, d, w) = orbit.machine["parameters"]["m"], orbit(orbit.flight_time)

    def rates(_, x):
        h, v, d, w = x
        return [v, -2 * h - 2 * d - 1, w, (m - h - 2 * d) / (2 * m)]

    start = [h, v, -d, -w]
    return -2 * solve_ivp(rates, (0, t[-1]), start, method="DOP853", rtol=1e-12, atol=1e-12, t_eval=t).y[2]
