"""Chooses the next command by trying many: model predictive path integral control (MPPI).

Sequences of commands around the last best one, and some fixed ones (turn, then drive; back up;
stop), are rolled out with the robot's acceleration limits and footprint. Their cost depends on the
distance to obstacles and on the cost to go at their ends; the command is their mean, weighted by
exponentials of the costs (Williams, Drews, Goldfain, Rehg and Theodorou, "Aggressive driving with
model predictive path integral control", ICRA 2016). A command is sent only if the robot can still
brake without touching anything after executing it for two periods.
"""

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_control.navigation.footprint import Vehicle
from onebot_description.arrays import Floats, Singles
from onebot_description.geometry.poses import PlanarPose, Triple

_BLOCK = 0.36  # s for which the noise of a sequence is constant
_SPREAD = 0.3, 0.3, 0.35  # standard deviation of the noise, as a share of the speed limits
_FINE = 0.2  # factor of the noise for a third of the sequences, for narrow places
_BATCHES = 8  # sets of noise, used in turn
_TURNS = 16  # directions to turn to before driving
_SOFT = 0.05  # m in which the cost of proximity falls to 1/e
_MIN_CLEARANCE = 0.005  # m, minimum clearance from obstacles
_SLIGHT, _MAX_SLACK = 0.0002, 0.002  # m by which a command may reduce a smaller clearance
_PER_SPEED = 0.04  # m of additional clearance per m/s of speed
_FAST = 10.0  # cost of exceeding that speed
_FAR = 0.2  # m, clearance above which its exact value does not matter
_CREEP = 0.1  # m/s, slow enough anywhere
_HIT = 60.0  # cost of touching something
_HEADING = 0.8  # cost of an end that does not point down the field
_AHEAD = 0.35  # m ahead of the end where the field is also looked up
_TEMPERATURE = 0.15
_TRIED = 12  # number of best sequences from which the first safe one is taken
_CAREFUL, _TIGHT = 0.5, 0.06  # maximum speed, m/s, below this clearance, m
_NARROW = 0.2  # m of clearance below which sequences along the path are also tried
_PURSUED = (0.08, 0.15, 0.3)  # m/s, speeds of these sequences
_LOOKED = (3, 5, 8)  # their lookahead distances, cells
_PURSUIT = 3  # steps for which their commands are constant
_RANGE = 2.9  # m, length of the roll-outs for which the costs were tuned
_APART = 0.08  # m, maximum distance between two poses whose clearance is looked up


class Situation(NamedTuple):
    """The robot's state and its surroundings: distances to obstacles and costs to go in the map."""

    pose: PlanarPose  # the robot's pose in the map
    speed: Triple  # forward, to the left, m/s, and turning to the left, rad/s
    goal: tuple[float, float]  # goal of the field, m
    distances: Singles  # (2 rows, 2 columns), from the centers of quarter cells, m
    field: Floats  # (rows, columns), cost to go
    maximum: float  # maximum cost to go, also used for unknown places
    origin: tuple[float, float]  # lower left corner of the first cell, m
    resolution: float  # edge of a cell, m
    path: Floats  # (N, 2), first points of the path, one per cell, m

    def clearance(
        self, circles: Singles, x: Singles, y: Singles, yaw: Singles, *, exact: bool = False
    ) -> Singles:
        """Return the clearance of circles at poses, m; negative: one touches an obstacle.

        It is a lower bound above ``_FAR``, and meaningless outside of the map.

        Args:
            circles: (N, 3), center and radius in the robot's frame, m.
            x: x coordinates of the poses, in an array of any shape, m.
            y: y coordinates, m.
            yaw: headings, rad.
            exact: whether to interpolate between quarter cells; else it is off by up to one half.
        """
        distances_at = partial(_interpolated, self.distances) if exact else self._nearest
        scale = np.float32(2.0 / self.resolution)
        column = ((x - np.float32(self.origin[0])) * scale).ravel()
        row = ((y - np.float32(self.origin[1])) * scale).ravel()
        clearance = distances_at(row, column)
        clearance -= (np.hypot(circles[:, 0], circles[:, 1]) + circles[:, 2]).max()
        near = np.flatnonzero(clearance < _FAR)
        cos, sin = (part(yaw.ravel()[near]) * scale for part in (np.cos, np.sin))
        rows = circles[:, :2] @ np.stack((sin, cos)) + row[near]
        columns = circles[:, :2] @ np.stack((cos, -sin)) + column[near]
        away = distances_at(rows, columns)
        away -= circles[:, 2:]
        clearance[near] = away.min(axis=0)
        return np.asarray(clearance.reshape(x.shape))

    def _nearest(self, row: Singles, column: Singles) -> Singles:
        """Return the distances at rows and columns of quarter cells."""
        index = row.astype(np.int32)
        index *= np.int32(self.distances.shape[1])
        index += column.astype(np.int32)
        return np.asarray(self.distances.take(index, mode="wrap"))

    def to_go(self, x: Singles, y: Singles) -> Singles:
        """Return the cost to go at points, interpolated between the centers of cells."""
        scale = np.float32(1.0 / self.resolution)
        column = (x - np.float32(self.origin[0])) * scale
        row = (y - np.float32(self.origin[1])) * scale
        return _interpolated(self.field, row, column, self.maximum)


