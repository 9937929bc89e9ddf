"""The notifications of one axis, as clients get them and as recordings keep them."""

from __future__ import annotations

from typing import Any

from seod.estimate.base import Estimate, finite_or_none
from seod.processes.ring import FLAG_FRESH, FLAG_SECOND_PHASE, AxisState

RowTuple = tuple[float, float, float, float, float, float, float, float, float, float, float, int, int]
"""One axis of a row in the order of `seod.processes.ring.Column`."""


def message(axis: str, estimate: Estimate, now: float) -> dict[str, Any]:
    """The `estimate` notification; `ps` [Pa] and `temperature` [K] are null where no sensor tells them."""
    return {
        "axis": axis,
        "t": estimate.t,
        "age_s": now - estimate.t,
        "zeta": estimate.zeta,
        "zeta_sd": estimate.zeta_sd,
        "omega_n": estimate.omega_n,
        "omega_n_sd": estimate.omega_n_sd,
        "K_L": estimate.K_L,
        "K_L_sd": estimate.K_L_sd,
        "delay_s": estimate.delay_s,
        "delay_sd_s": estimate.delay_sd_s,
        "frequency": estimate.frequency,
        "amplitude": estimate.amplitude,
        "asymmetry": estimate.asymmetry,
        "mean_speed": estimate.mean_speed,
        "ps": estimate.ps,
        "temperature": estimate.temperature,
        "fitness": estimate.fitness,
        "misfit": estimate.misfit,
        "lag_s": estimate.lag_s,
        "correlation": estimate.correlation and dict(estimate.correlation),
        "e_a_dependence": estimate.e_a_dependence and estimate.e_a_dependence._asdict(),
        "method": estimate.method,
        "quality": estimate.quality,
        "advice": estimate.advice,
    }


def sample_message(axis: str, tick: int, row: RowTuple) -> dict[str, Any]:
    """The `sample` notification of one row; `signal` is the relay's input e."""
    t, y, reference, u, t_u, e_a, bias, signal, ps, temperature, K_L, state, flags = row
    return {
        "axis": axis,
        "tick": tick,
        "t": t,
        "y": y,
        "u": u,
        "t_u": t_u,
        "reference": reference,
        "signal": signal,
        "e_a": e_a,
        "bias": bias,
        "ps": finite_or_none(ps),
        "temperature": finite_or_none(temperature),
        "K_L": finite_or_none(K_L),
        "state": AxisState(state).name.lower(),
        "fresh": bool(flags & FLAG_FRESH),
        "phase": 2 if flags & FLAG_SECOND_PHASE else 1,
    }
