"""What tests of a live session share: palpate on a terminal, a viewer that is a program, and the session of a generated knee."""

import codecs
import fcntl
import gzip
import json
import os
import pathlib
import pty
import re
import select
import socket
import struct
import subprocess
import sys
import tempfile
import termios
import time
import urllib.request

import cli

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
from websocket_client import BINARY, TEXT, WebSocketClient

PRESS = cli.TOUCH + '[[step]]\nhold = 60.0\n'
ERASE = "\r\033[K"
PRESSES = r" 0\.[5-9]\d/1\.40 N  femur"
# warning printed on a machine that is slow, or busy when a session begins
SLOW_MACHINE = re.compile("palpate: warning: soft tissue is solved in cells of .*\r?\n")


class Terminal:
    """palpate with stderr on a pseudo-terminal, and stdin too if `keyboard`. frames() are the successive contents of
    the status line. `typed` is in the input buffer before palpate starts."""

    def __init__(self, *arguments, keyboard=False, typed=b""):
        self.master, slave = pty.openpty()
        if typed:
            os.write(self.master, typed)
        own = {"start_new_session": True, "preexec_fn": lambda: fcntl.ioctl(slave, termios.TIOCSCTTY, 0)}
        self.process = subprocess.Popen([cli.PALPATE, *map(str, arguments)],
                                        stdin=slave if keyboard else subprocess.DEVNULL,
                                        stdout=subprocess.PIPE, stderr=slave, text=True, **(own if keyboard else {}))
        os.close(slave)
        self.shown = ""
        # a piece may end in the middle of a character
        self.decoder = codecs.getincrementaldecoder("utf-8")()

    def press(self, key):
        os.write(self.master, key)
        self.shown = ""

    def read(self):
        """More of what is shown; False at the end."""
        if not select.select([self.master], [], [], 300)[0]:
            raise AssertionError(f"nothing for five minutes; shown: {self.shown[-500:]}")
        try:
            piece = os.read(self.master, 4096)
        except OSError:
            piece = b""
        self.shown += self.decoder.decode(piece)
        return bool(piece)

    def wait_until(self, done, what):
        # the live line never falls silent
        until = time.monotonic() + 300
        while not done():
            if not self.read():
                raise AssertionError(f"ended without {what}; shown: {self.shown[-500:]}")
            if time.monotonic() > until:
                raise AssertionError(f"five minutes without {what}; shown: {self.shown[-2000:]}")

    def wait_for(self, pattern):
        self.wait_until(lambda: re.search(pattern, self.shown), pattern)

    def finish(self):
        until = time.monotonic() + 300
        while self.read():
            if time.monotonic() > until:
                raise AssertionError(f"not ended after five minutes; shown: {self.shown[-2000:]}")
        out, _ = self.process.communicate(timeout=300)
        return self.process.returncode, out

    def close(self):
        self.process.kill()
        self.process.communicate()
        os.close(self.master)

    def frames(self):
        return [frame for frame in self.shown.split(ERASE) if " Hz  " in frame]

    def screen(self):
        """What is left to see at the end, a string a line."""
        return [line.split(ERASE)[-1] for line in self.shown.replace("\r\n", "\n").split("\n")]


