"""Commands for a running bus, one per line on its standard input: faults, motion by hand, state.

.. code-block:: text

    drop|corrupt|truncate ID [PROBABILITY [COUNT]]
    delay ID MILLISECONDS [PROBABILITY [COUNT]]
    clear [ID]                      end the faults of answers
    disconnect ID | connect ID      the servo's cable, with its supply
    restart ID [MILLISECONDS]       interrupt the supply; silent for 300 ms by default
    jam ID | free ID | load ID FRACTION
    stops ID LOW HIGH               hard stops of the shaft, in ticks
    lie ID TICKS [COUNT]            report positions with this error, in COUNT readings or all
    misread ID AT TICKS             the same, only at the position AT
    truth ID                        end both
    error ID BITS                   a hardware error
    heat ID CELSIUS | supply ID VOLT
    turn ID TICKS [SECONDS]         turn by hand; only without torque
    unplug | plug                   the adapter
    state ID                        show registers, in ticks: position, goal, torque
    help                            show these commands
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from emulated_dynamixel.line import FaultKind, ReplyFault
from emulated_dynamixel.servo import BOOT_NS, Lie

if TYPE_CHECKING:
    from emulated_dynamixel.pty import PtyServer


def carry_out(line: str, server: PtyServer, now_ns: int) -> str:
    """Execute *line*; return ``done: ...`` with the result, or ``refused: ...``."""
    try:
        told = _obey(line, server, now_ns)
    except (IndexError, KeyError):
        return f"refused: not a command of the emulated bus: {line.strip()!r}"
    except (ValueError, OSError) as error:
        return f"refused: {error}"
    return f"done: {line}{': ' if told else ''}{told}"


def _obey(line: str, server: PtyServer, now_ns: int) -> str:
    verb, *words = line.split() or ["nothing"]
    bus = server.bus
    match verb:
        case "nothing":
            return ""
        case "help":
            return " | ".join(each.strip() for each in (__doc__ or "").splitlines()[4:-1])
        case "plug":
            server.plug()
            return ""
        case "unplug":
            server.unplug()
            return ""
        case "clear":
            bus.faults.clear(int(words[0]) if words else None)
            return ""
    servo_id = int(words[0])
    if verb in set(FaultKind):
        bus.faults.add(servo_id, _fault(FaultKind(verb), words[1:]))
        return ""
    servo = bus.servo(servo_id)
    servo.advance(now_ns)
    match verb:
        case "disconnect":
            servo.disconnect(now_ns)
        case "connect":
            servo.connect(now_ns)
        case "restart":
            boot_ns = round(float(words[1]) * 1e6) if len(words) > 1 else BOOT_NS
            servo.reboot(now_ns, boot_ns=boot_ns)
        case "stops":
            servo.shaft.stops = (float(words[1]), float(words[2]))
        case "lie":
            servo.lie = Lie(int(words[1]), None, int(words[2]) if len(words) > 2 else None)
        case "misread":
            servo.lie = Lie(int(words[2]), int(words[1]))
        case "truth":
            servo.lie = None
        case "jam" | "free":
            servo.shaft.jammed = verb == "jam"
        case "load":
            servo.shaft.load = float(words[1])
        case "turn":
            if servo.is_torque_on:
                raise ValueError(f"servo {servo_id} holds: its torque is on")
            servo.shaft.turn(float(words[1]), float(words[2]) if len(words) > 2 else 0.0)
        case "heat":
            servo.temperature = int(words[1])
        case "supply":
            servo.supply = round(10.0 * float(words[1]))
        case "error":
            servo.fail(int(words[1], 0), now_ns)
        case "state":
            servo.refresh(now_ns)
            registers = ("present position", "goal position", "torque enable", "bus watchdog")
            shown = ("position", "goal", "torque", "watchdog")
            pairs = zip(shown, map(servo.value, registers), strict=True)
            return ", ".join(f"{word} {value}" for word, value in pairs)
        case _:
            raise KeyError(verb)
    return ""


def _fault(kind: FaultKind, words: list[str]) -> ReplyFault:
    fault = ReplyFault(kind)
    if kind is FaultKind.DELAY:
        fault.delay_ns = round(float(words.pop(0)) * 1e6)
    if words:
        fault.probability = float(words.pop(0))
    if words:
        fault.remaining = int(words.pop(0))
    return fault
