"""Chooses the next command by trying many: model predictive path integral control (MPPI).

Sequences of commands around the last best one, and some of a fixed kind (turn, then drive; back;
stop), are rolled out with the robot's acceleration limits and its footprint, and priced by how near
they come to obstacles and by the cost to go at their ends; the command is their mean, weighted by
exponentials of the prices (Williams, Drews, Goldfain, Rehg and Theodorou, "Aggressive driving with
model predictive path integral control", ICRA 2016). A command is sent only if the robot, once it
has obeyed it for a while, could still brake without touching anything.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_control.navigation.footprint import Vehicle
from onebot_description.arrays import Floats, Singles
from onebot_description.geometry.poses import PlanarPose, Triple

_BLOCK = 6  # steps for which the noise of a sequence stays
_SPREAD = 0.3, 0.3, 0.35  # its standard deviation, of the limits of speed
_FINE = 0.2  # share of it that a third of the sequences has, for narrow places
_BATCHES = 8  # sets of noise, which take turns
_TURNS = 16  # directions to turn to, and then to drive
_SOFT = 0.05  # m in which the price of being near falls to 1/e
_LEAST = 0.005  # m, clearance that is kept from obstacles
_PER_SPEED = 0.04  # m of further clearance for each m/s of speed
_FAST = 10.0  # price of being faster than that
_CREEP = np.float32(0.1)  # m/s, which is slow enough anywhere
_HIT = 60.0  # price of touching something
_HEADING = 0.8  # price of an end that does not point down the field
_AHEAD = 0.35  # m ahead of the end where the field is looked up, too
_TEMPERATURE = 0.15
_TRIED = 12  # best sequences from which the first safe one is taken
_NARROW = 0.2  # m of clearance below which the way itself is tried, too
_PURSUED = (0.08, 0.15, 0.3)  # m/s, speeds at which it is
_LOOKED = (3, 5, 8)  # cells ahead on it that are pursued
_RANGE = 2.9  # m that the prices were chosen for


class Surroundings(NamedTuple):
    """What is around the robot: the map's distances and costs to go."""

    distances: Singles  # (2 rows, 2 columns), from the middles of quarters of cells, m
    field: Floats  # (rows, columns), cost to go
    most: float  # maximum cost to go; also that of unknown places
    origin: tuple[float, float]  # lower left corner of the first cell, m
    resolution: float  # edge of a cell, m
    path: Floats = np.zeros((0, 2))  # first points of the way, one for each cell, m

    def nearest(self, x: Singles, y: Singles) -> Singles:
        """Return the distance to the nearest obstacle at points."""
        scale = np.float32(2.0 / self.resolution)
        column = (x - np.float32(self.origin[0])) * scale
        row = ((y - np.float32(self.origin[1])) * scale).astype(np.int32)
        row *= self.distances.shape[1]
        row += column.astype(np.int32)
        # What lies outside of the map is not known, whatever is found for it.
        return np.asarray(self.distances.take(row, mode="clip"))

    def to_go(self, x: Singles, y: Singles) -> Singles:
        """Return the cost to go at points, interpolated between the middles of cells."""
        rows, columns = self.field.shape
        column = ((x - self.origin[0]) / self.resolution - 0.5).clip(0.0, columns - 1.001)
        row = ((y - self.origin[1]) / self.resolution - 0.5).clip(0.0, rows - 1.001)
        left, low = column.astype(np.int32), row.astype(np.int32)
        right, up = column - left, row - low
        corners = np.minimum(
            [self.field[low + a, left + b] for a, b in ((0, 0), (0, 1), (1, 0), (1, 1))], self.most
        )
        below = corners[0] * (1 - right) + corners[1] * right
        above = corners[2] * (1 - right) + corners[3] * right
        return np.asarray(below * (1 - up) + above * up, np.float32)


class _Paths(NamedTuple):
    """Roll-outs, (steps, sequences)."""

    speeds: Singles  # (steps, 3, sequences), forward, to the left, turning
    x: Singles
    y: Singles
    yaw: Singles


