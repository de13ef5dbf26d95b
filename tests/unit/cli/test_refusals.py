"""What commands refuse without a daemon: the exit status, and what the one line says."""

import pytest
from command_line import assert_refused, inside

STANDARD = "{standard}"
FILES = {
    "one.yaml": "keyframes: [{rotation_vector: [0, 0, 0.5]}]\n",
    "run.mcap": "dear",
    "load.csv": "time,load\n0,1\n",
    "duration.yaml": (
        "keyframes:\n  - {time: 0, rotation_vector: [0, 0, 0]}\n"
        "  - {time: 1, rotation_vector: [0, 0, 1]}\nduration: 2\n"
    ),
}
"""Files in the folder of a test, by name."""

REFUSED = [
    # the command, its exit status, and what its line says
    # Files
    ("plan absent.yaml", 1, ["cannot read", "No such file"]),
    ("compare none.yaml", 1, ["none.yaml"]),
    (
        "plan duration.yaml",
        1,
        [
            "orientd: duration.yaml: duration: the planner then chooses the times; leave out "
            "those of the keyframes\n"
        ],
    ),
    ("replay load.csv --dry-run", 1, ["no quaternion in the"]),
    ("record run.mcap", 1, ["run.mcap", "there already"]),
    ("record none/run.mcap", 1, ["run.mcap: No such file or directory"]),
    ("demo --plot none/demo.png", 1, ["cannot write"]),
    # Curves
    ("plan one.yaml", 1, ["keyframes: ", "expected at least 2"]),
    ("compare one.yaml", 1, ["keyframes: ", "expected at least 2"]),
    ("plot one.yaml", 1, ["keyframes: ", "expected at least 2"]),
    (
        f"compare {STANDARD}/repeated_and_flipped.yaml --times chord",
        1,
        ["keyframes[2]", "is the same as the one before it"],
    ),
    (f"plot {STANDARD}/spread.yaml --show body -o x.svg", 1, ["positions"]),
    (
        "plot squad",
        1,
        [
            "'squad' is no file",
            "set `method: squad` in a motion file, or see its picture in the documentation",
        ],
    ),
    ("plot kks-2", 1, ["'kks-2' is no file", "see the figures of the papers in the documentation"]),
    ("plot nothing", 1, ["'nothing' is no file\n"]),
    ("methods --gallery here", 1, ["`orientd compare FILE --plot PICTURE`", "page Curves"]),
    ("methods --format here", 1, ["`orientd compare FILE --plot PICTURE`", "page Curves"]),
    # Mistakes of usage
    ("mvoe", 2, ["no such command 'mvoe'", "did you mean 'move'"]),
    ("plot", 2, ["expected a motion file or a recording", "`orientd methods`"]),
    (f"compare {STANDARD}/spread.yaml --sort torque", 2, ["needs --inertia"]),
    *(
        (f"compare {STANDARD}/spread.yaml --inertia={inertia}", 2, ["--inertia"])
        for inertia in ("1,2", "1,2,x", "1,0,2", "1,-1,2", "1,inf,2", "")
    ),
    ("plan m.yaml --plot picture.foo", 2, ["must end in .png"]),
    ("plot m.yaml -o picture.foo", 2, ["must end in .png"]),
    ("demo -p picture.foo", 2, [".png", "got 'picture.foo'"]),
    (
        f"compare {STANDARD}/spread.yaml --plot sheet.gif",
        2,
        ["must end in .png, .svg, .pdf"],
    ),
    ("status --address nowhere", 2, ["expected HOST:PORT or fleet:NAME, got 'nowhere'"]),
    ("status --address localhost", 2, ["expected HOST:PORT or fleet:NAME, got 'localhost'"]),
    ("status --cert ana.pem", 2, ["--cert, --key and --ca need --address"]),
    ("sim dynamixel --link bus --usb-ms inf", 2, ["--usb-ms"]),
    ("sim dynamixel --link bus --servos 1:mx28", 2, ["'1:mx28'"]),
    *(
        (f"serve {protocol} --north nan", 2, ["expected a finite number, got nan"])
        for protocol in ("rotctld", "mavlink", "alpaca")
    ),
    *(
        (f"serve alpaca --park {place}", 2, ["expected azimuth and altitude"])
        for place in ("10", "a,b", "10,200", "nan,0")
    ),
    *(
        (f"serve alpaca --observer {place}", 1, ["expected LAT,LON"])
        for place in ("10", "a,b", "100,200", "nan,0")
    ),
]


@pytest.mark.parametrize(("command", "status", "parts"), REFUSED, ids=[row[0] for row in REFUSED])
def test_a_command_that_is_refused_says_why(command, status, parts, tmp_path, monkeypatch, request):
    for module in ("matplotlib", "mcap", "alpaca.telescope"):
        pytest.importorskip(module)
    standard = request.config.rootpath / "tests/data/standard"
    monkeypatch.delenv("ORIENTD_ADDRESS", raising=False)
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    done = inside(*command.format(standard=standard).split(" "))
    assert_refused(done, status=status)
    for part in parts:
        assert part in done.stderr
    assert done.stdout == ""
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == FILES
