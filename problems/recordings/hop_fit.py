"""The parameters of a machine from recorded hops."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from orbits.errors import InputError, NoOrbit, OrbitsError, list_of_names
from orbits.laws import number
from orbits.model import Machine, check_machine, free_parameters, refuse_hysteresis, refuse_steps
from orbits.running import exclusive
from orbits.symbolic import suggest
from orbits.units import LENGTH, STIFFNESS, TIME

from .channels import Channel, channels_of
from .hop_guess import Start, sizes_of, starts_of
from .hop_program import DAMPERS, RESTITUTION, Samples, Unknowns
from .hop_record import HopRecord, read_hops
from .hop_result import HopFit
from .hop_rounds import FIT, Fitted, Fitting, Question, usual
from .hop_separation import separation

# Four recorded hops of a leg with known values.
SAMPLE = Path(__file__).with_name("hops_of_a_leg.csv")


@exclusive
def fit(
    machine: Machine, source: Any, unknown: str | Sequence[str], *,
    columns: Mapping[str, str] | None = None, units: Mapping[str, str] | None = None,
    noise: Mapping[str, float] | None = None, offsets: Sequence[str] | None = None, delays: Sequence[str] = (),
) -> HopFit:  # fmt: skip
    """The parameters with which a machine hops as it was recorded, by multiple shooting and least squares.

    machine : of two masses with smooth laws, such as `hopper_in_si(...)`; its own values of the unknown parameters are
        the start, which lies within a third of the truth
    source : a file, a `pandas.DataFrame`, a mapping of columns, or a list of these. It has the time and any channels:
        heights, speeds and accelerations of body and foot, the ground force and the length of the spring, with their
        units in the header. Empty cells are missing samples; a time that goes back begins another motion
    unknown : names of parameters of the machine, and "restitution"; the friction of a guide is the machine's "drag"
    columns, units : the column and the unit of "time" and of channels, by their names, where the header does not say
        them
    noise : standard deviation of a sample of a channel, by name; by default that of the residuals
    offsets : channels with an unknown offset; by default all heights and lengths
    delays : channels with an unknown delay, as those of another clock

    Unknown are also the instants of all impacts, landings and lift-offs, and the motion itself. Samples off by more
    than five deviations are left out. Returns a `HopFit`, whose `machine` is one like any other. Raises `InputError`
    where the record lacks what is needed, and `NoOrbit` where no motion of the machine is like it.

    >>> import numpy as np
    >>> from orbits import simulate
    >>> from problems import Hopper, recordings
    >>> run, t = simulate(Hopper(mass_ratio=0.4, damping=0.05), 6.0, hops=2), np.linspace(0.0, 20.0, 200)
    >>> record = {"time": t, "body height": run(t)[:, 0], "foot height": run(t)[:, 2]}
    >>> found = recordings.fit(Hopper(mass_ratio=0.5, damping=0.04), record, ("mass_ratio", "damping"))
    >>> {name: round(value, 6) for name, value in found.values.items()}
    {'mass_ratio': 0.4, 'damping': 0.05}
    """
    names = _checked_names(machine, unknown)
    channels = channels_of(machine)
    records = read_hops(source, channels, machine.units is not None, columns, units)
    question = _question(_with_dampers(machine, names), names, records, channels, noise, offsets, delays)
    best: Fitted | None = None
    reason = ""
    for starts in _starts(question, records):
        try:
            fitted = Fitting(question, records, starts).fitted()
        except (OrbitsError, np.linalg.LinAlgError) as error:
            reason = f" ({error})"
            continue
        # A machine that lacks something leaves the same residuals from every start.
        again = best is not None and fitted.whole and best.whole and abs(fitted.misfit / best.misfit - 1) < FIT.again
        if best is None or (fitted.whole, -fitted.misfit) > (best.whole, -best.misfit):
            best = fitted
        if again or (best.whole and not best.lack):
            break
    if best is None or not best.misfit <= FIT.unlike:
        off = reason if best is None else f" (the nearest one is off by {best.misfit:.0%} of its range)"
        raise NoOrbit(
            f"no motion of the machine resembles the record{off}: state values that are nearer to the machine's, "
            "within a third of them, and check the units and the signs of the columns"
        )
    return _result(best, records)


def _checked_names(machine: Machine, unknown: str | Sequence[str]) -> tuple[str, ...]:
    """The names of the unknown parameters; raises `InputError` for a machine without such hops, and for names that it
    does not have."""
    check_machine(machine, "with_values", "restitution")
    refuse_hysteresis(machine.model)
    refuse_steps(machine.model, "a fit")
    if machine.model.flight.pieces:
        raise InputError("a law in pieces, such as a table, is not fitted: fit a formula to the table, springs.fit")
    if not machine.model.one_speed:
        raise InputError(
            f"a {machine.model.name} has launches of several numbers; a fit takes two masses on rigid ground"
        )
    names = tuple(list_of_names("unknown", unknown))
    known = [*free_parameters(machine), *(each for each in DAMPERS if hasattr(machine, each)), RESTITUTION]
    known = [*dict.fromkeys(known)]
    if not names:
        raise InputError(f"unknown = (): name the parameters to fit; the machine has {', '.join(known)}")
    if wrong := [name for name in names if name not in known]:
        near = suggest(str(wrong[0]), known)
        raise InputError(f"the machine has no parameter {wrong[0]!r}{near} It has {', '.join(known)}")
    if len({*names}) < len(names):
        raise InputError(f"unknown = {names}: a name occurs twice; leave one out")
    return names


def _with_dampers(machine: Any, names: Sequence[str]) -> Machine:
    """The machine, with a small damper where that is unknown and was none."""
    unit = machine.units.of(STIFFNESS) * machine.units.of(TIME) if machine.units else 1.0
    missing = [name for name in DAMPERS if name in names and getattr(machine, name) == 0]
    return machine.with_values(**dict.fromkeys(missing, FIT.damping * unit)) if missing else machine


def _question(
    machine: Machine, names: tuple[str, ...], records: Sequence[HopRecord], channels: Mapping[str, Channel],
    noise: Mapping[str, float] | None, offsets: Sequence[str] | None, delays: Sequence[str],
) -> Question:  # fmt: skip
    """What is fitted; raises `InputError` for channels that the record does not have, and too few samples."""
    own = {name: channels[name] for name in channels if any(name in record.values for record in records)}
    if not isinstance(noise, Mapping | None):
        raise InputError(
            f"noise = {noise!r}; it must map channels to standard deviations, such as {{'ground force': 5.0}}"
        )
    stated, delays = noise or {}, list_of_names("delays", delays)
    offsets = None if offsets is None else list_of_names("offsets", offsets)
    for what, names_of in (("noise", stated), ("offsets", offsets or ()), ("delays", delays)):
        if wrong := [each for each in names_of if each not in own]:
            raise InputError(f"{what}: the record has no channel {wrong[0]!r}; it has {', '.join(own)}")
    biased = [name in offsets if offsets is not None else own[name].dimension == LENGTH for name in own]
    delayed = [name in delays for name in own]
    if all(delayed):
        raise InputError(f"delays = {tuple(delays)}: leave one channel out; delays are relative to it")
    deviations = [number(f"noise of {name}", stated[name], low=0) if name in stated else np.nan for name in own]
    samples = [_samples(name, records) for name in own]
    count, needed = sum(len(each.values) for each in samples), FIT.fewest * (len(names) + 4 * len(records))
    if count < needed:
        raise InputError(f"{count} samples for {len(names)} parameters: at least {needed} are needed")
    for name, each in zip(own, samples, strict=True):
        if not len(each.values) or not np.ptp(each.values) > 0:
            raise InputError(f"the {name} is the same in all rows: it shows no hop")
    sizes = sizes_of([each.values for each in samples])
    pairs = zip(samples, sizes, strict=True)
    samples = [each._replace(weights=each.weights / (FIT.first_deviation * size)) for each, size in pairs]
    values = {**machine.values, RESTITUTION: machine.restitution}
    scales = tuple(abs(values[name]) or 1.0 for name in names)
    channels_of_record, ranges = tuple(own.values()), tuple(sizes.tolist())
    unknowns = Unknowns(machine, names, channels_of_record, tuple(biased), tuple(delayed), ranges, scales)
    return Question(unknowns, tuple(samples), np.array(deviations))


def _samples(name: str, records: Sequence[HopRecord]) -> Samples:
    """The samples of a channel in all records, with a weight of 1, or 0 where they look like spikes."""
    found = []
    for k, record in enumerate(records):
        if name in record.values:
            values = record.values[name]
            here = np.isfinite(values)
            found.append(np.array([np.full(here.sum(), k), record.times[here], values[here], usual(values[here])]))
    motion, times, values, weights = np.hstack(found)
    return Samples(motion.astype(int), times, values, weights)


def _starts(question: Question, records: Sequence[HopRecord]) -> list[list[Start]]:
    """Starts of the motions of all records, the best of each first."""
    unknowns, found = question.unknowns, []
    for record in records:
        pairs = zip(unknowns.channels, unknowns.biased, strict=True)
        own = [(channel, biased) for channel, biased in pairs if channel.name in record.values]
        own = [(channel, biased) for channel, biased in own if np.isfinite(record.values[channel.name]).any()]
        if not own:
            raise InputError(f"{record.name} has no sample of any channel")
        values = [record.values[channel.name].copy() for channel, _ in own]
        for each in values:
            here = np.isfinite(each)
            each[here] = np.where(usual(each[here]), each[here], np.nan)
        channels = {channel.name: channel for channel, _ in own}
        found.append(starts_of(unknowns.machine, channels, record.times, values, [biased for _, biased in own]))
    return [[each[min(i, len(each) - 1)] for each in found] for i in range(max(map(len, found)))]


def _result(fitted: Fitted, records: Sequence[HopRecord]) -> HopFit:
    """The result of a fit, with its covariance and what the record does not separate."""
    last, unknowns = fitted.last, fitted.last.program.unknowns
    apart = separation(last.program, last.z, last.program.slopes(last.z, fitted.weighted())[0])
    names = [each.name for each in unknowns.channels]
    biased = [i for i, own in enumerate(unknowns.biased) if own]
    late = [name for name, own in zip(names, unknowns.delayed, strict=True) if own]
    offsets = last.solution.bias * np.array(unknowns.sizes)[biased]
    return HopFit(
        source=last.machine,
        values=last.solution.values,
        covariance=apart.covariance,
        offsets=dict(zip([names[i] for i in biased], offsets.tolist(), strict=True)),
        delays=dict(zip(late, last.solution.delay.tolist(), strict=True)),
        noise=dict(zip(names, fitted.sigma.tolist(), strict=True)),
        inseparable=apart.together,
        remedy=apart.remedy,
        lack=fitted.lack,
        parts=fitted.parts(),
        samples={
            name: np.array([each.motion, each.times, each.values, each.values - off, each.weights > 0], dtype=float)
            for name, each, off in zip(names, last.program.samples, last.off, strict=True)
        },
        followed=[float(motion.edges[-1]) for motion in last.solution.motions],
        source_name="; ".join(record.name for record in records),
        unused=tuple(dict.fromkeys(name for record in records for name in record.unused)),
    )
