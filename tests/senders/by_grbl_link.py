"""A job by grbl-link: one line after the other, each when the one before is answered."""
import sys
import time

import serial
from grbl_link.grbl_link import Grbl

port, job, place = sys.argv[1:]
sender = Grbl(serial.serial_for_url(port, 115200, timeout=1))
deadline = time.monotonic() + 60


def wait_for(what, held):
    while not held():
        assert time.monotonic() < deadline, (what, sender.status, sender.alarm_state)
        time.sleep(0.02)


wait_for("a banner", lambda: sender.version)
for line in open(job):
    sender.send(line.strip())
modes = set()


def idle():
    sender.send(b"?")
    time.sleep(0.05)
    modes.add(sender.status["mode"])
    return sender.status["mode"] == "Idle" and "Run" in modes


wait_for("the end of the job", idle)
assert sender.alarm_state is None, sender.alarm_state
assert sender.status["MPos"] == [float(axis) for axis in place.split(",")], sender.status
