"""The header of a record: which columns are extension and force, in which units, and which sense they count."""

import re
import unicodedata
from collections.abc import Sequence
from typing import NamedTuple

from orbits.errors import InputError
from orbits.units import STANDARD_GRAVITY

from .measured_rows import ROWS
from .text_rows import COMMENTS, are_numbers, cells_of, is_empty, short

# Words that name columns, without accents and in small letters: English, German, French, Spanish and Turkish.
EXTENSION_NAMES = (
    *("extension", "deflection", "displacement", "elongation", "travel", "stroke", "compression", "position"),
    *("crosshead", "length", "deformation", "weg", "verschiebung", "auslenkung", "dehnung", "verlangerung"),
    *("stauchung", "hub", "lange", "deplacement", "allongement", "course", "fleche", "enfoncement", "longueur"),
    *("desplazamiento", "elongacion", "alargamiento", "carrera", "recorrido", "deformacion", "deflexion"),
    *("compresion", "posicion", "longitud", "uzama", "degistirme", "yerdegistirme", "deplasman", "sehim"),
    *("sikisma", "strok", "konum", "uzunluk", "r", "x"),
)
ANGLE_NAMES = ("angle", "rotation", "twist", "winkel", "verdrehung", "drehung", "angulo", "giro", "aci", "donme")
FORCE_NAMES = (
    *("force", "tension", "load", "kraft", "last", "effort", "charge", "fuerza", "carga", "kuvvet", "yuk"),
    *("f", "fx", "fy", "fz"),
)
TORQUE_NAMES = ("torque", "moment", "couple", "momento", "tork")
# Words that end other ones, as in Federweg, Standardkraft and Drehmoment.
ENDS_OF_WORDS = ("weg", "kraft", "winkel", "moment")
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "in": 0.0254, "inch": 0.0254}
# kg and lb are of weights, under standard gravity.
POUND_FORCE = 0.45359237 * STANDARD_GRAVITY
FOOT = 0.3048
NEWTONS = {
    **{"N": 1.0, "mN": 1e-3, "cN": 1e-2, "daN": 10.0, "kN": 1e3, "MN": 1e6, "n": 1.0, "kn": 1e3},
    **dict.fromkeys(("kgf", "kg"), STANDARD_GRAVITY),
    "gf": 1e-3 * STANDARD_GRAVITY,
    **dict.fromkeys(("lbf", "lb", "lbs"), POUND_FORCE),
}
DEGREE = 0.017453292519943295
RADIANS = {"rad": 1.0, "mrad": 1e-3, "deg": DEGREE, "°": DEGREE, "degree": DEGREE, "degrees": DEGREE, "grad": DEGREE}
NEWTON_METRES = {
    **{"Nm": 1.0, "nm": 1.0, "mNm": 1e-3, "Ncm": 1e-2, "Nmm": 1e-3, "kNm": 1e3},
    **{"kgfm": STANDARD_GRAVITY, "kgfcm": 1e-2 * STANDARD_GRAVITY},
    **dict.fromkeys(("lbfin", "inlbf", "lbin", "inlb"), FOOT / 12 * POUND_FORCE),
    **dict.fromkeys(("lbfft", "ftlbf", "lbft", "ftlb"), FOOT * POUND_FORCE),
}
# Of each column, the units of a spring that is stretched and of one that is twisted.
UNITS = ((METRES, RADIANS), (NEWTONS, NEWTON_METRES))
SI_UNITS = (("m", "N"), ("rad", "N m"))
NAMES = ((*EXTENSION_NAMES, *ANGLE_NAMES), (*FORCE_NAMES, *TORQUE_NAMES))
NO_UNIT = ("", "-", "1")
UNIT_WORDS = {unit.lower() for each in UNITS for units in each for unit in units}
# Words of a header whose column counts tension and extension; beginnings of those of one that counts compression.
TENSILE = {"tension", "tensile", "extension", "elongation"}
COMPRESSIVE = ("compress", "compres", "druck", "stauch", "enfoncement", "sikis", "basma")
# Words of columns that are no measured extension or force beside one of a plain name.
NOT_MEASURED = {
    *("setpoint", "set", "target", "command", "commanded", "demand", "desired", "nominal", "time", "rate", "speed"),
    *("velocity", "limit", "error", "soll", "sollwert", "zeit", "consigne", "temps", "tiempo", "hedef", "zaman"),
}
MOST_LINES_BEFORE_HEADER = 200  # of a preamble
DELIMITERS = ("\t", ";", ",", None)


