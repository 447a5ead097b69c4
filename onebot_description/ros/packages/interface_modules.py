"""Fills the modules of a package of interfaces, as in generated code.

``package.msg`` has the classes of its messages, and ``package.msg._name`` the class of one of them,
in line with its ``__module__``. A class is made when it is first used.
"""

from itertools import product
from types import ModuleType
from typing import Any

from onebot_description.ros.packages.late_attributes import provide
from onebot_description.ros.wire.interface_text import definitions, own_package
from onebot_description.ros.wire.interfaces import own_interface
from onebot_description.ros.wire.message_class import made_class, module_name

_PARTS = "Request", "Response", "Event"
_SERVICES = {
    "msg": (),
    "srv": tuple(f"_{part}" for part in _PARTS),
    "action": tuple(f"_{call}_{part}" for call, part in product(("SendGoal", "GetResult"), _PARTS)),
}
# Suffixes of classes that only the module of a single action has.
_OTHERS = "_Goal", "_Result", "_Feedback", "_FeedbackMessage", "_SendGoal", "_GetResult"


def fill(module: ModuleType) -> None:
    """Add the classes to a module ``package.kind`` or ``package.kind._name``.

    Raises:
        ModuleNotFoundError: the package has no interface of that name.
    """
    package, kind, *stem = module.__name__.split(".")
    folder = own_package(package)
    files = definitions(folder, [kind]) if folder else ()
    types = [f"{package}/{kind}/{file.stem}" for file in files]
    if stem:
        types = [name for name in types if module_name(name) == module.__name__]
    if not types:
        raise ModuleNotFoundError(f"No module named '{module.__name__}'", name=module.__name__)
    parts = ("", *_SERVICES[kind], *(_OTHERS if stem and kind == "action" else ()))
    homes = {name.rpartition("/")[2] + part: name for name in types for part in parts}

    def find(short: str) -> Any:
        own_interface(homes[short])
        return made_class(f"{package}/{kind}/{short}")

    names = sorted(homes)
    provide(module.__name__, names, find)
    module.__dict__.update(__all__=names, __dir__=lambda: names)
