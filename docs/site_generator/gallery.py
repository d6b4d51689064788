"""The gallery: runs of scenarios as replays, pages that stand alone, each beside its drawing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import pinarm
from pinarm.use.show.drawings import sketch
from pinarm.use.show.replay.page import Replay
from site_generator.kind_pages import Made
from site_generator.repository_pages import ROOT

HEAD = """# Gallery

Each of these is a scenario that comes with pinarm, solved while this site was built. A replay is one page that needs no
server and no network: drag to turn, space plays, the arrow keys step, and the plots have a cursor that follows.
`python -m pinarm replay RESULT` writes such a page of any run.
"""


@dataclass(frozen=True)
class Shown:
    """An entry.

    Attributes:
        scenario: Its name.
        text: What there is to see.
        traces: Points whose paths are drawn.
        arrows: Arrows that are drawn; see ``pinarm.replay``.
    """

    scenario: str
    text: str
    traces: tuple[str, ...] = ()
    arrows: tuple[str, ...] = ()


ENTRIES = (
    Shown(
        "manipulator_motion",
        "Industrial manipulator: a parallelogram with a counterweight, and a pneumatic cylinder. Two loops, one degree "
        "of freedom; the arrows are weights and loads.",
        arrows=("forces",),
    ),
    Shown(
        "andrews_squeezing",
        "Andrews' squeezing mechanism: seven bodies and three loops, driven by a constant torque; a benchmark of "
        "integrators since 1990.",
    ),
    Shown(
        "bricard_falling",
        "Bricard's linkage: six revolute joints in one spatial loop, which can move only because of the directions of "
        "its axes. The rows of its loop are dependent.",
    ),
    Shown("magic_arms_cycle", "A fairground ride: three revolutes, and the acceleration of a passenger."),
    Shown("gyroscope_free", "Gyroscope on gimbals: the nutation of a rotor at 200 rad/s."),
    Shown("slider_crank_gas", "Slider-crank with the force of a gas on its piston."),
    Shown(
        "porter_governor_modes",
        "Porter's governor at its steady speed: the replay moves its modes, with a slider for the amplitude. Two loops "
        "that stay closed.",
    ),
    Shown("olive_vibrator_modes", "A vibrator on a tree: its resonance as a mode that moves."),
    Shown("panda_quintic", "A Panda from one pose to another along polynomials of degree 5."),
)


def gallery_pages() -> Iterator[Made]:
    """Yield the page of the gallery, its replays and drawings."""
    lines = [HEAD]
    for entry in ENTRIES:
        result = pinarm.run(ROOT / "scenarios" / f"{entry.scenario}.yaml")
        replay: Replay = result.replay(traces=entry.traces, arrows=entry.arrows)
        yield Made(f"gallery/{entry.scenario}.html", replay.html)
        yield Made(f"gallery/{entry.scenario}.svg", sketch(result).svg())
        lines += _section(entry, result.content.title)
    yield Made("gallery.md", "\n".join(lines))


def _section(entry: Shown, title: str) -> list[str]:
    page = f"gallery/{entry.scenario}.html"
    return [
        f"## {title}", "", entry.text, "",
        f'<div class="pictures" markdown="1">\n![{title}](gallery/{entry.scenario}.svg)\n</div>', "",
        f"[Open the replay]({page}) or the [scenario](../scenarios/{entry.scenario}.yaml).", "",
        f'<details><summary>Show it here</summary>\n<iframe class="replay" loading="lazy" src="{page}" '
        f'title="{title}"></iframe></details>', "",
    ]  # fmt: skip
