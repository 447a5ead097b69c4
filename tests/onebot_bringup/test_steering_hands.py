"""Keys drive while a hand holds them, whatever a browser swallows: the page under a fake clock."""

import random
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.onebot_bringup.keyboard_model import (
    DRIVE,
    KEYBOARDS,
    STRAFE,
    Action,
    Desk,
    fault,
    random_actions,
)
from tests.onebot_bringup.steering_support import PageClient, Steering, steering
from tests.steering_browser_support import Page
from tests.support import wait_for

pytestmark = pytest.mark.slow

SEQUENCES = 250  # of each keyboard

FAKES = Path(__file__).with_name("steering_fakes.js").read_text()  # clock and server
SHOW = "server.onmessage({ data: JSON.stringify(arguments[0]) })"
REPLAY = "return arguments[0].map(([events, duration]) => replay(events, duration))"


@pytest.fixture(scope="module")
def node(domain: int) -> Iterator[Steering]:
    with steering() as node:
        yield node


@pytest.fixture(scope="module")
def faked(node: Steering, chromium: Page) -> Iterator[Page]:
    """The page with fakes in place of the clock and the server."""
    hook = chromium.devtools("Page.addScriptToEvaluateOnNewDocument", source=FAKES)
    chromium.driver.get(node.address)
    ready = "return Boolean(window.server?.onmessage)"
    wait_for(lambda: chromium.driver.execute_script(ready), "the page's modules")
    chromium.driver.execute_script("connect()")
    yield chromium
    chromium.devtools("Page.removeScriptToEvaluateOnNewDocument", **hook)


@pytest.fixture(scope="module")
def state(node: Steering) -> dict[str, Any]:
    """A state of the server's."""
    with PageClient(node.address) as client:
        return client.state


def played(keyboard: str, drive: tuple[str, ...], actions: list[Action]) -> Desk:
    desk = Desk(KEYBOARDS[keyboard], drive)
    desk.play(actions)
    return desk


def faults(page: Page, desks: Sequence[Desk]) -> list[str]:
    """What is wrong with the commands that the page sends for each hand's events."""
    script = [[desk.events, desk.time] for desk in desks]
    commands = page.driver.execute_script(REPLAY, script)
    return [fault(desk, sent) for desk, sent in zip(desks, commands, strict=True)]


@pytest.mark.parametrize(
    ("keyboard", "lateral"), [*((keyboard, 0.0) for keyboard in KEYBOARDS), ("X11", 0.5)]
)
def test_only_a_hand_on_the_keys_drives(
    faked: Page, state: dict[str, Any], keyboard: str, lateral: float
) -> None:
    """Commands end soon after the last key that drives is up, and go on while one is held.

    Any event may be swallowed, also in menus, by other programs, by fields and by other windows.
    Only where the drive goes sideways, E drives like the others.
    """
    limits = {**state["limits"], "lateral": lateral}
    faked.driver.execute_script(SHOW, {**state, "limits": limits})
    drive = (*DRIVE, STRAFE) if lateral else DRIVE
    rng = random.Random(keyboard)
    sequences = [random_actions(rng) for _ in range(SEQUENCES)]
    found = faults(faked, [played(keyboard, drive, actions) for actions in sequences])
    for actions, wrong in zip(sequences, found, strict=True):
        assert not wrong, actions


def ran(page: Page, script: str) -> list[int]:
    """What a script returns: how many commands the page sends in each ``pass``."""
    return list(page.driver.execute_script(f"replay([], 1000); {script}"))


def test_a_gamepad_that_freezes_is_let_go(faked: Page) -> None:
    """Its values have noise while a hand is there; frozen at full they last five seconds.

    Then the stick has to come back to its middle, as after any stop.
    """
    script = """
    window.stick = [0, 0, 0, 0];
    const plugged = new Event("gamepadconnected");
    plugged.gamepad = { index: 0 };
    window.dispatchEvent(plugged);
    const sent = [pass(100)];
    let noise = 0;
    for (let each = 0; each < 4; each++) {
      window.stick = [0, -1, (noise += 1e-5), 0];
      sent.push(pass(4000));
    }
    sent.push(pass(20000));
    window.stick = [0, -1, 0.5, 0];
    sent.push(pass(1000));
    window.stick = [0, 0, 0, 0];
    pass(100);
    window.stick = [0, -1, 0, 0];
    sent.push(pass(1000));
    window.stick = [0, 0, 0, 0];
    pass(100);
    window.stick = null;
    return sent;"""
    rest, *driven, frozen, stuck, again = ran(faked, script)
    assert rest == stuck == 0
    assert all(count == pytest.approx(80, abs=2) for count in driven)
    assert frozen == pytest.approx(20, abs=2), "what is left of five seconds"
    assert again == pytest.approx(20, abs=2)


POINTERS = """
const axis = (name) => document.querySelector(`#${name} input`);
const point = (type, name, pointerId, buttons) => axis(name).dispatchEvent(
  new PointerEvent(type, { pointerId, buttons, button: 0, bubbles: true, cancelable: true }));
const push = (name) => { axis(name).value = "0.5"; axis(name).dispatchEvent(new Event("input")); };
"""


@pytest.mark.parametrize("moves", ["both", "one"])
def test_each_slider_needs_its_own_finger(faked: Page, moves: str) -> None:
    """A finger that moves on one slider does not hold the other one, whose finger has gone."""
    script = f"""{POINTERS}
    for (const [id, name] of [[1, "linear"], [2, "angular"]]) {{
      point("pointerdown", name, id, 1);
      push(name);
    }}
    const sent = [];
    for (let second = 0; second < 12; second++) {{
      if ({str(moves == "both").lower()}) point("pointermove", "linear", 1, 1);
      point("pointermove", "angular", 2, 1);
      sent.push(pass(1000));
    }}
    for (const [id, name] of [[1, "linear"], [2, "angular"]]) point("pointerup", name, id, 0);
    sent.push(pass(1000));
    return sent;"""
    *held, after = ran(faked, script)
    assert after == 0
    expected = [20] * (12 if moves == "both" else 5) + [0] * (0 if moves == "both" else 7)
    assert held == pytest.approx(expected, abs=2)


@pytest.mark.parametrize("swallowed", ["", "key('keyup', 'Escape')"])
def test_a_button_that_enter_holds_is_a_key(faked: Page, swallowed: str) -> None:
    """What tells that an event was swallowed releases it, as it does the keys that drive."""
    script = f"""
    const button = document.querySelector("#linear [name=plus]");
    const key = (type, code, repeat = false) => button.dispatchEvent(
      new KeyboardEvent(type, {{ code, repeat, bubbles: true, cancelable: true }}));
    key("keydown", "Enter");
    const sent = [pass(500)];
    for (let each = 0; each < 10; each++) {{
      key("keydown", "Enter", true);
      sent.push(pass(200));
    }}
    {swallowed};
    sent.push(pass(3000));
    return sent;"""
    *held, after = ran(faked, script)
    assert held == pytest.approx([10, *[4] * 10], abs=1)
    assert after == 0 if swallowed else after <= 12
