"""The result of a fit of recorded hops: values with their covariance, residuals, and the machine."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from orbits.errors import InputError
from orbits.model import Machine
from orbits.result import Axes, Result, Row
from orbits.tables import digits_within
from orbits.units import TIME

from .channels import channels_of
from .hop_program import DAMPERS, RESTITUTION


@dataclass(frozen=True, eq=False)
class PartOfHop:
    """One phase of the fitted motion.

    motion : the number of the record, from 1
    phase : "flight" or "contact"
    begins : by what, "free" at the start of a record
    start, end : times of the record
    rms : (c,) of the residuals of each channel, in deviations; NaN without samples
    """

    motion: int
    phase: str
    begins: str
    start: float
    end: float
    rms: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class HopFit(Result, what="hop fit", in_line=("values", "source_name"), printed_digits=8):
    """The parameters of a machine fitted to recorded hops.

    source, machine : the machine with these values
    values : of the unknown parameters. Errors may put a damper below 0, which the machine has then almost none of
    covariance : (k, k), of these in their order; infinite for values that the record does not separate
    offsets, delays : of the channels that have unknown ones, by name
    noise : the standard deviation of a sample of each channel, by name: the stated one, or that of the residuals
    inseparable : groups of parameters that the record does not separate
    remedy : which further measurement would, in words
    lack : why the machine does not fit, in words; "" where nothing says so
    parts : the flights and contacts of the motion, with their residuals
    samples : of each channel (5, n): the number of its record, from 0, its times, what was recorded, what the motion
        shows, NaN after its end, and 1 where it is used, 0 for a spike and near an impact
    followed : the time up to which each record is followed
    source_name : of the records
    unused : columns of the record that are not channels
    """

    source: Machine
    values: Mapping[str, float]
    covariance: np.ndarray
    offsets: Mapping[str, float]
    delays: Mapping[str, float]
    noise: Mapping[str, float]
    inseparable: tuple[tuple[str, ...], ...]
    remedy: str
    lack: str
    parts: list[PartOfHop]
    samples: Mapping[str, np.ndarray]
    followed: list[float]
    source_name: str
    unused: tuple[str, ...] = ()

    machine = property(lambda self: self.source)

    @property
    def lossless(self) -> Machine:
        """The machine without its dampers, which `find` takes: with them no hop is lossless."""
        dampers = {name: 0.0 for name in DAMPERS if getattr(self.source, name, 0.0)}
        return self.source.with_values(**dampers) if dampers else self.source

    @property
    def deviations(self) -> dict[str, float]:
        """The standard deviations of the values; infinite for values that the record does not separate."""
        variances = np.diag(self.covariance)
        return dict(
            zip(self.values, np.sqrt(np.where(np.isfinite(variances), variances, np.inf)).tolist(), strict=True)
        )

    def distributions(self) -> dict[tuple[str, ...], Any]:
        """The joint normal distribution of the parameters, as `uncertainty(fit.lossless, fit)` takes it, without
        dampers and restitution, which do not affect lossless orbits. Raises `InputError` if some are not separated.
        """
        from scipy.stats import multivariate_normal  # slow to import

        if self.inseparable:
            raise InputError(f"the record does not separate {self._together()}: {self.remedy}; or state one of them")
        own = [i for i, name in enumerate(self.values) if name not in (*DAMPERS, RESTITUTION)]
        names, mean = [*self.values], np.array([*self.values.values()])
        normal = multivariate_normal(mean[own], self.covariance[np.ix_(own, own)], allow_singular=True)
        return {tuple(names[i] for i in own): normal}

    def _together(self) -> str:
        return "; ".join(" and ".join(group) for group in self.inseparable)

    @property
    def units(self) -> Mapping[str, str]:
        """The units of the parameters and channels by name; empty for a dimensionless machine."""
        units = self.machine.units
        if units is None:
            return {}
        channels = {name: units.text(each.dimension) for name, each in channels_of(self.machine).items()}
        second = dict.fromkeys(("start", "end"), units.text(TIME))
        return {**self.machine.describe().get("units", {}), **channels, **second}

    def title(self) -> str:
        count = sum(int(self._used(name).sum()) for name in self.samples)
        return f"{self.machine.model.name} fitted to {count} samples of {self.source_name}"

    def _used(self, name: str) -> np.ndarray:
        """Whether each sample of a channel counts."""
        return (self.samples[name][4] > 0) & np.isfinite(self.samples[name][3])

    def table(self) -> dict[str, Any]:
        """The parts of the motion as columns: record, phase, how it begins, start, end, and of each channel the rms of
        its residuals in deviations."""
        columns = {
            "record": [each.motion for each in self.parts], "phase": [each.phase for each in self.parts],
            "begins": [each.begins for each in self.parts],
            "start": np.array([each.start for each in self.parts]), "end": np.array([each.end for each in self.parts]),
        }  # fmt: skip
        rms = np.array([each.rms for each in self.parts])
        return columns | {f"residual of {name}": rms[:, i] for i, name in enumerate(self.samples)}

    def heads(self) -> list[str]:
        return []

    def _rows(self) -> list[Row]:
        found, deviations = [], self.deviations
        for name, value in self.values.items():
            unit, deviation = self.unit_of(name), deviations[name]
            if not np.isfinite(deviation):
                found.append(Row(name, {name: "not separated"}))
                continue
            digits = digits_within(value, 0.05 * deviation, self.printed_digits)
            plain = f".{max(digits - 1 - int(np.floor(np.log10(abs(value) or 1.0))), 0)}f"
            style = plain if abs(value) < 1e6 else f".{digits}g"
            found.append(
                Row(
                    name,
                    {name: value, f"deviation of {name}": deviation},
                    (f"{{:{style}}} +- {{:.2g}} {unit}".rstrip(),),
                )
            )
        for name, value in self.noise.items():
            unit, count = self.unit_of(name), int(np.isfinite(self.samples[name][3]).sum())
            spikes = count - int(self._used(name).sum())
            after = f" a sample of {count}" + (f", {spikes} left out" if spikes else "")
            found.append(Row(f"noise of {name}", {f"noise of {name}": value}, (f"{{:.2g}} {unit}".rstrip() + after,)))
        offsets = [(f"offset of {name}", value, self.unit_of(name)) for name, value in self.offsets.items()]
        offsets += [(f"delay of {name}", value, self.unit_of("start")) for name, value in self.delays.items()]
        return [*found, *(Row(name, {name: value}, (f"{{:.4g}} {unit}".rstrip(),)) for name, value, unit in offsets)]

    def _notes(self) -> list[str]:
        hops = sum(each.begins == "lift-off" for each in self.parts)
        notes = [f"{len(self.parts)} flights and contacts, {hops} lift-offs"]
        if low := [name for name in DAMPERS if self.values.get(name, 0.0) < 0]:
            notes.append(f"{' and '.join(low)} below 0 by the errors: the machine has almost none")
        if self.inseparable:
            notes.append(f"the record does not separate {self._together()}: {self.remedy}; or state one of them")
        for k, end in enumerate(self.followed):
            times = np.concatenate([each[1][each[0] == k] for each in self.samples.values()])
            if (left := int((times > end).sum())) and len(times):
                notes.append(
                    f"the motion ends at {end:.6g} {self.unit_of('end')}".rstrip()
                    + f", {left} samples later are not used"
                )
        return [*notes, *filter(None, [self.lack]), *([f"not used: {', '.join(self.unused)}"] if self.unused else [])]

    def plot(self, axes: Axes | None = None, record: int = 1) -> Axes:
        """Plot the channels of one record with the motion and the residuals; returns the axes of the first channel."""
        from .hop_figures import plot_hop_fit  # loads what draws

        return plot_hop_fit(self, axes, record)
