"""The parameters of another node, by its services."""

from collections.abc import Sequence
from typing import Any

from onebot_bringup.cli.ros_session import Session
from onebot_bringup.cli.service_calls import call
from onebot_bringup.introspection.parameters import NOT_SET, parse_value
from onebot_description.errors import OneBotError
from onebot_description.text import did_you_mean


class ParameterClient:
    """Asks one node about its parameters.

    All methods raise an OneBotError if the node does not answer.
    """

    def __init__(self, session: Session, node: str) -> None:
        """Take the full name of a node that is up."""
        self._session, self._node = session, node

    def _call(self, service: str, **fields: Any) -> Any:
        from rcl_interfaces import srv

        kind = getattr(srv, service)
        name = {
            "ListParameters": "list_parameters",
            "GetParameters": "get_parameters",
            "DescribeParameters": "describe_parameters",
            "SetParameters": "set_parameters",
        }[service]
        return call(self._session, kind, f"{self._node}/{name}", kind.Request(**fields), 5.0)

    def names(self, prefixes: Sequence[str] = ()) -> list[str]:
        """Return the names of all parameters, or of those below the prefixes."""
        return list(self._call("ListParameters", prefixes=list(prefixes)).result.names)

    def values(self, names: Sequence[str]) -> list[Any]:
        """Return a ParameterValue for each name, if all exist."""
        return list(self._call("GetParameters", names=list(names)).values)

    def describe(self, names: Sequence[str]) -> list[Any]:
        """Return a ParameterDescriptor for each name, if all exist."""
        return list(self._call("DescribeParameters", names=list(names)).descriptors)

    def get(self, name: str) -> Any:
        """Return one ParameterValue.

        Raises:
            OneBotError: there is no such parameter; the message lists near names.
        """
        values = self.values([name])
        known = self.names() if not values or values[0].type == NOT_SET else [name]
        if not values or name not in known:
            raise OneBotError(
                f'{self._node} has no parameter "{name}"{did_you_mean(name, known, "parameters")}'
            )
        return values[0]

    def set(self, pairs: Sequence[tuple[str, str]]) -> list[Any]:
        """Set parameters to what was written; return a SetParametersResult each."""
        from rcl_interfaces.msg import Parameter, ParameterValue

        request = []
        for name, text in pairs:
            field, kind, value = parse_value(text, self._declared(name))
            request.append(Parameter(name=name, value=ParameterValue(type=kind, **{field: value})))
        return list(self._call("SetParameters", parameters=request).results)

    def _declared(self, name: str) -> int:
        """The type a parameter is bound to; NOT_SET if it is free, or there is none."""
        found = self.describe([name])
        return int(found[0].type) if found and not found[0].dynamic_typing else NOT_SET
