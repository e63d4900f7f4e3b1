#!/usr/bin/env python3
"""Boots the linked Pixhawk 6C program in a bare Cortex-M7 (Unicorn, `pip install unicorn`), with as much of its peripherals as it waits for.

usage: tools/boot-pixhawk.py [PROGRAM]

Registers are memory; bits that the start-up waits for answer at once; DMA1 moves the bytes of UART7 and UART5; a USB host enumerates OTG2.
Each link gets one Hello. Exit code 0 if the program sets 480 MHz, 48 MHz and 921,600 baud, keeps DMA out of memory that it cannot reach,
answers on each of the three links with its name in a frame whose CRC is right, after a fault reports its registers, and restarts into its
boot loader when it is asked to.
"""

import struct
import sys
import zlib

from unicorn import UC_ARCH_ARM, UC_HOOK_MEM_READ, UC_HOOK_MEM_WRITE, UC_MODE_MCLASS, UC_MODE_THUMB, Uc, UcError
from unicorn.arm_const import UC_ARM_REG_PC, UC_ARM_REG_SP, UC_CPU_ARM_CORTEX_M7

PROGRAM = sys.argv[1] if len(sys.argv) > 1 else "target/firmware/thumbv7em-none-eabihf/release/pixhawk6c"
ELF = open(PROGRAM, "rb").read()
VERSION = 2
FLASH, DTCM, AXI = 0x08020000, 0x20000000, 0x24000000
RCC, PWR, DMA1, OTG = 0x58024400, 0x58024800, 0x40020000, 0x40080000
UARTS = {"TELEM1": (0x40007800, 0, 1, 79, 80), "TELEM2": (0x40005000, 2, 3, 65, 66)}
SENDERS = [DMA1 + 0x10 + 0x18 * send for _, _, send, _, _ in UARTS.values()]
MOST_INSTRUCTIONS = 30_000_000
HELLO, STATUS, BOOT_LOADER = 0x01, 0x06, 0x08
AIRCR, RTC_BACKUP_0 = 0xE000ED0C, 0x58004050


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


def request(kind, sequence):
    frame = bytes([VERSION, kind]) + struct.pack("<H", sequence)
    return stuffed(frame + struct.pack("<I", zlib.crc32(frame)))


def payload(stream):
    """Of the first frame, if its CRC is right."""
    frame = unstuffed(stream.split(b"\0")[0])
    if len(frame) < 8 or struct.unpack("<I", frame[-4:])[0] != zlib.crc32(frame[:-4]):
        return None
    return frame[4:-4]


