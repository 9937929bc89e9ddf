"""The plant's parameters from recordings under any voltage."""

from seod import callable_room
from seod.identify.answer import Result, identify
from seod.identify.record import IdentifyError, Record, UntoldError

__all__ = ["IdentifyError", "Record", "Result", "UntoldError", "identify"]

callable_room(__name__)
