"""A job by pygrbl-streamer: it resets and unlocks the controller, counts characters, and waits until it stands."""
import sys
import threading

from pygrbl_streamer import GrblStreamer

port, job, place = sys.argv[1:]
failed, heard, over = [], [], threading.Event()
sender = GrblStreamer(port)
sender.alarm_callback = failed.append
sender.error_callback = failed.append
sender.receive_callback = heard.append
sender.connect()


def poll():
    while not over.wait(0.05):
        sender.realtime(b"?")


threading.Thread(target=poll, daemon=True).start()
completed = sender.send_file(job, completion_timeout=60)
over.set()
assert completed and not failed, failed
assert any(line.startswith("<Run|") for line in heard), heard
assert sender.last_status["raw"].startswith(f"<Idle|MPos:{place}|"), sender.last_status
sender.disconnect()
