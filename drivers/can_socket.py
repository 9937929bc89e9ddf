"""Frames from a SocketCAN socket, with what python-can leaves out: which of them this very socket has sent.

The kernel tells it by MSG_CONFIRM. MSG_DONTROUTE, all that python-can looks at, is set for the frames of
every program on this computer. One system call a frame, and deaf to steps of the wall clock.
"""

from __future__ import annotations

import select
import socket
import struct
from typing import NamedTuple

import can

EFF_FLAG, RTR_FLAG, ERR_FLAG = 0x80000000, 0x40000000, 0x20000000
EFF_MASK, SFF_MASK = 0x1FFFFFFF, 0x7FF
FD_SIZE = 72
BRS, ESI = 0x01, 0x02
OURS, HERE = int(socket.MSG_CONFIRM), int(socket.MSG_DONTROUTE)
"""Flags of `recvmsg` as plain numbers: those of the module are enumerations, a microsecond each."""
HEADER = struct.Struct("=IBB2x")
STAMP = struct.Struct("@ll")
STAMP_SPACE = socket.CMSG_SPACE(STAMP.size)


class Frame(NamedTuple):
    """One frame: `message.is_rx` is False for those of this socket, `here` is True for this computer's."""

    message: can.Message
    here: bool


def receive(raw: socket.socket, timeout: float) -> Frame | None:
    """The next frame; None if there is none within `timeout` s.

    Raises:
        OSError: The interface fails; EAGAIN where another reader was faster.
    """
    if timeout > 0.0 and not select.select([raw], [], [], timeout)[0]:
        return None
    frame, ancillary, flags, _ = raw.recvmsg(FD_SIZE, STAMP_SPACE)
    return Frame(unpack(frame, ancillary[0][2] if ancillary else b"", flags), bool(flags & HERE))


def unpack(frame: bytes, stamp: bytes, flags: int) -> can.Message:
    """A `struct can_frame` or `canfd_frame` with its SO_TIMESTAMPNS and the flags of `recvmsg`."""
    word, length, bits = HEADER.unpack_from(frame)
    extended = bool(word & EFF_FLAG)
    seconds, nanoseconds = STAMP.unpack_from(stamp) if len(stamp) >= STAMP.size else (0, 0)
    return can.Message(
        timestamp=seconds + nanoseconds * 1e-9,
        arbitration_id=word & (EFF_MASK if extended else SFF_MASK),
        is_extended_id=extended,
        is_remote_frame=bool(word & RTR_FLAG),
        is_error_frame=bool(word & ERR_FLAG),
        is_fd=len(frame) == FD_SIZE,
        is_rx=not flags & OURS,
        bitrate_switch=len(frame) == FD_SIZE and bool(bits & BRS),
        error_state_indicator=len(frame) == FD_SIZE and bool(bits & ESI),
        dlc=length,
        data=frame[8 : 8 + length],
    )
