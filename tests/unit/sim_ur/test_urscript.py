"""URScript on the emulated controller, in virtual time: the language, its threads, its words."""

import itertools
import math
from pathlib import Path

import pytest

from emulated_ur import Behaviour, Controller
from emulated_ur.arm import rotation_between
from emulated_ur.urscript import ScriptError, Splitter, compile_script
from emulated_ur.variables import ProgramState

PROGRAMS = sorted((Path(__file__).parents[2] / "data" / "ur" / "language").glob("*.script"))


@pytest.fixture
def robot():
    return Controller(Behaviour(program_start=0.002))


def run(robot, body, ticks=200):
    """Run the statements of a program and return what it said."""
    robot.upload("def test():\n" + body + "\nend\n")
    for _ in range(ticks):
        robot.tick()
    return list(robot.told)


def value(robot, expression):
    (said,) = run(robot, f"textmsg({expression})", 5)
    return said


@pytest.mark.parametrize(
    ("expression", "said"),
    [
        ("1 + 2 * 3 - 4 / 8", "6.5"),
        ("-(2 + 1) % 5 == 2", "True"),
        ("7 / 2", "3.5"),
        ("True and not False or 1 / 0", "True"),
        ("True xor True", "False"),
        ("1 < 2 and 2 <= 2 and 3 != 4", "True"),
        ("0x1F", "31"),
        ("[1, 2.5, True]", "[1, 2.5, True]"),
        ("p[0, 0, .1, 0, 0, 0]", "p[0, 0, 0.1, 0, 0, 0]"),
        ("[1, 2] + [3, 4] * 2", "[7, 10]"),
        ("-3 * [1, 2]", "[-3, -6]"),
        ("[[1, 2], [3, 4]][1, 0]", "3"),
        ('str_cat("a", str_sub("hello", 1, 3))', "aell"),
        ('str_find("abc", "c") + str_len("four")', "6"),
        ('to_num("2.5") + to_num("-4")', "-1.5"),
        ("norm([3, 4]) + norm(-2)", "7"),
        ("floor(2.7) + ceil(0.2) + round(1.6)", "5"),
        ("binary_list_to_integer([True, False, True])", "5"),
        ("pose_trans(p[1,0,0,0,0,1.5707963267948966], p[1,0,0,0,0,0])", "p[1, 1, 0, 0, 0, 1.5708]"),
        ("pose_inv(p[1, 2, 3, 0, 0, 0])", "p[-1, -2, -3, 0, 0, 0]"),
        ("interpolate_pose(p[0,0,0,0,0,0], p[1,0,0,0,0,1], 0.5)", "p[0.5, 0, 0, 0, 0, 0.5]"),
        ("rotvec2rpy(rpy2rotvec([0.1, 0.2, 0.3]))", "[0.1, 0.2, 0.3]"),
        ("get_list_length(get_actual_joint_positions())", "6"),
    ],
)
def test_expression(robot, expression, said):
    assert value(robot, expression) == said


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: path.stem)
def test_program_says_what_its_last_lines_expect(robot, path):
    """A script of tests/data/ur/language ends with a comment for each line that it says."""
    program, *said = path.read_text().rstrip("\n").split("\n# says ")
    robot.upload(program + "\n")
    for _ in range(200):
        robot.tick()
    assert list(robot.told) == said
    assert robot.runtime_state is ProgramState.STOPPED


def test_end_of_the_program_ends_its_threads(robot):
    body = "thread on():\n while True:\n  textmsg(1)\n  sync()\n end\nend\nrun on()\nsleep(0.2)"
    said = len(run(robot, body, 500))
    assert 90 <= said <= 105


@pytest.mark.parametrize(
    ("text", "line", "why"),
    [
        ("def f():\n  x = foo(1)\nend\n", 2, "compile_error_name_not_found:foo:"),
        ("def f():\n  textmsg(y)\nend\n", 2, "compile_error_name_not_found:y:"),
        (
            "def f():\n  movej([0,0,0,0,0,0], speed=1)\nend\n",
            2,
            "arguments:movej: got an unexpected",
        ),
        ("def f():\n  stopj(1, 2, 3)\nend\n", 2, "arguments:stopj: too many"),
        ("def f():\n  x = (1 +\nend\n", 3, "syntax_error_on_line:3:end:"),
        ("def f():\n  1 = 2\nend\n", 2, "syntax_error_on_line:2:1 = 2:"),
        ("def f():\n  x = 1 ; y = 2\nend\n", 2, "lexer_error_on_line:2"),
        ("def f():\n  if True\n    sync()\n  end\nend\n", 2, "expected ':'"),
        ("def f():\n  return\n", 3, "expected 'end'"),
        ("def f():\n  switch (1):\n  end\nend\n", 2, "switch is not emulated: use if and elif"),
        ("end\n", 1, "expected a statement"),
        ("def f():\n  x = " + "(" * 5000 + "\nend\n", 1, "too many brackets"),
    ],
)
def test_program_that_does_not_compile_says_where(robot, text, line, why):
    robot.upload(text)
    kind, said, _, (at, _) = robot.events[-1]
    assert (kind, at) == ("exception", line)
    assert why in said
    assert "program refused" in robot.log[-1]
    assert robot.program is None


