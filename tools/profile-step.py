#!/usr/bin/env python3
"""Where the instructions of a step go, by source file: the longest step of one solution, on the emulated board.

usage: tools/profile-step.py [SOLUTION [SECONDS]]      after `cargo xtask firmware` and `cargo build --release`

SOLUTION is one of residuals, t-test, network (unless given), sequential, all. Flies the beginning of the reference flight (2.2 s, or SECONDS) as
`rotortwin board measure` does, with an emulator that tells every instruction. A step is what lies between the entry of
`Application::advance` and its return: with the reply's writing, that is some more than what the board counts between two looks at its counter.
"""

import os
import shutil
import struct
import subprocess
import sys
import tempfile
from bisect import bisect_right

SOLUTIONS = ("residuals", "t-test", "network", "sequential", "all")
SOLUTION = sys.argv[1] if len(sys.argv) > 1 else "network"
SECONDS = sys.argv[2] if len(sys.argv) > 2 else "2.2"
PROGRAM = "target/firmware/thumbv7em-none-eabihf/release/mps2-an500"
ELF = open(PROGRAM, "rb").read()
if SOLUTION not in SOLUTIONS:
    sys.exit(f"profile-step: '{SOLUTION}' is no solution, expected one of {', '.join(SOLUTIONS)}")


def functions():
    """Address, size and name of every function."""
    sections, count = struct.unpack_from("<I", ELF, 0x20)[0], struct.unpack_from("<H", ELF, 0x30)[0]
    headers = [struct.unpack_from("<10I", ELF, sections + 40 * k) for k in range(count)]
    table = next(header for header in headers if header[1] == 2)
    names = headers[table[6]][4]
    for at in range(table[4], table[4] + table[5], 16):
        name, address, size, info = struct.unpack_from("<IIIB", ELF, at)
        if info & 0xF == 2 and size:
            yield address & ~1, size, ELF[names + name : ELF.index(b"\0", names + name)].decode()


def plain(name):
    """The last words of a mangled name."""
    words, at = [], name.find("_ZN") + 3
    while 2 < at < len(name) and name[at].isdigit():
        end = at
        while name[end].isdigit():
            end += 1
        length = int(name[at:end])
        words.append(name[end : end + length])
        at = end + length
    return "::".join(words[-3:-1]) if len(words) > 2 else name


TABLE = sorted(functions())
STARTS = [start for start, _, _ in TABLE]
STEP = next(start for start, _, name in TABLE if "Application7advance" in name)
CALLER = next(index for index, (_, _, name) in enumerate(TABLE) if "Application7receive" in name)


def owner(address, known={}):
    """Place in TABLE."""
    if address not in known:
        known[address] = bisect_right(STARTS, address) - 1
    return known[address]


def longest_step(trace):
    """Instructions by address, and their sum."""
    best, most, counts, inside = {}, 0, {}, False
    for line in trace:
        # Trace 0: 0x7f… [00000000/00003f2c/…] name
        at = line.find("/")
        if at < 0:
            continue
        address = int(line[at + 1 : line.index("/", at + 1)], 16)
        function = owner(address)
        if address == STEP:
            inside, counts = True, {}
        elif inside and function == CALLER:
            inside, total = False, sum(counts.values())
            if total > most:
                best, most = counts, total
        if inside:
            counts[address] = counts.get(address, 0) + 1
    return best, most


def sources(addresses):
    """The file of ours that an instruction comes from, seen through what was inlined; the function, where that is not ours."""
    tool = shutil.which("llvm-addr2line") or shutil.which("addr2line")
    names = {address: plain(TABLE[owner(address)][2]) for address in addresses}
    if not tool:
        return names
    listing = "\n".join(f"{address:#x}" for address in addresses)
    words = subprocess.run([tool, "-a", "-i", "-e", PROGRAM], input=listing, capture_output=True, text=True).stdout
    address, found = None, {}
    for line in words.splitlines():
        if line.startswith("0x"):
            address = int(line, 16)
        elif "/crates/" in line and address not in found:
            found[address] = line.split("/crates/", 1)[1].split(":")[0]
    return {address: found.get(address, name) for address, name in names.items()}


emulator = shutil.which("qemu-system-arm") or sys.exit("profile-step: qemu-system-arm is missing")
with tempfile.TemporaryDirectory() as folder:
    pipe, shim, count = f"{folder}/trace", f"{folder}/qemu-system-arm", f"{folder}/count"
    os.mkfifo(pipe)
    with open(shim, "w") as script:
        # `board measure` flies the solutions one after the other, each with an emulator of its own.
        script.write(f'#!/bin/sh\necho >> {count}\nif [ $(wc -l < {count}) = {SOLUTIONS.index(SOLUTION) + 1} ]; then\n')
        script.write(f'  exec {emulator} "$@" -singlestep -d exec,nochain -D {pipe}\nfi\nexec {emulator} "$@"\n')
    os.chmod(shim, 0o755)
    command = ["target/release/rotortwin", "board", "measure", "qemu", "--duration", SECONDS]
    environment = dict(os.environ, PATH=f"{folder}:{os.environ['PATH']}")
    flights = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
    with open(pipe) as trace:
        counts, total = longest_step(trace)
    status = flights.wait()
    totals, names = {}, sources(list(counts))
    for address, times in counts.items():
        totals[names[address]] = totals.get(names[address], 0) + times
    print(f"{SOLUTION}: {total} instructions in the longest step of {SECONDS} s, reply included")
    for name, times in sorted(totals.items(), key=lambda item: -item[1]):
        print(f"  {times:>7}  {100 * times / total:4.1f} %  {name}")
    sys.exit(status)