class RecordHeader(NamedTuple):
    """The line with the names of a record's columns.

    line : index of the first line of rows
    delimiter : what separates cells, None for blanks
    cells : of the header; the numbers of the first row where there is none
    under : cells of a row of units, () without one
    candidates : of extension and of force, the columns that may be meant
    """

    line: int
    delimiter: str | None
    cells: list[str]
    under: Sequence[str]
    candidates: tuple[list[int], list[int]]


class Columns(NamedTuple):
    """The two columns of a record that are used.

    places : of extension and force
    scales : their factors for SI, 1 without units
    sense : -1.0 where the header says that compression counts, else 1.0
    text : their names and units
    units : of the scaled numbers, "" without
    """

    places: tuple[int, int]
    scales: tuple[float, float]
    sense: float
    text: str
    units: tuple[str, str]


def find_header(where: str, lines: list[str], stated: Sequence[str | int] | None) -> RecordHeader:
    """The first line that names both columns with numbers below it; a comment only where nothing else is a header.

    stated : the names or the places, from 0, of both columns; None to recognise them
    Raises `InputError` for a record without such a line.
    """
    if stated is not None and all(isinstance(each, int) for each in stated):
        return _header_of_places(where, lines, [int(each) for each in stated])
    found, first = list[RecordHeader](), ""
    for commented in (False, True):
        for line, text in enumerate(lines[:MOST_LINES_BEFORE_HEADER]):
            if text.lstrip().startswith(COMMENTS) != commented or not text.strip(" \t,;"):
                continue
            first = first or text
            for delimiter in DELIMITERS:
                header = _header(lines, line, cells_of(text.lstrip("#%/ \t"), delimiter), delimiter, stated)
                if header is None:
                    continue
                if are_numbers(
                    _first_row(lines, header.line, delimiter), [*header.candidates[0], *header.candidates[1]]
                ):
                    return header
                found.append(header)
    if found:
        return found[0]
    raise InputError(_why_no_header(where, lines, first, stated))


def used_columns(where: str, header: RecordHeader, units: Sequence[str] | None, in_si: bool) -> Columns:
    """The columns of extension and force; raises `InputError` where several may be meant, and for a missing, an
    unknown and a foreign unit.

    units : of both columns, None for those of the header
    """
    places = _column_meant(where, header, 0), _column_meant(where, header, 1)
    if places[0] == places[1]:
        raise InputError(f"{where}: {_title(header.cells[places[0]])!r} cannot be both columns: state two")
    cells = [header.cells[place] for place in places]
    has_names = not are_numbers(cells, (0, 1))
    titles = [_title(cell) if has_names else f"column {place}" for cell, place in zip(cells, places, strict=True)]
    if units is None and has_names:
        units = [
            f"[{header.under[place]}]" if header.under else _unit_in(header.cells[place], NAMES[role])
            for role, place in enumerate(places)
        ]
    scales, own = scales_of(where, titles, units or ("", ""), in_si)
    words = [unit.strip(" []()") for unit in units or ("", "")]
    described = [f"{title} in {word}" if in_si else title for title, word in zip(titles, words, strict=True)]
    return Columns(places, scales, _sense(where, cells) if has_names else 1.0, " and ".join(described), own)


def scales_of(
    where: str, titles: Sequence[str], units: Sequence[str], in_si: bool
) -> tuple[tuple[float, float], tuple[str, str]]:
    """The factors of both columns for SI, and the units then, m and N or rad and N m.

    Raises `InputError` for a unit where there are none, and for a missing, an unknown and a foreign one.
    """
    scales, twisted = list[float](), list[bool]()
    for title, unit, known in zip(titles, units, UNITS, strict=True):
        plain = unit.strip(" []()")
        spelled = re.sub(r"[\s·*.^-]+", "", plain)
        found = [name in own for name in (spelled, spelled.lower()) for own in known]
        if not in_si:
            # Without brackets, an unknown word belongs to the name.
            if plain not in NO_UNIT and (any(found) or plain != unit):
                raise InputError(
                    f"{where} gives {short(title)!r} in {short(plain)}, but this machine has no units: "
                    "state it with hopper_in_si (a file's [si]; a table in_si=True), or take units out of the header"
                )
            scales.append(1.0)
        elif plain in NO_UNIT or (not any(found) and plain == unit):
            remedy = 'state the units, units=("mm", "N") (table:FILE?units=mm,N)'
            raise InputError(f"{where} gives no unit of {short(title)!r}, but this machine is in SI: {remedy}")
        elif not any(found):
            names = ", ".join(name for own in known for name in own)
            raise InputError(f"{where}: unknown unit {short(plain)!r}; known: {names}")
        else:
            i = found.index(True)
            twisted.append(bool(i % 2))
            scales.append(known[i % 2][spelled if i < 2 else spelled.lower()])
    if len(set(twisted)) > 1:
        both = " and ".join(unit.strip(" []()") for unit in units)
        raise InputError(f"{where}: {both} belong to two kinds of springs: use mm with N, or deg with N m")
    return (scales[0], scales[1]), (("", "") if not in_si else SI_UNITS[twisted[0]])


