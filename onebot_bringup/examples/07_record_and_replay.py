"""Records a drive of OneBot into a new folder, a rosbag2, and converts it to a file for Rerun.

Run it with `python 07_record_and_replay.py`. Then `onebot replay FOLDER` shows it. To drive
yourself, run `onebot_bringup steer:=true record:=FOLDER`; Ctrl-C ends the drive.
"""

import signal
import subprocess
import time

FOLDER = time.strftime("drive-%H%M%S")  # A recording needs a folder that does not exist.
TWIST = "{linear: {x: 0.3}, angular: {z: 0.3}}"


def run(*words: str) -> None:
    """Run a command to its end."""
    subprocess.run(words, check=True)


with subprocess.Popen(["onebot_bringup", "viewer:=none", f"record:={FOLDER}"]) as robot:
    try:
        # It waits for two subscribers, the controller and the recorder, and publishes for 3 s.
        publish = "onebot topic pub -w 2 -r 50 -t 150 -p 50 /velocity_controller/cmd_vel"
        run(*publish.split(), "geometry_msgs/msg/Twist", TWIST)
    finally:
        robot.send_signal(signal.SIGINT)  # Ctrl-C does the same

run("onebot", "bag", "info", FOLDER)
run("onebot", "replay", FOLDER, "viewer:=none", f"save:={FOLDER}.rrd")
