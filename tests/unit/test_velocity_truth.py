"""Velocity mode, loop and estimator, against hydraulics' own equations under scipy's solver."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from seod.estimate import make_estimator
from seod.observe.estimation import Axis
from seod.processes.ring import AXIS_FIELDS, FLAG_EXCITING, AxisState
from tests.unit.loop_bench import PERIOD, Bench
from tests.unit.ode_rig import Motor, OdeDriver

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

pytestmark = pytest.mark.slow

E_A, K_L, NULL = 0.5, 17.0, 0.07
PLANTS = [(0.21, 117.0, 32.5), (0.45, 145.0, 120.0), (0.8, 60.0, 0.0)]
FIELDS = (*AXIS_FIELDS, "state", "flags")


class OdeBench(Bench):
    """The test bench, with that motor in the place of the simulated rig."""

    driver: OdeDriver  # type: ignore[assignment] # instead of the virtual one

    def __init__(self, motor: Motor, noise: float, axis: dict[str, Any]) -> None:
        self.motor, self.noise = motor, noise
        limits = {"output": 10.0, "travel": (-60.0, 190.0), "speed": None, "amplitude": 0.8}
        mode = {"mode": "velocity", "limits": limits, "polarity": {"movement": 3.0}, "K_L": motor.K_L}
        sensor = {"channel": "motor.angle", "unit": "rad/s"}
        super().__init__({"sensors": {"angle": sensor}, "axes": {"motor": mode | axis}})

    def make_driver(self) -> OdeDriver:  # type: ignore[override] # as above
        return OdeDriver(self.motor, self.pacer.now, self.noise)

    def excite(self, seconds: float) -> list[dict[str, float]]:
        """Start, and run for so long with the relay on; the rows from then on."""
        assert self.call("start") is None
        for _ in range(500):
            if self.state is AxisState.EXCITING:
                break
            self.run(0.01)
        assert self.state is AxisState.EXCITING, self.take()
        self.run(seconds)
        assert self.faults() == []
        rows = [row for row in self.rows() if row["state"] == AxisState.EXCITING]
        return rows[1:]  # the reference of the first one stood before the relay was on

    def estimates(self, rows: list[dict[str, float]], **changes: Any) -> list[Any]:
        axis = Axis("motor", self.config.axes["motor"], PERIOD, make_estimator)
        axis.change(changes)
        return axis.feed([tuple(row[name] for name in FIELDS) for row in rows])  # type: ignore[arg-type] # int flags


@pytest.fixture
def bench() -> Iterator[Callable[..., OdeBench]]:
    made: list[OdeBench] = []

    def make(motor: Motor, noise: float = 0.0, **axis: Any) -> OdeBench:
        made.append(OdeBench(motor, noise, axis))
        made[-1].run(0.02)
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.mark.parametrize(("zeta", "omega_n", "reference"), PLANTS)
def test_the_relay_works_on_the_integral_of_the_speeds_error(
    bench: Callable[..., OdeBench], zeta: float, omega_n: float, reference: float
) -> None:
    """The shaft's angle is the speed's integral: the solver has it, the loop must find it."""
    rig = bench(Motor(K_L, omega_n, zeta, NULL), reference=reference, ramp=300.0)
    rows = rig.excite(1.5)
    angles, first = rig.driver.angles, rows[0]
    swing = max(abs(row["signal"]) for row in rows)
    for row in rows:
        assert row["reference"] == reference
        turned = angles[row["t"]] - angles[first["t"]]
        integral = first["signal"] + reference * (row["t"] - first["t"]) - turned
        assert row["signal"] == pytest.approx(integral, abs=2e-3 * swing)
        if abs(row["signal"]) > 1e-12:
            level = row["bias"] + (row["e_a"] if row["signal"] > 0.0 else -row["e_a"])
            assert row["u"] == pytest.approx(level)


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize(("zeta", "omega_n", "reference"), PLANTS)
def test_zeta_and_omega_n_are_the_motors(
    bench: Callable[..., OdeBench], zeta: float, omega_n: float, reference: float, noise: float
) -> None:
    amplitude = 1.28 * K_L * E_A / (2.0 * zeta)
    motor = Motor(K_L, omega_n, zeta, NULL)
    rig = bench(motor, noise * amplitude, reference=reference, ramp=300.0, estimator={"cycles": 8})
    rows = rig.excite(0.8 + 200.0 / omega_n)
    last = [a for a in rig.estimates(rows) if a.quality == "ok"][-20:]
    assert len(last) == 20
    close = 0.01 if noise else 2e-3
    assert sum(a.zeta for a in last) / 20 == pytest.approx(zeta, rel=close)
    assert sum(a.omega_n for a in last) / 20 == pytest.approx(omega_n, rel=close)
    assert sum(a.mean_speed for a in last) / 20 == pytest.approx(reference, abs=0.01 * amplitude)


def test_the_bias_left_wrong_shows_as_the_solver_has_it(bench: Callable[..., OdeBench]) -> None:
    """Untrimmed, the relay's mean voltage makes up for the valve's null; the mean speed is the reference."""
    rig = bench(Motor(K_L, 117.0, 0.21, 0.2), reference=32.5, ramp=300.0, trim=False)
    rows = [row for row in rig.excite(2.5) if int(row["flags"]) & FLAG_EXCITING]
    ups = [k for k in range(1, len(rows)) if rows[k]["u"] > rows[k - 1]["u"]]
    cycles = rows[ups[-31] : ups[-1]]
    assert all(row["bias"] == pytest.approx(32.5 / K_L) for row in cycles)
    mean = sum(row["u"] for row in cycles) / len(cycles)
    assert mean == pytest.approx(32.5 / K_L + 0.2, abs=2e-3)
    angles = rig.driver.angles
    turned = angles[rows[ups[-1]]["t"]] - angles[rows[ups[-31]]["t"]]
    assert turned / (len(cycles) * PERIOD) == pytest.approx(32.5, abs=0.05)
    answer = rig.estimates(rows)[-1]
    assert answer.quality == "asymmetric"
    assert answer.zeta == pytest.approx(0.21, rel=0.01)
    assert answer.omega_n == pytest.approx(117.0, rel=0.01)
