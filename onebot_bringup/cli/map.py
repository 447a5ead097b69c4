"""``onebot map save``: saves the map on the topic map, as Nav2's map_saver does."""

from argparse import Namespace

from onebot_bringup.cli.options import Subcommand, positional
from onebot_bringup.cli.session import Session
from onebot_description.errors import OneBotError


def save(args: Namespace) -> None:
    """Save the map."""
    import numpy as np
    from nav_msgs.msg import OccupancyGrid as GridMessage

    from onebot_control.navigation.map_files import save_map
    from onebot_control.occupancy_grid import OccupancyGrid
    from onebot_description.ros.topic_qos import LATCHED

    with Session(args.ros_args) as session:
        received = list[GridMessage]()
        session.node.create_subscription(GridMessage, "map", received.append, LATCHED)
        topic = session.full_name("map")
        if not session.look_for(lambda: received, f"a map on {topic}"):
            raise OneBotError(f"there is no map on {topic}: start the robot with navigate:=true")
    info = received[-1].info
    data = np.asarray(received[-1].data, np.int8).reshape(info.height, info.width)
    origin = info.origin.position.x, info.origin.position.y
    path = save_map(OccupancyGrid(data, info.resolution, origin), args.name)
    print(f"saved {path}: {info.width} x {info.height} cells of {info.resolution:g} m")


COMMANDS = {
    "save": Subcommand(
        "save the map as NAME.yaml and NAME.pgm",
        save,
        positional("NAME", "path of the files without their endings"),
    ),
}
