"""Clients that come, send garbage and go, two hundred times at each port, leave nothing behind and disturb no others."""

import os
import pathlib
import random
import re
import socket
import struct
import time

import cli
import published
from published import IGTL_HEAD, SEED, OpenIgtLink, Ros2, WebSocket, tick_stream, until

setUpModule = published.enter_namespaces


class ReconnectionTest(published.NetworkCase):
    """On loopback, as by default."""

    COUNT = 200

    def setUp(self):
        super().setUp()
        self.chance = random.Random(SEED)
        self.session = self.published("knee-phantom:spacing=3", domain=1)

    def garbage(self, beginning=b""):
        return beginning + self.chance.randbytes(self.chance.randrange(1, 2000))

    def connect(self, port, sent, read=True):
        """A client of TCP that sends bytes, may read the first answer, and closes abruptly or in order."""
        with socket.create_connection(("127.0.0.1", port), timeout=60) as client:
            if self.chance.random() < 0.5:
                # closed with data unread or unsent, the connection is reset
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            try:
                client.sendall(sent)
                if read:
                    client.recv(1000)
            except ConnectionError:
                pass  # the server is not obliged to listen on

    def on_page(self):
        what = self.chance.randrange(4)
        if what == 0:
            tick_stream.TickViewer(self.session.page, ticks=True).close()
        elif what == 1:
            viewer = tick_stream.TickViewer(self.session.page, ticks=True)
            viewer.socket.sendall(self.garbage(bytes([0x81])))
            viewer.close()
        else:
            host = f"Host: 127.0.0.1:{self.session.page}\r\n\r\n".encode()
            self.connect(self.session.page, self.garbage(b"GET / HTTP/1.1\r\n" + host if what == 2 else b""), what == 2)

    def on_openigtlink(self):
        kinds = (b"", IGTL_HEAD.pack(2, b"STATUS", b"x", 0, 200, 0),
                 IGTL_HEAD.pack(1, b"GET_IMAGE", b"Labels", 0, 0, 0),
                 IGTL_HEAD.pack(1, b"TRANSFORM", b"x", 0, 1 << 40, 0))
        self.connect(self.session.openigtlink, self.garbage(self.chance.choice(kinds)))

    def on_dds(self):
        # by RTPS: domain 1's ports for discovery and for data of the first participant
        head = self.chance.choice((b"", b"RTPS\x02\x03\x01\x0f" + bytes(12),
                                   b"RTPS\x02\x01\x01\x10" + self.chance.randbytes(12)))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            for port in (7660, 7661):
                client.sendto(self.garbage(head)[:1400], ("127.0.0.1", port))

    def resources(self):
        """Open descriptors, threads, and resident memory in kB."""
        status = pathlib.Path(f"/proc/{self.session.program.pid}/status").read_text()
        threads, resident_kB = (int(re.search(rf"^{key}:\s*(\d+)", status, re.MULTILINE).group(1))
                                for key in ("Threads", "VmRSS"))
        return len(os.listdir(f"/proc/{self.session.program.pid}/fd")), threads, resident_kB

    def test_reconnections_and_garbage_leave_nothing(self):
        beside = self.receiving(WebSocket(self.session.page, ticks=True), OpenIgtLink(self.session.openigtlink),
                                Ros2(1, "127.0.0.1"))
        ports = {"page": self.on_page, "OpenIGTLink": self.on_openigtlink, "DDS": self.on_dds}
        for name, reconnect in ports.items():
            with self.subTest(name):
                # memory pools, and threads that are made when they are first needed
                for _ in range(self.COUNT // 4):
                    reconnect()
                time.sleep(1)
                before = self.resources()
                begin = time.monotonic()
                for _ in range(self.COUNT):
                    reconnect()
                descriptors, threads, before_kB = before
                until(lambda: self.resources()[:2] == (descriptors, threads) or None,
                      f"{name}: {before} before, {self.resources()} after; seed {SEED}")
                after_kB = self.resources()[2]
                print(f"{name}: {descriptors} descriptors, {threads} threads, {before_kB} kB before, "
                      f"{after_kB} kB after")
                # what each of 200 connections leaves behind would be a page or more
                self.assertLess(after_kB - before_kB, 4 * self.COUNT, f"{name}, kB; seed {SEED}")
                for receiver in beside:
                    now_s = time.monotonic()
                    until(lambda: receiver.first_made_after(now_s) or receiver.failure, f"{receiver.name} stands still")
                    self.assertIsNone(receiver.failure, f"{receiver.name} beside {name}; seed {SEED}")
                    self.assertGreater(len(receiver.since(begin)), 0)
        self.assertLessEqual(beside[0].lost, beside[0].dropped)

    def test_nodes_that_come_and_go_leave_nothing(self):
        beside, = self.receiving(Ros2(1, "127.0.0.1"))

        def come_and_go():
            node = Ros2(1, "127.0.0.1").start()
            until(lambda: node.poses or node.failure, "a node receives nothing")
            node.close()
            self.assertGreater(len(node.poses), 0, node.failure)
        for _ in range(3):
            come_and_go()
        descriptors, threads, before_kB = self.resources()
        for _ in range(10):
            come_and_go()
        after = self.resources()
        print(f"nodes: {descriptors, threads, before_kB} before and {after} after")
        self.assertEqual(after[:2], (descriptors, threads))
        now_s = time.monotonic()
        until(lambda: beside.first_made_after(now_s), "the node beside stands still")


if __name__ == "__main__":
    cli.spawn_only()
    cli.main()
