"""Coverage-guided fuzzing (atheris) of all that takes bytes from outside: no crash, hang or growing memory.

    python bench/fuzz.py [--target all] [--for 20] [--corpus build/corpus]

Each target has a process of its own under libFuzzer: JSON-RPC lines, CAN payloads through codec and checks,
frames and lines of a serial board, rig files, DBCs, each reader of recordings. An exception that is not the
documented one ends it, so does a unit of more than a minute or 2 GB. Prints the units run.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

REPO = Path(__file__).parents[1]
sys.path.insert(0, str(REPO))

if TYPE_CHECKING:
    from collections.abc import Callable

SLOWEST_S, MOST_MB = 60, 2048
PACKAGES = ["seod.protocol", "seod.config", "seod.data", "seod.record", "drivers"]


def _jsonrpc() -> Callable[[bytes], None]:
    from seod.protocol.jsonrpc import LineSplitter, LineTooLongError, Refusal, Request, error_text, parse

    def take(data: bytes) -> None:
        splitter = LineSplitter(limit=512)
        for at in range(0, len(data), 7):
            splitter.feed(data[at : at + 7])
        splitter.look(b"estop")
        while True:
            try:
                line = splitter.next_line()
            except LineTooLongError:
                continue
            if line is None:
                return
            for request in parse(line).requests:
                assert isinstance(request, Request | Refusal)
                if isinstance(request, Refusal):
                    error_text(request.id, request.error)

    return take


def _can() -> Callable[[bytes], None]:
    from drivers.base import NO_SAMPLE
    from drivers.can_codec import CanCodec, UnknownFrameError, WrongLengthError
    from drivers.can_config import CanOptions
    from drivers.can_counters import COUNTER_NAMES
    from drivers.can_errors import bus_event
    from drivers.can_inputs import InputFrame

    section = {"kind": "can", "channel": "can0", "dbc": str(REPO / "configs/motor.dbc")}
    codec = CanCodec(CanOptions.model_validate(section))

    def take(data: bytes) -> None:
        samples, counts = [NO_SAMPLE] * 2, [0] * len(COUNTER_NAMES)
        encoder = InputFrame(codec.layout("Encoder"), [("angle", 0), ("run_enable", 1)], samples, counts)
        for k, at in enumerate(range(0, len(data), 10)):
            head, payload = data[at : at + 2], data[at + 2 : at + 10]
            bus_event(int.from_bytes(head, "little"), payload)
            try:
                decoded = codec.decode((257, 258, 513, 0)[head[0] % 4], False, payload)
            except (UnknownFrameError, WrongLengthError):
                continue
            if decoded.message == "Encoder":
                encoder.accept(decoded, 0.002 * k)
        encoder.remarks(1e9)
        encoder.why_old()

    return take


def _serial() -> Callable[[bytes], None]:
    from drivers.device_clock import DeviceClock
    from drivers.serial_frame import Block, FrameError, Splitter, decode, read_hello, read_sample

    block = Block("iB")

    def take(data: bytes) -> None:
        splitter, clock = Splitter(b"\0", 64), DeviceClock()
        for k, piece in enumerate(splitter.feed(data)):
            try:
                frame = decode(piece)
                clock.heard(read_sample(block, frame).time_us, 0.01 * k)
                read_hello(frame.body)
            except FrameError:
                continue

    return take


def _text() -> Callable[[bytes], None]:
    from drivers.serial_ascii import Line, board_version, read_command
    from drivers.serial_frame import FrameError, Splitter

    lines = [Line(["t_us", "angle", "run"], ["angle", "run"], sealed) for sealed in (False, True)]

    def take(data: bytes) -> None:
        for line in Splitter(b"\n", 64).feed(data):
            for call in (lines[0].read, lines[1].read, board_version):
                try:
                    call(line)
                except FrameError:
                    continue
            try:
                read_command(line.decode("ascii", "replace"), 2)
            except FrameError:
                continue

    return take


def _rig() -> Callable[[bytes], None]:
    from seod.config.errors import ConfigErrors
    from seod.config.load import load_text

    for example in ("virtual", "can", "serial"):  # what a driver imports is no part of a unit
        load_text((REPO / f"configs/{example}.yaml").read_text(), "rig.yaml", REPO / "configs")

    def take(data: bytes) -> None:
        try:
            load_text(data.decode("utf-8", "replace"), "rig.yaml", REPO / "configs")
        except ConfigErrors as errors:
            str(errors)

    return take


def _reader(kind: str) -> Callable[[], Callable[[bytes], None]]:
    """All that is done with a file of a kind, as `bench/fuzz_readers.py` does it."""

    def make() -> Callable[[bytes], None]:
        from tests.damage.files import sound_files
        from tests.damage.trial import outcome, uses

        sound = sound_files()[kind]
        folder = Path(
            tempfile.mkdtemp(prefix="seod-fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None)
        )
        path = folder / f"fuzz{sound.suffix}"
        # a sound one of other names may be told, too
        companion = "sound.log" if kind == "dbc" else "motor.dbc"

        def take(data: bytes) -> None:
            path.write_bytes(data)
            for use in uses(path, sound, folder, "csv")[:2]:
                wrong = outcome(use, path.name, companion)
                assert not wrong, wrong

        return take

    return make


READERS = ("csv", "csv-gz", "parquet", "mat5", "mat4", "mf4", "mdf3", "mcap-own", "mcap-json", "dbc")
LOGS = ("can-blf", "can-asc", "can-log", "can-trc")
TARGETS: dict[str, Callable[[], Callable[[bytes], None]]] = {
    "jsonrpc": _jsonrpc,
    "can": _can,
    "serial": _serial,
    "text": _text,
    "rig": _rig,
    **{kind: _reader(kind) for kind in (*READERS, *LOGS)},
}


def seed(target: str, corpus: Path) -> None:
    """Sound examples to begin with."""
    corpus.mkdir(parents=True, exist_ok=True)
    if target in READERS + LOGS:
        from tests.damage.files import sound_files

        sound = sound_files()[target]
        sound.make(corpus / f"sound{sound.suffix}")
    elif target == "rig":
        for name in ("virtual.yaml", "can.yaml", "serial.yaml"):
            (corpus / name).write_text((REPO / "configs" / name).read_text())
    elif target == "jsonrpc":
        (corpus / "call").write_bytes(
            b'{"jsonrpc":"2.0","id":1,"method":"set","params":{"e_a":1.5}}\n[{"id":2}]\n'
        )


def fuzz(target: str, corpus: Path, seconds: float) -> None:
    """Become libFuzzer."""
    import atheris

    with atheris.instrument_imports(include=PACKAGES):
        take = TARGETS[target]()
    words = [f"-max_total_time={seconds:.0f}", f"-timeout={SLOWEST_S}", f"-rss_limit_mb={MOST_MB}"]
    words += ["-print_final_stats=1", "-verbosity=0", f"-artifact_prefix={corpus}/crash-", str(corpus)]
    if target in READERS + LOGS:  # a crash of their reader's process is that process' own
        words += [f"-handle_{name}=0" for name in ("segv", "bus", "abrt", "ill", "fpe")]
    atheris.Setup([sys.argv[0], *words], take)
    atheris.Fuzz()


def main() -> int:
    """Each target in a process of its own."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--target", default="all", help=f"all, or of {', '.join(TARGETS)}, by comma")
    parser.add_argument("--for", type=float, default=20.0, dest="seconds", help="of each [s]")
    parser.add_argument("--corpus", type=Path, default=REPO / "build" / "corpus")
    parser.add_argument("--run", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.run:
        fuzz(given.run, given.corpus, given.seconds)
        return 0
    failed = []
    for target in TARGETS if given.target == "all" else given.target.split(","):
        corpus = given.corpus / target
        seed(target, corpus)
        command = [
            sys.executable,
            __file__,
            "--run",
            target,
            "--corpus",
            str(corpus),
            "--for",
            str(given.seconds),
        ]
        with tempfile.TemporaryFile("w+") as log:  # a pipe would be held open by what it leaves behind
            env = os.environ | {"TQDM_DISABLE": "1"}
            done = subprocess.run(command, check=False, stdout=log, stderr=log, text=True, env=env)
            log.seek(0)
            said = log.read()
        units = re.findall(r"number_of_executed_units:\s*(\d+)", said) or ["?"]
        peak = re.findall(r"peak_rss_mb:\s*(\d+)", said) or ["?"]
        kept, ended = len(list(corpus.iterdir())), "FAILED" if done.returncode else "none failed"
        told = f"{units[0]:>9} units, {kept} in the corpus, peak {peak[0]} MB: {ended}"
        print(f"{target:<10} {told}", flush=True)
        if done.returncode:
            failed.append(target)
            print(said[-3000:])
    print(f"failed: {', '.join(failed) or 'none'}")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
