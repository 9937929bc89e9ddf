"""A progress bar for work that takes long, where somebody is looking."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from seod.data.source import Block


def shown(blocks: Iterable[Block], what: str) -> Iterator[Block]:
    """Pass the blocks on; on a terminal with a bar on stderr, which goes away in the end."""
    if not sys.stderr.isatty():
        yield from blocks
        return
    from seod.terminal.progress import bar  # noqa: PLC0415 - only where it is seen

    with bar() as show:
        done = 0.0
        for block in blocks:
            done = max(done, block.done)
            show(what, done)
            yield block
