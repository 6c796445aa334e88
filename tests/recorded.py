"""Shared by the tests that hold what they find against what has been found before, in `data/NAME.json`.

Where a change is meant, run the tests with RECORD=1 in the environment, and look at the difference.
"""

import json
import os
from pathlib import Path
from typing import Any

DATA = Path(__file__).parent / "data"


def known(name: str, key: str, found: Any) -> Any:
    """What is recorded in the file of this name under a key; where that is asked for, what has been found."""
    path = DATA / f"{name}.json"
    values = json.loads(path.read_text(encoding="utf-8"))
    if os.environ.get("RECORD"):
        values[key] = found
        text = json.dumps(dict(sorted(values.items())), indent=1, ensure_ascii=False)
        path.write_text(text + "\n", encoding="utf-8")
    return values[key]
