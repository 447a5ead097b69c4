"""A client of the parameter services that every node has."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from onebot_bringup.introspection.parameter_values import NOT_SET, is_finite, parse_value
from onebot_description.errors import OneBotError, did_you_mean

_REPEAT = 1.0  # s without a response until a request is sent again
_ATTEMPTS = 5
_ANSWER = _REPEAT * _ATTEMPTS  # s for a service to be discovered, and again for its response


class SpinningNode(Protocol):
    """A node, and how to wait for what it receives."""

    @property
    def node(self) -> Any:
        """Has rclpy's create_client and destroy_client."""

    def spin(self, until: Callable[[], Any], timeout: float) -> Any:
        """Wait until ``until()`` is true, or for ``timeout`` seconds; return its value."""


class ParameterClient:
    """Calls the parameter services of one node.

    All methods raise an OneBotError if the node does not answer.
    """

    def __init__(self, session: SpinningNode, node: str) -> None:
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
        client = self._session.node.create_client(kind, f"{self._node}/{name}")
        try:
            return self._response(client, kind.Request(**fields))
        finally:
            self._session.node.destroy_client(client)

    def _response(self, client: Any, request: Any) -> Any:
        """Send a request until there is a response.

        A server drops its response if it has not discovered the client yet, as it may when the
        machine is busy. All these requests may be repeated.
        """
        session, name = self._session, client.srv_name
        if not session.spin(client.service_is_ready, _ANSWER):
            raise OneBotError(f"the service {name} is not available")
        futures = []
        for _ in range(_ATTEMPTS):
            futures.append(client.call_async(request))
            if answered := session.spin(lambda: [f for f in futures if f.done()], _REPEAT):
                return answered[0].result()
        raise OneBotError(f"the service {name} does not answer (waited {_ANSWER:g} s)")

    def names(self, prefixes: Sequence[str] = ()) -> list[str]:
        """Return the names of all parameters, or of the parameters below the prefixes."""
        return list(self._call("ListParameters", prefixes=list(prefixes)).result.names)

    def values(self, names: Sequence[str]) -> list[Any]:
        """Return a ParameterValue for each name; its type is NOT_SET where there is no value."""
        from rcl_interfaces.msg import ParameterValue

        values = list(self._call("GetParameters", names=list(names)).values)
        if len(values) == len(names):
            return values
        # rclpy and rclcpp return no value at all when one parameter of the request has none.
        if len(names) == 1:
            return [ParameterValue()]
        return [value for name in names for value in self.values([name])]

    def require(self, names: Sequence[str]) -> None:
        """Raise an OneBotError for the first name of no parameter; it lists similar ones."""
        parameters = self.names()
        for name in names:
            if name not in parameters:
                hint = did_you_mean(name, parameters, "parameters")
                raise OneBotError(f'{self._node} has no parameter "{name}"{hint}')

    def describe(self, names: Sequence[str]) -> list[Any]:
        """Return a ParameterDescriptor for each name, if all exist."""
        return list(self._call("DescribeParameters", names=list(names)).descriptors)

    def get(self, name: str) -> Any:
        """Return one ParameterValue; a name of none is an OneBotError, which lists similar ones."""
        [value] = self.values([name])
        if value.type == NOT_SET:
            self.require([name])
        return value

    def delete(self, name: str) -> Any:
        """Unset a parameter; return a SetParametersResult. It raises as ``get`` does."""
        from rcl_interfaces.msg import Parameter

        self.require([name])
        [result] = self._call("SetParameters", parameters=[Parameter(name=name)]).results
        return result

    def set(
        self, pairs: Sequence[tuple[str, str]], *, same_types: bool = False, finite: bool = False
    ) -> list[Any]:
        """Set parameters to values in YAML; return a SetParametersResult each.

        ``same_types`` reads a value as one of the type that the parameter has now, as far as that
        can be, also where the node allows another; ``finite`` refuses infinities and NaN.
        """
        from rcl_interfaces.msg import Parameter, ParameterValue

        request = []
        for name, text in pairs:
            declared = self._declared(name)
            if same_types and declared == NOT_SET:
                declared = self.values([name])[0].type
            field, kind, value = parse_value(text, declared)
            if finite and not is_finite(value):
                raise OneBotError(
                    f'{name} is a finite number, not "{text}"; --allow-non-finite lets it through'
                )
            request.append(Parameter(name=name, value=ParameterValue(type=kind, **{field: value})))
        return list(self._call("SetParameters", parameters=request).results)

    def _declared(self, name: str) -> int:
        """The type of a statically typed parameter; NOT_SET if it is dynamic or undeclared."""
        for descriptor in self.describe([name]):
            if not descriptor.dynamic_typing:
                return int(descriptor.type)
        return NOT_SET
