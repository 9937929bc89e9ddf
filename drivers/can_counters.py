"""Health counters of the CAN driver: their names, and their places in `Driver.counters`."""

from __future__ import annotations

COUNTER_NAMES = (
    "frames_received",  # sensor frames that were used
    "frames_sent",  # frames that the interface took
    "lost",  # gaps in sequence counters, once they are too old to be reordered frames
    "repeated",  # the counter of a frame that was used already
    "reordered",
    "garbage",  # a counter that jumps, and no frame goes on from there
    "counter_restarts",  # a counter that begins elsewhere, and goes on from there
    "late",  # more than one and a half nominal periods after the one before
    "checksum_errors",
    "wrong_length",
    "unknown_frames",  # passed the filters, but are no message of the DBC (remote frames, multiplexers)
    "foreign_commands",  # another node sends our commands
    "deferred",  # commands held back because too many were waiting for the bus
    "unconfirmed",  # times that commands did not leave the bus
    "no_buffers",  # transmit queue full
    "send_errors",
    "receive_errors",
    "interface_down",
    "reopened",
    "error_frames",
    "error_warning",
    "error_passive",
    "bus_off",
    "restarted",
    "ack_errors",
    "overflows",  # of the controller's buffers
    "clock_steps",
)

(
    FRAMES_RECEIVED,
    FRAMES_SENT,
    LOST,
    REPEATED,
    REORDERED,
    GARBAGE,
    COUNTER_RESTARTS,
    LATE,
    CHECKSUM_ERRORS,
    WRONG_LENGTH,
    UNKNOWN_FRAMES,
    FOREIGN_COMMANDS,
    DEFERRED,
    UNCONFIRMED,
    NO_BUFFERS,
    SEND_ERRORS,
    RECEIVE_ERRORS,
    INTERFACE_DOWN,
    REOPENED,
    ERROR_FRAMES,
    ERROR_WARNING,
    ERROR_PASSIVE,
    BUS_OFF,
    RESTARTED,
    ACK_ERRORS,
    OVERFLOWS,
    CLOCK_STEPS,
) = range(len(COUNTER_NAMES))
