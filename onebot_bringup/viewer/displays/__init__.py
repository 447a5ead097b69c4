"""What the robot view draws: each display is one file with its settings, topics and layout.

A display is registered by its name in ``DISPLAYS``, and by nothing else.
"""

from typing import Any

from onebot_bringup.viewer.displays.camera_info import CameraInfoDisplay
from onebot_bringup.viewer.displays.covariance import CovarianceDisplay
from onebot_bringup.viewer.displays.curves import CurvesDisplay
from onebot_bringup.viewer.displays.display import Display
from onebot_bringup.viewer.displays.image import ImageDisplay
from onebot_bringup.viewer.displays.imu import ImuDisplay
from onebot_bringup.viewer.displays.joint_limits import JointLimitsDisplay
from onebot_bringup.viewer.displays.joint_plot import JointPlotDisplay
from onebot_bringup.viewer.displays.laser_scan import LaserScanDisplay
from onebot_bringup.viewer.displays.log import LogDisplay
from onebot_bringup.viewer.displays.map import MapDisplay
from onebot_bringup.viewer.displays.marker import MarkerDisplay
from onebot_bringup.viewer.displays.odometry import OdometryDisplay
from onebot_bringup.viewer.displays.path import PathDisplay
from onebot_bringup.viewer.displays.point_cloud2 import PointCloud2Display
from onebot_bringup.viewer.displays.point_stamped import PointStampedDisplay
from onebot_bringup.viewer.displays.polygon import PolygonDisplay
from onebot_bringup.viewer.displays.pose import PoseArrayDisplay, PoseDisplay
from onebot_bringup.viewer.displays.pose_with_covariance import PoseWithCovarianceDisplay
from onebot_bringup.viewer.displays.range import RangeDisplay
from onebot_bringup.viewer.displays.speeds import SpeedsDisplay
from onebot_bringup.viewer.displays.tf import TfDisplay
from onebot_bringup.viewer.displays.trail import TrailDisplay
from onebot_bringup.viewer.displays.trajectory import TrajectoryDisplay

# In the order in which they log: transforms first, since the others wait for theirs.
DISPLAYS: tuple[type[Display[Any]], ...] = (
    TfDisplay,
    JointPlotDisplay,
    JointLimitsDisplay,
    TrailDisplay,
    CovarianceDisplay,
    SpeedsDisplay,
    CurvesDisplay,
    PathDisplay,
    MapDisplay,
    OdometryDisplay,
    PoseDisplay,
    PoseArrayDisplay,
    PoseWithCovarianceDisplay,
    PointStampedDisplay,
    PolygonDisplay,
    TrajectoryDisplay,
    LaserScanDisplay,
    PointCloud2Display,
    ImageDisplay,
    CameraInfoDisplay,
    ImuDisplay,
    RangeDisplay,
    MarkerDisplay,
    LogDisplay,
)
