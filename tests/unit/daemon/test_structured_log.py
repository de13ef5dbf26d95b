"""Log lines for people and for programs."""

import json
import logging

from orientd.daemon.log import JsonFormatter, about


def record(level=logging.INFO, **extra):
    made = logging.LogRecord("orientd.x", level, "x.py", 1, "%s: ü\n%d", ("arm", 3), None)
    for name, content in extra.items():
        setattr(made, name, content)
    return made


def test_a_record_is_one_line_of_json_with_what_it_is_about():
    line = JsonFormatter(has_priority=False).format(
        record(**about(device="arm", motion=3, motion_id="ab"))
    )
    assert "\n" not in line
    told = json.loads(line)
    assert told["message"] == "arm: ü\n3"
    assert (told["level"], told["device"], told["motion_id"]) == ("info", "arm", "ab")


def test_the_journal_is_told_the_priority():
    formatter = JsonFormatter(has_priority=True)
    for level, priority in ((logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6)):
        assert formatter.format(record(level)).startswith(f"<{priority}>{{")
