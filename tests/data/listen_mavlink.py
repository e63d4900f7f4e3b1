"""A ground station: what pymavlink makes of the datagrams at PORT until SECONDS have passed without one, as JSON.

    python listen_mavlink.py PORT SECONDS
"""

import json
import socket
import sys
import time

from pymavlink.dialects.v20 import common

port, patience_s = int(sys.argv[1]), float(sys.argv[2])
listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
listener.bind(("127.0.0.1", port))
print("listening", flush=True)
decoder = common.MAVLink(None)
decoder.robust_parsing = True
counts, last, texts, wrong, missed, expected = {}, {}, [], 0, 0, None
# The first one may take longer: the flight is only starting.
listener.settimeout(60.0)
while True:
    try:
        datagram = listener.recv(65536)
    except TimeoutError:
        break
    listener.settimeout(patience_s)
    for message in decoder.parse_buffer(datagram) or []:
        kind = message.get_type()
        if kind == "BAD_DATA":
            wrong += 1
            continue
        sequence = message.get_seq()
        missed += expected is not None and sequence != expected
        expected = (sequence + 1) % 256
        counts[kind] = counts.get(kind, 0) + 1
        last[kind] = {key: value for key, value in message.to_dict().items() if key != "mavpackettype"}
        if kind == "STATUSTEXT":
            texts.append(message.text)
print(json.dumps({"counts": counts, "last": last, "texts": texts, "wrong": wrong, "missed": missed}, default=str))
