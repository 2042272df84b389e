"""A session published by OpenIGTLink, received as another program receives it."""

import re
import signal
import socket
import struct
import subprocess
import time

import cli

HEAD = struct.Struct(">H12s20sQQQ")


def text(field):
    return field.split(b"\0")[0].decode()


class Client:
    def __init__(self, port):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=20)

    def read(self, count):
        data = b""
        while len(data) < count:
            part = self.socket.recv(count - len(data))
            if not part:
                raise EOFError
            data += part
        return data

    def next(self):
        version, kind, name, _, size, _ = HEAD.unpack(self.read(HEAD.size))
        assert version == 1
        return text(kind), text(name), self.read(size)

    def ask(self, kind, name):
        self.socket.sendall(HEAD.pack(1, kind.encode(), name.encode(), 0, 0, 0))


class OpenIgtLinkTest(cli.PalpateTest):
    def started(self, *arguments):
        """The program, and the port that it prints."""
        program = subprocess.Popen([cli.PALPATE, *arguments, "--openigtlink", "0"], text=True, stdin=subprocess.DEVNULL,
                                   stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        self.addCleanup(program.stderr.close)
        self.addCleanup(program.wait)
        self.addCleanup(program.send_signal, signal.SIGINT)
        for line in program.stderr:
            found = re.search(r"OpenIGTLink at 127\.0\.0\.1 port (\d+)", line)
            if found:
                return int(found.group(1))
        self.fail("it prints no port")

    def test_a_scripted_hand_touches_what_it_reports(self):
        # with its page, which offers no tasks then
        client = Client(self.started("explore", f"knee-phantom:spacing={cli.KNEE_MM}", "--port", "0", "--repeat"))
        structures, largest_N, tips = {"none"}, 0.0, set()
        # on a busy machine the hand starts to move late
        deadline = time.monotonic() + 300
        while len(tips) <= 100 or largest_N <= 0.2 or structures == {"none"}:
            self.assertLess(time.monotonic(), deadline, f"{len(tips)} tips, {largest_N:.2f} N, {structures}")
            kind, name, body = client.next()
            if name == "ProbeToRAS":
                tips.add(struct.unpack(">3f", body[36:]))
            if name == "Force":
                largest_N = max(largest_N, sum(f * f for f in struct.unpack(">3f", body[36:])) ** 0.5)
            if kind == "STRING":
                structures.add(body[4:].decode())
        client.ask("GET_IMAGE", "Labels")
        while True:
            kind, name, body = client.next()
            if name == "Labels":
                break
        dims = struct.unpack(">3H", body[6:12])
        self.assertEqual(len(body), 72 + 2 * dims[0] * dims[1] * dims[2])
        self.assertGreater(max(body[72:]), 0)

    def test_what_cannot_be_published_is_refused(self):
        self.expect_error(cli.USAGE, "explore", "knee-phantom", "--device", "pointer", "--task", "meniscus-probing",
                          "--openigtlink", 0, message="would see what a task hides")
        self.expect_error(cli.USAGE, "explore", "knee-phantom", "--openigtlink", 70000, message="--openigtlink")
        self.expect_error(cli.USAGE, "explore", "knee-phantom", "--openigtlink-listen", "0.0.0.0", message="--openigtlink")


if __name__ == "__main__":
    cli.main()
