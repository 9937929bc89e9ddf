"""Rig files as texts that tests edit."""

from __future__ import annotations

import re

from seod.files.shipped import configs_dir


def can_at_2_khz() -> str:
    """The shipped CAN rig at 2 kHz with the default times: the tests' bus loads and ages."""
    text = (configs_dir() / "can.yaml").read_text().replace("rate_hz: 500", "rate_hz: 2000")
    text = re.sub(r"^  rate_hz: 2000 .*\n  hang_timeout.*\n", "  rate_hz: 2000\n", text, flags=re.MULTILINE)
    text = text.replace("rig_watchdog: 50 ms", "rig_watchdog: 20 ms")
    text = text.replace("watchdog_s: 0.05", "watchdog_s: 0.02")
    return text.replace("stale: 50 ms", "stale: 10 ms")
