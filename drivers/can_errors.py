"""Error frames of SocketCAN (`linux/can/error.h`): what the controller says about the bus and itself."""

from __future__ import annotations

from typing import NamedTuple

ERR_CONTROLLER = 0x004
ERR_ACK = 0x020
ERR_BUS_OFF = 0x040
ERR_RESTARTED = 0x100

CONTROLLER_OVERFLOW = 0x03  # data[1]: receive, transmit buffer
CONTROLLER_WARNING = 0x0C  # receive, transmit error counter at 96
CONTROLLER_PASSIVE = 0x30  # receive, transmit error counter at 128
CONTROLLER_ACTIVE = 0x40  # back below both


class BusEvent(NamedTuple):
    """What one error frame says; several may hold."""

    bus_off: bool
    restarted: bool
    ack_missing: bool
    warning: bool
    passive: bool
    overflow: bool


def bus_event(classes: int, data: bytes | bytearray) -> BusEvent:
    """Decode an error frame.

    Args:
        classes: Its identifier without the flags.
        data: Its data; shorter ones than 8 bytes are taken as if followed by zeros.
    """
    controller = data[1] if classes & ERR_CONTROLLER and len(data) > 1 else 0
    return BusEvent(
        bus_off=bool(classes & ERR_BUS_OFF),
        restarted=bool(classes & ERR_RESTARTED or controller & CONTROLLER_ACTIVE),
        ack_missing=bool(classes & ERR_ACK),
        warning=bool(controller & CONTROLLER_WARNING),
        passive=bool(controller & CONTROLLER_PASSIVE),
        overflow=bool(controller & CONTROLLER_OVERFLOW),
    )
