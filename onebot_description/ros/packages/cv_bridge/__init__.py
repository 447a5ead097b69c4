"""Images as arrays, as in the package cv_bridge, without OpenCV.

``cvtColorForDisplay`` is missing.
"""

from cv_bridge.core import CvBridge as CvBridge
from cv_bridge.core import CvBridgeError as CvBridgeError
from cv_bridge.core import getCvType as getCvType
