"""Blocks of sensors, and robots of one link that have them."""

from onebot_description.description.loading import parse_description

RAY = (
    "<ray><scan><horizontal><samples>{samples}</samples><min_angle>{low}</min_angle>"
    "<max_angle>{high}</max_angle></horizontal></scan>"
    "<range><min>{near}</min><max>{far}</max></range></ray>"
)
VALUES = {"samples": 360, "low": -3, "high": 3, "near": 0.1, "far": 10, "rate": 10}


def block(name="s", kind="ray", inside=None, link="a", **values):
    """One block, in a line."""
    values = VALUES | values
    inside = RAY.format(**values) if inside is None else inside
    rate = f"<update_rate>{values['rate']}</update_rate>"
    return (
        f'<gazebo reference="{link}"><sensor name="{name}" type="{kind}">{rate}{inside}'
        "</sensor></gazebo>"
    )


def camera(inside="", kind="camera", fov=1, width=320, height=240, plugin="", **others):
    size = f"<width>{width}</width><height>{height}</height>"
    values = f"<horizontal_fov>{fov}</horizontal_fov><image>{size}</image>"
    return block(kind=kind, inside=f"<camera>{values}{inside}</camera>{plugin}", **others)


def read(*blocks):
    """The description of a robot of one link; the blocks are on lines 2, 3, ..."""
    return parse_description(
        "\n".join(['<robot name="r"><link name="a"/>', *blocks, "</robot>"]), "r"
    )


def rays(*plugins: str, rows: int = 1, kind: str = "ray", name: str = "s") -> str:
    """A lidar of these rows, with plugins."""
    text = RAY.format(**VALUES)
    if rows > 1:
        fan = f"<vertical><samples>{rows}</samples><min_angle>-0.1</min_angle>"
        text = text.replace("</scan>", f"{fan}<max_angle>0.3</max_angle></vertical></scan>")
    return block(name, kind, text + "".join(plugins))


def plugin(inside: str = "", file: str = "libgazebo_ros_ray_sensor.so", name: str = "p") -> str:
    return f'<plugin name="{name}" filename="{file}">{inside}</plugin>'


def ros(*remappings: str, namespace: str = "") -> str:
    """The element of a plugin of ROS 2."""
    space = f"<namespace>{namespace}</namespace>" if namespace else ""
    rules = "".join(f"<remapping>{each}</remapping>" for each in remappings)
    return f"<ros>{space}{rules}</ros>"
