"""What only GitHub shows: a `<div class="on-github">` of a page says where to read what GitHub leaves out."""

import re

ONLY = re.compile(r'^<div class="on-github">\n.*?^</div>\n+', flags=re.MULTILINE | re.DOTALL)


def leave_out(app, page: str, source: list[str]) -> None:
    """The event of Sphinx, which takes the text of a page in place."""
    source[0] = ONLY.sub("", source[0])


def setup(app) -> dict:
    app.connect("source-read", leave_out)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