def _sense(where: str, headers: Sequence[str]) -> float:
    """-1.0 where the headers of extension and force say that compression counts, else 1.0."""
    compressed = [any(word.startswith(COMPRESSIVE) for word in words_of(header)) for header in headers]
    for header, other, is_compressed in zip(headers, headers[::-1], compressed, strict=True):
        if not is_compressed and any(compressed) and not TENSILE.isdisjoint(words_of(header)):
            both = f"{short(header.strip())!r} and {short(other.strip())!r}"
            raise InputError(f"{where}: {both} have opposite signs: reverse one column and its name")
    return -1.0 if any(compressed) else 1.0


def _header(
    lines: list[str], line: int, cells: list[str], delimiter: str | None, stated: Sequence[str | int] | None
) -> RecordHeader | None:
    """Cells as a header, with the row of units below it; None where they do not name both columns."""
    if stated is None:
        columns = _columns_recognised(cells, 0), _columns_recognised(cells, 1)
    else:
        columns = _columns_stated(cells, stated[0]), _columns_stated(cells, stated[1])
    if not all(columns):
        return None
    below = line + 1
    while below < len(lines) and is_empty(lines[below], delimiter):
        below += 1
    under = [cell.strip(" []()") for cell in cells_of(lines[below] if below < len(lines) else "", delimiter)]
    has_units = len(under) > max(map(max, columns)) and any(
        _is_unit(under[place], role) for role in (0, 1) for place in columns[role]
    )
    return RecordHeader(below + 1 if has_units else below, delimiter, cells, under if has_units else (), columns)


def _header_of_places(where: str, lines: list[str], places: list[int]) -> RecordHeader:
    """The header above the first row with numbers at two places; the row itself where no line above has its cells."""
    above: tuple[int, list[str]] | None = None
    for delimiter in DELIMITERS:
        for line, text in enumerate(lines[:MOST_LINES_BEFORE_HEADER]):
            cells = [] if is_empty(text, delimiter) else cells_of(text, delimiter)
            if min(places) < 0 or len(cells) <= max(places):
                continue
            if not are_numbers(cells, places):
                above = above or (line, cells)
                continue
            columns = [places[0]], [places[1]]
            if above is None:
                return RecordHeader(line, delimiter, cells, (), columns)
            return _header(lines, above[0], above[1], delimiter, places) or RecordHeader(
                line, delimiter, cells, (), columns
            )
        above = None
    raise InputError(f"{where} has no row with numbers in columns {places[0]} and {places[1]}, counted from 0")


def _columns_recognised(cells: Sequence[str], role: int) -> list[int]:
    """The columns that may be extension, or force, by their names and units."""
    named = [i for i, cell in enumerate(cells) if _names(cell, NAMES[role])]
    # A cell that names both, as load cell displacement, has its last word for a noun.
    named = [i for i in named if _last_name(cells[i]) == role]
    plain = [_unit_in(cells[i], NAMES[role]) for i in named]
    own = [i for i, unit in zip(named, plain, strict=True) if _is_unit(unit.strip(" []()"), role)]
    foreign = [i for i, unit in zip(named, plain, strict=True) if unit.startswith(("[", "(")) and i not in own]
    return [i for i in named if i not in foreign] if len(foreign) < len(named) else named


def _columns_stated(cells: Sequence[str], stated: str | int) -> list[int]:
    """The columns of a stated name, or of a place."""
    if isinstance(stated, int):
        return [stated] if 0 <= stated < len(cells) else []
    for same in (str.strip, lambda text: _title(text).casefold()):
        if found := [i for i, cell in enumerate(cells) if same(cell) == same(stated)]:
            return found
    return []


