"""The reference handle's C beside our frames, byte for byte, on a board of the host's."""

import ctypes
import shutil
import struct
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from cobs import cobs
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.messages import SafetyState
from forefeel.devices.coil.protocol import (
    NAME,
    PROTOCOL,
    Button,
    CoilCommand,
    CoilIdentity,
    CoilParser,
    CoilState,
    Flag,
    Identify,
    crc_ccitt_false,
    encode,
)

FOLDER = Path(__file__).parents[2] / "firmware/handle"
MOST_MA = 1000
CONSTANTS = {
    "SERIAL_NUMBER": '"A17"',
    "COUNTS_PER_M": 2_000_000,
    "INDEX": 0,
    "MOST_MA": MOST_MA,
    "FULL_MA": 2400,
    "SENSE_UA": 0,
    "LATE_US": 1500,
    "main": "firmware_main",
}
BOARD = """
#include "handle.h"
uint8_t sent[256], buttons;
uint16_t size;
int16_t driven_ma;
void board_start(void) {}
bool board_read(uint8_t *byte) { return byte == 0; }
void board_write(uint8_t byte) { sent[size++ % 256] = byte; }
void board_alive(void) {}
uint8_t board_buttons(void) { return buttons; }
uint16_t board_sense(void) { return 0; }
void board_drive(bool negative, uint16_t ma) { driven_ma = negative ? -ma : ma; }
void board_lamp(bool lit) { (void)lit; }
"""
WARNINGS = "-Wall", "-Wextra", "-Werror"
TRAPS = "-fsanitize=bounds", "-fsanitize-undefined-trap-on-error"  # needs no library of the compiler's
I16, U16 = st.integers(-(2**15) + 1, 2**15 - 1), st.integers(0, 2**16 - 1)
CURRENTS = st.integers(-1500, 1500) | I16


class Chip:
    """A handle's firmware as a library."""

    def __init__(self, folder: Path) -> None:
        (folder / "board.c").write_text(BOARD)
        defined = [f"-D{name}={value}" for name, value in CONSTANTS.items()]
        sources = str(FOLDER / "handle.c"), str(folder / "board.c")
        command = ["cc", "-std=c11", "-fPIC", "-shared", *WARNINGS, *TRAPS, f"-I{FOLDER}", *defined]
        subprocess.run([*command, *sources, "-o", str(folder / "chip.so")], check=True)
        self.library = ctypes.CDLL(str(folder / "chip.so"))
        self.counts = 0

    def number(self, name: str, kind: type = ctypes.c_int16) -> int:
        return int(kind.in_dll(self.library, name).value)  # type: ignore[attr-defined]

    def take(self, data: bytes) -> bytes:
        """What it sends when these bytes arrive."""
        ctypes.c_uint16.in_dll(self.library, "size").value = 0
        for byte in data:
            self.library.handle_take(byte)
        return self.sent()

    def step(self, periods: int = 1) -> bytes:
        ctypes.c_uint16.in_dll(self.library, "size").value = 0
        self.library.handle_tick()
        self.library.handle_step(periods)
        return self.sent()

    def move(self, counts: int) -> None:
        """Turns the encoder: A leads B forwards."""
        for _ in range(abs(counts)):
            self.counts += 1 if counts > 0 else -1
            self.library.handle_edge((0, 1, 3, 2)[self.counts % 4])

    def sent(self) -> bytes:
        size = self.number("size", ctypes.c_uint16)
        return bytes((ctypes.c_uint8 * 256).in_dll(self.library, "sent"))[:size]


@pytest.fixture(scope="module")
def chip(tmp_path_factory: pytest.TempPathFactory) -> Chip:
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    return Chip(tmp_path_factory.mktemp("firmware"))


def identity(watchdog_ms: int, limit_ma: int) -> CoilIdentity:
    limit_ma = min(limit_ma, MOST_MA)
    return CoilIdentity(PROTOCOL, watchdog_ms, limit_ma, 1000, 1500, 2_000_000, NAME, "A17", "2.0")


@given(watchdog_ms=U16, limit_ma=U16)
def test_it_is_identified_and_bounds_the_limit(chip: Chip, watchdog_ms: int, limit_ma: int) -> None:
    answer = chip.take(encode(Identify(PROTOCOL, watchdog_ms, limit_ma)))
    assert answer == encode(identity(watchdog_ms, limit_ma))


@given(
    command=st.builds(CoilCommand, U16, CURRENTS, st.sampled_from([None, *SafetyState]), I16, st.booleans()),
    limit_ma=st.integers(0, 1200),
    buttons=st.integers(0, 3),
    moved=st.integers(-300, 300),
)
def test_states_and_commands_are_ours(
    chip: Chip, command: CoilCommand, limit_ma: int, buttons: int, moved: int
) -> None:
    """Also a current that a limit cuts, the velocity, the watchdog, after which a command does nothing."""
    chip.take(encode(Identify(PROTOCOL, 20, limit_ma)))
    before = [decoded(chip.step()) for _ in range(8)][-1]
    ctypes.c_uint8.in_dll(chip.library, "buttons").value = buttons
    chip.move(moved)
    assert chip.take(encode(command)) == b""
    most_ma = min(limit_ma, MOST_MA)
    driven_ma = max(-most_ma, min(most_ma, command.current_ma)) if command.enabled else 0
    assert chip.number("driven_ma") == driven_ma
    state = before._replace(
        sequence=(before.sequence + 1) % 2**16,
        time_us=before.time_us + 1000,
        counts=before.counts + moved,
        velocity=125 * moved,
        buttons=Button(buttons),
        current_ma=driven_ma,
    )
    assert chip.step() == encode(state)
    tripped = decoded(chip.step(periods=20))
    assert (tripped.flags, tripped.current_ma, chip.number("driven_ma")) == (Flag.WATCHDOG, 0, 0)
    chip.take(encode(command))
    assert chip.number("driven_ma") == 0


@given(noise=st.lists(st.binary(max_size=40), max_size=6))
def test_noise_does_nothing_and_costs_no_frame_after_it(chip: Chip, noise: list[bytes]) -> None:
    chip.take(encode(Identify(PROTOCOL, 65_000, 1000)) + encode(CoilCommand(1, 500, None, None, True)))
    assert chip.take(b"\0".join(noise)) == b""
    assert chip.number("driven_ma") == 500
    chip.take(encode(CoilCommand(2, -700, None, None, True)))
    assert chip.number("driven_ma") == -700


@pytest.mark.parametrize(
    "payload",
    [
        b"\x02" + struct.pack("<HhBiB", 1, 500, 8, 0, 1),  # an unknown lamp
        b"\x02" + struct.pack("<HhBi", 1, 500, 4, 0),
        b"\x03" + struct.pack("<BHHB", PROTOCOL, 20, 1000, 0),
        b"\x05" + struct.pack("<HhBiB", 1, 500, 4, 0, 1),
    ],
)
def test_frame_of_other_content_does_nothing_though_its_checksum_is_right(chip: Chip, payload: bytes) -> None:
    chip.take(encode(Identify(PROTOCOL, 65_000, 1000)) + encode(CoilCommand(1, 300, None, None, True)))
    wire = cobs.encode(payload + crc_ccitt_false(payload).to_bytes(2, "little")) + b"\0"
    assert chip.take(wire) == b""
    assert chip.number("driven_ma") == 300


def decoded(data: bytes) -> CoilState:
    (state,) = CoilParser(Counter()).feed(data)
    assert isinstance(state, CoilState)
    return state