@pytest.mark.parametrize(
    ("statement", "why"),
    [
        ("x = 1 / 0", "division by zero"),
        ("x = [1][2]", "index 2 is outside a list of 1 elements"),
        ("x = read_input_integer_register(99)", "number 99 is outside 0 to 47"),
        ("movel(p[5, 0, 0, 0, 0, 0])", "no solution"),
        ("x = get_inverse_kin(p[3, 0, 0, 0, 0, 0])", "no solution"),
        ("servoj([0, 0, 0, 0, 0, 0], lookahead_time=0)", "lookahead"),
        ("servoj([0, 0, 0, 0, 0, 0], gain=-1e5)", "gain"),
        ("movej([1e308, 0, 0, 0, 0, 0])", "expected 6 numbers"),
        ("movej([0, 0])", "expected 6 numbers"),
        ("direct_torque([0, 0, 0, 0, 0, 0])", "direct_torque is not emulated"),
        ("x = acos(2)", "math domain error"),
        ("x = p[1, 0, 0, 0, 0, 0] + 1", "poses have no arithmetic"),
        ("x = [1, 2] + [1]", "lists of 2 and 1 elements"),
        ("def f():\n f()\nend\nf()", "recursion"),
        ("x = y\n  y = 1", "'y'"),
        ('rtde_set_watchdog("nothing", 10)', "no register 'nothing'"),
    ],
)
def test_exception_ends_the_program_and_says_where(robot, statement, why):
    run(robot, f"  sleep(0.01)\n{statement}", 20)
    kind, said, _, (line, _) = robot.events[-2]
    assert kind == "exception"
    assert line >= 3
    assert why in said
    assert robot.runtime_state is ProgramState.STOPPED


def test_two_threads_cannot_move_the_arm_at_once(robot):
    run(robot, "thread other():\n sleep(0.1)\n stopj(1)\nend\nrun other()\n"
               "movej([1, -1, 1, 0, 0, 0])")  # fmt: skip
    assert "another thread is already controlling the robot" in robot.log[-1]


@pytest.mark.parametrize(
    ("call", "seconds"),
    [
        ("movej(q)", 1.07),
        ("movej(q, 3.0, 3.0)", 0.73),
        ("movej(q, t=0.5)", 0.5),
        ("movel(p[x[0], x[1], x[2] - 0.05, x[3], x[4], x[5]], v=0.1, a=1)", 0.6),
        ("servoj(get_target_joint_positions(), t=0.3)", 0.3),
        ("speedj([0.1, 0, 0, 0, 0, 0], 1, 0.2)", 0.2),
        ("speedj([0.1, 0, 0, 0, 0, 0], 1)", 0.1),
        ("speedl([0, 0, 0.05, 0, 0, 0], 0.25)", 0.2),
        ("sleep(0.25)", 0.25),
    ],
)
def test_motion_takes_its_time(robot, call, seconds):
    body = f"q = get_target_joint_positions()\nx = get_target_tcp_pose()\nq[0] = q[0] + 0.4\n{call}"
    robot.upload(f"def p():\n{body}\nwrite_output_integer_register(1, 1)\nend\n")
    robot.tick()
    count = 0
    while not robot.value("output_int_register_1") and count < 1000:
        robot.tick()
        count += 1
    assert count * 0.002 == pytest.approx(seconds, abs=0.02)


def test_speed_goes_on_until_the_stop_and_the_tool_takes_it_on_gradually(robot):
    before = robot.tool.pose("actual_TCP_pose")[2]
    run(robot, "speedl([0, 0, 0.05, 0, 0, 0], 0.25)\nsleep(0.2)\nstopl(5)\nsleep(1)", 50)
    assert 0.5 * 0.25 * 0.08**2 * 0.5 < robot.tool.pose("target_TCP_pose")[2] - before < 0.002
    for _ in range(300):
        robot.tick()
    assert robot.arm.is_still
    assert robot.tool.pose("actual_TCP_pose")[2] - before == pytest.approx(0.015, abs=0.003)


