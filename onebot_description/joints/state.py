"""All that follows from joint_state_publisher's parameters and the robot's description."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from onebot_description.description import Description
from onebot_description.joints.config import JointsConfig
from onebot_description.joints.plan import Plan
from onebot_description.joints.problems import ConfigError
from onebot_description.joints.source import JointStateSource


@dataclass(frozen=True)
class JointsState:
    """Replaced as a whole, so that a refusal changes nothing.

    Attributes:
        values: the parameters, by name.
        config: the same, checked.
        description: the robot, None until it is known.
        source: moves the robot's joints, None until then.
        plan: what ``source`` is still to be told, None for nothing.
    """

    values: Mapping[str, Any]
    config: JointsConfig
    description: Description | None = None
    source: JointStateSource | None = None
    plan: Plan | None = None

    def describing(self, description: Description) -> "JointsState":
        """Return the state with another robot, whose joints go on from where they are.

        Raises:
            ConfigError: the parameters do not suit it.
        """
        source = JointStateSource.from_description(description, self.config, previous=self.source)
        return replace(self, description=description, source=source, plan=None)

    def with_parameters(
        self,
        values: Mapping[str, Any],
        config: JointsConfig,
        new: Description | None = None,
        waiting: Description | None = None,
    ) -> "JointsState":
        """Return the state with other parameters; this one stays as it is.

        Args:
            values: the parameters.
            config: the same, checked.
            new: the robot they describe, if it is another one.
            waiting: a robot that the parameters so far did not suit: taken up if these do.

        Raises:
            ConfigError: the parameters do not suit the robot.
        """
        changed = replace(self, values=values, config=config)
        if new is not None:
            return changed.describing(new)
        if waiting is not None:
            # A joint renamed in both files: the description waited for these parameters.
            with suppress(ConfigError):
                return changed.describing(waiting)
        return replace(changed, plan=self.source.prepare(config) if self.source else None)
