"""Wrong motion files: each is refused in one line with the file, the field, the value and more."""

import pytest
from command_line import inside

REST = "keyframes:\n  - {rotation_vector: [0, 0, 0]}\n"
TURN = REST + "  - {rotation_vector: [0, 0, 1]}\n"

# The file, the field, and what the line says of it.
WRONG = {
    "a decimal point lost in an azimuth": (
        REST + "  - azimuth_elevation: {azimuth: 24435, elevation: -20}\n",
        "keyframes[1].azimuth_elevation.azimuth: expected -720 to 720 deg, got 24435; "
        "check the decimal point",
    ),
    "a decimal point lost in an elevation": (
        REST + "  - azimuth_elevation: {azimuth: 20, elevation: -2443.5}\n",
        "keyframes[1].azimuth_elevation.elevation: expected -180 to 180 deg, got -2443.5; "
        "check the decimal point",
    ),
    "a misspelt key of the sun": (
        REST + "keep_out:\n  - {name: s, half_angle_deg: 9, sun: {latitude: 1, lon: 2}}\n",
        "keep_out[0].sun.lon: unknown key; did you mean 'longitude'?; known are latitude, ",
    ),
    "a decimal comma in a mapping": (
        REST + "  - {time: 3,5, rotation_vector: [0, 0, 1]}\n",
        "keyframes[1].5: unknown key; write numbers with a decimal point; known are quaternion, ",
    ),
    "a decimal comma in a list": (
        REST + "  - {rotation_vector: [0,5, 0, 1]}\n",
        "keyframes[1].rotation_vector: expected 3 entries, got 4: [0, 5, 0, 1]",
    ),
    "a decimal comma of a number": (
        REST + "duration: 2,5\n",
        "duration: expected 'minimum' or seconds, got the text '2,5' "
        "(with a decimal point it would be a number)",
    ),
    "a number with its unit": (
        REST + "limits: {velocity: 30 deg/s}\n",
        "limits.velocity: expected a number, got the text '30 deg/s' "
        "(write the number alone, without a unit)",
    ),
    "components in capitals": (
        REST + "  - {quaternion: {W: 1, X: 0, Y: 0, Z: 0}}\n",
        "keyframes[1].quaternion.W: unknown key; did you mean 'w'?; known are w, x, y, z",
    ),
    "angles in a list": (
        REST + "  - {azimuth_elevation: [20, 30]}\n",
        "keyframes[1].azimuth_elevation: expected {azimuth: ..., elevation: ...}, got [20, 30]",
    ),
    "a matrix in one row": (
        REST + "  - {matrix: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n",
        "keyframes[1].matrix: expected 3 entries, got 9: [1, 0, 0, 0, 1, 0, ...]",
    ),
    "keyframes by name": (
        "keyframes:\n  first: {rotation_vector: [0, 0, 0]}\n",
        "keyframes: expected a list, got {'first': {'rotation_vector': [0, 0, 0]}}",
    ),
    "one time in milliseconds": (
        "keyframes:\n  - {time: 0, rotation_vector: [0, 0, 0]}\n"
        "  - {time: 2000, rotation_vector: [0, 0, 1]}\n"
        "  - {time: 2.5, rotation_vector: [0, 0, 2]}\n",
        "keyframes[2].time: must be later than keyframes[1] at 2000 s, got 2.5 s",
    ),
    "a component that is left out": (
        REST + "  - {quaternion: {w: 1, x: 0, y: 0}}\n",
        "keyframes[1].quaternion.z: missing; add this key",
    ),
    "a number that is none": (
        REST + "  - {rotation_vector: [0, 0, .nan]}\n",
        "keyframes[1].rotation_vector[2]: expected a finite number, got nan; "
        "give a number such as 1.5",
    ),
    "a limit of zero": (
        TURN + "limits: {velocity: 0}\n",
        "limits.velocity: expected a number greater than 0, got 0; "
        "give such a limit, or leave it out",
    ),
    "half a turn": (
        REST + "  - {rotation_vector: [0, 0, 1], turns: 1.5}\n",
        "keyframes[1].turns: expected a whole number, got 1.5; give a number such as 2",
    ),
    "two forms at once": (
        REST + "  - {rotation_vector: [0, 0, 1], direction: [1, 0, 0]}\n",
        "keyframes[1]: expected one of quaternion, rotation_vector, euler, matrix, direction, "
        "azimuth_elevation, look_at; got rotation_vector and direction; keep one",
    ),
    "a matrix of huge entries": (
        REST + "  - {matrix: [[1.0e+200, 0, 0], [0, 1.0e+200, 0], [0, 0, 1.0e+200]]}\n",
        "keyframes[1].matrix: must be a rotation, got an entry of 1e+200",
    ),
    "a mirror": (
        REST + "  - {matrix: [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}\n",
        "keyframes[1].matrix: must be a rotation, got a reflection (determinant -1); "
        "give orthonormal rows, or another form",
    ),
    "mixed axes": (
        REST + "  - {euler: {axes: xYz, degrees: [1, 2, 3]}}\n",
        "keyframes[1].euler.axes: must be one to three of the letters xyz (about fixed axes) or "
        "XYZ (about axes that turn with the body), no two neighbours the same, got 'xYz'; "
        "give for example xyz",
    ),
    "the full angle of a cone": (
        TURN + "keep_out: [{name: s, half_angle_deg: 300, direction: [1, 0, 0]}]\n",
        "keep_out[0].half_angle_deg: expected above 0, at most 90, got 300; "
        "give half of the angle, in degrees",
    ),
    "a switch that is a number": (
        TURN + "approach: 1\n",
        "approach: expected true or false, got 1; write one of the two",
    ),
    "a bracket that is left open": (
        REST + "  - {rotation_vector: [0, 0, 1]\n",
        "line 4: not YAML: did not find expected ',' or '}'; "
        "put commas between entries, and close the brackets",
    ),
    "a key twice": (
        REST + "  - {rotation_vector: [0, 0, 1], rotation_vector: [0, 0, 2]}\n",
        "keyframes[1].rotation_vector: the key is given twice, again on line 3; keep one",
    ),
    "tabs": ("keyframes:\n\t- {}\n", "line 2: not YAML: a tab; YAML is indented with spaces"),
}
PLANNED = {
    "a method of another library": (
        TURN + "method: cubic\n",
        "method: unknown method 'cubic'; `orientd methods` lists them",
    ),
    "a frame that nobody has defined": (
        TURN + "frame: table\n",
        "keyframes[0].frame: there are no frames here, got 'table'; define it in `frames` of the "
        "motion or of the device",
    ),
    "an order above the number of keyframes": (
        TURN + "method: kks_bspline\noptions: {order: 11}\n",
        "options.order: order must be at most the number of keyframes, 2, got 11",
    ),
}


def refusal(path):
    """Return the one line with which a motion file is refused."""
    done = inside("plan", path)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1)
    return done.stderr.removeprefix("orientd: ").rstrip("\n")


@pytest.mark.parametrize(
    ("text", "line"), WRONG.values(), ids=[name.replace(" ", "_") for name in WRONG]
)
def test_a_wrong_motion_file_is_refused_with_field_value_and_expectation(tmp_path, text, line):
    path = tmp_path / "motion.yaml"
    path.write_text(text)
    assert refusal(path).startswith(f"{path}: {line}")


@pytest.mark.parametrize(
    ("text", "line"), PLANNED.values(), ids=[name.replace(" ", "_") for name in PLANNED]
)
def test_what_cannot_be_planned_is_refused_with_its_field(tmp_path, text, line):
    path = tmp_path / "motion.yaml"
    path.write_text(text)
    assert refusal(path) == line
