#!/usr/bin/env python3
"""Boots the linked Pixhawk 6C program in a bare Cortex-M7 (Unicorn, `pip install unicorn`), as far as that goes without its peripherals.

usage: tools/boot-pixhawk.py [PROGRAM]

Registers are memory; the bits that the start-up waits for answer at once; UART7 delivers one Hello. Passes (exit code 0) if the program
sets PLL1 for 480 MHz and UART7 for 921,600 baud, and answers with its name in a frame whose CRC is right.
"""

import struct
import sys
import zlib

from unicorn import UC_ARCH_ARM, UC_HOOK_MEM_READ, UC_HOOK_MEM_WRITE, UC_MODE_MCLASS, UC_MODE_THUMB, Uc
from unicorn.arm_const import UC_ARM_REG_SP, UC_CPU_ARM_CORTEX_M7

PROGRAM = sys.argv[1] if len(sys.argv) > 1 else "target/firmware/thumbv7em-none-eabihf/release/pixhawk6c"
FLASH, RAM = 0x08020000, 0x24000000
RCC, PWR, UART7 = 0x58024400, 0x58024800, 0x40007800
MOST_INSTRUCTIONS = 20_000_000


def stuffed(frame):
    out, block = bytearray(), bytearray()
    for byte in frame + b"\0":
        if byte:
            block.append(byte)
        else:
            out += bytes([len(block) + 1]) + block
            block = bytearray()
    return bytes(out) + b"\0"


def unstuffed(data):
    out, at = bytearray(), 0
    while at < len(data):
        distance = data[at]
        out += data[at + 1 : at + distance]
        at += distance
        if at < len(data):
            out.append(0)
    return bytes(out)


elf = open(PROGRAM, "rb").read()
cpu = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
cpu.ctl_set_cpu_model(UC_CPU_ARM_CORTEX_M7)
cpu.mem_map(0x08000000, 0x200000)
cpu.mem_map(RAM, 0x80000)
for base in (0x40000000, 0x52000000, 0x58000000, 0xE0000000):
    cpu.mem_map(base, 0x100000)
table, count = struct.unpack_from("<I", elf, 0x1C)[0], struct.unpack_from("<H", elf, 0x2C)[0]
for k in range(count):
    kind, offset, _, address, size = struct.unpack_from("<5I", elf, table + 32 * k)
    if kind == 1 and size:
        cpu.mem_write(address, elf[offset : offset + size])

hello = bytes([1, 1, 1, 0])
to_board = bytearray(stuffed(hello + struct.pack("<I", zlib.crc32(hello))))
from_board, written = bytearray(), {}


def get(address):
    return struct.unpack("<I", bytes(cpu.mem_read(address, 4)))[0]


def put(address, value):
    cpu.mem_write(address, struct.pack("<I", value & 0xFFFFFFFF))


def on_read(_cpu, _access, address, _size, _value, _data):
    value = get(address)
    if address == RCC:  # oscillator and PLL are ready when they are on
        for on, ready in ((16, 17), (24, 25)):
            value = value | 1 << ready if value >> on & 1 else value & ~(1 << ready)
        put(address, value)
    elif address in (PWR + 0x04, PWR + 0x18):  # voltage is ready
        put(address, value | 1 << 13)
    elif address == RCC + 0x10:  # the clock that was asked for is in use
        put(address, value & ~0x38 | (value & 7) << 3)
    elif address == UART7 + 0x1C:
        put(address, 1 << 7 | (1 << 5 if to_board else 0))
    elif address == UART7 + 0x24:
        put(address, to_board.pop(0) if to_board else 0)


def on_write(_cpu, _access, address, _size, value, _data):
    if address == UART7 + 0x28:
        from_board.append(value & 0xFF)
        if value & 0xFF == 0:
            cpu.emu_stop()
    else:
        written[address] = value


for base in (0x40000000, 0x52000000, 0x58000000):
    cpu.hook_add(UC_HOOK_MEM_READ, on_read, begin=base, end=base + 0xFFFFF)
    cpu.hook_add(UC_HOOK_MEM_WRITE, on_write, begin=base, end=base + 0xFFFFF)
stack, start = struct.unpack("<II", bytes(cpu.mem_read(FLASH, 8)))
cpu.reg_write(UC_ARM_REG_SP, stack)
cpu.emu_start(start, 0, count=MOST_INSTRUCTIONS)

divider = written.get(RCC + 0x30, 0)
clock = 16_000_000 * ((divider & 0x1FF) + 1) // ((divider >> 9 & 0x7F) + 1)
frame = unstuffed(bytes(from_board[:-1]))
crc_fits = len(frame) > 8 and struct.unpack("<I", frame[-4:])[0] == zlib.crc32(frame[:-4])
print(f"processor {clock / 1e6:.0f} MHz, UART7 divider {written.get(UART7 + 0x0C)}, answer {frame[4:-4]!r}, CRC {'fits' if crc_fits else 'wrong'}")
good = clock == 480_000_000 and written.get(UART7 + 0x0C) == 130 and crc_fits and b"pixhawk6c" in frame
sys.exit(0 if good else 1)
