"""Runs the command ``onebot_bringup`` as ``python -m onebot_bringup``."""

import sys

from onebot_bringup.launch.onebot_bringup import main

if __name__ == "__main__":
    sys.exit(main())
