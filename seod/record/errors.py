"""What can be wrong with a log of the bus."""

from __future__ import annotations


class BusLogError(Exception):
    """The bus cannot be logged; the message says why."""
