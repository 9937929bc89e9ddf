"""`python -m tests.dst`: runs seeds, and shrinks those that fail."""

from __future__ import annotations

import argparse
import gc
import sys
import time

from tests.dst.run import run
from tests.dst.shrink import shrunk


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m tests.dst", description=__doc__)
    parser.add_argument("--seeds", type=int, default=100, help="so many seeds")
    parser.add_argument("--first", type=int, default=1, help="the first of them")
    parser.add_argument("--seconds", type=float, default=20.0, help="with faults, of each run")
    parser.add_argument("--for", type=float, default=float("inf"), dest="budget", help="stop after this [s]")
    parser.add_argument("--wire", choices=("can", "serial"), default="can", help="that the rig hangs on")
    parser.add_argument("--trace", action="store_true", help="print the trace of failing seeds")
    parser.add_argument("--no-shrink", action="store_true", help="do not look for the fewest faults")
    given = parser.parse_args()
    gc.freeze()  # what is loaded by now need not be looked through after each run
    began, simulated, faults, failed, ran = time.monotonic(), 0.0, 0, [], 0
    for seed in range(given.first, given.first + given.seeds):
        outcome = run(seed, given.seconds, wire=given.wire)
        ran += 1
        simulated += outcome.simulated_s
        faults += len(outcome.faults)
        if outcome.failures:
            failed.append(seed)
            print(
                f"seed {seed} (--seconds {given.seconds:g} --wire {given.wire}): {outcome.failures[0]}",
                flush=True,
            )
            if not given.no_shrink:
                least = shrunk(outcome, given.seconds)
                print(f"  {len(outcome.faults)} faults shrunk to {len(least.faults)}: {least.failures[0]}")
                for fault in least.faults:
                    print(f"    {fault}", flush=True)
                if given.trace:
                    again = run(seed, given.seconds, least.faults, keep=True, wire=given.wire)
                    print("\n".join(again.trace[-200:]), flush=True)
        if time.monotonic() - began > given.budget:
            break
    took = time.monotonic() - began
    print(
        f"{ran} seeds, {simulated / 3600.0:.2f} simulated hours, {faults} faults, {len(failed)} failed, "
        f"{took:.1f} s ({simulated / took:.0f} times real time)"
    )
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
