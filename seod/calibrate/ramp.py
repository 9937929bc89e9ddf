"""An e_a ramp: zeta and omega_n over the relay's amplitude, and the smallest that oscillates cleanly."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seod.calibrate.procedure import CalibrationError
from seod.files.user_files import named
from seod.terminal.text import number, with_sd

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from seod.client import Client

SETTLE_S = 1.0
"""After each change of e_a estimates are let go for this long."""
ESTIMATES = 20
"""So many make one step."""
STEP_S = 6.0
"""A step ends after this, however few have come."""
CLEAN_SHARE = 0.9
"""A clean step has at least this share of estimates with quality ok"""
CLEAN_SCATTER = 0.05
"""and their zeta scatters by no more than this share of its mean."""


@dataclass(frozen=True, slots=True)
class Step:
    """Means at one e_a [V]: omega_n [rad/s]; sd is that of the mean, None without estimates that have one."""

    e_a: float
    estimates: int
    ok: float
    zeta: float | None
    zeta_sd: float | None
    omega_n: float | None
    omega_n_sd: float | None
    clean: bool


def step_of(e_a: float, estimates: Sequence[dict[str, Any]]) -> Step:
    """What the estimates at one amplitude say together.

    Neighbouring estimates share their window, and all of them what is known of the delay: the mean is
    credited no more than the median's own sd, and none where the method states none.
    Those that are good but for their dependence on e_a count: it is what the ramp is to show.
    """
    good = [e for e in estimates if _is_clean(e) and e["zeta"] is not None]
    share = len(good) / len(estimates) if estimates else 0.0
    if len(good) < 4:
        return Step(e_a, len(estimates), share, None, None, None, None, False)
    means, sds, scatters = [], [], []
    for name in ("zeta", "omega_n"):
        values = np.array([e[name] for e in good])
        own = [e[f"{name}_sd"] for e in good if e[f"{name}_sd"] is not None]
        spread = float(values.std(ddof=1))
        means.append(float(values.mean()))
        sds.append(max(spread / math.sqrt(len(good) / 4), float(np.median(own))) if own else None)
        scatters.append(spread / float(values.mean()))
    clean = share >= CLEAN_SHARE and scatters[0] <= CLEAN_SCATTER
    return Step(e_a, len(estimates), share, means[0], sds[0], means[1], sds[1], clean)


def _is_clean(estimate: dict[str, Any]) -> bool:
    return estimate["quality"] == "ok" or estimate.get("e_a_dependence") is not None


def smallest_clean(steps: Sequence[Step]) -> float | None:
    """Smallest e_a from which on all are clean [V]; None if the largest is not."""
    found = None
    for step in sorted(steps, key=lambda each: -each.e_a):
        if not step.clean:
            break
        found = step.e_a
    return found


def depends(steps: Sequence[Step], name: str) -> bool:
    """Whether zeta or omega_n differs between clean steps by more than their 95 % intervals explain."""
    clean = [step for step in steps if step.clean and getattr(step, f"{name}_sd") is not None]
    if len(clean) < 2:
        return False
    values = np.array([getattr(step, name) for step in clean])
    weights = 1.0 / np.array([max(getattr(step, f"{name}_sd"), 1e-12) for step in clean]) ** 2
    chi2 = float(weights @ (values - weights @ values / weights.sum()) ** 2)
    from scipy.stats import chi2 as distribution  # noqa: PLC0415 - slow to import, needed at the end

    return chi2 > float(distribution.ppf(0.95, len(clean) - 1))


def ramp(client: Client, axis: str, low: float, high: float, steps: int) -> Iterator[Step]:
    """Excite the axis and raise e_a from `low` to `high` [V]; e_a and state are as before afterwards.

    Raises:
        CalibrationError: The axis is in fault or ends meanwhile.
        RequestError: Refused; says why.
    """
    before = client.get(axis)
    was_idle = before["state"] == "idle"
    subscription = client.subscribe(["estimate", "event"], [axis])
    try:
        client.set(axis, e_a=low)
        if was_idle:
            client.start(axis)
        for e_a in np.linspace(low, high, steps).tolist():
            client.forget()
            client.set(axis, e_a=e_a)
            yield step_of(e_a, settled(client, axis))
    finally:
        client.unsubscribe(subscription)
        if was_idle:
            client.stop(axis)
        client.set(axis, e_a=before["settings"]["e_a"])


def settled(client: Client, axis: str) -> list[dict[str, Any]]:
    """Estimates of one step, once the limit cycle has followed the new amplitude.

    Estimates come after the rows that they are of: the change's own event tells from when on they count. Both
    have to be subscribed to before the change.

    Raises:
        CalibrationError: The axis is in fault.
    """
    since, kept = None, []
    for message in client.notifications(STEP_S):
        estimate = message["params"]
        if estimate.get("axis") != axis or message["method"] not in ("estimate", "event"):
            continue
        if message["method"] == "event":
            since = estimate["t"] if "e_a" in estimate.get("values", {}) else since
            continue
        since = estimate["t"] if since is None else since
        if estimate["quality"] == "fault":
            raise CalibrationError(f"{axis} is in fault: {client.get(axis)['fault']['why']}")
        if estimate["t"] - since >= SETTLE_S:
            kept.append(estimate)
        if len(kept) == ESTIMATES:
            break
    return kept


def report(axis: str, steps: Sequence[Step]) -> dict[str, Any]:
    """The whole answer for programs."""
    return {
        "axis": axis,
        "steps": [asdict(step) for step in steps],
        "smallest_clean_e_a": smallest_clean(steps),
        "depends_on_e_a": {name: depends(steps, name) for name in ("zeta", "omega_n")},
    }


def as_text(answer: dict[str, Any]) -> str:
    """The whole answer for people."""
    lines = [f"{'e_a [V]':>8}  {'ok':>5}  {'zeta':<20}  {'omega_n [rad/s]':<20}"]
    for s in answer["steps"]:
        row = f"{s['e_a']:>8.4g}  {100 * s['ok']:>4.0f}%  {with_sd(s['zeta'], s['zeta_sd']):<20}  "
        lines.append(row + f"{with_sd(s['omega_n'], s['omega_n_sd']):<20}  {'clean' if s['clean'] else ''}")
    least = answer["smallest_clean_e_a"]
    lines.append("no clean limit cycle" if least is None else f"clean from e_a = {number(least)} V on")
    changed = [name for name, yes in answer["depends_on_e_a"].items() if yes]
    if changed:
        lines.append(
            f"{' and '.join(changed)} depend on e_a by more than the 95 % interval: state e_a with them"
        )
    return "\n".join(line.rstrip() for line in lines)


def plot(answer: dict[str, Any], path: Path) -> None:
    """Draw zeta and omega_n over e_a into a PNG file.

    Raises:
        CalibrationError: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure  # noqa: PLC0415 - optional
    except ImportError as error:
        raise CalibrationError("--plot needs matplotlib: pip install matplotlib") from error
    figure = Figure(figsize=(6.4, 5.0), layout="constrained")
    good = [step for step in answer["steps"] if step["zeta"] is not None]
    for axes, name in zip(figure.subplots(2, 1, sharex=True), ("zeta", "omega_n"), strict=True):
        bars = [1.96 * (step[f"{name}_sd"] or 0.0) for step in good]
        axes.errorbar([s["e_a"] for s in good], [s[name] for s in good], bars, fmt="o-", capsize=3)
        axes.set_ylabel("zeta" if name == "zeta" else "omega_n [rad/s]")
    axes.set_xlabel("e_a [V]")
    with named(path):
        figure.savefig(path, format="png", dpi=120)


def run(
    client: Client, axis: str | None, low: float, high: float, steps: int, to: Path | None, as_json: bool
) -> None:
    """`seod ramp`.

    Raises:
        CalibrationError: It cannot be done; says why.
    """
    name = client.get(axis)["axis"]
    found = []
    for step in ramp(client, name, low, high, steps):
        found.append(step)
        sys.stderr.write(f"{name}: e_a = {step.e_a:.4g} V, {step.estimates} estimates\n")
    answer = report(name, found)
    sys.stdout.write((json.dumps(answer) if as_json else as_text(answer)) + "\n")
    if to is not None:
        plot(answer, to)
