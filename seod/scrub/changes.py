"""What has to change in a recording so that it shows no token."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from seod.config.redact import redacted, secrets
from seod.config.token_field import LEAST

if TYPE_CHECKING:
    from seod.config.redact import Secret


class ScrubError(Exception):
    """A file cannot be cleaned, and is as it was; the message names it and says why."""


@dataclass
class Changes:
    """Bytes to be written over others, and what must not be in the file any more.

    Attributes:
        patches: Place in the file and new bytes, as many as they replace.
        spellings: Each token in UTF-8, as it means, as it was written, and as JSON writes it.
        tokens: How many different ones there are.
    """

    patches: list[tuple[int, bytes]] = field(default_factory=list)
    spellings: set[bytes] = field(default_factory=set)
    tokens: set[str] = field(default_factory=set)

    def learn(self, text: str) -> None:
        """Take note of the tokens in a text."""
        for each in secrets(text):
            if len(each.value) >= LEAST:
                self.tokens.add(each.value)
                self.spellings |= _spellings(each, text)

    def take(self, text: str, at: int) -> bytes:
        """Have a text that begins at `at` lose its tokens; returns it without them, in UTF-8."""
        self.learn(text)
        clean = redacted(text).encode()
        if clean != text.encode():
            self.patches.append((at, clean))
        return clean

    def in_bytes(self, data: bytes) -> bool:
        """Whether a token is in these bytes."""
        return any(spelling in data for spelling in self.spellings)


def _spellings(secret: Secret, text: str) -> set[bytes]:
    words = secret.value, text[secret.start : secret.end]
    escaped = (json.dumps(secret.value, ensure_ascii=ascii_only)[1:-1] for ascii_only in (True, False))
    return {word.encode(errors="surrogateescape") for word in (*words, *escaped)}
