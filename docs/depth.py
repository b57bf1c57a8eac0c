#!/usr/bin/env python3
"""Takes the place of the lathe's depth board. It needs pyserial.

    torno up lathe --open depth=./depth
    python3 depth.py ./depth

The master sends a sub-frame of three bytes: the distance in slots of 0.178 mm (two bytes, high first) and the direction
(0 outwards, 1 inwards). A slave says ACK and the parity of the sub-frames that it has taken when it is done, or CAN and
a letter when it has failed. It is asked with ENQ, once a second while it is busy, and has 20 ms for its answer.
"""
import sys
import time

import serial

ENQ, ACK, BEL, CAN = 0x05, 0x06, 0x07, 0x18
SLOTS_PER_SECOND = 1.5
GAP = 0.05  # A longer silence ends a sub-frame that is not complete.

port = serial.serial_for_url(sys.argv[1], 9600)
position = 0
taken = 0  # sub-frames
fault = b"r"  # It has just started, and says so when it is asked; before that, it takes nothing.
asked = False
done_at = None  # while it is busy
part = b""


def answer():
    if done_at is not None:
        port.write([BEL])
    elif fault:
        port.write([CAN] + list(fault))
    else:
        port.write([ACK, ord("eo"[taken % 2])])


while True:
    port.timeout = max(0, done_at - time.monotonic()) if done_at is not None else GAP if part else None
    byte = port.read(1)
    if not byte and done_at is not None:
        done_at = None
        answer()
    elif not byte:
        part, fault = b"", b"g"
    elif byte[0] == ENQ and not part:  # No sub-frame begins with it: the way has 900 slots.
        answer()
        asked = True
    elif done_at is None:
        part += byte
        if len(part) == 3 and asked:
            distance, direction = int.from_bytes(part[:2], "big"), part[2]
            fault = b"g" if direction > 1 else b""
            if not fault:
                taken += 1
                position += -distance if direction else distance
                done_at = time.monotonic() + distance / SLOTS_PER_SECOND
                print(f"{distance} slots {'in' if direction else 'out'}, to {position}", flush=True)
        part = part[:len(part) % 3]
