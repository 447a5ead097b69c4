"""The accuracy that the README promises, and the command that measures it."""

import io
import math
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from onebot_control.accuracy import (
    ODOMETRY_GOAL,
    PATHS,
    TRUTH_GOAL,
    Deviation,
    DrivenPath,
    Report,
    Result,
    Segment,
    deviation,
    follow,
    main,
    measure,
    missed,
    robots_table,
    straight,
    table,
    turn,
    write,
)
from onebot_control.driven_robot import DrivenRobot
from onebot_control.odometry import PoseCovariance
from onebot_control.parameters import ControlConfig, default_control_file, read_control_files
from onebot_control.poses import PlanarPose
from onebot_description.description import load_description
from onebot_description.errors import OneBotError

BEGIN, END = "<!-- accuracy -->", "<!-- /accuracy -->"
CHECKOUT = Path(__file__).resolve().parents[2]
ROBOT = CHECKOUT / "tests" / "robots" / "diff_drive.urdf"
ONEBOT = CHECKOUT / "onebot_description" / "urdf" / "onebot.urdf.xacro"


def config(**changes: object) -> ControlConfig:
    values = read_control_files([default_control_file()], "/", "velocity_controller").values
    return ControlConfig.from_parameters({**values, **changes})


def result(**changes: object) -> Result:
    """One metre, exact unless ``changes`` say otherwise."""
    end = PlanarPose(1.0, 0.0, 0.0)
    exact = PoseCovariance()
    whole = Result(DrivenPath("one", straight(1.0)), end, end, exact, end, 1.0, 0.0, 0.0, 0.0)
    return whole._replace(**changes)


class Command(NamedTuple):
    """A run of the command, and what it measured."""

    report: Report
    code: int
    out: str
    err: str
    written: str


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """The command with ``--write FILE``, of the test's robot; to measure takes seconds."""
    reports, file = [], tmp_path_factory.mktemp("accuracy") / "table.md"

    def kept(*arguments):
        reports.append(measure(*arguments))
        return reports[0]

    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr("onebot_control.accuracy.measure", kept)
        code = main(["--robot", str(ROBOT), "--write", str(file)])
    return Command(reports[0], code, out.getvalue(), err.getvalue(), file.read_text())


@pytest.fixture(scope="module")
def diff_drive(command):
    """What was measured of the test's robot."""
    return command.report


@pytest.fixture(scope="module")
def onebot():
    """The same for OneBot."""
    return measure(load_description(ONEBOT), config(), PATHS)


@pytest.mark.parametrize("robot", ["diff_drive", "onebot"])
def test_goals_are_met(robot, request):
    """Odometry within 0.05 % of truth, truth within 0.5 % of command, rest below 0.01 mm."""
    report = request.getfixturevalue(robot)
    assert missed(report) == []
    assert report.rest == 60.0
    assert [r.path for r in report.results] == list(PATHS)


@pytest.mark.parametrize("robot", ["diff_drive", "onebot"])
def test_errors_are_inside_the_ellipse(robot, request):
    """At the end of each path odometry is off truth by less than its covariance says: of 99 %."""
    for found in request.getfixturevalue(robot).results:
        xx, xy, yy, xt, yt, tt = found.covariance
        covariance = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
        off = np.array(found.odometry) - np.array(found.truth)
        assert off @ np.linalg.solve(covariance, off) < 11.34


def test_commanded_paths_are_what_they_are_called(diff_drive):
    """By the integral of the limited command: 2 m, 360 degrees, a closed square, two circles."""
    two_metres, full_turn, square, figure = diff_drive.results
    assert two_metres.length == pytest.approx(2.0)
    assert two_metres.commanded == pytest.approx((2.0, 0.0, 0.0))
    assert full_turn.turned == pytest.approx(2.0 * math.pi)
    assert full_turn.commanded == pytest.approx((0.0, 0.0, 2.0 * math.pi))
    assert square.length == pytest.approx(4.0)
    assert square.commanded == pytest.approx((0.0, 0.0, 2.0 * math.pi), abs=1e-9)
    assert figure.turned == pytest.approx(4.0 * math.pi)
    assert figure.commanded.yaw == pytest.approx(0.0, abs=1e-9)


def test_where_the_robot_starts_does_not_matter():
    drive = DrivenRobot.of(load_description(ROBOT), config(x=3.0, y=-2.0, yaw=2.5))
    found = follow(drive, DrivenPath("arc", (Segment(0.2, 0.2, 2.0), Segment(0.0, 0.0, 1.0))))
    drive.plant.close()
    assert deviation(found.truth, found.commanded).position < 1e-3
    assert found.truth_error < 2e-3


