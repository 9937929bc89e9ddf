"""What an MCAP recording holds, for who writes and who reads it.

Profile `seod`; metadata record `seod` (version, protocol, rig, started, clock, clock_offset_ns, part);
attachments `rig.yaml` (the rig file) and `rig.json` (as it was read, in SI). Channels:

- `/rows/<axis>`: one message a tick, CDR by the schema `ROW_SCHEMA` ("ros2msg"): every message has the bytes
  of `ROW`, so that `decode` is one look at memory and all digits are kept. Undefined is nan.
- `/estimates/<axis>`, `/model_errors/<axis>`, `/events`, `/health`, `/counters`: JSON as on the TCP stream.
  Undefined is null.

Times in messages are CLOCK_MONOTONIC [s]. `log_time` [ns] is `t_tick` (of JSON messages `t`) plus
`clock_offset_ns`: the wall clock, by one offset for a file. `publish_time` of a row is `t_u`, likewise.
The order of the messages in the file is that in which the gateway took them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from seod.processes.ring import AXIS_FIELDS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

PROFILE: Final = "seod"
RIG_FILE: Final = "rig.yaml"
RIG: Final = "rig.json"
"""Names of the attachments."""
ROWS: Final = "/rows/"
ESTIMATES: Final = "/estimates/"
MODEL_ERRORS: Final = "/model_errors/"
EVENTS: Final = "/events"
HEALTH: Final = "/health"
COUNTERS: Final = "/counters"

UNITS: Final = {
    "t": "s, when y was sampled",
    "y": "axis unit (SI): rad or m, in velocity mode per second",
    "reference": "axis unit, set point",
    "u": "V, the command in force after this tick",
    "t_u": "s, when u left",
    "e_a": "V, amplitude of the relay",
    "bias": "V, added behind the relay",
    "signal": "the relay's input",
    "ps": "Pa, supply pressure",
    "temperature": "K",
    "K_L": "axis unit/s/V, gain in force",
}
"""Fields of `seod.processes.ring.AXIS_FIELDS` with unit and meaning."""

MEASURED: Final = ("y", "reference")
"""Fields in the unit of what the axis measures; metadata of the rows' channel tells it."""

ROW: Final = np.dtype(
    [
        ("cdr", "<u4"),
        ("tick", "<i8"),
        ("t_tick", "<f8"),
        ("age", "<f8"),
        *[(name, "<f8") for name in AXIS_FIELDS],
        ("state", "u1"),
        ("flags", "u1"),
    ]
)
"""Bytes of one `/rows/<axis>` message; `cdr` is the encoding's own header."""
CDR_LITTLE_ENDIAN: Final = 0x0100

ROW_SCHEMA_NAME: Final = "seod/msg/Row"
ROW_SCHEMA: Final = "\n".join(
    [
        "# One tick of one axis. Undefined is nan.",
        "uint8 IDLE=0",
        "uint8 ARMED=1",
        "uint8 EXCITING=2",
        "uint8 HOLDING=3",
        "uint8 FAULT=4",
        "uint8 FLAG_EXCITING=1",
        "uint8 FLAG_FRESH=2",
        "uint8 FLAG_LIMITED=4",
        "uint8 FLAG_SATURATED=8",
        "uint8 FLAG_SECOND_PHASE=16",
        "uint8 FLAG_FOREIGN=32",
        "int64 tick",
        "float64 t_tick  # s, when the tick began",
        "float64 age  # s, of the sample at that time",
        *[f"float64 {name.lower()}  # {UNITS[name]}" for name in AXIS_FIELDS],  # ROS knows no capitals
        "uint8 state",
        "uint8 flags",
        "",
    ]
)


def row_dtype(axes: int) -> np.dtype[np.void]:
    """`Shared.row_struct` of the ring as a dtype: tick, tick_t [s], one `axes` record for each axis."""
    axis = [(name, "<f8") for name in AXIS_FIELDS] + [("state", "<i8"), ("flags", "<i8")]
    return np.dtype([("tick", "<i8"), ("tick_t", "<f8"), ("axes", axis, (axes,))])


def encode(rows: NDArray[np.void], axis: int) -> NDArray[np.void]:
    """Messages (dtype `ROW`) of one axis, by its number, for rows of dtype `row_dtype`."""
    out = np.zeros(len(rows), ROW)
    of_axis = rows["axes"][:, axis]
    out["cdr"] = CDR_LITTLE_ENDIAN
    out["tick"], out["t_tick"] = rows["tick"], rows["tick_t"]
    for name in (*AXIS_FIELDS, "state", "flags"):
        out[name] = of_axis[name]
    out["age"] = out["t_tick"] - out["t"]
    return out


def decode(messages: Sequence[bytes]) -> NDArray[np.void]:
    """Rows of one axis (dtype `ROW`) from the data of its messages.

    Raises:
        ValueError: Their length is not that of `ROW`.
    """
    if any(len(message) != ROW.itemsize for message in messages):
        raise ValueError(f"a row of this version has {ROW.itemsize} bytes")
    return np.frombuffer(b"".join(messages), ROW)


def nanoseconds(seconds: NDArray[np.float64], offset_ns: int) -> NDArray[np.int64]:
    """Wall-clock times [ns] of times on the loop's clock [s]."""
    return np.rint(seconds * 1e9).astype(np.int64) + offset_ns
