"""One line for whatever is wrong, exit code 2, and nothing left behind."""

import sys

import pytest

from forefeel.common.recording.mcap_writer import RunWriter
from tests.commands.conftest import Shell
from tests.unit.recording_samples import force, put

SLAVE = "role: slave\ntransport: {listen: ['tcp/127.0.0.1:0']}\n"
RECORDING = "time_s,position_m,force_n\n0.0,0.0,0.1\n0.01,0.001,0.2\n0.02,0.002,0.3\n"
LOOPBACK = "loopback --virtual-time --out @/out"
PLAYED = f"{LOOPBACK} --recording @/run.csv"
MODEL = "schema: forefeel.model/1\nname: x\neffects:\n"
MAGIC, BIAS, CONTACT = (f"{MODEL}  - effect: {name}\n" for name in ("magic", "bias", "contact_loss"))
AXIS = "role: slave\naxes:\n  - "
VESSEL = "instrument_radius_mm: 0.9\nlumen_radius_mm: {0: 3.0, 40: -1.0}\n"
NEAR, ROUTED = "--connect tcp/127.0.0.1:9", "--zenoh tcp/127.0.0.1:9"
REAL = f"{AXIS}stage: {{driver: zaber_ascii, port: p, microstep_m: 1.0e-7, travel_m: [-0.01, 0.13]}}\n    "
CELL = "load_cell: {driver: bota_serial, port: q, full_scale_n: 20"
GRIPPER = "    gripper: {driver: simulated}\n"
FAR = "role: master\ntransport: {connect: [tls/10.0.0.1:7447]}"

KEEPS = "prediction: {prior_dir: p, instrument: wire, patient: B}"
START, CHECK, MASTER = "slave --config", "config check", "role: master\naxes: "
SETTINGS: list[tuple[str, str, tuple[str, ...], str]] = [
    *((START, f"--duration {text}", ("--duration",), SLAVE) for text in ("soon", "-1", "nan")),
    (START, "", ("f.yaml:2", "'slave'"), "cell: a\nrole: master\n"),
    (START, "", ("f.yaml:3", "axes[0].gate.watchdog_ms"), f"{AXIS}gate: {{watchdog_ms: 60}}"),
    (CHECK, "", ("f.yaml:3", "driver = 'warp'"), f"{AXIS}stage: {{driver: warp}}"),
    (CHECK, "", ("f.yaml:2", "mars", "satellite"), "role: slave\nimpairment: {inbound: mars}\n"),
    (START, "", ("f.yaml:2", "no.mcap"), "role: slave\nimpairment: {replay: no.mcap}\n"),
    (CHECK, "", ("f.yaml:2", "patient"), f"{MASTER}[{{prediction: {{prior_dir: p, instrument: wire}}}}]"),
    (CHECK, "", ("f.yaml: ", "too large"), f"role: slave\nseed: 1{':1' * 200}.0"),
    (CHECK, "", ("f.yaml:2", "'a/b'"), f"{MASTER}[{{prediction: {{patient: a/b}}}}]"),
    (CHECK, "", ("two keep one prior",), f"{MASTER}[{{name: a, {KEEPS}}}, {{name: b, {KEEPS}}}]"),
    (CHECK, "", ("f.yaml:3: axes[0]", "load_cell: missing", "add the line load_cell: {"), f"{REAL}name: a"),
    (CHECK, "", ("gripper: missing", "add the line gripper: {"), f"{REAL}{CELL}}}"),
    (CHECK, "", ("f.yaml:4", "the line pushes_only: true"), f"{REAL}{CELL}, filter_lag_s: 0}}\n{GRIPPER}"),
    (CHECK, "", ("add the line filter_lag_s: 0",), f"{REAL}{CELL}, pushes_only: true}}\n{GRIPPER}"),
    (CHECK, "", ("f.yaml:3", "preset"), f"{AXIS}simulation: {{preset: [a]}}"),
    (CHECK, "", ("axes: handle: missing", "add the line handle: {"), FAR),
    ("master --config", "", ("no.csv",), f"{MASTER}[{{handle: {{driver: recording, recording: no.csv}}}}]"),
]
"""(command, options, words of the complaint, the file)"""

