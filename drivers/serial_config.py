"""The rig file's `driver:` section for a board on a serial line. Plain SI numbers."""

from __future__ import annotations

import struct
from collections import Counter
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]

CODES = {"int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f"}
"""Types of a block's fields -> their code in `struct` and in a board's HELLO."""

LARGEST_BLOCK = 238
"""Bytes of inputs or outputs that one frame can carry."""

OWN_FIELDS = ("time", "sequence", "status", "ack", "age")
"""Fields of an ASCII line that are no inputs."""


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)


class FieldOptions(_Section):
    """One quantity of a block: value = number on the line times `scale`, plus `offset`."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_.-]{0,31}$")]
    """Name of the channel."""
    type: Literal["int8", "uint8", "int16", "uint16", "int32", "uint32", "float32"] = "float32"
    """On a binary line; in the ASCII form numbers are as they are written."""
    scale: Finite = 1.0
    """What one count is [`unit`]."""
    offset: Finite = 0.0
    """Value at count 0 [`unit`]."""
    unit: str = ""
    """Unit of the channel; none: a bare number."""

    @property
    def code(self) -> str:
        """Of its type."""
        return CODES[self.type]

    @property
    def numbers(self) -> tuple[float, float]:
        """Smallest and largest number on the line."""
        if self.type == "float32":
            return -3.4e38, 3.4e38
        bits = 8 * struct.calcsize("<" + self.code)
        if self.code.isupper():
            return 0.0, 2.0**bits - 1.0
        return -(2.0 ** (bits - 1)), 2.0 ** (bits - 1) - 1.0

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest value [unit] that it can carry."""
        ends = [number * self.scale + self.offset for number in self.numbers]
        return min(ends), max(ends)

    @model_validator(mode="after")
    def _has_a_scale(self) -> FieldOptions:
        if self.scale == 0.0:
            raise ValueError("scale must not be 0: every number would mean the same")
        if self.name in OWN_FIELDS:
            raise ValueError(f"a channel cannot be named {self.name!r}: that is a field of the line itself")
        return self


class SerialOptions(_Section):
    """A board on a serial or USB-CDC line (`docs/serial.md`)."""

    kind: Literal["serial"]
    port: Annotated[str, Field(min_length=1)]
    """Best by its stable name, such as `/dev/serial/by-id/usb-...`: it stays the same after replugging."""
    baud: Annotated[int, Field(gt=0)] = 1_000_000
    """[bit/s] USB-CDC ignores it."""
    usb: bool = False
    """The line is USB-CDC: its bit rate limits nothing, and `seod check` leaves the load out."""
    format: Literal["binary", "ascii"] = "binary"
    """Form of the line: frames with a CRC, or lines of text (`docs/serial.md`)."""
    rate_hz: Positive = 2000.0
    """Samples that the board pushes [Hz]."""
    inputs: Annotated[list[FieldOptions], Field(min_length=1)]
    """The block of each sample, in its order."""
    outputs: Annotated[list[FieldOptions], Field(min_length=1)]
    """The block of each command, in its order."""
    fields: list[str] = []
    """ASCII: what is in a line, in its order; left out: time, sequence, then the inputs."""
    checksum: bool = False
    """ASCII: refuse lines without `*hh`."""
    watchdog_s: Positive = 0.05
    """The longest [s] a board may wait for a command before it goes to neutral; a slower one is refused."""
    handshake_s: Positive = 3.0
    """How long the board may take to answer [s] (some restart when the port is opened)."""
    max_in_flight: Annotated[int, Field(ge=1, le=100)] = 16
    """Commands that may wait for the board's acknowledgement; newer ones then replace each other."""
    confirm_timeout_s: Positive = 0.1
    """A command that was not acknowledged after this long [s] is trouble."""

    @property
    def layout(self) -> str:
        """Inputs and outputs in the short form of a board's HELLO."""
        return "/".join("".join(each.code for each in block) for block in (self.inputs, self.outputs))

    @property
    def line(self) -> tuple[str, ...]:
        """Fields of an ASCII line, in order."""
        return tuple(self.fields) or ("time", "sequence", *(each.name for each in self.inputs))

    def has(self, *own: str) -> bool:
        """Whether the board tells all these of `OWN_FIELDS`."""
        return self.format == "binary" or set(own) <= set(self.line)

    @model_validator(mode="after")
    def _names_are_unique(self) -> SerialOptions:
        names = Counter(each.name for each in (*self.inputs, *self.outputs))
        twice = [name for name, count in names.items() if count > 1]
        if twice:
            raise ValueError(f"channel {', '.join(twice)} is there twice")
        for key, block in (("inputs", self.inputs), ("outputs", self.outputs)):
            size = struct.calcsize("<" + "".join(each.code for each in block))
            if size > LARGEST_BLOCK:
                raise ValueError(f"{key} take {size} bytes: a frame carries {LARGEST_BLOCK}")
        return self

    @model_validator(mode="after")
    def _fields_fit(self) -> SerialOptions:
        if self.format == "binary":
            if self.fields or self.checksum:
                raise ValueError("fields and checksum belong to format: ascii")
            return self
        inputs = [each.name for each in self.inputs]
        unknown = [name for name in self.line if name not in (*OWN_FIELDS, *inputs)]
        missing = [name for name in inputs if name not in self.line]
        if unknown or missing or len(set(self.line)) != len(self.line):
            known = ", ".join((*OWN_FIELDS, *inputs))
            raise ValueError(f"fields must hold each input once, and no others than {known}")
        if ("age" in self.line) > ("ack" in self.line) or ("age" in self.line) > ("time" in self.line):
            raise ValueError("fields: age needs ack and time")
        return self
