#!/usr/bin/env python3
"""navigator: drives a robot to goals around obstacles, and builds a map with its lidar.

Run it alone with ``python -m onebot_control.navigator [FILE] --ros-args ...``, beside a simulation,
a real robot or a recording; FILE is the robot's URDF or xacro file. Parameters and interfaces have
Nav2's names, so that Nav2's clients work. For several robots, as in velocity_controller, one
process runs a node for each: ``... --robot -r __ns:=/robot1 --robot -r __ns:=/robot2``.

Subscribes:
    scan (sensor_msgs/msg/LaserScan, best effort): scans of a level lidar; its frame is in TF.
    velocity_controller/odom (nav_msgs/msg/Odometry): wheel odometry.
    imu (sensor_msgs/msg/Imu): measures rotation more exactly than the wheels; optional.
    /tf, /tf_static (tf2_msgs/msg/TFMessage): poses of the sensors, and frames of goals.
    robot_description (std_msgs/msg/String, transient local): the robot's footprint.
    goal_pose (geometry_msgs/msg/PoseStamped): a goal to drive to.
    initialpose (geometry_msgs/msg/PoseWithCovarianceStamped): the robot's pose in the map.
    velocity_controller/cmd_vel: commands from other nodes, which end the goal.
    velocity_controller/cmd_vel_locked (std_msgs/msg/Bool, transient local): a lock ends the goal.

Publishes:
    velocity_controller/cmd_vel (geometry_msgs/msg/Twist, or TwistStamped if the robot takes that).
    /tf (tf2_msgs/msg/TFMessage): global_frame -> odom.
    map (nav_msgs/msg/OccupancyGrid, transient local): the map, once a second.
    amcl_pose (geometry_msgs/msg/PoseWithCovarianceStamped, transient local): the pose in the map.
    plan (nav_msgs/msg/Path): the path to the goal.
    global_costmap/costmap, local_costmap/costmap (nav_msgs/msg/OccupancyGrid, transient local).
    local_costmap/published_footprint (geometry_msgs/msg/PolygonStamped).
    ~/status (std_msgs/msg/String, transient local): its current activity, in one line.

Actions (nav2_msgs): navigate_to_pose, navigate_through_poses, follow_waypoints, follow_path,
    compute_path_to_pose, compute_path_through_poses, smooth_path, spin, backup, drive_on_heading,
    wait. A new goal of any of them replaces the current one.

Services: map_server/map, map_server/load_map, map_saver/save_map,
    global_costmap/clear_entirely_global_costmap, local_costmap/clear_entirely_local_costmap;
    get_state of Nav2's nodes, manage_nodes and is_active of its lifecycle managers.
"""

if __name__ == "__main__":  # first: the imports take a second
    from onebot_description.ros.process_start import start_node

    start_node()

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from onebot_control.navigation.parameters import NavigatorParameters
from onebot_description.ros.command_line import RosArguments, split_robots
from onebot_description.ros.run_node import run_described_node

if TYPE_CHECKING:
    from onebot_control.nodes.navigation.navigator_node import NavigatorNode


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; ``args`` are as in sys.argv. Return the exit code."""
    common, robots = split_robots(sys.argv if args is None else args)

    def make(file: str | None, _: RosArguments) -> "list[NavigatorNode]":
        from onebot_control.nodes.navigation.navigator_node import NavigatorNode

        return [NavigatorNode(file, words) for words in robots] or [NavigatorNode(file)]

    return run_described_node("navigator", __doc__, NavigatorParameters, make, args=common)


if __name__ == "__main__":
    sys.exit(main())
