"""A job by grbl-streamer: its own thread counts characters, and polls the status."""
import sys
import threading

from grbl_streamer import GrblStreamer

port, job = sys.argv[1:]
booted, known, idle, failed, seen = threading.Event(), threading.Event(), threading.Event(), [], []


def heard(event, *data):
    if event == "on_boot":
        booted.set()
    elif event in ("on_error", "on_alarm"):
        failed.append((event, data))
        idle.set()
    elif event == "on_stateupdate":
        mode, position, _ = data
        seen.append((mode, position))
        known.set()
        if mode == "Idle" and any(mode == "Run" for mode, _ in seen):
            idle.set()


sender = GrblStreamer(heard)
sender.setup_logging()
sender.cnect(port, 115200)
assert booted.wait(20), "no banner"
sender.poll_start()
# It asks for more than the state at first, and the controller answers that only while it is idle.
assert known.wait(20), "no state"
sender.load_file(job)
sender.job_run()
assert idle.wait(60), seen
assert not failed, failed
assert seen[-1] == ("Idle", (0.356, 0.0, 1.0)), seen[-1]
sender.disconnect()