class Viewer(WebSocketClient):
    """A viewer that is a program: the protocol's messages, and the resources served over HTTP."""

    def __init__(self, address, token=None):
        self.address, self.wire = address, bytearray()  # wire: every byte received
        self.texts, self.poses, self.state, self.last_id = [], 0, {}, 0
        host, port = re.fullmatch(r"http://([\d.]+):(\d+)/", address).groups()
        super().__init__(host, int(port), **({"token": token} if token else {}))

    def _take(self, count):
        data = super()._take(count)
        self.wire += data
        return data

    def next(self):
        """The next message: ('pose', bytes) or ('text', dict)."""
        opcode, data = self.receive()
        if opcode == BINARY:
            self.poses += 1
            return "pose", data
        assert opcode == TEXT, (opcode, data)
        self.texts.append(data)
        message = json.loads(data)
        if message["type"] == "state":
            self.state = message
        return "text", message

    def ask(self, **request):
        """The answer to a request."""
        self.last_id += 1
        self.send({**request, "id": self.last_id})
        while True:
            kind, message = self.next()
            if kind == "text" and message.get("id") == self.last_id:
                return message

    def wait_for_pose(self, is_it):
        """Waits for a pose whose first device satisfies is_it(force_N, stiffness, label, flags); returns these four
        values."""
        until = time.monotonic() + 300
        while time.monotonic() < until:
            kind, data = self.next()
            if kind != "pose":
                continue
            force = sum(f * f for f in struct.unpack_from("<3f", data, 96 + 52)) ** 0.5
            stiffness, flags = struct.unpack_from("<fI", data, 96 + 84)
            label = struct.unpack_from("<H", data, 96 + 96)[0]
            if is_it(force, stiffness, label, flags):
                return force, stiffness, label, flags
        raise AssertionError(f"no such pose within five minutes; the last: {force, stiffness, label, flags}")

    def get(self, path):
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        with opener.open(self.address + path, timeout=300) as answer:
            data = answer.read()
            return gzip.decompress(data) if answer.headers["Content-Encoding"] == "gzip" else data


def http_get(address, path, token):
    """The head and the body of an answer, whatever its status; the body as it was before it was compressed."""
    host, port = re.fullmatch(r"http://([\d.]+):(\d+)/", address).groups()
    with socket.create_connection((host, int(port)), timeout=300) as connection:
        connection.sendall(f"GET /{path} HTTP/1.1\r\nHost: {host}:{port}\r\nConnection: close\r\nAccept-Encoding: gzip\r\n"
                           f"Authorization: Bearer {token}\r\n\r\n".encode())
        data = b"".join(iter(lambda: connection.recv(1 << 16), b""))
    head, body = data.split(b"\r\n\r\n", 1)
    return head, gzip.decompress(body) if b"Content-Encoding: gzip" in head else body


class SessionTest(cli.PalpateTest):
    """Starts sessions on a terminal or with a viewer."""

    def terminal(self, *arguments, **options):
        terminal = Terminal(*arguments, **options)
        self.addCleanup(terminal.close)
        return terminal

    def viewed(self, *arguments, token=None):
        """A session in the background with a viewer: its process, the viewer, and what was told until then."""
        process = subprocess.Popen([cli.PALPATE, *map(str, arguments)], stdin=subprocess.DEVNULL,
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(process.communicate)
        self.addCleanup(process.kill)
        told = ""
        while not (address := re.search(r"open (http://\S+)$", told, re.M)):
            line = process.stderr.readline()
            self.assertTrue(line, f"ended without an address: {told}")
            told += line
        viewer = Viewer(address.group(1), token)
        self.addCleanup(viewer.close)
        return process, viewer, told


class KneeSessionTest(SessionTest):
    """Sessions of a coarse generated knee, whose `script` presses on the femur."""

    @classmethod
    def setUpClass(cls):
        cls._made = tempfile.TemporaryDirectory(prefix="palpate-e2e-")
        made = cls.made = pathlib.Path(cls._made.name)
        done = cli.run("data", "fetch", "knee-phantom", "-o", made / "knee", "--voxel", cli.KNEE_MM)
        assert done.returncode == 0, done.stderr
        labels = next((made / "knee").glob("*.seg.nrrd"))
        cls.scene, cls.script = made / "scene.toml", made / "press.toml"
        done = cli.run("scene", "new", labels, "-o", cls.scene)
        assert done.returncode == 0, done.stderr
        cls.script.write_text(PRESS)

    @classmethod
    def tearDownClass(cls):
        cls._made.cleanup()

    def explore(self, *options):
        return ["explore", self.scene, "--script", self.script, *options]

    def assert_replays(self, recording, stdout, scene=None):
        again = self.succeed("replay", recording, *([scene] if scene else []))
        self.assertIn("identical", again.stdout)
        self.assertNotIn("cut short", again.stdout)
        self.assertEqual(cli.run_hash(again.stdout), cli.run_hash(stdout))
