"""Sessions that are published by every protocol, and their receivers, as the tests of networks share them.

A script of these tests is root of a user namespace, and has a loopback interface of its own."""

import contextlib
import dataclasses
import faulthandler
import os
import pathlib
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time

import cli
import two_machines

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import tick_stream

RECEIVER = os.environ.get("FAST_DDS_RECEIVER", "")
# until something happens that has to
PATIENCE_S = 120
SEED = int.from_bytes(os.urandom(4), "big") if os.environ.get("PALPATE_TEST_SEED") == "any" else 57
IGTL_HEAD = struct.Struct(">H12s20sQQQ")


def enter_namespaces():
    """As setUpModule()."""
    # a process with more than one thread cannot enter a user namespace
    faulthandler.cancel_dump_traceback_later()
    try:
        two_machines.enter_user_namespace()
    except OSError as error:
        cli.missing(f"user namespaces ({error.strerror})")
    cli.end_before_timeout()


def until(happened, what):
    end = time.monotonic() + PATIENCE_S
    while not (result := happened()):
        if time.monotonic() > end:
            raise AssertionError(what)
        time.sleep(0.01)
    return result


@dataclasses.dataclass
class Pose:
    """A pose that was received at `at_s` of the monotonic clock, made `age_s` before."""

    at_s: float
    age_s: float

    @property
    def made_s(self):
        return self.at_s - self.age_s


class Receiver:
    """Receives one protocol on a thread of its own. receive() of a subclass calls self.add(age_s) for each pose."""

    def __init__(self):
        self.poses, self.failure = [], None
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self):
        self._thread.start()
        return self

    def _run(self):
        try:
            self.receive()
        except (OSError, EOFError, AssertionError, struct.error, IndexError) as error:
            self.failure = error

    def add(self, age_s):
        self.poses.append(Pose(time.monotonic(), age_s))

    def since(self, begin_s, end_s=float("inf")):
        return [pose for pose in self.poses[:] if begin_s <= pose.at_s < end_s]

    def first_made_after(self, begin_s):
        return next((pose for pose in self.poses[:] if pose.made_s >= begin_s), None)


class WebSocket(Receiver):
    """Poses, and with `ticks` every tick."""

    name = "WebSocket"

    def __init__(self, port, host="127.0.0.1", **hello):
        super().__init__()
        self.ticks = self.lost = 0
        self.first_tick = self.last_tick = None
        self.lateness_p99_us, self.dropped = [], 0
        self.viewer = tick_stream.TickViewer(port, host, poses_hz=60, **hello)

    def receive(self):
        while True:
            opcode, data = self.viewer.receive()
            assert opcode != 8, "closed by the server"
            if data[:4] == b"PLPT":
                self.add(1e-9 * (time.monotonic_ns() - struct.unpack_from("<q", data, 32)[0]))
                self.lateness_p99_us.append((time.monotonic(), struct.unpack_from("<f", data, 72)[0]))
                self.dropped = struct.unpack_from("<I", data, 88)[0]
            elif data[:4] == b"PLPB":
                _, self.lost, ticks = tick_stream.read_bundle(data)
                self.first_tick = ticks[0]["tick"] if self.first_tick is None else self.first_tick
                self.last_tick = ticks[-1]["tick"]
                self.ticks += len(ticks)

    def close(self):
        with contextlib.suppress(OSError):
            self.viewer.socket.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self.viewer.close()


