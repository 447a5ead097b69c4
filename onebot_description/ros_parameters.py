"""Parameters of a node whose types are left open, so that 10 and 10.0 are both right."""

from array import array
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter


def declare(node: Node, name: str, default: Any = None) -> None:
    """Declare a parameter, unless that was done; ``default`` counts where nobody has set it."""
    if node.has_parameter(name):
        return
    # Of an empty list rclpy cannot tell what kind it is: such is set afterwards.
    first = None if default == [] else default
    node.declare_parameter(name, first, ParameterDescriptor(dynamic_typing=True))
    if default == [] and node.get_parameter(name).value is None:
        node.set_parameters([parameter(name, default)])


def parameter(name: str, value: Any) -> Parameter:
    """Return a parameter of whichever type ``value`` has; None unsets it."""
    if value == []:
        return Parameter(name, Parameter.Type.STRING_ARRAY, [])
    return Parameter(name, value=value)


def plain(value: Any) -> Any:
    """Return a parameter's value, arrays as lists: they come as array.array, tuple or list."""
    return list(value) if isinstance(value, array | tuple | list) else value
