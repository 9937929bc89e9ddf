"""In the guest after the cut: mounts the image again and prints the ticks that the recording has, as JSON.

python read_rows.py IMAGE
"""

from __future__ import annotations

import json
import sys

from mounting import mount

from seod.record.read import items, parts


def main(image: str) -> None:
    """Read what is there."""
    disk = mount(image)
    path = disk / "a.mcap"
    ticks = [tick for rows in items(path, ["motor"]) for tick in rows["tick"].tolist()]
    print(json.dumps({"ticks": ticks, "parts": len(parts(path))}))


main(*sys.argv[1:])
