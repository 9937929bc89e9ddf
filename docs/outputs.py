"""What commands print, put into the pages that show it: `make outputs`; a test asks whether it is there.

A block of a page that follows the comment `<!-- printed -->` is what the commands of the block before it
print, run one after the other in an empty folder with the repository's `configs` in it. Only commands whose
output is the same in each run can be shown so; times and machines differ.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

REPO: Final = Path(__file__).parents[1]
PAGES: Final = (REPO / "README.md", *sorted((REPO / "docs").rglob("*.md")))
SHOWN: Final = re.compile(
    r"```sh\n(?P<commands>(?:(?!```).)*?)```\n\n<!-- printed -->\n```\n(?P<output>.*?)```\n", re.DOTALL
)


def printed(commands: str) -> str:
    """Standard output of the last of some `seod` commands, a line each, in a folder of their own."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "configs").symlink_to(REPO / "configs")
        for line in commands.splitlines():
            words = line.split(" #")[0].split()
            assert words[0] == "seod", line
            command = [sys.executable, "-m", "seod.cli", *words[1:]]
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    return "".join(f"{line.rstrip()}\n" for line in done.stdout.splitlines())


def renewed(page: str) -> str:
    """A page with what its commands print now."""

    def block(found: re.Match[str]) -> str:
        return found.group().replace(found["output"], printed(found["commands"]))

    return SHOWN.sub(block, page)


def main() -> None:
    """Write what is printed now into all pages."""
    for page in PAGES:
        before = page.read_text()
        after = renewed(before)
        if after != before:
            page.write_text(after)
            print(f"{page.relative_to(REPO)}: renewed")


if __name__ == "__main__":
    main()
