"""The numbers of each figure and table: what the simulated rigs show, by each method, with intervals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from seod.estimate.limit_cycle.closed_form import correction_factors
from seod.estimate.limit_cycle.inversion import eq8
from seod.paper.bench import Bench, rig
from seod.paper.daemon import Daemon
from seod.processes.ring import Column
from sim.parameters import parameters
from sim.runs import RELAY, ideal_relay
from sim.state import new_state

if TYPE_CHECKING:
    from collections.abc import Callable

    from seod.config.model import RigConfig
    from seod.estimate.base import Estimate
    from seod.respond.response import Response

Numbers = dict[str, Any]

SURE: Final = 1.96
"""Standard deviations of a 95 % interval."""
LIVE: Final = ("peaks", "exact", "wave")
SETTLED_S: Final = 1.5
"""After the relay is on; the trim of the bias is over then."""
STEADY_S: Final = 2.0
"""Of answers at one operating point."""
SWEEP_S: Final = 10.0
SERVO: Final = "servo-hydraulic"
SEAT: Final = "seat-hydraulic"
TAIL: Final = "tail-hydraulic"
DIGITS: Final = 9
"""Significant digits that are kept: what differs between machines lies below."""


def kept(value: Any) -> Any:
    """Numbers rounded to `DIGITS`, nan as null; anything that JSON knows."""
    if isinstance(value, dict):
        return {key: kept(each) for key, each in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [kept(each) for each in value]
    if isinstance(value, float | np.floating):
        return float(f"{float(value):.{DIGITS}g}") if math.isfinite(value) else None
    return value


def median(told: list[Estimate], name: str) -> float | None:
    """Of one value of many answers; None where none has it."""
    values = [getattr(each, name) for each in told if getattr(each, name) is not None]
    return float(np.median(values)) if values else None


def answer(told: list[Estimate]) -> Numbers:
    """The median of steady answers with half the width of one answer's 95 % interval."""
    found: Numbers = {name: median(told, name) for name in ("zeta", "omega_n", "K_L", "misfit")}
    for name in ("zeta", "omega_n", "K_L"):
        sd = median(told, f"{name}_sd")
        found[f"{name}_95"] = None if sd is None else SURE * sd
    words = [each.quality for each in told]
    return found | {"quality": max(sorted(set(words)), key=words.count) if words else "no_oscillation"}


def of_response(response: Response) -> Numbers:
    """Fit and points of a frequency response."""
    plant, sd, points = response.fit.plant, response.fit.sd, response.points
    found: Numbers = {name: getattr(plant, name) for name in ("zeta", "omega_n", "K_L", "delay")}
    found |= {f"{name}_95": SURE * sd[name] for name in ("zeta", "omega_n", "K_L")}
    without = response.without_delay.plant
    return found | {
        "quality": response.quality,
        "without_delay": {"zeta": without.zeta, "omega_n": without.omega_n, "K_L": without.K_L},
        "points": {"omega": points.omega, "gain": np.abs(points.G), "phase": np.unwrap(np.angle(points.G))},
    }


def point(
    name: str, axis: str, ps: float, speed: float, sizes: tuple[float, ...], band: tuple[float, float]
) -> Numbers:
    """All methods at one operating point.

    Args:
        name: Of the rig file.
        axis: Of the axis.
        ps: Supply pressure [Pa].
        speed: About which [unit/s]; in position mode 0.
        sizes: Peak voltages of the frequency response [V].
        band: Of it [Hz].
    """
    bench = Bench(name, axis)
    settings: dict[str, Any] = {"reference": speed} if bench.velocity else {}
    found: Numbers = {"ps": ps, "speed": speed, "small_signal": bench.true(ps, speed)}
    with Daemon(at_pressure(name, axis, ps), axis, LIVE, settings=settings or None) as daemon:
        daemon.start()
        daemon.run(SETTLED_S)
        daemon.forget()
        daemon.run(STEADY_S)
        found |= {method: answer(told) for method, told in daemon.told.estimates.items()}
    with Daemon(
        at_pressure(name, axis, ps), axis, ("two-phase",), settings={**settings, "two_phase": True}
    ) as daemon:
        daemon.start()
        daemon.run(SETTLED_S)
        daemon.forget()
        daemon.run(STEADY_S)
        found["two-phase"] = answer(daemon.told.estimates["two-phase"])
    for size in sizes:
        found[f"response_{size:g}"] = of_response(bench.response(size, band, ps=ps, speed=speed))
    return found


def at_pressure(name: str, axis: str, ps: float, **axis_changes: Any) -> RigConfig:
    """A shipped rig at a supply pressure [Pa] from the start."""
    config = rig(name)
    if config.simulation is None:
        raise ValueError(f"{name} has no simulation")
    simulation = config.simulation.model_copy(
        update={"constants": {**config.simulation.constants, "pressure": ps}}
    )
    axes = {**config.axes, axis: config.axes[axis].model_copy(update=axis_changes)}
    return config.model_copy(update={"simulation": simulation, "axes": axes})


