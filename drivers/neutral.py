"""Neutral commands from a process that has nothing of the driver but its recipe (`Driver.neutral_recipe`).

The supervisor uses it when the loop has died or hangs. Standard library only, and nothing ever blocks.
"""

from __future__ import annotations

import errno
import os
import socket
import struct
import termios
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

CAN_EFF_FLAG = 0x80000000
CANFD_BRS, CANFD_FDF = 0x01, 0x04
CLASSIC, FLEXIBLE = struct.Struct("=IB3x8s"), struct.Struct("=IBB2x64s")  # can_frame, canfd_frame
ENOUGH = 2
"""Frames of a cycle after which neutral has left: the next, and the one after a frame not counted."""
GONE = (errno.ENODEV, errno.ENXIO, errno.EBADF)


class NeutralWriter(Protocol):
    """Writes neutral to one rig."""

    def write(self, commands_sent: int) -> str:
        """Send neutral now.

        Args:
            commands_sent: Command frames that the loop had sent; the sequence counter goes on from there.

        Returns:
            "" if it was sent, else why not.
        """

    def close(self) -> None:
        """Give the connection back; may be called twice."""


class NoNeutral:
    """For rigs that no other process can reach."""

    def __init__(self, why: str) -> None:
        self.why = why

    def write(self, commands_sent: int) -> str:  # noqa: ARG002 - part of the protocol
        """Nothing but the reason why not."""
        return self.why

    def close(self) -> None:
        """Nothing is open."""


class SocketcanNeutral:
    """Neutral frames over an own raw socket.

    The whole cycle of sequence counters is sent, beginning with the next: whichever the rig expects is among
    the first, also if the loop died between sending a frame and counting it.
    """

    def __init__(self, channel: str, fd: bool, cycle: list[list[bytes]]) -> None:
        self.channel = channel
        self.fd = fd
        self.cycle = cycle
        self.socket: socket.socket | None = None
        with suppress(OSError):
            self._opened()

    def _opened(self) -> socket.socket:
        if self.socket is None:
            self.socket = _raw_socket(self.channel, self.fd)
        return self.socket

    def write(self, commands_sent: int) -> str:
        """Send the cycle; an interface that was deleted and has come back is taken again."""
        for _ in range(2):
            try:
                return self._send_cycle(self._opened(), commands_sent)
            except OSError as error:
                if self.socket is None or error.errno not in GONE:
                    return f"{self.channel}: {error.strerror}"
                self.close()
        return f"{self.channel} is gone"

    def _send_cycle(self, raw: socket.socket, commands_sent: int) -> str:
        length = len(self.cycle)
        for sent in range(length):
            for frame in self.cycle[(commands_sent + sent) % length]:
                try:
                    raw.send(frame)
                except OSError as error:
                    if error.errno in (errno.ENOBUFS, errno.EAGAIN):
                        if sent >= ENOUGH:
                            return ""
                        return (
                            f"{self.channel}: only {sent} of {length} neutral frames found room in the queue"
                        )
                    raise
        return ""

    def close(self) -> None:
        """Close the socket."""
        if self.socket is not None:
            self.socket.close()
            self.socket = None


class SerialNeutral:
    """Neutral commands over an own handle on a serial port, which the loop has set up already."""

    def __init__(self, port: str, data: bytes) -> None:
        self.port = port
        self.data = data
        self.fd: int | None = None
        with suppress(OSError):
            self._opened()

    def _opened(self) -> int:
        if self.fd is None:
            self.fd = os.open(self.port, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        return self.fd

    def write(self, commands_sent: int) -> str:  # noqa: ARG002 - whichever sequence comes first, one is new
        """Throw away what has not left, then send; a port that has come back is taken again."""
        for _ in range(2):
            try:
                fd = self._opened()
            except OSError as error:
                return f"{self.port}: {error.strerror}"
            try:
                termios.tcflush(fd, termios.TCOFLUSH)
                sent = os.write(fd, self.data)
            except (OSError, termios.error) as error:
                why = f"{self.port}: {error}"
                self.close()
            else:
                return "" if sent == len(self.data) else f"{self.port}: no room for neutral"
        return why

    def close(self) -> None:
        """Close the port."""
        if self.fd is not None:
            os.close(self.fd)
            self.fd = None


def _raw_socket(channel: str, fd: bool) -> socket.socket:
    raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW | socket.SOCK_NONBLOCK, socket.CAN_RAW)
    try:
        raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")  # it never reads
        if fd:
            raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        raw.bind((channel,))
    except OSError:
        raw.close()
        raise
    return raw


def pack_frame(frame: Mapping[str, Any]) -> bytes:
    """One frame of a recipe as the kernel's `struct can_frame` or `struct canfd_frame`."""
    identifier = frame["id"] | (CAN_EFF_FLAG if frame["extended"] else 0)
    data = bytes.fromhex(frame["data"])
    if frame["fd"]:
        flags = CANFD_FDF | (CANFD_BRS if frame["bit_rate_switch"] else 0)
        return FLEXIBLE.pack(identifier, len(data), flags, data)
    return CLASSIC.pack(identifier, len(data), data)


def open_neutral(recipe: Mapping[str, Any]) -> NeutralWriter:
    """The writer for a recipe; an interface that is not there yet is tried again at each write.

    Raises:
        ValueError: A kind of recipe that is not known.
    """
    if recipe["kind"] == "none":
        return NoNeutral(recipe["why"])
    if recipe["kind"] == "serial":
        return SerialNeutral(recipe["port"], bytes.fromhex(recipe["data"]))
    if recipe["kind"] != "socketcan":
        raise ValueError(f"unknown neutral recipe {recipe['kind']!r}")
    cycle = [[pack_frame(frame) for frame in frames] for frames in recipe["frames"]]
    return SocketcanNeutral(recipe["channel"], recipe["fd"], cycle)
