"""Limit cycle against frequency response: alike at a small amplitude, apart at a large one as predicted.

    python bench/response.py

1. The linear plants of the design under one tick of delay and noise of 1 % of the limit cycle's amplitude:
   the relay's answer (`wave`, K_L known) over 3 s, multisines and sines at the same rate. Goal: within 1 % in
   omega_n and 3 % in zeta.
2. A servo motor whose flow follows the square root of the pressure drop, measured on an integrator written
   apart (RK4), predicted from the rig file's plant by the kernel (`seod response --predict`), and for the
   relay's first harmonic by the describing function of the flow.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from statistics import median

import numpy as np
from scipy.optimize import brentq

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from bench.estimators import E_A, K_L, PLANTS, TICK, feed, relay_rows  # noqa: E402
from seod.config.load import load_rig  # noqa: E402
from seod.identify import Record, identify  # noqa: E402
from seod.respond import Segment, respond  # noqa: E402
from seod.respond.design import Excitation, multisines, settling_time, sines  # noqa: E402
from seod.respond.fit import Plant  # noqa: E402
from seod.respond.predict import predict  # noqa: E402
from tests.unit.flow_truth import Actuator, driven, relay_run  # noqa: E402

LINEAR = 1e9
"""A supply that nothing feels."""
SERVO = Actuator(17.4, 60.0, 0.22, 729.0)
"""Displacement, inertia of Table 1(a) at 8 MPa: D P_s / J = 729 rad/s^2; K_L of Eq. 9."""
AMPLITUDES = (0.05, 0.3, 1.5)


def excitations(plant: Plant, kind: str, volts: float, seed: int = 1) -> list[Excitation]:
    low, high = 0.05 * plant.omega_n / (2 * np.pi), 3.0 * plant.omega_n / (2 * np.pi)
    settling = settling_time(plant, None)
    if kind == "sine":
        drives = [Excitation(1 / t[0].frequency, t, settling, 0.0) for t in sines((low, high), 12)]
    else:
        sets = multisines((low, high), 1 / low, 3, "position", np.random.default_rng(seed))
        drives = [Excitation(1 / low, tones, settling, 0.0) for tones in sets]
    return [drive.scaled(volts) for drive in drives]


def measured(a: Actuator, drive: Excitation, noise: float, delay: int, seed: int) -> Segment:
    periods = 6 if len(drive.tones) > 1 else max(6, int(0.5 / drive.period))
    t = np.arange(int((drive.settling + periods * drive.period) / TICK) + 2) * TICK
    hertz, amplitude, phase = np.array(drive.tones).T
    u = np.sin(2 * np.pi * np.outer(t, hertz) + phase) @ amplitude
    y = driven(a, np.concatenate((np.zeros(delay), u[: len(u) - delay])), noise, seed)
    return Segment.of("apart", t, u, y, None, period=drive.period).after(drive.settling)


def agreement() -> None:
    print("limit cycle against frequency response of linear plants; goal: 1 % in omega_n, 3 % in zeta")
    print(f"{'zeta':>5} {'omega_n':>8} {'by':>10}  {'omega_n':>9} {'zeta':>8}   of the response's own")
    for zeta, omega_n in PLANTS:
        rows = relay_rows(zeta, omega_n, 1, 0.01, 3.0)
        answers = [e for e in feed("wave", rows)[0] if e.quality == "ok"]
        cycle = Plant(K_L, median(e.omega_n for e in answers), median(e.zeta for e in answers))
        noise = 0.01 * 1.28 * K_L * E_A / (2 * zeta * omega_n)
        for kind in ("multisine", "sine"):
            drives = excitations(cycle, kind, E_A)
            actuator = Actuator(K_L, omega_n, zeta, LINEAR)
            segments = [measured(actuator, drive, noise, 1, k) for k, drive in enumerate(drives)]
            fit = respond(segments).fit
            off = cycle.omega_n / fit.plant.omega_n - 1, cycle.zeta / fit.plant.zeta - 1
            sd = fit.sd["omega_n"] / omega_n, fit.sd["zeta"] / zeta
            line = f"{zeta:5} {omega_n:8} {kind:>10}  {100 * off[0]:+8.2f}% {100 * off[1]:+7.2f}%"
            print(f"{line}   sd {100 * sd[0]:.2f} %, {100 * sd[1]:.2f} %")


def described(a: Actuator, e_a: float) -> float:
    """zeta that the limit cycle shows by its first harmonic at omega_n: pressure and relay are in phase."""
    shape = np.abs(np.cos(np.linspace(0, 2 * np.pi, 4001)[:-1]))

    def surplus(speed: float) -> float:
        drop = 1 - speed * a.omega_n * shape / a.supply
        flow = a.K_L * e_a * np.sign(drop) * np.sqrt(np.abs(drop))
        return float(2 * np.mean(flow * shape) - 2 * a.zeta * speed)

    largest = 2 / np.pi * e_a * a.K_L / a.zeta
    return 2 / np.pi * e_a * a.K_L / brentq(surplus, 0.0, largest)


def large_amplitudes() -> None:
    print(f"\nsquare-root flow, zeta {SERVO.zeta}, omega_n {SERVO.omega_n}, supply {SERVO.supply:g} rad/s^2")
    print(f"{'e_a [V]':>8} {'':>12} {'measured':>9} {'predicted':>10}      off   describing function")
    rig = rig_file()
    for e_a in AMPLITUDES:
        drives = excitations(Plant(*SERVO[:3]), "multisine", e_a)
        expected = predict(rig, "motor", drives, e_a, SERVO.K_L)
        t, u, y = relay_run(SERVO, e_a, 3.0)
        late = t > 1.0
        fit = identify([Record("relay", t[late], u[late], y[late])], SERVO.K_L, 0.0).fit
        cycle = fit.value["zeta"] if fit else float("nan")
        found = respond([measured(SERVO, drive, 0.0, 0, k) for k, drive in enumerate(drives)]).fit.plant
        for name, value, other in (
            ("limit cycle", cycle, expected.limit_cycle.zeta),
            ("response", found.zeta, expected.response.zeta),
            ("ratio", cycle / found.zeta, expected.limit_cycle.zeta / expected.response.zeta),
        ):
            closed = f"{described(SERVO, e_a):.4f}" if name == "limit cycle" else ""
            off = f"{100 * (other / value - 1):+6.2f} %"
            print(f"{e_a:8} {name:>12} {value:9.4f} {other:10.4f} {off}   {closed}")


def rig_file():
    config = load_rig(ROOT / "configs" / "virtual.yaml")
    simulation = config.simulation
    changes = {
        "K_L": SERVO.K_L,
        "omega_n": SERVO.omega_n,
        "zeta": SERVO.zeta,
        "effects": {"square_root_flow": {"supply": SERVO.supply}},
        "stops": None,
    }
    plants = {"motor": simulation.plants["motor"].model_copy(update=changes)}
    axis = config.axes["motor"]
    axis = axis.model_copy(update={"relay": axis.relay.model_copy(update={"hysteresis": 0.0})})
    return config.model_copy(
        update={"simulation": simulation.model_copy(update={"plants": plants}), "axes": {"motor": axis}}
    )


if __name__ == "__main__":
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    agreement()
    large_amplitudes()
