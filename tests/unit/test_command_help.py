"""What `--help` shows: examples that can be typed, plain words for values; daemons that are found by name."""

from __future__ import annotations

import os
import re
import shlex

import pytest
from test_cli import invoke

from seod.client import UnreachableError
from seod.client.nearby import Address, announce, find, running
from seod.commands.common import names
from seod.commands.examples import EXAMPLES

NAMES = sorted(names())


def test_every_command_has_an_example_and_no_other_has():
    assert sorted(EXAMPLES) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_examples_are_shown_and_name_options_that_there_are(name):
    code, out, _ = invoke(*name.split(), "--help")
    assert code == 0
    options = set(re.findall(r"--[a-z][-a-z]*", out.partition("Examples:")[0]))
    for example in EXAMPLES[name]:
        assert f"  {example}\n" in out
        words = shlex.split(example.partition(" | ")[0])
        assert set(name.split()) <= set(words) or name == "archive build"  # which may be left out
        assert {word for word in words if word.startswith("--")} <= options
    assert not re.search(r"<(str|int|float|path|list|bool)", out)


def test_a_daemon_is_found_by_its_rig_as_long_as_it_holds_its_name():
    rig = f"a rig/{os.getpid()}"
    held = announce(Address(rig, "127.0.0.1", 7777, True))
    try:
        assert find(rig) == (rig, "127.0.0.1", 7777, True)
        assert announce(Address(rig, "127.0.0.1", 7777, True)) is None  # taken
    finally:
        held.close()
    with pytest.raises(UnreachableError, match="no daemon of rig"):
        find(rig)
    assert announce(Address("x" * 200, "127.0.0.1", 1, False)) is None


def test_lines_that_are_none_are_passed_over():
    good = "00: 00000002 00000000 00010000 0001 01 1 @seod-at/motor/127.0.0.1/7600/0"
    bad = ["", "junk @seod-at/motor", "x @seod-at/a/b/notaport/0", "y @seod/motor"]
    assert running([*bad, good]) == [Address("motor", "127.0.0.1", 7600, False)]
