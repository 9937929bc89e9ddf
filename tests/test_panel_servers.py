"""What the panel's process serves beside its page, spoken to by programs of others; who may not come in."""

from __future__ import annotations

import json
import re
import shutil
import socket
import ssl
import struct
import subprocess
import time
import urllib.request
from typing import TYPE_CHECKING, Any

import pytest
import pyvisa
import yaml
from mcap_ros2._dynamic import generate_dynamic
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from seod.files.shipped import configs_dir
from tests.chromium import chromium
from tests.panel_rig import PanelRig, panel_daemon
from tests.peers import free_port, until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from pyvisa.resources import MessageBasedResource

pytestmark = pytest.mark.processes

READ, COMMAND = "read-token-of-sixteen", "command-token-of-sixteen"
CHANGES = (("POST", "/estop"), ("POST", "/api/jobs"), ("PUT", "/api/rigfile"), ("POST", "/api/rigfile/check"))
MONITORING = configs_dir() / "monitoring"


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelRig]:
    with panel_daemon(tmp_path_factory.mktemp("servers")) as running:
        yield running


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelRig]:
    """A daemon with TLS and both tokens."""
    folder = tmp_path_factory.mktemp("locked")
    make = [
        "openssl",
        "req",
        "-x509",
        "-newkey",
        "rsa:2048",
        "-nodes",
        "-days",
        "2",
        "-subj",
        "/CN=localhost",
    ]
    files = ["-keyout", folder / "key.pem", "-out", folder / "cert.pem"]
    subprocess.run([*make, *files], check=True, capture_output=True)
    server = "  tls: {certificate: cert.pem, key: key.pem}\n"
    server += f"  read_token: {READ}\n  command_token: {COMMAND}\n"
    with panel_daemon(folder, server, "https") as running:
        yield running


# ---- metrics


def test_alert_rules_and_configuration_are_right() -> None:
    promtool = shutil.which("promtool")
    assert promtool, "apt-get install prometheus"
    for arguments in (("check", "rules", "alerts.yml"), ("test", "rules", "alerts-test.yml")):
        subprocess.run([promtool, *arguments], cwd=MONITORING, check=True, capture_output=True)
    subprocess.run(
        [promtool, "check", "config", "prometheus.yml"], cwd=MONITORING, check=True, capture_output=True
    )


def test_metrics_are_what_promtool_takes_and_what_board_and_rules_ask_for(rig: PanelRig) -> None:
    text = rig.ask("/metrics")[2]
    checked = subprocess.run(
        ["promtool", "check", "metrics"], input=text.encode(), capture_output=True, check=False
    )
    assert b"error" not in checked.stderr.lower(), checked.stderr.decode()
    names = {line.split()[2] for line in text.splitlines() if line.startswith("# TYPE")}
    asked = json.dumps(json.loads((MONITORING / "grafana.json").read_text()))
    asked += (MONITORING / "alerts.yml").read_text()
    for name in set(re.findall(r"\bseod_[a-z_]+\b", asked)):
        base = name.removesuffix("_bucket")
        assert {base, name} & names or base in {"seod_state", "seod_quality"}, name
    assert "seod_lateness_seconds_bucket" in text
    counts = [float(x.split()[-1]) for x in text.splitlines() if x.startswith("seod_lateness_seconds_bucket")]
    assert counts == sorted(counts)
    assert counts[-1] > 0


