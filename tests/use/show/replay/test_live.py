"""Results in meshcat's own viewer: what its server holds, where it listens, and what a browser makes of it."""

import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import meshcat
import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.use.facade import Result

ROOT = Path(__file__).parents[4]

pytestmark = [  # meshcat connects twice, and leaves the first socket and its processes to the collector
    pytest.mark.filterwarnings("ignore:Unclosed socket"), pytest.mark.filterwarnings("ignore:subprocess"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]  # fmt: skip


@pytest.fixture(scope="module")
def viewer(request: pytest.FixtureRequest) -> Iterator[meshcat.Visualizer]:
    """A viewer with the two-rod arm on a motion of one second, half a turn of O in all."""
    arm = pinarm.Mechanism.load(ROOT / "models" / "gen411_arm" / "mechanism.yaml")
    t = np.linspace(0.0, 1.0, 11)
    result = pinarm.result(arm, t, np.stack([np.pi * t, 0.0 * t], axis=1))
    yield result.show()


def test_a_new_viewer_listens_on_loopback_only(viewer: meshcat.Visualizer) -> None:
    """Addresses of listening sockets as Linux tells them, in reversed bytes: 0100007F is 127.0.0.1."""
    ports = {int(url.split(":")[2].split("/")[0]) for url in (viewer.url(), viewer.window.zmq_url)}
    table = Path("/proc/net/tcp")
    if not table.exists():
        pytest.skip("no /proc/net/tcp")
    listening = [line.split()[1].split(":") for line in table.read_text().splitlines()[1:] if line.split()[3] == "0A"]
    addresses = {address for address, port in listening if int(port, 16) in ports}
    assert addresses == {"0100007F"}
    with socket.create_connection(("127.0.0.1", min(ports)), timeout=5):
        pass


class Recorder(meshcat.Visualizer):
    """A viewer that keeps what it is sent, and has no server."""

    def __init__(self) -> None:
        self.window = self
        self.path = meshcat.path.Path(("meshcat",))
        self.sent: list[dict[str, Any]] = []

    def send(self, command: Any) -> None:
        self.sent.append(command.lower())


def test_what_is_sent_is_the_mechanism_and_its_motion(solved: Callable[[str], Result]) -> None:
    result = solved("gen411_arm_static")
    recorder = Recorder()
    assert result.show(recorder, name="mine") is recorder
    assert result.show(SimpleNamespace(viewer=Recorder())).sent  # as Pinocchio's MeshcatVisualizer has it
    kinds = [command["type"] for command in recorder.sent]
    assert kinds[0] == "delete"
    assert kinds[-1] == "set_animation"
    paths = {command["path"] for command in recorder.sent if command["type"] == "set_transform"}
    assert {"/meshcat/mine/O", "/meshcat/mine/B"} <= {path if path.startswith("/") else f"/{path}" for path in paths}
    clips = {clip["path"].strip("/"): clip["clip"] for clip in recorder.sent[-1]["animations"]}
    tracks = {track["name"]: track["keys"] for track in clips["meshcat/mine/B"]["tracks"]}
    mechanism, run = result.trajectory.mechanism, result.trajectory
    for k in (0, 100, 240):
        placement = mechanism.frame("joint.B", run.q[k])
        assert tracks[".position"][k]["value"] == pytest.approx(placement[:3, 3], abs=1e-12)
        x, y, z, w = tracks[".quaternion"][k]["value"]
        assert [2 * (x * y + z * w), w * w + x * x - y * y - z * z] == pytest.approx(placement[[1, 0], 0], abs=1e-12)
    assert tracks[".position"][-1]["time"] / clips["meshcat/mine/B"]["fps"] == pytest.approx(5.0)


def test_something_else_is_no_viewer(solved: Callable[[str], Result]) -> None:
    with pytest.raises(InputError, match="a str is no viewer of meshcat"):
        solved("gen411_arm_static").show("http://127.0.0.1:7000")
