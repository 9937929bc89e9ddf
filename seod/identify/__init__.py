"""The plant's parameters from recordings under any voltage."""

from seod.identify.answer import Result, identify
from seod.identify.record import IdentifyError, Record, UntoldError

__all__ = ["IdentifyError", "Record", "Result", "UntoldError", "identify"]
