"""A tracked tool live, from its tip to the patient: palpate pivot, register and explore over a tracker's stream, which this script
sends as PLUS does."""

import json
import math
import random
import signal
import socket
import struct
import subprocess
import threading
import time

import cli
from poses import POINTS, at, composed, rotated, times

TOOL, REFERENCE = "StylusToTracker", "ReferenceToTracker"
TIP = (-17.8, 1.1, -156.9)  # in the tool's frame, mm
PLACE = (12.0, -60.0, 8.0)  # in the patient, where the tip is held at the end
FLE_MM = 0.4


# the patient in the coordinates of the markers on it
REFERENCE_FROM_PATIENT = rotated((1, 2, 3), 0.7), [100.0, -50.0, 90.0]


def tool_at(place, turn):
    """The tool's pose in the reference's coordinates whose tip is at a place there."""
    return turn, [a - b for a, b in zip(place, times(turn, TIP))]


def crc64(data):
    crc = 0
    for byte in data:
        crc ^= byte << 56
        for _ in range(8):
            crc = (crc << 1 ^ (0x42F0E1EBA9EA3693 if crc >> 63 else 0)) & 0xFFFFFFFFFFFFFFFF
    return crc


def transform(name, pose, stamp_s):
    """A message of version 1."""
    rotation, shift = pose
    body = struct.pack(">12f", *(rotation[r][c] for c in range(3) for r in range(3)), *shift)
    return struct.pack(">H12s20sQQQ", 1, b"TRANSFORM", name.encode(), int(stamp_s * 2**32), len(body), crc64(body)) + body


class Tracker:
    """A server that sends 100 times a second what `pose(now)` says of the tool in the reference's coordinates. The patient moves all
    the while."""

    def __init__(self, pose):
        self.pose = pose
        self.drop_after_s = None  # the next connection, once
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self._socket.getsockname()[1]}"
        self._end = False
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def close(self):
        self._end = True
        self._thread.join()
        self._socket.close()

    def _serve(self):
        self._socket.settimeout(0.1)
        while not self._end:
            try:
                client, _ = self._socket.accept()
            except TimeoutError:
                continue
            with client:
                until = time.monotonic() + (self.drop_after_s or math.inf)
                self.drop_after_s = None
                try:
                    while not self._end and time.monotonic() < until:
                        now = time.monotonic()
                        reference = rotated((0, 1, 0.2), 0.2 * math.sin(now)), [20 * math.sin(0.7 * now), 5.0, 900.0]
                        tool = self.pose(now)
                        client.sendall(transform(TOOL, composed(reference, tool), now) + transform(REFERENCE, reference, now))
                        time.sleep(0.01)
                except OSError:
                    pass


class Swinging:
    """About the tip, in a dimple that is fixed to the reference."""

    def __init__(self):
        self.random = random.Random(7)
        self.turn = rotated((1, 0, 0), 0.3)

    def __call__(self, now):
        self.turn = rotated([self.random.gauss(0, 1) for _ in range(3)], self.random.gauss(0, 0.5))
        return tool_at((40, 30, 20), self.turn)


class Touching:
    """One point after the other, held for 1.3 s each."""

    def __init__(self, places, held_s=1.3):
        self.places, self.held_s, self.begun = places, held_s, None

    def __call__(self, now):
        self.begun = self.begun or now
        turn = int((now - self.begun) / self.held_s)
        place = self.places[min(turn, len(self.places) - 1)]
        return tool_at(at(REFERENCE_FROM_PATIENT, place), rotated((1, turn, 0), 0.4))


