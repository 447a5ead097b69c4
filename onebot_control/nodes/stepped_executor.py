"""An rclpy executor that runs all ready callbacks in a fixed order, and never waits."""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from inspect import iscoroutinefunction
from typing import Any, NamedTuple

from rclpy.context import Context
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.task import Task
from rclpy.waitable import NumberOfEntities

from onebot_control.nodes.callback_watch import CallbackWatch

_WAITABLE, _TIMER, _SUBSCRIPTION = "waitable", "timer", "subscription"
_KINDS = (_SUBSCRIPTION, "guard_condition", _TIMER, "client", "service")  # a wait set's names
TF_TOPICS = ("/tf", "/tf_static")
RCLError, WaitSet = rclpy_implementation.RCLError, rclpy_implementation.WaitSet


class _Entry(NamedTuple):
    """An entity of a node in a wait set."""

    kind: str
    entity: Any
    node: Node
    add: Callable[[Any], object]  # adds ``argument`` to the wait set
    argument: Any
    pointer: int  # the wait set's identifier of the ready entity; 0 for a waitable
    is_first: bool  # whether other callbacks only run when none of these is ready


class SteppedExecutor(Executor):
    """Runs all ready callbacks: node by node in the order of ``add_node``, oldest entity first.

    rclpy's executors iterate over a set of nodes, whose order differs from process to process, and
    build a wait set for each wait, which takes longer than all callbacks of most nodes. This one
    only builds it when a node's entities have changed. It does not wait for the nodes' own
    subscriptions to /clock: the caller sets their time.

    Half of all entities are events, such as the log of an incompatible QoS. They only have
    callbacks when entities have changed, or when ``look_for_events`` was set to true.

    Subscriptions to /tf and /tf_static, and nodes that forward messages to them, run before all
    others, so that callbacks of other messages can look up the transforms.

    Attributes:
        nodes: the nodes, in the order in which they were added.
        changed: whether entities have changed since this was set to false.
        look_for_events: whether events count as ready in the next run.
        first: nodes whose callbacks run before those of the others.
    """

    def __init__(self, context: Context, watch: CallbackWatch) -> None:
        """Start without nodes; ``watch`` ends blocking callbacks."""
        self.nodes: list[Node] = []
        self.first: set[Node] = set()
        self.changed = self._is_stale = self.look_for_events = True
        super().__init__(context=context)
        self._watch = watch
        # rclpy's executors have this attribute, too.
        self._tasks: list[tuple[Task, Any, Node | None]] = []
        self._suspended: set[Task] = set()
        self._entries: list[_Entry] = []
        self._entries_without_events: list[_Entry] = []
        self._wait_set: Any = None

    def add_node(self, node: Node) -> bool:
        """Run a node's callbacks from now on; return false if it has already been added."""
        if node in self.nodes:
            return False
        self.nodes.append(node)
        node.executor = self
        self.wake()
        return True

    def remove_node(self, node: Node) -> None:
        """Stop running a node's callbacks."""
        if node in self.nodes:
            self.nodes.remove(node)
            self.wake()

    def get_nodes(self) -> list[Node]:
        """Return the nodes, in the order in which they were added."""
        return list(self.nodes)

    def wake(self) -> None:
        """Record that entities have changed; nodes call it when they create or destroy one."""
        self.changed = self._is_stale = self.look_for_events = True

    def run_ready(self) -> None:
        """Run callbacks until none is ready; an exception in a callback is raised here.

        A suspended coroutine is resumed, but if it is suspended again, it does not count as ready:
        it may await something that takes simulated time.
        """
        while self._context.ok():
            ran = self._run_tasks()
            for entry in self._ready():
                ran = True
                with self._watch.running(entry.node):
                    self._run(entry.kind, entry.entity, entry.node)
                if not self._context.ok():
                    return  # a callback has shut it down
            if not ran:
                self.look_for_events = False
                return

    def _run_tasks(self) -> bool:
        """Start or resume each coroutine; return whether one has started or ended."""
        ran = False
        for task, _, node in reversed(self._tasks[:]):
            if _is_pending(task) and (node is None or node in self.nodes):
                with self._watch.running(node):
                    _run_task(task)
                ran |= not _is_pending(task) or task not in self._suspended
        self._tasks = [entry for entry in self._tasks if _is_pending(entry[0])]
        self._suspended = {task for task, _, _ in self._tasks}
        return ran

    def _run(self, kind: str, entity: Any, node: Node) -> None:
        """Run the callback of a ready entity, unless it has been destroyed meanwhile."""
        is_plain = kind in (_TIMER, _SUBSCRIPTION) and not iscoroutinefunction(entity.callback)
        if not is_plain:
            _run_task(self._make_handler(entity, node, getattr(self, f"_take_{kind}")))
            return
        # Do not create a task, which takes longer than most callbacks.
        handle, arguments = entity.handle, ()
        try:
            with handle:
                if kind == _TIMER:
                    if not handle.is_timer_ready():
                        return  # a callback has just cancelled or reset it
                    handle.call_timer()
                elif received := handle.take_message(entity.msg_type, entity.raw):
                    is_short = entity._callback_type is Subscription.CallbackType.MessageOnly
                    arguments = received[:1] if is_short else received
                else:
                    return
        except InvalidHandle:
            return
        entity.callback(*arguments)

    def _ready(self) -> list[_Entry]:
        """Return the ready entities."""
        with suppress(InvalidHandle, RCLError):
            return self._wait()
        # An entity was destroyed without its node, or a thread has just shut rclpy down.
        self._is_stale = True
        return self._wait() if self._context.ok() else []

    def _wait(self) -> list[_Entry]:
        if self._is_stale:
            self._collect()
        entries = self._entries if self.look_for_events else self._entries_without_events
        if self._tasks:  # a coroutine may hold its callback group
            entries = [entry for entry in entries if self.can_execute(entry.entity)]
        wait_set = self._wait_set
        wait_set.clear_entities()
        for entry in entries:
            entry.add(entry.argument)
        wait_set.wait(0)
        ready = {pointer for kind in _KINDS for pointer in wait_set.get_ready_entities(kind)}
        found = [
            entry
            for entry in entries
            if entry.pointer in ready or (not entry.pointer and entry.entity.is_ready(wait_set))
        ]
        return [entry for entry in found if entry.is_first] or found

    def _collect(self) -> None:
        """Create a wait set for the current entities of the nodes."""
        self._is_stale = False
        self.nodes = [node for node in self.nodes if is_alive(node.handle)]
        entities = [entry for node in self.nodes for entry in _entities(node)]
        counts = Counter(kind for kind, _, _ in entities)
        numbers = (item.get_num_entities() for kind, item, _ in entities if kind == _WAITABLE)
        waitables = sum(numbers, NumberOfEntities())
        numbers = (getattr(waitables, f"num_{kind}s") + counts[kind] for kind in (*_KINDS, "event"))
        self._wait_set = wait_set = WaitSet(*numbers, self._context.handle)
        self._entries = [_entry(wait_set, *entity, entity[2] in self.first) for entity in entities]
        self._entries_without_events = [
            entry for entry in self._entries if not isinstance(entry.entity, EventHandler)
        ]


