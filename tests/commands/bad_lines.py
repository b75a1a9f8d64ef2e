"""Wrong command lines and files, and the words of the complaint that a person needs."""

from dataclasses import dataclass, field

SLAVE = "role: slave\ntransport: {listen: ['tcp/127.0.0.1:0']}\n"
RECORDING = "time_s,position_m,force_n\n0.0,0.0,0.1\n0.01,0.001,0.2\n0.02,0.002,0.3\n"


@dataclass(frozen=True)
class Bad:
    """A wrong command line: what stands in it (`@` is the test's folder), the files, and the words of the
    complaint.
    """

    arguments: str
    words: tuple[str, ...]
    files: dict[str, str] = field(default_factory=dict)


def settings(command: str, text: str, *words: str) -> Bad:
    return Bad(f"{command} @/file.yaml", ("file.yaml", *words), {"file.yaml": text})


def recording(text: str, *words: str, arguments: str = "") -> Bad:
    line = f"loopback --virtual-time --out @/out --recording @/run.csv {arguments}"
    # a column is refused before the file is opened
    return Bad(line, words if "=" in words[0] else ("run.csv", *words), {"run.csv": text})


def axis(text: str) -> str:
    return f"role: slave\naxes:\n  - {text}\n"


LOOPBACK = "loopback --virtual-time --out @/out"
CHECK = "config check"
MODEL = "schema: forefeel.model/1\nname: x\neffects:\n"

