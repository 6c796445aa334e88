"""The file format of orbits: JSON with every float at 17 significant digits, read strictly."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..flow.trajectory import Trajectory
from ..io import to_json
from ..model.model import Units
from ..model.phase import Affine
from .certificate import CERTIFICATE_FIELDS, Certificate
from .cycle import Shape

ORBIT_FORMAT = "persistent-orbits orbit 1"
# What describes a machine in a document.
MACHINE_FIELDS = ("machine", "spring", "gravity", "mass_ratio", "rest_length", "restitution", "parameters", "laws_in")


def write_orbit(
    path: str | Path,
    document: Mapping[str, Any],
    shape: Shape,
    flight: Trajectory,
    contact: Trajectory | None,
    units: Units | None,
) -> Path:
    """Write an orbit's document and its motion; returns the path, raises `InputError` when that cannot be."""
    motion = {
        "shape": {
            "reversor": shape.reversor,
            "contact_reversor": shape.contact_reversor,
            "embed": shape.embed.tolist(),
            "heights": {name: [height.weights, height.offset] for name, height in shape.heights.items()},
            "springs": shape.springs,
        },
        "flight": _path_document(flight),
        "contact": contact and _path_document(contact),
        "units": units and asdict(units),
    }
    path = Path(path)
    try:
        path.write_text(to_json({"format": ORBIT_FORMAT, **document, "motion": motion}) + "\n", encoding="utf-8")
    except (OSError, ValueError) as error:
        raise InputError(f"the orbit cannot be saved to {path}: {error}") from None
    return path


def read_orbit(path: str | Path) -> dict[str, Any]:
    """The fields of the `Orbit` in a file, by name; raises `InputError` when the file is not one."""
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
        if data["format"] != ORBIT_FORMAT:
            raise ValueError(f"format {data['format']!r}, expected {ORBIT_FORMAT!r}")
        motion = data["motion"]
        checked = {name: data[name] for name in CERTIFICATE_FIELDS if name != "violations"}
        return {
            "machine": {name: data[name] for name in MACHINE_FIELDS},
            **{name: _float_of(data[name]) for name in ("alpha", "liftoff_extension", "flight_time")},
            "contact_time": data["contact_time"] and _float_of(data["contact_time"]),
            "flight": _path_of(motion["flight"]),
            "contact": motion["contact"] and _path_of(motion["contact"]),
            "shape": _shape_of(motion["shape"]),
            "certificate": Certificate(**checked, violations=tuple(data["violations"])),
            "method": data["method"],
            "skipped": tuple(data["skipped"]),
            "seconds": data["seconds"],
            "units": motion["units"] and Units(**motion["units"]),
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is not a saved orbit: {error}") from None


def _path_document(path: Trajectory) -> dict[str, Any]:
    return {"names": path.names, "times": path.times, "coefficients": path.coefficients}


def _path_of(data: Mapping[str, Any]) -> Trajectory:
    path = Trajectory(np.array(data["times"]), np.array(data["coefficients"]), tuple(data["names"]))
    steps, rows, _ = path.coefficients.shape
    if len(path.times) != steps + 1 or rows != len(path.names) or not (path.steps > 0).all():
        raise ValueError("its motion is damaged")
    return path


def _shape_of(data: Mapping[str, Any]) -> Shape:
    return Shape(
        data["reversor"] and tuple(data["reversor"]),
        data["contact_reversor"] and tuple(data["contact_reversor"]),
        np.array(data["embed"]),
        {name: Affine(tuple(weights), offset) for name, (weights, offset) in data["heights"].items()},
        tuple(map(tuple, data["springs"])),
    )


def _float_of(value: Any) -> float:
    if not isinstance(value, float):
        raise ValueError(f"{value!r} is not a number")
    return value
