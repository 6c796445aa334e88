"""Random records of random legs: is the truth within three stated deviations, and how long does a fit take?

Legs of 3 to 60 kg with a cubic spring and a damper hop 1 to 8 times. Two to four of eight channels are recorded at 100
to 1,000 Hz with noise of 0.1 to 3 % of half of their range. The fit starts with a mass, a spring and a damper that are
up to a quarter off. The figure shows for each parameter by how many deviations the fits are off, beside a normal
distribution. The sample record of the package comes first.
Run: python studies/recorded_hops.py [--count 200] [--seed 1] [--output figures] [--quick]
"""

import argparse
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from orbits import OrbitsError, simulate
from orbits.show import COLOURS, new_axes, save_figure
from orbits.units import LIFTOFF_SPEED
from problems import hopper_in_si
from problems.recordings import SAMPLE, HopFit, channels_of, fit, observed

NAMES = ("foot_mass", "k", "b", "damping")
CHANNELS = (
    *("body height", "foot height", "ground force", "spring length"),
    *("body speed", "foot speed", "body acceleration", "foot acceleration"),
)
MASSES, RATIOS, LENGTHS, STRETCH = (3.0, 60.0), (0.08, 0.5), (0.3, 0.9), (0.005, 0.05)
CUBIC, DAMPING, SPEEDS, OFF = (0.03, 1.0), (0.005, 0.08), (3.0, 10.0), 0.25
RATES, NOISE, HOPS = (100.0, 1000.0), (1e-3, 3e-2), 8
GRAVITY = 9.80665
UNITS = {"height": "m", "length": "m", "speed": "m/s", "acceleration": "m/s^2", "force": "N"}


class Fit(NamedTuple):
    """One fit: by how many deviations each parameter is off, empty where it is refused; its samples and seconds."""

    off: dict[str, float]
    samples: int
    seconds: float
    reason: str


def leg_of(rng: np.random.Generator) -> Any:
    """A random leg, whose spring hardens over a tenth of its length."""
    body, length = np.exp(rng.uniform(*np.log(MASSES))), rng.uniform(*LENGTHS)
    foot = body * np.exp(rng.uniform(*np.log(RATIOS)))
    stiffness = body * GRAVITY / (length * rng.uniform(*STRETCH))
    cubic = stiffness / (0.1 * length) ** 2 * rng.uniform(*CUBIC)
    damping = 2 * rng.uniform(*DAMPING) * np.sqrt(stiffness * foot)
    values = {"k": stiffness, "b": cubic}
    return hopper_in_si(body, foot, force="k*r + b*r**3", parameters=values, rest_length=length, damping=damping)


def record_of(leg: Any, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A record of random channels of some hops of a leg."""
    speed = leg.units.of(LIFTOFF_SPEED) * rng.uniform(*SPEEDS)
    run = simulate(leg, speed, hops=int(rng.integers(1, HOPS + 1)))
    rate, noise = rng.uniform(*RATES), np.exp(rng.uniform(*np.log(NOISE)))
    t, names = np.arange(0, run.end, 1 / rate), rng.choice(CHANNELS, rng.integers(2, 5), replace=False).tolist()
    record = {"time [s]": t + rng.uniform(0, 10)}
    for name, values in zip(names, observed(run, {name: channels_of(leg)[name] for name in names}, t), strict=True):
        deviation = 0.5 * noise * np.ptp(values)
        record[f"{name} [{UNITS[name.split()[-1]]}]"] = values + deviation * rng.standard_normal(len(t))
    return record


def fit_of(rng: np.random.Generator) -> Fit:
    """The fit of a random record from a start that is off."""
    leg = leg_of(rng)
    record = record_of(leg, rng)
    start = leg.with_values(**{name: leg.values[name] * np.exp(rng.uniform(-OFF, OFF)) for name in NAMES})
    samples, began = sum(map(len, [*record.values()][1:])), process_time()
    try:
        found = fit(start, record, NAMES)
    except OrbitsError as error:
        return Fit({}, samples, process_time() - began, str(error))
    sizes = {name: size if np.isfinite(size) else 0.0 for name, size in found.deviations.items()}
    off = {name: (found.values[name] - leg.values[name]) / (sizes[name] or np.nan) for name in NAMES}
    return Fit(
        off, samples, process_time() - began, "; ".join(filter(None, [found.lack, str(found.inseparable or "")]))
    )


def fit_of_sample() -> HopFit:
    """The fit of the sample, a leg of 12 kg and 2 kg."""
    values = {"k": 12500.0, "b": 2.4e6}
    leg = hopper_in_si(12.0, 2.5, force="k*r + b*r**3", parameters=values, rest_length=0.6, damping=22.0)
    return fit(leg, SAMPLE, NAMES)


def plot(off: np.ndarray, path: Path) -> Path:
    """Draw how many fits are off by less than some deviations."""
    axes, levels = new_axes(), np.linspace(0, 4, 200)
    for i, (name, colour) in enumerate(zip(NAMES, COLOURS, strict=False)):
        axes.plot(
            np.sort(np.nan_to_num(np.abs(off[:, i]), nan=np.inf)),
            (np.arange(len(off)) + 1) / len(off),
            color=colour,
            label=name,
        )
    normal = np.mean(np.abs(np.random.default_rng(0).standard_normal(20_000))[:, None] < levels, axis=0)
    axes.plot(levels, normal, color="0.4", ls="--", label="normal distribution")
    axes.set(xlabel="error / stated deviation", ylabel="share of fits below", xlim=(0, 4), ylim=(0, 1.02))
    axes.legend(loc="lower right")
    return save_figure(axes, path)


def main(argv: list[str] | None = None) -> np.ndarray:
    """Fit random records; returns the errors (fits, parameters) in stated deviations."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path, default=Path("figures"))
    parser.add_argument("--quick", action="store_true", help="four records")
    options = parser.parse_args(argv)
    print(fit_of_sample())
    fits = [fit_of(np.random.default_rng([options.seed, i])) for i in range(4 if options.quick else options.count)]
    for i, each in enumerate(fits):
        if each.reason:
            print(f"record {i}: {each.reason}")
    # A parameter that is refused or not separated is not within any deviations.
    off = np.array([[*each.off.values()] or [np.nan] * len(NAMES) for each in fits])
    whole = np.isfinite(off).all(1).sum()
    print(f"{whole} of {len(fits)} records are fitted, of {np.median([each.samples for each in fits]):.0f} samples")
    for name, own in zip(NAMES, off.T, strict=True):
        print(
            f"  {name}: {np.mean(np.abs(own) < 3):.1%} within three deviations, rms {np.sqrt(np.nanmean(own**2)):.2f}"
        )
    seconds = np.array([each.seconds for each in fits])
    print(f"seconds for a fit: median {np.median(seconds):.2f}, largest {seconds.max():.2f}")
    options.output.mkdir(parents=True, exist_ok=True)
    print(plot(off, options.output / "recorded_hops.png"))
    return off


if __name__ == "__main__":
    main()
