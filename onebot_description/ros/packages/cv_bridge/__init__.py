"""Pictures as arrays, as the package cv_bridge has them, without OpenCV.

``cvtColorForDisplay`` is not here.
"""

from cv_bridge.core import CvBridge as CvBridge
from cv_bridge.core import CvBridgeError as CvBridgeError
from cv_bridge.core import getCvType as getCvType
