"""A job by plotdeck, without its window: its controller counts characters, and polls the status."""
import sys
import threading
import time

from plotdeck.core.controller import MachineController

port, job = sys.argv[1:]
failed, seen, ended = [], [], threading.Event()
finished = []
sender = MachineController()
sender.on_port_error = failed.append
sender.on_alarm = sender.on_command_error = lambda *why: failed.append(why)
sender.on_stream_error = lambda *why: failed.append(why)
sender.on_status = lambda status: seen.append((status.state, status.mpos))
sender.on_job_finished = lambda how: (finished.append(how), ended.set())
sender.connect(port)
deadline = time.monotonic() + 60


def wait_for(what, held):
    while not held():
        assert time.monotonic() < deadline and not failed, (what, failed, seen[-5:])
        time.sleep(0.02)


# It sends empty lines first, and begins to poll when they have gone.
wait_for("a state", lambda: sender.connected and seen)
assert sender.run_text(open(job).read())
wait_for("the end of the job", ended.is_set)
assert finished == ["completed"], finished
wait_for("the end of the motion", lambda: seen and seen[-1][0] == "Idle")
assert any(state == "Run" for state, _ in seen), seen
assert seen[-1][1] == (0.356, 0.0, 1.0), seen[-1]
sender.disconnect()
