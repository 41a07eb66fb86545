"""Hosts drive a whole hand, one after another, and python-can watches its bus meanwhile.

    python3 hand_clients.py SLCAN PORT...

SLCAN is HOST:PORT, PORT anything that pyserial opens: `hil-sim hand --pty --listen 127.0.0.1:0 --slcan 127.0.0.1:0 --scenario
hil-sim/grasps/ball.toml` says which. Exit code 0 if all is as the manual and its clients have it, 1 with the first thing that is not.
"""

import sys
import threading
import time
from collections import Counter

import can
import gcl_client
from gcl_client import READERS, Host, check

MOTORS = range(1, 8)
# Property numbers (docs/properties.md); MODE 4 is velocity, RealTime's.
MODE, V, M = 8, 44, 58
VELOCITY = 4
# GCL counts a hall count; MPE's default.
HALL, MPE = 55, 200

# Line, error, answer: what costs no time. Each reader types all of it.
LINES = [
    ("", 0, ""),
    ("fRob", 32, ""),
    ("FGET", 64, ""),
    ("X1FGET P DP", 0, None),
    # Several pairs in a line, as a client sends them, and as another reads them; LCT, LFBP and LFAIN are of later hands.
    ("123FSET LCV 1 LCVC 1 LCPG 1 LFV 0 LFS 1 LFAP 1 LFDP 0 LFDPC 1", 0, ""),
    ("1FGET LCV LCPG LCT LFV LFS LFAP LFDP LFBP LFAIN", 0, "1 1 0 0 1 1 0 0 0"),
    ("123FSET LCT 0 LFBP 0 LFAIN 0", 0, ""),
    ("123FSET LCV 1 LCVC", 1024, ""),
    ("123FSET LCV", 128, ""),
    ("PSET LFT 1 LFDPD 0", 0, ""),
    ("PGET LFT LFDPD", 0, "1 0"),
    ("PSET LFT 0", 0, ""),
    # Four axes without a prefix, as many as it has with one.
    ("FSET DS 700", 0, ""),
    ("FGET DS", 0, "700 700 700 700"),
    ("12FGET DS DP", 0, "700 700 8500 8500"),
    ("X1234567FGET DS", 0, " ".join(["700"] * 7)),
    ("FDEF", 0, ""),
]


class Watcher:
    """Takes all frames of the bus, in a thread."""

    def __init__(self, address):
        self.bus = can.Bus(interface="slcan", channel=f"socket://{address}", bitrate=1_000_000, sleep_after_open=0.1)
        self.frames, self.over = [], False
        self.thread = threading.Thread(target=self.watch, daemon=True)
        self.thread.start()

    def watch(self):
        while True:
            frame = self.bus.recv(gcl_client.QUIET_S)
            if frame is not None:
                self.frames.append((frame.arbitration_id, bytes(frame.data)))
            elif self.over:
                return

    def finish(self):
        """All frames, once no more come."""
        self.over = True
        self.thread.join(gcl_client.HANGS_S)
        check(not self.thread.is_alive(), "the bus falls silent when nobody asks anything")
        self.bus.shutdown()
        return self.frames


def positions(host, prefix="", count=4):
    found = host.numbers(f"{prefix}FGET P")
    check(len(found) == count, f"{prefix}FGET P says {count} positions: {found}")
    return found


def is_at(host, goals, prefix=""):
    found = positions(host, prefix, len(goals))
    near = all(abs(goal - position) <= MPE for goal, position in zip(goals, found))
    check(near, f"{prefix}FGET P says {goals}, by {MPE}: {found}")


