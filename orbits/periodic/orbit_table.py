"""The table of an orbit: its rows, and the digits of its numbers that their errors allow."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import OrbitsError
from ..model import STEP_LENGTH
from ..result import Row
from ..tables import VIOLATED, machine_numbers
from ..units import APEX, ENERGY, LIFTOFF_SPEED, RISE, TORQUE
from .quantities import OF_RUNS, QUANTITIES

if TYPE_CHECKING:
    from .orbit import Orbit

BOUND = "   +- {:.1e} (numerical)"
# The quantities of an orbit that stand behind another one in its row, by the words for them.
BESIDE = {
    "period": ("frequency", "frequency"),
    "contact_time": ("duty_factor", "duty factor"),
    "liftoff_extension": ("stroke", "stroke"),
    "largest_contact_force": ("peak_force_in_weights", ""),
}


class TableOptions(NamedTuple):
    """How many digits of a quantity are known, and which widths of launches are stated.

    safety : of an error relative to that of alpha. Of 120 hoppers and jugglers in families up to 24, solved by two
        methods, no quantity differed by more than 3.9 times the relative error of alpha, lengths relative to the motion
    of_deviation : share of a standard deviation that counts as an error, so that its second digit is shown
    narrow : share of alpha below which a width of the launches that are attracted is stated: on 45 hoppers the true one
        was then 0.4 to 4 times that of the leading order, and beyond any number
    """

    safety: float = 4.0
    of_deviation: float = 0.1
    narrow: float = 0.05


TABLE_OF_ORBIT = TableOptions()


def errors_of(orbit: "Orbit", options: TableOptions = TABLE_OF_ORBIT) -> dict[str, float]:
    """Estimates of the errors of an orbit's quantities by name, by its numerics and by the noise of a table's rows."""
    numbers, c, size = orbit.numbers, orbit.certificate, abs(orbit.alpha) or 1.0
    noise = options.of_deviation * (c.alpha_noise or 0.0) / size
    share = options.safety * c.error / size + noise
    places = [abs(x) for x in (*orbit.rises.values(), *orbit.apexes.values(), c.smallest_separation) if x is not None]
    sizes = dict.fromkeys(("clearance", "smallest_separation", "rises", "apexes"), max(places, default=0.0))
    sizes["smallest_contact_force"] = c.largest_contact_force or 0.0
    known = {name: abs(x) for name in (*QUANTITIES, *OF_RUNS) if isinstance(x := numbers.get(name), float)}
    found = {name: share * max(sizes.get(name, 0.0), known.get(name, 0.0)) for name in {*sizes, *known}}
    if c.loss_error is not None and c.loss_coefficient:
        found["loss_coefficient"] = c.loss_error + noise * abs(c.loss_coefficient)
    if c.friction_needed is not None:
        found["friction_needed"] = c.friction_error or 0.0
    return found


def rows_of_orbit(orbit: "Orbit") -> Iterator[Row]:
    """The machine, then the certificate: speed, times, distances, forces, the loss of a neighbouring hop, errors,
    whether it is a motion, and, in rows named `VIOLATED`, the reasons why not. A quantity without a value has no row,
    except the separation, which is not checked then."""
    c, own, errors = orbit.certificate, machine_numbers(orbit.machine), errors_of(orbit)
    if own:
        texts = [f"{name} = {{:g}} {unit}".rstrip() for name, (_, unit) in own.items()]
        numbers = {name.replace(" ", "_"): value for name, (value, _) in own.items()}
        yield Row("machine", numbers, (", ".join(texts),))
    yield _with_error("alpha", "alpha", orbit.alpha, c.error, orbit.unit_of("alpha"))
    yield from _by_noise(orbit)
    for name, value in orbit.tuned.items():
        if name != STEP_LENGTH:
            yield _with_error(f"tuned {name}", name, value, orbit.tuned_errors[name], orbit.unit_of(name))
    yield from _launches(orbit)
    for name, quantity in QUANTITIES.items():
        if name == "rises":
            yield from _heights(orbit, errors)
        elif quantity.words and name != "alpha" and (name == "smallest_separation" or orbit.numbers[name] is not None):
            row = _quantity(orbit, name, errors)
            angular = orbit.scales is not None and orbit.scales.resolved(name) == (*TORQUE, 0, 0)
            yield row._replace(heading=quantity.words.replace("force", "torque") if angular else quantity.words)
    for name, quantity in OF_RUNS.items() if orbit.step is not None else ():
        yield _quantity(orbit, name, errors)._replace(heading=quantity.words)
    yield from _friction(orbit)
    yield from _on_loop(orbit)
    if orbit.known_in_family is not None:
        yield Row("known in its family", {"known_in_family": orbit.known_in_family})
    yield Row("residual", {"residual": c.residual}, ("{:.1e}",))
    yield Row("energy drift", {"energy_drift": c.energy_drift}, ("{:.1e}",))
    found = {"method": orbit.method, "seconds": orbit.seconds}
    yield Row("found by", found, (f"{{}}, {1e3 * orbit.seconds:.1f} ms",))
    yield Row("admissible", {"admissible": orbit.admissible}, ("yes" if orbit.admissible else "NO",))
    yield from (Row(VIOLATED, {VIOLATED: violation}) for violation in c.violations)


def _with_error(heading: str, name: str, value: float, error: float, unit: str) -> Row:
    """The row of a number with its error, which has all of its digits on a page too."""
    pattern = f"{{:all}} {unit}".rstrip() + BOUND
    return Row(heading, {name: value, "error": error}, (pattern,), {name: error})


def _by_noise(orbit: "Orbit") -> Iterator[Row]:
    """What is known of the error of alpha by the noise of a table's rows."""
    c, speed = orbit.certificate, f" {orbit.unit_of('alpha')}".rstrip()
    if c.alpha_noise is not None:
        text = f"+- {{:.1e}}{speed} (one standard deviation of the rows{', or less' if c.alpha_per_noise else ''})"
        yield Row("  by the table's noise", {"alpha_noise": c.alpha_noise}, (text,))
    if c.alpha_per_noise is not None:
        force = orbit.unit_of("largest_spring_force") or "unit"
        text = f"+- {{:.2g}}{speed} for each {force} of a row's standard deviation"
        text = text if c.alpha_noise is not None else f"not known: {text}"
        yield Row("  by the table's noise", {"alpha_per_noise": c.alpha_per_noise}, (text,))


