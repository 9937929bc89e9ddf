"""A token as a field of the rig file: long enough, and written out only among the daemon's processes."""

from __future__ import annotations

from typing import Annotated, Final

from pydantic import AfterValidator, PlainSerializer, SecretStr, SerializationInfo, WithJsonSchema

LEAST = 16
"""Characters of a token: with letters and digits more than anyone can try out."""
FILL = "x"
"""Stands for each character of a token where a rig file is written for others to read."""
CREDENTIALS: Final = "$CREDENTIALS_DIRECTORY/"
"""A path that begins so is one of systemd's credentials of the unit."""
WITH_TOKENS: Final = {"tokens": True}
"""Context of `model_dump_json` by which the daemon's processes hand a configuration on among themselves."""


def _written(token: SecretStr, info: SerializationInfo) -> str:
    return token.get_secret_value() if info.context == WITH_TOKENS else FILL * LEAST


def _long_enough(token: SecretStr) -> SecretStr:
    if len(token) < LEAST:
        raise ValueError(f"must have at least {LEAST} characters")
    return token


Token = Annotated[
    SecretStr,
    AfterValidator(_long_enough),
    PlainSerializer(_written, when_used="unless-none"),
    WithJsonSchema({"type": "string", "minLength": LEAST}),
]
