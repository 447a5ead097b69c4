"""The services of simulation_interfaces, to step, pause and reset the simulation."""

from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from onebot_control.nodes.spinning import NodeThread
from onebot_control.runtime.control_loop import ControlLoop
from onebot_description.errors import OneBotError
from onebot_description.ros.wire.interfaces import load_interface


class SimulationServices:
    """The node ``simulation`` of a world, with its services, in its own thread.

    In this thread, a step can wait for commands, which the robots' nodes receive meanwhile.
    """

    def __init__(
        self,
        beside: Node,
        loop: ControlLoop,
        restart: Callable[[], None],
        failed: Callable[[BaseException], None],
    ) -> None:
        """Offer the services.

        Args:
            beside: a robot's node; with a single robot, the new node is in the same namespace,
                otherwise in "/".
            loop: the control loop of the world.
            restart: resets the world to the start; called in the control thread.
            failed: called with the error that ends the thread.
        """
        self._loop, self._restart = loop, restart
        self._reset_paused = False  # whether the last pause was a reset: state STOPPED
        self._node = Node(
            "simulation",
            context=beside.context,
            namespace=beside.get_namespace() if len(loop.fleet.robots) == 1 else "/",
            use_global_arguments=False,
            start_parameter_services=False,
        )
        self._result, self._states, self._features = (
            load_interface(f"simulation_interfaces/msg/{kind}")
            for kind in ("Result", "SimulationState", "SimulatorFeatures")
        )
        for name, kind, answer in (
            ("step_simulation", "StepSimulation", self._step),
            ("reset_simulation", "ResetSimulation", self._reset),
            ("set_simulation_state", "SetSimulationState", self._set_state),
            ("get_simulation_state", "GetSimulationState", self._get_state),
            ("get_simulator_features", "GetSimulatorFeatures", self._get_features),
        ):
            service = load_interface(f"simulation_interfaces/srv/{kind}")
            self._node.create_service(service, name, answer)
        self._thread = NodeThread([self._node], "services", failed)

    def stop(self) -> None:
        """End the thread."""
        self._thread.stop()

    def _do(self, answer: Any, action: Callable[[], object]) -> Any:
        """Run ``action`` in the control thread; return the answer with its result."""
        answer.result.result = self._result.RESULT_OK
        try:
            self._loop.call(action)
        except OneBotError as error:
            return self._failed(answer, self._result.RESULT_OPERATION_FAILED, str(error))
        return answer

    def _failed(self, answer: Any, code: int, text: str) -> Any:
        answer.result.result, answer.result.error_message = code, text
        return answer

    def _step(self, request: Any, answer: Any) -> Any:
        return self._do(answer, lambda: self._loop.step(request.steps))

    def _reset(self, request: Any, answer: Any) -> Any:
        state, time = request.SCOPE_STATE, request.SCOPE_TIME
        scope = (request.scope or request.SCOPE_ALL) & ~request.SCOPE_SPAWNED
        if scope == state:
            return self._do(answer, self._loop.fleet.reset)
        if scope in (state | time, request.SCOPE_ALL & ~request.SCOPE_SPAWNED):
            return self._do(answer, self._restart)
        text = f"scope {request.scope} is not supported: only the state is reset, or all with time"
        return self._failed(answer, self._result.RESULT_FEATURE_UNSUPPORTED, text)

    def _get_state(self, _: Any, answer: Any) -> Any:
        answer.state.state = self._state
        answer.result.result = self._result.RESULT_OK
        return answer

    @property
    def _state(self) -> int:
        states = self._states
        if not self._loop.paused:
            return int(states.STATE_PLAYING)
        at_start = self._reset_paused and not self._loop.fleet.ticks
        return int(states.STATE_STOPPED if at_start else states.STATE_PAUSED)

    def _set_state(self, request: Any, answer: Any) -> Any:
        target, states = request.state.state, self._states
        if target not in (states.STATE_STOPPED, states.STATE_PLAYING, states.STATE_PAUSED):
            text = f"state {target} is not supported; write 0 (stopped), 1 (playing) or 2 (paused)"
            return self._failed(answer, self._result.RESULT_FEATURE_UNSUPPORTED, text)
        if target == self._state:
            return self._failed(
                answer, answer.ALREADY_IN_TARGET_STATE, "it is already in this state"
            )
        stopped = target == states.STATE_STOPPED

        def change() -> None:
            if stopped:
                self._restart()  # first, as it may fail
            self._loop.pause(target != states.STATE_PLAYING)

        self._do(answer, change)
        self._reset_paused = stopped and answer.result.result == self._result.RESULT_OK
        return answer

    def _get_features(self, _: Any, answer: Any) -> Any:
        kind = self._features
        features = [
            kind.SIMULATION_RESET,
            kind.SIMULATION_RESET_STATE,
            kind.SIMULATION_STATE_GETTING,
            kind.SIMULATION_STATE_SETTING,
            kind.SIMULATION_STATE_PAUSE,
            kind.STEP_SIMULATION_SINGLE,
            kind.STEP_SIMULATION_MULTIPLE,
        ]
        if self._loop.simulated:
            features.insert(1, kind.SIMULATION_RESET_TIME)
        answer.features.features = features
        answer.features.custom_info = "onebot_control: PyBullet"
        return answer
