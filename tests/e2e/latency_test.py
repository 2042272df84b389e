"""palpate verify latency: figures, notes, refusals, and an interrupt in the middle of it."""

import json
import signal
import subprocess
import time

import cli


class Latency(cli.PalpateTest):
    @cli.long
    def test_figures_and_notes_of_one_rate(self):
        file = self.folder / "latency.json"
        done = cli.run("verify", "latency", "--seconds", "0.2", "--rate", "1000", "--spin", "80", "--json", file)
        # 3: a limit is broken, which a machine busy with other tests may do
        self.assertIn(done.returncode, (cli.OK, cli.LIMIT), done.stderr)
        for name in ("scheduler", "1-kHz/lateness/servo", "free-running/trilinear/rate", "limits kept"):
            self.assertIn(name, done.stdout)
        written = json.loads(file.read_text())
        self.assertEqual(set(written["notes"]), {"scheduler", "memory", "scene", "pace", "founding"})
        self.assertIn("spin 80 us", written["notes"]["pace"])
        figures = written["figures"]
        self.assertEqual(figures["1-kHz/ticks/dropped"]["value"], 0)
        self.assertEqual(figures["1-kHz/ticks/dropped"]["limit"], 0)
        self.assertGreater(figures["1-kHz/compute/p50"]["n"], 0)
        self.assertGreater(figures["1-kHz/share/contact"]["value"], 90, "the hand strokes")
        self.assertGreater(figures["free-running/trilinear/of-R4400/tick"]["value"], 1)

    def test_options_that_cannot_be(self):
        self.expect_error(cli.USAGE, "verify", "accuracy", "--seconds", "1", message="'accuracy' takes no --seconds")
        self.expect_error(cli.USAGE, "verify", "accuracy", "--scene", "head", message="'accuracy' takes no --scene")
        for option, value in (("--seconds", "0"), ("--seconds", "nan"), ("--rate", "20"), ("--rate", "20000"),
                              ("--spin", "-1")):
            with self.subTest(f"{option} {value}"):
                self.expect_error(cli.USAGE, "verify", "latency", option, value)
        self.expect_error(cli.BAD_INPUT, "verify", "latency", "--scene", "elbow", message="elbow")

    @cli.long
    def test_an_interrupt(self):
        # while the scene is made, and while the loops run
        for delay_s in (0.3, 3):
            with self.subTest(delay_s):
                process = subprocess.Popen([cli.PALPATE, "verify", "latency", "--seconds", "60",
                                            "--json", str(self.folder / "latency.json")], stdout=subprocess.PIPE,
                                           stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True)
                cli.wait_for_handler(process)
                time.sleep(delay_s)
                process.send_signal(signal.SIGINT)
                out, err = process.communicate(timeout=600)
                self.assertEqual(process.returncode, cli.INTERRUPTED, err)
                self.assertIn("interrupted", err)
                self.assertEqual(out, "")
        self.assertEqual(list(self.folder.iterdir()), [])


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
