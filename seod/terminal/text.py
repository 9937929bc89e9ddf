"""Numbers, estimates, events and states as text for people. Standard library only."""

from __future__ import annotations

import math
from typing import Any

Message = dict[str, Any]


def number(value: float | None, digits: int = 4) -> str:
    """A number for people; a dash where it is undefined."""
    return "-" if value is None else f"{value:.{digits}g}"


def figure(value: float, digits: int = 4) -> str:
    """A number of a table: always so many significant digits, so that `2.30` stands beside `2.31`."""
    return f"{value:#.{digits}g}".removesuffix(".")


def with_sd(value: float | None, sd: float | None) -> str:
    """`0.21034 ± 0.00041`: as many digits as the standard deviation has to say anything about."""
    if value is None or not sd:
        return number(value)
    decimals = min(12, max(0, 1 - math.floor(math.log10(sd))))
    return f"{value:.{decimals}f} ± {sd:.{decimals}f}"


def estimate(e: Message) -> str:
    """One estimate as a line of a log."""
    parts = [
        f"t={e['t']:.3f}",
        e["axis"],
        e["quality"],
        f"zeta={with_sd(e['zeta'], e['zeta_sd'])}",
        f"omega_n={with_sd(e['omega_n'], e['omega_n_sd'])} rad/s",
        f"frequency={number(e['frequency'])} rad/s",
        f"amplitude={number(e['amplitude'])}",
        f"method={e['method']}",
    ]
    return "  ".join(parts) + (f"  ({e['advice']})" if e["advice"] else "")


def event(e: Message) -> str:
    """One event as a sentence."""
    kind, why = e["event"], e.get("why") or ""
    where = f"{e['axis']}: " if e.get("axis") else ""
    if kind == "state":
        what = f"{e.get('previous') or 'start'} -> {e['state']}"
        return f"{where}{what} ({why})" if why else f"{where}{what}"
    if kind == "changed":
        return f"{where}set {settings(e['values'])}"
    if kind == "started":
        return f"loop {e['generation']} started"
    return f"{kind}: {why if why.startswith(where) else where + why}"


def settings(values: Message, units: Message | None = None) -> str:
    """`e_a = 1.5 V, trim = true, method = exact`, with those units that are told."""
    known = units or {}
    words = {name: f"{_setting(value)} {known.get(name, '')}".rstrip() for name, value in values.items()}
    return ", ".join(f"{name} = {word}" for name, word in words.items())


def _setting(value: bool | float | str | None) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return value if isinstance(value, str) else number(value, 6)


def health(h: Message) -> str:
    """The loop's health in one line."""
    parts = [
        f"{number(h['rate_hz'])} Hz",
        f"lateness p99 {number(h['lateness']['p99_us'], 3)} us",
        f"overruns {h['overruns']}",
        f"lost rows {h['rows_lost']}",
        f"clients {h['clients']['connected']}",
    ]
    if h["recorder"] is not None:
        parts.append(f"recorded {h['recorder']['rows']} rows")
    if not h["realtime"]["ok"]:
        parts.append("not real-time")
    return " | ".join([*parts, *(f"{name} {count}" for name, count in h["counters"].items() if count)])


def axis(a: Message) -> str:
    """The answer to `get`."""
    lines = [f"{a['axis']}: {a['state']}"]
    if a["fault"] is not None:
        lines.append(f"  fault: {a['fault']['why']}")
    lines.append(f"  settings: {settings(a['settings'], a.get('units', {}))}")
    if a["estimate"] is None:
        lines.append("  no estimate yet")
    else:
        lines.append(f"  {estimate(a['estimate'])}  age={number(a['estimate']['age_s'], 3)} s")
    if a.get("model_error"):
        lines.append(f"  {model_error(a['model_error'])}")
    return "\n".join(lines)


def model_error(m: Message) -> str:
    """How well the rig file's model simulates the rig, in one line."""
    holds = "has left its model" if m["left"] else "keeps to its model"
    error = f"error {number(100.0 * m['nrmse'], 3)} % of the movement, statistic {number(m['statistic'], 3)}"
    return f"the rig {holds}: {error} ({m['model']})"


def _truth(s: Message, name: str, truth: Message) -> str:
    gain = s["axes"].get(name, {}).get("units", {}).get("K_L", "")
    return settings(truth, {"K_L": gain, "omega_n": "rad/s"})


def status(s: Message) -> str:
    """The answer to `status`."""
    lines = [
        f"{s['rig']}: {s['state']}, driver {s['driver']}, {number(s['rate_hz'])} Hz, seod {s['version']}"
    ]
    lines += [axis(each) for each in s["axes"].values()]
    if s["truth"]:
        lines += [f"truth of {name}: {_truth(s, name, truth)}" for name, truth in s["truth"].items()]
    lines.append(health(s["health"]))
    lines += [f"not real-time: {why}" for why in s["realtime"]["why"]]
    return "\n".join(lines)
