"""seod: live damping ratio and natural frequency of hydraulic servo actuators from a relay limit cycle.

    import seod

    found = seod.identify("run.csv")            # or a table of pandas or polars, or t=, u=, y=
    print(found.omega_n, found.zeta)
    seod.diagnose("run.csv", units="y=mm").save("found")

What is named here is loaded when it is first used, so that the daemon needs none of it.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

__version__ = "0.2.0"
PROTOCOL = 1
"""Version of the JSON-RPC protocol; raised when a message changes incompatibly."""

_OFFERED = {
    "read": "seod.api.data",
    "identify": "seod.api.identification",
    "diagnose": "seod.api.diagnoses",
    "response": "seod.api.responses",
    "simulate": "seod.api.simulations",
    "RigFile": "seod.api.rig_file",
    "Recording": "seod.data.recording",
    "Identification": "seod.api.identification",
    "Diagnosis": "seod.api.diagnoses",
    "FrequencyResponse": "seod.api.responses",
    "Simulation": "seod.api.simulations",
    "Client": "seod.client",
    "AsyncClient": "seod.client.asynchronous",
    "ReadError": "seod.data.source",
    "IdentifyError": "seod.identify.record",
    "DiagnoseError": "seod.diagnose.result",
    "RespondError": "seod.respond.record",
    "ConfigErrors": "seod.config.errors",
    "ClientError": "seod.client",
}
"""Name -> module that has it. `__init__.pyi` tells type checkers the same."""

__all__ = ["PROTOCOL", "__version__", *_OFFERED]  # noqa: PLE0604 - names of a table


class Room(ModuleType):
    """A package that is a function of the Python interface as well: `seod.identify(...)`.

    Three rooms have the names of functions that are their purpose. Such a room sets its class to this one.
    """

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """What the function of this name answers."""
        return offered(self.__name__.rpartition(".")[2])(*args, **kwargs)

    def __getattr__(self, name: str) -> Any:
        if name in ("__wrapped__", "__signature__"):  # for `help` and notebooks
            function = offered(self.__name__.rpartition(".")[2])
            if name == "__wrapped__":
                return function
        raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")


def callable_room(name: str) -> None:
    """Let the package of this name be called."""
    sys.modules[name].__class__ = Room


def offered(name: str) -> Any:
    """What the Python interface has under this name.

    Raises:
        KeyError: Nothing.
    """
    own_packages()
    return getattr(import_module(_OFFERED[name]), name)


def own_packages() -> None:
    """Ask whether `drivers` and `sim` are the ones that came with seod, not another project's.

    Raises:
        ImportError: Another one comes first; says where it is.
    """
    for name in ("drivers", "sim"):
        spec = find_spec(name)
        found = Path(spec.origin).parent.parent if spec is not None and spec.origin else None
        if found != Path(__file__).parent.parent:
            where = spec.origin if spec is not None and spec.origin else "nowhere"
            raise ImportError(
                f"seod's package {name!r} is hidden by another ({where}): give seod an environment of its "
                "own, as pipx does, and start it in another folder"
            )


def __getattr__(name: str) -> Any:
    if name in ("identify", "diagnose", "simulate"):
        return import_module(f"seod.{name}")
    if name in _OFFERED:
        return offered(name)
    raise AttributeError(f"module 'seod' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_OFFERED})
