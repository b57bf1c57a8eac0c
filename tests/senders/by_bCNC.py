"""A job by bCNC's sender, which opens its port by serial_for_url, counts characters and polls the status. Its windows
are left out.
"""
# Needs: numpy svgelements tkinter _tkinter
import builtins
import importlib.util
import os
import sys
import time

port, job = sys.argv[1:]
folder = importlib.util.find_spec("bCNC").submodule_search_locations[0]
sys.path[:0] = [folder, *(os.path.join(folder, name) for name in ("lib", "controllers"))]
builtins._ = str  # Its messages are not translated.
import Utils

Utils.loadConfiguration(systemOnly=True)
import Sender
from CNC import CNC

Sender.Sender.disable = lambda self: None  # The buttons, while a job runs.
sender = Sender.Sender()
sender.controllerLoad()
sender.controllerSet("GRBL1")
sender.open(port, 115200)
deadline = time.monotonic() + 60
states = set()


def wait_for(what, held):
    while not held():
        assert time.monotonic() < deadline, (what, CNC.vars["state"], states)
        states.add(CNC.vars["state"])
        time.sleep(0.02)


wait_for("a state", lambda: CNC.vars["state"] == "Idle")
sender.initRun()
for line in open(job):
    sender.queue.put(line)
wait_for("the end of the job", lambda: {"Run"} & states and CNC.vars["state"] == "Idle" and sender.queue.empty())
assert not {"Alarm", "Error"} & states, states
place = tuple(CNC.vars[axis] for axis in ("mx", "my", "mz"))
assert place == (0.356, 0.0, 1.0), place
sender.close()
os._exit(0)  # Its thread has no end of its own.
