"""The commands in this process, as `typer.testing` calls them, but made once.

Typer makes all commands anew for each call: 30 ms, more than most of them take to refuse a word.
"""

from __future__ import annotations

from functools import cache

from typer import testing

testing._get_command = cache(testing._get_command)
CliRunner = testing.CliRunner
