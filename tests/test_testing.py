"""The pytest plugin as control software's tests use it, and the asyncio client against a real daemon."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import seod

if TYPE_CHECKING:
    from seod.testing.daemon import Daemon

pytestmark = pytest.mark.processes
EXAMPLE = Path(__file__).parents[1] / "docs" / "how-to" / "examples" / "test_controller.py"


def test_the_example_of_the_page_passes(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_controller=EXAMPLE.read_text())
    done = pytester.runpytest_subprocess("-q", "-p", "no:cacheprovider")
    done.assert_outcomes(passed=2)


def test_a_daemon_that_does_not_come_up_says_why(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest

        @pytest.fixture
        def virtual_rig(virtual_rig):
            text = virtual_rig.path.read_text().replace("e_a: 0.5 V", "e_a: 0.5 m")
            virtual_rig.path.write_text(text)
            return virtual_rig

        def test_it(seod_daemon):
            assert False, "comes never so far"
        """
    )
    done = pytester.runpytest_subprocess("-q", "-p", "no:cacheprovider")
    done.assert_outcomes(errors=1)
    done.stdout.fnmatch_lines(["*the daemon ended: *relay.e_a*"])


async def test_tasks_share_an_asyncio_client(seod_daemon: Daemon) -> None:
    async with seod.AsyncClient(port=seod_daemon.port, wait=10.0) as rig:
        info, status = await asyncio.gather(rig.info(), rig.status())
        assert info["rig"] == status["rig"] == seod_daemon.rig.rig
        with pytest.raises(seod.ClientError, match="nothing_such"):
            await rig.call("nothing_such")

        async def first_ok() -> float:
            async for estimate in rig.estimates("motor"):
                if estimate["quality"] == "ok":
                    return float(estimate["omega_n"])
            raise AssertionError

        waiting = asyncio.create_task(first_ok())
        for _ in range(100):  # its first samples may be under way
            try:
                await rig.start()
                break
            except seod.ClientError:
                await asyncio.sleep(0.05)
        async with asyncio.timeout(40.0):
            assert await waiting == pytest.approx(117.0, rel=0.05)
        settings = await rig.set("motor", e_a=0.4)
        assert settings["settings"]["e_a"] == 0.4
        await rig.stop()


async def test_an_asyncio_client_is_told_that_the_daemon_has_ended(seod_daemon: Daemon) -> None:
    async with seod.AsyncClient(port=seod_daemon.port) as rig:
        await rig.info()
        seod_daemon.__exit__()
        with pytest.raises(seod.ClientError):
            await asyncio.wait_for(anext(rig.notifications()), 20.0)
        with pytest.raises(seod.ClientError, match="ended"):
            await rig.info()
    with pytest.raises(seod.ClientError, match="no daemon listens"):
        await seod.AsyncClient(port=seod_daemon.port).connect()
