"""Makes the READMEs' pictures again, with the commands that anyone has.

``python tests/pictures.py [onebot] [mrm] [steering] [gallery] [--into FOLDER]``: all if none is
named. They go where the READMEs show them, or beside one another into FOLDER, to be looked at.
"""

import argparse
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
PLACES = {
    "onebot": CHECKOUT / "onebot_bringup/images/onebot.png",
    "mrm": CHECKOUT / "mrm_description/images/mrm.png",
    "steering": CHECKOUT / "onebot_bringup/images/steering.png",
    "gallery": CHECKOUT / "onebot_bringup/images/gallery.png",
}
# What OneBot is told for its picture: m/s, rad/s and s, an S that shows all there is to see.
DRIVE = ((0.2, 0.5, 6.0), (0.35, -0.5, 6.0), (0.25, 0.45, 6.0))
ORANGE, TRAIL = (255, 107, 10), (77, 208, 225)  # as in dimensions.yaml and view.yaml
SCREEN = (1440, 860)
TOPIC = "/velocity_controller/cmd_vel"
_MODULES = {
    "onebot": "onebot_bringup.cli.main",
    "onebot_bringup": "onebot_bringup.launch.onebot_bringup",
    "mrm_bringup": "mrm_description.launch.mrm_bringup",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Make the pictures that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(PLACES))
    parser.add_argument("--into", type=Path, metavar="FOLDER")
    args = parser.parse_args(argv)
    unknown = set(args.names) - set(PLACES)
    if unknown:
        parser.error(f"no picture {', '.join(sorted(unknown))} (there: {', '.join(PLACES)})")
    os.environ["ROS_DOMAIN_ID"] = str(random.randint(1, 100))  # no other robot in the picture
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    for name in args.names or PLACES:
        picture = args.into.absolute() / f"{name}.png" if args.into else PLACES[name]
        with tempfile.TemporaryDirectory(prefix="onebot-pictures-") as folder:
            _MAKERS[name](picture, Path(folder))
        print(f"{name}: {picture}")
    return 0


def make_onebot(picture: Path, folder: Path) -> None:
    """OneBot mid-drive, with its trails and its speeds."""
    rrd = folder / "onebot.rrd"
    with ExitStack() as drivers:  # the last one drives on until the robot is gone
        with running("onebot_bringup", "viewer:=none", f"save:={rrd}", ready="driving robot"):
            for linear, angular, seconds in DRIVE:
                before = drivers.pop_all()
                drivers.enter_context(running("onebot", *driving(linear, angular), ready="#1"))
                before.close()  # only now, so that the robot does not stop between two
                time.sleep(seconds)
    run("onebot", "snapshot", str(picture), str(rrd), "--dashboard")


def make_mrm(picture: Path, folder: Path) -> None:
    """MRM turning, with the plot of its joint over most of a swing."""
    rrd = folder / "mrm.rrd"
    with running("mrm_bringup", "viewer:=none", f"save:={rrd}", ready="showing"):
        time.sleep(17.0)
    run("onebot", "snapshot", str(picture), str(rrd), "--dashboard")


def make_gallery(picture: Path, folder: Path) -> None:
    """OneBot driven through the maze, with what it senses there, as the viewer shows it."""
    rrd = folder / "gallery.rrd"
    maze = ("world:=maze", "sensors_enabled:=true", "viewer:=none", f"save:={rrd}")
    with running("onebot_bringup", *maze, ready="showing"), ExitStack() as drivers:
        for linear, angular, seconds in ((0.25, 0.0, 4.0), (0.2, 0.4, 3.0)):
            before = drivers.pop_all()
            drivers.enter_context(running("onebot", *driving(linear, angular), ready="#1"))
            before.close()
            time.sleep(seconds)
    camera = ("--camera", "-0.3,-1.3,1.6:1.2,0.35,0.0")
    run("onebot", "snapshot", str(picture), str(rrd), "--dashboard", *camera)


