"""Processors, memory and limits of this computer; where a system has no such thing, nothing is limited."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from types import ModuleType


def _limits() -> ModuleType | None:
    try:
        import resource  # noqa: PLC0415 - not on Windows
    except ImportError:
        return None
    return resource if sys.platform == "linux" else None


RESOURCE = _limits()
"""Limits of this process, on Linux; elsewhere there are none that are told as there, or none at all: None."""


PLATFORM = sys.platform


class NeedsLinuxError(Exception):
    """Something that only Linux has was asked for elsewhere."""


def needs_linux() -> None:
    """What excites a rig asks this first.

    Raises:
        NeedsLinuxError: This is another system.
    """
    if PLATFORM != "linux":
        raise NeedsLinuxError(
            f"this needs Linux, and here is {PLATFORM}: identify, diagnose, response of recordings and "
            "simulate run anywhere"
        )


def processors() -> int:
    """Processors that this process may use."""
    allowed: Any = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed is not None else os.cpu_count() or 1


def memory_bytes() -> float:
    """Memory of this computer; infinite where the system does not tell."""
    ask: Any = getattr(os, "sysconf", None)
    if ask is None:
        return float("inf")
    return float(ask("SC_PHYS_PAGES") * ask("SC_PAGE_SIZE"))
