"""Shows a recording in Rerun as the live viewer would have shown it, all of its time at once."""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import rerun as rr
import rerun.blueprint as rrb

from onebot_bringup.bag.frame_prefix import frame_prefix_of
from onebot_bringup.bag.reader import Bag
from onebot_bringup.bag_feed import BagFeed, Say, Shown
from onebot_bringup.bag_robot import DESCRIPTION, RobotTopics, frames_of, robot_of
from onebot_bringup.viewer.streams import TIMELINE
from onebot_bringup.viewer.view_config import ViewConfig, load_view
from onebot_bringup.viewer.view_files import view_for
from onebot_description.errors import OneBotError
from onebot_description.text import listing


def log_bag(
    bag: Bag,
    stream: rr.RecordingStream,
    *,
    view: Path | None = None,
    fixed_frame: str = "",
    frame_prefix: str = "",
    namespace: str = "",
    from_start: bool = True,
    progress: Say = print,
    warn: Say = print,
) -> Shown:
    """Log all that ``bag`` holds of a robot.

    Args:
        bag: the recording.
        stream: where to log.
        view: how to look at it, a .yaml or .rbl file; None for the view of the robot's
            description, if that is installed.
        fixed_frame: the frame to show everything in; "" for the view's.
        frame_prefix: put before link names to get their frames; "" to find it out.
        namespace: of the robot to show; "" for the first.
        from_start: the viewer plays it from its beginning; False: it shows its end.
        progress: told how far it is when that takes over two seconds.
        warn: told what cannot be shown, and of damage.

    Raises:
        OneBotError: there is nothing to show in it or in the namespace, or the view is wrong.
    """
    names = RobotTopics(bag, namespace)
    if not names.shown:
        raise OneBotError(
            f"{bag.source} holds nothing of a robot: no description, transforms or joint states "
            f"(topics: {listing(bag.topics)})"
        )
    if len(names.spaces) > 1 and not namespace:
        there = listing([space or "/" for space in names.spaces])
        warn(
            f"several robots are recorded, in {there}: showing that in {names.space or '/'} "
            "(namespace:= chooses)"
        )
    elif not names.descriptions:
        warn(f"{bag.source} holds no {DESCRIPTION}: showing the frames without the robot")
    robot = robot_of(bag, names)
    view = view or (view_for(robot.name) if robot is not None else None)
    if robot is not None and not frame_prefix:
        frames = frames_of(bag, names)
        frame_prefix = frame_prefix_of(robot.root, robot.links, frames, names.space)
    config, blueprint = ViewConfig(), None
    if view is not None and view.suffix == ".rbl":
        blueprint = view
    elif view is not None:
        config = load_view(view)
    if fixed_frame:
        config = replace(config, fixed_frame=fixed_frame)
    for sentence in bag.warnings:
        warn(sentence)
    told = len(bag.warnings)
    played = cast(rr.RecordingStream, _Played(stream)) if from_start else stream
    shown = BagFeed(names, played, config, blueprint, frame_prefix, warn).run(bag, progress)
    for sentence in bag.warnings[told:]:
        warn(sentence)
    if not shown.messages:
        raise OneBotError(f"nothing of {bag.source} can be shown")
    return shown


class _Played:
    """A recording whose layouts play it from its beginning, in the place of following its end."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def send_blueprint(self, blueprint: rrb.Blueprint, **options: bool) -> None:
        blueprint.time_panel = rrb.TimePanel(
            state="collapsed", timeline=TIMELINE, play_state="playing"
        )
        self._stream.send_blueprint(blueprint, **options)
