"""Random policies through a real client and daemon, judged by the setpoints of the driver.

Run 50 with `make storm`; ORIENTD_STORM_POLICIES says how many, ORIENTD_STORM_SEED which.
"""

import os
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from policies import asked_turn, policy
from storm_rig import PERIOD, Rig, rotation_vectors, sent, shares_of_limits

import orientd
from orientd.protocol import to_quaternion, to_vector
from orientd.tolerances import GUARD_TOLERANCE

POLICIES = int(os.environ.get("ORIENTD_STORM_POLICIES", "50"))
SEED = int(os.environ.get("ORIENTD_STORM_SEED", "1"))

PATIENCE = 5.0
"""A busy machine causes no fault, s."""


class Player:
    """Plays random policies on a device, one after the other."""

    def __init__(self, rig, robot, device):
        self.rig, self.robot, self.device = rig, robot, device.name
        self.limits = device.limits

    def play_all(self, seeds):
        """Play a policy of each seed; return their lines and problems."""
        return [self.play(seed) for seed in seeds]

    def play(self, seed):
        """Play a policy; return a line of figures, and what is wrong."""
        report = self.robot.state().devices[self.device]
        start, place = to_quaternion(report.cycle.q), to_vector(report.cycle.position)
        wanted = policy(seed, start, place)
        skip = max(len(sent(self.rig.recordings[self.device])) - 3, 0)
        with self.robot.play(device=self.device, limits=wanted.limits) as play:
            begin = time.monotonic()
            for chunk in wanted.chunks:
                time.sleep(max(begin + chunk.arrives - time.monotonic(), 0.0))
                chunk.arrives = time.monotonic() - begin
                play.chunk(
                    [orientd.Quaternion(w=w, x=x, y=y, z=z) for w, x, y, z in chunk.poses],
                    times=begin + np.array(chunk.times),
                    positions=chunk.positions,
                )
            is_played = play.wait(30.0)
            timing = play.timing()
        figures, problems = self.judge(wanted, begin, skip, asked_turn(wanted.chunks, start))
        if not is_played:
            problems.append("not at rest within 30 s")
        line = f"{wanted}; seam {timing.largest_seam:.2f} rad, starved {timing.starved}, {figures}"
        return line, problems

    def judge(self, wanted, begin, skip, asked):
        """Return what the setpoints show, and what is wrong with them."""
        limits = SimpleNamespace(**{**vars_of(self.limits), **wanted.limits})
        setpoints = sent(self.rig.recordings[self.device])[skip:]
        shares, judge = shares_of_limits(setpoints, limits)
        # The linear acceleration changes in a cycle by at most half of its limit.
        change = judge.peaks["linear_jerk"] * PERIOD
        shares["linear_jerk"] = change / (0.5 * limits.linear_acceleration)
        problems = [
            f"{name}: {share:.4f} of the limit"
            for name, share in shares.items()
            if share > GUARD_TOLERANCE
        ]
        turned = float(np.linalg.norm(rotation_vectors(setpoints["q"]), axis=1).sum())
        # Each overshoot costs a little; an extra turn costs 2 pi.
        if turned > 1.2 * asked + np.pi:
            problems.append(f"turned {turned:.2f} rad, asked {asked:.2f} rad")
        last = wanted.chunks[-1]
        goal = np.array([last.poses[-1]])
        left = np.linalg.norm(
            [rotation_vectors(np.vstack([goal, [q]]))[0] for q in setpoints["q"]], axis=1
        )
        if left[-1] > 1e-4:
            problems.append(f"ended {left[-1]:.2g} rad from the last pose")
        if last.positions and np.abs(setpoints["position"][-1] - last.positions[-1]).max() > 1e-4:
            problems.append("ended beside the last position")
        tail = int(np.searchsorted(setpoints["time_ns"], 1e9 * (begin + last.times[-1])))
        tail = min(tail, len(left) - 1)
        arrived = np.flatnonzero(left > 1e-3)
        took = (max(int(arrived[-1]) + 1 - tail, 0) if len(arrived) else 0) * PERIOD
        allowed = slowest_end(setpoints["q"][tail - 1 : tail + 1], float(left[tail]), limits)
        if took > allowed:
            problems.append(f"at rest after {took:.2f} s, allowed {allowed:.2f} s")
        return (
            f"turned {turned:.2f} of {asked:.2f} rad, limits used "
            f"{' '.join(f'{share:.3f}' for share in shares.values())}, "
            f"rest after {took:.2f} of {allowed:.2f} s, {judge.rests} stalls",
            problems,
        )


def vars_of(limits):
    """Return the limits of a device by name."""
    names = ("velocity", "acceleration", "jerk", "linear_velocity", "linear_acceleration")
    return {name: getattr(limits, name) for name in names}


def slowest_end(steps, left, limits):
    """Return how long it may take at most to stop, turn back by *left* rad, and stop again, s."""
    speed = float(np.linalg.norm(rotation_vectors(steps), axis=1).max(initial=0.0)) / PERIOD
    pause = limits.acceleration / limits.jerk
    stop = speed / limits.acceleration + pause
    left += speed * stop
    turn = 2.0 * np.sqrt(left / limits.acceleration) + left / limits.velocity
    return stop + turn + 4.0 * pause + 0.3


@pytest.mark.parametrize(
    "policies",
    [pytest.param(4), pytest.param(POLICIES, marks=[pytest.mark.storm, pytest.mark.timeout(0)])],
    ids=["some", "all"],
)
def test_whatever_a_policy_sends_the_setpoints_keep_the_limits_and_end_at_its_last_pose(
    tmp_path, policies
):
    seeds = range(SEED, SEED + policies)
    with (
        Rig(tmp_path, patience=PATIENCE) as rig,
        orientd.connect(rig.socket, holder="policies") as robot,
    ):
        players = [Player(rig, robot, device) for device in robot.devices()]
        shares = [seeds[k :: len(players)] for k in range(len(players))]
        with ThreadPoolExecutor(len(players)) as pool:
            rounds = [one for some in pool.map(Player.play_all, players, shares) for one in some]
        faults = [
            report.fault_text for report in robot.state().devices.values() if report.fault_text
        ]
    print(*(line for line, _ in rounds), sep="\n")
    assert not faults
    broken = [f"{line}: {', '.join(problems)}" for line, problems in rounds if problems]
    assert not broken, "\n".join(broken)
