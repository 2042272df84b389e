"""Two network namespaces as two machines, joined by a relay in user space that loses, delays, limits and records
packets.

The kernel's own emulation (netem) is a module that not every kernel has. Packets of TCP and UDP cross a TUN device of
each namespace, so both machines' protocol stacks see real losses, with real retransmissions.
"""

import collections
import contextlib
import ctypes
import dataclasses
import fcntl
import heapq
import json
import os
import random
import resource
import select
import signal
import socket
import struct
import time

CLONE_NEWUSER, CLONE_NEWNET = 0x10000000, 0x40000000
TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x1, 0x1000
SIOCGIFFLAGS, SIOCSIFFLAGS, SIOCSIFADDR, SIOCSIFNETMASK = 0x8913, 0x8914, 0x8916, 0x891C
IFF_UP, IFF_MULTICAST = 0x1, 0x1000
MTU = 1500
# a router's buffer before a limited line: packets that would wait longer are dropped
MAX_QUEUE_S = 0.3
TCP = 6

_libc = ctypes.CDLL(None, use_errno=True)


def _checked(result):
    if result != 0:
        error = ctypes.get_errno()
        raise OSError(error, os.strerror(error))


@dataclasses.dataclass
class Line:
    """State of the line between the machines, the same in both directions.

    loss      fraction of the packets that are lost, each for itself
    delay_s   each packet is delayed by a time drawn evenly from 0 to this; packets overtake each other
    kbit_s    rate of each TCP connection, and of all UDP packets together; 0: unlimited
    cut       whether nothing passes
    """

    loss: float = 0
    delay_s: float = 0
    kbit_s: float = 0
    cut: bool = False


