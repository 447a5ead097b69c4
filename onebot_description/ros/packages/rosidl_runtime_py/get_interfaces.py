"""Lists interfaces, such as msg/String, by their packages."""

from collections.abc import Iterable
from functools import partial

from onebot_description.errors import OneBotError
from onebot_description.ros.wire.interface_text import KINDS, installed_interfaces, interface_file


def get_interfaces(
    package_names: Iterable[str] = (), *, kinds: Iterable[str] = KINDS
) -> dict[str, list[str]]:
    """Return the interfaces of some packages, by default of all.

    Raises:
        LookupError: there is no such package.
    """
    chosen_packages = {*package_names}
    known_packages = {
        name.partition("/")[0] for kind in KINDS for name in installed_interfaces(kind)
    }
    if unknown := sorted(chosen_packages - known_packages):
        raise LookupError(f"Unknown package '{unknown[0]}'")
    interfaces: dict[str, list[str]] = {}
    for name in (name for kind in kinds for name in installed_interfaces(kind)):
        package, _, inner = name.partition("/")
        if package in (chosen_packages or known_packages):
            interfaces.setdefault(package, []).append(inner)
    return interfaces


get_message_interfaces = partial(get_interfaces, kinds=["msg"])
get_service_interfaces = partial(get_interfaces, kinds=["srv"])
get_action_interfaces = partial(get_interfaces, kinds=["action"])


def get_interface_packages() -> dict[str, str]:
    """Return the packages that have interfaces, and the folder of each."""
    interfaces = get_interfaces()
    return {
        name: str(interface_file(f"{name}/{listed[0]}").parents[1])
        for name, listed in interfaces.items()
    }


def get_interface_path(interface_name: str) -> str:
    """Return the file that defines an interface, such as std_msgs/msg/String.

    Raises:
        LookupError: there is no such interface.
    """
    try:
        return str(interface_file(interface_name.partition(".")[0]))
    except (OneBotError, ValueError) as error:
        raise LookupError(f"Could not find the interface '{interface_name}'") from error