class Board:
    def __init__(self, link, kind=HELLO, fault=None):
        self.link, self.from_board, self.written = link, bytearray(), {}
        # Garbage first: half a frame of somebody else.
        self.to_board = bytearray(b"\x07\x55\x00" + request(HELLO, 1) + (request(kind, 2) if kind != HELLO else b""))
        self.wanted = {HELLO: 1, STATUS: 2, BOOT_LOADER: 99}[kind]
        self.reset = False
        self.cpu = cpu = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        cpu.ctl_set_cpu_model(UC_CPU_ARM_CORTEX_M7)
        cpu.mem_map(0x08000000, 0x200000)
        cpu.mem_map(DTCM, 0x20000)
        cpu.mem_map(AXI, 0x80000)
        # Registers: the system's own, two peripheral domains, and the USB core.
        for base in (0x40000000, 0x52000000, 0x58000000, 0xE0000000):
            cpu.mem_map(base, 0x100000)
        table, count = struct.unpack_from("<I", ELF, 0x1C)[0], struct.unpack_from("<H", ELF, 0x2C)[0]
        for k in range(count):
            kind_, offset, _, address, size = struct.unpack_from("<5I", ELF, table + 32 * k)
            if kind_ == 1 and size:
                cpu.mem_write(address, ELF[offset : offset + size])
        if fault:
            cpu.mem_write(symbol("FAULT"), struct.pack("<6I", 0xFA17FA17, *fault))
        self.usb = UsbHost(self) if link == "USB" else None
        for base in (0x40000000, 0x52000000, 0x58000000):
            cpu.hook_add(UC_HOOK_MEM_READ, self.on_read, begin=base, end=base + 0xFFFFF)
            cpu.hook_add(UC_HOOK_MEM_WRITE, self.on_write, begin=base, end=base + 0xFFFFF)
        cpu.hook_add(UC_HOOK_MEM_READ, self.on_cycles, begin=0xE0001004, end=0xE0001007)
        cpu.hook_add(UC_HOOK_MEM_WRITE, self.on_reset, begin=AIRCR, end=AIRCR + 3)
        self.put(OTG + 0x3C, 0x2300)

    def get(self, address):
        return struct.unpack("<I", bytes(self.cpu.mem_read(address, 4)))[0]

    def put(self, address, value):
        self.cpu.mem_write(address, struct.pack("<I", value & 0xFFFFFFFF))

    def on_cycles(self, _cpu, _access, address, _size, _value, _data):
        self.put(address, self.get(address) + 1000)

    def on_reset(self, _cpu, _access, _address, _size, value, _data):
        self.reset = value & 0xFFFF0004 == 0x05FA0004
        self.cpu.emu_stop()

    def on_read(self, _cpu, _access, address, _size, _value, _data):
        value = self.get(address)
        if address == RCC:  # oscillator and PLLs are ready when they are on
            for on, ready in ((16, 17), (24, 25), (28, 29)):
                value = value | 1 << ready if value >> on & 1 else value & ~(1 << ready)
            self.put(address, value)
        elif address in (PWR + 0x04, PWR + 0x18):  # voltage is ready
            self.put(address, value | 1 << 13)
        elif address == PWR + 0x0C:  # so is the supply of USB
            self.put(address, value | 1 << 26)
        elif address == RCC + 0x10:  # the clock that was asked for is in use
            self.put(address, value & ~0x38 | (value & 7) << 3)
        elif address in SENDERS:  # what was to be sent is out at once
            self.put(address, value & ~1)
        elif self.link in UARTS and address == DMA1 + 0x14 + 0x18 * UARTS[self.link][1]:
            stream = DMA1 + 0x10 + 0x18 * UARTS[self.link][1]
            if self.to_board and self.get(stream) & 1:
                size = self.written[address]
                at = (size - value) % size
                self.cpu.mem_write(self.get(stream + 0x0C) + at, bytes([self.to_board.pop(0)]))
                self.put(address, value - 1 or size)
        elif OTG <= address < OTG + 0x40000 and self.usb:
            self.usb.on_read(address - OTG, value)
        elif address == OTG + 0x10:
            self.put(address, (value | 1 << 31) & ~0x31)

    def on_write(self, _cpu, _access, address, _size, value, _data):
        self.written[address] = value & 0xFFFFFFFF
        for base, _, send, _, _ in UARTS.values():
            stream = DMA1 + 0x10 + 0x18 * send
            if address == stream and value & 1:
                if self.link in UARTS and UARTS[self.link][0] == base:
                    start, length = self.get(stream + 0x0C), self.written[stream + 4]
                    assert AXI <= start < AXI + 0x80000, hex(start)
                    self.take(bytes(self.cpu.mem_read(start, length)))
        if OTG <= address < OTG + 0x40000 and self.usb:
            self.usb.on_write(address - OTG, value & 0xFFFFFFFF)

    def take(self, data):
        self.from_board += data
        if self.from_board.count(0) >= self.wanted:
            self.cpu.emu_stop()

    def run(self):
        stack, start = struct.unpack("<II", bytes(self.cpu.mem_read(FLASH, 8)))
        assert DTCM < stack <= DTCM + 0x20000, hex(stack)
        self.cpu.reg_write(UC_ARM_REG_SP, stack)
        try:
            self.cpu.emu_start(start, 0, count=MOST_INSTRUCTIONS)
        except UcError as error:
            print(f"{self.link}: the processor stopped at {self.cpu.reg_read(UC_ARM_REG_PC):#x}: {error}")
        return bytes(self.from_board)


