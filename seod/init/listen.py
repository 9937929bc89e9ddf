"""Two seconds on a CAN interface: which frames come, and how often. Nothing is sent."""

from __future__ import annotations

import time
from collections import defaultdict

from seod.init.signals import InitError

LISTEN_S = 2.0


def heard(interface: str, channel: str, duration: float = LISTEN_S) -> dict[int, float]:
    """Rate of each frame by its identifier [Hz].

    Args:
        interface: Of python-can, such as `socketcan`.
        channel: Such as `can0`.
        duration: How long to listen [s].

    Raises:
        InitError: The interface cannot be opened.
    """
    import can  # noqa: PLC0415 - only where a bus is listened to

    times: dict[int, list[float]] = defaultdict(list)
    try:
        with can.Bus(channel=channel, interface=interface) as bus:
            end = time.monotonic() + duration
            while (left := end - time.monotonic()) > 0.0:
                frame = bus.recv(left)
                if frame is not None and not frame.is_error_frame:
                    times[frame.arbitration_id].append(frame.timestamp)
    except (can.CanError, OSError, ValueError) as error:
        raise InitError(f"{interface} {channel}: cannot be listened to: {error}") from error
    return {
        identifier: (len(each) - 1) / (each[-1] - each[0]) if len(each) > 1 else 1.0 / duration
        for identifier, each in times.items()
    }