class Live(cli.PalpateTest):
    def serve(self, pose):
        tracker = Tracker(pose)
        self.addCleanup(tracker.close)
        return tracker

    def write(self, name, text):
        file = self.folder / name
        file.write_text(text)
        return file

    def scan(self):
        return self.write("scan.csv", "".join(f"{name},{x},{y},{z}\n" for name, (x, y, z) in POINTS.items()))

    def test_from_the_tip_to_the_patient_and_how_wrong_it_may_be(self):
        tip_file, registration_file, run_file = (self.folder / name for name in ("tip.json", "registration.json", "run.h5"))
        # in the reference's coordinates, so that both may move
        tracker = self.serve(Swinging())
        stream = ("--transform", TOOL, "--reference", REFERENCE)
        done = self.succeed("pivot", tracker.address, *stream, "-o", tip_file)
        # 200 are enough; one more may have come before it looked
        self.assertRegex(done.stdout, r"of 2\d\d poses")
        tip = json.loads(tip_file.read_text())
        self.assertLess(math.dist(tip["tip_mm"], TIP), 1e-3)

        tracker.pose = Touching(list(POINTS.values()))
        done = self.succeed("register", self.scan(), tracker.address, *stream, "--tip", tip_file, "--fle", FLE_MM,
                            "--target=" + ",".join(map(str, PLACE)), "-o", registration_file)
        self.assertIn("touch medial (1 of 5)", done.stderr)
        self.assertIn("fibula: recorded, held within 0.00 mm", done.stderr)
        registration = json.loads(registration_file.read_text())
        self.assertEqual(registration["reference"], REFERENCE)
        self.assertEqual([point["name"] for point in registration["by_points"]["points"]], list(POINTS))

        # the tip is where it is in the patient, however that moves; a connection that is lost comes back
        tracker.pose = Touching([PLACE])
        explored = ("explore", f"knee-phantom:spacing={cli.KNEE_MM}", "--device", "tracker", "--tracker", tracker.address, *stream,
                    "--tip", tip_file, "--registration", registration_file, "--no-viewer", "--no-realtime", "--no-supervisor")
        tracker.drop_after_s = 2
        done = self.succeed(*explored, "--seconds", 3, "-o", run_file)
        self.assertIn("has closed the connection", done.stderr)
        self.assertIn("the device is ready again", done.stderr)
        for place in cli.device_columns(run_file, "tip_patient_mm")["tip_patient_mm"]:
            self.assertLess(math.dist(place, PLACE), 0.01)
        # the registration's own error there, as its file has it, and the tool's
        target, = registration["by_points"]["targets"]
        rms_mm = math.sqrt(target["tre_rms_mm"] ** 2 + tip["tip_error_mm"] ** 2 + tip["rms_mm"] ** 2)
        self.assertIn(f"error of the tracked tip {rms_mm:.3f} mm (TRE, root mean square), below {target['tre_95_mm']:.3f} in 95", done.stdout)
        self.assertIn(f"residual at the points {registration['by_points']['fre_mm']:.3f} mm (FRE)", done.stdout)

        # what does not fit together is one error
        mixed = [REFERENCE if argument == TOOL else TOOL if argument == REFERENCE else argument for argument in explored]
        self.expect_error(cli.BAD_INPUT, *mixed, message=f"was made in the coordinates of {REFERENCE}")
        self.expect_error(cli.USAGE, *explored, "-o", tip_file, message="would replace an input")

    def test_what_is_missing_or_too_little_is_refused_and_nothing_is_written(self):
        still = lambda now: tool_at((40, 30, 20), rotated((1, 0, 0), 0.3))  # noqa: E731
        tracker = self.serve(still)
        out = self.folder / "tip.json"
        self.expect_error(cli.USAGE, "pivot", tracker.address, message="--transform")
        self.expect_error(cli.UNAVAILABLE, "pivot", tracker.address, "--transform", "ProbeToTracker", "-o", out, message=f"it sends: {REFERENCE}, {TOOL}")
        self.expect_error(cli.UNAVAILABLE, "pivot", "127.0.0.1:1", "--transform", TOOL, message="does not answer")
        self.expect_error(cli.USAGE, "register", self.scan(), tracker.address, "--transform", TOOL, message="--tip")
        ill = self.write("ill.json", "{}")
        self.expect_error(cli.BAD_INPUT, "register", self.scan(), tracker.address, "--transform", TOOL, "--tip", ill, message="tip_mm")
        scene = ("explore", "knee-phantom", "--device", "tracker", "--no-viewer")
        self.expect_error(cli.USAGE, *scene, "--tracker", tracker.address, message="--transform")
        self.expect_error(cli.BAD_INPUT, *scene, "--tracker", tracker.address, "--transform", TOOL, "--tip", ill, "--registration", ill, message="tip_mm")
        self.expect_error(cli.USAGE, "devices", "--tracker", "nowhere", message="HOST:PORT")
        self.assertIn(f"{TOOL}: ready", self.succeed("devices", "--tracker", tracker.address).stdout)

        # ended by hand: a tool that hardly turned, and a registration half way
        tracker.pose = lambda now: tool_at((40, 30, 20), rotated((1, 0, 0), 0.05 * math.sin(5 * now)))
        self.assertIn("hardly turned", self.interrupted("pivot", tracker.address, "--transform", TOOL, "--reference", REFERENCE, "-o", out, code=cli.BAD_INPUT))
        tip = self.write("tip.json", json.dumps({"tip_mm": TIP, "tip_error_mm": 0.1, "rms_mm": 0.2}))
        registration = self.folder / "registration.json"
        self.interrupted("register", self.scan(), tracker.address, "--transform", TOOL, "--reference", REFERENCE, "--tip", tip, "-o", registration, code=cli.INTERRUPTED)
        self.assertEqual(sorted(file.name for file in self.folder.iterdir()), ["ill.json", "scan.csv", "tip.json"])

    def interrupted(self, *arguments, code):
        process = subprocess.Popen([cli.PALPATE, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True)
        cli.wait_for_handler(process)
        time.sleep(1.5)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
        self.assertEqual(process.returncode, code, said)
        return said


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