class UsbHost:
    """A host that enumerates the device and writes to its serial port; knows the registers of the core from RM0433, 57.14."""

    def __init__(self, board):
        self.board, self.events, self.fifo, self.pending = board, ["reset", "speed"], [], {}
        setup = lambda *words: ("setup", struct.pack("<BBHHH", *words))
        self.script = [
            setup(0x80, 6, 0x0100, 0, 18),
            setup(0x00, 5, 5, 0, 0),
            setup(0x80, 6, 0x0200, 0, 255),
            setup(0x00, 9, 1, 0, 0),
            setup(0x21, 0x22, 3, 0, 0),
            ("data", bytes(board.to_board)),
        ]
        self.answers, self.current, self.received, self.out_endpoint = [], None, bytearray(), 1

    def step(self):
        """The next thing that the device is to see in GINTSTS."""
        if self.events or self.pending:
            return
        if self.current is None and self.script:
            self.current, data = self.script.pop(0)
            self.received = bytearray()
            if self.current == "setup":
                self.wants, self.length = data[0] & 0x80, struct.unpack_from("<H", data, 6)[0]
                self.events = [("packet", 6, 0, data), ("packet", 4, 0, b"")]
            else:
                self.events = [("packet", 2, self.out_endpoint, data), ("packet", 3, self.out_endpoint, b"")]

    def on_read(self, offset, value):
        put = lambda new: self.board.put(OTG + offset, new)
        if offset == 0x10:  # GRSTCTL: idle, nothing in reset or flushed
            put((value | 1 << 31) & ~0x31)
        elif offset == 0x14:  # GINTSTS
            self.step()
            event = self.events[0] if self.events else None
            bits = {"reset": 1 << 12, "speed": 1 << 13}.get(event, 1 << 4 if event else 0)
            put(bits | (1 << 18 if self.pending else 0))
        elif offset in (0x1C, 0x20) and self.events and self.events[0][0] == "packet":
            _, status, endpoint, data = self.events[0]
            put(endpoint | len(data) << 4 | status << 17)
            if offset == 0x20:
                self.events.pop(0)
                padded = data + bytes(-len(data) % 4)
                self.fifo += struct.unpack(f"<{len(padded) // 4}I", padded)
        elif offset == 0x808:  # DSTS: full speed
            put(0b11 << 1)
        elif 0x1000 <= offset < 0x2000:
            put(self.fifo.pop(0) if self.fifo else 0)
        elif 0x900 <= offset < 0xA00 and offset & 0x1F == 0x18:  # room in the FIFO
            put(256)
        elif 0x900 <= offset < 0xA00 and offset & 0x1F == 0x08:
            endpoint = (offset - 0x900) >> 5
            put(1 if endpoint in self.pending else 0)
        elif 0x900 <= offset < 0xA00 and offset & 0x1F == 0x00:  # what was enabled has been sent
            put(value & ~(1 << 31))

    def on_write(self, offset, value):
        if offset == 0x14 and self.events and self.events[0] in ("reset", "speed"):
            if value & (1 << 12 if self.events[0] == "reset" else 1 << 13):
                self.events.pop(0)
        elif 0x900 <= offset < 0xA00 and offset & 0x1F == 0x08 and value & 1:
            self.pending.pop((offset - 0x900) >> 5, None)
        elif 0x900 <= offset < 0xA00 and offset & 0x1F == 0x00 and value >> 31:
            endpoint = (offset - 0x900) >> 5
            length = self.board.get(OTG + 0x910 + 0x20 * endpoint) & 0x7FFFF
            if length == 0:
                self.sent(endpoint, b"")
            else:
                self.expected = (endpoint, length, bytearray())
        elif offset >= 0x1000:
            endpoint, length, data = self.expected
            data += struct.pack("<I", value)
            if len(data) >= length:
                self.sent(endpoint, bytes(data[:length]))

    def sent(self, endpoint, data):
        """The device has put a packet into a FIFO; the host fetches it."""
        self.pending[endpoint] = True
        if endpoint:
            self.board.take(data)
            return
        self.received += data
        if self.current == "setup" and (len(data) < 64 or len(self.received) >= self.length):
            self.answers.append(bytes(self.received))
            if self.wants:
                # The status stage.
                self.events = [("packet", 2, 0, b""), ("packet", 3, 0, b"")]
            self.current = None


