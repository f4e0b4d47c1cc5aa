"""Ctrl-C while OSQP solves: it changes no plan, and it is not lost."""

import signal
import subprocess
import sys

import pytest

DRIVE = """
import os, signal, sys, threading, time
import gymnasium, numpy as np, wayfield
from wayfield.policies import Pilot, make

def drive(steps):
    env = gymnasium.make("wayfield/DiffDrivePathFollowing-v0", scenario="right_angle", actuators="lagged")
    seen, _ = env.reset(seed=0)
    pilot = Pilot(make("mpc"), env)
    pilot.reset()
    actions = []
    for _ in range(steps):
        actions.append(pilot.command(seen).copy())
        seen = env.step(pilot.act(seen))[0]
    return np.array(actions)

def interrupt():
    while True:
        time.sleep(0.0005)
        os.kill(os.getpid(), signal.SIGINT)

alone = drive(40)
signal.signal(signal.SIGINT, signal.SIG_IGN if sys.argv[1] == "ignored" else signal.default_int_handler)
try:
    threading.Thread(target=interrupt, daemon=True).start()
    same = np.array_equal(drive(40 if sys.argv[1] == "ignored" else 100000), alone)
except KeyboardInterrupt:
    os._exit(130)
os._exit(0 if same else 1)
"""


# a second interrupt may come before the first is answered: then the process ends of that
@pytest.mark.parametrize(("handler", "statuses"), [("ignored", {0}), ("default", {130, -signal.SIGINT})])
def test_an_interrupt_in_a_solution_is_the_process_s(handler: str, statuses: set[int]) -> None:
    done = subprocess.run([sys.executable, "-c", DRIVE, handler], capture_output=True, text=True, check=False)
    assert done.returncode in statuses, done.stdout[-500:] + done.stderr[-2000:]