BAD = {
    # --- the words of the command line ---
    "no such command": Bad("fly", ("No such command", "fly")),
    "no such option": Bad("slave --konfig x", ("--konfig",)),
    "option missing": Bad("slave", ("--config",)),
    "argument missing": Bad("config check", ("FILE",)),
    "duration no number": Bad(
        "slave --config @/file.yaml --duration soon", ("--duration",), {"file.yaml": SLAVE}
    ),
    "slave for a negative duration": Bad(
        "slave --config @/file.yaml --duration -1", ("--duration",), {"file.yaml": SLAVE}
    ),
    "master for a negative duration": Bad(
        "master --config @/file.yaml --duration -1", ("--duration",), {"file.yaml": "role: master\n"}
    ),
    "slave until nan": Bad(
        "slave --config @/file.yaml --duration nan", ("--duration",), {"file.yaml": SLAVE}
    ),
    # --- YAML files ---
    "slave without a file": Bad("slave --config @/none.yaml", ("none.yaml", "No such file")),
    "slave of a folder": Bad("slave --config @", ("Is a directory",)),
    "slave of a master's file": settings("slave --config", "cell: a\nrole: master\n", ":2", "'slave'"),
    "master of a slave's file": settings("master --config", "role: slave\n", ":1", "'master'"),
    "role missing": settings(CHECK, "cell: a\n", "role = None"),
    "role unknown": settings(CHECK, "role: captain\n", ":1", "captain"),
    "role a list": settings(CHECK, "role: [slave]\n", ":1", "['slave']"),
    "empty": settings(CHECK, "", "expected a mapping"),
    "a list": settings(CHECK, "- role: slave\n", ":1", "expected a mapping"),
    "not YAML": settings("slave --config", "role: slave\ncell: [a\n", ":3", "YAML"),
    "a tab": settings("master --config", "role: master\n\tcell: a\n", ":2", "YAML"),
    "not text": settings(CHECK, "role: slave\0\n"),
    "key twice": settings("slave --config", "role: slave\ncell: a\ncell: b\n", ":3", "cell", "twice"),
    "a list as key": settings(CHECK, "role: slave\n? [a]\n: b\n", ":2"),
    "endless": settings(CHECK, "role: slave\naxes: &a [*a]\n", ":2"),
    "code in YAML": settings(CHECK, "role: !!python/name:os.system\n", ":1", "python/name"),
    "unknown key": settings("slave --config", "role: slave\nspeed: 3\n", ":2", "speed", "unknown key"),
    "unknown key deep down": settings(
        "slave --config", axis("gate: {watchdog_ms: 60}"), ":3", "axes[0].gate.watchdog_ms"
    ),
    "unknown key of the master": settings(
        "master --config",
        "role: master\naxes: [{rendering: {max_n: 4}}]\n",
        ":2",
        "axes[0].rendering.max_n",
    ),
    "watchdog out of range": settings(CHECK, axis("gate: {watchdog_s: 0.31}"), ":3", "watchdog_s = 0.31"),
    "nan": settings(CHECK, axis("limits: {max_force_n: .nan}"), ":3", "max_force_n = nan"),
    "workspace upside down": settings(CHECK, axis("limits: {workspace_m: [1, 0]}"), ":3", "workspace_m"),
    "no axis": settings("slave --config", "role: slave\naxes: []\n", ":2", "axes"),
    "two axes of one name": settings(
        CHECK, "role: master\naxes: [{name: a}, {name: a}]\n", "['a', 'a']", "once"
    ),
    "a wildcard cell": settings(CHECK, "role: slave\ncell: '*'\n", ":2", "cell = '*'"),
    "unknown driver": settings(CHECK, axis("stage: {driver: warp}"), ":3", "driver = 'warp'"),
    "unknown world": settings(CHECK, axis("simulation: {preset: mars}"), ":3", "preset = 'mars'"),
    "unknown effect": settings(
        CHECK,
        axis(
            "simulation: {contact: {schema: forefeel.model/1, name: x, effects: [{effect: magic}]}}",
        ),
        ":3",
        "effects[0].effect",
        "magic",
    ),
    "unknown impairment": settings(
        CHECK, "role: slave\nimpairment: {inbound: mars}\n", ":2", "mars", "satellite"
    ),
    "jitter beyond the delay": settings(
        CHECK, "role: master\nimpairment: {outbound: {jitter_s: 1}}\n", ":2", "jitter_s"
    ),
    "no such replay": settings(
        "slave --config", "role: slave\nimpairment: {replay: no.mcap}\n", ":2", "no.mcap"
    ),
    "no such recording": settings(
        "master --config",
        "role: master\naxes:\n  - handle: {driver: recording, recording: no.csv}\n",
        ":3",
        "no.csv",
    ),
    # --- files that a daemon reads ---
    "master of a model that is none": Bad(
        "master --config @/file.yaml",
        ("model.yaml", "effects[0].effect", "magic"),
        {
            "file.yaml": "role: master\naxes: [{prediction: {model: model.yaml}}]\n",
            "model.yaml": MODEL + "  - effect: magic\n",
        },
    ),
    "master of a model with nothing to learn": Bad(
        "master --config @/file.yaml",
        ("model.yaml",),
        {
            "file.yaml": "role: master\naxes: [{prediction: {model: model.yaml}}]\n",
            "model.yaml": MODEL + "  - effect: contact_loss\n",
        },
    ),
    "master of a recording in single samples": Bad(
        "master --config @/file.yaml",
        ("run.csv",),
        {
            "file.yaml": "role: master\naxes: [{handle: {driver: recording, recording: run.csv}}]\n",
            "run.csv": "time_s,position_m\n0,0\n1,0\n",
        },
    ),
    "slave of a recording without force": Bad(
        "slave --config @/file.yaml",
        ("run.csv", "no force column"),
        {
            "file.yaml": axis("load_cell: {driver: recorded, recording: run.csv}"),
            "run.csv": "time_s,position_m\n0,0\n0.01,0\n",
        },
    ),
    "slave of a replay without impairment": Bad(
        "slave --config @/file.yaml",
        ("run.mcap", "no impairment of the slave's links"),
        {"file.yaml": "role: slave\nimpairment: {replay: run.mcap}\n", "run.mcap": "@an empty run"},
    ),
    "slave of a replay that is no run": Bad(
        "slave --config @/file.yaml",
        ("no.mcap",),
        {"file.yaml": "role: slave\nimpairment: {replay: no.mcap}\n", "no.mcap": "not MCAP at all"},
    ),
    # --- endpoints ---
    "slave at a malformed endpoint": Bad(
        "slave --config @/file.yaml",
        ("'tcp:7447'", "protocol/host:port"),
        {"file.yaml": "role: slave\ntransport: {listen: ['tcp:7447']}\n"},
    ),
    "master to a host that is none": Bad(
        "master --config @/file.yaml",
        ("no-such-host.invalid", "does not resolve"),
        {"file.yaml": "role: master\ntransport: {connect: ['tcp/no-such-host.invalid:7447']}\n"},
    ),
    "record at a malformed endpoint": Bad("record --out @/r.mcap --connect 10.0.0.2", ("'10.0.0.2'",)),
    # --- record ---
    "record nowhere": Bad(
        "record --out @/none/r.mcap --connect tcp/127.0.0.1:9", ("none/r.mcap", "No such file")
    ),
    "record over a file": Bad(
        "record --out @/r.mcap --connect tcp/127.0.0.1:9", ("r.mcap", "File exists"), {"r.mcap": "precious"}
    ),
    "record a wildcard": Bad("record --out @/r.mcap --connect tcp/127.0.0.1:9 --cell a/*", ("--cell", "a/*")),
    "record for a negative duration": Bad(
        "record --out @/r.mcap --connect tcp/127.0.0.1:9 --duration -1", ("--duration",)
    ),
    # --- dashboard ---
    "dashboard of nobody": Bad("dashboard", ("--connect", "missing")),
    "dashboard at a malformed endpoint": Bad("dashboard --connect 10.0.0.2 --port 0", ("'10.0.0.2'",)),
    "dashboard of a wildcard": Bad("dashboard --connect tcp/127.0.0.1:9 --cell a/*", ("--cell", "a/*")),
    "dashboard at a port that is none": Bad("dashboard --connect tcp/127.0.0.1:9 --port 99999", ("--port",)),
    "view of nothing": Bad("view @/none.mcap", ("none.mcap", "No such file")),
    "view of a table": Bad("view @/run.csv", ("run.csv", "MCAP"), {"run.csv": RECORDING}),
    "loopback watched in virtual time": Bad(f"{LOOPBACK} --virtual-time --dashboard", ("--dashboard",)),
    # --- report ---
    "report of nothing": Bad("report @/none.mcap --out @/out", ("none.mcap", "No such file")),
    "report of a table": Bad("report @/run.csv --out @/out", ("run.csv", "MCAP"), {"run.csv": RECORDING}),
    # --- loopback ---
    "loopback impairment": Bad(f"{LOOPBACK} --impairment mars", ("--impairment", "mars", "satellite")),
    "loopback preset": Bad(f"{LOOPBACK} --preset mars", ("--preset", "mars", "guidewire")),
    "loopback for a negative duration": Bad(f"{LOOPBACK} --duration -1", ("--duration",)),
    "loopback for no time": Bad(f"{LOOPBACK} --duration 0.1", ("--duration",)),
    "loopback until nan": Bad(f"{LOOPBACK} --duration nan", ("--duration",)),
    "loopback seed": Bad(f"{LOOPBACK} --seed -1", ("--seed",)),
    "loopback into a file": Bad(f"{LOOPBACK}", ("out", "is a file"), {"out": "precious"}),
    "loopback below a file": Bad(f"{LOOPBACK}/deep/er", ("out", "Not a directory"), {"out": "precious"}),
    "loopback over an earlier run": Bad(
        f"{LOOPBACK}", ("out", "earlier run", "--overwrite"), {"out/recording.mcap": "precious"}
    ),
    "loopback slave model missing": Bad(f"{LOOPBACK} --slave-model @/m.yaml", ("m.yaml", "No such file")),
    "loopback slave model": Bad(
        f"{LOOPBACK} --slave-model @/m.yaml", ("m.yaml", "magic"), {"m.yaml": MODEL + "  - effect: magic\n"}
    ),
    "loopback hides nothing": Bad(f"{LOOPBACK} --hide-at 3", ("--hide-at 3", "--hide")),
    "loopback hides a file that is not there": Bad(f"{LOOPBACK} --hide @/m.yaml", ("m.yaml", "No such file")),
    "loopback hides before it begins": Bad(
        f"{LOOPBACK} --hide @/m.yaml --hide-at -1",
        ("--hide-at -1", "0 to"),
        {"m.yaml": MODEL + "  - effect: bias\n"},
    ),
    "loopback hides a second contact": Bad(
        f"{LOOPBACK} --hide @/m.yaml",
        ("second contact effect",),
        {"m.yaml": MODEL + "  - effect: contact_loss\n"},
    ),
    "loopback hides beside recorded forces": Bad(
        f"{LOOPBACK} --recording @/run.csv --hide @/m.yaml",
        ("--hide", "m.yaml", "has forces"),
        {"run.csv": RECORDING, "m.yaml": MODEL + "  - effect: bias\n"},
    ),
    "loopback master model": Bad(
        f"{LOOPBACK} --master-model @/m.yaml", ("m.yaml", "schema"), {"m.yaml": "name: x\neffects: []\n"}
    ),
    "loopback master model that learns nothing": Bad(
        f"{LOOPBACK} --master-model @/m.yaml",
        ("m.yaml", "no linear parameter"),
        {"m.yaml": MODEL + "  - effect: contact_loss\n"},
    ),
    "loopback of a file that is no model": Bad(
        f"{LOOPBACK} --slave-model @/m.yaml",
        ("forefeel: /", "m.yaml: model: schema"),
        {"m.yaml": "name: x\n"},
    ),
    "a column of no recording": Bad(f"{LOOPBACK} --force N:load", ("--force N:load", "--recording")),
    "a preset beside recorded forces": Bad(
        f"{LOOPBACK} --recording @/run.csv --preset guidewire",
        ("--preset guidewire", "has forces"),
        {"run.csv": RECORDING},
    ),
    "a world beside recorded forces": Bad(
        f"{LOOPBACK} --recording @/run.csv --slave-model @/m.yaml",
        ("--slave-model", "m.yaml", "has forces"),
        {"run.csv": RECORDING, "m.yaml": MODEL + "  - effect: contact_loss\n"},
    ),
    "recording missing": Bad(f"{LOOPBACK} --recording @/none.csv", ("none.csv", "No such file")),
    "recording of another kind": Bad(f"{LOOPBACK} --recording @/a.txt", ("a.txt", ".csv"), {"a.txt": "x"}),
    "recording that is no MCAP": Bad(f"{LOOPBACK} --recording @/a.mcap", ("a.mcap",), {"a.mcap": RECORDING}),
    "recording empty": recording("", "empty"),
    "recording without position": recording("time_s,force_n\n0,1\n1,2\n", "position_m"),
    "recording without time": recording("t,position_m\n0,1\n1,2\n", "time_s"),
    "recording with nan": recording(
        "time_s,position_m\n0,0\n0.01,nan\n0.02,0\n", "line 3", "position_m", "nan"
    ),
    "recording with an empty cell": recording("time_s,position_m\n0,0\n0.01,\n", "line 3", "position_m"),
    "recording with text": recording("time_s,position_m\n0,0\n0.01,far\n", "line 3", "far"),
    "recording with a short line": recording("time_s,position_m\n0,0\n0.01\n", "line 3", "1 cell"),
    "recording back in time": recording(
        "time_s,position_m\n0,0\n0.02,0\n0.01,0\n", "line 4", "0.01 after 0.02"
    ),
    "recording with time twice": recording("time_s,position_m\n0,0\n0.01,0\n0.01,0\n", "line 4"),
    "recording of one sample": recording("time_s,position_m\n0,0\n", "1 sample"),
    "recording in single samples": recording("time_s,position_m\n0,0\n1,0\n2,0\n", "no two samples"),
    "recording in kilometres": recording("time_s,position_m\n0,0\n0.05,4000\n", "workspace_m"),
    "recording of a shot": recording("time_s,position_m\n0,0\n0.001,4\n", "max_velocity_m_s"),
    "recording column of no unit": recording(RECORDING, "time = 'time_s'", arguments="--time time_s"),
    "recording column of a wrong unit": recording(
        RECORDING, "position = 'N:position_m'", "'N'", arguments="--position N:position_m"
    ),
    "recording column that is not there": recording(RECORDING, "'laser'", arguments="--position mm:laser"),
}
