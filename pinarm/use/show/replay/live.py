"""A result in a live meshcat viewer, with meshcat's own controls and recorder."""

from __future__ import annotations

import atexit
import subprocess
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import InputError, PinarmError
from pinarm.use.show.bodies import Shape, placed, visuals
from pinarm.use.show.replay.page import rows_shown
from pinarm.use.show.scene import scene

if TYPE_CHECKING:
    import meshcat

    from pinarm.use.result.result import Result

FRAMES = 60.0
"""Frames of a second of meshcat's animations; rows need not fall on them."""

SECONDS = 5.0
"""Length of the animation where something other than the time runs along the rows."""

UPRIGHT = pin.SE3(pin.rpy.rpyToMatrix(np.pi / 2, 0.0, 0.0), np.zeros(3))
"""From meshcat's cylinders, which lie along y, to those of URDF, along z."""

SERVER = """
import functools, tornado.web
tornado.web.Application.listen = functools.partialmethod(tornado.web.Application.listen, address="127.0.0.1")
from meshcat.servers.zmqserver import main
main()
"""
"""meshcat's own server would listen on all interfaces of the machine."""


def show(result: Result, visualizer: Any = None, *, name: str = "pinarm") -> meshcat.Visualizer:
    """Show a result in a meshcat viewer; see ``Result.show``."""
    viewer = _viewer(visualizer)
    run = result.trajectory.some(rows_shown(result.trajectory, []))
    model = run.mechanism.model
    shown = scene(run.mechanism, run.dynamics.forces, run.q, visuals(run.mechanism))
    root = viewer[name]
    root.delete()
    places = placed(model, run.q, len(run))
    paths = [root[joint.replace("/", "_")] for joint in model.names]
    for path, place in zip(paths, places[0], strict=True):
        path.set_transform(place)
    for k, shape in enumerate(shown.shapes):
        for j, (geometry, place) in enumerate(_geometries(shape)):
            part = paths[shape.node][f"{k}.{j}"]
            part.set_object(geometry, _material(shape))
            part.set_transform((shape.placement * place).homogeneous)
    if len(run) > 1:
        viewer.set_animation(_animation(run, paths[1:], places[:, 1:]))
    return viewer


def _viewer(visualizer: Any) -> meshcat.Visualizer:
    """Return the viewer that is given, that of Pinocchio's ``MeshcatVisualizer``, or a new one.

    Raises:
        InputError: It is none.
    """
    import meshcat

    viewer = getattr(visualizer, "viewer", visualizer)
    if viewer is None:
        return meshcat.Visualizer(zmq_url=_server())
    if not isinstance(viewer, meshcat.Visualizer):
        expected = "meshcat.Visualizer, Pinocchio's MeshcatVisualizer, or none for a new"
        raise InputError(f"a {type(viewer).__name__} is no viewer of meshcat", expected=expected)
    return viewer


def _server() -> str:
    """Start meshcat's server for this machine alone, until the program ends; return the address of its socket.

    Raises:
        PinarmError: It does not start.
    """
    command = [sys.executable, "-u", "-c", SERVER]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True
    )
    atexit.register(process.kill)
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith("zmq_url="):
            return line.strip().removeprefix("zmq_url=")
    raise PinarmError("the server of meshcat does not start", hint="python -m meshcat.servers.zmqserver, to see why")


def _geometries(shape: Shape) -> Iterator[tuple[Any, pin.SE3]]:
    """Yield the geometries of meshcat for a shape, each with its placement in the shape."""
    from meshcat import geometry

    nowhere = pin.SE3.Identity()
    if shape.mesh is not None:
        yield geometry.TriangularMeshGeometry(shape.mesh.vertices * shape.size, shape.mesh.triangles), nowhere
    elif shape.kind == "box":
        yield geometry.Box(list(shape.size)), nowhere
    elif shape.kind == "sphere":
        yield geometry.Sphere(shape.size[0]), nowhere
    else:
        radius, length = shape.size
        yield geometry.Cylinder(length, radius), UPRIGHT
        for end in (-0.5, 0.5) if shape.kind == "capsule" else ():
            yield geometry.Sphere(radius), pin.SE3(np.eye(3), np.array([0.0, 0.0, end * length]))


def _material(shape: Shape) -> Any:
    from meshcat.geometry import MeshPhongMaterial

    *colour, opacity = shape.colour
    red, green, blue = (round(255 * part) for part in colour)
    return MeshPhongMaterial(color=red << 16 | green << 8 | blue, opacity=opacity, transparent=opacity < 1.0)


def _animation(run: Trajectory, paths: list[Any], places: Array) -> Any:
    """Return the motion of the bodies, (rows, bodies, 4, 4): a frame for every row, at its own instant."""
    from meshcat.animation import Animation, AnimationClip, AnimationTrack

    along = np.abs(run.grid.t - run.grid.t[0])
    seconds = along if run.parameter == "t" else SECONDS * along / (along[-1] or 1.0)
    frames = (FRAMES * seconds).tolist()
    clips = {}
    for k, path in enumerate(paths):
        turns = [pin.Quaternion(place[:3, :3]).coeffs().tolist() for place in places[:, k]]
        tracks = {
            "position": AnimationTrack("position", "vector3", frames, places[:, k, :3, 3].tolist()),
            "quaternion": AnimationTrack("quaternion", "quaternion", frames, turns),
        }
        clips[path.path] = AnimationClip(tracks, fps=FRAMES)
    return Animation(clips, default_framerate=FRAMES)
