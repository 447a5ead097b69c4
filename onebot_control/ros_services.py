"""velocity_controller's services: back to the start, and the passing of simulated time."""

from collections.abc import Callable

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from onebot_control.control_loop import ControlLoop
from onebot_control.frames import PlanarPose
from onebot_description.errors import OneBotError


class Services:
    """~/reset, ~/reset_odometry, ~/pause and ~/step."""

    def __init__(self, node: Node, robot: Callable[[], ControlLoop | None]) -> None:
        """Offer them.

        Args:
            node: of which the services are.
            robot: returns the loop that drives the robot, None as long as there is no robot.
        """
        self._robot = robot
        node.create_service(Trigger, "~/reset", self._on_reset)
        node.create_service(Trigger, "~/reset_odometry", self._on_reset_odometry)
        node.create_service(SetBool, "~/pause", self._on_pause)
        node.create_service(Trigger, "~/step", self._on_step)

    def _on_reset(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        return self._answer(answer, lambda loop: loop.drive.reset())

    def _on_reset_odometry(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        return self._answer(answer, lambda loop: loop.drive.place_odometry(PlanarPose()))

    def _on_pause(self, request: SetBool.Request, answer: SetBool.Response) -> SetBool.Response:
        return self._answer(answer, lambda loop: setattr(loop, "paused", request.data))

    def _on_step(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        return self._answer(answer, lambda loop: loop.step())

    def _answer(
        self,
        answer: Trigger.Response | SetBool.Response,
        action: Callable[[ControlLoop], object],
    ) -> Trigger.Response | SetBool.Response:
        loop = self._robot()
        try:
            if loop is None:
                raise OneBotError("there is no robot yet")
            loop.call(lambda: action(loop))
            answer.success = True
        except OneBotError as error:
            answer.success, answer.message = False, str(error)
        return answer
