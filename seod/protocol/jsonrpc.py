"""JSON-RPC 2.0, one message a line, without sockets: bytes to requests, replies and notifications to bytes.

Source: JSON-RPC 2.0 specification (2013-01-04). Ours to add: a line is at most `MAX_LINE` bytes, a batch at
most `MAX_BATCH` requests, parameters go by name, and an undefined number is `null`, never NaN.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Never

if TYPE_CHECKING:
    from collections.abc import Iterable

MAX_LINE = 65_536
"""Longest line [bytes], its end not counted."""
MAX_BATCH = 32

PARSE_ERROR = -32700
INVALID_REQUEST = -32600
UNKNOWN_METHOD = -32601
INVALID_PARAMS = -32602
UNAUTHORISED = -32001
REFUSED = -32002
"""The loop said no, or an e-stop came first; the message is the reason."""
NO_ANSWER = -32003
"""The loop is not there or did not answer in time."""
TOO_MANY_CLIENTS = -32004
BUSY = -32005

Id = str | int | float | None


class JsonText(str):
    """A result that is JSON already."""

    __slots__ = ()


class RpcError(Exception):
    """An error that the caller is told: `code` and a sentence that says what would be right."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code
        self.message = message


class LineTooLongError(Exception):
    """A line was longer than the limit; it is dropped, and reading goes on with the next one."""


@dataclass(frozen=True, slots=True)
class Request:
    """A well-formed call; `answered` is False for a notification, which gets no reply."""

    method: str
    params: Any
    id: Id = None
    answered: bool = True


@dataclass(frozen=True, slots=True)
class Refusal:
    """A call that is not well-formed, and what its sender is told."""

    id: Id
    error: RpcError


@dataclass(frozen=True, slots=True)
class Call:
    """What one line asks for; a batch is answered by one array."""

    requests: tuple[Request | Refusal, ...]
    batch: bool = False


class LineSplitter:
    """Cuts a byte stream into lines; holds what was fed and not yet taken."""

    def __init__(self, limit: int = MAX_LINE) -> None:
        self._limit = limit
        self._buffer = bytearray()
        self._searched = 0
        self._looked = 0
        self._skipping = False

    def __len__(self) -> int:
        """Bytes that were fed and not taken."""
        return len(self._buffer)

    def feed(self, data: bytes | memoryview) -> None:
        """Add what was received."""
        self._buffer += data

    def look(self, word: bytes) -> tuple[int, int] | None:
        """Where the next whole line with this word lies, [start, end) with its end; each is found once."""
        at = self._buffer.find(word, self._looked)
        end = self._buffer.find(b"\n", at) + 1 if at >= 0 else 0
        if not end:  # of a line that is not whole yet the word may be
            self._looked = at if at >= 0 else max(self._looked, len(self._buffer) - len(word) + 1)
            return None
        self._looked = end
        start = self._buffer.rfind(b"\n", 0, at) + 1
        return self.look(word) if self._skipping and start == 0 else (start, end)

    def peek(self, start: int, end: int) -> bytes:
        """These bytes."""
        return bytes(self._buffer[start:end])

    def remove(self, start: int, end: int) -> None:
        """Take these bytes out, before others that came earlier."""
        del self._buffer[start:end]
        self._looked = max(start, self._looked - (end - start))
        self._searched = min(self._searched, start)

    def next_line(self) -> bytes | None:
        r"""The next whole line without its `\n`, or None until more is fed.

        Raises:
            LineTooLongError: Once for each line over the limit.
        """
        end = self._buffer.find(b"\n", self._searched)
        if end < 0:
            self._wait_for_end()
            return None
        line = bytes(self._buffer[:end])
        del self._buffer[: end + 1]
        self._searched = 0
        self._looked = max(0, self._looked - end - 1)
        if self._skipping:
            self._skipping = False
            return self.next_line()
        if end > self._limit:
            raise LineTooLongError
        return line

    def _wait_for_end(self) -> None:
        self._searched = len(self._buffer)
        if self._skipping or self._searched > self._limit:
            self._buffer.clear()
            self._searched = self._looked = 0
            if not self._skipping:
                self._skipping = True
                raise LineTooLongError


