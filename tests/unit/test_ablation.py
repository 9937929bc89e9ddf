"""Rescue rules that `bench/ablation.py` switches off are functions of the diagnosis."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "bench"))
sys.path.append(str(Path(__file__).parents[1] / "blind"))

from ablation_runs import RULES, found


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_each_rule_is_a_function(rule):
    _, name, function = found(rule)
    assert callable(function)
    assert name == rule.name.split(".")[-1]
    assert callable(rule.off)


def test_names_are_apart():
    assert len({rule.name for rule in RULES}) == len(RULES)