@pytest.mark.parametrize("rate", [33.3, 150, 1000])
def test_odometry_is_as_accurate_at_every_control_rate(rate):
    drive = DrivenRobot.of(load_description(ROBOT), config(update_rate=rate))
    for path in (DrivenPath("line", straight(0.4)), DrivenPath("spot", turn(0.5), turning=True)):
        found = follow(drive, path)
        assert found.odometry_error < ODOMETRY_GOAL
        assert found.truth_error < TRUTH_GOAL
        drive.reset()
    drive.plant.close()


def test_wrong_odometry_is_seen():
    """A wheel that is believed 1 % larger than it is shows as 1 %."""
    wrong = config(left_wheel_radius_multiplier=1.01, right_wheel_radius_multiplier=1.01)
    (found,) = measure(load_description(ROBOT), wrong, PATHS[:1], rest=0.01).results
    assert found.odometry_error == pytest.approx(0.01, rel=0.01)
    report = Report((found,), 0.0, 60.0, 20.0, 100.0)
    assert any("odometry is off truth" in sentence for sentence in missed(report))


def test_share_is_relative_to_the_path():
    """Place by its length, heading by all turning; on the spot only the heading counts."""
    assert result().share(Deviation(0.01, 0.0)) == pytest.approx(0.01)
    assert result(turned=2.0).share(Deviation(0.0, 0.02)) == pytest.approx(0.01)
    spot = result(path=DrivenPath("spot", turn(1.0), turning=True), length=0.0, turned=1.0)
    assert spot.share(Deviation(5.0, 0.003)) == pytest.approx(0.003)


def test_missed_goals_are_named():
    off = result(odometry=PlanarPose(1.001, 0.0, 0.0), commanded=PlanarPose(1.1, 0.0, 0.0))
    sentences = missed(Report((off,), 1e-4, 60.0, 10.0, 100.0))
    assert len(sentences) == 3
    assert "0.100%" in sentences[0]
    nan = result(truth=PlanarPose(math.nan, 0.0, 0.0))
    assert len(missed(Report((nan,), math.nan, 60.0, math.nan, 100.0))) == 3
    assert missed(Report((result(),), 0.0, 60.0, 20.0, 100.0)) == []


def test_writing_replaces_what_is_between_the_marks(tmp_path):
    file = tmp_path / "README.md"
    file.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    for _ in range(2):
        write(file, "new\n")
        assert file.read_text() == f"before\n{BEGIN}\nnew\n{END}\nafter\n"
    write(tmp_path / "new.md", "text\n")
    assert (tmp_path / "new.md").read_text() == f"{BEGIN}\ntext\n{END}\n"
    file.write_text("nothing here\n")
    with pytest.raises(OneBotError, match="README.md: has no lines"):
        write(file, "new\n")
    assert file.read_text() == "nothing here\n"


def test_command_prints_and_writes_the_same(command):
    assert command.out.startswith("| Path |") and command.out == table(command.report)
    assert command.written == f"{BEGIN}\n{command.out}{END}\n"
    assert (command.code, command.err) == (0, "")


def test_a_missing_robot_is_a_clear_error(tmp_path):
    with pytest.raises(OneBotError, match="nowhere.urdf"):
        main(["--robot", str(tmp_path / "nowhere.urdf")])
    with pytest.raises(OneBotError, match="nowhere.yaml"):
        main(["--robot", str(ROBOT), "--control", str(tmp_path / "nowhere.yaml")])


def test_robots_are_compared_in_one_table(tmp_path, capsys):
    arm = CHECKOUT / "tests" / "robots" / "good_mimic_chain.urdf"
    files = [str(ROBOT), str(arm), str(tmp_path / "missing.urdf")]
    assert main(["--robots", *files, "--write", str(tmp_path / "robots.md")]) == 0
    text = capsys.readouterr().out
    head, _, drives, stands, missing = text.splitlines()
    assert head.startswith("| Robot | File | Wheels")
    assert "| 2; 0.300 m, 0.060 m | 2.0000 m; 2.0000 m, 0.0 mm aside, " in drives
    assert drives.endswith("| 360.00°; 360.00° |")
    assert "refused: no wheel on the left that has its like on the right was found" in stands
    assert "unreadable: " in missing and "missing.urdf: no such file" in missing
    marked = f"<!-- accuracy of robots -->\n{text}<!-- /accuracy of robots -->\n"
    assert (tmp_path / "robots.md").read_text() == marked
    assert robots_table([], config()).count("\n") == 2
