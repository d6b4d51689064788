"""Pictures and videos of a replay page, taken by an installed Chromium."""

from __future__ import annotations

import math
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from pinarm.engine.motion.trajectory import ROW, Trajectory
from pinarm.errors import InputError, PinarmError
from pinarm.input.units import read_quantity
from pinarm.use.output.folder import write_file
from pinarm.use.show.replay.chromium import browser
from pinarm.use.show.replay.page import Replay

MOST_FRAMES = 36_000
"""Twenty minutes at thirty pictures a second."""


def place(run: Trajectory, text: str) -> float:
    """Return the value of the parameter [SI] that a text such as ``t=2.5`` or ``phi=30 deg`` names.

    Raises:
        InputError: It names another parameter, has no unit where it needs one, or lies outside of the run.
    """
    name, equals, said = (part.strip() for part in text.partition("="))
    if not equals or name != run.parameter:
        raise InputError(f"'{text}' is no place of this run", expected=f"{run.parameter}=VALUE [{run.unit}]")
    number, written = read_quantity(said)
    if written is None and number and name not in ("t", ROW):
        raise InputError(f"'{said}' has no unit", expected=f"a value such as {said} {run.unit}")
    if written is not None and written.dimension != run.unit.dimension:
        raise InputError(f"'{written}' is not a unit of {name}", expected=f"a unit such as {run.unit}")
    low, high = sorted((float(run.grid.t[0]), float(run.grid.t[-1])))
    if not low <= number <= high:
        raise InputError(f"{text} lies outside of the run", expected=f"{low:g} to {high:g} {run.unit}")
    return number


def picture(replay: Replay, value: float, target: Path) -> Path:
    """Write a PNG of a replay at a value of its parameter [SI].

    Raises:
        PinarmError: There is no Chromium, or the file cannot be written.
    """
    with browser() as shown, tempfile.TemporaryDirectory() as folder:
        shown.open(replay.save(Path(folder) / "replay.html"), f"#t={value!r}")
        shown.evaluate(f"replay.picture(), replay.show({value!r})")
        raw = shown.screenshot()
    write_file(target, [raw])
    return target


def video(
    replay: Replay, target: Path, *, fps: float = 30.0, speed: float = 1.0,
    progress: Callable[[str], None] = lambda _: None,
) -> Path:  # fmt: skip
    """Write an MP4 of the whole motion of a replay.

    Args:
        replay: The page.
        target: The file.
        fps: Pictures a second.
        speed: Relative to real time, or where the motion is not over time to six seconds for the whole.
        progress: Told how far it is.

    Raises:
        PinarmError: There is no Chromium or no ffmpeg, or the video would be too long.
    """
    program = ffmpeg()
    if not (0.0 < fps <= 240.0 and 0.0 < speed < math.inf):
        raise InputError(f"{fps:g} pictures a second at speed {speed:g}", expected="positive numbers, at most 240 fps")
    with browser() as shown, tempfile.TemporaryDirectory() as folder:
        shown.open(replay.save(Path(folder) / "replay.html"), "#t=0")
        shown.evaluate("replay.picture()")
        encoded = Path(folder) / "video.mp4"
        frames = 1 + round(shown.evaluate("replay.player.seconds()") * fps / speed)
        if frames > MOST_FRAMES:
            raise InputError(f"the video would have {frames} pictures", expected=f"at most {MOST_FRAMES}",
                             hint="a higher --speed, or a lower --fps")  # fmt: skip
        encoder = subprocess.Popen(
            [program, "-y", "-loglevel", "error", "-f", "image2pipe", "-c:v", "png", "-framerate", f"{fps:g}",
             "-i", "-", "-pix_fmt", "yuv420p", "-movflags", "+faststart", "-f", "mp4", str(encoded)],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        )  # fmt: skip
        assert encoder.stdin is not None
        try:
            for k in range(frames):
                progress(f"picture {k + 1} of {frames}")
                shown.evaluate(f"replay.show(replay.player.at({k / max(frames - 1, 1)!r}))")
                encoder.stdin.write(shown.screenshot())
        except BrokenPipeError:
            pass  # ffmpeg says why
        finally:
            progress("")
            _, complaint = encoder.communicate()
        if encoder.returncode:
            last = complaint.decode(errors="replace").strip().splitlines()[-1:] or ["it does not say why"]
            raise PinarmError(f"ffmpeg could not write {target}: {last[0]}")
        with open(encoded, "rb") as stream:
            write_file(target, iter(partial(stream.read, CHUNK), b""))
    return target


CHUNK = 1 << 20
"""Bytes of a video that are copied at once."""


def ffmpeg() -> str:
    """Return the path of an ffmpeg: the one on the PATH, or that of the package imageio-ffmpeg.

    Raises:
        PinarmError: There is none; says what to install.
    """
    program = shutil.which("ffmpeg")
    if program:
        return program
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise PinarmError(
            "videos need ffmpeg, and there is none", hint="pip install 'pinarm[replay]', or apt-get install ffmpeg"
        ) from None
