"""The claims of Chatterjee, Pratap, Reddy and Ruina, each with their number and ours; `paper` puts them on a page.

Each function yields the rows of one part: the section, what is claimed, the number expected, ours, and how near they
must be (half a unit of the last digit that is printed, or rounding where the claim is exact).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from orbits import ReturnMap, find, find_all, follow, multiplier, simulate
from problems import Chain, HeavyHand, Hopper, Juggler, hopper_in_si
from studies import air_track, attraction, figure_5, figure_8

FIRST = 4.493409457909064


@dataclass(frozen=True)
class Claim:
    """One row: the error of `ours` is to be at most `within`."""

    section: str
    statement: str
    expected: float | bool
    ours: float | bool
    within: float

    @property
    def error(self) -> float:
        return abs(float(self.ours) - float(self.expected))

    @property
    def ok(self) -> bool:
        return self.error <= self.within


def claims_of(rows: Callable[[], Iterator[tuple]]) -> list[Claim]:
    """The claims of a part, computed."""
    return [
        Claim(section, words, *(bool(x) if isinstance(expected, bool) else float(x) for x in (expected, ours)), within)
        for section, words, expected, ours, within in rows()
    ]


def lossless() -> Iterator[tuple]:
    """Sections 7 to 9: the lossless motions, exactly."""
    for n, printed, digit in ((1, 4.493409, 1e-6), (2, 7.725251, 1e-6), (3, 10.90412, 1e-5)):
        yield (
            "8",
            f"alpha* of family {n}, a root of alpha = tan alpha (eq. 12)",
            printed,
            find(Hopper(), n).alpha,
            digit,
        )
    hop, juggle = find(Hopper()), find(Juggler())
    t = np.linspace(0, hop.flight_time, 400)
    r, w = np.cos(t) + FIRST * np.sin(t), 1 + FIRST * t - t**2 / 2
    exact = np.stack([(r + w) / 2, (w - r) / 2], axis=1)  # M = 1
    yield "8", "flight against eqs. (7) and (8), largest difference", 0.0, np.abs(hop(t)[:, ::2] - exact).max(), 1e-13
    yield "8", "flight time over alpha (eq. 11)", 2.0, hop.flight_time / hop.alpha, 1e-14
    landing = hop(hop.flight_time)
    yield "8", "extension at landing, that of lift-off", 1.0, landing[0] - landing[2], 1e-13
    yield "8", "height of the foot at landing (eq. 10)", 0.0, landing[2], 1e-13
    yield "8", "speed of the foot at landing (eq. 10)", 0.0, landing[3], 1e-13
    yield "8", "its third derivative is negative there", True, hop.certificate.landing_jerk < 0, 0
    yield "9", "the body's speed at landing over that at lift-off", -1.0, landing[1] / hop.alpha, 1e-13
    yield "9", "change of energy over flight and contact, as a share", 0.0, hop.certificate.energy_drift, 1e-13
    speed = FIRST * 9.80665 * np.sqrt(2 / 3 * 5.0 / 500.0)
    ours = find(hopper_in_si(3.0, 2.0, stiffness=500.0)).si()["alpha_m_per_s"]
    yield "8", "launch speed in m/s of 3 kg on 2 kg and 500 N/m (eq. 13)", speed, ours, 1e-13
    yield "8", "the juggler's alpha*, from that of the hopper", 0.0, juggle.alpha - hop.alpha, 1e-15
    ball = hop(t) @ np.array([1.0, 0.0, 1.0, 0.0]) - 1
    yield (
        "7",
        "Fig. 3, M = 1: ball from twice the hopper's centre of mass",
        0.0,
        np.abs(ball - juggle(t)[:, 0]).max(),
        1e-12,
    )
    t = np.linspace(0, hop.period, 400)
    off = np.abs(hop(np.mod(hop.flight_time - t, hop.period)) - np.array([1, -1, 1, -1]) * hop(t)).max()
    yield "9", "a lossless motion played backwards, from itself", 0.0, off, 1e-12
    bent = find(Hopper("r + 0.1*r**3", "1/(1 + z/60)**2", rest_length=12))
    yield "9", "a nonlinear spring in varying gravity has a lossless hop too", True, bent.admissible, 0
    losses = [float(ReturnMap(Hopper(restitution=e))(hop.alpha).loss) for e in (0.0, 0.5, 0.9)]
    yield "11", "loss at alpha* whatever the restitution: 0, 0.5, 0.9", 0.0, np.max(losses), 1e-12
    yield "10", "oscillations of the hand in flight, about one and a half", 1.5, juggle.flight_time / (2 * np.pi), 0.1


def maps() -> Iterator[tuple]:
    """Section 9: the return map, for feet light and heavy."""
    step = ReturnMap(Hopper())
    hops = step(np.linspace(0.5, 12, 3000))
    lifts = hops.status == "lifts_off"
    yield "9", "a launch speed is ever gained, M = 1", False, np.any(hops.next[lifts] > hops.alpha[lifts]), 0
    near = step(FIRST + np.array([-1e-3, 1e-3]))
    yield "9", "impacts just right of alpha*", 1, near.impacts[1], 0
    yield "9", "impacts just left of alpha*: one bounce more", 2, near.impacts[0], 0
    for M in (0.1, 1.0, 10.0):
        alpha = FIRST + 1e-12
        slope = (ReturnMap(Hopper(mass_ratio=M))(alpha).next - FIRST) / (alpha - FIRST)
        yield (
            "9",
            f"slope just right of alpha*, tangent to the identity, M = {M:g}",
            1.0,
            float(slope),
            5e-3,
        )
    damped = ReturnMap(Hopper(damping=0.01))(np.linspace(4.0, 12, 2000))
    yield "9", "damping lets a launch speed come back", False, np.any(damped.next >= damped.alpha), 0
    losses = [figure_5.worst_loss(M) for M in (1e-4, 1e-5)]
    yield "9", "M to 0: exponent of the map's distance from the identity", 1.0, np.log10(losses[0] / losses[1]), 1e-2
    bunched = _apart(1e-4) / _apart(1e-2)
    yield "9", "and of the distance between launch speeds alpha*", 0.5, np.log(bunched) / np.log(1e-2), 1e-2
    hand = ReturnMap(HeavyHand(), cap=300)
    edges = hand(np.array([np.pi - 1e-6, np.pi + 1e-6]))
    yield "9", "M to infinity: a throw just below pi bounces on", False, edges.status[0] == "cap", 0
    yield "9", "M to infinity: a throw just above pi bounces on", True, edges.status[1] == "cap", 0
    yield "9", "the end of stable bouncing with period one, about", 3.59, _last_period_one(), 1e-2
    yield "9", "beyond it there is stable bouncing with period two", True, _bouncing(3.6) == 2, 0
    impacts = [int(ReturnMap(Hopper(mass_ratio=M))(3.4).impacts) for M in (1e2, 1e3, 1e4)]
    yield "9", "impacts of a throw at 3.4 grow with M", True, impacts[0] < impacts[1] < impacts[2], 0


def stability() -> Iterator[tuple]:
    """Sections 9 and 11: what becomes of launches beside a lossless one."""
    step, alpha = ReturnMap(Hopper()), np.array([FIRST + 1e-3, FIRST - 1e-3])
    for _ in range(500):
        alpha = step(alpha).next
    yield "9", "distance from alpha* after 500 hops from 1e-3 above", 0.0, alpha[0] - FIRST, 1e-8
    yield "9", "a launch from 1e-3 below is still near alpha* then", False, abs(alpha[1] - FIRST) < 0.1, 0
    points = {eps: ReturnMap(Hopper(), inject=eps).fixed_points(4.3, 5.0) for eps in (-0.05, 0.03, 0.11)}
    yield "9", "Fig. 8(a): fixed points where energy is taken", 0, len(points[-0.05]), 0
    yield "9", "Fig. 8(c): fixed points with a small injection", 2, len(points[0.03]), 0
    for name, eps, index, stable in (
        ("Fig. 8(c): the upper one is stable", 0.03, -1, True),
        ("Fig. 8(c): the lower one is stable", 0.03, 0, False),
        ("Fig. 8(e): the upper one is stable", 0.11, -1, False),
    ):
        yield "9", name, stable, abs(multiplier(Hopper(), points[eps][index].alpha)) < 1, 0
    eps = figure_8.marginal()
    slope = np.diff(ReturnMap(Hopper(), inject=eps)(figure_8.pair(eps)[1] + np.array([-1e-6, 1e-6])).next)[0] / 2e-6
    yield "9", "Fig. 8(d): slope at the upper fixed point, differenced", -1.0, slope, 1e-6
    basins = [float(np.ptp(figure_8.basin(share * eps))) for share in (0.25, 0.5, 0.75, 1.0)]
    yield "9", "the basin grows with the injection up to (d)", True, np.all(np.diff(basins) > 0), 0
    shares = [attraction.attracted(M, 30) for M in (1e-3, 1.0, 1e3)]
    yield "11", "share of launches attracted, M = 1/1000", 1.0, shares[0], 0.0
    yield "11", "the same, M = 1: few", 0.0, shares[1], 0.1
    yield "11", "the same, M = 1000", 1.0, shares[2], 0.0


def on_the_air_track() -> Iterator[tuple]:
    """Section 10: the experiment."""
    orbit = find(Juggler(mass_ratio=0.909))  # the paper's own rounding
    lowest = orbit(orbit.flight_time + orbit.contact_time / 2)[0]
    h, h1 = orbit.rises["ball"], orbit.rises["hand"]
    for name, printed, ours in (
        ("h", 10.095, h),
        ("h1", 3.603, h1),
        ("h2", 8.942, -lowest),
        ("A1", 19.037, h - lowest),
        ("A2", 12.545, h1 - lowest),
        ("A1/A2", 1.517, (h - lowest) / (h1 - lowest)),
    ):
        yield "10", f"{name}, M = 0.909 (eq. 14)", printed, ours, 5e-4
    orbit, first, second = air_track.amplitudes()
    yield "10", "mass ratio of hand and ball", 0.909, orbit.machine["mass_ratio"], 5e-4
    yield "10", "slope of the track in degrees, about", 1.0, float(np.degrees(air_track.SLOPE)), 0.1
    yield "10", "the ball's amplitude (m)", 0.103, first, 5e-4
    yield (
        "10",
        "A1/A2 as measured, within 6%",
        air_track.MEASURED_RATIO,
        first / second,
        0.06 * air_track.MEASURED_RATIO,
    )
    measured = air_track.MEASURED_AMPLITUDE
    yield "10", "the ball's amplitude as measured (m), within 10%", measured, first, 0.1 * measured
    yield (
        "10",
        "model's ratio off the measured one, %",
        0.4,
        100 * (air_track.MEASURED_RATIO / (first / second) - 1),
        0.05,
    )
    yield "10", "model's amplitude off the measured one, %", 4.0, 100 * (first / measured - 1), 0.5


def errata() -> Iterator[tuple]:
    """What we found otherwise than printed."""
    hop, juggle = simulate(Hopper(), 5.0, hops=2), simulate(Juggler(), 5.0, hops=2)
    t = np.linspace(0, min(hop.end, juggle.end), 500)
    y = hop(t)
    ball = y[:, 0] - 1 + y[:, 2]  # eq. 6 for M = 1
    scaled = juggle(np.sqrt(0.5) * t)[:, 0]
    yield "7", "eq. 6 with one clock: largest distance of the balls", 0.0, np.abs(ball - juggle(t)[:, 0]).max(), 1e-9
    yield "7", "eq. 6 with the clocks as printed: the balls agree", False, np.abs(ball - scaled).max() < 0.1, 0
    run = simulate(HeavyHand(), 3.58, hops=1, cap=600)
    acceleration = -1 - run.events[-1].after[2]
    yield "9", "stable bouncing: the hand's acceleration is above -2", True, -2 < acceleration < -1, 0
    yield "9", "Fig. 5(d): bouncing reaches up to 3.59", False, _right_edge() < 3.595, 0
    step, C = ReturnMap(Hopper()), _local_coefficient()
    for d in (1e-6, 1e-9):
        side = step(FIRST - d * np.array([1 - 1e-3, 1 + 1e-3])).next
        law = 40 / 3 * C * d ** (1 / 3)
        slope = (side[0] - side[1]) / (2e-3 * d)
        yield "9", f"left of alpha* by {d:g}: slope less 1, over (40/3) C d^(1/3)", 1.0, (slope - 1) / law, 0.1
    ratio = step(FIRST - 1e-9).loss / step(FIRST + 1e-9).loss
    yield "9", "loss left over loss right of alpha*, 1e-9 beside it", 10.0, float(ratio), 0.05
    length = 0.2657 * 9.81 * 1.1 / np.hypot(1.1, 60) / 8.8
    yield "10", "unit of length (m) from the stated data", length, air_track.amplitudes()[0].scales.length, 1e-12
    yield "10", "it is the printed 5.431e-3 m", False, abs(length - 5.431e-3) < 5e-7, 0
    heavy, light = (ReturnMap(Hopper(mass_ratio=M))([*np.arange(0.5, 30, 0.05), 22.8899]) for M in (1.5, 1 / 1.5))
    differ, once = np.abs(heavy.next - light.next), (heavy.impacts == 1) & (light.impacts == 1)
    yield "R&P", "M and 1/M, hops of one impact: largest difference", 0.0, np.nanmax(differ[once]), 1e-12
    yield "R&P", "next launch from 22.8899, M = 1.5", 1.218, heavy.next[-1], 5e-4
    yield "R&P", "the same, M = 1/1.5", 8.992, light.next[-1], 5e-4


def beyond() -> Iterator[tuple]:
    """What the paper could not show, against closed forms and values of 40-digit arithmetic."""
    coefficient = find(Hopper()).certificate.loss_coefficient
    yield "beyond", "C of the local law C d^(4/3), M = 1", _local_coefficient(), coefficient, 1e-12
    power = np.log10(ReturnMap(Hopper())(FIRST + 1e-7).loss / ReturnMap(Hopper())(FIRST + 1e-10).loss) / 3
    yield "beyond", "its exponent", 4 / 3, float(power), 1e-3
    eps = figure_8.marginal()
    low, high = figure_8.pair(eps)
    yield "beyond", "injection of curve (d)", 0.071587384137, eps, 1e-12
    yield "beyond", "its stable fixed point", 4.541763272853, high, 1e-11
    yield "beyond", "its unstable fixed point", 4.481341946645, low, 1e-11
    yield "beyond", "where hops of period two lose stability", 0.11342924652339789, figure_8.last_cycle(), 1e-11
    yield "beyond", "throws on the infinitely heavy hand bounce up to", 3.72496, _right_edge(), 1e-5
    family = follow(Hopper("tanh"), "b", 0.4, start=0.1)
    yield "beyond", "where the first family of a saturating spring escapes", 1 / 3, family.end.limit, 1e-4
    softening = follow(Hopper("cubic", parameters={"beta": 0.0}), "beta", -0.02, most=60)
    fold = next(event.point for event in softening.events if event.kind == "fold")
    yield "beyond", "fold of the cubic family: beta", -0.0106952149164040, fold.value, 1e-13
    yield "beyond", "and alpha", 5.83222367210583, fold.alpha, 1e-8
    three = Chain()
    hop = find(three, start=three.start([-11.15, -3.02], 3.222, 2.460))
    yield "beyond", "three masses: rest of the top one in mid-contact", -11.153174, _rest(hop), 6e-7
    yield "beyond", "hops of three masses found, at least", 5, min(5, len(find_all(three, three.starts(6, 6)))), 0


def _local_coefficient() -> float:
    """C of the linear hopper, M = 1: at landing the gap's third derivative is -alpha/2 and its derivative by alpha is
    alpha^3/(1 + alpha^2)."""
    return FIRST / 32 * (12 * FIRST**2 / (1 + FIRST**2)) ** (4 / 3)


@cache
def _right_edge() -> float:
    return figure_5.right_edge(HeavyHand())


def _apart(M: float) -> float:
    """How far the first two lossless launch speeds lie apart, in units in which body, spring and gravity are fixed."""
    return np.sqrt(M / (1 + M)) * (find(Hopper(mass_ratio=M), 2).alpha - find(Hopper(mass_ratio=M)).alpha)


def _rest(orbit) -> float:
    return float(orbit(orbit.flight_time + orbit.contact_time / 2)[0])


def _last_period_one() -> float:
    """The fastest throw on the heavy hand whose bouncing comes to period one, to 5e-3."""
    low, high = 3.57, 3.602
    while high - low > 5e-3:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _bouncing(middle) == 1 else (low, middle)
    return low


def _bouncing(alpha: float) -> int:
    """The period of the bouncing that a throw on the heavy hand comes to."""
    run = simulate(HeavyHand(), alpha, hops=1, cap=1000)
    speeds = np.array([event.after[3] for event in run.events[-4:]])
    return 1 if np.ptp(speeds) < 1e-3 else 2 if abs(speeds[-1] - speeds[-3]) < 1e-3 else 0
