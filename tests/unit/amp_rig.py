"""A CAN rig with an enable bit, a mode and a key, a validity bit of its sensor, and two e-stop lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

DBC = """VERSION "1"

NS_ :

BS_:

BU_: seod rig

BO_ 257 AmpStat: 8 rig
 SG_ Position : 0|32@1- (0.000001,0) [-1000|1000] "m" seod
 SG_ PosValid : 32|2@1+ (1,0) [0|3] "" seod
 SG_ Chain : 34|1@1+ (1,0) [0|1] "" seod
 SG_ Panel : 35|1@1+ (1,0) [0|1] "" seod

BO_ 2566873601 AmpCmd: 8 seod
 SG_ Current : 7|16@0- (0.01,0) [-100|100] "mA" rig
 SG_ Enable : 16|2@1+ (1,0) [0|3] "" rig
 SG_ Mode : 18|3@1+ (1,0) [0|7] "" rig
 SG_ Reserve : 21|3@1+ (1,0) [0|7] "" rig
 SG_ Key : 24|8@1+ (1,0) [0|255] "" rig
 SG_ counter : 32|4@1+ (1,0) [0|15] "" rig
 SG_ checksum : 56|8@1+ (1,0) [0|255] "" rig

BA_DEF_ BO_ "ChecksumKind" STRING ;
BA_DEF_DEF_ "ChecksumKind" "";
BA_ "ChecksumKind" BO_ 2566873601 "xor8";
"""

RIG = """version: 1
rig: amp

driver:
  kind: can
  channel: vcan0
  dbc: amp.dbc
  messages:
    AmpStat: {rate_hz: 500}

loop:
  rate_hz: 500

sensors:
  position:
    channel: AmpStat.Position
    unit: m
    valid: {channel: AmpStat.PosValid, is: 1}

outputs:
  valve:
    channel: AmpCmd.Current
    unit: mA
    enable: {channel: AmpCmd.Enable, on: 1, off: 0, drop_on_fault: true}
    fixed: {AmpCmd.Mode: 2, AmpCmd.Key: 90, AmpCmd.Reserve: 0}

axes:
  ram:
    sensor: position
    output: valve
    K_L: 25 mm/s/mA
    relay: {e_a: 2 mA}
    limits:
      output: 10 mA
      travel: [-0.2, 0.2]
      speed: 1 m/s
      amplitude: 50 mm
      excitation: 60 s
    polarity: {movement: 1 mm}

guard:
  stale: 20 ms
  rig_watchdog: 50 ms
  estop:
  - {channel: AmpStat.Chain, run: 1}
  - {channel: AmpStat.Panel, run: 0}
"""


def folder(directory: Path) -> Path:
    """The folder, with the DBC in it."""
    (directory / "amp.dbc").write_text(DBC)
    return directory
