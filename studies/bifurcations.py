"""What becomes of a hopper's fixed points as energy is added at every hop: folds, flips, and hops of period two.

The stable fixed point of curve (c) of the paper's Fig. 8 begins at the lossless hop, together with an unstable one, and
loses its stability at curve (d), where its multiplier is -1; the paper leaves open whether the period doubles there
(section 9). It does, for the paper's equal masses: from eps = 0.071587384137 on the machine repeats every second hop.
A damper takes back what is added. With eps = 0.1 at every hop and a growing damper the same happens the other way
round: hops of period two become one, and that meets the unstable one in a fold, beyond which every launch comes to
rest.
Run: python studies/bifurcations.py [--output FOLDER] [--quick]
"""

import argparse
from pathlib import Path

import numpy as np

from orbits import BifurcationDiagram, bifurcations
from orbits.show.plot import new_row, save_figure
from problems import Hopper

LAUNCHES = (4.4, 4.7)
INJECT, DAMPED_INJECT = (0.0, 0.15), 0.1


def main(folder: Path, quick: bool = False) -> dict[str, BifurcationDiagram]:
    """Draw both diagrams; the quick mode has the first alone."""
    sections = 3 if quick else 5
    visits = 60 if quick else 600
    found = {"inject": bifurcations(Hopper(), "inject", INJECT, LAUNCHES, sections=sections, attractor=visits)}
    if not quick:
        found["damping"] = bifurcations(
            Hopper(), "damping", (0.0, 0.007), LAUNCHES, inject=DAMPED_INJECT, sections=sections
        )
    panels = np.atleast_1d(new_row(len(found), 5.2, 4.4))
    for axes, (name, diagram) in zip(panels, found.items(), strict=True):
        print(f"\n{diagram}")
        diagram.plot(axes)
        axes.set_title(f"along the {'injection' if name == 'inject' else 'damping'}", fontsize="medium")
    folder.mkdir(parents=True, exist_ok=True)
    print(f"\n  figure: {save_figure(panels[0], folder / 'bifurcations.png')}")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the figure")
    parser.add_argument("--quick", action="store_true", help="the injection alone, with fewer of its values")
    arguments = parser.parse_args()
    main(arguments.output, arguments.quick)
