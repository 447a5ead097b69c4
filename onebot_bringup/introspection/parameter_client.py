"""A client of the parameter services that every node has."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from onebot_bringup.introspection.parameter_values import NOT_SET, is_finite, parse_value
from onebot_description.errors import OneBotError, did_you_mean

_REPEAT = 1.0  # s without a response after which a request is sent again
_ATTEMPTS = 5
_ANSWER = _REPEAT * _ATTEMPTS  # s for a service to be discovered, and again for its response


class SpinningNode(Protocol):
    """A node with a way to wait while its callbacks run."""

    @property
    def node(self) -> Any:
        """An object with rclpy's create_client and destroy_client."""

    def spin(self, until: Callable[[], Any], timeout: float) -> Any:
        """Wait until ``until()`` is true, or for ``timeout`` seconds; return its value."""


class ParameterClient:
    """Calls the parameter services of one node.

    All methods raise an OneBotError if the node does not answer.
    """

    def __init__(self, session: SpinningNode, node: str) -> None:
        self._session, self._node = session, node

    def _call(self, service: str, **fields: Any) -> Any:
        """Call a service, such as "list" for list_parameters, and return its response."""
        from rcl_interfaces import srv

        kind = getattr(srv, f"{service.capitalize()}Parameters")
        client = self._session.node.create_client(kind, f"{self._node}/{service}_parameters")
        try:
            return self._response(client, kind.Request(**fields))
        finally:
            self._session.node.destroy_client(client)

    def _response(self, client: Any, request: Any) -> Any:
        """Send a request repeatedly until there is a response.

        A server drops its response if it has not discovered the client yet, which may happen on a
        busy machine. All these requests can safely be repeated.
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

    def names(self) -> list[str]:
        """Return the names of all parameters."""
        return list(self._call("list").result.names)

    def values(self, names: Sequence[str]) -> list[Any]:
        """Return a ParameterValue for each name; its type is NOT_SET if there is no value."""
        from rcl_interfaces.msg import ParameterValue

        values = list(self._call("get", names=list(names)).values)
        if len(values) == len(names):
            return values
        # rclpy and rclcpp return no value at all when one parameter of the request has none.
        if len(names) == 1:
            return [ParameterValue()]
        return [value for name in names for value in self.values([name])]

    def describe(self, names: Sequence[str]) -> list[Any]:
        """Return a ParameterDescriptor for each name; all have to exist."""
        return list(self._call("describe", names=list(names)).descriptors)

    def get(self, name: str) -> Any:
        """Return one ParameterValue.

        Raises:
            OneBotError: there is no such parameter; lists similar names.
        """
        [value] = self.values([name])
        if value.type == NOT_SET and name not in (names := self.names()):
            hint = did_you_mean(name, names, "parameters")
            raise OneBotError(f'{self._node} has no parameter "{name}"{hint}')
        return value

    def set(
        self, pairs: Sequence[tuple[str, str]], *, same_types: bool = False, finite: bool = False
    ) -> list[Any]:
        """Set parameters.

        Args:
            pairs: names, and values in YAML.
            same_types: parse a value as the parameter's current type, if possible, even if the node
                allows another type.
            finite: reject infinities and NaN.

        Returns:
            A SetParametersResult for each parameter.
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
                    f'{name} is a finite number, not "{text}"; --allow-non-finite accepts it'
                )
            request.append(Parameter(name=name, value=ParameterValue(type=kind, **{field: value})))
        return list(self._call("set", parameters=request).results)

    def _declared(self, name: str) -> int:
        """Return a parameter's type if it is statically typed; else, or if undeclared, NOT_SET."""
        for descriptor in self.describe([name]):
            if not descriptor.dynamic_typing:
                return int(descriptor.type)
        return NOT_SET
