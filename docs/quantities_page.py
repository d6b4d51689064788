"""Write docs/quantities.md: the families of names, as the program has them. ``python docs/quantities_page.py``."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from pinarm.engine.quantities.catalogue import COLUMNS
from pinarm.engine.quantities.families import FAMILIES
from pinarm.engine.quantities.family import Family

PAGE = Path(__file__).with_name("quantities.md")

HEAD = """# Quantities

`outputs`, `expect`, `find`, sweeps and `result[...]` take these names, symbols of the mechanism, coordinates, arguments
of the model, and formulas of them such as `Cr*theta21d` or `(2e4 N/m)*y`. `python -m pinarm quantities SCENARIO` lists
those of a mechanism with units, meanings and frames, and says which are refused and why.

Vectors end in a component, `.x`, `.y`, `.z` in world axes, or `.norm`, the length; of joints with an axis also in
`.axial`, the part along the axis, and `.radial`, the size of the rest. `.along.B` before the component gives it in the
axes of link B, `.about.P` takes a moment about the origin of link P: `joint.knee.moment.about.foot.x`.

Other names: `t`, or whatever else runs along the rows; `g`, the magnitude of gravity.
"""


TABLE = ("| name | what it is |", "| --- | --- |")


def page() -> str:
    """Return the page."""
    lines = [HEAD]
    for word, (module, name) in FAMILIES.items():
        family: type[Family] = getattr(import_module(f"pinarm.engine.quantities.families.{module}"), name)
        lines += [f"## `{word}`", "", str(family.__doc__).strip().replace("``", "`"), "", *TABLE]
        for part, said in family.meanings.items():
            name = ".".join([word, *filter(None, (family.element, part))]) if part else f"{word}.F"
            lines.append(f"| `{name}` | {said} |")
        lines.append("")
    lines += ["## What friction, controllers and kinds of problem add", "", *TABLE]
    lines += [f"| `{'...' if mark.startswith('.') else ''}{mark}` | {said} |" for mark, said in COLUMNS.items()]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"written to {PAGE}")
