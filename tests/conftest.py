"""Shared by the tests: the reference values, and machines as they state them."""

import json
from pathlib import Path

import pytest

from problems import Hopper

DATA = Path(__file__).parent / "data"
REFERENCES = json.loads((DATA / "orbits.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory):
    """Compiled code is kept in a temporary folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


def machine_of(reference: dict) -> Hopper:
    """The hopper of a reference orbit."""
    return Hopper(
        reference["spring"],
        reference["gravity"],
        reference["mass_ratio"],
        reference["rest_length"],
        parameters=reference["parameters"],
    )


def name_of(reference: dict) -> str:
    return f"{reference['spring']}, {reference['gravity']}, family {reference['family']}".replace(" ", "")


@pytest.fixture(params=REFERENCES, ids=name_of)
def reference(request) -> dict:
    """Each orbit of the reference file in turn."""
    return request.param