def too_long() -> Refusal:
    """What the sender of an over-long line is told."""
    return Refusal(None, RpcError(INVALID_REQUEST, f"line longer than {MAX_LINE} bytes; it was dropped"))


def parse(line: bytes) -> Call:
    """Read one line; anything wrong with it becomes a `Refusal`. An empty line asks for nothing."""
    text = line.strip()
    if not text:
        return Call(())
    try:
        message = json.loads(text.decode("utf-8"), parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:  # also bad UTF-8 and integers of thousands of digits
        return Call((Refusal(None, RpcError(PARSE_ERROR, f"not JSON: {error}")),))
    if not isinstance(message, list):
        return Call((_request(message),))
    if not 1 <= len(message) <= MAX_BATCH:
        why = f"a batch holds 1 to {MAX_BATCH} requests, got {len(message)}"
        return Call((Refusal(None, RpcError(INVALID_REQUEST, why)),))
    return Call(tuple(_request(each) for each in message), batch=True)


def _no_constant(name: str) -> Never:
    raise ValueError(f"{name} is not JSON; use null")


def _request(message: object) -> Request | Refusal:
    if not isinstance(message, dict):
        return Refusal(None, RpcError(INVALID_REQUEST, "a request is a JSON object"))
    sender = message.get("id")
    if not _is_id(sender):
        return Refusal(None, RpcError(INVALID_REQUEST, "id must be a string, a number or null"))
    method, params = message.get("method"), message.get("params", {})
    if message.get("jsonrpc") != "2.0":
        return Refusal(sender, RpcError(INVALID_REQUEST, 'jsonrpc must be "2.0"'))
    if not isinstance(method, str):
        return Refusal(sender, RpcError(INVALID_REQUEST, "method must be a string"))
    return Request(method, params, sender, answered="id" in message)


def _is_id(value: object) -> bool:
    if isinstance(value, bool):
        return False
    return (
        value is None or isinstance(value, (str, int)) or (isinstance(value, float) and math.isfinite(value))
    )


def hint(name: str, known: Iterable[str]) -> str:
    """`; did you mean ...` for a name that is nearly one of the known ones, else the list of them."""
    names = sorted(known)
    close = get_close_matches(name, names, n=2)
    return f"; did you mean {' or '.join(close)}?" if close else f"; known: {', '.join(names)}"


def unknown_method(name: str, known: Iterable[str]) -> RpcError:
    """The error for a method that there is not."""
    return RpcError(UNKNOWN_METHOD, f"no method {name[:40]!r}{hint(name[:40], known)}")


def result_text(sender: Id, result: Any) -> str:
    """The reply to a call that went well; a result that is `JsonText` goes into it as it is."""
    text = result if isinstance(result, JsonText) else json_text(result)
    return f'{{"jsonrpc":"2.0","id":{json.dumps(sender)},"result":{text}}}'


def error_text(sender: Id, error: RpcError) -> str:
    """The reply to a call that did not."""
    return json_text(
        {"jsonrpc": "2.0", "id": sender, "error": {"code": error.code, "message": error.message}}
    )


def notification(method: str, params: dict[str, Any]) -> bytes:
    """A message that nobody answers, as a line."""
    return encode({"jsonrpc": "2.0", "method": method, "params": params})


def encode(message: Any) -> bytes:
    """One line of JSON; numbers that are not finite become null."""
    return json_text(message).encode("ascii") + b"\n"


def json_text(message: Any) -> str:
    """JSON without a line's end; numbers that are not finite become null."""
    try:
        return json.dumps(message, separators=(",", ":"), allow_nan=False)
    except ValueError:
        return json.dumps(_undefined_to_null(message), separators=(",", ":"), allow_nan=False)


def _undefined_to_null(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _undefined_to_null(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_undefined_to_null(each) for each in value]
    return value
