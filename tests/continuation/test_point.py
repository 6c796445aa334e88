"""Points of families in files: a wrong value is refused by its name."""

import json

import pytest

from orbits import Family, InputError

FAULTS = [
    ("point", "u", []), ("point", "u", "abc"), ("point", "u", [1.0]), ("point", "tangent", []), ("point", "alpha", "x"),
    ("point", "tangent", [1.0]), ("certificate", "violations", "abc"), ("certificate", "error", "x"),
    ("certificate", "error", -1.0), ("certificate", "family", 1.5), ("point", "value", None),
    ("point", "alpha", 0.0), ("point", "tangent", [0.0, 0.0, 0.0]), ("point", "tangent", [0.0, 0.0, 1e-320]),
]  # fmt: skip


@pytest.mark.usefixtures("any_digest")
@pytest.mark.parametrize(("where", "key", "value"), FAULTS)
def test_a_point_with_a_wrong_value_is_refused_by_name(where, key, value, saved_documents, tmp_path):
    head, first, *rest = saved_documents["family"].splitlines()
    record = json.loads(first)
    (record["point"] if where == "point" else record["point"]["certificate"])[key] = value
    path = tmp_path / "family.jsonl"
    path.write_text("\n".join([head, json.dumps(record), *rest]))
    with pytest.raises(InputError, match=f"is not a saved family: .*{key}"):
        Family.load(path)
