"""The paper claim by claim: every number and figure of Chatterjee, Pratap, Reddy and Ruina beside ours, on one page.

Each claim is one row: what the paper says, in which section, its number, ours, and how near they must be (half a unit
of the last digit that is printed, or rounding where the claim is exact). Then the errata, and what the paper could not
show. The page is one HTML file that needs no network.
Run: python studies/reproduction.py [--output FOLDER] [--quick]
"""

import argparse
import base64
import html
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a script too it finds the other studies

from orbits.show import STYLE as FIGURE_STYLE, THEME
from studies import (
    air_track,
    attraction,
    chain,
    claims,
    damped_hopper,
    design,
    existence,
    figure_3,
    figure_4,
    figure_5,
    figure_6,
    figure_7,
    figure_8,
    gravity_families,
    spring_families,
    start_up,
)
from studies.claims import Claim


@dataclass(frozen=True)
class Part:
    """A part of the page.

    rows : yields the claims' fields, as the functions in `claims`
    figures : their titles, the studies that draw them, and whether those have a quick mode
    """

    title: str
    words: str
    rows: Callable[[], Iterator[tuple]]
    figures: tuple[tuple[str, ModuleType, bool], ...] = ()


PARTS = (
    Part(
        "Lossless motions",
        "Launched at one of the speeds alpha*, the foot lands without speed, acceleration or energy lost, however "
        "plastic the impact.",
        claims.lossless,
        (
            ("Fig. 3: lossless hop and juggle", figure_3, False),
            ("Fig. 4: ways to land", figure_4, False),
            ("Fig. 6: the foot's path", figure_6, False),
            ("Fig. 7: why lossless hops exist", figure_7, False),
        ),
    ),
    Part(
        "The return map",
        "From the launch speed at one lift-off to that at the next; light and heavy feet are its limits.",
        claims.maps,
        (("Fig. 5: the return map", figure_5, True),),
    ),
    Part(
        "Stability",
        "A lossless hop attracts from above and repels from below. A little energy added at every hop makes it stable.",
        claims.stability,
        (("Fig. 8: injections", figure_8, True), ("Section 11: attraction", attraction, True)),
    ),
    Part(
        "The air track",
        "The table-top experiment of section 10 from its SI data.",
        claims.on_the_air_track,
        (("Section 10: the air track", air_track, False),),
    ),
    Part(
        "Errata",
        "What we found otherwise than printed. Section 7: eqs. (2) turn into eqs. (4) with one clock for hopper and "
        "juggler, not with clocks in the ratio sqrt(M/(1 + M)). Section 9: the bound -2 for stable bouncing is on the "
        "hand's acceleration, where a speed is printed; bouncing reaches beyond the 3.59 of Fig. 5(d)'s caption, since "
        "bouncing of period two goes on; and the slope of the map does not jump at a lossless launch: to its left it "
        "is above one, but it tends to one there too, as 1 + (40/3) C d^(1/3). Section 10: the unit of length is "
        "5.429 mm. R&P, Reddy and Pratap (Phys. Rev. E 68, 2003): the map does not change with the inversion of the "
        "mass ratio for hops of one impact only.",
        claims.errata,
    ),
    Part(
        "Beyond the paper",
        "Nonlinear springs, varying gravity, the local law of the loss, period doubling, chains of masses, control and "
        "design. Expected are closed forms and values of 40-digit arithmetic.",
        claims.beyond,
        (
            ("Families of nonlinear springs", spring_families, True),
            ("Families in varying gravity", gravity_families, True),
            ("Existence in two parameters", existence, True),
            ("Chains of masses", chain, True),
            ("What damping costs", damped_hopper, True),
            ("Starts and recoveries", start_up, True),
            ("A leg by design", design, True),
        ),
    ),
)
# Pixels an inch of a figure has at least, so that its type can be read on a small screen, where the figure is moved
# sideways in its frame; and at most.
SMALLEST, LARGEST = 95, 135
STYLE = """body{font:16px/1.5 system-ui,sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem;color:var(--ink);
background:var(--ground);overflow-wrap:break-word}
table{border-collapse:collapse;width:100%;font-size:.9rem}td,th{padding:.25rem .6rem;border-bottom:1px solid #8888;
text-align:left}.n{text-align:right;white-space:nowrap;font-variant-numeric:tabular-nums}.no{background:#fbd9d0;color:#222}
.figure{overflow-x:auto}.figure img{display:block;width:100%;filter:var(--figure)}
@media(max-width:48rem){h1{font-size:1.5rem}thead{display:none}td{border:0;padding:0;text-align:left!important}
tr{display:grid;grid-template-columns:1fr 1fr;padding:.4rem 0;border-bottom:1px solid #8888}
td:nth-child(2){grid-column:1/-1;grid-row:1;font-weight:600}td:not(:nth-child(2))::before{content:attr(data-head) " ";
opacity:.75}td:empty{display:none}}"""


