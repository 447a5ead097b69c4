"""A model of keyboards, and of what a browser reports of them: which commands a hand justifies.

A hand presses and releases keys. Menus, other programs, fields and other windows take some of the
events, and any other event may be swallowed. The model knows where the hand really is, so that it
can judge the commands that the steering page sends.
"""

import math
import random
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

DRIVE = ("KeyW", "KeyA", "KeyS", "ArrowRight")
MODIFIERS = {"ShiftLeft": 2, "ControlLeft": 4, "AltLeft": 8, "MetaLeft": 16}  # flags of events
STRAFE = "KeyE"  # drives robots that go sideways
OTHER = ("KeyK", "Escape", *MODIFIERS)
REPEAT = 1  # flag of an event
AWAY = ("menu", "grab", "window")  # they take all keys
PRESSED, REPEATED, OTHERS = 2000, 600, 5000  # ms that the page's signs of a hand are good for
UP = 700  # ms that a key may drive after it was released
SLACK = 150  # ms: the page counts commands, one each 50 ms
DELAYS = (0, 0, 20, 60, 150, 300, 600, 1200, 2500)  # ms between two actions


class Keyboard(NamedTuple):
    """How a system repeats keys."""

    delay: float = math.inf  # ms until a key repeats
    period: float = math.inf  # ms
    silent: tuple[str, ...] = ()  # keys that do not repeat
    shift_repeats: bool = False  # in place of the key that is held
    meta_swallows: bool = False  # the releases of others while it is down


KEYBOARDS = {
    "X11": Keyboard(660, 40, tuple(MODIFIERS)),
    "Windows": Keyboard(500, 33, shift_repeats=True),
    "slow Windows": Keyboard(1000, 400, shift_repeats=True),
    "macOS": Keyboard(500, 90, (*MODIFIERS, "KeyA", "KeyS"), meta_swallows=True),  # with accents
    "no repeat": Keyboard(),
}


class Action(NamedTuple):
    """What a hand does."""

    delay: int  # ms since the previous action
    act: str  # "down", "up", or "go"
    what: str  # the code of a key, or where the keys go: "page", "field", or one of AWAY
    seen: bool = True  # the browser reports it, where it can


class Segment(NamedTuple):
    """The commands that are right from an event to the next, until these times (ms)."""

    start: float
    allowed: float
    required: float


