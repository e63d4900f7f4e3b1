"""A wire with delay and loss between two network interfaces, for kernels without netem.

usage: lossy_wire.py A B DELAY_MS LOSS_PERCENT SEED; both interfaces in this network name space. Ends when it is killed.
       lossy_wire.py INTERFACE: only turns the checksum offload of an interface off, so that its packets carry whole checksums.
"""

import array
import collections
import fcntl
import random
import select
import socket
import struct
import sys
import time

SIOCETHTOOL = 0x8946
ETHTOOL_STXCSUM = 0x17
ETH_P_ALL = 3
PACKET_OUTGOING = 4


def checksums_in_software(interface):
    command = array.array("B", struct.pack("II", ETHTOOL_STXCSUM, 0))
    request = struct.pack("16sP", interface.encode(), command.buffer_info()[0])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        fcntl.ioctl(control, SIOCETHTOOL, request)


def open_interface(interface):
    port = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETH_P_ALL))
    port.bind((interface, 0))
    port.setblocking(False)
    return port


def relay(a, b, delay_s, loss, seed):
    ports = [open_interface(a), open_interface(b)]
    draw = random.Random(seed)
    waiting = collections.deque()
    print("relaying", flush=True)
    while True:
        now = time.monotonic()
        while waiting and waiting[0][0] <= now:
            _, port, frame = waiting.popleft()
            try:
                port.send(frame)
            except OSError:
                pass  # the interface is down
        pause = max(0.0, waiting[0][0] - now) if waiting else None
        for port in select.select(ports, [], [], pause)[0]:
            try:
                frame, origin = port.recvfrom(65536)
            except OSError:
                continue
            if origin[2] == PACKET_OUTGOING or draw.random() < loss:
                continue
            other = ports[1] if port is ports[0] else ports[0]
            waiting.append((time.monotonic() + delay_s, other, frame))


if len(sys.argv) == 2:
    checksums_in_software(sys.argv[1])
else:
    relay(sys.argv[1], sys.argv[2], float(sys.argv[3]) / 1000, float(sys.argv[4]) / 100, int(sys.argv[5]))
