"""Receives palpate's labels and their names by OpenIGTLink (docs/guide/openigtlink.md). Slicer's own connector receives
poses, forces and sections; it makes no node of LBMETA, and sends no request for images."""

import socket
import struct
import threading

import numpy as np

from .errors import PalpateError
from .grid import Grid

HEAD = struct.Struct(">H12s20sQQQ")
IMAGE_HEAD = struct.Struct(">HBBBB3H12f3H3H")
LISTED_LABEL = struct.Struct(">64s20sBB4B3H20s")
UINT16, LITTLE_ENDIAN, RAS = 5, 2, 1
# longest body that is read; the others end the connection
MAX_BODY_BYTES = 1 << 34
LABELS = "Labels"


def _text(field):
    return field.split(b"\0")[0].decode("utf-8", "replace")


def parse_image(body):
    """@returns (Grid, first, voxels) of an IMAGE of labels: the grid of the whole image, and the uint16 array of the box that
    the message has, whose first voxel is `first` (i, j, k)"""
    fields = IMAGE_HEAD.unpack_from(body)
    dims, matrix, first, part = fields[5:8], fields[8:20], fields[20:23], fields[23:26]
    # components, scalar type, endianness and coordinates
    if fields[1:5] != (1, UINT16, LITTLE_ENDIAN, RAS):
        raise ValueError("an image of another type")
    if len(body) != IMAGE_HEAD.size + 2 * part[0] * part[1] * part[2]:
        raise ValueError("an image of another size")
    if any(begin + count > whole for begin, count, whole in zip(first, part, dims)):
        raise ValueError("a box beyond the image")
    columns = np.array(matrix, dtype=float).reshape(4, 3).T
    steps = columns[:, :3]
    # the message has the position of the image's centre
    grid = Grid(dims, steps, columns[:, 3] - steps @ ((np.array(dims) - 1) / 2))
    return grid, first, np.frombuffer(body, dtype="<u2", offset=IMAGE_HEAD.size).reshape(part[::-1])


def parse_label_list(body):
    """@returns {label: (name, colour)} of an LBMETA"""
    listed = {}
    for at in range(0, len(body) - LISTED_LABEL.size + 1, LISTED_LABEL.size):
        name, _, label, _, red, green, blue, *_ = LISTED_LABEL.unpack_from(body, at)
        listed[label] = (_text(name), (red / 255, green / 255, blue / 255))
    return listed


class LabelsClient:
    """Receives the labels after each change, on a thread of its own, which ends with close()."""

    def __init__(self, host, port, timeout_s=10):
        where = f"{host}:{port}"
        try:
            self._socket = socket.create_connection((host, port), timeout=timeout_s)
        except OSError as error:
            raise PalpateError(f"cannot be reached ({error.strerror or error})", where,
                               "start palpate explore with --openigtlink there, and open this port") from error
        self._where = where
        self._lock = threading.Lock()
        self._names, self._image, self._failure, self._closed = None, None, None, False
        # the latest labels, whole; the receiving thread's
        self._voxels = None
        self._socket.settimeout(None)
        self._ask("GET_LBMETA", "")
        self._ask("STT_IMAGE", LABELS)
        self._thread = threading.Thread(target=self._receive, name="palpate labels", daemon=True)
        self._thread.start()

    def names(self):
        """{label: (name, colour)}; None before it has come. Labels above 255 are not in it."""
        with self._lock:
            return self._names

    def take(self):
        """The latest (Grid, voxels), once; None if nothing has changed.

        Raises PalpateError if the connection has ended.
        """
        with self._lock:
            image, self._image = self._image, None
            if image is None and self._failure is not None:
                raise PalpateError(self._failure, self._where, "the session may have ended: start it again")
            return image

    def close(self):
        with self._lock:
            self._closed = True
        try:
            self._socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self._thread.join()
        self._socket.close()

    def _ask(self, kind, name):
        # no body: its checksum is 0
        self._socket.sendall(HEAD.pack(1, kind.encode(), name.encode(), 0, 0, 0))

    def _read(self, count):
        data = bytearray(count)
        view = memoryview(data)
        while view:
            received = self._socket.recv_into(view)
            if received == 0:
                raise EOFError
            view = view[received:]
        return data

    def _receive(self):
        try:
            while True:
                self._take(*self._next())
        except (OSError, EOFError):
            failure = "the connection has ended"
        except (ValueError, struct.error, MemoryError) as error:
            failure = f"sends what is no label volume of palpate ({error})"
        with self._lock:
            if not self._closed:
                self._failure = failure

    def _next(self):
        version, kind, name, _, size, _ = HEAD.unpack(self._read(HEAD.size))
        if version not in (1, 2) or size > MAX_BODY_BYTES:
            raise ValueError("no OpenIGTLink message")
        return _text(kind), _text(name), self._read(size)

    def _take(self, kind, name, body):
        if kind == "LBMETA":
            names = parse_label_list(body)
            with self._lock:
                self._names = names
        elif kind == "IMAGE" and name == LABELS:
            grid, first, part = parse_image(body)
            if part.shape == grid.shape:
                self._voxels = part
            else:
                if self._voxels is None or self._voxels.shape != grid.shape:
                    raise ValueError("a box of an image that has not come")
                # those taken before stay as they are
                self._voxels = self._voxels.copy()
                box = tuple(slice(begin, begin + count) for begin, count in zip(first[::-1], part.shape))
                self._voxels[box] = part
            with self._lock:
                self._image = grid, self._voxels
