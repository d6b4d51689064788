"""Laws through points and tables: ramps by hand, cubics reproduced, tables refused with their line."""

import math
from pathlib import Path

import numpy as np
import pytest

from pinarm.errors import InputError, UnitError
from pinarm.input.csv_tables import read_table
from pinarm.input.units import unit
from pinarm.mechanics.laws import SpeedPoints, Spline
from pinarm.mechanics.laws.motion_law import Grid

from .test_motion_law import LAWS, across, table


def test_steps_hold_each_value_from_its_instant_on():
    law = LAWS["steps"]
    assert law.jumps(0) == law.breakpoints() == [0.9, 1.4]
    t = np.array([-1.0, 0.5, 0.9, 1.2, 1.4, 9.0])
    grid = Grid.cover(t, [law])
    assert grid.t.tolist() == [-1.0, 0.5, 0.9, 0.9, 1.2, 1.4, 1.4, 9.0]
    assert grid.evaluate(law)[0].tolist() == [0.2, 0.2, 0.2, 1.0, 1.0, 1.0, -0.7, -0.7]
    assert not np.array(grid.evaluate(law)[1:]).any()


class TestSpeedPoints:
    def test_a_ramp_of_speed_by_hand(self):
        """A carousel: 0 to 0.84 rad/s within 9 s, then steady: 0.84 * 9 / 2 + 0.84 * 8 = 10.5 rad after 17 s."""
        law = SpeedPoints(points=[(0.0, 0.0), (9.0, 0.84)])
        s, ds, dds = across(law, [-1.0, 4.5, 9.0, 17.0])
        assert s == pytest.approx([0.0, 0.945, 3.78, 10.5], abs=1e-14)
        assert ds == pytest.approx([0.0, 0.42, 0.84, 0.84], abs=1e-15)
        assert dds == pytest.approx([0.0, 0.84 / 9, 0.0, 0.0], abs=1e-15)


class TestSpline:
    def test_it_meets_its_points_with_the_given_end_speeds(self):
        law = LAWS["spline"]
        s, ds, dds = across(law, [t for t, _ in law.points] + [3.2])
        assert s == pytest.approx([*(value for _, value in law.points), 1.5 - 0.6], abs=1e-15)
        assert (ds[0], ds[3], ds[4]) == pytest.approx((0.4, -0.6, -0.6), abs=1e-14)
        assert dds[4] == 0.0
        assert across(law, [-0.7])[0] == pytest.approx(0.2 - 0.4, abs=1e-15)


@pytest.mark.parametrize("member", [Spline, SpeedPoints])
@pytest.mark.parametrize("times", [(0.0, 0.0), (0.0, 2.0, 1.0)])
def test_points_that_do_not_ascend_are_refused(member, times):
    with pytest.raises(InputError, match=rf"do not ascend.*\(point {len(times)}\)"):
        member(points=[(t, 0.0) for t in times])


class TestTable:
    def test_it_is_the_spline_through_its_rows_in_si(self, tmp_path):
        law = table(tmp_path, "t [ms],theta [deg],note\n0,0,x\n500,90,y\n\n2000,180,z\n", speeds=(0.1, 0.2))
        points = [(0.0, 0.0), (0.5, math.pi / 2), (2.0, math.pi)]
        t = np.linspace(-1.0, 3.0, 41)
        assert across(law, t) == pytest.approx(across(Spline(points=points, speeds=(0.1, 0.2)), t), abs=1e-14)
        law.check_units(unit("rad"))
        with pytest.raises(UnitError, match=r"column 2 of the table table\.csv is in deg/s"):
            table(tmp_path, "t [s],w [deg/s]\n0,0\n1,1\n").check_units(unit("m"))
        with pytest.raises(UnitError, match=r"column 1 of the table table\.csv is in deg"):
            table(tmp_path, "crank [deg],x [m]\n0,0\n1,1\n").check_units(unit("m"))

    @pytest.mark.parametrize(
        ("text", "column", "message"),
        [
            ("t [s],b [deg],a [deg]\n0,0,1\n1,1,2\n", None, r"has several columns[\s\S]*column: one of a, b"),
            ("t [s],b [deg],a [deg]\n0,0,1\n1,1,2\n", "c", r"no column 'c'[\s\S]*column: one of a, b"),
            ("t [s],b [deg],b [m]\n0,0,1\n1,1,2\n", "b", r"several columns 'b'"),
        ],
    )
    def test_a_column_that_is_not_clear_is_refused(self, tmp_path, text, column, message):
        with pytest.raises(InputError, match=message):
            table(tmp_path, text, column=column)

    @pytest.mark.parametrize("text", ["\ufefft [s],x [m]\r\n0,0\r\n1,1\r\n", '"t [s]","x [m]",\n 0 , 0,\n"1",+1e0,\n'])
    def test_what_spreadsheets_write_is_read(self, tmp_path, text):
        assert tuple(read_table(Path(table(tmp_path, text).file), None).columns[1]) == (0.0, 1.0)

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("t [s],x [m]\n0,0\n2,1\n1,2\n", r"table\.csv:4:1: the first column does not increase"),
            ("t [s],x [m]\n0,0\nnan,1\n", r"table\.csv:3:1: a finite number is missing"),
            ("t [s],x [m]\n0,0\n0,5,0,1\n", r"table\.csv:3:1: the row has 4 cells, the heading 2"),
            ("t [s];x [m]\n0;0\n1;1\n", r"table\.csv:1:1: the cells of this table are separated by semicolons"),
            ("t,x [m]\n0,0\n1,1\n", r"table\.csv:1:1: the heading 't' has no unit"),
            ("t [s],x [m]\n0,0\n", "too short"),
        ],
    )  # fmt: skip
    def test_bad_tables_are_refused_with_their_line(self, tmp_path, text, message):
        with pytest.raises(InputError, match=message):
            table(tmp_path, text)

    def test_a_file_outside_the_root_is_refused(self, tmp_path):
        folder = tmp_path / "root"
        folder.mkdir()
        (tmp_path / "table.csv").write_text("t [s],x [m]\n0,0\n1,1\n")
        (folder / "link.csv").symlink_to(tmp_path / "table.csv")
        for file in ("../table.csv", "link.csv", str(tmp_path / "table.csv")):
            with pytest.raises(InputError, match="leads out of the root folder"):
                table(folder, file=file)

    def test_a_file_that_never_ends_is_refused(self, tmp_path):
        with open(tmp_path / "table.csv", "wb") as stream:
            stream.truncate(200_000_000)  # takes no room on the disk
        with pytest.raises(InputError, match="too large"):
            table(tmp_path)