def swept(daemon: Daemon, over: str, course: Callable[[float], None] | None, seconds: float) -> Numbers:
    """Answers while something sweeps; `over` is `ps` [Pa] or `mean_speed` [unit/s] of the estimate."""
    daemon.start()
    daemon.run(SETTLED_S)
    daemon.forget()
    daemon.run(seconds, course)
    found: Numbers = {}
    for method, told in daemon.told.estimates.items():
        good = [
            e for e in told if e.zeta is not None and e.omega_n is not None and getattr(e, over) is not None
        ]
        found[method] = {
            over: [getattr(e, over) for e in good],
            **{name: [getattr(e, name) for e in good] for name in ("zeta", "omega_n")},
            **{f"{n}_95": [SURE * (getattr(e, f"{n}_sd") or 0.0) for e in good] for n in ("zeta", "omega_n")},
            "quality": [e.quality for e in good],
        }
    return found


def exponent(x: list[float], y: list[float]) -> float:
    """Slope of log y over log x, by least squares."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def figure_4() -> Numbers:
    """Correction factors: Eq. 8, the exact limit cycle, and simulation with an ideal relay."""
    grid = np.geomspace(0.1, 5.0, 60)
    exact = np.array([correction_factors(zeta) for zeta in grid.tolist()])
    fitted = np.array([eq8(zeta) for zeta in grid.tolist()])
    marks = (0.1, 0.2, 0.45, 0.7, 1.0, 1.5, 2.0, 3.0, 4.0)
    simulated = [_simulated_factors(zeta) for zeta in marks]
    return {
        "zeta": grid,
        "xi_exact": exact[:, 0],
        "Gamma_exact": exact[:, 1],
        "xi_eq8": fitted[:, 0],
        "Gamma_eq8": fitted[:, 1],
        "zeta_simulated": marks,
        "xi_simulated": [each[0] for each in simulated],
        "Gamma_simulated": [each[1] for each in simulated],
        "worst_xi": float(np.max(np.abs(fitted[:, 0] / exact[:, 0] - 1.0))),
        "worst_Gamma": float(np.max(np.abs(fitted[:, 1] / exact[:, 1] - 1.0))),
    }


def _simulated_factors(zeta: float) -> tuple[float, float]:
    """Both factors, xi and Gamma, of the reduced kernel under a relay that sees every instant."""
    K_L, omega_n, e_a = 17.0, 117.0, 0.5
    p = parameters(K_L, omega_n, zeta)
    state, relay = new_state(p), np.zeros(1, RELAY)
    relay["e_a"] = e_a
    period = 2.0 * math.pi / omega_n
    cycles = 60.0 + 40.0 / zeta
    t = np.arange(round(cycles * 400.0)) * (period / 400.0)
    y, switches = np.empty(len(t)), np.empty(4 * round(cycles) + 40)
    count = min(ideal_relay(p[0], state[0], relay[0], t, y, switches), len(switches))
    frequency = 2.0 * math.pi / float(switches[count - 1] - switches[count - 3])
    late = y[-2000:]
    amplitude = 0.5 * float(_peak(late) + _peak(-late))
    return frequency / omega_n, amplitude * 2.0 * zeta * omega_n / (K_L * e_a)


def _peak(y: np.ndarray) -> float:
    """Highest value between the samples, by a parabola."""
    k = int(np.argmax(y[1:-1])) + 1
    a, b, c = y[k - 1 : k + 2].tolist()
    bend = a - 2.0 * b + c
    return float(b if bend == 0.0 else b - (c - a) ** 2 / (8.0 * bend))


def figure_10() -> Numbers:
    """Waves of the velocity loop: speed, the relay's input and output."""
    with Daemon(at_pressure(SERVO, "motor", 8e6), "motor", ("peaks",)) as daemon:
        daemon.start()
        daemon.run(SETTLED_S)
        daemon.forget()
        daemon.run(0.5)
        told = daemon.told
        t, u, y = (told.column(which) for which in (Column.T, Column.U, Column.Y))
        signal, bias = told.column(Column.SIGNAL), told.column(Column.BIAS)
    turns = int(np.count_nonzero(np.diff(np.sign(u - bias))))
    return {
        "t": t - t[0],
        "speed": y,
        "relay_input": signal,
        "relay_output": u - bias,
        "switches": turns,
        "speed_noise": 0.2,
        "cycle_s": 2.0 * float(t[-1] - t[0]) / max(turns, 1),
    }


