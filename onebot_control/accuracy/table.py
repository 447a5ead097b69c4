"""The experiment as a table in Markdown, and putting it where it belongs."""

import math
from pathlib import Path

from onebot_control.accuracy.measuring import Report, Result
from onebot_control.frames import PlanarPose
from onebot_description.errors import OneBotError

BEGIN, END = "<!-- accuracy -->", "<!-- /accuracy -->"

# What the project promises: shares, metres, simulated seconds a second.
ODOMETRY_GOAL = 0.0005
TRUTH_GOAL = 0.005
REST_GOAL = 1e-5
FACTOR_GOAL = 15.0

_HEAD = (
    "Path",
    "Commanded: x, y, heading",
    "Odometry",
    "Truth",
    "Odometry to truth",
    "Truth to command",
)


def table(report: Report) -> str:
    """Return the report as Markdown."""
    rows = [_HEAD, ("---",) * len(_HEAD), *(_row(result) for result in report.results)]
    lines = [f"| {' | '.join(row)} |" for row in rows]
    lines += [
        "",
        f"At rest the robot moves {1e3 * report.rest_drift:.6f} mm in {report.rest:g} s. "
        f"Physics and control at {report.rate:g} Hz run {report.real_time_factor:.0f} times faster "
        "than real time on one core.",
    ]
    return "\n".join(lines) + "\n"


def missed(report: Report) -> list[str]:
    """Return a sentence for each goal that is missed."""
    sentences = []
    for result in report.results:
        for what, error, goal in (
            ("odometry is off truth", result.odometry_error, ODOMETRY_GOAL),
            ("truth is off the command", result.truth_error, TRUTH_GOAL),
        ):
            if not error <= goal:
                sentences.append(f"{result.path.name}: {what} by {error:.3%}; goal {goal:.2%}")
    if not report.rest_drift < REST_GOAL:
        sentences.append(
            f"at rest the robot moves {1e3 * report.rest_drift:.4f} mm; goal {1e3 * REST_GOAL:g} mm"
        )
    if not report.real_time_factor >= FACTOR_GOAL:
        sentences.append(f"real-time factor {report.real_time_factor:.1f}; goal {FACTOR_GOAL:g}")
    return sentences


def write(file: Path, text: str) -> None:
    """Put ``text`` between the marks in ``file``; a file that is not there is made.

    Raises:
        OneBotError: the file has no marks, or cannot be read or written.
    """
    try:
        old = file.read_text(encoding="utf-8") if file.exists() else f"{BEGIN}\n{END}\n"
        before, begin, rest = old.partition(BEGIN)
        _, end, after = rest.partition(END)
        if not (begin and end):
            raise OneBotError(f"{file}: has no lines {BEGIN} and {END} to put the table between")
        file.write_text(f"{before}{BEGIN}\n{text}{END}{after}", encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise OneBotError(f"{file}: {error}") from None


def _row(result: Result) -> tuple[str, ...]:
    poses = (result.commanded, result.odometry, result.truth)
    errors = (
        (result.odometry_error, result.odometry_worst),
        (result.truth_error, result.truth_worst),
    )
    return (
        result.path.name,
        *(_pose(pose) for pose in poses),
        *(f"{error:.4%}, at most {1e3 * worst:.3f} mm" for error, worst in errors),
    )


def _pose(pose: PlanarPose) -> str:
    # Adding 0 turns -0.0 into 0.0.
    x, y = (round(1e3 * value, 3) + 0.0 for value in (pose.x, pose.y))
    return f"{x:.3f} mm, {y:.3f} mm, {round(math.degrees(pose.yaw), 4) + 0.0:.4f}°"