def symbol(part):
    """Address of the only object whose name holds `part`."""
    sections, entry, count = struct.unpack_from("<I", ELF, 0x20)[0], 40, struct.unpack_from("<H", ELF, 0x30)[0]
    headers = [struct.unpack_from("<10I", ELF, sections + entry * k) for k in range(count)]
    table = next(header for header in headers if header[1] == 2)
    names = headers[table[6]][4]
    found = []
    for at in range(table[4], table[4] + table[5], 16):
        name, address, _, info = struct.unpack_from("<IIIB", ELF, at)
        text = ELF[names + name : ELF.index(b"\0", names + name)].decode()
        if info & 0xF == 1 and part in text:
            found.append(address)
    assert len(found) == 1, (part, found)
    return found[0]


failures = []


def check(what, good):
    print(f"{'ok  ' if good else 'FAIL'} {what}")
    if not good:
        failures.append(what)


for link in ("TELEM1", "TELEM2", "USB"):
    board = Board(link)
    answer = payload(board.run())
    check(f"{link}: answers {answer!r}", answer is not None and b"pixhawk6c" in answer)
    written = board.written
    if link == "TELEM1":
        divider = written.get(RCC + 0x30, 0)
        clock = 16_000_000 * ((divider & 0x1FF) + 1) // ((divider >> 9 & 0x7F) + 1)
        check(f"PLL1: {clock / 1e6:.0f} MHz for the processor", clock == 480_000_000)
        divider = written.get(RCC + 0x40, 0)
        inlet = 16_000_000 / (written.get(RCC + 0x28, 0) >> 20 & 0x3F)
        clock = inlet * ((divider & 0x1FF) + 1) / ((divider >> 16 & 0x7F) + 1)
        check(f"PLL3: {clock / 1e6:.0f} MHz for USB", clock == 48e6 and written.get(RCC + 0x54, 0) >> 20 & 3 == 2)
    if link in UARTS:
        base, receive, send, *requests = UARTS[link]
        baud = 120e6 / written.get(base + 0x0C, 1)
        check(f"{link}: {baud:.0f} baud", abs(baud / 921_600 - 1) < 0.005)
        streams = [DMA1 + 0x10 + 0x18 * number for number in (receive, send)]
        places = [written.get(stream + 0x0C, 0) for stream in streams]
        check(f"{link}: DMA in AXI SRAM, at {places[0]:#x} and {places[1]:#x}", all(AXI <= place < AXI + 0x80000 for place in places))
        found = [written.get(0x40020800 + 4 * number) for number in (receive, send)]
        check(f"{link}: DMA requests {found}", found == requests)
    else:
        answers = board.usb.answers
        device = answers[0] if answers else b""
        ids = struct.unpack_from("<HH", device, 8) if len(device) == 18 else (0, 0)
        check(f"USB: device {ids[0]:04x}:{ids[1]:04x}, {len(answers)} control transfers", len(answers) == 5 and ids == (0x16C0, 0x27DD))

registers = (0x08021234, 0x08025679, 0x8200, 0x40000000, 0xDEADBEE0)
report = payload(Board("TELEM1", STATUS, registers).run().split(b"\0", 1)[1])
found = struct.unpack("<5I", report[-20:]) if report and len(report) > 20 else ()
check(f"a fault is reported: {' '.join(f'{register:08x}' for register in found)}", found == registers and report[-21] == 2)

board = Board("TELEM2", BOOT_LOADER)
frames = board.run().count(b"\0")
mark = board.written.get(RTC_BACKUP_0, 0)
check(f"restarts into the boot loader, mark {mark:08x}, after the answer", board.reset and mark == 0xB007B007 and frames == 2)
sys.exit(1 if failures else 0)
