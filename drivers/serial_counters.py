"""Health counters of the serial driver: their names, and their places in `Driver.counters`."""

from __future__ import annotations

COUNTER_NAMES = (
    "samples",  # that were used
    "commands",  # that the line took
    "lost",  # gaps in the board's sequence
    "repeated",
    "late",  # arrived more than one and a half periods after they were taken
    "crc_errors",  # checksums of lines, too
    "bad_frames",  # that are no COBS, of wrong length or type, or no numbers
    "garbage_bytes",  # thrown away without any end of a frame in them
    "deferred",  # commands held back because too many were waiting
    "unconfirmed",  # times that commands were not acknowledged
    "unplugged",
    "reopened",
    "handshakes",
    "refused",  # boards of another version or layout
    "clock_resets",  # of the board
    "watchdog_trips",  # the board went to neutral by itself while it was commanded
    "board_overruns",  # its sampling timer missed turns
    "board_drops",  # samples that the line was too full for
    "board_errors",  # broken frames from the daemon
)

(
    SAMPLES,
    COMMANDS,
    LOST,
    REPEATED,
    LATE,
    CRC_ERRORS,
    BAD_FRAMES,
    GARBAGE_BYTES,
    DEFERRED,
    UNCONFIRMED,
    UNPLUGGED,
    REOPENED,
    HANDSHAKES,
    REFUSED,
    CLOCK_RESETS,
    WATCHDOG_TRIPS,
    BOARD_OVERRUNS,
    BOARD_DROPS,
    BOARD_ERRORS,
) = range(len(COUNTER_NAMES))
