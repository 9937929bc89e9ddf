"""python-can without what it drags along: where asammdf is installed it imports that, and pandas with it.

Neither is for a real-time process, whose memory is locked, nor for a daemon that should start at once.
"""

from __future__ import annotations

import sys
from importlib import import_module


def import_light() -> None:
    """Import python-can now, in this process without its MF4 files; does nothing if it is there already."""
    if "can" in sys.modules or "asammdf" in sys.modules:
        return
    sys.modules["asammdf"] = None  # type: ignore[assignment]  # the language's way to say: not to be imported
    try:
        import_module("can")
    finally:
        del sys.modules["asammdf"]