def _column_meant(where: str, header: RecordHeader, role: int) -> int:
    """The column that is meant; raises `InputError` where several may be."""
    columns = header.candidates[role]
    counts = [_count_of_words(header.cells[i]) for i in columns]
    plainest = columns[counts.index(min(counts))]
    # Of `Force setpoint` and `Force` the plain name is that of the measured column.
    others = [i for i in columns if i != plainest]
    if counts.count(min(counts)) == 1 and not any(NOT_MEASURED.isdisjoint(words_of(header.cells[i])) for i in others):
        return plainest
    names = " and ".join(repr(short(header.cells[i].strip())) for i in columns[:3])
    what, remedy = ("extension", "force")[role], 'columns=("NAME", "NAME") or columns=(0, 1), table:FILE?columns=0,1'
    raise InputError(f"{where}: each of {names} may be the {what}: state both columns, {remedy}")


def _why_no_header(where: str, lines: list[str], first: str, stated: Sequence[str | int] | None) -> str:
    """Why no line of a record is a header, in words."""
    if len([text for text in lines if text.strip(" \t,;")]) < 2:
        return f"{where} has no rows; it needs a header and at least {ROWS.fewest} rows"
    if stated is not None:
        return f"{where} has no columns {stated[0]!r} and {stated[1]!r}: its header is {short(first)!r}"
    cells = re.split(r"[\t;,]|\s+", first.strip())
    if are_numbers(cells, range(len(cells))):
        remedy = "state its columns, columns=(0, 1), and their units"
        return f"{where} has no header; name its columns in the first row, or {remedy}"
    names = FORCE_NAMES if any(_names(cell, EXTENSION_NAMES) for cell in cells) else EXTENSION_NAMES
    has = f"its header is {short(first)!r}, known names are {', '.join(names)}"
    return f"{where} has no column {names[0]}: {has}; or state the columns, columns=(0, 1)"


def _first_row(lines: list[str], line: int, delimiter: str | None) -> list[str]:
    return cells_of(next((each for each in lines[line:] if not is_empty(each, delimiter)), ""), delimiter)


def words_of(cell: str) -> list[str]:
    """The words of a cell in small letters without accents."""
    letters = unicodedata.normalize("NFKD", cell.replace("\u0131", "i").replace("\u00df", "ss"))
    plain = "".join(letter for letter in letters if not unicodedata.combining(letter)).lower()
    return [word for word in re.split(r"[\s_()\[\]/,.:|-]+", plain) if word]


def _title(cell: str) -> str:
    """A column's name without a unit in brackets."""
    return short(re.sub(r"\s*[\[(][^\])]*[\])]", "", cell).strip())


def _count_of_words(cell: str) -> int:
    """The number of words that name a column, without its unit."""
    return sum(word not in UNIT_WORDS for word in words_of(re.sub(r"[\[(][^\])]*[\])]", " ", cell)))


def _names_a_column(word: str, first: bool, names: Sequence[str]) -> bool:
    ends = tuple(end for end in ENDS_OF_WORDS if end in names)
    return word.endswith(ends) or (word in names and (len(word) > 1 or first))


def _names(cell: str, names: Sequence[str]) -> bool:
    """Whether a cell names a column: by its first word, or by a longer one later on."""
    return any(_names_a_column(word, i == 0, names) for i, word in enumerate(words_of(cell)))


def _last_name(cell: str) -> int:
    """Whether the last word of a cell that names a column names the extension, 0, or the force, 1."""
    roles = [
        role for i, word in enumerate(words_of(cell)) for role in (0, 1) if _names_a_column(word, i == 0, NAMES[role])
    ]
    return roles[-1]


def _is_unit(unit: str, role: int) -> bool:
    spelled = re.sub(r"[\s·*.^-]+", "", unit)
    return any(spelled in known or spelled.lower() in known for known in UNITS[role])


def _unit_in(cell: str, names: Sequence[str]) -> str:
    """The unit in a header's cell: the text in brackets, with them, or else the last word if it is not the name."""
    if bracketed := re.search(r"[\[(][^\])]*[\])]", cell):
        return bracketed[0]
    last = [word for word in re.split(r"[\s_/,:]+", cell.strip()) if word][-1:]
    return "" if not last or _names(last[0], names) else last[0]