def make_steering(picture: Path, folder: Path) -> None:
    """The steering page in a browser, while its joystick drives OneBot through the maze."""
    sys.path.insert(0, str(CHECKOUT))
    from tests.steering_browser_support import Page
    from tests.support import wait_for
    from tests.support_browser import browser

    maze = ("world:=maze", "sensors_enabled:=true")
    words = (*maze, "steer:=true", "port:=0", "viewer:=web")
    address = re.compile(r"\[steering_page\].* open (http\S+)")
    with (
        running("onebot_bringup", *words, ready=address.search) as output,
        browser(folder / "profile") as driver,
    ):
        found = address.search(output())
        assert found
        page = Page(driver)
        page.emulate(*SCREEN, prefers_color_scheme="dark")
        page.open(found[1])
        wait_for(lambda: view_is_drawn(driver.get_screenshot_as_png()), "the robot's view", 180.0)
        wait_for(lambda: not page.find("#slow").is_displayed(), "the note to go", 180.0)
        # Software draws the live view late: the trail says that it has come so far.
        page.drive_until(
            lambda: page.hold_pad(-0.03, 0.2),
            page.let_go,
            lambda: trail_is_drawn(driver.get_screenshot_as_png()),
            "the trail",
        )
        picture.write_bytes(driver.get_screenshot_as_png())
        page.let_go()


def view_is_drawn(png: bytes) -> bool:
    """Return whether OneBot's orange and its white shell are seen."""
    from tests.support_rendering import colored, pixels

    image = pixels(png)
    return bool(colored(image, ORANGE).sum() > 30 and (image.min(axis=2) > 200).sum() > 500)


def trail_is_drawn(png: bytes) -> bool:
    """Return whether a good part of the trail of the truth is seen."""
    from tests.support_rendering import colored, pixels

    return bool(colored(pixels(png), TRAIL).sum() > 500)


def driving(linear: float, angular: float) -> tuple[str, ...]:
    """Return the command that publishes a Twist, m/s and rad/s, at 50 Hz."""
    twist = f"{{linear: {{x: {linear}}}, angular: {{z: {angular}}}}}"
    return ("topic", "pub", "-r", "50", TOPIC, "geometry_msgs/msg/Twist", twist)


def command(program: str, *words: str) -> list[str]:
    """Run a program of this checkout, installed or not."""
    return [sys.executable, "-u", "-m", _MODULES[program], *words]


def run(program: str, *words: str) -> None:
    """Run a command to its end.

    Raises:
        CalledProcessError: it failed.
    """
    subprocess.run(command(program, *words), check=True, stdout=subprocess.DEVNULL, cwd=CHECKOUT)


@contextmanager
def running(
    program: str, *words: str, ready: str | Callable[[str], object], patience: float = 90.0
) -> Iterator[Callable[[], str]]:
    """Run a command meanwhile, from when its output is ``ready`` on; Ctrl-C ends it.

    Yields:
        A function that returns all it has printed.
    """
    with tempfile.NamedTemporaryFile("r") as log, open(log.name, "w") as written:
        process = subprocess.Popen(
            command(program, *words),
            stdout=written,
            stderr=subprocess.STDOUT,
            cwd=CHECKOUT,
            start_new_session=True,
        )

        def output() -> str:
            return Path(log.name).read_text()

        is_ready = ready if callable(ready) else lambda text: str(ready) in text
        try:
            deadline = time.monotonic() + patience
            while not is_ready(output()):
                if process.poll() is not None or time.monotonic() > deadline:
                    raise RuntimeError(f"{program} did not come up:\n{output()}")
                time.sleep(0.1)
            yield output
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)
            process.wait(180.0)


_MAKERS: dict[str, Callable[[Path, Path], None]] = {
    "onebot": make_onebot,
    "mrm": make_mrm,
    "steering": make_steering,
    "gallery": make_gallery,
}


if __name__ == "__main__":
    sys.exit(main())
