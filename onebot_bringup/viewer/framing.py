"""What of a recording's layout is in a picture: all of it, or the robot alone, and from where.

A layout here is what Rerun's client reads and writes: entity path -> archetype -> field -> value.
"""

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from onebot_bringup.viewer.blueprint import ROBOT_VIEW
from onebot_bringup.viewer.geometry import Vector
from onebot_description.errors import OneBotError

LayoutValues = Mapping[str, Any]

_TIME = "/time_panel"
_PANELS = {
    "/blueprint_panel": "PanelBlueprint",
    "/selection_panel": "PanelBlueprint",
    _TIME: "TimePanelBlueprint",
    "/top_panel": "PanelBlueprint",
}


@dataclass(frozen=True)
class Framing:
    """How to frame a picture.

    Attributes:
        dashboard: the whole layout with its plots; False for the robot alone.
        eye: where to look from, metres in the fixed frame; None as the layout says.
        target: where to look at, metres in the fixed frame; None as the layout says.
        time_panel: the dashboard's; a recording that still grows is never still in it.
    """

    dashboard: bool = True
    eye: Vector | None = None
    target: Vector | None = None
    time_panel: bool = True

    @property
    def as_it_is(self) -> bool:
        """The layout is shown as it is."""
        return self == Framing()

    @property
    def of_robot(self) -> bool:
        """It takes a view of the robot."""
        return not self.dashboard or self.eye is not None or self.target is not None


def robot_view(views: Mapping[str, tuple[str, str]]) -> str:
    """Return the view that shows the robot in space.

    Args:
        views: class and name of each view, by its id.

    Raises:
        OneBotError: none of them shows anything in space.
    """
    in_space = [identity for identity, (kind, _) in views.items() if kind == "3D"]
    named = [identity for identity in in_space if views[identity][1] == ROBOT_VIEW]
    if not in_space:
        raise OneBotError(
            "the recording has no view in 3D; --dashboard gives a picture of those it has"
        )
    return (named or in_space)[0]


def framed(layout: LayoutValues, view: str, framing: Framing) -> dict[str, Any]:
    """Return ``layout`` as ``framing`` wants it.

    Args:
        layout: what the viewer shows now.
        view: the id of the robot's view in it; "" if ``framing`` takes none.
        framing: what is to be in the picture.
    """
    changed = copy.deepcopy(dict(layout))
    for path, archetype in _PANELS.items():
        if not framing.dashboard or (path == _TIME and not framing.time_panel):
            _entry(changed, path, archetype)["state"] = "Hidden"
    if not framing.dashboard:
        _entry(changed, "/viewport", "ViewportBlueprint")["maximized"] = view
    if framing.eye is not None or framing.target is not None:
        controls = _entry(changed, f"/view/{view}/EyeControls3D", "EyeControls3D")
        # To follow something would move the eye away from the place that is asked for.
        controls.pop("tracking_entity", None)
        controls.setdefault("kind", "Orbital")
        if framing.eye is not None:
            controls["position"] = list(framing.eye)
        if framing.target is not None:
            controls["look_target"] = list(framing.target)
    return changed


def _entry(layout: dict[str, Any], path: str, archetype: str) -> dict[str, Any]:
    entry: dict[str, Any] = layout.setdefault(path, {}).setdefault(archetype, {})
    return entry
