"""Types that are installed, by name, and the text that defines them."""

import os
import sys
from pathlib import Path

import pytest
from std_srvs.srv import SetBool

from onebot_bringup.introspection.interfaces import message_class, service_class
from onebot_description.errors import OneBotError
from tests.support import run_to_end


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("geometry_msgs/msg/Twst", 'did you mean "geometry_msgs/msg/Twist"'),
        ("geometry_msgs/srv/Twist", 'did you mean "geometry_msgs/msg/Twist"'),
        ("", "no message type"),
    ],
)
def test_unknown_types(name: str, part: str) -> None:
    """A type that is not installed is refused with those that are alike."""
    with pytest.raises(OneBotError, match="no message type") as caught:
        message_class(name)
    assert part in str(caught.value)


def test_short_names() -> None:
    """The short form of a type's name is the long one."""
    assert message_class("geometry_msgs/Twist") is message_class("geometry_msgs/msg/Twist")
    assert service_class("std_srvs/SetBool") is SetBool


def test_a_definition_is_utf_8_whatever_the_locale(tmp_path: Path) -> None:
    """As ROS writes them; a recording holds them, too."""
    folder = tmp_path / "share/names_of_angles/msg"
    folder.mkdir(parents=True)
    text = "float64 alpha  # \N{GREEK SMALL LETTER ALPHA}\n"
    (folder / "Angle.msg").write_text(text, encoding="utf-8")
    code = (
        "from onebot_description.ros.wire.interface_text import interface_text as definition;"
        "print(ascii(definition('names_of_angles/msg/Angle')))"
    )
    limited = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    paths = {"AMENT_PREFIX_PATH": str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path)}
    done = run_to_end([sys.executable, "-c", code], env={**os.environ, **limited, **paths})
    assert done.stdout.strip() == ascii(text), done.stderr
