"""Starts nodes as processes, shows what they print, and stops them all together.

    from onebot_bringup.launcher.launcher import Launcher
    from onebot_bringup.launcher.process import python_node

    nodes = [python_node("robot_state_publisher", "onebot_description.robot_state_publisher")]
    exit_code = Launcher(nodes).run()

Standard library only: no ROS, no threads. Nothing is imported here, because each node's process
comes by here as well.
"""
