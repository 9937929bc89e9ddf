"""A rig at a real broker: what it tells, that nothing is lost or comes twice, and which commands it takes."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import paho.mqtt.client as mqtt
import pytest

from seod.archive.build import build
from seod.archive.sql import ask
from tests.chromium import chromium
from tests.mosquitto import Mosquitto, mosquitto
from tests.peers import SEOD, Program, Rpc, find_process, free_port, kill, port_of, until, write_rig_file

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

pytestmark = [pytest.mark.processes, pytest.mark.timeout(240)]

COMMAND = "c0mm4nd-Yt5RmPd2hGe"
Json = dict[str, Any]


class Ear:
    """A subscriber and publisher of others' making."""

    def __init__(
        self, port: int, user: str | None = None, password: str | None = None, ca: Path | None = None
    ):
        self.heard: list[tuple[str, Json, bool]] = []
        self.client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
        self.client.on_connect = lambda client, *_: client.subscribe("seod/v1/#", qos=1)
        self.client.on_message = self._on_message
        self.client.reconnect_delay_set(1, 1)
        if user is not None:
            self.client.username_pw_set(user, password)
        if ca is not None:
            self.client.tls_set(str(ca))
        self.client.connect("localhost" if ca else "127.0.0.1", port)
        self.client.loop_start()

    def _on_message(self, _: object, __: object, message: mqtt.MQTTMessage) -> None:
        self.heard.append((message.topic, json.loads(message.payload), message.retain))

    def on(self, suffix: str) -> list[Json]:
        return [body for topic, body, _ in list(self.heard) if topic.split("/", 3)[3].startswith(suffix)]

    def wait(self, suffix: str, fits: Callable[[Json], bool] = lambda _: True) -> Json:
        return until(suffix, lambda: next((body for body in self.on(suffix) if fits(body)), None))

    def command(self, rig: str, retain: bool = False, age: float = 0.0, **body: Any) -> Json:
        """Send a command; its answer."""
        body = {"id": f"id-{time.monotonic_ns()}", "at": time.time() - age, **body}
        self.client.publish(
            f"seod/v1/{rig}/command", json.dumps(body), qos=1, retain=retain
        ).wait_for_publish(20)
        return self.wait("answer", lambda answer: answer["id"] == body["id"])

    def close(self) -> None:
        self.client.disconnect()
        self.client.loop_stop()
        self.client._reset_sockets()  # the library leaves a pair open


def in_fleet(folder: Path, port: int, *more: str, server: str = "") -> Path:
    """A rig file of a rig at this broker."""
    path = write_rig_file(folder)
    lines = [f"host: {'localhost' if any('tls' in each for each in more) else '127.0.0.1'}", f"port: {port}"]
    lines += ["store: store", "rate_hz: 5", "health: 1 s", *more]
    text = path.read_text().replace("server:\n", f"server:\n{server}", 1)
    path.write_text(text + "\nmqtt:\n" + "".join(f"  {line}\n" for line in lines))
    return path


class Daemon:
    """A rig at the broker."""

    def __init__(self, rig_file: Path, token: str | None = None) -> None:
        self.rig = f"motor-{port_of(rig_file)}"
        self.program = Program(rig_file.with_name("daemon.log"), "run", rig_file)
        until("the broker", lambda: self.is_there() or self.program.process.poll() is not None, 100)
        assert self.program.process.poll() is None, self.program.said()
        self.rpc = Rpc(port_of(rig_file))
        if token is not None:
            self.rpc.call("authenticate", token=token)
        self.rpc.wait_for_centre("motor")

    def is_there(self) -> bool:
        return "is there" in self.program.said() and "JSON-RPC on" in self.program.said()

    def publisher(self) -> int:
        return until("the publisher", lambda: find_process("seod.fleet", self.program.pid))

    def stop(self) -> None:
        self.rpc.close()
        self.program.stop()


@contextmanager
def daemon(rig_file: Path, token: str | None = None) -> Iterator[Daemon]:
    running = Daemon(rig_file, token)
    try:
        yield running
    finally:
        running.stop()


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Mosquitto]:
    with mosquitto(tmp_path / "broker") as running:
        yield running


@contextmanager
def ear(*arguments: Any) -> Iterator[Ear]:
    opened = Ear(*arguments)
    try:
        yield opened
    finally:
        opened.close()


def keys(bodies: list[Json]) -> list[tuple[int, int]]:
    return [(body["session"], body["seq"]) for body in bodies if "seq" in body and "prev" in body]


