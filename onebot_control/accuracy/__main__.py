"""``python -m onebot_control.accuracy``."""

import sys

from onebot_control.accuracy.command import main

sys.exit(main(sys.argv[1:]))
