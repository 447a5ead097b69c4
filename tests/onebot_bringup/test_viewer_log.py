"""What nodes log: lines of text at their times, where somebody asks for them."""

import pytest
from rcl_interfaces.msg import Log

from onebot_bringup.viewer.core.display import LayoutPart
from onebot_bringup.viewer.displays.log import LogDrawing, LogView
from onebot_description.ros.wire.messages import time_message
from tests.onebot_bringup.drive_support import column, stamps
from tests.onebot_bringup.viewer_support import START_NS, Shown, drawn


def line(level, text, node="planner") -> Log:
    """A line; of level 20 for "info"."""
    return Log(stamp=time_message(START_NS), level=level, name=node, msg=text)


def test_lines_have_their_level_node_and_time(tmp_path):
    """A level between two is the lower; of what is below the least nothing is shown."""
    lines = [line(level, f"at {level}") for level in (10, 20, 30, 35, 40, 50)]
    view = "log: {visible: true, level: info}"
    file = drawn(tmp_path, view, *(("/rosout", each) for each in lines))
    texts = [f"[planner] at {level}" for level in (20, 30, 35, 40, 50)]
    assert column(file, "/log/rosout", "TextLog:text") == [[text] for text in texts]
    levels = ["INFO", "WARN", "WARN", "ERROR", "CRITICAL"]
    assert column(file, "/log/rosout", "TextLog:level") == [[level] for level in levels]
    assert {*stamps(file, "/log/rosout")} == {START_NS}, "their stamps, not when they came"


def test_another_level_writes_no_line_again(tmp_path):
    """It is of the lines that follow."""
    shown = Shown(tmp_path, "log: {visible: true}")
    for number, level in enumerate(("warn", "debug")):
        shown.send("/rosout", line(20, f"{number}"))
        shown.tick()
        shown.look(f"log: {{visible: true, level: {level}}}")
    shown.send("/rosout", line(10, "2"))
    texts = column(shown.end(), "/log/rosout", "TextLog:text")
    assert [text[0] for text in texts if text] == ["[planner] 0", "[planner] 2"]


@pytest.mark.parametrize(
    ("view", "views"),
    [
        ("", ()),
        ("shown: [/rosout]", (LogView("log/rosout", "/rosout"),)),
        ("log: {visible: true}", (LogView("log/rosout", "/rosout"),)),
        ("log: {topics: {/rosout: {visible: true}}}", (LogView("log/rosout", "/rosout"),)),
    ],
)
def test_its_view_is_below_the_robot_if_it_is_asked_for(tmp_path, view, views):
    """Every system has /rosout: not by itself."""
    shown = Shown(tmp_path, view)
    shown.send("/rosout", line(20, ""))
    assert [each.visible for each in shown.view.offered] == [bool(views)]
    displays = shown.view.message_displays
    [display] = [each for each in displays if each.draws is LogDrawing]
    assert display.layout() == ([LayoutPart(wide=views)] if views else [])
    for each in views:
        assert each.view().class_identifier == "TextLog"
    shown.end()