def test_secondary_program_runs_beside_the_main_one(robot):
    run(robot, "while True:\n sync()\nend", 5)
    robot.upload("sec io():\n  set_standard_digital_out(3, True)\nend\n")
    robot.tick()
    assert robot.value("actual_digital_output_bits") == 8
    assert robot.runtime_state is ProgramState.PLAYING
    robot.upload("sec late():\n  sleep(1)\nend\n")
    robot.tick()
    assert "SECONDARY_PROGRAM_EXCEPTION_XXX" in robot.log[-1]
    assert robot.runtime_state is ProgramState.PLAYING


def test_registers_flags_and_outputs(robot):
    robot.write_package(["input_int_register_3"], [7])
    robot.write_package(["input_double_register_4"], [0.5])
    body = """
  write_output_integer_register(2, read_input_integer_register(3) + 1)
  write_output_float_register(3, read_input_float_register(4) * 2)
  write_output_boolean_register(64, True)
  set_configurable_digital_out(1, True)
  set_tool_digital_out(0, True)
  set_standard_analog_out(0, 0.5)
  set_flag(3, True)
  textmsg(get_flag(3), read_output_boolean_register(64))
  textmsg(get_configurable_digital_out(1), get_digital_in(0))"""
    assert run(robot, body) == ["TrueTrue", "TrueFalse"]
    assert robot.value("output_int_register_2") == 8
    assert robot.value("output_double_register_3") == 1.0
    assert robot.value("output_bit_register_64") == 1
    assert robot.value("actual_digital_output_bits") == 1 << 9 | 1 << 16
    assert robot.value("standard_analog_output0") == pytest.approx(0.012)


def test_blocking_popup_waits_until_it_is_closed(robot):
    assert run(robot, 'popup("stop here", blocking=True)\ntextmsg("on")') == []
    assert robot.popup == "stop here"
    robot.popup = ""
    robot.tick()
    assert list(robot.told) == ["on"]


def test_watchdog_pauses_unless_told_to_stop(robot):
    run(robot, 'rtde_set_watchdog("input_int_register_0", 10)\nsleep(5)', 100)
    assert robot.runtime_state is ProgramState.PAUSED


def test_line_at_which_the_program_waits(robot):
    run(robot, "sync()\ndef wait():\n  sleep(5)\nend\nwait()", 5)
    assert robot.program.line == 4


@pytest.mark.parametrize("cut", [1, 7, 1000])
def test_programs_are_found_in_a_stream_however_it_is_cut(cut):
    line, empty = "movej([0, 0, 0, 0, 0, 0])\n", "\n# a comment with end\n"
    program = 'def a():\n  if True: sync() end\n  def b():\n    textmsg("end")\n  end \nend\r\n'
    stream = (empty + line + program + "sec c():\nend\n" + "  while tr").encode()
    splitter = Splitter()
    found = [
        one for at in range(0, len(stream), cut) for one in splitter.feed(stream[at : at + cut])
    ]
    assert [one.strip() for one in found] == [
        line.strip(), program.replace("\r", "").strip(), "sec c():\nend",
    ]  # fmt: skip
    assert splitter.unfinished == "while tr"


def test_nonsense_is_refused_whatever_it_is():
    for text in ("\x00", "def", "def f(", "def f():", 'x = "', "a.b()\n", "x = [", "((((", "p[1"):
        with pytest.raises(ScriptError):
            compile_script(text, {})


@pytest.mark.parametrize("number", [math.nan, math.inf, 1e308])
@pytest.mark.parametrize(
    "statement",
    [
        "movej([x, x, x, x, x, x])",
        "servoj(get_inverse_kin(p[x, x, x, x, x, x]), t=0.1)",
        "servoj(get_target_joint_positions(), t=x, lookahead_time=x, gain=x)",
        "speedl([x, x, x, x, x, x], x)",
        "stopl(x)",
        "force_mode(p[x,x,x,x,x,x], [x,x,x,x,x,x], [x,x,x,x,x,x], 2, [x,x,x,x,x,x])",
        'rtde_set_watchdog("input_int_register_0", x)',
    ],
)
def test_numbers_that_are_none_reach_no_joint(robot, statement, number):
    robot.write_package(["input_double_register_0"], [number])
    before = robot.arm.actual_q
    run(robot, f"x = read_input_float_register(0)\n{statement}\nsync()", 10)
    assert robot.arm.actual_q == pytest.approx(before)


@pytest.mark.parametrize(
    "call",
    ["movej([0.4, -1.57, 1.4, -1.4, -1.57, 0])", "movel(pose_add(x, p[0, 0, -0.1, 0, 0, 0]))"],
)
def test_motion_that_was_paused_goes_on_from_where_the_arm_stopped(robot, call):
    run(robot, f"x = get_target_tcp_pose()\n{call}\nwrite_output_integer_register(1, 1)", 150)
    robot.pause()
    for _ in range(50):
        robot.tick()
    assert robot.runtime_state is ProgramState.PAUSED
    robot.play()
    for _ in range(600):
        robot.tick()
    assert robot.value("output_int_register_1") == 1
    assert robot.log == []


