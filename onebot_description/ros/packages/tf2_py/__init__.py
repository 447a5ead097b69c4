"""tf2's transform buffer, as in the package tf2_py, based on the buffer of OneBot's own nodes."""

from tf2_py._tf2_py import BufferCore as BufferCore
from tf2_py._tf2_py import ConnectivityException as ConnectivityException
from tf2_py._tf2_py import ExtrapolationException as ExtrapolationException
from tf2_py._tf2_py import InvalidArgumentException as InvalidArgumentException
from tf2_py._tf2_py import LookupException as LookupException
from tf2_py._tf2_py import TimeoutException as TimeoutException
from tf2_py._tf2_py import TransformException as TransformException
