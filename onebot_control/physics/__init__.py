"""Physics of robots on level ground or in a scene, with PyBullet: joint velocities in, motion out.

Example:
    >>> from onebot_control.physics.spawning import RobotSpawn
    >>> from onebot_control.physics.world import World
    >>> from onebot_description.description import load_description
    >>> description = load_description("package://onebot_description/urdf/onebot.urdf.xacro")
    >>> with World([RobotSpawn(description, ("left_wheel_joint", "right_wheel_joint"))]) as world:
    ...     [robot] = world.robots
    ...     robot.turn([3.0, 3.0])  # rad/s
    ...     world.step(1.0)
    ...     joints, pose, velocity = robot.state()
    >>> pose.translation[0] > 0.1
    True
"""
