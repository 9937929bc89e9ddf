"""An example or two of each command, shown by its `--help`, in the order in which commands are listed."""

from __future__ import annotations

from typing import Final

EXAMPLES: Final[dict[str, tuple[str, ...]]] = {
    "init": (
        "seod init --virtual --out rig.yaml",
        "seod init --dbc motor.dbc --interface can0 --listen --out rig.yaml",
    ),
    "run": ("seod run configs/virtual.yaml --start --watch", "seod run rig.yaml --record run.mcap --for 60"),
    "rig": ("seod rig configs/can.yaml", "seod rig configs/serial.yaml --for 30"),
    "neutral": ("seod neutral rig.yaml",),
    "check": ("seod check rig.yaml",),
    "upgrade": ("seod upgrade rig.yaml",),
    "latency": ("seod latency --for 10", "seod latency --json"),
    "calibrate": ("seod calibrate rig.yaml --dry-run", "seod calibrate rig.yaml --axis motor --pressures 3"),
    "status": ("seod status", "SEOD_HOST=rig7 SEOD_TOKEN=... seod status --json"),
    "get": ("seod get motor", "seod get --json"),
    "watch": ("seod watch", "seod watch --json --axis motor --rate 10 | head -100"),
    "set": ("seod set e_a=400mV", "seod set motor 'K_L=50 mm/s/V' method=wave"),
    "start": ("seod start --wait", "seod start motor --hold"),
    "stop": ("seod stop", "seod stop motor"),
    "estop": ("seod estop",),
    "reset": ("seod reset", "seod reset motor"),
    "ramp": ("seod ramp --from 0.1 --to 1.5 --steps 8 --plot ramp.png",),
    "identify": (
        "seod identify run.csv --units y=mm",
        "seod identify a.mcap b.mcap --config rig.yaml --json",
    ),
    "response": (
        "seod response --config rig.yaml --plot bode.png",
        "seod response sweep.csv --gain '17 rad/s/V'",
    ),
    "diagnose": (
        "seod diagnose run.csv --units y=mm --out found",
        "seod diagnose run.mcap --config rig.yaml",
    ),
    "simulate": (
        "seod simulate configs/virtual.yaml --out run.csv --effect coulomb_friction.level=500",
        "seod simulate rig.yaml --out sweep.csv --excitation sweep --amplitude '400 mV' --band 0.5:60",
    ),
    "batch": (
        "seod batch identify recordings/ --units y=mm --out found",
        "seod batch simulate rig.yaml --seeds 0-99 --workers 2 --out drawn",
        "seod batch diagnose recordings/*.mcap --scheduler tcp://host:8786",
    ),
    "info": ("seod info run.mcap", "seod info log.blf --dbc motor.dbc --plot columns.png"),
    "export": ("seod export run.mcap --to parquet", "seod export run.csv --to mat --units y=deg"),
    "report": (
        "seod report motor --since 2026-11-01 --archive recordings --out motor.html",
        "seod report motor --config rig.yaml --response bode.json --limit omega_n=100: --out motor.pdf",
    ),
    "scrub": ("seod scrub run.mcap",),
    "archive build": ("seod archive recordings", "seod archive s3://bench/2026 --workers 2 --diagnose"),
    "archive query": (
        "seod archive query recordings 'SELECT rig, max(omega_n) FROM segments GROUP BY rig' --out most.csv",
    ),
    "archive trend": ("seod archive trend recordings --quantity omega_n --rig bench7 --plot trend.svg",),
    "archive left-model": (
        "seod archive left-model recordings",
        "seod archive left-model recordings --to csv",
    ),
    "archive causes": ("seod archive causes recordings --since 2026-01-01",),
    "archive compare": ("seod archive compare recordings bench7 bench8 --plot both.svg",),
    "fleet": (
        "seod fleet --broker broker.plant:8883 --tls ca.pem",
        "seod fleet --broker localhost --archive DIR",
    ),
    "paper": ("seod paper --out paper", "seod paper --figure 11 --figure exponent"),
}

PANELS: Final[dict[str, tuple[str, ...]]] = {
    "Data": ("columns", "units", "between", "axis", "output", "hold", "holdout", "dbc", "group", "offset"),
    "What is known": ("config", "gain", "delay", "limit_cycle"),
    "Excitation": (
        "kind",
        "excitation",
        "amplitude",
        "bias",
        "band",
        "period",
        "periods",
        "realisations",
        "points",
        "frequency",
        "duration",
        "lines",
        "cycles",
        "input_",
        "relay",
        "e_a",
        "seed",
        "seeds",
        "effect",
        "noise",
        "latency",
        "predict",
        "low",
        "high",
        "steps",
    ),
    "Workers": ("scheduler", "workers", "memory"),
    "Search": ("method", "effort", "relevance"),
    "Answer": ("as_json", "plot", "out", "to", "force"),
    "Connection": (
        "host",
        "port",
        "rig_name",
        "token",
        "token_file",
        "tls",
        "broker",
        "user",
        "password_file",
    ),
}
"""Groups of options, in the order in which `--help` shows them."""


def place(command: str) -> int:
    """Where a command, or a group of some, stands in lists: in the order of `EXAMPLES`."""
    known = [k for k, name in enumerate(EXAMPLES) if name == command or name.startswith(f"{command} ")]
    return min(known, default=len(EXAMPLES))


def epilog(command: str) -> str:
    """What stands below the options."""
    return "\n\n".join(["Examples:", *(f"  {line}" for line in EXAMPLES.get(command, ()))])


def panel(option: str, command: str) -> str | None:
    """The group of an option; None for those that stand alone."""
    if command in ("run", "watch", "rig", "latency") and option in ("duration", "hold"):
        return None
    if command == "start" and option == "hold":
        return None
    return next((title for title, names in PANELS.items() if option in names), None)