def real_time(host):
    """All headers, and both ends; by the parameters that LINES has set: velocity and gain in, strain and position out."""
    host.ask("123FSET LCV 1 LCVC 8 LCPG 1 LFV 0 LFS 1 LFAP 1 LFDP 0 LFDPC 1")
    begin, blocks = positions(host, "123", 3), 0
    host.loop("123")
    data, feedback, found = bytes([20, 32] * 3), 1 + 3 * 5, b""
    end = time.monotonic() + gcl_client.HANGS_S
    # 1000 GCL counts at 20 x 8 x 55 a second.
    while not found or int.from_bytes(found[1:5], "big", signed=True) < begin[0] + 1000:
        for control, size in [(b"C" + data, feedback), (b"c" + data, 1), (b"A", feedback), (b"a", 1)]:
            found, blocks = host.block(control, size) or found, blocks + 1
        check(time.monotonic() < end, f"the links move on from {begin}: {found}")
    host.leave(gcl_client.ABORT)
    moved = [now - before for before, now in zip(begin, positions(host, "123", 3))]
    check(all(gone >= 700 for gone in moved), f"each link has gone as far as the first, about: {moved}")
    host.loop("4")
    host.leave(b"x", error=2048)
    host.ask("FDEF")
    return blocks


def session(port):
    """A client's day. Returns what to say of it."""
    host = Host(port)
    for host.reader in READERS:
        for line, error, answer in LINES:
            host.ask(line, error, answer)
    host.ask("HI")
    is_at(host, [0] * 4)
    host.ask("C")
    check(host.numbers("GFGET BD") == [1] * 3, "each finger has broken away at the ball")
    host.reader = READERS[0]
    host.ask("O")
    check(host.numbers("GFGET BD") == [0] * 3, "O clears BD")
    is_at(host, [0] * 4)
    host.reader = READERS[1]
    host.ask("M 3000")
    is_at(host, [3000] * 4)
    host.ask("12m 2000")
    is_at(host, [2000, 2000, 3000, 3000])
    host.reader = READERS[2]
    host.ask("SM")
    is_at(host, [1575], "S")
    host.ask("M 20001", error=128)
    blocks = real_time(host)
    last = positions(host, "X1234567", 7)
    host.close()
    return f"{port.split(':')[0]}: {host.lines} lines, {blocks} RealTime blocks", last


def look(frames, last):
    """What has to have been on the bus, after hosts of whom the last read these positions last."""
    boards, sets, modes, called = Counter(), set(), Counter(), {}
    for identifier, data in frames:
        sender, to = identifier >> 5 & 31, identifier & 31
        if sender == 0:
            check(to in MOTORS or to == 4 and identifier & 0x400, f"GOD speaks to boards: {identifier:#x}")
            if data[0] & 0x80:
                sets.add((to, data[0] & 0x7F, int.from_bytes(data[2:], "little", signed=True)))
            continue
        check(sender in MOTORS and identifier & 0x400 and to in (3, 6), f"boards answer: {identifier:#x}")
        boards[sender] += 1
        if to == 3:
            bits = int.from_bytes(data, "big") & 0x3FFFFF
            called[sender] = bits - (1 << 22) if bits & 1 << 21 else bits
        elif data[0] == 0x80 | MODE:
            # Nobody asks for MODE in these sessions: the end of a motion.
            modes[sender] += 1
    check(sorted(boards) == list(MOTORS), f"all boards answer: {boards}")
    for motor in MOTORS:
        goals = {value for to, what, value in sets if (to, what) == (motor, M)}
        check(len(goals) >= 2, f"GOD sends motor {motor} to places: {goals}")
        check(modes[motor] >= 2, f"motor {motor} tells of ends of motions: {modes}")
    for link in (1, 2, 3, 5, 6, 7):
        check((link, MODE, VELOCITY) in sets, f"LOOP puts motor {link} into mode {VELOCITY}")
        check(any((to, what) == (link, V) and value > 0 for to, what, value in sets), f"a block gives motor {link} a velocity")
    found = [called.get(motor, 0) * HALL for motor in MOTORS]
    check(found == last, f"the boards' last positions are what the host read, {last}: {found}")
    ends = ", ".join(f"{motor}: {boards[motor]}" for motor in MOTORS)
    return f"python-can saw {len(frames)} frames, of the boards {ends}"


def main(slcan, ports):
    watcher = Watcher(slcan)
    for port in ports:
        text, last = session(port)
        print(text)
    print(look(watcher.finish(), last))


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2:])
