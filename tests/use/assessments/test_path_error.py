"""Paths of linkages whose curves are known: Peaucellier's line, Chebyshev's near one, and a coupler's curve."""

from collections.abc import Callable
from math import acos, atan2, cos, hypot, pi, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError, PinarmError
from pinarm.use.study.restore import restore

FOUR_BAR = "scenarios/crank_rocker_turning.yaml"
A, B, C, D = 0.10, 0.35, 0.25, 0.40
"""Lengths of the four-bar."""
CHEBYSHEV = {"P0": (-2, 0), "Q0": (2, 0), "P": (1, 4), "Q": (-1, 4), "M": (0, 4)}
"""Ground 4, cranks 5, coupler 2: its middle is on the line y = 4 at x = -2, 0 and 2."""


def linkage(
    folder: Path, points: dict[str, tuple[float, float]], ground: str, links: dict[str, str], text: str
) -> Path:
    drawn = "\n".join(f"    {name}: [{x!r} m, {y!r} m]" for name, (x, y) in points.items())
    joined = "\n".join(f"    {name}: {{points: [{of}], mass: 1 kg, inertia: 1 kg*m^2, centre: {of.split(',')[0]}}}"
                       for name, of in links.items())  # fmt: skip
    mechanism = f"pinarm: 1\nplanar:\n  points:\n{drawn}\n  ground: [{ground}]\n  links:\n{joined}\n"
    (folder / "m.yaml").write_text(mechanism)
    (folder / "s.yaml").write_text("pinarm: 1\nmechanism: m.yaml\n" + text)
    return folder / "s.yaml"


@pytest.fixture
def chebyshev(tmp_path: Path) -> Callable[..., Any]:
    def build(wanted: str, turn: str = "from: -15 deg, to: 40 deg") -> Any:
        text = (
            "problem:\n  kind: kinematics\n  time: {end: 1 s, samples: 21}\n"
            f"  motion: {{P0: {{law: polynomial, {turn}, duration: 1 s, degree: 3}}}}\n"
            f"outputs: [point.M.position.x]\npath_error: {{point: M, {wanted}}}\n"
        )
        links = {"left": "P0, P", "right": "Q0, Q", "coupler": "P, Q, M"}
        return pinarm.load(linkage(tmp_path, {k: (float(x), float(y)) for k, (x, y) in CHEBYSHEV.items()}, "P0, Q0",
                                   links, text))  # fmt: skip

    return build


def middle(angle: float) -> tuple[float, float]:
    """Return the middle of Chebyshev's coupler for an angle of the left crank, by intersection of circles."""
    px, py = -2 + 5 * cos(angle), 5 * sin(angle)
    far = hypot(2 - px, -py)
    turn = acos((4 + far**2 - 25) / (4 * far))  # of P -> Q against P -> Q0, of a triangle with the sides 2, far and 5
    qx, qy = (px + 2 * cos(atan2(-py, 2 - px) - turn), py + 2 * sin(atan2(-py, 2 - px) - turn))
    return (px + qx) / 2, (py + qy) / 2


def test_peaucellier_draws_a_straight_line(tmp_path: Path) -> None:
    r, arm, side = 1.0, 2.5, 1.5
    b = (1.5, sqrt(0.75))
    far = hypot(*b)
    u, out = (b[0] / far, b[1] / far), (arm**2 - side**2) / far
    m = (far + out) / 2
    h = sqrt(arm**2 - m**2)
    up, down = ((m * u[0] - side * u[1], m * u[1] + side * u[0]) for side in (h, -h))
    points = {"O": (0.0, 0.0), "C": (r, 0.0), "B": b, "T": (out * u[0], out * u[1]), "D": up, "E": down}
    links = {"crank": "C, B", "up": "O, D", "down": "O, E", "a": "D, B", "b": "D, T", "c": "E, B", "d": "E, T"}
    heights = [2.0, 1.6, 1.1, 0.9, 0.4]
    text = (
        "problem:\n  kind: kinematics\n  time: {end: 1 s, samples: 11}\n"
        "  motion: {C: {law: polynomial, from: 40 deg, to: -45 deg, duration: 1 s, degree: 3}}\n"
        f"outputs: [point.T.position.x]\npath_error: {{point: T, wanted: {{x: {['2 m'] * 5}, "
        f"y: {[f'{y} m' for y in heights]}}}}}\n"
    )
    result = pinarm.run(linkage(tmp_path, points, "O, C", links, text))
    assert result.number("path_error.peak")[0] < 1e-11
    met = np.array([row[5] for row in result.sections["path_error"].tables[0].rows], float)
    assert met == pytest.approx(heights, abs=1e-11)


