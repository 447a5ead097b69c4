"""What a xacro file declares is found without expanding it."""

from pathlib import Path

from onebot_description.description.xacro import XacroArguments, included_files, xacro_arguments

MAIN = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <!-- a comment -->
  <xacro:arg name="length" default="1.5"/>
  <xacro:arg name="needed"/>
  <xacro:include filename="part.xacro"/>
  <xacro:include filename="$(arg needed).xacro"/>
  <xacro:include filename="absent.xacro"/>
  <link name="a"/>
</robot>"""
PART = """<robot xmlns:xacro="http://wiki.ros.org/xacro">
  <xacro:include filename="main.xacro"/>
  <xacro:arg name="colour" default="red"/><xacro:arg name="length" default="9"/>
</robot>"""


def test_arguments_of_a_file_and_its_includes(tmp_path: Path) -> None:
    """Defaults, required ones, and those of includes; a circle or a missing file does no harm."""
    (tmp_path / "main.xacro").write_text(MAIN)
    (tmp_path / "part.xacro").write_text(PART)
    arguments = xacro_arguments(str(tmp_path / "main.xacro"))
    found = {argument.name: argument for argument in arguments.arguments}
    assert not arguments.complete  # $(arg needed).xacro may declare more
    assert {name: argument.default for name, argument in found.items()} == {
        "length": "1.5",
        "needed": "",
        "colour": "red",
    }
    assert "required" in found["needed"].description
    assert set(included_files(str(tmp_path / "main.xacro"))) == {
        tmp_path / "main.xacro",
        tmp_path / "part.xacro",
    }


def test_a_file_that_cannot_be_read_declares_nothing(tmp_path: Path) -> None:
    """Loading it is what reports the mistake."""
    (tmp_path / "bad.xacro").write_text("<robot")
    for name in ("bad.xacro", "absent.xacro", ""):
        assert xacro_arguments(str(tmp_path / name)) == XacroArguments()
    assert xacro_arguments("package://no_such_package/x.xacro") == XacroArguments()
