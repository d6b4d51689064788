"""A headless Chromium, driven through a pipe by the DevTools protocol: no port, no server, no further package.

https://chromedevtools.github.io/devtools-protocol/; with ``--remote-debugging-pipe`` the browser reads commands from
file descriptor 3 and writes answers and events to 4, each a JSON text that ends with a zero byte.
"""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from pinarm.errors import PinarmError

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
    """Return the path of an installed Chromium or Chrome.

    Raises:
        PinarmError: There is none; says what to install.
    """
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
    """One page in the browser.

    Attributes:
        events: What the browser has reported since the page was opened, such as requests and console messages.
    """

    def __init__(self, commands: int, answers: int) -> None:
        self.events: list[dict[str, Any]] = []
        self._commands, self._answers = commands, answers
        self._rest, self._count, self._session, self._target = b"", 0, "", ""

    def open(self, path: Path, fragment: str = "", *, width: int = 1280, height: int = 720) -> None:
        """Show a page, in place of the one before, and wait until it is ready: ``<html data-ready="yes">``.

        Raises:
            PinarmError: The page does not start.
        """
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
        """Return the value of a JavaScript expression, awaited, as plain data.

        Raises:
            PinarmError: It throws.
        """
        answer = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            raise PinarmError(f"the page failed: {details.get('exception', {}).get('description', details['text'])}")
        return answer["result"].get("value")

    def screenshot(self) -> bytes:
        """Return what is on the screen, as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def pdf(self) -> bytes:
        """Return the page as it is printed, as PDF, on paper of the size that its style asks for."""
        options = {"printBackground": True, "preferCSSPageSize": True, "generateDocumentOutline": True}
        return base64.b64decode(self.call("Page.printToPDF", **options)["data"])

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its answer.

        Raises:
            PinarmError: The browser refuses it, or does not answer.
        """
        self._count += 1
        command = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            command["sessionId"] = self._session
        raw = json.dumps(command).encode() + b"\0"
        try:
            while raw:
                raw = raw[os.write(self._commands, raw) :]
        except BrokenPipeError:
            raise PinarmError("the browser has stopped") from None
        while True:
            message = self._next()
            if message.get("id") == self._count:
                if "error" in message:
                    raise PinarmError(f"the browser refuses {method}: {message['error'].get('message')}")
                answer: dict[str, Any] = message["result"]
                return answer
            self.events.append(message)

    def _next(self) -> dict[str, Any]:
        """Return the next message of the browser."""
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
    """Start a browser with a profile of its own, and end it afterwards.

    Args:
        options: Further command-line options.

    Raises:
        PinarmError: There is no browser.
    """
    program = chromium()
    if os.geteuid() == 0:
        options = (*options, "--no-sandbox")  # which root must not use
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        theirs, commands = os.pipe()
        answers, writes = os.pipe()
        # So that 3 and 4 overwrite neither. They may be files of this process that are closed at any time, by the
        # collector of garbage: ``pass_fds`` would refuse them then; all others end with the call of the program.
        high = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (theirs, writes)]

        def connect() -> None:
            os.dup2(high[0], 3)
            os.dup2(high[1], 4)

        process = subprocess.Popen(
            [program, *OPTIONS, *options, f"--user-data-dir={profile}", "about:blank"],
            preexec_fn=connect, close_fds=False, start_new_session=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        for end in (theirs, writes, *high):
            os.close(end)
        try:
            yield Page(commands, answers)
        finally:
            os.close(commands)
            os.close(answers)
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