@pytest.mark.slow
def test_chebyshev_passes_points_of_a_line_and_misses_others(chebyshev: Callable[..., Any]) -> None:
    exact = chebyshev("wanted: {x: [0 m, -2 m], y: [4 m, 4 m]}").run()
    assert exact.number("path_error.peak")[0] < 1e-11
    along = [1.0, 0.7, 0.3, -0.4, -1.2, -1.7]
    wanted = f"wanted: {{x: {[f'{x} m' for x in along]}, y: {['4 m'] * 6}}}"
    result = chebyshev(wanted).run()
    errors = [row[-1] for row in result.sections["path_error"].tables[0].rows]
    start = atan2(4, 3)
    assert middle(start - 15 * pi / 180)[0] > 1.2 and middle(start + 40 * pi / 180)[0] < -2.05
    curve = np.array([middle(start + turn) for turn in np.linspace(-15 * pi / 180, 40 * pi / 180, 400001)])
    assert np.hypot(*(np.array(middle(start)) - (0, 4))) < 1e-12  # the drawing
    nearest = [np.hypot(*(curve - (x, 4.0)).T).min() for x in along]
    assert errors == pytest.approx(nearest, rel=1e-6)
    assert result.number("path_error.rms")[0] == pytest.approx(sqrt(np.mean(np.square(nearest))), rel=1e-6)
    assert result.number("path_error.sum_of_squares")[0] == pytest.approx(np.sum(np.square(nearest)), rel=1e-6)


def test_points_that_are_met_in_another_order_are_refused(chebyshev: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match="does not meet the points 1 and 2 one after the other"):
        _ = chebyshev("wanted: {x: [-1 m, 1 m], y: [4 m, 4 m]}").run().sections


def test_prescribed_instants_leave_nothing_to_seek(chebyshev: Callable[..., Any]) -> None:
    result = chebyshev("wanted: {x: [1 m, 0 m], y: [4 m, 4 m]}, times: [0.25 s, 0.75 s]").run()
    errors = [row[-1] for row in result.sections["path_error"].tables[0].rows]
    start, exact = atan2(4, 3), []
    for time, x in ((0.25, 1.0), (0.75, 0.0)):
        part = time**2 * (3 - 2 * time)
        place = middle(start + (-15 + 55 * part) * pi / 180)
        exact.append(hypot(place[0] - x, place[1] - 4))
    assert errors == pytest.approx(exact, rel=1e-10)


def coupler(angles: np.ndarray, b: float = B) -> np.ndarray:
    """Return the middle of the four-bar's coupler for angles of the crank, in closed form, shape (n, 2)."""
    x, y = A * np.cos(angles), A * np.sin(angles)
    far, towards = np.hypot(D - x, y), np.arctan2(-y, D - x)
    turn = np.arccos((b**2 + far**2 - C**2) / (2 * b * far))
    return np.stack([x + b / 2 * np.cos(towards + turn), y + b / 2 * np.sin(towards + turn)], axis=1)


def asked(angles: list[float], b: float = B) -> dict[str, Any]:
    x, y = coupler(np.radians(angles), b).T
    wanted = {"x": [f"{each!r} m" for each in x.tolist()], "y": [f"{each!r} m" for each in y.tolist()]}
    return {"expect": [], "problem.time.samples": 61, "path_error": {"point": "G3", "wanted": wanted}}


def test_a_path_that_closes_may_begin_anywhere() -> None:
    angles = [200.0, 300.0, 10.0, 80.0]
    result = pinarm.run(FOUR_BAR, asked(angles))
    assert result.number("path_error.peak")[0] < 1e-12
    times = [row[1] for row in result.sections["path_error"].tables[0].rows]
    assert times == pytest.approx([angle / 600.0 for angle in angles], abs=1e-9)  # 100 rpm are 600 deg/s


