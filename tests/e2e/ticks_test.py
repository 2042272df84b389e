"""Every tick of a session comes to a viewer that asks for it, in bundles.

    PALPATE_TEST_SECONDS   how long they are received, 60 without it
"""

import os
import pathlib
import re
import signal
import struct
import subprocess
import sys

import cli

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import tick_stream


class Ticks(cli.PalpateTest):
    def viewer(self, *arguments, **hello):
        program = subprocess.Popen([cli.PALPATE, "explore", "knee-phantom:spacing=3", "--port", "0", "--repeat", *arguments],
                                   text=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        self.addCleanup(program.stderr.close)
        self.addCleanup(program.wait)
        self.addCleanup(program.send_signal, signal.SIGINT)
        for line in program.stderr:
            if found := re.search(r"open http://127\.0\.0\.1:(\d+)/", line):
                break
        else:
            self.fail("it prints no address")
        viewer = tick_stream.TickViewer(int(found.group(1)), **hello)
        self.addCleanup(viewer.close)
        return viewer

    def receive(self, rate_hz, seconds):
        """Until so many ticks have come; the greatest force of them, and how many ticks there were for a bundle."""
        viewer = self.viewer("--rate", str(rate_hz), ticks=True, poses_hz=60)
        ticks, bundles, largest_N, lost = 0, 0, 0.0, 0
        last = None
        while ticks < rate_hz * seconds:
            sequence, lost, received = tick_stream.read_bundle(viewer.binary(b"PLPB"))
            bundles += 1
            self.assertEqual(sequence, bundles)
            for tick in received:
                self.assertTrue(last is None or tick["tick"] > last)
                last = tick["tick"]
                largest_N = max(largest_N, sum(f * f for f in tick["device"][0]["force_N"]) ** 0.5)
            ticks += len(received)
        # what the session itself has dropped, if anything, is no fault of the stream
        dropped = struct.unpack_from("<I", viewer.binary(b"PLPT"), 88)[0]
        self.assertLessEqual(lost, dropped)
        return ticks / bundles, largest_N

    @cli.long
    def test_none_is_lost_at_1_khz(self):
        ticks_each, largest_N = self.receive(1000, float(os.environ.get("PALPATE_TEST_SECONDS", "60")))
        self.assertGreater(ticks_each, 10)
        self.assertGreater(largest_N, 0.2)

    def test_they_come_at_4_khz(self):
        self.assertGreater(self.receive(4000, 0.5)[0], 40)


if __name__ == "__main__":
    cli.main()
