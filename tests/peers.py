"""The other ends that tests talk to: processes and JSON-RPC by line. Standard library only."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import signal
    from collections.abc import Callable

REPO = Path(__file__).parents[1]
SEOD = Path(sys.executable).with_name("seod")
PATIENCE_S = 45.0
"""How long a condition may take to come true; none should."""

Json = dict[str, Any]
T = TypeVar("T")


def until(what: str, look: Callable[[], T], patience_s: float = PATIENCE_S) -> T:
    """Wait until `look()` is true; returns what it gave."""
    deadline = time.monotonic() + patience_s
    while True:
        found = look()
        if found:
            return found
        if time.monotonic() > deadline:
            raise AssertionError(f"not within {patience_s:g} s: {what} (last: {found!r})")
        time.sleep(0.02)


class RpcError(Exception):
    """The other end said no."""


class Rpc:
    """JSON-RPC by line, as any client would write it; notifications are kept in `heard`."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        self.lines = self.socket.makefile("rb")
        self.number = 0
        self.heard: list[Json] = []

    def call(self, method: str, **params: Any) -> Any:
        """The result of a call."""
        self.number += 1
        request = {"jsonrpc": "2.0", "id": self.number, "method": method, "params": params}
        self.socket.sendall(json.dumps(request).encode() + b"\n")
        while True:
            message = self.next()
            if message.get("id") != self.number:
                self.heard.append(message)
            elif "error" in message:
                raise RpcError(message["error"]["message"])
            else:
                return message["result"]

    def next(self) -> Json:
        """The next message, whatever it is."""
        line = self.lines.readline()
        assert line, "the other end hung up"
        message: Json = json.loads(line)
        return message

    def wait_for(self, what: str, fits: Callable[[Json], bool]) -> Json:
        """The first notification that fits, those already heard included; takes it and all before it."""
        deadline = time.monotonic() + PATIENCE_S
        others: Counter[str] = Counter()
        while time.monotonic() < deadline:
            message = self.heard.pop(0) if self.heard else self.next()
            if fits(message):
                return message
            assert message.get("params", {}).get("event") != "fault", f"waiting for {what}: {message}"
            others[_in_short(message)] += 1
        raise AssertionError(f"not within {PATIENCE_S:g} s: {what}, but {dict(others.most_common(20))}")

    def event(self, **wanted: Any) -> Json:
        """The first event with these values."""
        params: Json = self.wait_for(
            f"event {wanted}",
            lambda m: m.get("method") == "event" and wanted.items() <= m["params"].items(),
        )["params"]
        return params

    def wait_for_centre(self, axis: str, within: float = 0.1) -> None:
        """Until the daemon has seen this axis near zero: a start before that is refused, or faults."""
        number = self.call("subscribe", topics=["sample"], axes=[axis], rate_hz=20.0)["subscription"]
        self.heard.clear()
        self.wait_for(f"{axis} in the middle", lambda m: _near_zero(m, axis, within))
        self.call("unsubscribe", subscription=number)

    def close(self) -> None:
        """Hang up."""
        self.lines.close()
        self.socket.close()


def recover(rpc: Rpc, axis: str = "motor") -> None:
    """Bring an axis out of a fault, or stop it, and wait until it is idle."""
    until("reset or stop", lambda: _recovers(rpc, axis))
    until("idle", lambda: rpc.call("get", axis=axis)["state"] == "idle")


def _recovers(rpc: Rpc, axis: str) -> bool:
    """A reset is refused while the fault's cause is still there."""
    try:
        rpc.call("reset" if rpc.call("get", axis=axis)["state"] == "fault" else "stop")
    except RpcError as why:
        print(why)
        return False
    return True


def _in_short(message: Json) -> str:
    """What a notification says, without its numbers."""
    params = message.get("params", {})
    words = (params.get(name) for name in ("event", "code", "state", "quality", "advice"))
    return " ".join([message.get("method", "answer"), *(str(each) for each in words if each)])


def _near_zero(message: Json, axis: str, within: float) -> bool:
    sample = message["params"] if message.get("method") == "sample" else {}
    return sample.get("axis") == axis and sample["y"] is not None and abs(sample["y"]) < within


class Program:
    """`seod ARGS` as a process with its output in a file; whatever it leaves behind is ended too."""

    def __init__(self, log: Path, *arguments: str | Path) -> None:
        self.log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(
                [SEOD, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Of the process that was started: for the daemon, its supervisor."""
        return self.process.pid

    def said(self) -> str:
        """All output so far."""
        return self.log.read_text(errors="replace")

    def ready(self) -> Json:
        """The line of JSON by which `seod rig` tells that it is there."""
        lines: list[str] = []

        def told() -> bool:
            lines[:] = [line for line in self.said().splitlines(keepends=True) if line.startswith("{")]
            return bool(lines and lines[0].endswith("\n")) or self.process.poll() is not None

        until("the rig's ready line", told)
        assert lines, self.said()
        facts: Json = json.loads(lines[0])
        return facts

    def wait(self) -> int:
        """Exit code."""
        return self.process.wait(PATIENCE_S)

    def stop(self) -> None:
        """SIGTERM, and SIGKILL if need be."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
                raise


def free_port() -> int:
    """A TCP port on loopback that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


ROOM = (
    ("travel: [-60 deg, 60 deg]", "travel: [-120 deg, 120 deg]"),
    ("amplitude: 0.45 rad", "amplitude: 1.5 rad\n      growth: 10"),
)
"""For a motor whose relay comes 0.1 s late: so long a virtual machine stands still now and then."""


def write_rig_file(folder: Path) -> Path:
    """The shipped virtual rig with a name and a port of its own, and patience with a busy machine."""
    port = free_port()
    text = (REPO / "configs" / "virtual.yaml").read_text()
    for old, new in (
        ("rig: virtual-motor", f"rig: motor-{port}"),
        ("port: 7600", f"port: {port}\n  panel: false"),
        ("hang_timeout: 50 ms", "hang_timeout: 1 s"),
        ("stale: 10 ms", "stale: 100 ms"),
        ("count: 20,", "count: 150,"),
        *ROOM,
    ):
        assert old in text, old
        text = text.replace(old, new)
    path = folder / "rig.yaml"
    path.write_text(text)
    return path


def port_of(rig_file: Path) -> int:
    """The port that a rig file names."""
    return int(re.findall(r"^  port: (\d+)", rig_file.read_text(), re.MULTILINE)[0])


def port_open(port: int) -> bool:
    """Whether something listens."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def find_process(word: str, parent: int | None = None) -> int:
    """The process with this word in its command line (and this parent); 0 if there is none that lives."""
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0")
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
        except OSError:  # ended meanwhile
            continue
        if word.encode() in words and fields[0] != "Z" and parent in (None, int(fields[1])):
            return int(entry.name)
    return 0


def kill(pid: int, number: signal.Signals) -> None:
    """Signal a process that may be gone already."""
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return
