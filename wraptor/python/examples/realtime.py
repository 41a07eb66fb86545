"""Measures RealTime from Python: `realtime.py [HOST:PORT [BLOCKS_A_SECOND [SECONDS [MOTORS]]]]`. Wakes and homes the hand, closes and
opens its motors slowly."""

import sys

import wraptor

# Hall counts/s.
VELOCITY = 40

# Motors turn back after so many blocks.
TURN = 300


def main() -> None:
    address, rate, seconds, motors = [*sys.argv[1:], *["127.0.0.1:11001", "300", "10", "G"][len(sys.argv) - 1 :]]
    blocks = int(float(rate) * float(seconds))
    with wraptor.Hand.connect(address, limit=5) as hand:
        hand.init(limit=60)
        with hand.realtime(motors, limit=2) as realtime:

            def control(number: int, feedback: wraptor.Feedback) -> list[float] | None:
                velocity = VELOCITY if number // TURN % 2 == 0 else -VELOCITY
                return [velocity] * realtime.axes if number < blocks else None

            statistics = realtime.run(float(rate), control, limit=1)
    print(f"{motors}: {statistics.rate:.1f} blocks/s of {rate}, {statistics.missed} missed")
    for name, times in [("sent late by", statistics.jitter), ("round trip", statistics.round_trip)]:
        median, most, longest = (1000 * time for time in times)
        print(f"  {name}: median {median:.2f} ms, 99 % {most:.2f} ms, maximum {longest:.1f} ms")


if __name__ == "__main__":
    main()