@dataclass
class Desk:
    """A hand at a keyboard."""

    keyboard: Keyboard
    drive: tuple[str, ...] = DRIVE  # the keys that drive
    time: float = 0.0
    place: str = "page"
    down: set[str] = field(default_factory=set)  # keys, as they really are
    repeating: str = ""  # the key that repeats next
    repeats: bool = False  # it has, before the browser's eyes
    next: float = math.inf
    known: set[str] = field(default_factory=set)  # keys that are down by the events
    held: set[str] = field(default_factory=set)  # keys that drive by the events, and may be up
    deadline: float = 0.0  # until when a hand that has left is allowed to drive
    clean: bool = True  # nothing was swallowed so far
    sign: float = 0.0  # when a key that drives gave the last sign
    alive: float = 0.0  # until when that is good
    events: list[tuple[float, str, str, int]] = field(default_factory=list)  # of the browser
    segments: list[Segment] = field(default_factory=list)

    def play(self, actions: list[Action]) -> None:
        for delay, act, what, seen in actions:
            self.wait(delay)
            {"down": self.press, "up": self.release, "go": self.go}[act](what, seen)
            self.mark()
        self.wait(max(self.deadline - self.time, 0.0) + 500)

    def wait(self, duration: float) -> None:
        end = self.time + duration
        while self.next <= end:
            self.time, self.next = self.next, self.next + self.keyboard.period
            self.emit("keydown", self.repeating, REPEAT)
            self.mark()
        self.time = end

    def mark(self) -> None:
        """Note what is right from now on."""
        hand_is_there = bool(self.held & self.down)
        allowed = math.inf if hand_is_there else self.deadline if self.held else self.time
        live = self.clean and self.held
        self.segments.append(Segment(self.time, allowed, self.alive - SLACK if live else 0.0))

    # The hand ------------------------------------------------------------------------------------

    def press(self, key: str, seen: bool) -> None:
        if key in self.down:
            return
        self.down.add(key)
        if key not in MODIFIERS or self.keyboard.shift_repeats:
            self.repeating, self.repeats = key, False
            silent = key in self.keyboard.silent
            self.next = math.inf if silent else self.time + self.keyboard.delay
        self.emit("keydown", key, 0, seen)
        if key == "Escape" and self.place == "menu":
            self.place = "page"

    def release(self, key: str, seen: bool) -> None:
        if key not in self.down:
            return
        self.down.remove(key)
        if key in self.drive:
            repeats = self.repeats and self.repeating in self.drive
            silent = 0.0 if repeats else self.sign + PRESSED
            self.deadline = max(self.deadline, self.time + UP, silent)
        if key == self.repeating:
            self.repeating, self.next = "", math.inf
        if self.keyboard.meta_swallows and "MetaLeft" in self.down:
            seen = False
        self.emit("keyup", key, 0, seen)

    def go(self, place: str, seen: bool) -> None:
        before, self.place = self.place, place
        if place == before:
            return
        self.clean = False
        moves = {"field": ("focusin", "focusout"), "window": ("blur", "focus")}
        for taken, events in moves.items():
            for event, there in zip(events, (place, before), strict=True):
                if there == taken:
                    self.events.append((self.time, event, "", 0))
                    self.lose()
        if "window" in (place, before):
            self.known.clear()

    # The browser ---------------------------------------------------------------------------------

    def emit(self, kind: str, key: str, flags: int, seen: bool = True) -> None:
        if self.place in AWAY or not seen:
            self.clean = False
            return
        flags |= sum(flag for modifier, flag in MODIFIERS.items() if modifier in self.down)
        self.events.append((self.time, kind, key, flags))
        if self.held and abs(self.time - self.alive) < SLACK:
            self.clean = False  # the page may have let go, or not yet
        elif self.clean and self.time > self.alive:
            self.held.clear()
        (self.see_press if kind == "keydown" else self.see_release)(key, flags)

    def see_press(self, key: str, flags: int) -> None:
        repeat, menu = bool(flags & REPEAT), MODIFIERS["AltLeft"] | MODIFIERS["MetaLeft"]
        elsewhere = self.place == "field" or key == "Escape" or flags & menu
        if elsewhere or repeat != (key in self.known):
            self.lose()
        self.known.add(key)
        if flags & MODIFIERS["MetaLeft"]:
            self.known.clear()
        self.repeats |= repeat
        if repeat and key in self.held:
            self.sign, self.alive = self.time, self.time + REPEATED
        elif repeat and key == "ShiftLeft":
            self.alive = max(self.alive, self.sign + PRESSED)
        ignored = flags & (menu | MODIFIERS["ControlLeft"]) or self.place == "field"
        if key in self.drive and not repeat and not ignored:
            self.held.add(key)
            self.sign, self.alive = self.time, self.time + PRESSED

    def see_release(self, key: str, flags: int) -> None:
        if key not in self.known:
            self.lose()
        self.known.discard(key)
        if key in self.held:
            self.held.remove(key)
            if self.held:
                self.sign, self.alive = self.time, self.time + OTHERS
                self.deadline = max(self.deadline, self.time + OTHERS)

    def lose(self) -> None:
        """Something was swallowed, or the hand is elsewhere: what is held does not drive."""
        self.held.clear()


def random_actions(rng: random.Random) -> list[Action]:
    """Return what a hand does; in half of the cases the browser reports all of it."""
    swallowed = rng.choice((0.0, 0.0, 0.1, 0.5))
    places = ("page", "field", *AWAY) if swallowed or rng.random() < 0.3 else ()
    keys = (*DRIVE, STRAFE, *(("ShiftLeft",) if rng.random() < 0.4 else OTHER))
    actions = []
    down: list[str] = []
    for _ in range(rng.randint(1, 12)):
        act = rng.choice(("down", "down", "up", "up", "go"))
        if act == "go" and places:
            what = rng.choice(places)
        elif act == "up" and down:
            what = down.pop(rng.randrange(len(down)))
        else:
            act, what = "down", rng.choice(keys)
            down.append(what)
        actions.append(Action(rng.choice(DELAYS), act, what, rng.random() >= swallowed))
    seen = [rng.random() >= swallowed for _ in down]
    return [*actions, *(Action(30, "up", key, see) for key, see in zip(down, seen, strict=True))]


def fault(desk: Desk, commands: list[float]) -> str:
    """Return what is wrong with commands that were sent at these times (ms); "" if nothing."""
    times = [segment.start for segment in desk.segments]
    for segment, end in zip(desk.segments, [*times[1:], desk.time], strict=True):
        late = [time for time in commands if max(segment.start, segment.allowed) < time < end]
        if late:
            return f"a command at {late[0]:.0f} ms, allowed until {segment.allowed:.0f} ms"
        until = min(segment.required, end)
        if until > segment.start:
            sent = [time for time in commands if segment.start - 60 <= time <= until]
            gap = any(b - a > 60 for a, b in pairwise([*sent, until]))
            if not sent or gap:
                return f"no commands from {segment.start:.0f} to {until:.0f} ms"
    return ""
