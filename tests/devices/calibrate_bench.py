"""What the tests of `forefeel calibrate` on fakes share: the slave's file, the words of the command."""

from pathlib import Path

SLAVE = """role: slave
axes:
- stage: {driver: zaber_ascii, port: /dev/stage, microstep_m: 1e-6, travel_m: [0, 0.09], sign: SIGN}
  load_cell: {driver: ascii_line, port: /dev/cell, unit: counts, full_scale_n: 10, sign: SIGN,
    full_scale_native: 500_000}
  limits: {workspace_m: [0, 0.08]}
"""
CELL = ["calibrate", "load-cell", "--config", "slave.yaml", "--axis", "insertion", "--out", "cell.yaml"]
STAGE = ["calibrate", "stage", "--config", "slave.yaml", "--axis", "insertion", "--out", "stage.yaml"]


def configure(sign: int = 1) -> None:
    Path("slave.yaml").write_text(SLAVE.replace("SIGN", str(sign)))


def unwritten() -> bool:
    return [path.name for path in Path().iterdir()] == ["slave.yaml"]
