"""The docstrings of the packages as reStructuredText, and signatures as they are written in the sources.

A docstring is plain text with three conventions: a line `name : text` says what an argument or a field is, single
backticks are around code and names, and `>>>` begins an example. Everything else is taken as it stands.
"""

import ast
import inspect
import re
import textwrap

FIELD = re.compile(r"(?P<names>[A-Za-z_]\w*(?:, [A-Za-z_]\w*)*) : (?P<text>.+)")
CODE = re.compile(r"(``.+?``|`[^`]+`)")
SPECIAL = re.compile(r"[*|\\]|(?<=\w)_(?!\w)")
# Results are made by functions, so that how they are constructed would only be in the way.
RESULTS = {
    *("Active", "Bifurcation", "BifurcationCurve", "BifurcationDiagram", "Branch", "Disturbed", "Exploration"),
    *("Certificate", "Checked", "Control", "Design", "Driven", "Enclosure", "End", "Event", "Existence"),
    *("Family", "Front", "Hops", "Modes", "Orbit", "Point", "Proof", "ReturningHops", "Simulation", "Sweep"),
    *("PeriodDiagram", "PlaceOnCurve", "SweepProgress", "Uncertainty", "Machine", "Law", "MachineInSI"),
}


def escaped(line: str) -> str:
    """A line in which only what is in backticks is markup."""
    return "".join(part if part.startswith("`") else SPECIAL.sub(r"\\\g<0>", part) for part in CODE.split(line))


def restructured(lines: list[str]) -> list[str]:
    """The lines of a docstring with its fields as a definition list."""
    text, example, fields = [], False, False
    for line in lines:
        example = bool(line.strip()) and (example or line.lstrip().startswith(">>>"))
        field = FIELD.fullmatch(line)
        if example:
            text.append(line)
        elif field:
            text += [*([] if fields else [""]), ", ".join(f"``{name}``" for name in field["names"].split(", "))]
            text.append("    " + escaped(field["text"]))
            fields = True
            continue
        elif fields and line.startswith("    "):
            text.append(escaped(line))
            continue
        else:
            text.append(escaped(line))
        fields = False
    return text


def process_docstring(app, what, name, thing, options, lines: list[str]) -> None:
    """The event of autodoc, which takes the lines in place."""
    # Python's own docstring of a named tuple's field says nothing; the docstring of the class describes the fields.
    lines[:] = [] if lines and lines[0].startswith("Alias for field number") else restructured(lines)


def process_signature(app, what, name, thing, options, signature, returned):
    """The signature with the annotations of the source, which are shorter than what they stand for."""
    if what == "class":
        return ("", None) if name.rpartition(".")[2] in RESULTS else (_short(thing) or signature, None)
    if what not in ("function", "method"):
        return signature, returned
    try:
        function = ast.parse(textwrap.dedent(inspect.getsource(inspect.unwrap(thing)))).body[0]
    except (OSError, TypeError, SyntaxError):
        return signature, returned
    arguments = function.args
    positional = arguments.posonlyargs or arguments.args
    if what == "method" and positional and positional[0].arg in ("self", "cls"):
        (arguments.posonlyargs or arguments.args).pop(0)
    return f"({ast.unparse(arguments)})", function.returns and ast.unparse(function.returns)


def _short(thing: type) -> str:
    """How a class is called: names and simple defaults, without annotations."""
    try:
        signature = inspect.signature(thing)
    except (TypeError, ValueError):
        return ""
    simple = (int, float, str, bool, type(None), tuple)
    parameters = []
    for parameter in signature.parameters.values():
        default = parameter.default
        if default is not parameter.empty and (not isinstance(default, simple) or len(repr(default)) > 30):
            default = ...
        parameters.append(parameter.replace(annotation=parameter.empty, default=default))
    return str(signature.replace(parameters=parameters, return_annotation=signature.empty)).replace("Ellipsis", "...")


def setup(app) -> dict:
    app.connect("autodoc-process-docstring", process_docstring)
    app.connect("autodoc-process-signature", process_signature)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
