"""The service upgraded while it runs, rolled back, removed."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import PORT
from test_service import (
    RIG_FILES,
    UNIT,
    UNITS,
    install,
    installed,  # noqa: F401 - a fixture, as the next
    manage,
    rig_file,
    show,
    systemctl,
    unit,  # noqa: F401
)

import seod
from tests.peers import Rpc, port_open

pytestmark = pytest.mark.timeout(400)


@pytest.mark.usefixtures("unit")
def test_upgrade_while_it_runs_and_back() -> None:
    first = show("MainPID")
    done = install("later")
    assert done.returncode == 0, done.stderr
    assert "9.0.0-2 is in force instead of" in done.stdout
    assert show("ActiveState") == "active"
    assert show("MainPID") != first
    again = Rpc(PORT)
    assert again.call("info")["version"] == "9.0.0"
    again.close()
    failed = install("broken")
    assert failed.returncode == 1
    assert "9.0.0-2 is in force again" in failed.stderr, failed.stderr
    assert show("ActiveState") == "active"
    back = manage("rollback")
    assert back.returncode == 0, back.stderr
    assert show("ActiveState") == "active"
    again = Rpc(PORT)
    assert again.call("info")["version"] == seod.__version__
    again.close()
    assert (RIG_FILES / "can.yaml").read_text() == rig_file()


@pytest.mark.usefixtures("installed")
def test_nothing_of_it_stays_but_the_rig_files() -> None:
    systemctl("enable", "--now", UNIT)
    done = manage("uninstall")
    assert done.returncode == 0, done.stderr
    assert not Path("/opt/seod").exists()
    assert not (UNITS / "seod@.service").exists()
    assert not port_open(PORT)
    assert (RIG_FILES / "can.yaml").read_text() == rig_file()
    assert manage("uninstall").returncode == 0
