"""A viewer that receives every tick, written from docs/reference/viewer-messages.md: the tables there are its description of the
bytes."""

import base64
import json
import os
import pathlib
import re
import socket
import struct

MANUAL = pathlib.Path(__file__).resolve().parents[1] / "docs/reference/viewer-messages.md"
CODES = {"f32": "f", "f64": "d", "u32": "I", "u64": "Q"}


def layout(part):
    """[(name, type, count)] of the manual's table of a "tick" or a "device"; checks that its offsets are those of the types."""
    table = MANUAL.read_text(encoding="utf-8").split(f"<!-- bundled {part} begin -->")[1].split("<!-- bundled")[0]
    fields, offset = [], 0
    for at, kind, count, name in re.findall(r"^\| (\d+) \| `(\w+)(?:\[(\d+)\])?` \| `(\w+)` \|", table, re.MULTILINE):
        assert int(at) == offset, f"{name} at {at}, not {offset}"
        fields.append((name, kind, int(count or 1)))
        offset += struct.calcsize("<" + CODES[kind]) * fields[-1][2]
    return fields


class Part:
    def __init__(self, name):
        self.fields = layout(name)
        self.struct = struct.Struct("<" + "".join(CODES[kind] * count for _, kind, count in self.fields))

    def read(self, data, at):
        numbers, values = iter(self.struct.unpack_from(data, at)), {}
        for name, _, count in self.fields:
            values[name] = next(numbers) if count == 1 else tuple(next(numbers) for _ in range(count))
        return values


TICK, DEVICE = Part("tick"), Part("device")
HEAD = struct.Struct("<4sHHIIQQ")


def read_bundle(data):
    """@returns (sequence, lost, [tick]); each tick has its devices as `device`"""
    kind, version, _, size, count, sequence, lost = HEAD.unpack_from(data)
    assert (kind, version, size) == (b"PLPB", 3, len(data))
    at, ticks = HEAD.size, []
    for _ in range(count):
        tick = TICK.read(data, at)
        at += TICK.struct.size
        tick["device"] = []
        for _ in range(tick["devices"]):
            tick["device"].append(DEVICE.read(data, at))
            at += DEVICE.struct.size
        ticks.append(tick)
    assert at == size
    return sequence, lost, ticks


class Viewer:
    def __init__(self, port, host="127.0.0.1", **hello):
        self.socket = socket.create_connection((host, port), timeout=60)
        self.stream = self.socket.makefile("rb")
        self.socket.sendall((f"GET /ws HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                             f"Sec-WebSocket-Key: {base64.b64encode(os.urandom(16)).decode()}\r\nSec-WebSocket-Version: 13\r\n"
                             "Sec-WebSocket-Protocol: palpate.v1\r\n\r\n").encode())
        assert b" 101 " in self.stream.readline()
        while self.stream.readline() != b"\r\n":
            pass
        text = json.dumps({"type": "hello", "protocol": 3, **hello}).encode()
        size = bytes([0x80 | len(text)]) if len(text) < 126 else bytes([0x80 | 126]) + struct.pack(">H", len(text))
        # masked by zeros
        self.socket.sendall(b"\x81" + size + bytes(4) + text)

    def close(self):
        self.stream.close()
        self.socket.close()

    def message(self):
        """The next (opcode, data)."""
        head = self.stream.read(2)
        size = head[1]
        if size > 125:
            size = struct.unpack(">H" if size == 126 else ">Q", self.stream.read(2 if size == 126 else 8))[0]
        return head[0] & 15, self.stream.read(size)

    def binary(self, kind):
        """The next binary message that begins with these four bytes."""
        while True:
            opcode, data = self.message()
            assert opcode != 8, "the session has ended"
            if opcode == 2 and data[:4] == kind:
                return data
