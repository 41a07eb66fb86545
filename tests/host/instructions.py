"""Repeats random instructions on Unicorn's Cortex-M3 and compares everything after each of them.

    python3 instructions.py FILE LEAST

FILE is what `cargo run --release --package board-emu --example instructions` has written; its layout stands there. Exit code
1 with the first instructions that differ, or if fewer than LEAST were compared; 2 for a file that cannot be read.
"""

import struct
import sys

from unicorn import UC_ARCH_ARM, UC_MODE_MCLASS, UC_MODE_THUMB, Uc, UcError, arm_const

FLASH, FLASH_LEN = 0x08000000, 128 * 1024
RAM, RAM_LEN = 0x20000000, 20 * 1024
WINDOW, WINDOW_LEN = 0x20001000, 256

# 0 to 15, then xPSR.
REGISTERS = [
    *range(arm_const.UC_ARM_REG_R0, arm_const.UC_ARM_REG_R12 + 1),
    arm_const.UC_ARM_REG_SP,
    arm_const.UC_ARM_REG_LR,
    arm_const.UC_ARM_REG_PC,
    arm_const.UC_ARM_REG_XPSR,
]
NAMES = [f"r{i}" for i in range(13)] + ["sp", "lr", "pc", "xpsr"]
STATE = struct.Struct("<17I")

SHOWN = 20

IT_BITS = 0x0600FC00


def it_state(xpsr):
    """ITSTATE of xPSR (ARMv7-M A7.3.2), 0 outside IT blocks."""
    return xpsr >> 25 & 3 | xpsr >> 8 & 0xFC


def it_bits(state):
    return (state & 3) << 25 | (state & 0xFC) << 8


def advanced(state):
    """ITAdvance() of ARMv7-M A7.3.2."""
    return state & 0xE0 | state << 1 & 0x1F if state & 7 else 0


class Reader:
    def __init__(self, data):
        self.data, self.at = memoryview(data), 0

    def take(self, length):
        if self.at + length > len(self.data):
            print(f"error: the file ends at byte {len(self.data)}, expected {self.at + length}", file=sys.stderr)
            sys.exit(2)
        self.at += length
        return self.data[self.at - length : self.at]

    def state(self):
        return list(STATE.unpack(self.take(STATE.size)))


def core(flash):
    uc = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
    uc.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M3)
    uc.mem_map(FLASH, FLASH_LEN)
    uc.mem_map(RAM, RAM_LEN)
    uc.mem_write(FLASH, bytes(flash))
    return uc


def read(uc):
    return [uc.reg_read(register) for register in REGISTERS]


def shown(state):
    return " ".join(f"{name}={value:08x}" for name, value in zip(NAMES, state))


class Comparison:
    def __init__(self):
        self.done, self.failures = 0, []

    def case(self, uc, flash, reader):
        before = reader.state()
        window = bytes(reader.take(WINDOW_LEN))
        for register, value in zip(REGISTERS, before):
            uc.reg_write(register, value)
        uc.mem_write(WINDOW, window)
        ok = True
        for _ in range(reader.take(1)[0]):
            expected = reader.state()
            if reader.take(1)[0]:
                window = bytes(reader.take(WINDOW_LEN))
            if not ok:
                continue
            ok = self.step(uc, flash, before, expected, window)
            before = expected

    def step(self, uc, flash, before, expected, window):
        at = before[15] - FLASH
        code = struct.unpack("<HH", flash[at : at + 4])
        self.done += 1
        length = 4 if code[0] >> 11 >= 0b11101 else 2
        following = before[15] + length
        within = it_state(before[16])
        if within:
            # Unicorn stops only after the last instruction of an IT block: each is made the last.
            uc.reg_write(REGISTERS[16], before[16] & ~IT_BITS | it_bits(within & 0xF0 | 8))
        # A branch that came before may have led there, with another end.
        uc.ctl_remove_cache(before[15], following + 4)
        try:
            # It does not count an instruction whose condition fails: that one ends where the next begins.
            uc.emu_start(before[15] | 1, following, count=1)
            error = None
        except UcError as problem:
            error = f"Unicorn: {problem}"
        found = read(uc)
        if within:
            found[16] |= it_bits(advanced(within))
        if error and found == expected and found[15] != following:
            # It is the branch's target that cannot be fetched.
            error = None
        memory = bytes(uc.mem_read(WINDOW, WINDOW_LEN))
        if error is None and found == expected and memory == window:
            return True
        text = [f"{code[0]:04x} {code[1]:04x} at {before[15]:#010x}", f"  before   {shown(before)}"]
        text += [f"  board-emu {shown(expected)}", f"  Unicorn   {shown(found)}"]
        text += [f"  differ: {' '.join(n for n, a, b in zip(NAMES, expected, found) if a != b)}"]
        text += [f"  memory {WINDOW + i:#x}: {a:02x}, {b:02x}" for i, (a, b) in enumerate(zip(window, memory)) if a != b]
        text += [f"  {error}"] if error else []
        self.failures.append("\n".join(text))
        return False


def main():
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    try:
        with open(sys.argv[1], "rb") as file:
            reader = Reader(file.read())
    except OSError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    comparison = Comparison()
    while reader.at < len(reader.data):
        flash = reader.take(FLASH_LEN)
        uc = core(flash)
        for _ in range(struct.unpack("<I", reader.take(4))[0]):
            comparison.case(uc, flash, reader)
    for failure in comparison.failures[:SHOWN]:
        print(failure)
    print(f"{comparison.done} instructions compared, {len(comparison.failures)} differ")
    few = comparison.done < int(sys.argv[2])
    if few:
        print(f"that is fewer than {sys.argv[2]}")
    return 1 if few or comparison.failures else 0


if __name__ == "__main__":
    sys.exit(main())