def test_a_real_prometheus_scrapes_and_alerts(rig: PanelRig, tmp_path: Path) -> None:
    config = yaml.safe_load((MONITORING / "prometheus.yml").read_text())
    config["scrape_configs"][0]["static_configs"] = [{"targets": [f"127.0.0.1:{rig.ports['panel']}"]}]
    config["rule_files"] = [str(MONITORING / "alerts.yml")]
    (tmp_path / "prometheus.yml").write_text(yaml.safe_dump(config))
    port = free_port()
    command = [
        "prometheus",
        f"--config.file={tmp_path / 'prometheus.yml'}",
        f"--storage.tsdb.path={tmp_path / 'data'}",
    ]
    command += [f"--web.listen-address=127.0.0.1:{port}", "--log.level=error"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def query(path: str) -> Any:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/api/v1/{path}") as answer:
                return json.load(answer)["data"]
        except OSError:
            return {}

    def alerts() -> set[str]:
        return {each["labels"]["alertname"] for each in query("alerts").get("alerts", [])}

    try:
        up = "query?query=up"
        until("a scrape", lambda: [r["value"][1] for r in query(up).get("result", [])] == ["1"])
        ticks = "query?query=seod_ticks_total"
        until("ticks", lambda: any(float(r["value"][1]) > 100 for r in query(ticks).get("result", [])))
        assert "RigFault" not in alerts()
        rpc = rig.rpc()
        rpc.call("estop")
        until("the alert of a fault", lambda: "RigFault" in alerts())
        rpc.call("reset")
        until("its end", lambda: "RigFault" not in alerts())
        rpc.close()
    finally:
        process.terminate()
        process.wait()


# ---- SCPI


@pytest.fixture
def instrument(rig: PanelRig) -> Iterator[MessageBasedResource]:
    manager = pyvisa.ResourceManager("@py")
    opened: Any = manager.open_resource(f"TCPIP::127.0.0.1::{rig.ports['scpi']}::SOCKET")
    opened.read_termination = opened.write_termination = "\n"
    opened.timeout = 20000
    try:
        yield opened
    finally:
        opened.close()
        manager.close()


def test_pyvisa_measures_sets_and_stops(rig: PanelRig, instrument: MessageBasedResource) -> None:
    assert instrument.query("*IDN?").startswith("seod,motor-")
    instrument.write("*CLS")
    until("at rest", lambda: instrument.query("SYST:STAT?") == "IDLE")
    instrument.write("SOUR:REL:AMPL 0.5 V,(@motor);HYST 4 mrad")

    def started() -> bool:
        instrument.write("INIT")
        return instrument.query("OUTP?") == "1"

    until("the relay", started)
    until("an estimate", lambda: instrument.query("MEAS:QUAL?") == "ok")
    assert abs(float(instrument.query("MEAS:ZETA? (@motor)")) - 0.21) < 0.02
    _, zeta_sd, omega_n, *_ = instrument.query_ascii_values("FETC?", converter="s")
    assert float(zeta_sd) > 0.0
    assert abs(float(omega_n) - 117.0) < 4.0
    assert float(instrument.query("SOUR:REL:AMPL?")) == 0.5
    instrument.write("*CLS;SOUR:REL:AMPL 50 V")
    error = instrument.query("SYST:ERR?")
    assert error.startswith("-222")
    assert "limits.output" in error
    instrument.write("*CLS;*SRE 8;:STAT:QUES:ENAB 512")
    instrument.write("SYST:EST")
    until("its fault", lambda: instrument.query("SYST:STAT?") == "FAULT")
    assert int(instrument.query("*STB?")) & 72 == 72
    instrument.write("SYST:RES")
    until("out of it", lambda: instrument.query("SYST:STAT?") == "IDLE")
    assert instrument.query("SYST:ERR?") == '0,"No error"'


def test_an_estop_goes_before_lines_that_wait(rig: PanelRig) -> None:
    with socket.create_connection(("127.0.0.1", rig.ports["scpi"])) as raw, raw.makefile("rb") as lines:
        raw.sendall(b"*CLS\n" + 100 * b"SOUR:REL:AMPL?\n" + b"SYST:EST\nSYST:STAT?\nSYST:ERR?\n")
        until("the stop", lambda: rig_state(rig) == "fault")
        answers = []
        while not answers or (not answers[-1].startswith(b"-") and b"No error" not in answers[-1]):
            answers.append(lines.readline())
        assert len(answers) < 102
        assert b"an e-stop came after it" in answers[-1]
        raw.sendall(b"*CLS;:SYST:RES\n")
        until("the end of it", lambda: rig_state(rig) == "idle")


def rig_state(rig: PanelRig) -> str:
    rpc = rig.rpc()
    try:
        return str(rpc.call("get", axis="motor")["state"])
    finally:
        rpc.close()


# ---- Foxglove


def test_a_client_of_the_published_protocol_gets_live_topics(rig: PanelRig) -> None:
    address = f"ws://127.0.0.1:{rig.ports['panel']}/foxglove"
    with connect(address, subprotocols=["foxglove.websocket.v1"]) as client:
        assert client.subprotocol == "foxglove.websocket.v1"
        info, advertised = json.loads(client.recv(timeout=20)), json.loads(client.recv(timeout=20))
        assert info["op"] == "serverInfo"
        assert advertised["op"] == "advertise"
        channels = {each["topic"]: each for each in advertised["channels"]}
        wanted = ["/rows/motor", "/health"]
        subscriptions = [{"id": 7 + k, "channelId": channels[topic]["id"]} for k, topic in enumerate(wanted)]
        client.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
        found: dict[int, tuple[int, bytes]] = {}
        end = time.monotonic() + 20
        while len(found) < 2 and time.monotonic() < end:
            data = client.recv(timeout=20)
            assert isinstance(data, bytes), data
            operation, number, stamp = struct.unpack_from("<BIQ", data)
            assert operation == 1
            found[number] = (stamp, data[13:])
        stamp, row = found[7]
        assert abs(stamp * 1e-9 - time.time()) < 30
        schema = channels["/rows/motor"]
        decoders = generate_dynamic(schema["schemaName"], schema["schema"])
        decoded = decoders[schema["schemaName"]](row)
        assert decoded.tick > 0
        assert abs(decoded.y) < 2
        assert json.loads(found[8][1])["ticks"] > 0
        client.send(json.dumps({"op": "unsubscribe", "subscriptionIds": [7, 8]}))
        client.send("nonsense")
        while not isinstance(data := client.recv(timeout=20), str):
            pass
        assert json.loads(data) == {"op": "status", "level": 1, "message": "not a message of the protocol"}


@pytest.mark.parametrize(
    ("path", "protocols", "origin"),
    [
        ("/foxglove", ["foxglove.websocket.v1"], "https://evil.example"),
        ("/foxglove", ["something.else"], None),
        ("/ws", ["seod.panel.1", "csrf.wrong"], None),
        ("/ws", ["seod.panel.1", "csrf.wrong"], "same"),
    ],
)
def test_websockets_of_others_are_refused(
    rig: PanelRig, path: str, protocols: list[Any], origin: Any
) -> None:
    cookie = rig.session()["cookie"]
    given = rig.url if origin == "same" else origin
    address = f"ws://127.0.0.1:{rig.ports['panel']}{path}"
    with (
        pytest.raises(InvalidStatus) as caught,
        connect(address, subprotocols=protocols, origin=given, additional_headers={"cookie": cookie}),
    ):
        pass
    assert caught.value.response.status_code == 403


# ---- who may come in


def test_only_our_own_page_may_change_anything(rig: PanelRig) -> None:
    session = rig.session()
    assert rig.ask("/estop", "POST", b"", **session)[0] == 200
    rpc = rig.rpc()
    rpc.call("reset")
    rpc.close()
    for change in (
        {"origin": "http://evil.example"},
        {"x_seod_csrf": "guessed"},
        {"cookie": "seod_session=x"},
    ):
        wrong = session | change
        for method, path in CHANGES:
            assert rig.ask(path, method, b"{}", **wrong)[0] == 403, (change, path)
    assert rig_state(rig) == "idle"


def test_names_of_others_lead_nowhere_and_pages_are_guarded(rig: PanelRig) -> None:
    assert rig.ask("/", host="evil.example")[0] == 421
    headers = rig.ask("/")[1]
    assert "unsafe" not in headers["content-security-policy"]
    assert "script-src 'self'" in headers["content-security-policy"]
    cookie = headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    for path in ("/api/recordings", "/api/rigfile", "/api/about", "/api/jobs/1"):
        assert rig.ask(path)[0] in {401, 403}, path
    cookie = rig.session()["cookie"]
    assert rig.ask("/api/recordings/..%2Frig.yaml", cookie=cookie)[0] == 404
    assert rig.ask("/static/..%2Fapp.py", cookie=cookie)[0] == 404


def test_login_over_tls_gives_the_rights_of_its_token(locked: PanelRig) -> None:
    assert locked.ask("/")[0] == 303
    assert locked.ask("/metrics")[0] == 401
    assert locked.ask("/metrics", authorization=f"Bearer {READ}")[0] == 200
    assert locked.ask("/metrics", authorization="Bearer wrong")[0] == 401
    with chromium(1280, 860, "--ignore-certificate-errors") as page:
        page.driver.get(locked.url)
        log_in(page, "not-a-token-of-this-rig")
        page.until(lambda: page.js("document.getElementById('wrong')?.hidden === false"), "not told")
        log_in(page, READ)
        page.until(lambda: page.text("link") == "live", "never live")
        assert page.js(
            "['start', 'stop', 'take', 'record'].every((id) => document.getElementById(id).disabled)"
        )
        page.click("estop")
        page.until_text("alert", "command_token")
        page.view("rigfile")
        page.until(lambda: "server:" in page.js("document.getElementById('rig-text').value"), "no rig file")
        text = page.js("document.getElementById('rig-text').value")
        assert READ not in text
        assert COMMAND not in text
        page.click("logout")
        log_in(page, COMMAND)
        page.until(lambda: page.text("link") == "live", "never live")
        page.click("estop")
        page.until(lambda: page.text("state") == "fault", "not stopped")
        cookie = page.driver.get_cookies()[0]
        assert cookie["secure"]
        assert cookie["httpOnly"]


def log_in(page: Any, token: str) -> None:
    page.until(lambda: page.js("document.querySelectorAll('input[name=token]').length"), "no login")
    field = page.driver.find_element("name", "token")
    field.send_keys(token)
    page.js("window.before = true")
    field.submit()
    page.until(lambda: page.js("window.before === undefined"), "the answer's page never came")


def test_scpi_over_tls_wants_a_token(locked: PanelRig) -> None:
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    with (
        socket.create_connection(("127.0.0.1", locked.ports["scpi"])) as raw,
        context.wrap_socket(raw) as safe,
        safe.makefile("rb") as lines,
    ):
        for line, answer in (
            ("MEAS:ZETA?;:SYST:ERR?", None),
            ("SYST:ERR?", b"-203"),
            ('SYST:PASS "wrong"', None),
            ("SYST:ERR?", b"-203"),
            (f'SYST:PASS "{READ}"', None),
            ("SYST:STAT?", b""),
            ("INIT", None),
            ("SYST:ERR?", b"-203"),
        ):
            safe.sendall(line.encode() + b"\n")
            if answer is not None:
                assert lines.readline().startswith(answer), line
