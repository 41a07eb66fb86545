"""How fast RealTime goes in real time: all seven motors with all feedback, block after block.

    python3 hand_rate.py PORT LEAST [BAUD]

PORT is anything that pyserial opens: `hil-sim hand --listen 127.0.0.1:0` or, with BAUD, `hil-sim hand --pty --pace-baud` says
which. Exit code 1 if it is slower than LEAST blocks/s.
"""

import sys

from gcl_client import ABORT, Host, check, rates

SECONDS = 6
MOTORS = 7
# Velocity and gain in; velocity, strain, four bytes of position and its change out: the defaults of the parameters.
FEEDBACK = 1 + 7 * MOTORS
# A byte of a serial line: start, eight bits, stop.
BITS = 10


def control(number, seconds):
    """All motors to and fro, half a second each; the gain too changes with each block, which costs the bus most."""
    velocity = 20 if int(2 * seconds) % 2 == 0 else -20
    return b"C" + bytes([velocity & 0xFF, 16 + number % 2]) * MOTORS


def main(port, least, baud):
    host = Host(port)
    if baud:
        host.ask(f"PSET BAUD {baud // 100}")
        host.wire.port.baudrate = baud
        host.ask("")
    host.ask("HI")
    host.ask("M 1500")
    host.loop("X" + "".join(str(motor) for motor in range(1, MOTORS + 1)))
    times, took = rates(host, control, FEEDBACK, SECONDS)
    host.leave(ABORT)
    host.close()
    rate = len(times) / took
    p50, p99, worst = (1000 * times[min(len(times) - 1, int(share * len(times)))] for share in (0.5, 0.99, 1.0))
    over, share = "TCP", ""
    if baud:
        over, share = f"a pseudo-terminal at {baud} baud", f", {100 * rate * BITS * (1 + FEEDBACK) / baud:.1f} % of what the wire allows"
    print(
        f"figure: RealTime in real time over {over}, seven motors, all data, gain changing: {rate:.0f} blocks/s{share};"
        f" a block takes {p50:.1f} ms (median), {p99:.1f} (99 %), {worst:.1f} (worst)"
    )
    check(rate >= least, f"{least} blocks/s at least: {rate:.1f}")
    # A per cent for the ends of the measurement.
    check(not baud or rate * BITS * (1 + FEEDBACK) <= 1.01 * baud, f"no more than {baud} baud allow: {rate:.1f} blocks/s")


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    main(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) == 4 else None)