def test_cycle_of_a_cb3_controller_is_eight_milliseconds():
    robot = Controller(Behaviour(program_start=0.002, version=(3, 15, 8, 0)))
    body = "n = 0\nwhile n < 10:\n  sync()\n  n = n + 1\nend\ntextmsg(get_steptime())"
    assert run(robot, body, 40) == []
    for _ in range(3):
        robot.tick()
    assert list(robot.told) == ["0.008"]


@pytest.mark.parametrize(("sweep", "mode"), [(0.6, 0), (2.0, 0), (4.5, 0), (0.6, 1), (1.2, 1)])
def test_movec_runs_on_the_circle_through_its_three_positions(robot, sweep, mode):
    x, y, z, *turn = robot.tool.pose("target_TCP_pose")

    def pose(angle):
        at = x, y + 0.05 * math.sin(angle), z + 0.05 - 0.05 * math.cos(angle)
        return f"p[{', '.join(map(repr, (*at, *turn)))}]"

    begun = robot.tool.at(robot.arm.target_q)
    robot.upload(
        f"def p():\n  movec({pose(sweep / 3)}, {pose(sweep)}, a=0.5, v=0.05, mode={mode})\nend\n"
    )
    angles = []
    for _ in range(4000):
        robot.tick()
        _, b, c, *_ = robot.tool.pose("target_TCP_pose")
        assert math.hypot(b - y, c - z - 0.05) == pytest.approx(0.05, abs=1e-9)
        angles.append(math.atan2(b - y, z + 0.05 - c) % math.tau)
    assert robot.runtime_state is ProgramState.STOPPED
    assert angles[-1] == pytest.approx(sweep, abs=1e-9)
    turned = rotation_between(begun, robot.tool.at(robot.arm.target_q))
    assert turned == pytest.approx((sweep if mode else 0.0, 0, 0), abs=1e-9)
    assert max(b - a for a, b in itertools.pairwise(angles)) < 1.01 * 0.05 / 0.05 * 0.002


def test_movec_without_a_circle_ends_the_program(robot):
    run(robot, "q = get_target_tcp_pose()\n  movec(q, q)")
    assert "the three positions are on a line" in robot.log[-1]


def test_interpreter_mode_runs_statements_of_the_program_as_they_come(robot):
    assert robot.interpret("statelastexecuted") == "discard: no program runs: statelastexecuted"
    robot.upload("def p():\n  a = 2\n  interpreter_mode()\n  textmsg(a)\nend\n")
    for _ in range(5):
        robot.tick()
    statements = [
        "def twice(x): sync() return 2 * x end",
        "a = twice(a) + 1",
        "b = a",
        "textmsg(b)",
        "sleep(1)",
        "never()",
        "textmsg(1)",
    ]
    answers = [robot.interpret(statement) for statement in statements]
    ids = [1, 2, 3, 4, 5, None, 6]
    assert answers == [
        f"ack: {n}: {one}" if n else f"discard: compile_error_name_not_found:never:: {one}"
        for n, one in zip(ids, statements, strict=True)
    ]
    for _ in range(20):
        robot.tick()
    assert list(robot.told) == ["5"]
    states = ("statelastexecuted", "statelastinterpreted", "stateunexecuted", "statelastcleared")
    assert [int(robot.interpret(one).split(":")[1]) for one in states] == [5, 6, 1, 0]
    assert robot.interpret("skipbuffer") == "ack: 6: skipbuffer"
    assert robot.interpret("end_interpreter()").startswith("ack: 7")
    for _ in range(600):
        robot.tick()
    assert list(robot.told) == ["5", "5"]
    assert robot.runtime_state is ProgramState.STOPPED


def test_a_motion_of_interpreter_mode_is_aborted(robot):
    robot.upload("def p():\n  interpreter_mode()\nend\n")
    for _ in range(5):
        robot.tick()
    robot.interpret("movej([1, -1, 1, -1, -1, 0])")
    for _ in range(100):
        robot.tick()
    assert not robot.arm.is_still
    assert robot.interpret("abort").startswith("ack: 1")
    for _ in range(300):
        robot.tick()
    assert robot.arm.is_still
    assert robot.arm.target_q[0] < 0.9
    assert robot.interpret("textmsg(1)") == "ack: 2: textmsg(1)"


def test_statement_for_a_program_that_does_not_interpret_is_discarded(robot):
    robot.upload("def p():\n  sleep(1)\nend\n")
    for _ in range(5):
        robot.tick()
    assert robot.interpret("textmsg(1)\r").startswith("discard: the program is not in interp")
