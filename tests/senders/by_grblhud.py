"""A job by grblhud, the whole program as its users start it; it wants a terminal."""
import os
import pty
import re
import sys

port, job = sys.argv[1:]
screen = b""


def shown(terminal):
    global screen
    data = os.read(terminal, 4096)
    screen += data
    return data


status = pty.spawn([sys.executable, "-m", "grblhud", "--serial", port, job], shown)
assert status == 0, status
states = re.findall(rb"\[(\w+) +XYZ:([-\d.,]+) ", screen.split(b"Stream send")[1])
assert b"Run" in [state for state, _ in states], states
# Its places are the workpiece's.
assert states[-1] == (b"Idle", b"14.712,00.000,01.000"), states[-1]
