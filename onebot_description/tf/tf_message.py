"""``TFMessage``: the genuine tf2_msgs/msg/TFMessage where it is installed, else our own.

Both are the same on the wire. Tested: the type's name, hash and description, and every field.
"""

import logging
from typing import Any

__all__ = ["TFMessage"]


def _find_genuine() -> Any:
    """Return the class of an installed tf2_msgs; None without one, or if it cannot be used."""
    try:
        from tf2_msgs.msg import TFMessage as Genuine

        if type(Genuine)._TYPE_SUPPORT is None:
            type(Genuine).__import_type_support__()
        return Genuine if type(Genuine)._TYPE_SUPPORT is not None else None
    except ModuleNotFoundError:
        return None
    except Exception as error:  # a failing type support raises bare Exceptions
        logging.getLogger(__name__).debug("tf2_msgs is installed but unusable: %s", error)
        return None


def _make_own() -> Any:
    from onebot_description.tf import _message

    type(_message.TFMessage).__import_type_support__()
    return _message.TFMessage


TFMessage: Any = _find_genuine() or _make_own()
"""The message class, ready for rclpy. Importing it raises an ``OneBotError`` that is also an
``ImportError`` where no type support can be loaded."""