def _entry(wait_set: Any, kind: str, entity: Any, node: Node, is_first: bool) -> _Entry:
    if kind == _WAITABLE:
        return _Entry(kind, entity, node, entity.add_to_wait_set, wait_set, 0, is_first)
    handle, add = entity.handle, getattr(wait_set, f"add_{kind}")
    is_first |= kind == _SUBSCRIPTION and entity.topic_name in TF_TOPICS
    return _Entry(kind, entity, node, add, handle, handle.pointer, is_first)


def _entities(node: Node) -> Iterator[tuple[str, Any, Node]]:
    """Yield a node's entities with their kinds, in the order in which they run."""
    kinds = {
        _WAITABLE: node.waitables,
        _TIMER: node.timers,
        _SUBSCRIPTION: node.subscriptions,
        "guard_condition": node.guards,
        "client": node.clients,
        "service": node.services,
    }
    for kind, entities in kinds.items():
        for entity in entities:
            is_clock = entity is node._time_source._clock_sub
            if not is_clock and is_alive(entity if kind == _WAITABLE else entity.handle):
                yield kind, entity, node


def is_alive(handle: Any) -> bool:
    """Return whether the entity of a handle has not been destroyed."""
    try:
        with handle:
            return True
    except InvalidHandle:
        return False


def _is_pending(task: Task) -> bool:
    return not (task.done() or task.cancelled())


def _run_task(task: Task) -> None:
    """Run a task, and raise its exception."""
    task()
    if task.done() and (error := task.exception()) is not None:
        raise error
