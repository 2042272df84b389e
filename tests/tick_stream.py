"""A viewer that receives every tick, written from docs/reference/viewer-messages.md: the tables there are its description of the
bytes."""

import pathlib
import re
import struct

from websocket_client import BINARY, CLOSE, WebSocketClient

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


class TickViewer(WebSocketClient):
    """A viewer that receives bundles of ticks."""

    def __init__(self, port, host="127.0.0.1", **hello):
        super().__init__(host, port, 60, **hello)

    def binary(self, kind):
        """The next binary message that begins with these four bytes."""
        while True:
            opcode, data = self.receive()
            assert opcode != CLOSE, "the session has ended"
            if opcode == BINARY and data[:4] == kind:
                return data
