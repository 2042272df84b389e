"""palpate devices and palpate doctor: what there is and what is missing, without a device on the machine."""

import json
import os
import tempfile

import cli


class Devices(cli.PalpateTest):
    def test_lists_what_explore_knows(self):
        known = json.loads(self.succeed("devices", "--json").stdout)["devices"]
        names = [device["name"] for device in known]
        self.assertEqual(names[:2], ["simulated", "pointer"])
        self.assertIn("haply", names)
        self.assertIn("force-dimension", names)
        self.assertIn("touch", names)
        self.assertIn("spacemouse", names)
        text = self.succeed("devices").stdout
        for device in known:
            self.assertIn(device["name"], text)
            self.assertIn(device["what"], text)
        # and an unknown one's error names the same
        refused = self.fail_clearly(cli.USAGE, "explore", "knee-phantom", "--device", "spoon", says="spoon")
        for name in names:
            self.assertIn(name, refused.stderr)

    def test_each_device_once_and_the_simulated_hand_first(self):
        for devices, says in ((["pointer", "pointer"], "twice"), (["pointer", "simulated"], "first")):
            options = [word for name in devices for word in ("--device", name)]
            self.fail_clearly(cli.USAGE, "explore", "knee-phantom", *options, says=says)


class Doctor(cli.PalpateTest):
    def test_on_a_machine_with_nothing_every_fault_has_its_cure(self):
        done = cli.run("doctor", "--json", "--seconds", "0.2")
        report = json.loads(done.stdout)
        # no service of Haply's runs where tests do
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertFalse(report["ready"])
        topics = {line["topic"] for line in report["lines"]}
        self.assertEqual(topics, {"this computer", "haply", "force-dimension", "touch", "spacemouse"})
        for line in report["lines"]:
            self.assertTrue(line["found"], line)
            self.assertEqual(bool(line["cure"]), line["finding"] != "fine", line)
        missing = [line for line in report["lines"] if line["finding"] == "missing"]
        self.assertIn("haply", {line["topic"] for line in missing})
        self.assertGreater(report["timer"]["rate_hz"], 0)

    def test_names_the_file_that_is_missing(self):
        done = cli.run("doctor", "--json", "--seconds", "0.2", "--device", "force-dimension")
        lines = [line for line in json.loads(done.stdout)["lines"] if line["topic"] == "force-dimension"]
        self.assertIn("libdrd.so.3", lines[0]["found"])
        self.assertIn("forcedimension.com", lines[0]["cure"])
        done = cli.run("doctor", "--json", "--seconds", "0.2", "--library", "force-dimension=/no/such.so")
        self.assertIn("there is no such file", done.stdout)
        done = cli.run("doctor", "--json", "--seconds", "0.2", "--device", "touch")
        self.assertIn("no libHD.so", done.stdout)
        for option, says in ((("--library", "spoon=x"), "spoon"), (("--library", "force-dimension"), "NAME=VALUE"),
                             (("--held-mass", "force-dimension=heavy"), "heavy"),
                             (("--held-mass", "force-dimension=-1"), "-1")):
            for verb in (("doctor",), ("devices",), ("explore", "knee-phantom")):
                self.fail_clearly(cli.USAGE, *verb, *option, says=says)

    def test_what_a_hand_holds(self):
        self.fail_clearly(cli.USAGE, "doctor", "--hold", "spoon", says="spoon")
        self.fail_clearly(cli.UNAVAILABLE, "doctor", "--hold", "touch", says="libHD.so")
        # a device at which nobody holds a key down is not tried; the simulated one is always held, and a machine
        # with much else to do is late and says so
        with tempfile.TemporaryDirectory() as folder:
            env = dict(os.environ, XDG_DATA_HOME=folder)
            done = cli.run("doctor", "--hold", "simulated", "--json", env=env)
            if done.returncode == cli.OK:
                figures = json.loads(done.stdout)
                self.assertGreater(figures["held_N_per_mm"], 0.09)
                self.assertLess(abs(figures["delay_s"] - 0.002), 0.002)
                with open(os.path.join(folder, "palpate", "held-hands.txt")) as kept:
                    self.assertIn(figures["device"], kept.read())
            else:
                self.assertIn("palpate doctor says of this computer", done.stderr)
            os.makedirs(os.path.join(folder, "palpate"), exist_ok=True)
            with open(os.path.join(folder, "palpate", "held-hands.txt"), "w") as kept:
                kept.write("# fine\nspoon\n")
            done = cli.run("explore", "knee-phantom", "--seconds", "0.2", "--no-viewer", env=env)
            self.assertEqual(done.returncode, cli.BAD_INPUT)
            self.assertIn("held-hands.txt:2: ", done.stderr)

    def test_in_words(self):
        done = cli.run("doctor", "--seconds", "0.2")
        self.assertEqual(done.returncode, 1)
        self.assertIn("MISSING", done.stdout)
        self.assertIn("what to do: ", done.stdout)
        self.assertIn("a device that pushes is not ready here", done.stdout)

    def test_of_a_device_that_is_not_known(self):
        self.fail_clearly(cli.USAGE, "doctor", "--device", "spoon", says="haply")


if __name__ == "__main__":
    cli.main()