BAD: list[tuple[str, tuple[str, ...], dict[str, str]]] = [
    # --- the words of the command line ---
    ("fly", ("No such command", "fly"), {}),
    ("slave --konfig x", ("--konfig",), {}),
    ("slave", ("--config",), {}),
    ("config check", ("FILE",), {}),
    ("slave --config @/none.yaml", ("none.yaml", "No such file"), {}),
    ("slave --config @", ("Is a directory",), {}),
    *(
        (f"{line}{'a' * 300}{suffix}", ("File name too long",), {})
        for line, suffix in [
            ("pki init --cell a @/", ""), ("simulate --model catheter --out @/", ".csv"),
            ("diagnose @/", ".csv"), (LOOPBACK, ""),
        ]
    ),
    *(
        (f"{command} @/f.yaml {options}".strip(), words, {"f.yaml": text})
        for command, options, words, text in SETTINGS
    ),
    # --- record, view, report ---
    (f"record --out @/r.mcap {NEAR} --cell a/*", ("--cell", "a/*"), {}),
    (f"record --out @/r.mcap {NEAR} --duration -1", ("--duration",), {}),
    ("dashboard", ("--connect", "missing"), {}),
    (f"ros {NEAR} --domain 233", ("--domain",), {}),
    (f"ros {NEAR} --rate 0 {ROUTED}", ("--rate",), {}),
    (f"ros {NEAR} --accept-commands", ("--accept-commands", "Zenoh", "--zenoh"), {}),
    (f"ros {NEAR} {ROUTED} --servo insertion=@/s", ("--servo", "--accept-commands"), {}),
    (f"ros {NEAR} {ROUTED} --accept-commands --servo insertion", ("AXIS=SOCKET",), {}),
    (f"ros {NEAR} {ROUTED}", ("tcp/127.0.0.1:9", "no router answers"), {}),
    (f"ros {NEAR} --zenoh tcp/192.0.2.1:7447", ("outside this host", "--insecure"), {}),
    ("ros --zenoh tcp/127.0.0.1:9", ("--connect",), {}),
    (f"dashboard {NEAR} --port 99999", ("--port",), {}),
    (f"dashboard {NEAR} --vessel @/v.yaml", ("v.yaml:2", "lumen_radius_mm"), {"v.yaml": VESSEL}),
    ("doctor --config @/none.yaml", ("none.yaml",), {}),
    ("doctor --config @", (), {}),
    ("doctor --config @/a.yaml --config @/b.yaml", (), {"a.yaml": SLAVE, "b.yaml": SLAVE}),
    ("doctor --config @/a.yaml", ("a.yaml:2", "cell"), {"a.yaml": "role: slave\ncell: '*'\n"}),
    ("report @/none.mcap --out @/out", ("none.mcap", "No such file"), {}),
    ("report @/run.csv --out @/out", ("run.csv", "MCAP"), {"run.csv": RECORDING}),
    # --- loopback ---
    (f"{LOOPBACK} --dashboard", ("--dashboard",), {}),
    (f"{LOOPBACK} --impairment mars", ("--impairment", "mars", "satellite"), {}),
    (f"{LOOPBACK} --preset mars", ("--preset", "mars", "guidewire"), {}),
    *((f"{LOOPBACK} --duration {text}", ("--duration",), {}) for text in ("-1", "0.1", "nan")),
    (f"{LOOPBACK} --seed -1", ("--seed",), {}),
    (LOOPBACK, ("out", "is a file"), {"out": "precious"}),
    (f"{LOOPBACK}/deep/er", ("out", "Not a directory"), {"out": "precious"}),
    (LOOPBACK, ("out", "earlier run", "--overwrite"), {"out/recording.mcap": "precious"}),
    (f"{LOOPBACK} --slave-model @/none.yaml", ("none.yaml", "No such file"), {}),
    (f"{LOOPBACK} --slave-model @/m.yaml", ("m.yaml", "magic"), {"m.yaml": MAGIC}),
    (f"{LOOPBACK} --hide-at 3", ("--hide-at 3", "--hide"), {}),
    (f"{LOOPBACK} --hide @/m.yaml --hide-at -1", ("--hide-at -1", "0 to"), {"m.yaml": BIAS}),
    (f"{LOOPBACK} --hide @/m.yaml", ("second contact effect",), {"m.yaml": CONTACT}),
    (f"{LOOPBACK} --accept-prior", ("--accept-prior", "--prior-dir"), {}),
    (f"{LOOPBACK} --patient B", ("--patient B", "--prior-dir"), {}),
    (f"{LOOPBACK} --prior-dir @/priors --patient B.json", ("patient = 'B.json'",), {}),
    (f"{LOOPBACK} --prior-dir @/f", ("--prior-dir", "is a file"), {"f": "precious"}),
    (f"{LOOPBACK} --master-model @/m.yaml", ("m.yaml", "no linear parameter"), {"m.yaml": CONTACT}),
    (f"{LOOPBACK} --force N:load", ("N:load", "--recording"), {}),
    (f"{PLAYED} --preset guidewire", ("--preset guidewire", "has forces"), {"run.csv": RECORDING}),
    (f"{PLAYED} --prior-dir @/priors", ("--prior-dir", "has forces"), {"run.csv": RECORDING}),
    (f"{PLAYED} --hide @/m.yaml", ("--hide", "has forces"), {"run.csv": RECORDING, "m.yaml": BIAS}),
    (f"{LOOPBACK} --recording @/a.doc", ("a.doc", ".csv"), {"a.doc": "x"}),
    (PLAYED, ("run.csv", "no two samples"), {"run.csv": "time_s,position_m\n0,0\n1,0\n2,0\n"}),
    (PLAYED, ("run.csv", "workspace_m"), {"run.csv": "time_s,position_m\n0,0\n0.05,4000\n"}),
    (f"{PLAYED} --position N:position_m", ("position = 'N:position_m'", "'N'"), {"run.csv": RECORDING}),
]  # fmt: skip