def _launches(orbit: "Orbit") -> Iterator[Row]:
    """The launches that come to the orbit."""
    width = orbit.certificate.attraction_width(orbit.restitution)
    if width is not None and width < TABLE_OF_ORBIT.narrow * orbit.alpha:
        unit = f" {orbit.unit_of('alpha')}".rstrip()
        yield Row("launch range", {"launch_range": width}, (f"up to {{:.2g}}{unit} above alpha, to leading order",))
    elif width is not None:
        yield Row("launch range", {"launch_range": "above alpha, beyond the range of the leading order"})


def _quantity(orbit: "Orbit", name: str, errors: Mapping[str, float]) -> Row:
    """The row of a quantity, with another one that belongs to it."""
    c, numbers = orbit.certificate, orbit.numbers
    row = Row.of(name, numbers[name], orbit.unit_of(name))
    if name == "loss_coefficient":
        within = BOUND.partition(" (")[0].format(c.loss_error) if c.loss_error and not c.alpha_noise else ""
        pattern = "{:all}" if c.loss_error else "{}"
        row = Row.of(name, numbers[name], orbit.unit_of(name), within + c.losses_in_words(orbit.restitution), pattern)
    beside, words = BESIDE.get(name, ("", ""))
    if numbers.get(beside) is not None:
        unit = " weights" if beside == "peak_force_in_weights" else f" {orbit.unit_of(beside)}".rstrip()
        cells = (f"{row.cells[0]}   ({words} {{}}{unit})".replace("( ", "("),)
        row = row._replace(values={name: numbers[name], beside: numbers[beside]}, cells=cells)
    return row._replace(errors=errors)


def _heights(orbit: "Orbit", errors: Mapping[str, float]) -> Iterator[Row]:
    """The rise of each height, and its apex where it does not lift off from the ground."""
    unit, apexes = f" {orbit.unit_of('rises')}".rstrip(), orbit.apexes
    for name, rise in orbit.rises.items():
        key = name.replace(" ", "_")
        values, pattern = {f"{key}{RISE}": rise}, f"{{}}{unit}"
        if name in apexes and abs(apexes[name] - rise) > errors["apexes"]:
            values, pattern = values | {f"{key}{APEX}": apexes[name]}, f"{pattern}   (apex {{}}{unit})"
        yield Row(f"rise of {name}", values, (pattern,), dict.fromkeys(values, errors["rises"]))


def _friction(orbit: "Orbit") -> Iterator[Row]:
    """The friction that a machine in the plane needs."""
    c = orbit.certificate
    if c.friction_needed is not None:
        numbers = {"friction_needed": c.friction_needed, "friction_error": c.friction_error or 0.0}
        errors = {"friction_needed": numbers["friction_error"]}
        yield Row("friction needed", numbers, ("{:all}   +- {:.1e}",), errors)
    elif (least := c.smallest_stance_force) is not None and least <= 0 and c.stance_judged is False:
        remedy = "; state share=" if "share" in orbit.machine.get("parameters", {}) else ""
        text = f"not judged (smallest force {{:.3g}}){remedy}"
        yield Row("standing foot", {"smallest_stance_force": least}, (text,))


def _on_loop(orbit: "Orbit") -> Iterator[Row]:
    """What the hop loses on the measured loop of the spring."""
    try:
        upkeep: Any = orbit.upkeep_on_loop
    except OrbitsError as error:
        yield Row("on the measured loop", {"on the measured loop": str(error)})
        return
    if upkeep is not None:
        speed, joule = (f" {orbit.scales.text(each)}" if orbit.scales else "" for each in (LIFTOFF_SPEED, ENERGY))
        numbers = {"loop_energy": upkeep.energy, "next launch on the loop": orbit.alpha - upkeep.inject}
        text = f"a hop loses {{:.4g}}{joule}; its next launch speed is {{:.6g}}{speed}"
        yield Row("on the measured loop", numbers, (text,))
