"""What a rig file says of one message of the DBC."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

STRICT = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)
"""Of each section: it knows its own keys alone."""
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class MessageOptions(BaseModel):
    """How a message of the DBC proves that it is new and whole.

    What is left out is taken from the DBC: a signal named `counter` is the sequence counter, and a signal
    named `checksum` is the checksum if the message's attribute `ChecksumKind` says of which kind. `null`
    switches either off.
    """

    model_config = STRICT

    counter: str | None = None
    """Signal that counts up by one with each frame and wraps."""
    checksum: str | None = None
    """Signal of one whole byte, over all other bytes of the message."""
    checksum_kind: Literal["xor8", "sum8", "crc8_j1850"] | None = None
    """How it is computed: exclusive or, sum modulo 256, or CRC-8 of SAE J1850."""
    rate_hz: Positive | None = None
    """How often the message should come [Hz]; frames later than one and a half periods are counted."""
