"""The pytest plugin: fixtures for tests of software that talks to a rig."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from seod.api.rig_file import RigFile
    from seod.testing.daemon import Daemon


def pytest_configure(config: pytest.Config) -> None:
    """Tell pytest of the marker."""
    config.addinivalue_line(
        "markers",
        "seod_rig(name='virtual', **values): the shipped rig file that `virtual_rig` is made of, with other "
        "values by their place, such as **{'axes.motor.relay.e_a': '0.2 V'}",
    )


@pytest.fixture
def virtual_rig(request: pytest.FixtureRequest, tmp_path: Path) -> RigFile:
    """The rig file of a simulated rig, saved in `tmp_path`, with a name and a port of its own."""
    from seod.api.rig_file import RigFile  # noqa: PLC0415 - only where it is asked for
    from seod.testing.daemon import own_rig  # noqa: PLC0415

    marker = request.node.get_closest_marker("seod_rig")
    name = marker.args[0] if marker is not None and marker.args else "virtual"
    rig = RigFile.shipped(name)
    if marker is not None and marker.kwargs:
        rig = rig.with_values(marker.kwargs)
    return own_rig(rig, tmp_path)


@pytest.fixture
def seod_daemon(virtual_rig: RigFile, tmp_path: Path) -> Iterator[Daemon]:
    """A daemon that runs `virtual_rig`, on a free port, until the test ends."""
    from seod.testing.daemon import Daemon  # noqa: PLC0415 - only where it is asked for

    with Daemon(virtual_rig, tmp_path / "daemon.log") as daemon:
        yield daemon
