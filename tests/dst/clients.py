"""Clients on the other end of the gateway's connections."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from tests.dst.variety import variety

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

    from tests.dst.net import Network, Transport
    from tests.dst.world import World


class Client:
    """Speaks lines.

    Attributes:
        asked: Requests by number: method, time [s].
        answers: The newest answer of each method: result, or None where it was an error.
        heard: Told of each notification: topic, params.
        reads: It reads what comes.
    """

    def __init__(self, world: World, network: Network, name: str) -> None:
        self.world, self.network, self.name = world, network, name
        self.transport: Transport | None = None
        self.asked: dict[int, tuple[str, float]] = {}
        self.answers: dict[str, Any] = {}
        self.errors: dict[str, str] = {}
        self.heard: Callable[[str, dict[str, Any]], None] = lambda *_: None
        self.answered: Callable[[str, Any], None] = lambda *_: None
        self.reads = True
        self._last_id = 0
        self._rest = b""
        self._unread = b""

    def connect(self) -> bool:
        """Whether somebody listens."""
        self._rest = self._unread = b""
        self.asked.clear()
        self.transport = self.network.connect(self)
        return self.transport is not None

    def call(self, method: str, /, **params: Any) -> None:
        """Send one request."""
        if self.transport is None:
            return
        self._last_id += 1
        self.asked[self._last_id] = method, self.world.now
        line = json.dumps({"jsonrpc": "2.0", "id": self._last_id, "method": method, "params": params})
        self.transport.feed(line.encode() + b"\n")

    def send(self, data: bytes) -> None:
        """Send bytes."""
        if self.transport is not None:
            self.transport.feed(data)

    def leave(self) -> None:
        """Hang up."""
        if self.transport is not None:
            self.transport.hang_up()
            self.transport = None
            self.asked.clear()

    def hung_up(self) -> None:
        """The gateway has hung up."""
        self.transport = None
        self.asked.clear()
        self.answers.clear()

    def receive(self, data: bytes) -> None:
        """Bytes have come."""
        if self.transport is None:
            return
        if not self.reads:
            self._unread += data
            return
        self.transport.took(len(data))
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            self._take(json.loads(line))

    def read_again(self) -> None:
        """Read what has come meanwhile, and go on reading."""
        self.reads = True
        data, self._unread = self._unread, b""
        if data:
            self.receive(data)

    def _take(self, message: Any) -> None:
        if isinstance(message, list) or message.get("id") is None:
            if isinstance(message, dict) and "method" in message:
                self.heard(message["method"], message["params"])
            return
        asked = self.asked.pop(message["id"], None)
        if asked is None:
            self.world.fail(f"{self.name}: an answer to nothing that was asked, or a second one: {message}")
            return
        method, _ = asked
        self.world.note(f"{self.name} hears {method} {'ok' if 'result' in message else message['error']}")
        self.answers[method] = message.get("result")
        self.errors[method] = message.get("error", {}).get("message", "")
        self.answered(method, message.get("result"))


class Operator:
    """Keeps the rig excited: starts it, resets its faults, changes things now and then."""

    def __init__(self, client: Client, rng: Random) -> None:
        self.client, self.rng = client, rng
        self.world = client.world
        self.plain = False
        """Do nothing but look, reset and start; `calm`: nothing but look."""
        self.calm = False
        self.fault: Any = None
        self.state = ""
        client.answered = self._answered
        self.world.at(self.world.now + 0.2, self._turn)

    def _answered(self, method: str, result: Any) -> None:
        if method == "get":
            self.state = result["state"] if result else ""
            self.fault = result and result["fault"]

    def _turn(self) -> None:
        self.world.at(self.world.now + self.rng.uniform(0.05, 0.6), self._turn)
        if self.client.transport is None:
            self.state = ""
            self.client.connect()
            return
        self.client.call("get", axis="motor")
        if not self.calm:
            self._act()

    def _act(self) -> None:
        chance, call = self.rng.random(), self.client.call
        if self.state == "fault":
            call("reset")
        elif self.state == "idle":
            if chance < 0.8 or self.plain:
                call("start")
            elif chance < 0.9:
                call("drive", volts=self.rng.uniform(-0.1, 0.1), duration=0.3)
        elif self.plain:
            return
        elif chance < 0.04:
            call("estop")
        elif chance < 0.12:
            call("stop")
        elif chance < 0.3:
            call("set", e_a=self.rng.choice([0.05, 0.08, 0.1, 0.12]))
        elif chance < 0.35:
            call("set", method=self.rng.choice(["exact", "exact", "peaks", "wave"]))


class Watcher:
    """Subscribes to what its seed wants to know, again whenever it was cut off."""

    def __init__(self, client: Client, rng: Random) -> None:
        self.client, self.rng = client, rng
        wanted = variety(client.world.seed)
        self.wanted: dict[str, Any] = {"topics": wanted.topics}
        if wanted.messages_hz is not None:
            self.wanted["rate_hz"] = wanted.messages_hz
        self.world = client.world
        self.world.at(self.world.now + 0.3, self._turn)

    def _turn(self) -> None:
        self.world.at(self.world.now + self.rng.uniform(0.2, 1.0), self._turn)
        if self.client.transport is None and self.client.connect():
            self.client.call("subscribe", **self.wanted)
