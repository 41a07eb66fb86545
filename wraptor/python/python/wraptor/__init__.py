"""Host library and simulator of a robot hand (docs/python.md)."""

from . import sim
from ._errors import CallError, CallTimeout, ConnectError, InvalidArgument
from ._wraptor import Bus, Feedback, Hand, RealTime, Statistics, __version__, discover

__all__ = [
    "Bus",
    "CallError",
    "CallTimeout",
    "ConnectError",
    "Feedback",
    "Hand",
    "InvalidArgument",
    "RealTime",
    "Statistics",
    "__version__",
    "discover",
    "sim",
]
