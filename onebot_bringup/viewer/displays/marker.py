"""Markers (visualization_msgs/Marker and MarkerArray), as RViz shows them.

All markers of a namespace and type form a layer on one entity: a thousand cubes are one call into
Rerun, with arrays straight from the message. The assignment of rows to layers is cached, so that
another message with the same markers costs no work per marker.

A marker that is locked to its frame moves with that frame; any other marker lies in the fixed
frame, where its frame was at its own stamp. Markers whose lifetime is over are removed.
"""

import time
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, count, groupby
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.core.columns import below, entity_path, one_row, send
from onebot_bringup.viewer.core.drawing import Drawing, TopicSettings
from onebot_bringup.viewer.core.rerun_limits import LARGEST, is_drawable, is_old
from onebot_bringup.viewer.core.settings import name_list, setting
from onebot_bringup.viewer.core.stage import Stage
from onebot_bringup.viewer.displays.marker_shapes import (
    ARROW,
    ARROW_STRIP,
    KINDS,
    LINE_LIST,
    LINE_STRIP,
    MESH,
    TRIANGLE_LIST,
    Batch,
    MarkerContent,
    MarkerKind,
    MeshVariant,
    Piece,
    Rows,
    rgba,
)
from onebot_description.arrays import Floats
from onebot_description.errors import OneBotError, printable, shortened
from onebot_description.geometry.quaternions import (
    UNIT_TOLERANCE,
    from_matrix,
    multiply,
    normalized,
    rotate,
)
from onebot_description.timing import NS_PER_S

ADD, DELETE, DELETE_ALL = 0, 2, 3
_NEVER = np.iinfo(np.int64).max  # the end of an infinite lifetime
_NOT_DRAWN = -1  # type number of markers that are left out
_IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)  # position and quaternion
_TOGETHER_NS = 50_000_000  # single markers that arrive within this time are logged together
_STEP_NS = 1_000_000_000  # if the time goes back by this, the clock was set back
_SAME_NS = 1_000_000  # markers may have different stamps; within this time one transform serves
_MAX_WAITING = 2000  # markers that wait for a transform to their frames

Integers = NDArray[np.integer[Any]]
MarkerId = tuple[str, int]  # namespace and number


@dataclass(frozen=True)
class MarkerSettings(TopicSettings):
    """Markers: shapes that programs draw."""

    hidden_namespaces: tuple[str, ...] = setting((), "namespaces that are not drawn", name_list)


class Incoming(NamedTuple):
    """Received markers, one per row."""

    spaces: list[str]
    frames: list[str]
    ids: Integers
    types: Integers
    actions: Integers
    locked: Integers
    lifetimes: Integers  # nanoseconds
    seconds: Integers  # whole seconds of the headers' stamps
    nanoseconds: Integers
    points: Integers  # number of points
    poses: Floats  # (N, 7) meters and x y z w; may be written to
    scales: Floats  # (N, 3) meters
    colors: Floats  # (N, 4), 0 to 1
    messages: Sequence[Any]

    @classmethod
    def of(cls, markers: Any) -> "Incoming":
        """Return a single marker, or those of a MarkerArray, which is a table."""
        is_table = isinstance(markers.ns, list)
        return cls(
            spaces=markers.ns if is_table else [markers.ns],
            frames=markers.header.frame_id if is_table else [markers.header.frame_id],
            ids=np.atleast_1d(markers.id),
            types=np.atleast_1d(markers.type),
            actions=np.atleast_1d(markers.action),
            locked=np.atleast_1d(markers.frame_locked),
            lifetimes=np.atleast_1d(_nanoseconds(markers.lifetime)),
            seconds=np.atleast_1d(markers.header.stamp.sec),
            nanoseconds=np.atleast_1d(markers.header.stamp.nanosec),
            points=np.atleast_1d(markers.points.counts if is_table else len(markers.points)),
            # These are copied, since contiguous arrays are faster.
            poses=np.array(markers.pose.array(), ndmin=2),
            scales=np.array(markers.scale.array(), ndmin=2),
            colors=np.array(markers.color.array(), ndmin=2),
            messages=markers if is_table else [markers],
        )

    @classmethod
    def joined(cls, parts: Iterable["Incoming"]) -> "Incoming":
        """Return the markers of several messages in order."""
        columns: Any = zip(*parts, strict=True)
        joined: list[Any] = [
            np.concatenate(column)
            if isinstance(column[0], np.ndarray)
            else [*chain.from_iterable(column)]
            for column in columns
        ]
        return cls(*joined)

    def report(self, problems: dict[str, str], which: Any, text: str, kind: str = "") -> None:
        """Store a problem with the first marker that has it.

        Args:
            problems: the problems so far, by kind.
            which: the row with the problem, or a mask (N,) of rows.
            text: what is wrong.
            kind: the kind of problem; "" for the text itself.
        """
        for row in np.flatnonzero(which)[:1] if isinstance(which, np.ndarray) else [which]:
            space = printable(shortened(self.spaces[row]))
            problems.setdefault(kind or text, f'id {self.ids[row]} of "{space}": {text}')


