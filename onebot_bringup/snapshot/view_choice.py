"""Which view a picture is made with: the one asked for, or else the robot's own."""

from dataclasses import dataclass, field
from pathlib import Path

from onebot_bringup.viewer.view_config import ViewConfig, load_view
from onebot_bringup.viewer.view_files import view_for
from onebot_description.errors import OneBotError


@dataclass(frozen=True)
class ChosenView:
    """How to look at the robot; ``blueprint`` is a ``.rbl`` file for the layout, if any."""

    config: ViewConfig = field(default_factory=ViewConfig)
    blueprint: Path | None = None


def choose_view(asked: str, robot_name: str) -> ChosenView:
    """Return the view to use.

    Args:
        asked: a view file (.yaml), a layout saved in the viewer (.rbl), "none" for neither, or ""
            for the view in the description's package, if there is one.
        robot_name: as its URDF says.

    Raises:
        OneBotError: there is no such file, or it is wrong.
    """
    own = None if asked == "none" else view_for(robot_name)
    if asked in ("", "none"):
        return ChosenView() if own is None else ChosenView(load_view(own))
    path = Path(asked).expanduser().absolute()
    if path.suffix != ".rbl":
        return ChosenView(load_view(path))
    if not path.is_file():
        raise OneBotError(f"view {path}: there is no such file")
    return ChosenView(ViewConfig() if own is None else load_view(own), path)
