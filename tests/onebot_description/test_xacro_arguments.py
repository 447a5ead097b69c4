"""What a xacro file declares is found without expanding it."""

from pathlib import Path

import pytest

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
  <xacro:arg name="color" default="red"/><xacro:arg name="length" default="9"/>
</robot>"""


def test_arguments_of_a_file_and_its_includes(tmp_path: Path) -> None:
    (tmp_path / "main.xacro").write_text(MAIN)
    (tmp_path / "part.xacro").write_text(PART)
    arguments = xacro_arguments(str(tmp_path / "main.xacro"))
    found = {argument.name: argument for argument in arguments.arguments}
    assert not arguments.complete  # $(arg needed).xacro may declare more
    assert {name: argument.default for name, argument in found.items()} == {
        "length": "1.5",
        "needed": "",
        "color": "red",
    }
    assert "required" in found["needed"].description
    files = (tmp_path / "main.xacro", tmp_path / "part.xacro")
    included = included_files(str(tmp_path / "main.xacro"))
    assert set(files) <= set(included)
    for file in files[::-1]:  # one that is mended is noticed, too
        file.write_text("<robot")
        assert file in included_files(str(tmp_path / "main.xacro"))


def test_a_file_that_cannot_be_read_declares_nothing(tmp_path: Path) -> None:
    (tmp_path / "bad.xacro").write_text("<robot")
    for name in ("bad.xacro", "absent.xacro", ""):
        assert xacro_arguments(str(tmp_path / name)) == XacroArguments()
    assert xacro_arguments("package://no_such_package/x.xacro") == XacroArguments()


def robot(inside: str) -> str:
    return f'<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{inside}<link/></robot>'


@pytest.mark.parametrize(
    ("included", "complete"),
    [
        ("part.xacro", True),
        ("absent.xacro", True),
        ("$(find onebot_description)/urdf/onebot.urdf.xacro", True),
        ("$(find no_such_package)/urdf/part.xacro", False),
        ("$(arg part).xacro", False),
        ("$(find onebot_description", False),
    ],
)
def test_includes_that_can_be_followed(tmp_path: Path, included: str, complete: bool) -> None:
    main = tmp_path / "main.xacro"
    main.write_text(robot(f'<xacro:include filename="{included}"/>'))
    (tmp_path / "part.xacro").write_text(robot('<xacro:arg name="color" default="red"/>'))
    found = xacro_arguments(str(main))
    assert found.complete is complete
    assert len(included_files(str(main))) > 1 if complete else included_files(str(main)) == (main,)
    if included == "part.xacro":
        assert [argument.name for argument in found.arguments] == ["color"]


def test_arguments_that_are_used_without_being_declared(tmp_path: Path) -> None:
    main = tmp_path / "main.xacro"
    main.write_text(
        robot(
            '<a b="$(arg used) $( arg spaced )"/>$(arg used)<c>$(arg text)</c>'
            '<d e="${xacro.arg(\'inner\')}"/><f g="$(arg both)"/>'
            '<xacro:arg name="both" default="1"/><xacro:arg name="both" default="2"/>'
            '<xacro:arg/><arg name="no_xacro"/><xacro:arg name="void" default=""/>'
        )
    )
    found = {argument.name: argument for argument in xacro_arguments(str(main)).arguments}
    assert sorted(found) == ["both", "inner", "spaced", "text", "used", "void"]
    assert found["both"] == ("both", "1", "declared in main.xacro")
    assert found["used"] == ("used", "", "used in main.xacro, required")
    assert found["void"] == ("void", "", "declared in main.xacro")


def test_includes_of_includes_end(tmp_path: Path) -> None:
    for number in range(15):
        text = robot(f'<xacro:include filename="{number + 1}.xacro"/>' * 2)
        (tmp_path / f"{number}.xacro").write_text(text)
    files = included_files(str(tmp_path / "0.xacro"))
    assert files == tuple(tmp_path / f"{number}.xacro" for number in range(16))
    (tmp_path / "self.xacro").write_text(robot('<xacro:include filename="self.xacro"/>'))
    assert included_files(str(tmp_path / "self.xacro")) == (tmp_path / "self.xacro",)


def test_a_file_of_a_package() -> None:
    found = xacro_arguments("package://onebot_description/urdf/onebot.urdf.xacro")
    assert "mesh_enabled" in {argument.name for argument in found.arguments} and found.complete
