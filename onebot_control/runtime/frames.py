"""The names of a robot's frames, which must be unique in its world."""

from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

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
        name = partial(config.prefixed, namespace=namespace)
        world = config.world_frame(in_scene=in_scene)
        root, links = name(description.root_link), frozenset(map(name, description.link_names))
        if config.drive is None:
            return cls(world, "", "" if root == world else root, links - {world})
        base = name(config.drive.base_frame_id or description.root_link)
        return cls(world, name(config.drive.odom_frame_id), base, links)

    def check(
        self,
        present: "RobotFrames",
        others: Mapping[str, "RobotFrames"],
        scene: Description | None = None,
    ) -> None:
        """Check new frames of a robot, whose names must be unique, as each has one parent in TF.

        The root link of a scene may be the world frame itself.

        Args:
            present: the robot's current frames.
            others: frames of the other robots, by node.
            scene: the scene around the robots.

        Raises:
            ConfigError: two frames share a name, or the frame of the scene would change.
        """
        problems, owners = list[Problem](), dict[str, str]()
        owners.update(dict.fromkeys(self.links - {self.base}, "a link of the robot"))
        for name, frames in others.items():
            owners[frames.odom] = f"odom_frame_id of {name}"
            owners[frames.base] = f"base_frame_id of {name}"
        for link in scene.links if scene else ():
            if link.name in self.links:
                text = f'{link.where}: link "{link.name}": a frame of the robot has this name'
                problems.append(Problem("", f"{text}; rename the link"))
            elif not (scene and link.name == scene.root_link == self.world):
                owners.setdefault(link.name, f"a link of the world, {link.where}")
        for key, frame in (
            ("base_frame_id", self.base),
            ("odom_frame_id", self.odom),
            ("world_frame_id", self.world),
        ):
            if frame and frame in owners:
                text = f'"{frame}" is {owners[frame]}; each frame needs a unique name'
                problems.append(Problem(key, text))
            owners.setdefault(frame, key)
        if scene is not None and self.world != present.world:
            # The frames of the scene are published once.
            text = f'the frames of the world are in "{present.world}"'
            problems.append(Problem("world_frame_id", f"{text}; restart the node to change it"))
        if problems:
            raise ConfigError(problems)
