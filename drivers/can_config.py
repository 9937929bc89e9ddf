"""The rig file's `driver:` section for a rig on a CAN bus. Plain SI numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from drivers import can_dbc
from drivers.can_message import STRICT, MessageOptions, Positive


class _Section(BaseModel):
    model_config = STRICT


def _hexadecimal(text: str) -> str:
    try:
        data = bytes.fromhex(text)
    except ValueError as error:
        raise ValueError(f'expected pairs of hexadecimal digits such as "01 7f", got {text!r}') from error
    if len(data) not in can_dbc.FD_LENGTHS:
        raise ValueError(f"a CAN frame cannot have {len(data)} bytes")
    return text


class FrameOptions(_Section):
    """A frame that never changes."""

    id: Annotated[int, Field(ge=0, le=0x1FFFFFFF)]
    """Identifier: up to 0x7ff, or with `extended` up to 0x1fffffff."""
    data: Annotated[str, AfterValidator(_hexadecimal)] = ""
    """Hexadecimal digits: "01 00"."""
    extended: bool = False
    """29-bit identifier."""

    @property
    def payload(self) -> bytes:
        """The data bytes."""
        return bytes.fromhex(self.data)

    @model_validator(mode="after")
    def _check_identifier(self) -> FrameOptions:
        if not self.extended and self.id > 0x7FF:
            raise ValueError(f"id {self.id:#x} needs extended: true (11 bits reach 0x7ff)")
        return self


class HeartbeatOptions(FrameOptions):
    """A frame sent again and again."""

    period_s: Positive
    """Time from one to the next [s]."""


class CanOptions(_Section):
    """A rig on a CAN bus, by python-can and a DBC."""

    kind: Literal["can"]
    interface: str = "socketcan"
    """Any interface of python-can."""
    channel: str
    """Such as `can0`."""
    bitrate: Annotated[int, Field(gt=0)] = 1_000_000
    """[bit/s] For SocketCAN the system sets it (`ip link`); here it serves the bus load."""
    fd: bool = False
    """Whether the bus carries FD frames."""
    data_bitrate: Annotated[int, Field(gt=0)] | None = None
    """[bit/s] Of the data phase of FD frames; none: they go without a bit-rate switch."""
    dbc: str
    """Path of the DBC; relative to the rig file."""
    node: Annotated[str, Field(validate_default=True)] = "seod"
    """Our name in the DBC: the messages that it sends are outputs, all others inputs."""
    bus_options: dict[str, Any] = {}
    """Further arguments of `can.Bus`."""
    messages: dict[str, MessageOptions] = {}
    """Messages of the DBC by name, with what the DBC does not say of them."""
    start_frames: list[FrameOptions] = []
    """Sent once at start and whenever the bus returns, such as CANopen's NMT start."""
    tick_frames: list[FrameOptions] = []
    """Sent at the start of each tick, such as CANopen's SYNC."""
    heartbeat: list[HeartbeatOptions] = []
    """Frames sent again and again, such as CANopen's heartbeat."""
    max_in_flight: Annotated[int, Field(ge=1, le=100)] = 3
    """Command frames per message that may wait for the bus; newer commands then replace each other."""
    confirm_timeout_s: Positive = 0.1
    """A command that has not been on the bus after this long [s] is trouble."""
    echo: bool | None = None
    """Whether the interface hands back our own frames once they are sent; none: by what is known of it."""

    @field_validator("dbc", mode="after")
    @classmethod
    def _find_dbc(cls, value: str, info: ValidationInfo) -> str:
        path = (Path((info.context or {}).get("directory", ".")) / value).resolve()
        if not path.is_file():
            raise ValueError(f"no such file: {path}")
        try:
            can_dbc.load_database(str(path))
        except can_dbc.CodecError as error:
            raise ValueError(str(error)) from error
        return str(path)

    @field_validator("node", mode="after")
    @classmethod
    def _check_node(cls, value: str, info: ValidationInfo) -> str:
        if "dbc" in info.data:
            can_dbc.check_node(info.data["dbc"], value)
        return value

    @field_validator("messages", mode="after")
    @classmethod
    def _check_messages(
        cls, value: dict[str, MessageOptions], info: ValidationInfo
    ) -> dict[str, MessageOptions]:
        if "dbc" in info.data and "node" in info.data:
            problems = can_dbc.message_problems(info.data["dbc"], info.data["node"], value)
            if problems:
                raise ValueError("; ".join(problems))
        return value

    @model_validator(mode="after")
    def _check_fd(self) -> CanOptions:
        if self.fd:
            return self
        if self.data_bitrate is not None:
            raise ValueError("data_bitrate needs fd: true")
        for frame in (*self.start_frames, *self.tick_frames, *self.heartbeat):
            if len(frame.payload) > 8:
                raise ValueError(
                    f"frame {frame.id:#x} has {len(frame.payload)} bytes: more than 8 need fd: true"
                )
        return self
