"""The search on measured rigs: what it names, and that it ends. Skipped without the records."""

from __future__ import annotations

from itertools import count
from pathlib import Path

import pytest

from seod.data import read
from seod.diagnose.command import Options, diagnose

pytestmark = [pytest.mark.blind, pytest.mark.timeout(400)]
DATA = Path(__file__).parents[3] / "shared" / "data"
LOOKS_A_SECOND = 150.0
"""At its budget: the search is bounded by trials, not by the machine."""
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"the measured records are not in {DATA}")


@needs_data
def test_the_friction_of_a_motor_with_a_screw_is_found():
    record, looks = read(DATA / "electromechanical_positioning.csv.gz"), count()
    found = diagnose([record], (), Options("position"), clock=lambda: next(looks) / LOOKS_A_SECOND)
    assert "coulomb_friction" in {each.name for each in found.effects}
    assert found.extended.holdout_nrmse < 0.05
    assert found.extended.whole_nrmse < found.baseline.whole_nrmse