def test_points_come_from_a_file_that_the_result_keeps(tmp_path: Path, chebyshev: Callable[..., Any]) -> None:
    (tmp_path / "curve.csv").write_text("x [cm],note,y [m]\n100,a,4\n0,b,4\n-100,c,4\n")
    result = chebyshev("wanted: curve.csv").run()
    listed = chebyshev("wanted: {x: [1 m, 0 m, -1 m], y: [4 m, 4 m, 4 m]}").run()
    assert result.number("path_error.rms") == listed.number("path_error.rms")
    again = restore(result.save(tmp_path / "out", plots=False))
    assert again.number("path_error.rms") == result.number("path_error.rms")
    assert (tmp_path / "out" / "path_error_wanted.csv").is_file()


@pytest.mark.parametrize(
    ("text", "message"),
    [("x [kg],y [m]\n1,2\n", "no unit of this quantity"), ("a,b\n1,2\n", "no column 'x'"),
     ("x [mm],y [mm]\n", "too short"), ("x [mm]\nnan\n", "finite number is missing"),
     ("x [mm];y [mm]\n1,5;2,5\n", "separated by semicolons")],
)  # fmt: skip
def test_a_mistake_in_a_file_is_told(tmp_path: Path, chebyshev: Callable[..., Any], text: str, message: str) -> None:
    (tmp_path / "curve.csv").write_text(text)
    with pytest.raises(PinarmError, match=message):
        chebyshev("wanted: curve.csv")


@pytest.mark.parametrize(
    ("wanted", "message"),
    [("wanted: {x: [1 m], y: [1 m, 2 m]}", "as many coordinates"), ("wanted: {w: [1 m]}", "'w' is no axis"),
     ("wanted: {}", "none"), ("wanted: {x: [1 m]}, times: [1 s, 2 s]", "2 times for 1 points"),
     ("wanted: ../../../etc/passwd", "passwd|outside|root"),
     ("wanted: nowhere.csv", "nowhere.csv")],
)  # fmt: skip
def test_a_mistake_in_the_points_is_told(chebyshev: Callable[..., Any], wanted: str, message: str) -> None:
    with pytest.raises(PinarmError, match=message):
        chebyshev(wanted)


def circle(folder: Path, law: str, duration: str, angles: list[float]) -> Any:
    """Return the error of the tip of a crank of 0.3 m, and when it is nearest to points on its circle."""
    (folder / "m.yaml").write_text(
        "pinarm: 1\nplanar:\n  points: {O: [0, 0], P: [0.3 m, 0 m]}\n  ground: [O]\n"
        "  links: {crank: {points: [O, P], mass: 1 kg}}\n"
    )
    x, y = ([f"{0.3 * part(angle)!r} m" for angle in angles] for part in (cos, sin))
    (folder / "s.yaml").write_text(
        f"pinarm: 1\nmechanism: m.yaml\nproblem: {{kind: kinematics, time: {{end: {duration}, samples: 11}}, "
        f"motion: {{O: {law}}}}}\noutputs: [O]\npath_error: {{point: P, wanted: {{x: {x}, y: {y}}}}}\n"
    )
    result = pinarm.run(folder / "s.yaml")
    rows = result.sections["path_error"].tables[0].rows
    (rms, left), (peak, of_peak) = (result.number(f"path_error.{name}") for name in ("rms", "peak"))
    assert rms <= left < 1e-12 and peak <= of_peak < 1e-12  # the points are on the circle
    return rms, [float(row[1]) for row in rows]


@pytest.mark.parametrize(("begin", "off"), [(-128.1, 0.0018), (-70.8, -0.0002)])
@pytest.mark.parametrize("others", [[], [2.0, 4.0]])
def test_points_on_either_side_of_where_a_closed_path_begins_are_met(
    tmp_path: Path, begin: float, off: float, others: list[float]
) -> None:
    """One turn in a second: a point before the begin is met at its end, less what is missing."""
    law, start = f"{{law: constant_speed, speed: 360 deg/s, from: {begin} deg}}", begin * pi / 180
    error, instants = circle(tmp_path, law, "1 s", [start + off, *(start + other for other in others)])
    assert error < 1e-12
    assert instants == pytest.approx([off / (2 * pi) % 1.0, *(other / (2 * pi) for other in others)], abs=1e-9)
