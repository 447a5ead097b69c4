"""Starts nodes as processes, shows what they print, and stops them all together.

    from onebot_bringup.launcher.launcher import Launcher
    from onebot_bringup.launcher.process import NodeProcess

    node = NodeProcess("robot_state_publisher", "onebot_description.robot_state_publisher")
    exit_code = Launcher("example").run([node])

Standard library only, no ROS. Nothing is imported here, because each node's process imports this
package as well.
"""