def _nanoseconds(time_: Any) -> Any:
    """Convert a time or a duration, or a table of them, to nanoseconds."""
    return time_.sec * np.int64(NS_PER_S) + time_.nanosec


class LayerKey(NamedTuple):
    """The properties that all markers of a layer have in common."""

    space: str
    kind: str
    frame: str
    variant: object  # a MeshVariant, or the opacity of triangles


class Layer:
    """Markers of one type and namespace, on one entity."""

    def __init__(self, stage: Stage, entity: str, key: LayerKey, kind: MarkerKind) -> None:
        self._stage, self.entity, self.key, self._kind = stage, entity, key, kind
        self._own: list[Piece] = [*one_row(rr.CoordinateFrame(key.frame))]  # same for all rows
        if isinstance(key.variant, MeshVariant):
            self._own += key.variant.pieces()
        self.ids: list[MarkerId] = []
        self.changed = False  # since it was logged
        self.batch: Batch  # set with the first markers
        self.first_end = _NEVER  # the end of the first lifetime
        self._logged: Sequence[Piece] = ()
        self._stamp_ns = 0
        self.whole_at = 0.0  # the time when all columns were last logged

    def update(self, ids: list[MarkerId], batch: Batch) -> None:
        """Add markers, or change existing ones."""
        if self.ids and ids != self.ids:
            slots = {marker: slot for slot, marker in enumerate(self.ids)}
            slots |= {marker: slot for slot, marker in enumerate(ids, len(self.ids))}
            ids, batch = [*slots], self.batch.joined(batch).at(np.array([*slots.values()]))
        self._set(ids, batch)

    def keep(self, slots: Sequence[int]) -> None:
        """Remove all markers except those in these slots."""
        self._set([self.ids[slot] for slot in slots], self.batch.at(np.array(slots, np.intp)))

    def _set(self, ids: list[MarkerId], batch: Batch) -> None:
        self.ids, self.batch, self.changed = ids, batch, True
        self.first_end = int(batch.ends.min()) if ids else _NEVER

    def log(self, stamp_ns: int, *, hidden: bool) -> None:
        """Log the columns that changed since the last row; from time to time, all of them."""
        self.changed = False
        drawn = self._kind.pieces(self.batch) if self.ids and not hidden else ()
        if not drawn:
            if self._logged:
                self._stage.clear(self.entity, stamp_ns, self.key.frame)
            self._logged = ()
            return
        columns = pieces = [*self._own, *drawn]
        if self._logged and stamp_ns >= self._stamp_ns and not is_old(self.whole_at):
            pairs = zip(pieces, self._logged, strict=True)
            columns = [piece for piece, previous in pairs if not _is_same(piece, previous)]
        else:
            self.whole_at = time.monotonic()
        self._logged, self._stamp_ns = pieces, stamp_ns
        if columns:
            ready = [_column(piece) for piece in columns]
            send(self._stage.recording, self.entity, [stamp_ns], ready)