class OpenIgtLink(Receiver):
    name = "OpenIGTLink"

    def __init__(self, port, host="127.0.0.1", ask=()):
        super().__init__()
        self.names = set()
        self.socket = socket.create_connection((host, port), timeout=60)
        for kind, name in ask:
            self.socket.sendall(IGTL_HEAD.pack(1, kind.encode(), name.encode(), 0, 0, 0))

    def receive(self):
        with self.socket.makefile("rb") as stream:
            while True:
                head = stream.read(IGTL_HEAD.size)
                if len(head) < IGTL_HEAD.size:
                    raise EOFError
                _, kind, name, stamp, size, _ = IGTL_HEAD.unpack(head)
                stream.read(size)
                name = (kind.rstrip(b"\0") + b" " + name.rstrip(b"\0")).decode()
                self.names.add(name)
                if name == "TRANSFORM ProbeToRAS":
                    self.add(time.time() - stamp / 2**32)

    def close(self):
        with contextlib.suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self.socket.close()


class Ros2(Receiver):
    """A node by Fast DDS, in a process of its own."""

    name = "ROS 2"

    def __init__(self, domain, address, machine=None):
        super().__init__()
        self.transforms = 0
        self.process = subprocess.Popen([RECEIVER, str(domain), address], stdout=subprocess.PIPE, text=True,
                                        preexec_fn=machine.enter if machine else None)

    def receive(self):
        for line in self.process.stdout:
            kind, stamp_ns, received_ns = line.split()
            if kind == "cp":
                self.add(1e-9 * (int(received_ns) - int(stamp_ns)))
            else:
                self.transforms += 1
        raise EOFError

    def close(self):
        self.process.kill()
        self.process.wait()
        self._thread.join()
        self.process.stdout.close()


class Published:
    """palpate with every publisher.

    @param machine  where it runs, at all of whose addresses it publishes; None: here, on loopback
    """

    def __init__(self, scene, *arguments, machine=None, domain=0, tokens=None, **options):
        command = [cli.PALPATE, "explore", scene, "--repeat", "--port", "0", "--openigtlink", "0", "--ros2", domain]
        if machine:
            command += ["--listen", "0.0.0.0", "--token-file", tokens, "--openigtlink-listen", "0.0.0.0",
                        "--ros2-interface", machine.address]
        self.program = subprocess.Popen([*map(str, command), *map(str, arguments)], text=True, stdin=subprocess.DEVNULL,
                                        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                                        preexec_fn=machine.enter if machine else None, **options)
        self.page = self.openigtlink = None
        lines = []
        for line in self.program.stderr:
            lines.append(line)
            if found := re.search(r"open http://[\d.]+:(\d+)/", line):
                self.page = int(found.group(1))
            if found := re.search(r"OpenIGTLink at \S+ port (\d+)", line):
                self.openigtlink = int(found.group(1))
            if self.page and self.openigtlink and "ROS 2 in domain" in "".join(lines):
                break
        else:
            raise AssertionError("it does not publish: " + "".join(lines))
        # what it logs later must not fill the pipe
        self.log = []
        self._reader = threading.Thread(target=lambda: self.log.extend(self.program.stderr), daemon=True)
        self._reader.start()

    def end(self):
        self.program.send_signal(signal.SIGINT)
        code = self.program.wait()
        self._reader.join()
        self.program.stderr.close()
        return code


class NetworkCase(cli.PalpateTest):
    def two_machines(self, record=None):
        machines = two_machines.TwoMachines(SEED, record)
        self.addCleanup(machines.close)
        return machines

    def published(self, *arguments, **options):
        session = Published(*arguments, **options)
        self.addCleanup(lambda: self.assertEqual(session.end(), cli.OK, session.log))
        return session

    def tokens(self):
        """A file of tokens, and the one that permits viewing."""
        path = self.folder / "tokens"
        self.succeed("token", "-o", path, runner=cli.spawn)
        return path, re.search(r"^view (\S+)", path.read_text(), re.MULTILINE).group(1)

    def receiving(self, *receivers):
        """Each receiver, once its poses come."""
        for receiver in receivers:
            self.addCleanup(receiver.close)
            receiver.start()
        for receiver in receivers:
            until(lambda: len(receiver.poses) > 20 or receiver.failure, f"{receiver.name}: no poses come")
            self.assertIsNone(receiver.failure, receiver.name)
        return receivers