def test_birth_state_estimates_faults_and_the_last_will(tmp_path: Path, broker: Mosquitto) -> None:
    with daemon(in_fleet(tmp_path, broker.port)) as rig, ear(broker.port) as heard:
        birth = heard.wait("birth")
        assert birth["axes"]["motor"]["unit"] == "rad"
        assert birth["simulated"]
        assert not birth["commands"]
        rig.rpc.call("start")
        heard.wait("state", lambda body: body["state"] == "exciting")
        estimate = heard.wait("estimate/motor", lambda body: body["quality"] == "ok")
        assert abs(estimate["zeta"] - 0.21) < 0.02
        assert estimate["e_a"] == 0.5
        assert heard.wait("health")["store"]["thinned"] == {}
        refused = json.dumps({"id": "1", "method": "stop", "at": time.time()})
        heard.client.publish(f"seod/v1/{rig.rig}/command", refused, qos=1).wait_for_publish(20)
        rig.rpc.call("estop")
        assert heard.wait("event", lambda body: body["event"] == "fault")["code"] == "estop"
        heard.wait("state", lambda body: body["state"] == "fault")
        assert heard.on("answer") == []  # no command is taken where none is allowed
        kill(rig.publisher(), signal.SIGKILL)
        death = heard.wait("death")
        assert (death["session"], death["connection"]) == (birth["session"], birth["connection"])
        assert death["why"] == "gone"
        again = heard.wait("birth", lambda body: body["session"] > birth["session"])
        assert again["now"]["state"] in {"fault", "unknown"}
    with ear(broker.port) as late:
        assert late.wait("state")["axes"]["motor"]["fault"]["code"] == "estop"  # the broker keeps it
        assert late.wait("death")["why"] == "ended"


def test_nothing_is_lost_or_archived_twice_whatever_is_killed(tmp_path: Path, broker: Mosquitto) -> None:
    """The broker keeps nothing on its disk: what it had confirmed and not passed on is gone with it."""
    archive = tmp_path / "archive"
    watch = [
        "fleet",
        "--broker",
        f"127.0.0.1:{broker.port}",
        "--archive",
        archive,
        "--name",
        "hall",
        "--json",
    ]
    listener = Program(tmp_path / "fleet.log", *watch)

    def rows() -> list[Json]:
        lines = [
            each
            for path in sorted(archive.glob("fleet/*.jsonl"))
            for each in path.read_bytes().splitlines(True)
        ]
        return [json.loads(line) for line in lines if line.endswith(b"\n")]

    def estimates() -> int:
        return sum(row["kind"] == "estimate" for row in rows())

    try:
        with daemon(in_fleet(tmp_path, broker.port, "archive: hall")) as rig:
            rig.rpc.call("start")
            until("the listener's files", archive.exists)
            second = subprocess.run([SEOD, *watch], capture_output=True, text=True, check=False, timeout=60)
            assert second.returncode == 1
            assert "another `seod fleet` appends to this archive" in second.stderr
            until("estimates", lambda: estimates() > 5)
            for _ in range(2):
                broker.kill()
                rig.rpc.call("stop")
                until("at rest", lambda: rig.rpc.call("get", axis="motor")["state"] == "idle")
                rig.rpc.call("start")
                before = estimates()
                broker.start()
                until("what came meanwhile", lambda n=before: estimates() > n + 5)
            listener.process.kill()
            listener.wait()
            listener = Program(tmp_path / "fleet2.log", *watch)
            before = estimates()
            until("estimates for the next one", lambda: estimates() > before + 5)
            kill(rig.publisher(), signal.SIGKILL)
            before = estimates()
            until("estimates of the next publisher", lambda: estimates() > before + 5)
            rig.rpc.call("estop")
            until("the fault", lambda: any(row["message"].get("code") == "estop" for row in rows()))
        listener.process.terminate()
        listener.wait()
    finally:
        listener.stop()
    kept = keys_of_rows(rows())
    assert len(kept) == len(set(kept))
    assert kept == sorted(kept)
    for session in {session for session, _ in kept}:
        numbers = [seq for each, seq in kept if each == session]
        assert numbers == list(range(1, len(numbers) + 1))
    row = next(row for row in rows() if row["kind"] == "estimate" and row["quality"] == "ok")
    assert row["unit"] == "rad"
    assert abs(row["omega_n"] - 117) < 6
    build(archive)
    told = ask(archive, "SELECT count(*) AS n, median(omega_n) AS omega_n FROM fleet").to_pylist()[0]
    assert told["n"] == len(kept)
    assert abs(told["omega_n"] - 117) < 6


def keys_of_rows(rows: list[Json]) -> list[tuple[int, int]]:
    return [(row["session"], row["seq"]) for row in rows]


