"""How Sphinx builds the documentation; `build.py` is the command."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Of the processes that draw figures; some versions of Python give them no other path for what they load first.
os.environ |= {"MPLBACKEND": "Agg", "PYTHONPATH": os.pathsep.join(sys.path[:2])}

project = "persistent-orbits"
author = "The persistent-orbits developers"
copyright = author  # noqa: A001 - the name that Sphinx asks for
html_title = project

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx_copybutton",
    "parts.mathematics",
    "parts.docstrings",
    "parts.names",
    "parts.drawings",
    "parts.lines",
    "parts.commands",
    "parts.github",
    "parts.notebooks",
]
myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3
exclude_patterns = ["parts/**"]

nitpicky = True
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autoclass_content = "class"
add_module_names = False
python_use_unqualified_type_names = True
maximum_signature_line_length = 90
pygments_style = "tango"  # legible on white for the colour-blind too
toc_object_entries_show_parents = "hide"

# What a reader would type or save has a button that copies it, without prompts; what is printed has none.
LANGUAGES = ("console", "default", "ipython3", "python", "sh", "text", "toml")
copybutton_selector = ", ".join(f"div.highlight-{language} pre" for language in LANGUAGES)
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

html_theme = "furo"
html_math_renderer = "mathml"
html_copy_source = False
html_show_search_summary = False  # a page on the disk may not read another one
html_show_sphinx = False
html_static_path = ["style"]
html_css_files = ["page.css"]
html_theme_options = {"navigation_with_keys": True}
