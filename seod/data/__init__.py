"""Measured data of any format: read, looked at, exported."""

from seod.data.open import open_source
from seod.data.problems import Problem
from seod.data.recording import Recording, read
from seod.data.source import ReadError

__all__ = ["Problem", "ReadError", "Recording", "open_source", "read"]
