"""Messages as dictionaries, and classes by their names, as in the package rosidl_runtime_py.

Its ``message_to_csv``, and the functions that list interfaces, are missing.
"""

from rosidl_runtime_py.convert import get_message_slot_types as get_message_slot_types
from rosidl_runtime_py.convert import message_to_ordereddict as message_to_ordereddict
from rosidl_runtime_py.convert import message_to_yaml as message_to_yaml
from rosidl_runtime_py.import_message import (
    import_message_from_namespaced_type as import_message_from_namespaced_type,
)
from rosidl_runtime_py.set_message import set_message_fields as set_message_fields
