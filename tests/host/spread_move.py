"""Drives a spread as a host does, with python-can alone: enumerate, wake, verify, move, read positions.

    python3 spread_move.py HOST:PORT

HOST:PORT is an SLCAN adapter over TCP (`hil-sim bus --node 4 --slcan 127.0.0.1:0` prints one). Exit code 0 if all is
as the protocol says, 1 with the first thing that is not.
"""

import sys
import time

import can

SPREAD = 4
# Property numbers (docs/properties.md).
VERS, ROLE, ID, ERROR, STAT, MODE, P, E, TSTOP, END = 0, 1, 3, 4, 5, 8, 48, 52, 78, 115
IDLE, PID, TRAPEZOIDAL = 0, 3, 5
READY = 2
ARRIVED = 1

# A board answers within half a millisecond; the rest is for a busy machine between it and this script.
ANSWER_S = 1.0


def check(holds, text):
    if not holds:
        sys.exit(f"failed: {text}")


def parse(frame):
    """(node, property, value) of an answer to the host, or None."""
    if not frame.arbitration_id & 0x400:
        return None
    node, group, data = frame.arbitration_id >> 5 & 31, frame.arbitration_id & 31, frame.data
    if group == 3 and len(data) == 3:
        # 22 bits, the most significant first; bit 7 of the first byte is set, bit 6 clear.
        check(data[0] & 0xC0 == 0x80, f"the marks of a position: {data.hex()}")
        bits = int.from_bytes(data, "big") & 0x3FFFFF
        return node, P, bits - (1 << 22) if bits & 1 << 21 else bits
    if group == 6 and len(data) in (4, 6):
        check(data[0] & 0x7F != P, f"a position comes in group 3 with 22 bits: {frame}")
        return node, data[0] & 0x7F, int.from_bytes(data[2:], "little", signed=True)
    return None


class Host:
    def __init__(self, bus):
        self.bus = bus

    def send(self, node, data):
        self.bus.send(can.Message(arbitration_id=node, data=data, is_extended_id=False))

    def set(self, node, prop, value):
        self.send(node, bytes([0x80 | prop, 0]) + value.to_bytes(4, "little", signed=True))

    def answers(self, seconds):
        """All answers that come within a time."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            frame = self.bus.recv(left)
            if frame is not None and (answer := parse(frame)):
                yield answer

    def get(self, node, prop):
        self.send(node, [prop])
        for answer in self.answers(ANSWER_S):
            if answer[:2] == (node, prop):
                return answer[2]
        return None

    def wait(self, node, prop, value, seconds):
        """Polls until a property has a value."""
        end, found = time.monotonic() + seconds, None
        while time.monotonic() < end:
            found = self.get(node, prop)
            if found == value:
                return
        check(False, f"property {prop} of node {node} is {found}, not {value}, after {seconds} s")


def enumerate_nodes(host):
    found = {}
    for node in range(1, 32):
        host.send(node, [STAT])
        for answer in host.answers(0.001):
            found[answer[0]] = answer[2]
    for answer in host.answers(ANSWER_S):
        found[answer[0]] = answer[2]
    return found


def move(host, target):
    """Moves to a position and gives the positions on the way."""
    host.set(SPREAD, E, target)
    host.set(SPREAD, MODE, TRAPEZOIDAL)
    positions, end = [], time.monotonic() + 10
    while host.get(SPREAD, MODE) == TRAPEZOIDAL:
        positions.append(host.get(SPREAD, P))
        check(time.monotonic() < end, f"the move ends within 10 s: {positions}")
    check(None not in positions, f"every GET P is answered: {positions}")
    return positions


def stand_still(host):
    """Waits until the position has been the same for as long as a brake takes several times over."""
    end, position, since = time.monotonic() + 10, None, None
    while since is None or time.monotonic() < since + 0.3:
        check(time.monotonic() < end, f"the motor stands within 10 s: {position}")
        if (found := host.get(SPREAD, P)) != position:
            position, since = found, time.monotonic()


def main(address):
    channel = f"socket://{address}"
    with can.Bus(interface="slcan", channel=channel, bitrate=1_000_000, sleep_after_open=0.1) as bus:
        host = Host(bus)
        found = enumerate_nodes(host)
        check(list(found) == [SPREAD], f"enumeration finds the spread alone: {found}")

        host.set(SPREAD, STAT, READY)
        host.wait(SPREAD, STAT, READY, 5)
        fresh = {VERS: 600, ROLE: 0x0803, ID: SPREAD, ERROR: 0, MODE: IDLE, P: 0, TSTOP: 400}
        for prop, value in fresh.items():
            read = host.get(SPREAD, prop)
            check(read == value, f"property {prop} is {value}: {read}")

        positions = move(host, 160)
        check(host.get(SPREAD, MODE) == PID, "it holds its position after a move that MODE 5 orders")
        check(host.get(SPREAD, END) == ARRIVED, f"it has arrived: END {host.get(SPREAD, END)}")
        positions.append(host.get(SPREAD, P))
        check(positions == sorted(positions), f"positions rise: {positions}")
        # Seen on the way, not only at its ends; a move of 0.88 s gives hundreds on an idle machine.
        check(len({p for p in positions if 10 < p < 150}) >= 3, f"positions between: {positions}")
        # MPE is 200 in the host's counts, of which 55 make one of ours.
        check(abs(positions[-1] - 160) <= 4, f"ends within MPE of 160: {positions[-1]}")

        # The farthest goal of a spread (decision 0068): it presses on the stop.
        back = move(host, -8)
        check(back and min(back) >= -4, f"the stop is half a count below 0: {back}")
        host.set(SPREAD, MODE, IDLE)
        check(host.get(SPREAD, MODE) == IDLE, "idle")
        # Pressed into its stop, the joint springs back by a count when it is let go.
        stand_still(host)
        # In idle, P says what the present position is called: all 22 bits come back with their sign.
        for name in (-8, -1, 174):
            host.set(SPREAD, P, name)
            check(host.get(SPREAD, P) == name, f"the position is called {name}: {host.get(SPREAD, P)}")
        host.set(SPREAD, P, 32767)
        check(host.get(SPREAD, P) == 174, f"no place of a spread: {host.get(SPREAD, P)}")
        print(f"spread moved to {positions[-1]} and back, {len(positions)} positions read on the way there")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
