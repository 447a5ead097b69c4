"""The names of a robot's frames, which must be unique in its world."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from onebot_control.conventions import prefixed
from onebot_control.simulation_parameters import SimulationConfig
from onebot_description.description import Description
from onebot_description.parameters.reader import ConfigError, Problem


class RobotFrames(NamedTuple):
    """The names of a robot's frames, with prefix."""

    world: str  # frame of true poses; "" if there is none
    odom: str  # parent of the odometry's transform; "" without odometry
    base: str  # child of the odometry's transform, or root link
    links: frozenset[str]

    @classmethod
    def from_parameters(
        cls,
        config: SimulationConfig,
        description: Description,
        namespace: str,
        *,
        in_scene: bool,
    ) -> "RobotFrames":
        """Return the frames of a robot.

        A robot with a fixed base has no odometry, and its root link may be the world frame.

        Args:
            config: its parameters.
            description: the robot.
            namespace: namespace of its node.
            in_scene: whether there is a scene around it.
        """

        def name(frame: str) -> str:
            prefix = config.tf_frame_prefix
            return prefixed(frame, config.tf_frame_prefix_enable, prefix, namespace)

        world = config.world_frame(in_scene=in_scene)
        root, links = name(description.root_link), frozenset(map(name, description.link_names))
        if config.drive is None:
            return cls(world, "", "" if root == world else root, links - {world})
        base = name(config.drive.base_frame_id or description.root_link)
        return cls(world, name(config.drive.odom_frame_id), base, links)

    def problems(
        self, others: Mapping[str, "RobotFrames"], scene: Description | None = None
    ) -> Iterator[Problem]:
        """Report names that two frames share, because in TF each frame has one parent.

        The root link of a scene may be the world frame itself.

        Args:
            others: frames of the other robots, by node.
            scene: the scene around the robots.
        """
        owners = dict.fromkeys(self.links - {self.base}, "a link of the robot")
        for name, frames in others.items():
            owners[frames.odom] = f"odom_frame_id of {name}"
            owners[frames.base] = f"base_frame_id of {name}"
        for link in scene.links if scene else ():
            if link.name in self.links:
                text = f'{link.where}: link "{link.name}": a frame of the robot has this name'
                yield Problem("", f"{text}; rename the link")
            elif not (scene and link.name == scene.root_link == self.world):
                owners.setdefault(link.name, f"a link of the world, {link.where}")
        for key, frame in (
            ("base_frame_id", self.base),
            ("odom_frame_id", self.odom),
            ("world_frame_id", self.world),
        ):
            if frame and frame in owners:
                text = f'"{frame}" is {owners[frame]}; each frame needs a unique name'
                yield Problem(key, text)
            owners.setdefault(frame, key)


def check_frames(
    frames: RobotFrames,
    present: RobotFrames,
    others: Mapping[str, RobotFrames],
    scene: Description | None,
) -> None:
    """Check new frames of a robot.

    Args:
        frames: its frames with other parameters or another description.
        present: its current frames.
        others: frames of the other robots, by node.
        scene: the scene around the robots.

    Raises:
        ConfigError: two frames share a name, or the frame of the scene would change.
    """
    problems = [*frames.problems(others, scene)]
    if scene is not None and frames.world != present.world:
        # The frames of the scene are published once.
        text = f'the frames of the world are in "{present.world}"; restart the node to change it'
        problems.append(Problem("world_frame_id", text))
    if problems:
        raise ConfigError(problems)
