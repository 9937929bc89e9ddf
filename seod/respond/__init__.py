"""Frequency response of an actuator: what to excite it with, what recordings say, and the fit of Eq. 1."""

from seod.respond.record import RespondError, Segment
from seod.respond.response import Response, respond

__all__ = ["RespondError", "Response", "Segment", "respond"]
