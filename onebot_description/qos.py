"""How topics are heard and offered (quality of service), where ROS's default is not what is meant.

It imports nothing of a robot's description, so that a command that needs no more stays quick.
"""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

# Late comers get the last message: the description, a page's address, static transforms.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Static transforms as they are heard: of many publishers, each with a last message of its own.
STATIC_TF = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Best effort matches every publisher, and never makes one wait for us.
SENSOR = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
