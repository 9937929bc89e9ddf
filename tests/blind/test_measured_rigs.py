"""The search on measured rigs: what it names, and that it ends. Skipped without the records."""

from __future__ import annotations

from pathlib import Path

import pytest

from seod.data import read
from seod.diagnose.pipeline import Options, diagnose

pytestmark = [pytest.mark.blind, pytest.mark.timeout(1200)]
DATA = Path(__file__).parents[3] / "shared" / "data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"the measured records are not in {DATA}")


@needs_data
def test_the_friction_of_a_motor_with_a_screw_is_found():
    record = read(DATA / "electromechanical_positioning.csv.gz")
    found = diagnose([record], (), Options("position"))
    assert "coulomb_friction" in {each.name for each in found.effects}
    assert found.extended.holdout_nrmse < 0.05
    assert found.extended.whole_nrmse < found.baseline.whole_nrmse
