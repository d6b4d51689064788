"""Pictures and videos of a replay."""

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from matplotlib.image import imread

from pinarm.cli.main import main
from pinarm.errors import InputError
from pinarm.use.show.replay import chromium
from pinarm.use.show.replay.chromium import Page

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def saved(scenario: Callable[..., Any], folder: Path) -> Path:
    """A result folder of a swinging pendulum."""
    out: Path = scenario("inverse").run().save(folder / "out", plots=False)
    return out


@pytest.mark.slow
def test_a_picture_is_the_same_each_time(saved: Path, _browser: Page, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(saved), "--png", "t=1.5 s", "--arrows", "all", "--trace", "tip"]) == 0
    first = (saved / "replay.png").read_bytes()
    assert (
        main(["replay", str(saved), "--png", "t=1.5", "--arrows", "all", "--trace", "tip", "-o", str(saved / "b.png")])
        == 0
    )
    assert first.startswith(PNG)
    assert len(first) > 10_000
    one, two = (imread(saved / name) for name in ("replay.png", "b.png"))
    assert one.shape == two.shape
    assert (abs(one - two).max(axis=-1) > 0.05).mean() < 1e-3  # a glyph may be smoothed otherwise on a busy machine
    assert "replay.png" in capsys.readouterr().out


@pytest.mark.slow
def test_a_video_lasts_as_long_as_the_motion(saved: Path, _browser: Page) -> None:
    target = saved / "motion.mp4"
    assert main(["replay", str(saved), "--video", str(target), "--fps", "6", "--speed", "2"]) == 0
    told = subprocess.run([chromium.ffmpeg(), "-i", str(target)], capture_output=True, text=True, check=False).stderr
    assert "Duration: 00:00:01.17" in told  # 2 s at twice the speed, 6 a second, both ends: 7 pictures
    assert "h264" in told


@pytest.mark.parametrize(
    ("options", "says"),
    [("--png t=1 -o pic.html", "pic.png"), ("--video pic.html", "pic.mp4"), ("-o pic.png", "--png t=VALUE")],
)  # fmt: skip
def test_a_file_of_another_format_is_refused(
    options: str, says: str, saved: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(saved.parent)
    assert main(["replay", "out", *options.split()]) == 2
    assert says in capsys.readouterr().err
    assert not list(saved.parent.glob("pic*")) + list(saved.parent.glob("v.mp4"))


@pytest.mark.parametrize("text", ["1.5", "phi=1", "t=3", "t=nan"])
def test_a_place_outside_of_the_run_is_refused(scenario: Callable[..., Any], text: str) -> None:
    with pytest.raises(InputError):
        chromium.place(scenario("inverse").run().trajectory, text)


def test_without_a_browser_it_says_what_to_install(
    saved: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(saved))
    monkeypatch.setattr(chromium, "APPLICATIONS", ())
    assert main(["replay", str(saved), "--png", "t=1"]) == 2
    assert "apt-get install chromium" in capsys.readouterr().err


def test_the_command_writes_the_page(saved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(saved), "--json", "--plot"]) == 0
    assert '"notes": []' in capsys.readouterr().out
    assert (saved / "replay.html").read_text(encoding="utf-8").startswith("<!doctype html>")


@pytest.mark.parametrize("target", ["missing", "."])
def test_what_is_no_result_is_refused(folder: Path, target: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(folder / target)]) == 2
    assert "run the scenario again" in capsys.readouterr().err