def test_allowed_commands_obey_rights_limits_and_age(tmp_path: Path, broker: Mosquitto) -> None:
    server = f"  command_token: {COMMAND}\n"
    rig_file = in_fleet(tmp_path, broker.port, "commands: true", server=server)
    with ear(broker.port) as heard:
        old = {"id": "old", "at": time.time(), "token": COMMAND, "method": "start"}
        name = f"seod/v1/motor-{port_of(rig_file)}/command"
        heard.client.publish(name, json.dumps(old), qos=1, retain=True).wait_for_publish(20)
        with daemon(rig_file, COMMAND) as rig:
            assert "retained" in heard.wait("answer", lambda each: each["id"] == "old")["error"]
            assert "wrong token" in heard.command(rig.rig, method="start")["error"]
            assert "wrong token" in heard.command(rig.rig, method="start", token=COMMAND + "x")["error"]
            too_much = {"method": "set", "params": {"axis": "motor", "e_a": 5.0}, "token": COMMAND}
            assert "limits.output" in heard.command(rig.rig, **too_much)["error"]
            assert "ago" in heard.command(rig.rig, age=60.0, method="start", token=COMMAND)["error"]
            assert "must be one of" in heard.command(rig.rig, method="drive", token=COMMAND)["error"]
            set_ = {"method": "set", "params": {"axis": "motor", "e_a": 0.6}, "token": COMMAND, "id": "once"}
            assert heard.command(rig.rig, **set_)["result"]["settings"]["e_a"] == 0.6
            heard.client.publish(name, json.dumps({**set_, "at": time.time()}), qos=1).wait_for_publish(20)
            heard.wait("answer", lambda each: each["id"] == "once" and "before" in each.get("error", ""))
            assert heard.command(rig.rig, method="start", token=COMMAND, client="desk-1")["ok"]
            assert heard.on("answer/desk-1")
            heard.wait("state", lambda body: body["state"] == "exciting")
            assert heard.command(rig.rig, age=60.0, method="estop", token=COMMAND)["ok"]  # however old it is
            assert rig.rpc.call("get", axis="motor")["state"] == "fault"
            assert COMMAND not in json.dumps(
                [body for topic, body, _ in heard.heard if "command" not in topic]
            )


def test_tls_and_password(tmp_path: Path) -> None:
    files = ["-keyout", tmp_path / "key.pem", "-out", tmp_path / "cert.pem"]
    subject = ["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost"]
    make = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", *subject, *files]
    subprocess.run(make, check=True, capture_output=True)
    secret = tmp_path / "users"
    subprocess.run(["mosquitto_passwd", "-b", "-c", secret, "rig", "short"], check=True, capture_output=True)
    secret.chmod(0o644)
    tmp_path.chmod(0o755)
    (tmp_path / "key.pem").chmod(0o644)
    (tmp_path / "word").write_text("short\n")
    (tmp_path / "word").chmod(0o600)
    lines = [
        f"certfile {tmp_path / 'cert.pem'}",
        f"keyfile {tmp_path / 'key.pem'}",
        f"password_file {secret}",
    ]
    ours = ["tls: {ca: cert.pem}", "user: rig", "password_file: word"]
    with (
        mosquitto(tmp_path / "broker", "user root", *lines) as broker,
        daemon(in_fleet(tmp_path, broker.port, *ours)) as rig,
        ear(broker.port, "rig", "short", tmp_path / "cert.pem") as heard,
    ):
        assert heard.wait("birth")["rig"] == rig.rig
        heard.wait("health")


def test_a_broker_that_hangs_costs_the_rig_nothing(tmp_path: Path, broker: Mosquitto) -> None:
    assert broker.process is not None
    with daemon(in_fleet(tmp_path, broker.port)) as rig:
        broker.process.send_signal(signal.SIGSTOP)
        try:
            rig.rpc.call("start")
            rig.rpc.call("subscribe", topics=["estimate"])
            rig.rpc.wait_for("estimates", lambda m: m.get("params", {}).get("quality") == "ok")
            rig.rpc.call("stop")
        finally:
            broker.process.send_signal(signal.SIGCONT)


def test_the_page_lists_the_fleet(tmp_path: Path, broker: Mosquitto) -> None:
    rig_file = in_fleet(tmp_path, broker.port)
    port = free_port()
    rig_file.write_text(rig_file.read_text().replace("panel: false", f"panel: true\n  panel_port: {port}"))
    with daemon(rig_file) as rig, chromium() as page:
        until("the panel", lambda: "panel on" in rig.program.said())
        page.driver.get(f"http://127.0.0.1:{port}")
        page.until(lambda: page.text("link") == "live", "never live")
        rig.rpc.call("start")
        page.view("fleet")
        page.until_text("fleet", rig.rig)
        page.until_text("fleet", "exciting")
        page.until_text("fleet", "±")
        page.until(lambda: page.js("document.querySelectorAll('#fleet polyline[points]').length"), "no trend")
        assert page.complaints() == []
        page.driver.set_window_size(400, 800)
        assert page.js("document.documentElement.scrollWidth <= window.innerWidth")
