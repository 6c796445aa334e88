"""Figures of hops whose launches are several numbers: the map, periodic hops, and multipliers in the complex plane."""

from typing import TYPE_CHECKING

import numpy as np

from ..result import Axes
from .canvas import axes_or_new, finished
from .map_figures import IDENTITY
from .style import label_of

if TYPE_CHECKING:
    from ..control import HeldLaunches
    from ..hops import HopMultipliers
    from ..returns import LaunchHops, ReturningHops


def plot_launch_hops(hops: "LaunchHops", axes: Axes | None = None) -> Axes:
    """Plot each number of the next launches against the same number of the launches; return the axes."""
    axes, known = axes_or_new(axes, 0.95), hops.launches[np.isfinite(hops.launches)]
    ends = [float(known.min()), float(known.max())] if known.size else [0.0, 1.0]
    axes.plot(ends, ends, label="identity", **IDENTITY)
    for i, name in enumerate(hops.names):
        axes.plot(
            hops.launches[..., i].ravel(), hops.next[..., i].ravel(), ".", label=label_of(name, hops.unit_of(name))
        )
    return finished(axes, xlabel="number of the launch", ylabel="the same of the next launch")


def plot_periodic_hop(hop: "ReturningHops", axes: Axes | None = None) -> Axes:
    """Plot the numbers of the launches against the hop, up to the first launch again; return the axes."""
    axes = axes_or_new(axes)
    for i, name in enumerate(hop.names):
        values = hop.launches[:, i]
        axes.plot(
            np.arange(hop.period + 1), np.append(values, values[0]), "o-", label=label_of(name, hop.unit_of(name))
        )
    axes.set_xticks(range(hop.period + 1))
    return finished(axes, xlabel="hop", ylabel="number of the launch")


def plot_multipliers(found: "HopMultipliers", axes: Axes | None = None) -> Axes:
    """Plot the multipliers in the complex plane, with the unit circle; return the axes."""
    axes, turn = axes_or_new(axes, 0.95), np.linspace(0.0, 2 * np.pi, 200)
    axes.plot(np.cos(turn), np.sin(turn), label="unit circle", **IDENTITY)
    axes.plot(found.values.real, found.values.imag, "o", label="multipliers")
    axes.set_aspect("equal", adjustable="datalim")
    return finished(axes, xlabel="real part", ylabel="imaginary part")


def plot_held_launches(found: "HeldLaunches", axes: Axes | None = None) -> Axes:
    """Plot by how much launches are off, as shares of the launch speed, hop after hop; return the axes."""
    axes = axes_or_new(axes)
    for error, off, back in zip(found.errors, found.off, found.returned, strict=True):
        style = {"ls": "-" if back else ":", "marker": "o", "ms": 4}
        axes.semilogy(np.arange(len(off)), np.maximum(off, 1e-16), label=f"speed {100 * error:+.3g} %", **style)
    axes.axhline(found.within, color="0.5", lw=0.8)
    axes.set_ylim(bottom=max(1e-12, 0.3 * float(np.nanmin(found.off))))
    return finished(axes, xlabel="hop", ylabel="change of the launch, as a share")
