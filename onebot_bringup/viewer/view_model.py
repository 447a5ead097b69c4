"""What a saved view says, as dataclasses; see ``view_config`` for how it is written."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from onebot_bringup.viewer.geometry import Vector
from onebot_bringup.viewer.view_values import Color


@dataclass(frozen=True)
class AxesView:
    """The frames' axes.

    Attributes:
        visible: they are drawn.
        length: metres; 0 to choose it by the robot's size.
        names: the frames' names are written beside them.
        frames: of these frames only; empty for all.
    """

    visible: bool = True
    length: float = 0.0
    names: bool = True
    frames: tuple[str, ...] = ()


@dataclass(frozen=True)
class GridView:
    """The grid on the ground: drawn or not.

    Attributes:
        visible: it is drawn.
        spacing: metres; 0 to choose it by the robot's size.
        height: metres above the fixed frame's origin; negative where that is up on an axle.
    """

    visible: bool = True
    spacing: float = 0.0
    height: float = 0.0


@dataclass(frozen=True)
class CameraView:
    """Eye and target in the fixed frame, metres (None: chosen to fit); link to follow, or ""."""

    eye: Vector | None = None
    target: Vector | None = None
    follow: str = ""


@dataclass(frozen=True)
class JointPlotView:
    """The curves of the joints.

    Attributes:
        positions: they are plotted.
        velocities: they are plotted, if the joint states tell them.
        limits: with the positions, two level lines at those of each joint that has limits.
        window: how many seconds are shown; 0 for all.
    """

    positions: bool = True
    velocities: bool = True
    limits: bool = False
    window: float = 30.0


@dataclass(frozen=True)
class JointRangesView:
    """How far each joint can go, drawn in the robot: an arc or a bar, and a hand where it is.

    Attributes:
        visible: they are drawn.
        radius: of an arc, metres; 0 to choose it by the robot's size.
    """

    visible: bool = False
    radius: float = 0.0


@dataclass(frozen=True)
class PoseView:
    """What is drawn of the poses of an Odometry topic.

    Attributes:
        topic: relative, so that the node's namespace applies.
        color: sRGB bytes; None for one of ours.
        width: of the lines, metres.
        height: metres above the poses; negative to lay it on the ground.
    """

    topic: str = ""
    color: Color | None = None
    width: float = 0.01
    height: float = 0.0


@dataclass(frozen=True)
class TrailView(PoseView):
    """A line along the poses.

    Attributes:
        length: how many seconds of it are shown; 0 for all.
    """

    length: float = 60.0


@dataclass(frozen=True)
class CovarianceView(PoseView):
    """An ellipse and a sector that show the covariance of the pose.

    Attributes:
        sigma: how many standard deviations they are wide.
        heading: radius of the sector, which shows the yaw, metres; 0 for none.
    """

    width: float = 0.006
    sigma: float = 3.0
    heading: float = 0.5


@dataclass(frozen=True)
class SpeedLineView:
    """A curve in each plot of speeds.

    Attributes:
        topic: relative, so that the node's namespace applies.
        type: Twist, TwistStamped or Odometry; auto for what is on the topic.
        color: sRGB bytes; None for one of ours.
    """

    topic: str = ""
    type: str = "auto"
    color: Color | None = None


@dataclass(frozen=True)
class SpeedsView:
    """The curves of the speeds by name, and how many seconds of them are shown."""

    window: float = 20.0
    lines: Mapping[str, SpeedLineView] = field(default_factory=dict)


@dataclass(frozen=True)
class PanelsView:
    """The state of the viewer's panels: hidden, collapsed or expanded."""

    blueprint: str = "collapsed"
    selection: str = "collapsed"
    time: str = "collapsed"
    top: str = "expanded"


@dataclass(frozen=True)
class ViewConfig:
    """How a robot is looked at; see ``view_config``."""

    fixed_frame: str = ""
    axes: AxesView = field(default_factory=AxesView)
    grid: GridView = field(default_factory=GridView)
    collision: bool = False
    background: Color | None = None
    camera: CameraView = field(default_factory=CameraView)
    joint_plot: JointPlotView = field(default_factory=JointPlotView)
    joint_ranges: JointRangesView = field(default_factory=JointRangesView)
    trails: Mapping[str, TrailView] = field(default_factory=dict)
    covariance: Mapping[str, CovarianceView] = field(default_factory=dict)
    speeds: SpeedsView = field(default_factory=SpeedsView)
    panels: PanelsView = field(default_factory=PanelsView)
