"""Mounts a file system that is an image in a file. As root, in the guest."""

from __future__ import annotations

import subprocess
from pathlib import Path


def mount(image: str | Path, at: str = "/mnt/disk") -> Path:
    """Mount an ext4 image; returns where."""
    folder = Path(at)
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run(["modprobe", "loop"], check=True)
    if not Path("/dev/loop0").exists():
        subprocess.run(["mknod", "/dev/loop0", "b", "7", "0"], check=True)
    subprocess.run(["mount", "-t", "ext4", "-o", "loop", image, folder], check=True)
    return folder


def unmount(folder: Path) -> None:
    """Unmount it."""
    subprocess.run(["umount", folder], check=True)