def _interpolated(
    values: Floats | Singles, row: Singles, column: Singles, maximum: float = math.inf
) -> Singles:
    """Return values, at most ``maximum``, interpolated between the centers of cells."""
    rows, columns = values.shape
    column = (column - 0.5).clip(0.0, columns - 1.001)
    row = (row - 0.5).clip(0.0, rows - 1.001)
    left, low = column.astype(np.int32), row.astype(np.int32)
    right, up = column - left, row - low
    corners = np.minimum(
        [values[low + a, left + b] for a, b in ((0, 0), (0, 1), (1, 0), (1, 1))], maximum
    )
    below = corners[0] * (1 - right) + corners[1] * right
    above = corners[2] * (1 - right) + corners[3] * right
    return np.asarray(below * (1 - up) + above * up, np.float32)


class _Paths(NamedTuple):
    """Roll-outs, (steps, sequences), at every ``_stride``-th step."""

    speeds: Singles  # (steps, 3, sequences), forward, to the left, turning
    x: Singles
    y: Singles
    yaw: Singles


class LocalPlanner:
    """Follows a field of costs to go with one robot."""

    def __init__(
        self, vehicle: Vehicle, period: float = 0.05, *, samples: int = 300, steps: int = 24
    ) -> None:
        """Prepare the sequences.

        Args:
            vehicle: the robot.
            period: time between commands, s.
            samples: random sequences.
            steps: steps of a sequence.
        """
        self.vehicle, self._period = vehicle, period
        self._horizon = min(max(1.44, vehicle.forward / vehicle.acceleration + 0.4), 3.0)
        self._dt = self._horizon / steps
        self._stride = max(1, min(3, int(_APART / (vehicle.forward * self._dt))))
        self._steps = steps = self._stride * math.ceil(steps / self._stride)
        centers, radii = vehicle.circles()
        self._circles = np.concatenate((centers, radii[:, None]), axis=1).astype(np.float32)
        limits = (
            (-vehicle.backward, vehicle.forward, vehicle.acceleration),
            (-vehicle.sideways, vehicle.sideways, vehicle.acceleration),
            (-vehicle.turning, vehicle.turning, vehicle.turning_acceleration),
        )
        self._low, self._high, self._rates = np.array(limits, np.float32).T[..., None]
        generator = np.random.default_rng(0)
        block = math.ceil(_BLOCK / self._dt)
        shape = _BATCHES, math.ceil(steps / block), 3, samples
        noise = generator.standard_normal(shape, np.float32)
        noise *= self._high * np.array(_SPREAD, np.float32)[:, None]
        self._noise = np.repeat(noise, block, axis=1)[:, :steps]
        self._noise[..., 0] = 0.0
        self._noise[..., 1::3] *= np.float32(_FINE)
        self._primitives = self._fixed()
        self.reset()

    def reset(self) -> None:
        """Restart from standstill."""
        self._plan = np.zeros((self._steps, 3, 1), np.float32)
        self._turn = 0

    def _fixed(self) -> Singles:
        """Return the fixed sequences, (steps, 3, N)."""
        vehicle, times = self.vehicle, np.arange(self._steps) * self._dt
        rows: list[tuple[Any, Any, Any]] = [(0.0, 0.0, 0.0)]
        if not vehicle.minimum_radius:
            # Turn as fast as the acceleration allows, then drive.
            for angle in np.linspace(-math.pi, math.pi, _TURNS + 1):
                top = min(vehicle.turning, math.sqrt(abs(angle) * vehicle.turning_acceleration))
                turns = times < (abs(angle) / top if top else 0.0)
                rows += [
                    (~turns * speed * vehicle.forward, 0.0, turns * math.copysign(top, angle))
                    for speed in (0.0, 0.5, 1.0)
                ]
        for speed in (-vehicle.backward, 0.15 * vehicle.forward, 0.4 * vehicle.forward):
            curve = min(vehicle.turning, 2.0 * abs(speed) / max(self._scale(), 0.1))
            rows += [(speed, 0.0, share * curve) for share in (-2, -1, -0.5, 0, 0.5, 1, 2)]
        for angle in np.linspace(0.0, math.tau, 12, endpoint=False) if vehicle.sideways else ():
            rows.append(
                (vehicle.forward * math.cos(angle), vehicle.sideways * math.sin(angle), 0.0)
            )
        sequences = [[np.broadcast_to(values, self._steps) for values in row] for row in rows]
        return np.ascontiguousarray(np.array(sequences, np.float32).T)

    def _scale(self, share: float = 1.0) -> float:
        """Return the range at a share of the maximum speed, as a factor of ``_RANGE``, >= 0.3."""
        return max(0.3, share * self.vehicle.forward * self._horizon / _RANGE)

    def _pursuits(self, now: Situation) -> Singles:
        """Return slow sequences that pursue points of the path ahead, for narrow places."""
        path, pose = now.path, now.pose
        kernel = np.ones(min(5, len(path)))
        weights = np.convolve(np.ones(len(path)), kernel, "same")
        smooth = np.convolve(path @ (1.0, 1.0j), kernel, "same") / weights
        speeds, ahead = (part.ravel() for part in np.meshgrid(_PURSUED, _LOOKED))
        speeds = np.minimum(speeds, self.vehicle.forward)
        top, last = self.vehicle.turning, len(path) - 1
        place, yaw = np.full(len(speeds), complex(pose.x, pose.y)), np.full(len(speeds), pose.yaw)
        commands = np.zeros((self._steps, 3, len(speeds)), np.float32)
        dt = _PURSUIT * self._dt
        for step in range(0, self._steps, _PURSUIT):
            nearest = np.abs(smooth[:, None] - place).argmin(axis=0)
            toward = (smooth[np.minimum(nearest + ahead, last)] - place) * np.exp(-1.0j * yaw)
            bearing = np.angle(toward)
            forward = speeds * np.square(np.maximum(np.cos(bearing), 0.0))
            turning = np.maximum(np.minimum(2.0 * bearing, top), -top)
            part = commands[step : step + _PURSUIT]
            part[:, 0], part[:, 2] = forward, turning
            turn = turning * dt
            place += forward * dt * np.exp(1.0j * (yaw + turn / 2.0))
            yaw += turn
        return commands

    def _roll_out(self, commands: Singles, now: Situation) -> _Paths:
        """Return the roll-outs of sequences of commands, (steps, 3, N)."""
        axes = slice(None, None, 1 if self.vehicle.sideways else 2)
        limit = (self._rates * np.float32(self._dt))[axes]
        speeds = np.zeros_like(commands)
        last = np.repeat(np.array(now.speed, np.float32)[axes, None], commands.shape[-1], axis=1)
        for command, reached in zip(commands[:, axes], speeds[:, axes], strict=True):
            np.subtract(command, last, out=reached)
            np.maximum(reached, -limit, out=reached)  # np.clip takes twice as long
            np.minimum(reached, limit, out=reached)
            reached += last
            if self.vehicle.minimum_radius:
                curve = np.abs(reached[0]) / np.float32(self.vehicle.minimum_radius)
                np.clip(reached[-1], -curve, curve, out=reached[-1])
            last = reached
        return self._driven(speeds, now.pose)

    def _driven(self, speeds: Singles, pose: PlanarPose) -> _Paths:
        """Return the roll-outs of velocities, (steps, 3, N), at every ``_stride``-th step."""
        if self._stride > 1:
            speeds = speeds.reshape(-1, self._stride, *speeds.shape[1:]).mean(axis=1)
        moves = speeds * np.float32(self._dt * self._stride)
        yaw = np.cumsum(moves[:, 2], axis=0)
        yaw += np.float32(pose.yaw)
        middle = yaw - moves[:, 2] * np.float32(0.5)
        cos, sin = np.cos(middle), np.sin(middle)
        x, y = moves[:, 0] * cos, moves[:, 0] * sin
        if self.vehicle.sideways:
            x -= moves[:, 1] * sin
            y += moves[:, 1] * cos
        x, y = np.cumsum(x, axis=0), np.cumsum(y, axis=0)
        x += np.float32(pose.x)
        y += np.float32(pose.y)
        return _Paths(speeds, x, y, yaw)

    def clearance(self, now: Situation) -> float:
        """Return the clearance of the robot, m; negative: it touches an obstacle."""
        x, y, yaw = (np.array([value], np.float32) for value in now.pose)
        return float(self.clearances(now, x, y, yaw)[0])

    def clearances(self, now: Situation, x: Singles, y: Singles, yaw: Singles) -> Singles:
        """Return the clearance of the robot at poses, arrays of one shape, m."""
        return now.clearance(self._circles, x, y, yaw, exact=True)

    def command(self, now: Situation) -> tuple[Triple, bool]:
        """Return the next command, and whether the robot can continue."""
        clearance = self.clearance(now)
        # In tight places, use a shorter lookahead with smaller steps.
        careful = clearance < _TIGHT and max(map(abs, now.speed[:2])) <= _CAREFUL
        share = min(1.0, _CAREFUL / self.vehicle.forward) if careful else 1.0
        commands = np.concatenate((self._noise[self._turn], self._primitives), axis=2)
        self._turn = (self._turn + 1) % _BATCHES
        commands[:, :2] *= np.float32(share)
        commands[..., : self._noise.shape[-1]] += self._plan
        if clearance < _NARROW and len(now.path) > 1:
            commands = np.concatenate((commands, self._pursuits(now)), axis=2)
        shares = np.array([[share], [share], [1.0]], np.float32)
        np.clip(commands, self._low * shares, self._high * shares, out=commands)
        paths, scale = self._roll_out(commands, now), self._scale(share)
        costs, touching = self._costs(now, paths, clearance, scale)
        weights = np.exp((costs.min() - costs) / np.float32(_TEMPERATURE * scale))
        weights /= weights.sum()
        best = np.argsort(costs, kind="stable")[:_TRIED]
        tried = np.concatenate(((commands @ weights)[..., None], commands[..., best]), axis=2)
        safe = self._safe(now, tried[0], _MIN_CLEARANCE, clearance)
        if touching[best[0]] or not safe.any():
            self._plan[:] = 0.0
            return (0.0, 0.0, 0.0), False
        chosen = tried[..., [int(safe.argmax())]]
        shift = np.float32(min(1.0, self._period / self._dt))
        self._plan = chosen + shift * (np.concatenate((chosen[1:], chosen[-1:])) - chosen)
        forward, left, turning = chosen[0, :, 0].tolist()
        return (forward, left, turning), True

    def _costs(
        self, now: Situation, paths: _Paths, start: float, scale: float
    ) -> tuple[Singles, NDArray[np.bool_]]:
        """Return the cost of each path, and whether it touches something.

        Args:
            now: the robot's state and its surroundings.
            paths: the paths.
            start: current clearance of the robot, m.
            scale: see ``_scale``.
        """
        dt = self._dt * self._stride
        clearance = now.clearance(self._circles, paths.x, paths.y, paths.yaw)
        near, goal = self.vehicle.half_width * 0.5, np.array(now.goal, np.float32)
        away = np.square(paths.x - goal[0]) + np.square(paths.y - goal[1])
        arrived = np.logical_or.accumulate(away < np.float32(near * near), axis=0)
        touches = (clearance < min(_MIN_CLEARANCE, start - 0.01)) & ~arrived
        hit = np.logical_or.accumulate(touches, axis=0)
        speeds = np.abs(paths.speeds[:, 0])
        if self.vehicle.sideways:
            speeds += np.abs(paths.speeds[:, 1])
        costs = np.exp(np.maximum(clearance, 0.0) * np.float32(-1.0 / _SOFT))
        costs *= np.float32(0.3) + speeds * np.float32(3.0 / scale)
        fast = clearance < np.float32(_MIN_CLEARANCE) + speeds * np.float32(_PER_SPEED)
        speeds -= np.float32(_CREEP)
        costs += fast * np.maximum(speeds, 0.0) * np.float32(_FAST / scale)
        costs += np.float32(0.15)
        costs *= ~arrived
        total = costs.sum(axis=0) * np.float32(dt * scale)
        later = np.linspace(1.0, 0.0, len(hit), endpoint=False, dtype=np.float32)
        total += (later @ hit) * np.float32(20.0 * dt) + hit[-1] * np.float32(_HIT)
        x, y, yaw = paths.x[-1], paths.y[-1], paths.yaw[-1]
        ends = now.to_go(x, y)
        if not self.vehicle.sideways:
            ahead = np.float32(_AHEAD * min(1.0, scale))
            there = now.to_go(x + ahead * np.cos(yaw), y + ahead * np.sin(yaw))
            ends += np.float32(_HEADING) * np.minimum(there - ends, np.float32(2.0))
        total += ~arrived[-1] * ends
        total += np.abs(paths.speeds[:, 2]).mean(axis=0) * np.float32(0.02 * scale)
        total += (paths.speeds[-1, 0] < 0.0) * np.float32(0.3 * scale)
        return total, hit[-1]

    def _safe(
        self, now: Situation, commands: Singles, minimum: float, clearance: float
    ) -> NDArray[np.bool_]:
        """Return which commands, (3, N), let the robot brake after executing them for two periods.

        The clearance must be at least ``minimum``, m, until it has stopped. A robot that is nearer
        may come slightly nearer while it moves away, but does not touch.
        """
        minimum = min(minimum, clearance - min(max(0.5 * clearance, _SLIGHT), _MAX_SLACK))
        times = np.arange(1, self._steps + 1, dtype=np.float32)[:, None, None]
        times *= np.float32(self._dt)
        obeyed = np.minimum(times, np.float32(2.0 * self._period)) * self._rates
        start = np.array(now.speed, np.float32)[:, None]
        speeds = start + np.clip(commands - start, -obeyed, obeyed)
        braked = times * self._rates - obeyed
        speeds -= np.clip(speeds, -braked, braked)
        paths = self._driven(speeds, now.pose)
        clearances = self.clearances(now, paths.x, paths.y, paths.yaw)
        return np.asarray((clearances >= minimum).all(axis=0))

    def is_safe(self, now: Situation, command: Triple, *, narrow: bool = False) -> bool:
        """Return whether the robot could still brake after executing a command for two periods.

        Unless it has to go through a narrow place, the required clearance is larger than for
        ``command``, as the robot need not move there.
        """
        commands = np.array([command], np.float32).T
        minimum = _MIN_CLEARANCE if narrow else 3.0 * _MIN_CLEARANCE
        return bool(self._safe(now, commands, minimum, self.clearance(now))[0])
