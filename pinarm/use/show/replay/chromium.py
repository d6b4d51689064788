"""Pictures and videos of a replay page, by a headless Chromium: no port, no server, no further package.

It is driven through a pipe by the DevTools protocol, https://chromedevtools.github.io/devtools-protocol/; with
``--remote-debugging-pipe`` the browser reads commands from file descriptor 3 and writes answers and events to 4, each a
JSON text that ends with a zero byte.
"""

from __future__ import annotations

import base64
import json
import math
import os
import select
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import InputError, PinarmError
from pinarm.input.units import is_decimal
from pinarm.input.yaml.schema import in_si
from pinarm.use.output import write_file
from pinarm.use.show.replay.page import Replay

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")
APPLICATIONS = ("Chromium.app/Contents/MacOS/Chromium", "Google Chrome.app/Contents/MacOS/Google Chrome")
PATIENCE = 60.0
"""Seconds to wait for an answer: software graphics take some for large meshes on a busy machine."""

OPTIONS = (
    "--headless", "--remote-debugging-pipe", "--disable-gpu", "--enable-unsafe-swiftshader", "--hide-scrollbars",
    "--no-first-run", "--no-default-browser-check", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--disable-quic", "--disable-dev-shm-usage", "--mute-audio", "--force-color-profile=srgb",
)  # fmt: skip


def chromium() -> str:
    """Return the path of an installed Chromium or Chrome."""
    programs = [path for name in PROGRAMS if (path := shutil.which(name))]
    programs += [str(file) for name in APPLICATIONS if (file := Path("/Applications") / name).is_file()]
    if not programs:
        raise PinarmError(
            "pictures, videos and PDF files need Chromium or Chrome, and there is none",
            expected=f"one of {', '.join(PROGRAMS)} on the PATH",
            hint="apt-get install chromium, or brew install --cask chromium; pages (.html) need none",
        )
    return programs[0]


