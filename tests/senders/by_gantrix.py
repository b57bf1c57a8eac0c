"""A job by gantrix: its transport unlocks the controller, and waits for the answer to each line."""
import sys

from gantrix.transport import GrblTransport

port, job = sys.argv[1:]


def status(sender):
    sender._ser.write(b"?")
    line = ""
    while not line.startswith("<"):
        line = sender._ser.readline().decode().strip()
        assert line, "no status"
    return line


with GrblTransport(port, boot_delay=1) as sender:
    seen = set()
    for line in open(job):
        sender.send(line)
        seen.add(status(sender).split("|")[0])
    # It waits for the machine.
    sender.send("G4 P0")
    assert "<Run" in seen, seen
    assert status(sender).startswith("<Idle|MPos:0.356,0.000,1.000|"), status(sender)
