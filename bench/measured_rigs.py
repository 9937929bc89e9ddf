"""What `seod diagnose` makes of measured records that it was not made for, beside models without physics.

    python bench/measured_rigs.py FILE.csv ... [--effort normal]
    python bench/measured_rigs.py drive.mat --columns u=u1,y=z1,t=50Hz

Nothing is told of a record but its columns, as to a newcomer who has only the file. Printed are what y is
taken for, the free-run error of windows that no fit has seen, in % of their deviation: of Eq. 1, with the
causes found, of ARX and of the better NARX; the grade, the verdict, the causes named and the wall time.
Records are looked for by whoever runs it: most public ones carry no licence.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter

from seod.data import ReadError, read
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.result import DiagnoseError, Diagnosis

HEAD = (
    f"{'record':32}{'y is a':>9}{'Eq. 1':>8}{'found':>8}{'ARX':>8}{'NARX':>8}  "
    f"{'grade':16}{'verdict':12}{'s':>5}  causes"
)


def line(name: str, told: Diagnosis, seconds: float) -> str:
    """Of the table."""
    base, found = (100.0 * one.holdout_nrmse for one in (told.baseline, told.extended))
    other = told.yardstick
    arx, narx = (float("nan"), float("nan")) if other is None else (100.0 * other.arx, 100.0 * other.narx)
    kind = "speed" if told.output == "velocity" else "position"
    figures = "".join(f"{each:8.1f}" for each in (base, found, arx, narx))
    causes = ", ".join(each.name for each in told.effects) or "-"
    return f"{name:32}{kind:>9}{figures}  {told.grade:16}{told.verdict:12}{seconds:5.0f}  {causes}"


def main() -> None:
    """Print a line for each record."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--columns", default="")
    parser.add_argument("--effort", default="normal", choices=("quick", "normal", "thorough"))
    asked = parser.parse_args()
    print(HEAD)
    for path in asked.files:
        begun = perf_counter()
        try:
            told = diagnose([read(path, asked.columns)], (), Options(None, effort=asked.effort))
        except (ReadError, DiagnoseError) as why:
            print(f"{path.name:32} {why}")
            continue
        print(line(path.name, told, perf_counter() - begun), flush=True)


if __name__ == "__main__":
    main()
