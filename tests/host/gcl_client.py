"""A host of the hand, over anything that pyserial opens: three ways to read an answer, and RealTime.

Each way is one real client's: where their habits differ, the hand has to please all of them (line ends, echo, prompt).
"""

import sys
import time

import serial

# Only ends a script that would otherwise hang; HI takes some seconds.
HANGS_S = 30.0
# Nothing more comes: what has been on the way for so long has come, or is lost.
QUIET_S = 0.3

END = b"\r\n\r"
PROMPT = b"=> "
BUSY = b"one host does at a time" + END
ABORT = b"\x03"


def check(holds, text):
    if not holds:
        sys.exit(f"failed: {text}")


class Wire:
    """A port, and all that has come from it since it was last asked."""

    def __init__(self, port):
        self.port = serial.serial_for_url(port, timeout=HANGS_S, write_timeout=HANGS_S)
        self.came = bytearray()

    def write(self, data):
        self.port.write(data)

    def read(self, count):
        data = self.port.read(count)
        self.came += data
        check(len(data) == count, f"{count} bytes come within {HANGS_S} s: {data} after {bytes(self.came)}")
        return data

    def until(self, end):
        text = b""
        while not text.endswith(end):
            text += self.read(1)
        return text

    def take(self):
        came, self.came = bytes(self.came), bytearray()
        return came

    def drain(self):
        """Throws away what comes until nothing comes."""
        self.port.timeout = QUIET_S
        while self.port.read(1):
            pass
        self.port.timeout = HANGS_S
        self.came.clear()


# --- three ways to read what comes after `line` and CR: the answer and the number of its error ------------------------


def counts_echo(wire, line):
    """As many characters as were sent; then, from the first that is not white, all until `=> `."""
    wire.read(len(line))
    text = wire.until(PROMPT).removesuffix(PROMPT).strip()
    return (b"", int(text[4:])) if text.startswith(b"ERR") else (text, 0)


def compares_echo(wire, line):
    """The echo has to be what was sent, the prompt LF CR `=> ` and nothing else, an error LF CR `ERR n`."""
    echo = wire.read(len(line))
    check(echo == line, f"the echo of {line} is {echo}")
    text, _, error = wire.until(b"\n\r" + PROMPT)[: -len(PROMPT)].partition(b"\n\rERR ")
    return text.strip(), int(error or 0)


def drops_one(wire, line):
    """After the first LF one character is dropped, and two before `=> `."""
    wire.until(b"\n")
    wire.read(1)
    text = wire.until(PROMPT)[: -2 - len(PROMPT)].strip()
    return (b"", int(text[4:])) if text.startswith(b"ERR") else (text, 0)


READERS = [counts_echo, compares_echo, drops_one]


class Host:
    """One that types lines, and reads what comes as `reader` does."""

    def __init__(self, port, reader=counts_echo):
        self.reader, self.lines = reader, 0
        # As clients do when they connect: they may come in the middle of anything.
        end, said = time.monotonic() + HANGS_S, BUSY
        while said.endswith(BUSY):
            check(time.monotonic() < end, f"the hand is free for {port}: {said}")
            self.wire = Wire(port)
            self.wire.write(ABORT)
            # If the last host has only just left, the hand has yet to hear of it.
            said = self.wire.until((PROMPT, BUSY))
        self.wire.drain()
        self.ask("")

    def ask(self, line, error=0, answer=None):
        """Types a line; its answer as text. Every byte that comes back is looked at."""
        self.wire.write(line.encode() + b"\r")
        return self.read(line.encode(), error, answer)

    def read(self, line, error=0, answer=None):
        self.lines += 1
        found, number = self.reader(self.wire, line)
        # All lines of the answer, the error and the prompt begin alike, and there is nothing else.
        rows = [found] if found else []
        rows += [b"ERR %d" % number] if number else []
        meant, came = b"".join([line, *(END + row for row in rows), END + PROMPT]), self.wire.take()
        who = self.reader.__name__
        check(came == meant, f"after {line} come {meant}, which {who} reads: {came}")
        check(number == error, f"{line} ends with ERR {error}: {came}, read by {who}")
        found = found.decode()
        check(answer in (None, found), f"{line} is answered {answer}: {came}, read by {who}")
        return found

    def numbers(self, line):
        return [int(word) for word in self.ask(line).split()]

    def loop(self, prefix):
        """Enters RealTime: the first byte after the echo is `*`."""
        line = prefix.encode() + b"LOOP"
        self.wire.write(line + b"\r")
        self.wire.read(len(line) + 1)
        came = self.wire.take()
        check(came == line + b"*", f"after {line} comes `*`: {came}")

    def block(self, control, feedback):
        """A control block, and the so many bytes of its feedback block."""
        self.wire.write(control)
        came = self.wire.read(feedback)
        self.wire.take()
        check(came[:1] == b"*", f"a feedback block begins with `*`: {came}")
        return came[1:]

    def leave(self, header, error=0):
        """Ends RealTime by a header; it is not echoed."""
        self.wire.write(header)
        self.read(b"", error)

    def close(self):
        self.wire.port.close()


def rates(host, control, feedback, seconds):
    """Block after block for so long; how long each took, s, sorted, and all of them together."""
    times, begin = [], time.perf_counter()
    last = begin
    while last - begin < seconds:
        host.block(control(len(times), last - begin), feedback)
        now = time.perf_counter()
        times.append(now - last)
        last = now
    return sorted(times), last - begin
