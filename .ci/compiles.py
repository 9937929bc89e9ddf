"""What another Python says of the sources without anything installed (`make compiled`): some seconds.

Every file compiles, warnings are errors; what needs the standard library alone is imported: the supervisor.
The unit tests by each Python are `make pythons`.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from pathlib import Path

FOLDERS = ("seod", "drivers", "sim", "systemd", "docs", "tests", "bench", ".ci")
ALONE = ("seod/supervisor", "seod/processes")


def main() -> int:
    """The files that do not compile, and the modules that cannot be imported."""
    warnings.simplefilter("error")
    sys.dont_write_bytecode = True
    sys.path.insert(0, ".")
    files = [path for folder in FOLDERS for path in sorted(Path(folder).rglob("*.py"))]
    failed = [said for path in files if (said := compiled(path))]
    modules = [path for folder in ALONE for path in sorted(Path(folder).glob("*.py")) if path.stem[0] != "_"]
    failed += [said for path in modules if (said := imported(path))]
    version = ".".join(map(str, sys.version_info[:3]))
    print("\n".join([*failed, f"Python {version}: {len(files)} files compiled, {len(modules)} imported"]))
    return int(bool(failed))


def compiled(path: Path) -> str:
    """Why a file does not compile; "" where it does."""
    try:
        compile(path.read_text("utf-8"), str(path), "exec", dont_inherit=True)
    except (SyntaxError, SyntaxWarning, DeprecationWarning, ValueError) as error:
        return f"{path}: {error}"
    return ""


def imported(path: Path) -> str:
    """Why a module cannot be imported; "" where it can."""
    name = ".".join(path.with_suffix("").parts)
    try:
        importlib.import_module(name)
    except (ImportError, Warning, AttributeError, TypeError) as error:
        return f"{name}: {type(error).__name__}: {error}"
    return ""


if __name__ == "__main__":
    sys.exit(main())
