"""What disturbed steps lose, and what injections make of them: two panels of figures of machines that step.

A launch that is off by d loses C d^(4/3) of its speed on one side of the lossless launch, and K C d^(4/3) on the other
(see `Certificate`); with an injection I of speed at each launch the speeds settle at a distance of (I/C)^(3/4), or of
(I/(K C))^(3/4), above the lossless launch, as long as the map falls there with a slope above -1.
"""

import numpy as np

from orbits import Orbit, ReturnMap
from orbits.result import Axes
from orbits.show import COLOURS, legend_below


def factors(orbit: Orbit) -> dict[int, float]:
    """The factors of |d|^(4/3) below (-1) and above the lossless launch (1)."""
    c, more = orbit.certificate.loss_coefficient, orbit.certificate.bounce_factor
    above = orbit.certificate.bounce_side == "above"
    return {-1: c if above else more * c, 1: more * c if above else c}


def settled(steps: ReturnMap, launches: np.ndarray, injections: np.ndarray, count: int, shown: int) -> np.ndarray:
    """The last launch speeds (shown, k) of so many steps from launches (k,), with an injection (k,) at the end of each;
    NaN where the machine has come to rest or has gone back."""
    speeds, last = launches.copy(), []
    for number in range(count):
        walking = np.isfinite(speeds)
        if walking.any():
            speeds[walking] = steps(speeds[walking]).next + injections[walking]
        last += [speeds.copy()] if number >= count - shown else []
    return np.array(last)


def draw_losses(axes: Axes, steps: ReturnMap, orbit: Orbit, count: int) -> dict[str, float]:
    """Draw what launches beside the lossless one lose in a step; how far they may be off below and above it before no
    step follows any more."""
    distances, found = np.geomspace(1e-7, 1e-2, count), {}
    for side, word, mark, colour in ((-1, "below", "o", COLOURS[0]), (1, "above", "s", COLOURS[1])):
        launches, law = orbit.alpha + side * distances, factors(orbit)[side]
        lost = launches - steps(launches).next
        near = np.cumprod(np.isfinite(lost)).astype(bool)
        found[word] = float(distances[near].max())
        label = f"launch {word} the lossless one"
        axes.plot(distances[near], lost[near], mark, color=colour, ms=4, label=label)
        power = law * distances[near] ** (4 / 3)
        axes.plot(distances[near], power, "--", color=colour, lw=1, label=f"{law:.3g} d$^{{4/3}}$")
    axes.set(xscale="log", yscale="log", xlabel="launch off by d (rad/s)", ylabel="speed lost in a step (rad/s)")
    legend_below(axes)
    return found


def draw_settled(axes: Axes, steps: ReturnMap, orbit: Orbit, injections: np.ndarray, quick: bool) -> dict[str, float]:
    """Draw the launch speeds to which injections (k,) lead; up to which the machine goes on, at which the one launch
    speed splits into two, by the law, and how far the smallest one leads from the law, as a share. It
    goes on for as many steps as are made, 50, or 24 in quick mode."""
    law = factors(orbit)[1]
    steady = (injections / law) ** 0.75
    last = settled(steps, orbit.alpha + steady, injections, *((24, 8) if quick else (50, 24))) - orbit.alpha
    goes_on = float(injections[np.isfinite(last).all(0)].max())
    drawn, *_ = axes.plot(injections, (last / injections).T, ".", color=COLOURS[0], ms=3)
    drawn.set_label("launches, step after step")
    axes.plot(injections, steady / injections, "--", color=COLOURS[1], lw=1, label="one launch speed, by the law")
    axes.axvline(goes_on, color="0.4", lw=1, ls=":", label="largest that goes on")
    axes.set(xscale="log", xlabel="injection I at each launch (rad/s)", ylabel="(launch - lossless launch)/I")
    legend_below(axes)
    return {"goes on": goes_on, "off the law": float(np.abs(last[-1, 0] / steady[0] - 1)), "splits": 1.5**4 / law**3}


def draw_disturbed(panels, machine, orbit: Orbit, quick: bool, largest: float) -> dict[str, float]:
    """Draw both panels, with injections up to a largest one; say and return what was found."""
    steps, injections = ReturnMap(machine), np.geomspace(largest / 1e3, largest, 10 if quick else 31)
    found = draw_losses(panels[0], steps, orbit, 16 if quick else 61)
    found |= draw_settled(panels[1], steps, orbit, injections, quick)
    print(f"  beside the lossless launch, {orbit.alpha:.6g} rad/s, a step follows {found['below']:.1e} rad/s below and")
    print(f"  {found['above']:.1e} above; it goes on with injections up to {found['goes on']:.2g} rad/s, and with one")
    print(f"  launch speed, by the law, up to {found['splits']:.2g} rad/s")
    return found
