"""Results to be replayed, and a real browser to look at them with."""

import gzip
import json
import os
import re
from base64 import b64decode
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.errors import PinarmError
from pinarm.use.facade import Result
from pinarm.use.show.replay.chromium import Page, browser, chromium

ROOT = Path(__file__).parents[3]
TYPES = {"f8": np.float64, "f4": np.float32, "u4": np.uint32}


@pytest.fixture(scope="session")
def solved() -> Callable[[str], Result]:
    """``solved("gen411_arm_static")``: the result of a scenario of the project, solved once."""
    known: dict[str, Result] = {}

    def solve(name: str) -> Result:
        if name not in known:
            known[name] = pinarm.load(ROOT / "scenarios" / f"{name}.yaml").run()
        return known[name]

    return solve


@pytest.fixture
def read() -> Callable[[str], SimpleNamespace]:
    """Return what a page carries: its scene, and ``array(reference)``."""

    def parts(html: str) -> SimpleNamespace:
        found = dict(re.findall(r'<script type="[^"]*" id="(\w+)">([^<]*)</script>', html))
        raw = gzip.decompress(b64decode(found["arrays"]))

        def array(reference: list[Any]) -> np.ndarray:
            kind, offset, length = reference
            return np.frombuffer(raw, TYPES[kind], length, offset)

        return SimpleNamespace(scene=json.loads(found["scene"]), array=array, viewer=found["viewer"])

    return parts


@pytest.fixture(scope="session")
def _browser() -> Iterator[Page]:
    try:
        chromium()
    except PinarmError as error:
        if os.environ.get("CI"):
            pytest.fail(f"CI must have a browser: {error}")
        pytest.skip("there is no Chromium")
    with browser() as page:
        yield page


@pytest.fixture
def shown(_browser: Page, tmp_path: Path) -> Callable[..., Page]:
    """``shown(result, "#t=1", traces=["A"])``: the page of a result, open in Chromium."""

    def show(result: Result | str, fragment: str = "#t=0", **options: Any) -> Page:
        path = tmp_path / "replay.html"
        if isinstance(result, str):
            path.write_text(result, encoding="utf-8")
        else:
            result.replay(path, **options)
        _browser.open(path, fragment, width=900, height=600)
        return _browser

    return show


@pytest.fixture
def picture(tmp_path: Path, read: Callable[..., Any]) -> Callable[..., Any]:
    """Return the scene of a URDF text whose joints rest, and the notes on it."""

    def draw(xml: str, **content: Any) -> tuple[dict[str, Any], tuple[str, ...]]:
        (tmp_path / ".pinarm-root").touch()
        (tmp_path / "m.urdf").write_text(xml)
        forces = content.get("forces", "{}")
        (tmp_path / "m.yaml").write_text(f"pinarm: 1\nrobot: m.urdf\nforces: {forces}\n")
        hold = pinarm.Mechanism.load(tmp_path / "m.yaml").joints
        held = ", ".join(f"{name}: {content.get('at', 0)} {joint.unit}" for name, joint in hold.items())
        (tmp_path / "s.yaml").write_text(
            f"pinarm: 1\nmechanism: m.yaml\nproblem: {{kind: statics, hold: {{{held}}}}}\noutputs: [g]\n"
        )
        page = pinarm.load(tmp_path / "s.yaml").run().replay(arrows=content.get("arrows", ()))
        return read(page.html).scene, page.notes

    return draw