@pytest.mark.parametrize(("line", "words", "files"), BAD, ids=[line for line, *_ in BAD])
def test_bad_input_is_one_line_and_leaves_nothing(
    shell: Shell, line: str, words: tuple[str, ...], files: dict[str, str]
) -> None:
    shell.refused(line, words, files)


def test_recording_of_two_axes_can_not_be_played(shell: Shell) -> None:
    with RunWriter(shell.folder / "two.mcap") as writer:
        for name in ("insertion", "rotation"):
            for index in range(3):
                put(writer, force(index), axis=name)
    shell.refused(f"{LOOPBACK} --recording @/two.mcap", ("insertion, rotation",))


@pytest.mark.parametrize(
    ("module", "line", "extra", "files"),
    [
        ("pyarrow", "diagnose run.parquet", "formats", {"run.parquet": "PAR1"}),
        ("pyarrow", "simulate --model guidewire --duration 2 --out new.parquet", "formats", {}),
        ("distributed", "diagnose in --scheduler tcp://127.0.0.1:8786", "cluster", {"in/a.csv": RECORDING}),
        ("uvicorn", f"dashboard {NEAR}", "dashboard", {}),
        ("uvicorn", "view run.mcap", "dashboard", {}),
    ],
)
def test_what_needs_an_extra_says_what_to_install(
    shell: Shell, monkeypatch: pytest.MonkeyPatch, module: str, line: str, extra: str, files: dict[str, str]
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setitem(sys.modules, f"{module}.parquet", None)
    monkeypatch.delitem(sys.modules, "forefeel.dashboard.server", raising=False)
    shell.refused(line, (f"forefeel[{extra}]",), files)
