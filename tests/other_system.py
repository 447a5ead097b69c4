"""Makes a Python on Linux lack what Windows lacks, and macOS in part: for the tests."""

# What is absent there of what the half without ROS would use; mypy looks for the rest
# (test_other_systems).
LACKS = {
    "os": ("memfd_create", "fork", "killpg", "getuid", "O_NONBLOCK", "O_CLOEXEC", "statvfs"),
    "signal": ("SIGXCPU", "SIGHUP", "SIGCONT"),
    "resource": None,
    "fcntl": None,
}
ROS = "rclpy builtin_interfaces std_msgs sensor_msgs geometry_msgs nav_msgs rosidl_parser".split()
SITECUSTOMIZE = f"""
import importlib, os, sys

import psutil  # Rerun's, which refuses a platform that it does not know
for name, absent in {LACKS!r}.items():
    if absent is None:
        sys.modules[name] = None  # its import fails
    else:
        module = importlib.import_module(name)
        for attribute in absent:
            delattr(module, attribute)
for name in {ROS!r}:
    sys.modules[name] = None
sys.platform = "other"


def audit(event, arguments):
    if event in ("open", "os.listdir", "os.scandir") and str(arguments[0]).startswith("/proc"):
        raise FileNotFoundError(2, "there is no /proc", str(arguments[0]))


sys.addaudithook(audit)
"""
