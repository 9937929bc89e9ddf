"""`make audit` fails on an advisory, and passes unasked only where there is no database to ask."""

from __future__ import annotations

import subprocess
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from tests.scripts import loaded

if TYPE_CHECKING:
    from collections.abc import Iterator

PATH = Path(__file__).parents[2] / ".ci" / "audit.py"


@pytest.fixture
def audit() -> Any:
    return loaded(PATH)


@contextmanager
def answering(status: int, body: bytes) -> Iterator[str]:
    """A server on this machine that always says this."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(status)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            """Silent."""

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


@pytest.mark.parametrize(
    ("status", "body", "why"),
    [
        (200, b'{"vulnerabilities": []}', ""),
        (404, b"", "HTTP 404 Not Found"),
        (200, b'{"name": "pip"}', "the answer has no advisories"),
        (200, b"[]", "the answer has no advisories"),
    ],
)
def test_a_database_is_one_that_tells_advisories(audit: Any, status: int, body: bytes, why: str) -> None:
    with answering(status, body) as url:
        assert audit.missing(url) == why


def test_what_is_no_database(audit: Any) -> None:
    with answering(200, b"<html>") as url:
        assert "Expecting value" in audit.missing(url)
    assert "refused" in audit.missing(url)


@pytest.mark.parametrize(
    ("missing", "required", "found", "code"),
    [
        ("", "", 0, 0),
        ("", "", 1, 1),
        ("", "required", 1, 1),
        ("refused", "", None, 0),
        ("refused", "required", None, 1),
    ],
)
def test_an_advisory_fails_and_a_missing_database_only_where_it_is_required(
    audit: Any, missing: str, required: str, found: int | None, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(command: list[Any], check: bool) -> SimpleNamespace:
        assert found is not None, "it was asked although it is not there"
        assert command[0].name == "pip-audit"
        assert not check
        return SimpleNamespace(returncode=found)

    monkeypatch.setenv("AUDIT", required)
    monkeypatch.setattr(audit, "missing", lambda: missing)
    monkeypatch.setattr(subprocess, "run", run)
    assert audit.main() == code


ADVISORY = """
id: PYSEC-1
aliases: [CVE-1]
affected:
- package: {name: Some_Thing, ecosystem: PyPI}
  ranges:
  - type: ECOSYSTEM
    events: [{introduced: "0"}, {fixed: "1.10"}, {introduced: "2.0"}, {last_affected: "2.1"}]
  versions: ["1.2", "3.0.post1"]
"""


@pytest.mark.parametrize(
    ("version", "affected"),
    [("1.2", 1), ("1.9", 1), ("1.10", 0), ("2.0", 1), ("2.1", 1), ("2.1.1", 0), ("3.0.post1", 1), ("9", 0)],
)
def test_a_folder_of_advisories_is_asked_without_network(
    audit: Any, version: str, affected: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lock, database = tmp_path / "lock", tmp_path / "vulns" / "some-thing"
    lock.write_text(f"some-thing=={version} ; python_version > '3' \\\n    --hash=sha256:00\nother==1.2\n")
    database.mkdir(parents=True)
    assert audit.ask_folder(database, lock) == 1, "an empty folder tells nothing"
    (database / "PYSEC-1.yaml").write_text(ADVISORY)
    assert audit.ask_folder(tmp_path, lock) == affected
    told = "some-thing" if not affected else f"Some_Thing {version}: PYSEC-1 CVE-1"
    assert (told in capsys.readouterr().out) == bool(affected)
    (database / "PYSEC-1.yaml").write_text(ADVISORY.replace("PYSEC-1", next(iter(audit.ACCEPTED))))
    assert audit.ask_folder(tmp_path, lock) == 0
    (database / "PYSEC-1.yaml").write_text("withdrawn: 2024-01-01\n" + ADVISORY)
    assert audit.ask_folder(tmp_path, lock) == 0
