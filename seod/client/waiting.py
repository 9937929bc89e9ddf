"""Start, and wait until the answer is there. Standard library only."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from seod.client.connection import ClientError, RequestError

if TYPE_CHECKING:
    from seod.client.connection import Client

SAMPLES_S = 5.0
"""A rig that refuses to start is asked again for this long: its first samples may still be under way."""
PAUSE_S = 0.1
LOOK_S = 0.05


def start_and_wait(client: Client, axis: str | None, timeout: float) -> dict[str, dict[str, Any]]:
    """Excite an axis, or all, and wait until each has an estimate of quality `ok`.

    Args:
        client: A connection that nobody else uses meanwhile.
        axis: Of several.
        timeout: How long to wait [s].

    Returns:
        The estimates, by axis.

    Raises:
        ClientError: It is refused, a fault comes first, or there is none in time; says why.
    """
    began = time.monotonic()
    _started(client, axis, began)
    names = [axis] if axis is not None else list(client.info()["axes"])
    found: dict[str, dict[str, Any]] = {}
    while True:
        told = {name: client.get(name) for name in names}
        for name, each in told.items():
            if each["fault"] is not None:
                raise ClientError(f"{name}: fault: {each['fault']['why']}")
            if each["estimate"] is not None and each["estimate"]["quality"] == "ok":
                found[name] = each["estimate"]
        if len(found) == len(names):
            return found
        if time.monotonic() > began + timeout:
            raise ClientError(
                f"no estimate of quality ok within {timeout:g} s: "
                + "; ".join(_why(name, told[name]) for name in names if name not in found)
            )
        time.sleep(LOOK_S)


def _started(client: Client, axis: str | None, began: float) -> None:
    while True:
        try:
            client.start(axis)
        except RequestError:
            if time.monotonic() > began + SAMPLES_S:
                raise
            time.sleep(PAUSE_S)
        else:
            return


def _why(name: str, told: dict[str, Any]) -> str:
    estimate = told["estimate"]
    if estimate is None:
        return f"{name} is {told['state']}, without an estimate"
    advice = f" ({estimate['advice']})" if estimate.get("advice") else ""
    return f"{name} is {told['state']}, quality {estimate['quality']}{advice}"
