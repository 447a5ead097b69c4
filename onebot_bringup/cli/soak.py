"""``onebot soak``: a robot drives for long while faults are injected; a verdict at the end."""

import argparse
import os
import random
import tempfile
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

from onebot_bringup.cli.options import Parser, count, not_negative, positive
from onebot_bringup.cli.session import Session
from onebot_bringup.introspection.domains import claimed_domain
from onebot_bringup.soak.faults import FAULTS, GENTLE, NETWORK, possible, shuffled
from onebot_bringup.soak.network import enter_own_network
from onebot_bringup.soak.watch import Tolerances, Watch, clock
from onebot_bringup.soak.watched_bringup import WatchedBringup
from onebot_description.errors import OneBotError
from onebot_description.shared_memory import remove_stale_in_background

_GENTLE = 0.6  # of the time with faults that leave all processes running: leaks show
_PROGRESS = 30.0  # s


def run(argv: Sequence[str]) -> int:
    """Run the command; return 0 if nothing was found, else 1.

    Raises:
        UsageError: the command line is wrong.
    """
    parser = Parser("onebot soak", "drive a robot for long, inject faults, and judge what happens")
    parser.add_argument("--minutes", type=positive, default=30.0, metavar="M", help="30")
    parser.add_argument("--robots", type=count, default=1, metavar="N", help="1")
    parser.add_argument("--seed", type=int, default=1, help="of faults and commands (1)")
    parser.add_argument("--every", type=not_negative, default=15.0, metavar="S",
                        help="seconds of driving between two faults (15)")  # fmt: skip
    parser.add_argument("--fault", action="append", choices=FAULTS, metavar="FAULT",
                        help=f"only this one, or several: {', '.join(FAULTS)}")  # fmt: skip
    parser.add_argument("--patience", type=positive, default=1.0, metavar="FACTOR",
                        help="for what is to happen in time, on a slow machine (1)")  # fmt: skip
    parser.add_argument("--log", type=Path, metavar="FILE", help="for the output of the bringups")
    parser.add_argument("arguments", nargs="*", metavar="name:=value", help="of onebot_bringup")
    args = parser.parse(argv)
    with claimed_domain() as domain, tempfile.TemporaryDirectory(prefix="onebot-soak-") as folder:
        own_network = enter_own_network()
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        # Within one host alone, rmw has DDS use shared memory, which cannot be cut.
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET" if own_network else "LOCALHOST"
        watch = Watch(Tolerances(gap=args.patience, warm_up=min(60.0, 12.0 * args.minutes)))
        with Session(args.ros_args) as session:
            robot = WatchedBringup(
                session, watch, Path(folder), args.arguments,
                robots=args.robots, seed=args.seed, patience=args.patience, log=args.log,
            )  # fmt: skip
            injected = _soak(robot, args, own_network)
            print(_verdict(robot, injected, args.seed), flush=True)
    return 1 if watch.findings else 0


def _soak(robot: WatchedBringup, args: argparse.Namespace, own_network: bool) -> int:
    """Drive and inject faults until the time is over, or Ctrl-C; return how many there were."""
    injected, reported = 0, 0.0
    try:
        robot.start()
        gentle, everything = _draws(robot, args, own_network)
        seconds, began = 60.0 * args.minutes, robot.now
        while (passed := robot.now - began) < seconds:
            known = len(robot.watch.findings)
            robot.run_for(min(args.every, seconds - passed))
            for name in islice(gentle if passed < _GENTLE * seconds else everything, 1):
                _inject(robot, name)
                injected += 1
            for finding in list(robot.watch.findings.values())[known:]:
                print(f"  found at {finding}", flush=True)
            if robot.now - reported > _PROGRESS:
                reported = robot.now
                robot.report(f"of {clock(seconds)}: {_progress(robot, injected)}")
    except KeyboardInterrupt:
        print("stopping; the verdict so far:", flush=True)
    except OneBotError as error:
        robot.find(str(error))
    finally:
        robot.stop()
    robot.watch.judge_growth()
    remove_stale_in_background().join(1.0)
    return injected


def _draws(
    robot: WatchedBringup, args: argparse.Namespace, own_network: bool
) -> tuple[Iterator[str], Iterator[str]]:
    """Return the faults that leave all processes running, or those chosen, and all; in turn."""
    wanted = set(args.fault or FAULTS)
    names = possible(wanted, [*robot.nodes, *[NETWORK] * own_network])
    robot.report(f"faults: {', '.join(sorted(names))}")
    if left_out := wanted - names:
        robot.report(f"not possible here: {', '.join(sorted(left_out))}")
    chance = random.Random(args.seed)
    everything = shuffled(names, chance)
    if args.fault or not names & set(GENTLE):
        return everything, everything
    return shuffled(names & set(GENTLE), chance), everything


def _inject(robot: WatchedBringup, name: str) -> None:
    before, began = robot.watch.count, robot.now
    FAULTS[name].inject(robot)
    result = "ok" if robot.watch.count == before else "not as it should be"
    robot.report(f"{name} ({robot.now - began:.0f} s): {result}")


def _progress(robot: WatchedBringup, injected: int) -> str:
    now, found = robot.watch.used_now(), len(robot.watch.findings)
    memory, handles = sum(each["memory"] for each in now), sum(each["handles"] for each in now)
    return (
        f"{injected} faults, {found} findings; {len(now)} processes with {memory:.0f} MB "
        f"and {handles:.0f} handles"
    )


def _verdict(robot: WatchedBringup, injected: int, seed: int) -> str:
    watch = robot.watch
    lines = [f"{clock(robot.now)} with seed {seed}: {injected} faults, {robot.starts} starts"]
    if robot.machine_busy:
        lines.append(
            f"  for {robot.machine_busy:.0f} s rates were not judged: no processor was free"
        )
    lines += [*watch.report(), *map(str, watch.findings.values())]
    result = f"FAIL: {len(watch.findings)} findings" if watch.findings else "PASS"
    return "\n".join([*lines, result])
