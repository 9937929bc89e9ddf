"""Rig files as texts that tests edit."""

from __future__ import annotations

import re

from seod.paths import configs_dir


def can_at_2_khz() -> str:
    """The shipped CAN rig at 2 kHz with the default times: the tests' bus loads and ages."""
    text = (configs_dir() / "can.yaml").read_text().replace("rate_hz: 1000", "rate_hz: 2000")
    text = re.sub(r"^  rate_hz: 2000 .*\n  hang_timeout.*\n", "  rate_hz: 2000\n", text, flags=re.MULTILINE)
    return text.replace("stale: 20 ms", "stale: 10 ms")