def enter_user_namespace():
    """Makes this process, which has one thread, root of a user namespace, in a network namespace with a loopback
    interface alone. OSError where the kernel forbids it."""
    # that network namespace belongs to the user namespace: into another one the process could not return
    user, group = os.getuid(), os.getgid()
    # real-time scheduling, which root of a user namespace may not grant
    for limit in (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK):
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(limit, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    _checked(_libc.unshare(CLONE_NEWUSER | CLONE_NEWNET))
    with open("/proc/self/setgroups", "w", encoding="ascii") as file:
        file.write("deny")
    for name, number in (("uid_map", user), ("gid_map", group)):
        with open(f"/proc/self/{name}", "w", encoding="ascii") as file:
            file.write(f"0 {number} 1")
    _bring_up("lo")


def _bring_up(name, address=None):
    """Brings an interface of the current namespace up. @param address  IPv4, of a network of 24 bits"""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        if address:
            for request, number in ((SIOCSIFADDR, address), (SIOCSIFNETMASK, "255.255.255.0")):
                body = struct.pack("HH4s8x", socket.AF_INET, 0, socket.inet_aton(number))
                fcntl.ioctl(control, request, struct.pack("16s16s8x", name.encode(), body))
        flags = struct.unpack_from("H", fcntl.ioctl(control, SIOCGIFFLAGS, struct.pack("16s24x", name.encode())), 16)[0]
        fcntl.ioctl(control, SIOCSIFFLAGS, struct.pack("16sH22x", name.encode(), flags | IFF_UP | IFF_MULTICAST))


class Machine:
    """A network namespace with a loopback interface and the interface `tun0`, whose other end is `self.wire`."""

    def __init__(self, address):
        self.address = address
        outside = os.open("/proc/self/ns/net", os.O_RDONLY | os.O_CLOEXEC)
        try:
            _checked(_libc.unshare(CLONE_NEWNET))
            self._namespace = os.open("/proc/self/ns/net", os.O_RDONLY | os.O_CLOEXEC)
            self.wire = os.open("/dev/net/tun", os.O_RDWR | os.O_CLOEXEC | os.O_NONBLOCK)
            fcntl.ioctl(self.wire, TUNSETIFF, struct.pack("16sH22x", b"tun0", IFF_TUN | IFF_NO_PI))
            _bring_up("lo")
            _bring_up("tun0", address)
        finally:
            _checked(_libc.setns(outside, CLONE_NEWNET))
            os.close(outside)

    def enter(self):
        """Moves the calling thread here. As `preexec_fn` it starts a program on this machine."""
        _checked(_libc.setns(self._namespace, CLONE_NEWNET))

    @contextlib.contextmanager
    def entered(self):
        """Sockets and threads made within are this machine's."""
        before = os.open("/proc/thread-self/ns/net", os.O_RDONLY | os.O_CLOEXEC)
        self.enter()
        try:
            yield self
        finally:
            _checked(_libc.setns(before, CLONE_NEWNET))
            os.close(before)

    def close(self):
        os.close(self._namespace)
        os.close(self.wire)


class TwoMachines:
    """`left` and `right`, and the line between them.

    @param record  file to which every packet is written with its length (u32) before it; None: none
    """

    def __init__(self, seed, record=None):
        self.left, self.right = Machine("10.57.0.1"), Machine("10.57.0.2")
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._relay = os.fork()
        if self._relay == 0:
            try:
                self._control.close()
                _relay((self.left.wire, self.right.wire), theirs, random.Random(seed), record)
            finally:
                os._exit(0)
        theirs.close()

    def set(self, line):
        """Changes the line; when it returns, the change is in effect."""
        self._control.send(json.dumps(dataclasses.asdict(line)).encode())
        assert self._control.recv(16) == b"done"

    def close(self):
        self._control.close()
        os.waitpid(self._relay, 0)
        self.left.close()
        self.right.close()


def _flow(packet):
    """What shares a limited line: a TCP connection, or all other packets."""
    if packet[9] != TCP:
        return None
    head = 4 * (packet[0] & 15)
    return tuple(sorted(struct.unpack_from("!HH", packet, head)))


def _relay(wires, control, chance, record):
    """Passes packets between two wires until the other end of `control` is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    line, due, count, free = Line(), [], 0, collections.defaultdict(float)
    recorded = open(record, "wb", buffering=0) if record else None
    others = {wires[0]: wires[1], wires[1]: wires[0]}
    while True:
        wait_s = max(0, due[0][0] - time.monotonic()) if due else None
        ready, _, _ = select.select([*wires, control], [], [], wait_s)
        if control in ready:
            text = control.recv(4096)
            if not text:
                if recorded:
                    recorded.close()
                return
            line = Line(**json.loads(text))
            control.send(b"done")
        now = time.monotonic()
        for wire in wires:
            if wire not in ready:
                continue
            while True:
                try:
                    packet = os.read(wire, 65536)
                except BlockingIOError:
                    break
                if recorded:
                    recorded.write(struct.pack("=I", len(packet)) + packet)
                if line.cut or packet[0] >> 4 != 4 or chance.random() < line.loss:
                    continue
                at = now + chance.random() * line.delay_s
                if line.kbit_s:
                    flow = wire, _flow(packet)
                    begin = max(at, free[flow])
                    if begin - at > MAX_QUEUE_S:
                        continue
                    at = free[flow] = begin + len(packet) * 8e-3 / line.kbit_s
                count += 1
                heapq.heappush(due, (at, count, others[wire], packet))
        now = time.monotonic()
        while due and due[0][0] <= now:
            _, _, wire, packet = heapq.heappop(due)
            # a cut also ends what is under way
            if not line.cut:
                with contextlib.suppress(BlockingIOError):
                    os.write(wire, packet)


def recorded_streams(path):
    """Everything that a recording holds: the bytes of each TCP connection and direction in their order, and the
    packets of all others joined. @returns {(protocol, source port, destination port): bytes}; ports are 0
    except for TCP"""
    data, at = path.read_bytes(), 0
    streams, others = collections.defaultdict(dict), collections.defaultdict(list)
    while at < len(data):
        size = struct.unpack_from("=I", data, at)[0]
        packet = data[at + 4:at + 4 + size]
        at += 4 + size
        if packet[0] >> 4 != 4:
            continue
        head = 4 * (packet[0] & 15)
        if packet[9] != TCP:
            others[packet[9], 0, 0].append(packet[head:])
            continue
        source, destination, number = struct.unpack_from("!HHI", packet, head)
        body = packet[head + 4 * (packet[head + 12] >> 4):]
        stream = streams[TCP, source, destination]
        # a connection that begins: its first byte has the next number
        if packet[head + 13] & 2:
            stream["first"] = number + 1
        elif body:
            stream[(number - stream["first"]) % (1 << 32)] = body
    whole = {key: b"".join(parts) for key, parts in others.items()}
    for key, stream in streams.items():
        stream.pop("first", None)
        joined = bytearray()
        for offset in sorted(stream):
            joined[offset:offset + len(stream[offset])] = stream[offset]
        whole[key] = bytes(joined)
    return whole
