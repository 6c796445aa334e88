"""Shared by the tests of files: saved results as texts."""

from pathlib import Path

from orbits import find, follow
from problems import Hopper, hopper_in_si

NO_UNITS = (0, -1.0, 1e-320, 1e200)  # of which none can be a unit


def saved(folder: Path) -> dict[str, str]:
    """Saved orbits, one of them in SI, and a saved family, as texts."""
    orbit = find(Hopper("r + beta*r**3", rest_length=20, parameters={"beta": 0.3}))
    family = follow(Hopper("cubic", rest_length=20), "beta", 0.2, 0.1, longest=0.5)
    in_si = find(hopper_in_si(2.0, 1.0, stiffness=50.0, rest_length=1.0))
    texts = {"orbit": orbit.save(folder / "o.json").read_text(), "family": family.save(folder / "f.jsonl").read_text()}
    return {**texts, "orbit in SI": in_si.save(folder / "o.json").read_text()}
