"""The displays of the robot view.

Each display is registered in one of these tables, and its settings in ``ViewConfig``.
"""

from typing import Any

from onebot_bringup.viewer.displays.camera_info import CameraInfoDrawing
from onebot_bringup.viewer.displays.curves import CurvesDisplay, SpeedsDisplay
from onebot_bringup.viewer.displays.display import Display
from onebot_bringup.viewer.displays.drawing import Drawing
from onebot_bringup.viewer.displays.image import ImageDrawing
from onebot_bringup.viewer.displays.joint_limits import JointLimitsDisplay
from onebot_bringup.viewer.displays.joint_plot import JointPlotDisplay
from onebot_bringup.viewer.displays.joint_trajectory import JointTrajectoryDrawing
from onebot_bringup.viewer.displays.log import LogDrawing
from onebot_bringup.viewer.displays.map import MapDrawing
from onebot_bringup.viewer.displays.marker import MarkerDrawing
from onebot_bringup.viewer.displays.odometry_display import (
    CovarianceDisplay,
    OdometryDrawing,
    TrailDisplay,
)
from onebot_bringup.viewer.displays.points import LaserScanDrawing, PointCloud2Drawing
from onebot_bringup.viewer.displays.pose_display import (
    PoseArrayDrawing,
    PoseDrawing,
    PoseWithCovarianceDrawing,
)
from onebot_bringup.viewer.displays.shapes_of_messages import (
    ImuDrawing,
    PathDrawing,
    PointStampedDrawing,
    PolygonDrawing,
    RangeDrawing,
)

# Of each robot.
ROBOT_DISPLAYS: tuple[type[Display[Any]], ...] = (
    JointPlotDisplay,
    JointLimitsDisplay,
    TrailDisplay,
    CovarianceDisplay,
    SpeedsDisplay,
    CurvesDisplay,
)
# Of the topics of message types, whichever robot's they are.
MESSAGE_DRAWINGS: tuple[type[Drawing[Any]], ...] = (
    PathDrawing,
    JointTrajectoryDrawing,
    MapDrawing,
    OdometryDrawing,
    PoseDrawing,
    PoseArrayDrawing,
    PoseWithCovarianceDrawing,
    PointStampedDrawing,
    PolygonDrawing,
    LaserScanDrawing,
    PointCloud2Drawing,
    ImageDrawing,
    CameraInfoDrawing,
    ImuDrawing,
    RangeDrawing,
    MarkerDrawing,
    LogDrawing,
)
