"""The plant's parameters from recordings under any voltage."""

from seod.identify.answer import Result, identify
from seod.identify.record import IdentifyError, Record

__all__ = ["IdentifyError", "Record", "Result", "identify"]