def figure_11() -> Numbers:
    """Supply pressure 5 to 10 MPa at 32.5 rad/s."""
    low, high, speed = 5e6, 10e6, 32.5
    with Daemon(at_pressure(SERVO, "motor", low), "motor", LIVE) as daemon:
        found = swept(
            daemon,
            "ps",
            lambda s: daemon.constant("pressure", low + (high - low) * min(1.0, s / SWEEP_S)),
            SWEEP_S,
        )
    return found | _along_pressure(
        Bench(SERVO, "motor"), (5e6, 6e6, 7e6, 8e6, 9e6, 10e6), speed, (0.3, 1.5), (1.0, 40.0), found
    )


def _along_pressure(
    bench: Bench,
    pressures: tuple[float, ...],
    speed: float,
    sizes: tuple[float, ...],
    band: tuple[float, float],
    found: Numbers,
) -> Numbers:
    """Small signals and frequency responses at some pressures, and the exponents of omega_n."""
    small = [bench.true(ps, speed) for ps in pressures]
    more: Numbers = {
        "small_signal": {"ps": pressures}
        | {n: [each[n] for each in small] for n in ("zeta", "omega_n", "K_L")}
    }
    for size in sizes:
        fits = [of_response(bench.response(size, band, ps=ps, speed=speed)) for ps in pressures]
        more[f"response_{size:g}"] = {"ps": pressures} | {
            n: [each[n] for each in fits] for n in ("zeta", "omega_n", "zeta_95", "omega_n_95", "quality")
        }
    both = found | more
    more["exponents"] = {
        name: exponent(each["ps"], each["omega_n"]) for name, each in both.items() if len(each["ps"]) > 2
    }
    return more


def figure_12() -> Numbers:
    """Speed 0 to 120 rad/s at 8 MPa."""
    config = at_pressure(SERVO, "motor", 8e6, reference=0.0, ramp=120.0 / SWEEP_S)
    with Daemon(config, "motor", LIVE) as daemon:
        daemon.start()
        daemon.run(SETTLED_S)
        daemon.forget()
        daemon.set(reference=120.0)
        daemon.run(SWEEP_S)
        told = daemon.told
    found: Numbers = {}
    for method, estimates in told.estimates.items():
        good = [
            e for e in estimates if e.zeta is not None and e.omega_n is not None and e.mean_speed is not None
        ]
        found[method] = {
            "speed": [e.mean_speed for e in good],
            **{name: [getattr(e, name) for e in good] for name in ("zeta", "omega_n")},
            **{f"{n}_95": [SURE * (getattr(e, f"{n}_sd") or 0.0) for e in good] for n in ("zeta", "omega_n")},
            "quality": [e.quality for e in good],
        }
    bench, speeds = Bench(SERVO, "motor"), (0.0, 20.0, 40.0, 60.0, 80.0, 100.0, 120.0)
    small = [bench.true(8e6, speed) for speed in speeds]
    found["small_signal"] = {"speed": speeds} | {n: [s[n] for s in small] for n in ("zeta", "omega_n", "K_L")}
    fits = [of_response(bench.response(0.3, (1.0, 40.0), ps=8e6, speed=speed)) for speed in speeds]
    found["response_0.3"] = {"speed": speeds} | {
        n: [each[n] for each in fits] for n in ("zeta", "omega_n", "zeta_95", "omega_n_95", "quality")
    }
    return found


def figure_13() -> Numbers:
    """Bode plots at 0, 70 and 133 rad/s, 8 MPa."""
    return {
        f"{speed:g}": point(SERVO, "motor", 8e6, speed, (0.3, 1.5), (1.0, 60.0))
        for speed in (0.0, 70.0, 133.0)
    }


PRINTED: Final = {
    "pitch": {"zeta": {"SEO": 0.45, "FR": 0.41}, "omega_n": {"SEO": 145.0, "FR": 151.0}},
    "roll": {"zeta": {"SEO": 0.21, "FR": 0.24}, "omega_n": {"SEO": 117.0, "FR": 120.0}},
}
"""Table 2 as it is printed."""


def figure_14() -> Numbers:
    """Motion seat at 7 MPa and 0.5 V: Bode plot of roll, and Table 2."""
    found = {axis: point(SEAT, axis, 7e6, 0.0, (0.1, 0.5), (3.0, 60.0)) for axis in ("pitch", "roll")}
    return {**found, "printed": PRINTED}


def figure_15() -> Numbers:
    """Rudder over supply pressure; the paper prints no range, 4 to 10 MPa are taken."""
    low, high = 4e6, 10e6
    with Daemon(at_pressure(TAIL, "rudder", low), "rudder", LIVE) as daemon:
        found = swept(
            daemon,
            "ps",
            lambda s: daemon.constant("pressure", low + (high - low) * min(1.0, s / SWEEP_S)),
            SWEEP_S,
        )
    return found | _along_pressure(
        Bench(TAIL, "rudder"), (4e6, 5e6, 6e6, 7e6, 8e6, 9e6, 10e6), 0.0, (0.1,), (3.0, 60.0), found
    )
