"""A client of the WebSocket that docs/reference/viewer-protocol.md describes: its handshake and its framing."""

import base64
import json
import os
import socket
import struct

TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10  # opcodes


class WebSocketClient:
    """Connects and sends the first message, "hello" with these fields. Every read fails after `timeout_s` without data."""

    def __init__(self, host, port, timeout_s=300, **hello):
        self.socket = socket.create_connection((host, port), timeout=timeout_s)
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall((f"GET /ws HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                             f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
                             "Sec-WebSocket-Protocol: palpate.v1\r\n\r\n").encode())
        head = b""
        while not head.endswith(b"\r\n\r\n"):
            head += self._take(1)
        assert head.startswith(b"HTTP/1.1 101 "), head
        self.send({"type": "hello", "protocol": 3, **hello})

    def _take(self, count):
        data = bytearray()
        while len(data) < count:
            piece = self.socket.recv(count - len(data))
            if not piece:
                raise AssertionError("the server has hung up")
            data += piece
        return bytes(data)

    def _send_frame(self, opcode, data):
        assert len(data) < 65536
        size = bytes([0x80 | len(data)]) if len(data) < 126 else b"\xfe" + struct.pack(">H", len(data))
        mask = os.urandom(4)
        masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(data))
        self.socket.sendall(bytes([0x80 | opcode]) + size + mask + masked)

    def send(self, message):
        """Sends an object as a text message."""
        self._send_frame(TEXT, json.dumps(message).encode())

    def receive(self):
        """The opcode and the data of the next message. Pings are answered and not returned."""
        while True:
            first, size = self._take(2)
            if size >= 126:
                size = struct.unpack(">H", self._take(2))[0] if size == 126 else struct.unpack(">Q", self._take(8))[0]
            data = self._take(size)
            assert first & 0x80, "the server sends no message in several frames"
            if first & 15 != PING:
                return first & 15, data
            self._send_frame(PONG, data)

    def close(self):
        self.socket.close()
