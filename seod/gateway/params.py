"""The parameters that each method of the protocol takes, checked strictly, and errors that name them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from seod.config.units import KNOWN, parse_quantity
from seod.protocol.jsonrpc import INVALID_PARAMS, RpcError, hint

if TYPE_CHECKING:
    from collections.abc import Mapping

TOPICS = ("estimate", "sample", "event", "health", "model_error")
Topic = Literal["estimate", "sample", "event", "health", "model_error"]

_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
_Finite = Annotated[float, Field(allow_inf_nan=False)]


class Params(BaseModel):
    """Parameters by name; this one takes none."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class AxisParams(Params):
    """`axis`: left out means all axes for commands, and the only one for `get` and `set`."""

    axis: str | None = None


class EstopParams(Params):
    """None; and none that is given by mistake keeps an e-stop from being carried out."""

    model_config = ConfigDict(extra="ignore")


class SubscribeParams(Params):
    """What to send: `axes` left out means all, `rate_hz` left out means everything."""

    topics: Annotated[list[Topic], Field(min_length=1)]
    axes: Annotated[list[str], Field(min_length=1)] | None = None
    rate_hz: _Positive | None = None
    """At most this many samples and estimates a second, for each axis."""


class UnsubscribeParams(Params):
    """The number that `subscribe` gave."""

    subscription: int


class SetParams(AxisParams):
    """New values, see README: of the relay, of velocity mode, and of the estimator."""

    e_a: _Positive | None = None
    hysteresis: _NonNegative | None = None
    bias: _Finite | None = None
    K_L: _Positive | None = None
    two_phase: bool | None = None
    """Whether the relay's phase alternates, so that K_L and the delay come out as well."""
    reference: _Finite | None = None
    """Velocity mode: the speed about which it oscillates [axis unit/s]."""
    trim: bool | None = None
    """Velocity mode: whether the bias is corrected."""
    method: str | None = None

    def values(self) -> dict[str, Any]:
        """Those that were given."""
        return self.model_dump(exclude={"axis"}, exclude_none=True)


class DriveParams(AxisParams):
    """An open-loop voltage for a while, for calibration; the axis' bias is added."""

    volts: _Finite
    duration: _Positive
    """[s]"""
    stay: bool = False
    """Hold it where the drive has brought it, not where it began."""
    tones: list[Annotated[list[_Finite], Field(min_length=3, max_length=3)]] = Field(
        default=[], max_length=60
    )
    """[frequency in Hz, amplitude in V, phase in rad] each, for a steady voltage; clipped at `volts`."""


class RecordParams(Params):
    """`on`: whether to record."""

    on: bool


class AuthenticateParams(Params):
    """`token`: one of the rig file's."""

    token: str


def in_si(params: object, units: Mapping[str, str]) -> object:
    """Settings that are text with a unit, such as `400 mV`, as numbers in SI.

    Args:
        params: As they came.
        units: SI unit of each setting of the axis.

    Raises:
        RpcError: INVALID_PARAMS; a unit is of another dimension than the setting.
    """
    if not isinstance(params, dict):
        return params
    told = dict(params)
    for name, unit in units.items():
        if isinstance(value := told.get(name), str):
            try:
                told[name] = parse_quantity(value, KNOWN[unit][0])
            except ValueError as error:
                raise RpcError(INVALID_PARAMS, f"{name}: {error}") from None
    return told


P = TypeVar("P", bound=Params)


def read_params(model: type[P], params: object) -> P:
    """Check parameters.

    Raises:
        RpcError: INVALID_PARAMS; the message names each wrong parameter and what would be right.
    """
    if not isinstance(params, dict):
        raise RpcError(INVALID_PARAMS, 'params go by name: {"axis": ...}')
    try:
        return model.model_validate(params)
    except ValidationError as error:
        sentences = [_sentence(dict(each), model) for each in error.errors(include_url=False)]
        raise RpcError(INVALID_PARAMS, "; ".join(sentences[:5])) from None


def _sentence(error: dict[str, Any], model: type[Params]) -> str:
    name = ".".join(str(part) for part in error["loc"])[:60]
    if error["type"] == "missing":
        return f"{name}: required"
    if error["type"] == "extra_forbidden":
        return f"{name}: no such parameter{hint(name, model.model_fields) if model.model_fields else ''}"
    what = str(error["msg"]).removeprefix("Input ")
    return f"{name}: {what}" + ("" if name == "token" else f", got {repr(error['input'])[:40]}")
