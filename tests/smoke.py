"""Both robots come up and are recorded, OneBot is drawn, and the README's test of a node passes.

``python tests/smoke.py FOLDER`` runs the commands of its own environment, in FOLDER: the wheel and
pytest are in it, as in the workflow that the README shows.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

from readme import CHECKOUT, README, run_until_up

from onebot_description.ros.domains import claimed_domain

ROBOTS = ("mrm", "onebot")
DRAWN = CHECKOUT / "onebot_description/urdf/onebot.urdf.xacro"
_PNG = b"\x89PNG"


def main() -> int:
    """Run the smoke test."""
    folder = Path(sys.argv[1])
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    with claimed_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        for name in ROBOTS:
            _bring_up(name, folder)
        _draw(folder)
    _test_a_node(folder)
    return 0


def _bring_up(name: str, folder: Path) -> None:
    recording = folder / f"{name}.rrd"
    command = f"{name}_bringup viewer:=none save:={recording}"
    print(f"$ {command}", flush=True)
    code, output = run_until_up(command, folder)
    if code or "Traceback" in output:
        raise SystemExit(f"{command}: exit code {code}, or a traceback")
    if recording.stat().st_size < 10_000:
        raise SystemExit(f"{recording} holds {recording.stat().st_size} bytes")


def _draw(folder: Path) -> None:
    picture = folder / "onebot.png"
    size = ["--width", "320", "--height", "240"]  # Mesa draws it with processors
    command = ["onebot", "snapshot", str(picture), str(DRAWN), *size]
    print(f"$ {' '.join(command)}", flush=True)
    done = subprocess.run(command, cwd=folder, timeout=600, stderr=subprocess.PIPE, text=True)
    if "Traceback" in done.stderr:
        raise SystemExit(done.stderr)
    if sys.version_info < (3, 11):
        # Rerun's last release for 3.10 draws nothing without a window; one line has to say so.
        if done.returncode != 1 or "3.11" not in done.stderr:
            raise SystemExit(f"exit code {done.returncode}: {done.stderr}")
    elif done.returncode or not picture.read_bytes().startswith(_PNG):
        raise SystemExit(f"exit code {done.returncode}: {done.stderr}")


def _test_a_node(folder: Path) -> None:
    [code] = re.findall(
        r"\*test_stopper\.py\*.*?```python\n(.*?)```", README.read_text(), re.DOTALL
    )
    (folder / "test_stopper.py").write_text(code)
    subprocess.run([sys.executable, "-m", "pytest"], cwd=folder, timeout=600, check=True)


if __name__ == "__main__":
    sys.exit(main())