class Follower:
    """Follows a field of costs to go with one robot."""

    def __init__(
        self, vehicle: Vehicle, period: float = 0.05, *, samples: int = 400, steps: int = 24
    ) -> None:
        """Prepare the sequences.

        Args:
            vehicle: the robot.
            period: time between commands, s.
            samples: random sequences.
            steps: steps of a sequence.
        """
        self.vehicle, self._period, self._steps = vehicle, period, steps
        horizon = min(max(1.44, vehicle.forward / vehicle.acceleration + 0.4), 3.0)
        self._dt = horizon / steps
        self._scale = max(0.3, vehicle.forward * horizon / _RANGE)
        centers, radii = vehicle.circles()
        self._circles = np.concatenate((centers, radii[:, None]), axis=1).astype(np.float32)
        self._low = np.array([-vehicle.backward, -vehicle.sideways, -vehicle.turning], np.float32)
        self._high = np.array([vehicle.forward, vehicle.sideways, vehicle.turning], np.float32)
        self._rates = np.array(
            [vehicle.acceleration, vehicle.acceleration, vehicle.turning_acceleration], np.float32
        )
        generator = np.random.default_rng(0)
        blocks = math.ceil(steps / _BLOCK)
        noise = generator.standard_normal((_BATCHES, blocks, 3, samples), np.float32)
        noise *= (self._high * np.array(_SPREAD, np.float32))[:, None]
        self._noise = np.repeat(noise, _BLOCK, axis=1)[:, :steps]
        self._noise[..., 0] = 0.0
        self._noise[..., 1::3] *= np.float32(_FINE)
        self._primitives = np.ascontiguousarray(self._fixed().transpose(1, 2, 0))
        self.reset()

    def reset(self) -> None:
        """Begin anew, from standing."""
        self._plan = np.zeros((self._steps, 3, 1), np.float32)
        self._turn = 0

    def _fixed(self) -> Singles:
        """Return the sequences of a fixed kind, (N, steps, 3)."""
        vehicle, steps = self.vehicle, self._steps
        times = np.arange(steps) * self._dt
        rows = [np.zeros((1, steps, 3))]
        if not vehicle.least_radius:
            # Turn by an angle as fast as the acceleration allows, then drive on.
            for angle in np.linspace(-math.pi, math.pi, _TURNS + 1):
                top = min(vehicle.turning, math.sqrt(abs(angle) * vehicle.turning_acceleration))
                until = abs(angle) / top if top else 0.0
                for speed in (0.0, 0.5, 1.0):
                    row = np.zeros((1, steps, 3))
                    row[0, :, 2] = np.where(times < until, math.copysign(top, angle), 0.0)
                    row[0, times >= until, 0] = speed * vehicle.forward
                    rows.append(row)
        for speed in (-vehicle.backward, 0.15 * vehicle.forward, 0.4 * vehicle.forward):
            curve = min(vehicle.turning, 2.0 * abs(speed) / max(self._scale, 0.1))
            for share in (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0):
                row = np.zeros((1, steps, 3))
                row[0, :, 0], row[0, :, 2] = speed, share * curve
                rows.append(row)
        if vehicle.sideways:
            for angle in np.linspace(0.0, math.tau, 12, endpoint=False):
                row = np.zeros((1, steps, 3))
                row[0, :, 0] = vehicle.forward * math.cos(angle)
                row[0, :, 1] = vehicle.sideways * math.sin(angle)
                rows.append(row)
        return np.concatenate(rows).astype(np.float32)

    def _pursuits(self, path: Floats, pose: PlanarPose) -> Singles:
        """Return sequences that pursue points of the way ahead, slowly: through narrow places."""
        kernel = np.ones(min(5, len(path)))
        weights = np.convolve(np.ones(len(path)), kernel, "same")
        smooth = np.stack([np.convolve(part, kernel, "same") / weights for part in path.T], axis=1)
        speeds, ahead = (part.ravel() for part in np.meshgrid(_PURSUED, _LOOKED))
        speeds = np.minimum(speeds, self.vehicle.forward)
        poses = np.repeat(np.array([pose]).T, len(speeds), axis=1)
        commands = np.zeros((self._steps, 3, len(speeds)), np.float32)
        for step in range(self._steps):
            offsets = smooth[:, :, None] - poses[:2]
            nearest = np.square(offsets).sum(axis=1).argmin(axis=0)
            target = smooth[np.minimum(nearest + ahead, len(path) - 1)].T - poses[:2]
            bearing = np.arctan2(target[1], target[0]) - poses[2]
            bearing = (bearing + math.pi) % math.tau - math.pi
            forward = speeds * np.square(np.maximum(np.cos(bearing), 0.0))
            turning = np.clip(2.0 * bearing, -self.vehicle.turning, self.vehicle.turning)
            commands[step, 0], commands[step, 2] = forward, turning
            heading = poses[2] + turning * self._dt / 2.0
            poses[0] += forward * np.cos(heading) * self._dt
            poses[1] += forward * np.sin(heading) * self._dt
            poses[2] += turning * self._dt
        return commands

    def _roll_out(self, commands: Singles, pose: PlanarPose, speed: Triple) -> _Paths:
        """Return where sequences of commands, (steps, 3, N), lead to."""
        dt = np.float32(self._dt)
        most = (self._rates * dt)[:, None]
        speeds = np.empty_like(commands)
        now = np.empty_like(commands[0])
        now[:] = np.array(speed, np.float32)[:, None]
        for step, command in enumerate(commands):
            change = command - now
            np.minimum(change, most, out=change)
            np.maximum(change, -most, out=change)
            now += change
            if self.vehicle.least_radius:
                curve = np.abs(now[0]) / np.float32(self.vehicle.least_radius)
                np.maximum(np.minimum(now[2], curve), -curve, out=now[2])
            speeds[step] = now
        moves = speeds * dt
        turns = moves[:, 2]
        yaw = np.cumsum(turns, axis=0)
        yaw += np.float32(pose.yaw)
        middle = yaw - turns * np.float32(0.5)
        cos, sin = np.cos(middle), np.sin(middle)
        x, y = moves[:, 0] * cos, moves[:, 0] * sin
        if self.vehicle.sideways:
            x -= moves[:, 1] * sin
            y += moves[:, 1] * cos
        x, y = np.cumsum(x, axis=0), np.cumsum(y, axis=0)
        x += np.float32(pose.x)
        y += np.float32(pose.y)
        return _Paths(speeds, x, y, yaw)

    def _clearance(self, around: Surroundings, x: Singles, y: Singles, yaw: Singles) -> Singles:
        """Return how far the footprint is from obstacles at poses, m; negative: it touches one."""
        cos, sin = np.cos(yaw), np.sin(yaw)
        least = np.full(x.shape, np.inf, np.float32)
        for ahead, left, radius in self._circles:
            away = around.nearest(x + ahead * cos - left * sin, y + ahead * sin + left * cos)
            away -= radius
            np.minimum(least, away, out=least)
        return least

    def clearance(self, around: Surroundings, pose: PlanarPose) -> float:
        """Return how far the robot is from obstacles at a pose, m; negative: it touches one."""
        x, y, yaw = (np.array([value], np.float32) for value in pose)
        return float(self._clearance(around, x, y, yaw)[0])

    def command(
        self,
        around: Surroundings,
        pose: PlanarPose,
        speed: Triple,
        goal: tuple[float, float],
        *,
        limit: float = math.inf,
    ) -> tuple[Triple, bool]:
        """Return the next command, and whether there is a way on.

        Args:
            around: what is around the robot.
            pose: the robot's pose in the map.
            speed: its velocity forward, to the left, m/s, and turning, rad/s.
            goal: where the field ends, m.
            limit: maximum speed, m/s.
        """
        noise = self._noise[self._turn % _BATCHES]
        self._turn += 1
        high, low = self._high.copy(), self._low.copy()
        high[:2], low[:2] = np.minimum(high[:2], limit), np.maximum(low[:2], -limit)
        now = self.clearance(around, pose)
        parts = [self._plan + noise, self._primitives]
        if now < _NARROW and len(around.path) > 1:
            parts.append(self._pursuits(around.path, pose))
        commands = np.concatenate(parts, axis=2)
        np.minimum(commands, high[:, None], out=commands)
        np.maximum(commands, low[:, None], out=commands)
        paths = self._roll_out(commands, pose, speed)
        prices, touching = self._prices(around, paths, now, goal)
        weights = np.exp((prices.min() - prices) / np.float32(_TEMPERATURE * self._scale))
        weights /= weights.sum()
        mean = commands @ weights
        best = np.argsort(prices, kind="stable")[:_TRIED]
        tried = np.concatenate((mean[..., None], commands[..., best]), axis=2)
        safe = self._safe(around, tried, pose, speed, now)
        if touching[best[0]] or not safe.any():
            self._plan[:] = 0.0
            return (0.0, 0.0, 0.0), False
        chosen = tried[..., [int(safe.argmax())]]
        share = np.float32(min(1.0, self._period / self._dt))
        shifted = np.concatenate((chosen[1:], chosen[-1:]))
        self._plan = chosen + share * (shifted - chosen)
        forward, left, turning = chosen[0, :, 0].tolist()
        return (forward, left, turning), True

    def _prices(
        self, around: Surroundings, paths: _Paths, now: float, goal: tuple[float, float]
    ) -> tuple[Singles, NDArray[np.bool_]]:
        """Return the price of each path, and whether it touches something.

        Args:
            around: what is around the robot.
            paths: the paths.
            now: how far the robot is from obstacles, m.
            goal: where the field ends, m.
        """
        dt, scale = np.float32(self._dt), np.float32(self._scale)
        clearance = self._clearance(around, paths.x, paths.y, paths.yaw)
        touching = clearance < min(_LEAST, now - 0.01)
        near = np.float32(self.vehicle.half_width * 0.5)
        away = np.square(paths.x - np.float32(goal[0])) + np.square(paths.y - np.float32(goal[1]))
        arrived = np.logical_or.accumulate(away < near * near, axis=0)
        hit = np.logical_or.accumulate(touching & ~arrived, axis=0)
        speeds = np.abs(paths.speeds[:, 0]) + np.abs(paths.speeds[:, 1])
        prices = np.exp(np.maximum(clearance, 0.0) * np.float32(-1.0 / _SOFT))
        prices *= np.float32(0.3) + speeds * np.float32(3.0 / scale)
        fast = clearance < np.float32(_LEAST) + speeds * np.float32(_PER_SPEED)
        prices += fast * np.maximum(speeds - _CREEP, 0.0) * np.float32(_FAST / scale)
        prices += np.float32(0.15)
        prices[arrived] = 0.0
        total = prices.sum(axis=0) * (dt * scale)
        later = np.arange(self._steps, 0, -1, dtype=np.float32) / np.float32(self._steps)
        total += (later @ hit) * (np.float32(20.0) * dt) + hit[-1] * np.float32(_HIT)
        x, y, yaw = paths.x[-1], paths.y[-1], paths.yaw[-1]
        ends = around.to_go(x, y)
        ahead = np.float32(_AHEAD * min(1.0, self._scale))
        costs = around.to_go(x + ahead * np.cos(yaw), y + ahead * np.sin(yaw))
        if not self.vehicle.sideways:
            ends = ends + np.float32(_HEADING) * np.minimum(costs - ends, np.float32(2.0))
        total += ~arrived[-1] * ends
        total += np.abs(paths.speeds[:, 2]).mean(axis=0) * (np.float32(0.02) * scale)
        total += (paths.speeds[-1, 0] < 0.0) * (np.float32(0.3) * scale)
        return total, hit[-1]

    def _safe(
        self,
        around: Surroundings,
        commands: Singles,
        pose: PlanarPose,
        speed: Triple,
        now: float,
        least: float = _LEAST,
    ) -> NDArray[np.bool_]:
        """Return which sequences can be begun, and the robot could still brake then."""
        first = math.ceil(2.0 * self._period / self._dt)
        braking = np.zeros_like(commands)
        braking[:first] = commands[:first]
        paths = self._roll_out(braking, pose, speed)
        clearance = self._clearance(around, paths.x, paths.y, paths.yaw)
        return np.asarray((clearance >= min(least, now - 0.002)).all(axis=0))

    def is_safe(
        self, around: Surroundings, command: Triple, pose: PlanarPose, speed: Triple
    ) -> bool:
        """Return whether the robot could still brake after it has obeyed a command for a while.

        It keeps more clearance than on its way, as nothing makes it go there.
        """
        sequence = np.empty((self._steps, 3, 1), np.float32)
        sequence[:] = np.array(command, np.float32)[:, None]
        now = self.clearance(around, pose)
        return bool(self._safe(around, sequence, pose, speed, now, 3.0 * _LEAST)[0])
