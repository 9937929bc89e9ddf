"""Errors by their SCPI numbers (SCPI-1999, volume 2, chapter 21.8)."""

from __future__ import annotations

from typing import Final

TEXTS: Final = {
    -100: "Command error",
    -101: "Invalid character",
    -102: "Syntax error",
    -104: "Data type error",
    -108: "Parameter not allowed",
    -109: "Missing parameter",
    -113: "Undefined header",
    -131: "Invalid suffix",
    -203: "Command protected",
    -221: "Settings conflict",
    -222: "Data out of range",
    -224: "Illegal parameter value",
    -230: "Data corrupt or stale",
    -241: "Hardware missing",
    -350: "Queue overflow",
    -363: "Input buffer overrun",
}


class ScpiError(Exception):
    """A command is not carried out.

    Args:
        number: One of `TEXTS`.
        more: What is wrong in this case.
    """

    def __init__(self, number: int, more: str = "") -> None:
        self.number = number
        self.text = TEXTS[number] + (f"; {more}" if more else "")
        super().__init__(f"{number}, {self.text}")