def _is_same(piece: Piece, previous: Piece) -> bool:
    if isinstance(piece, tuple) and isinstance(previous, tuple):
        numbers, logged = piece[1], previous[1]
        # Compare the first row first, since it usually differs if anything moves.
        return np.array_equal(numbers[:1], logged[:1]) and np.array_equal(numbers, logged)
    return piece is previous


def _column(piece: Piece) -> Any:
    if isinstance(piece, tuple):
        make, numbers = piece
        return make(numbers)
    return piece


class MarkerPlan(NamedTuple):
    """The layers of the markers of a message, also for later messages with the same signature."""

    signature: tuple[object, ...]  # everything that the plan depends on
    members: list[tuple[Layer, list[MarkerId], Rows]]
    moved: dict[str, list[int]]  # rows that lie in the fixed frame, by their own frames


class MarkerDrawing(Drawing[MarkerSettings]):
    """The markers of one topic."""

    has_header = False

    key = "marker"
    message_types = ("visualization_msgs/msg/Marker", "visualization_msgs/msg/MarkerArray")
    rviz_classes = ("MarkerArray",)
    stamped_when_sent, replaces_previous = False, False

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._layers: dict[LayerKey, Layer] = {}
        self._where: dict[MarkerId, LayerKey] = {}
        self._plan: MarkerPlan | None = None
        self._stamp_ns = 0  # stamp of the last row
        self._now_ns = 0  # time of the last flush
        self._waiting: dict[MarkerId, tuple[int, Any]] = {}  # markers that wait for a transform
        self._fixed = ""  # the fixed frame
        self._tree: tuple[object, ...] = ()  # TF tree at the last check for their transforms

    def add(self, stamp_ns: int, message: Any) -> None:
        self._pending.append((stamp_ns, message))
        if not self.frame:  # it may become the fixed frame if there is no robot
            markers = getattr(message, "markers", [message])
            self.frame = next((_frame(marker) for marker in markers if _frame(marker)), "")

    def flush(self) -> None:
        """Log the messages received so far, and remove markers whose time is over."""
        self._fixed, now_ns = self.stage.fixed_frame, self.stage.now_ns
        if now_ns < self._now_ns - _STEP_NS:
            self._expire(_NEVER - 1)  # otherwise older markers would stay forever
        for stamp_ns, incoming in self._incoming():
            # It arrived at its stamp, unless that is before the last flush, or from another clock.
            arrived_ns = stamp_ns if self._now_ns < stamp_ns <= now_ns else now_ns
            self._expire(arrived_ns)
            self._take(stamp_ns, arrived_ns, incoming)
        tree = self.stage.frames.version, self._fixed
        if self._waiting and tree != self._tree:
            waiting, self._waiting = [*self._waiting.values()], {}
            latest_ns = max(stamp_ns for stamp_ns, _ in waiting)
            markers = Incoming.joined(Incoming.of(message) for _, message in waiting)
            self._take(latest_ns, now_ns, markers)
        self._tree = tree
        if self._waiting:
            self.frame = _frame(next(iter(self._waiting.values()))[1])
        self._expire(now_ns)
        self._now_ns = now_ns
        self._log(self._stamp_ns)

    def erase(self) -> None:
        for layer in self._layers.values():
            layer.log(self._stamp_ns, hidden=True)

    def change(self, settings: MarkerSettings) -> None:
        super().change(settings)
        for layer in self._layers.values():
            layer.changed = True
        self._log(self._stamp_ns)

    def _incoming(self) -> Iterator[tuple[int, Incoming]]:
        """Yield the messages; single markers that arrive at about the same time are joined."""
        pending, self._pending = self._pending, []
        for _, group in groupby(pending, lambda item: item[0] // _TOGETHER_NS):
            stamps_ns, messages = zip(*group, strict=True)
            if hasattr(messages[0], "markers"):
                for stamp_ns, array in zip(stamps_ns, messages, strict=True):
                    yield stamp_ns, Incoming.of(array.markers)
            else:
                yield stamps_ns[-1], Incoming.joined(map(Incoming.of, messages))

    # --- messages ---------------------------------------------------------------------------------

    def _take(self, stamp_ns: int, arrived_ns: int, incoming: Incoming) -> None:
        """Add, change or remove markers, whose lifetimes begin at ``arrived_ns``."""
        if not incoming.spaces:
            return
        kinds = self._kinds(incoming)
        plan = self._plan_of(stamp_ns, incoming, kinds)
        batch = self._batch(stamp_ns, arrived_ns, incoming, kinds, plan.moved)
        for layer, ids, rows in plan.members:
            layer.update(ids, batch.at(rows))
        is_all = all(layer.ids == ids for layer, ids, _ in plan.members)
        self._plan = plan if is_all and not self._waiting else None
        self._log(stamp_ns)

    def _kinds(self, incoming: Incoming) -> Integers:
        """Return the type of each marker, a key of KINDS; report those that cannot be drawn."""
        kinds = incoming.types
        arrows = kinds == ARROW
        if arrows.any():
            kinds = np.where(arrows & (incoming.points > 0), ARROW_STRIP, kinds)
        numbers = incoming.poses, incoming.scales, incoming.colors
        # One pass accepts nearly all messages, without a copy.
        if not all(float(np.vdot(column, column)) <= LARGEST for column in numbers):
            sound = (np.abs(np.hstack(numbers)) <= LARGEST).all(axis=1)
            kinds = np.where(sound, kinds, _NOT_DRAWN)
            incoming.poses[~sound] = _IDENTITY
            drawn = incoming.actions == ADD
            incoming.report(self.problems, ~sound & drawn, "its numbers are not finite: not drawn")
        return kinds

    def _plan_of(self, stamp_ns: int, incoming: Incoming, kinds: Integers) -> MarkerPlan:
        """Return the layers of the markers, after removing deleted ones and those that move.

        If nothing relevant changed, it is the previous plan, and nothing is left to remove.
        """
        variants = _variants(incoming, kinds)
        columns = incoming.ids, incoming.actions, kinds, incoming.locked
        numbers = [column.tobytes() for column in columns]
        tree = self._fixed, self.stage.frames.version
        signature = (incoming.spaces, incoming.frames, numbers, variants, tree)
        if self._plan is not None and self._plan.signature == signature:
            return self._plan
        _check(incoming, kinds, self.problems)
        newest, cleared = _newest_rows(incoming)
        gone = {m for m in (*self._where, *self._waiting) if "" in cleared or m[0] in cleared}
        for marker in gone & self._waiting.keys():
            del self._waiting[marker]
        keys: dict[MarkerId, LayerKey] = {}
        members: dict[LayerKey, list[MarkerId]] = {}
        moved: dict[str, list[int]] = {}
        for marker, row in newest.items():
            if incoming.actions[row] == DELETE:
                gone.add(marker)
                self._waiting.pop(marker, None)
                continue
            key = self._key(stamp_ns, incoming, row, kinds[row], variants.get(row))
            if key is None:
                continue
            if self._where.get(marker) != key:
                gone.add(marker)
            keys[marker] = key
            members.setdefault(key, []).append(marker)
            frame = incoming.frames[row].lstrip("/")
            if frame != key.frame:
                moved.setdefault(frame, []).append(row)
        self._remove(gone)
        self._where |= keys
        rows = {key: [newest[marker] for marker in ids] for key, ids in members.items()}
        return MarkerPlan(
            signature,
            [(self._layers[key], ids, _selection(rows[key])) for key, ids in members.items()],
            moved,
        )

    def _remove(self, markers: Collection[MarkerId]) -> None:
        layers = {self._where.pop(marker) for marker in markers if marker in self._where}
        for layer in map(self._layers.__getitem__, layers):
            layer.keep([slot for slot, marker in enumerate(layer.ids) if marker not in markers])

    def _key(
        self, stamp_ns: int, incoming: Incoming, row: int, kind: int, variant: object
    ) -> LayerKey | None:
        """Return the layer of a marker; None if it is not drawn, or not yet."""
        space, frame = incoming.spaces[row], incoming.frames[row].lstrip("/")
        if kind not in KINDS or not frame or incoming.actions[row] != ADD:
            return None
        marker = space, int(incoming.ids[row])
        if not self.stage.connected(frame):
            if marker in self._waiting or len(self._waiting) < _MAX_WAITING:
                self._waiting[marker] = stamp_ns, incoming.messages[row]
            return None
        self._waiting.pop(marker, None)
        home = frame if incoming.locked[row] else self._fixed
        key = LayerKey(space, KINDS[kind].name, home, variant)
        if key not in self._layers:
            try:
                self._layers[key] = Layer(self.stage, self._entity(key), key, KINDS[kind])
            except OneBotError as error:
                incoming.report(self.problems, row, str(error), "mesh")
                return None
        return key

    def _entity(self, key: LayerKey) -> str:
        """Return the entity of a new layer."""
        space = [key.space] if key.space else []
        first = below(self.entity, entity_path(*space, key.kind))
        names = (first if number == 1 else f"{first}_{number}" for number in count(1))
        used = {layer.entity for layer in self._layers.values()}
        return next(entity for entity in names if entity not in used)

    def _batch(
        self,
        stamp_ns: int,
        arrived_ns: int,
        incoming: Incoming,
        kinds: Integers,
        moved: Mapping[str, list[int]],
    ) -> Batch:
        """Return the markers with poses and colors as drawn."""
        poses = incoming.poses
        if not (incoming.actions == ADD).all():
            poses[incoming.actions != ADD] = _IDENTITY
        lengths = np.einsum("ij,ij->i", poses[:, 3:], poses[:, 3:])
        odd = np.abs(lengths - 1.0) > UNIT_TOLERANCE
        if odd.any():
            incoming.report(self.problems, odd, "its quaternion is not of unit length")
            poses[:, 3:] = normalized(poses[:, 3:])
        for frame, moving in moved.items():
            stamps_ns = incoming.seconds * np.int64(NS_PER_S) + incoming.nanoseconds
            moments = stamps_ns[moving] // _SAME_NS
            order = np.argsort(moments, kind="stable")  # 100,000 may have a moment each
            starts = np.flatnonzero(np.diff(moments[order])) + 1
            for rows in np.split(np.array(moving)[order], starts):
                at_ns = int(stamps_ns[rows[0]]) or stamp_ns
                pose = self.stage.frames.pose(frame, self._fixed, at_ns)
                assert pose is not None
                turn = from_matrix(pose[:3, :3])
                poses[rows, :3] = rotate(turn, poses[rows, :3]) + pose[:3, 3]
                poses[rows, 3:] = multiply(turn, poses[rows, 3:])
        ends = np.full(len(poses), _NEVER)
        if incoming.lifetimes.any():
            limited = incoming.lifetimes > 0
            ends[limited] = arrived_ns + incoming.lifetimes[limited]
        parts = np.full(len(poses), None)
        for row in np.flatnonzero(kinds >= LINE_STRIP).tolist():
            added = incoming.actions[row] == ADD
            if added and kinds[row] in KINDS and kinds[row] != MESH:
                parts[row] = self._part(incoming, row, int(kinds[row]))
        return Batch(poses, incoming.scales, incoming.colors, ends, parts)

    def _part(self, incoming: Incoming, row: int, kind: int) -> MarkerContent:
        """Return the points, colors and text of a marker."""
        message = incoming.messages[row]
        points = message.points.array().astype(np.float64).reshape(-1, 3)
        colors = message.colors.array().astype(np.float64).reshape(-1, 4)
        if kind == TRIANGLE_LIST and 3 * len(colors) == len(points):
            colors = colors.repeat(3, axis=0)
        if len(colors) not in (0, len(points)):
            text = "it has more or fewer colors than points: the marker's color is used"
            incoming.report(self.problems, row, text)
            colors = colors[:0]
        if not is_drawable(points):
            incoming.report(self.problems, row, "its points are not finite: not drawn")
            points = points[:0]
        end = len(points) - len(points) % 3 if kind == TRIANGLE_LIST else len(points)
        if incoming.types[row] == ARROW:
            end = 2
        if len(points) < KINDS[kind].min_points:
            end = 0
        colors = colors[:end] if len(colors) == len(points) else colors[:0]
        return MarkerContent(points[:end], colors, incoming.types[row] == LINE_LIST, message.text)

    # --- time -------------------------------------------------------------------------------------

    def _expire(self, until_ns: int) -> None:
        """Remove the markers whose lifetimes are over, each at its time."""
        while True:
            first = min((layer.first_end for layer in self._layers.values()), default=_NEVER)
            if first > until_ns or first == _NEVER:
                return
            at = min(until_ns, first + _TOGETHER_NS)
            for layer in self._layers.values():
                if layer.first_end <= at:
                    over = np.flatnonzero(layer.batch.ends <= at).tolist()
                    self._remove({layer.ids[slot] for slot in over})
            self._plan = None
            self._log(max(first, self._stamp_ns))  # not before the markers were drawn

    def _log(self, stamp_ns: int) -> None:
        """Log the layers that have changed, or are old, and drop empty ones."""
        self._stamp_ns = stamp_ns
        for layer in self._layers.values():
            if layer.changed or is_old(layer.whole_at):
                layer.log(stamp_ns, hidden=layer.key.space in self.settings.hidden_namespaces)
        if not all(layer.ids for layer in self._layers.values()):
            self._layers = {key: layer for key, layer in self._layers.items() if layer.ids}
            self._plan = None


def _check(incoming: Incoming, kinds: Integers, problems: dict[str, str]) -> None:
    """Report the problems that RViz warns about."""
    add = incoming.actions == ADD
    incoming.report(problems, add & (np.array(incoming.frames) == ""), "it names no frame")
    has_known_kind = np.isin(kinds, [*KINDS, _NOT_DRAWN])
    incoming.report(problems, add & ~has_known_kind, "its type is unknown: not drawn")
    for kind in KINDS.keys() & set(kinds[add].tolist()):
        how, rows = KINDS[kind], add & (kinds == kind)
        flat = (incoming.scales[:, how.of_scale] == 0).any(axis=1)
        incoming.report(problems, rows & flat, "its scale is zero")
        if how.min_points == 0 and kind != MESH:
            clear = incoming.colors[:, 3] == 0
            incoming.report(problems, rows & clear, "it is transparent: color.a is 0")
        rows &= incoming.points < how.min_points
        incoming.report(problems, rows, f"it has fewer than {how.min_points} points: not drawn")


def _frame(marker: Any) -> str:
    return str(marker.header.frame_id.lstrip("/"))


def _newest_rows(incoming: Incoming) -> tuple[dict[MarkerId, int], set[str]]:
    """Return the last row of each marker, and the namespaces deleted before; "" for all."""
    newest: dict[MarkerId, int] = {}
    cleared = set[str]()
    rows = zip(incoming.spaces, incoming.ids.tolist(), incoming.actions.tolist(), strict=True)
    for row, (space, number, action) in enumerate(rows):
        if action == DELETE_ALL:
            cleared.add(space)
            newest = {key: at for key, at in newest.items() if space not in ("", key[0])}
        else:
            newest[space, number] = row
    return newest, cleared


def _selection(rows: list[int]) -> Rows:
    """Return rows as an index; a slice, which copies nothing, if they are consecutive."""
    consecutive = range(rows[0], rows[-1] + 1)
    return slice(rows[0], rows[-1] + 1) if rows == [*consecutive] else np.array(rows)


def _variants(incoming: Incoming, kinds: Integers) -> dict[int, object]:
    """Return, by row, the properties in which markers on one entity must agree."""
    variants: dict[int, object] = {}
    for row in np.flatnonzero((kinds == MESH) | (kinds == TRIANGLE_LIST)).tolist():
        message = incoming.messages[row]
        colors = incoming.colors[row : row + 1]
        if kinds[row] == MESH:
            embedded = bool(message.mesh_use_embedded_materials)
            uri = message.mesh_resource
            variants[row] = MeshVariant(uri, None if embedded else int(rgba(colors)[0]))
        else:
            color = message.colors.array().reshape(-1, 4)[:1] if len(message.colors) else colors
            variants[row] = int(rgba(np.where(np.isnan(color), colors, color))[0]) & 255
    return variants