def page(parts: list[tuple[Part, list[Claim], list[tuple[str, str, Path]]]], quick: bool) -> str:
    """The page: part by part what it is about, its claims, and its figures with what their studies are for."""
    rows = [row for _, own, _ in parts for row in own]
    lines = [
        "<!doctype html><html lang='en'><meta charset='utf-8'>",
        "<meta name='viewport' content='width=device-width, initial-scale=1'>",
        f"<title>The paper, claim by claim</title><style>{THEME}{STYLE}</style>",
        "<h1>Persistent orbits: the paper, claim by claim</h1>",
        "<p>A. Chatterjee, R. Pratap, C. K. Reddy and A. Ruina, <i>Persistent passive hopping and juggling is possible "
        "even with plastic collisions</i>, Int. J. Robotics Research 21 (2002) 621-634.</p>",
        f"<p>{sum(row.ok for row in rows)} of {len(rows)} claims hold. The error of each is to be at most what stands "
        "beside it: a unit of the last digit printed, or rounding where the claim is exact."
        + (" The figures are drafts, of fewer points and families than their words say." if quick else "")
        + "</p>",
    ]
    for part, own, figures in parts:
        lines.append(f"<h2>{html.escape(part.title)}</h2><p>{html.escape(part.words)}</p>{_table(own)}")
        for title, words, path in figures:
            lines += [f"<h3>{html.escape(title)}</h3><p>{html.escape(words)}</p>", _picture(path, title)]
    return "\n".join(lines)


def _picture(path: Path, title: str) -> str:
    """A PNG file inside the page, in a frame in which it can be moved where it is wider, also by the keyboard."""
    data, name = path.read_bytes(), html.escape(title)
    inches = int.from_bytes(data[16:20]) / FIGURE_STYLE.resolution  # the width stands in a PNG file's header
    sizes = f"min-width:{SMALLEST * inches:.0f}px;max-width:{LARGEST * inches:.0f}px"
    source = f"data:image/png;base64,{base64.b64encode(data).decode()}"
    image = f"<img alt='{name}' style='{sizes}' src='{source}'>"
    return f"<div class='figure' tabindex='0' role='region' aria-label='{name}'>{image}</div>"


def _table(rows: list[Claim]) -> str:
    """The claims as a table; on a small screen each row is a block, whose numbers follow the names of their columns."""
    heads = {"section": "", "claim": "", "expected": "n", "ours": "n", "error": "n", "within": "n", "holds": ""}
    names = "".join(f"<th class='{kind}'>{head}</th>" for head, kind in heads.items())
    lines = [f"<table><thead><tr>{names}</tr></thead><tbody>"]
    for row in rows:
        numbers = ("", "") if isinstance(row.expected, bool) else (f"{row.error:.1e}", f"{row.within:.0e}")
        words = row.section, html.escape(row.statement), _text(row.expected), _text(row.ours)
        cells = zip(heads.items(), (*words, *numbers, "yes" if row.ok else "NO"), strict=True)
        line = "".join(f"<td class='{kind}' data-head='{head}'>{cell}</td>" for (head, kind), cell in cells)
        lines.append(f"<tr class='{'' if row.ok else 'no'}'>{line}</tr>")
    return "\n".join([*lines, "</tbody></table>"])


def _text(value: float | bool) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.1e}" if 0 < abs(value) < 1e-8 else f"{value + 0.0:.12g}"


def all_claims() -> list[Claim]:
    """All rows."""
    return [claim for part in PARTS for claim in claims.claims_of(part.rows)]


def main(folder: Path, quick: bool = False) -> list[Claim]:
    folder.mkdir(parents=True, exist_ok=True)
    parts, path = [], folder / "paper.html"
    for part in PARTS:
        rows, figures = claims.claims_of(part.rows), []
        for row in rows:
            word = "ok" if row.ok else "NO"
            print(f"  {word:<4}{row.section:<8}{row.statement:<66}{_text(row.expected):>18}{_text(row.ours):>18}")
        for title, study, has_quick in part.figures:
            study.main(folder, **({"quick": True} if has_quick and quick else {}))
            words = " ".join(study.__doc__.split("Run:")[0].split())
            figures.append((title, words, folder / f"{study.__name__.split('.')[-1]}.png"))
        parts.append((part, rows, figures))
    path.write_text(page(parts, quick), encoding="utf-8")
    rows = [row for _, own, _ in parts for row in own]
    print(f"\n  {sum(row.ok for row in rows)} of {len(rows)} claims hold; page: {path}")
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the page and its figures")
    parser.add_argument("--quick", action="store_true", help="the figures in their quick modes")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
