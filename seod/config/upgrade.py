"""Rig files of earlier versions made into ones of this version; comments and order stay."""

from __future__ import annotations

from io import StringIO
from typing import TYPE_CHECKING, Any, Final

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from seod.config.load import load_text
from seod.config.model import CONFIG_VERSION

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

STEPS: Final[dict[int, Callable[[Any], None]]] = {}
"""Version -> what makes a document of it one of the next version. Version 1 is the first."""


class UpgradeError(Exception):
    """A rig file cannot be upgraded; the message says why."""


def upgraded(text: str, name: str, folder: Path) -> str | None:
    """The rig file in this version's form; None where it is that already.

    Args:
        text: Of the rig file.
        name: Its name, for messages.
        folder: That its paths start from.

    Raises:
        UpgradeError: It has no version, or one that is not known here.
        ConfigErrors: What comes out is no valid rig file.
    """
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 1000
    try:
        document = yaml.load(text)
    except YAMLError as error:
        raise UpgradeError(f"{name}: no YAML: {error}") from error
    version = document.get("version") if isinstance(document, dict) else None
    if not isinstance(version, int) or isinstance(version, bool):
        raise UpgradeError(
            f"{name}: version: expected a whole number such as {CONFIG_VERSION}, got {version!r}"
        )
    if version == CONFIG_VERSION:
        load_text(text, name, folder)
        return None
    _climb(document, version, name)
    out = StringIO()
    yaml.dump(document, out)
    load_text(out.getvalue(), name, folder)
    return out.getvalue()


def _climb(document: Any, version: int, name: str) -> None:
    for step in range(version, CONFIG_VERSION):
        if step not in STEPS:
            raise UpgradeError(f"{name}: version: {version} was never one; this seod reads {CONFIG_VERSION}")
        STEPS[step](document)
        document["version"] = step + 1
    if version > CONFIG_VERSION:
        raise UpgradeError(
            f"{name}: version: {version} is of a later seod; this one reads {CONFIG_VERSION}: upgrade seod"
        )