class Page:
    """One page in the browser; ``events`` are its reports since it was opened, such as requests and messages."""

    def __init__(self, commands: int, answers: int) -> None:
        self.events: list[dict[str, Any]] = []
        self._commands, self._answers = commands, answers
        self._rest, self._count, self._session, self._target = b"", 0, "", ""

    def open(self, path: Path, fragment: str = "", *, width: int = 1280, height: int = 720) -> None:
        """Show a page, in place of the one before, and wait until it is ready: ``<html data-ready="yes">``."""
        self._session = ""
        if self._target:
            self.call("Target.closeTarget", targetId=self._target)
        self._target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=self._target, flatten=True)["sessionId"]
        self.events.clear()
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call("Page.navigate", url=path.resolve().as_uri() + fragment)
        end = time.monotonic() + PATIENCE
        while self.evaluate("document.documentElement?.dataset.ready") != "yes":
            if time.monotonic() > end:
                raise PinarmError("the page does not start in this browser", hint="open it in another, and see why")
            time.sleep(0.02)

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression, awaited, as plain data."""
        answer = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            raise PinarmError(f"the page failed: {details.get('exception', {}).get('description', details['text'])}")
        return answer["result"].get("value")

    def screenshot(self) -> bytes:
        """Return a screenshot of the page, as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def pdf(self) -> bytes:
        """Return the page as it is printed, as PDF, on paper of the size that its style asks for."""
        options = {"printBackground": True, "preferCSSPageSize": True, "generateDocumentOutline": True}
        return base64.b64decode(self.call("Page.printToPDF", **options)["data"])

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its answer."""
        self._count += 1
        command = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            command["sessionId"] = self._session
        with suppress(BrokenPipeError):  # then no answer comes
            raw = json.dumps(command).encode() + b"\0"
            while raw:
                raw = raw[os.write(self._commands, raw) :]
        while True:
            message = self._next()
            if message.get("id") == self._count:
                if "error" in message:
                    raise PinarmError(f"the browser refuses {method}: {message['error'].get('message')}")
                answer: dict[str, Any] = message["result"]
                return answer
            self.events.append(message)

    def _next(self) -> dict[str, Any]:
        end = time.monotonic() + PATIENCE
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._answers], [], [], max(end - time.monotonic(), 0.0))
            chunk = os.read(self._answers, 1 << 20) if ready else b""
            if not chunk:
                raise PinarmError("the browser does not answer" if not ready else "the browser has stopped")
            self._rest += chunk
        raw, _, self._rest = self._rest.partition(b"\0")
        message: dict[str, Any] = json.loads(raw)
        return message


@contextmanager
def browser(*options: str) -> Iterator[Page]:
    """Start a browser with a profile of its own and further options, and end it afterwards."""
    program = chromium()
    if os.geteuid() == 0:
        options = (*options, "--no-sandbox")  # which root must not use
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        theirs, commands = os.pipe()
        answers, writes = os.pipe()
        os.set_inheritable(theirs, True)  # where it is 3 already

        def connect() -> None:
            os.dup2(theirs, 3)
            os.dup2(writes, 4)

        process = subprocess.Popen(
            [program, *OPTIONS, *options, f"--user-data-dir={profile}", "about:blank"],
            preexec_fn=connect,
            close_fds=False,
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(theirs)
        os.close(writes)
        try:
            yield Page(commands, answers)
        finally:
            os.close(commands)
            os.close(answers)
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


MOST_FRAMES = 9_000
"""Five minutes at thirty pictures a second: a gigabyte of pictures."""


def place(run: Trajectory, text: str) -> float:
    """Return the value of the parameter [SI] that a text such as ``t=2.5`` or ``phi=30 deg`` names.

    Raises:
        InputError: It names another parameter, has no unit where it needs one, or lies outside of the run.
    """
    name, equals, value = (part.strip() for part in text.partition("="))
    if not equals or name != run.parameter:
        raise InputError(f"'{text}' is no place of this run", expected=f"{run.parameter}=VALUE [{run.unit}]")
    number = in_si(f"{value} s" if name == "t" and is_decimal(value) else value, run.unit)
    low, high = sorted((float(run.grid.t[0]), float(run.grid.t[-1])))
    if not low <= number <= high:
        raise InputError(f"{text} lies outside of the run", expected=f"{low:g} to {high:g} {run.unit}")
    return number


@contextmanager
def _opened(replay: Replay) -> Iterator[tuple[Page, Path]]:
    """Yield a replay in a browser, without its controls, and a folder for files."""
    with browser() as shown, tempfile.TemporaryDirectory() as folder:
        shown.open(replay.save(Path(folder) / "replay.html"))
        shown.evaluate("replay.picture()")
        yield shown, Path(folder)


def picture(replay: Replay, value: float, target: Path) -> Path:
    """Write a PNG of a replay at a value of its parameter [SI].

    Raises:
        PinarmError: There is no Chromium, or the file cannot be written.
    """
    with _opened(replay) as (shown, _):
        shown.evaluate(f"replay.show({value!r})")
        write_file(target, [shown.screenshot()])
    return target


def video(
    replay: Replay,
    target: Path,
    *,
    fps: float = 30.0,
    speed: float = 1.0,
    progress: Callable[[str], None] = lambda _: None,
) -> Path:
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
    with _opened(replay) as (shown, folder):
        frames = 1 + round(shown.evaluate("replay.player.seconds()") * fps / speed)
        if frames > MOST_FRAMES:
            words, hint = f"the video would have {frames} pictures", "a higher --speed, or a lower --fps"
            raise InputError(words, expected=f"at most {MOST_FRAMES}", hint=hint)
        for k in range(frames):
            progress(f"picture {k + 1} of {frames}")
            shown.evaluate(f"replay.show(replay.player.at({k / max(frames - 1, 1)!r}))")
            (folder / f"{k}.png").write_bytes(shown.screenshot())
        progress("")
        encoded = folder / "video.mp4"
        command = [program, "-loglevel", "error", "-framerate", f"{fps:g}", "-i", str(folder / "%d.png"),
                   "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(encoded)]  # fmt: skip
        encoder = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
        if encoder.returncode:
            last = encoder.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["it does not say why"]
            raise PinarmError(f"ffmpeg could not write {target}: {last[0]}")
        write_file(target, [encoded.read_bytes()])
    return target


def ffmpeg() -> str:
    """Return the path of an ffmpeg: the one on the PATH, or that of the package imageio-ffmpeg."""
    if program := shutil.which("ffmpeg"):
        return program
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise PinarmError(
            "videos need ffmpeg, and there is none", hint="pip install 'pinarm[replay]', or apt-get install ffmpeg"
        ) from None
