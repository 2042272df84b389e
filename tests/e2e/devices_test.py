"""palpate devices and palpate doctor: what there is and what is missing, without a device on the machine. A stand-in for a
maker's library is felt with, where somebody sees it and from a page."""

import fcntl
import json
import os
import pty
import re
import shutil
import signal
import subprocess
import termios
import time

import cli
import live_session

DEVICE_FAULT = 2048  # a flag of a tick

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
        refused = self.expect_error(cli.USAGE, "explore", "knee-phantom", "--device", "spoon", message="spoon")
        for name in names:
            self.assertIn(name, refused.stderr)

    def test_each_device_once_and_the_simulated_hand_first(self):
        for devices, says in ((["pointer", "pointer"], "twice"), (["pointer", "simulated"], "first")):
            options = [word for name in devices for word in ("--device", name)]
            self.expect_error(cli.USAGE, "explore", "knee-phantom", *options, message=says)


class Doctor(cli.PalpateTest):
    def test_on_a_machine_with_nothing_every_fault_has_its_cure(self):
        done = cli.run("doctor", "--json", "--seconds", "0.2")
        report = json.loads(done.stdout)
        # no service of Haply's runs where tests do
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertFalse(report["ready"])
        topics = {line["topic"] for line in report["lines"]}
        self.assertEqual(topics, {"this computer", "haply", "force-dimension", "touch", "spacemouse", "tracker"})
        for line in report["lines"]:
            self.assertTrue(line["found"], line)
            self.assertEqual(bool(line["remedy"]), line["finding"] != "fine", line)
        missing = [line for line in report["lines"] if line["finding"] == "missing"]
        self.assertIn("haply", {line["topic"] for line in missing})
        self.assertGreater(report["timer"]["rate_hz"], 0)

    def test_names_the_file_that_is_missing(self):
        done = cli.run("doctor", "--json", "--seconds", "0.2", "--device", "force-dimension")
        lines = [line for line in json.loads(done.stdout)["lines"] if line["topic"] == "force-dimension"]
        self.assertIn("libdrd.so.3", lines[0]["found"])
        self.assertIn("forcedimension.com", lines[0]["remedy"])
        done = cli.run("doctor", "--json", "--seconds", "0.2", "--library", "force-dimension=/no/such.so")
        self.assertIn("there is no such file", done.stdout)
        done = cli.run("doctor", "--json", "--seconds", "0.2", "--device", "touch")
        self.assertIn("no libHD.so", done.stdout)
        for option, says in ((("--library", "spoon=x"), "spoon"), (("--library", "force-dimension"), "NAME=VALUE"),
                             (("--held-mass", "force-dimension=heavy"), "heavy"),
                             (("--held-mass", "force-dimension=-1"), "-1")):
            for verb in (("doctor",), ("devices",), ("explore", "knee-phantom")):
                self.expect_error(cli.USAGE, *verb, *option, message=says)

    def test_vendor_library_is_not_taken_from_the_environment(self):
        for device, variable, name in (("force-dimension", "FAKE_DRD", "libdrd.so.3"), ("touch", "FAKE_HD", "libHD.so")):
            library = self.folder / name
            library.symlink_to(os.environ[variable])
            environment = {**os.environ, "LD_LIBRARY_PATH": str(self.folder)}
            # the proof itself: a loader that is asked for the bare name finds it there
            subprocess.run([shutil.which("python3"), "-c", f"import ctypes; ctypes.CDLL('{name}')"], env=environment,
                           check=not cli.SANITIZED)
            looked = ("doctor", "--json", "--seconds", "0.2", "--device", device)
            done = cli.run(*looked, env=environment)
            line = [line for line in json.loads(done.stdout)["lines"] if line["topic"] == device][0]
            self.assertEqual(line["finding"], "missing", line)
            self.assertIn(f"no {name}", line["found"])
            # and one that is named is taken
            done = cli.run(*looked, "--library", f"{device}={library}")
            line = [line for line in json.loads(done.stdout)["lines"] if line["topic"] == device][0]
            self.assertEqual(line["finding"], "fine", line)
            self.assertIn(str(library), line["found"])

    @cli.long
    def test_what_a_hand_holds(self):
        self.expect_error(cli.USAGE, "doctor", "--hold", "spoon", message="spoon")
        self.expect_error(cli.UNAVAILABLE, "doctor", "--hold", "touch", message="libHD.so")
        # a weight that the device carries would come on top of the trial's newton
        self.expect_error(cli.USAGE, "doctor", "--hold", "touch", "--held-mass", "touch=0.1", message="--held-mass")
        # a device at which nobody presses the key is not tried
        library = f"touch={os.environ['FAKE_HD']}"
        self.expect_error(cli.USAGE, "doctor", "--hold", "touch", "--library", library, message="the device was not armed")
        # the simulated one is always held; on a machine with much else to do it is late, or late with the plant's forces,
        # and says so
        environment = {**os.environ, "XDG_DATA_HOME": str(self.folder)}
        kept = self.folder / "palpate" / "held-hands.txt"
        done = cli.run("doctor", "--hold", "simulated", "--json", env=environment)
        if done.returncode == cli.OK:
            figures = json.loads(done.stdout)
            self.assertGreater(figures["held_N_per_mm"], 0.09)
            self.assertLess(abs(figures["delay_s"] - 0.002), 0.002)
            self.assertIn(figures["device"], kept.read_text())
        else:
            self.assertEqual(done.returncode, cli.UNAVAILABLE, done.stderr)
            self.assertEqual(done.stderr.count("palpate: error:"), 1, done.stderr)
            self.assertFalse(kept.exists())
        # what it kept is read when a session begins
        kept.parent.mkdir(exist_ok=True)
        kept.write_text("# fine\nspoon\n")
        done = cli.run("explore", "knee-phantom", "--seconds", "0.2", "--no-viewer", env=environment)
        self.assertEqual(done.returncode, cli.BAD_INPUT)
        self.assertIn("held-hands.txt:2: ", done.stderr)

    def hold_at_a_terminal(self, **keyboard):
        terminal = live_session.Terminal("doctor", "--hold", "touch", "--library", f"touch={os.environ['FAKE_HD']}",
                                         keyboard=True, **keyboard)
        self.addCleanup(terminal.close)
        terminal.wait_for("any other key cancels")
        return terminal

    def test_what_was_typed_before_arms_nothing(self):
        # it is there before anybody asks
        terminal = self.hold_at_a_terminal(typed=b"a")
        # and so may be the first of these
        while terminal.process.poll() is None:
            os.write(terminal.master, b"x")
            time.sleep(0.2)
        ended, _ = terminal.finish()
        self.assertEqual(ended, cli.USAGE, terminal.shown)
        self.assertIn("the device was not armed", terminal.shown)

    @cli.long
    def test_interrupting_the_prompt_reports_no_missing_arming(self):
        terminal = self.hold_at_a_terminal()
        terminal.process.send_signal(signal.SIGINT)
        ended, _ = terminal.finish()
        self.assertEqual(ended, cli.INTERRUPTED, terminal.shown)
        self.assertNotIn("was not armed", terminal.shown)

    @cli.long
    def test_without_a_terminal_the_device_stays_unarmed(self):
        master, slave = pty.openpty()
        self.addCleanup(os.close, master)
        self.addCleanup(os.close, slave)
        os.write(master, b"aaa")
        done = subprocess.run([cli.PALPATE, "doctor", "--hold", "touch", "--library", f"touch={os.environ['FAKE_HD']}"],
                              stdin=slave, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=300,
                              start_new_session=True, preexec_fn=lambda: fcntl.ioctl(slave, termios.TIOCSCTTY, 0))
        self.assertEqual(done.returncode, cli.USAGE, done.stderr)
        self.assertIn("the device was not armed", done.stderr)

    @cli.long
    def test_in_words(self):
        done = cli.run("doctor", "--seconds", "0.2")
        self.assertEqual(done.returncode, 1)
        self.assertIn("MISSING", done.stdout)
        self.assertIn("what to do: ", done.stdout)
        self.assertIn("force-feedback devices are not ready on this computer", done.stdout)

    def test_of_a_device_that_is_not_known(self):
        self.expect_error(cli.USAGE, "doctor", "--device", "spoon", message="haply")


class Plugins(cli.PalpateTest):
    """A driver that palpate was not built with, in a process of its own."""

    def setUp(self):
        super().setUp()
        self.device = f"plugin={os.environ['TEST_PLUGIN']}"

    @cli.long
    def test_is_examined_and_refused_like_any_device(self):
        said = self.succeed("doctor", "--device", self.device, "--json", runner=self.either).stdout
        line = next(line for line in json.loads(said)["lines"] if line["topic"] == self.device)
        self.assertEqual((line["finding"], line["found"]), ("fine", "loads"))
        self.expect_error(cli.UNAVAILABLE, "explore", "knee-phantom:spacing=3", "--device", "plugin=/no/such.so", "--no-viewer",
                          message="cannot be loaded")

    def either(self, *arguments):
        """The machine may lack what doctor looks for."""
        done = cli.spawn(*arguments)
        done.returncode = cli.OK
        return done

    @cli.long
    def test_its_faults_end_in_zero_force_and_one_message(self):
        for fault, says in (("", ""), ("crash", "has ended by signal 11"), ("hang", "did not answer for 0.1 s"),
                            ("nan", "a pose that is not finite"), ("size", "a sample of another size")):
            with self.subTest(fault):
                recording = self.folder / f"{fault or 'fine'}.h5"
                done = self.succeed("explore", "knee-phantom:spacing=3", "--device", self.device, "--no-viewer", "--seconds", "2",
                                    "-o", recording, env={**os.environ, "PALPATE_TEST_PLUGIN": fault})
                self.assertEqual(done.stderr.count("libpalpate_test_plugin.so: "), 1 if fault else 0, done.stderr)
                self.assertIn(says, done.stderr)
                columns = cli.device_columns(recording, "flags", "force_N")
                faults = {flags & DEVICE_FAULT for flags in columns["flags"][-100:]}
                self.assertEqual(faults, {DEVICE_FAULT} if fault else {0})
                if fault:
                    self.assertFalse(any(any(force) for force in columns["force_N"][-100:]))

    @cli.long
    def test_its_recording_replays_to_the_hash_of_every_tick(self):
        recording = self.folder / "press.h5"
        self.succeed("explore", "knee-phantom:spacing=3", "--device", self.device, "--no-viewer", "--seconds", "2", "-o", recording,
                     env={**os.environ, "PALPATE_TEST_PLUGIN": "press"})
        self.assertTrue(any(any(force) for force in cli.device_columns(recording, "force_N")["force_N"]))
        self.succeed("replay", recording)


class Arming(cli.PalpateTest):
    """A device that pushes, as far as palpate can tell: 3D Systems' library is a stand-in."""

    def setUp(self):
        super().setUp()
        self.succeed("data", "fetch", "knee-phantom", "-o", self.folder / "knee", "--voxel", cli.KNEE_MM)
        self.scene = self.folder / "scene.toml"
        self.succeed("scene", "new", next((self.folder / "knee").glob("*.seg.nrrd")), "-o", self.scene)
        # far from the knee
        self.scene.write_text(self.scene.read_text() + "\n[workspace]\nhome = [0, 0, 500]\n")

    def begin(self):
        terminal = live_session.Terminal("explore", self.scene, "--device", "touch", "--library", f"touch={os.environ['FAKE_HD']}",
                                         "--port", "0", "-o", self.folder / "run.h5", keyboard=True)
        self.addCleanup(terminal.close)
        self.terminal = terminal
        terminal.wait_for(r"http://[\d.]+:\d+/")
        self.viewer = live_session.Viewer(re.search(r"http://[\d.]+:\d+/", terminal.shown).group())
        self.addCleanup(self.viewer.close)
        self.wait_for_state(lambda state: state.get("armed"))

    def wait_for_state(self, is_it):
        while not is_it(self.viewer.state):
            self.viewer.next()

    def code_of_a_stop(self):
        self.terminal.press(b" ")
        self.terminal.wait_for(r"EMERGENCY STOP: r rearms, page: \d{6}\b")
        self.wait_for_state(lambda state: state["emergency_stop"])
        return re.findall(r"page: (\d{6})\b", self.terminal.shown)[-1]

    def rearm(self, **answer):
        return self.viewer.ask(type="rearm", stop=self.viewer.state["stop"], **answer)

    @cli.long
    def test_what_a_hand_held_bounds_the_stiffness(self):
        kept = self.folder / "palpate" / "held-hands.txt"
        kept.parent.mkdir()
        # as Windows ends its lines, with a carriage return
        kept.write_bytes(b"# fine\r\n1000 0.002 0.1 0.12 Touch no. 4711\r\n")
        recording = self.folder / "held.h5"
        self.succeed("explore", self.scene, "--device", "touch", "--library", f"touch={os.environ['FAKE_HD']}",
                     "--seconds", "0.3", "--no-viewer", "-o", recording,
                     env={**os.environ, "XDG_DATA_HOME": str(self.folder)})
        bound = cli.device_columns(recording, "max_stiffness_N_per_mm")["max_stiffness_N_per_mm"][-1]
        self.assertAlmostEqual(bound, 0.6 * 0.12, msg="0.27 is careful")

    def test_from_a_page_by_the_code_that_the_terminal_shows_once(self):
        self.begin()
        code = self.code_of_a_stop()
        self.assertIn("at the device", self.rearm()["what"])
        wrong = str((int(code) + 1) % 1000000).zfill(6)
        self.assertEqual(self.rearm(code=wrong)["where"], "code")
        self.assertTrue(self.viewer.state["emergency_stop"])
        self.assertEqual(self.rearm(code=code)["type"], "done")
        self.wait_for_state(lambda state: state["armed"])
        self.terminal.shown = ""
        self.terminal.wait_for(r" N  [^E]*\r")
        # the next stop has a code of its own, and three wrong ones leave none
        another = self.code_of_a_stop()
        self.assertNotEqual(another, code)
        for _ in range(3):
            self.assertEqual(self.rearm(code=code)["type"], "refused")
        self.assertEqual(self.rearm(code=another)["where"], "code")
        self.terminal.shown = ""
        self.terminal.wait_for(r"EMERGENCY STOP: r rearms *\r")
        # the key needs none
        self.terminal.press(b"r")
        self.wait_for_state(lambda state: state["armed"])
        self.terminal.process.send_signal(signal.SIGINT)
        ended, out = self.terminal.finish()
        self.assertEqual(ended, cli.OK, self.terminal.shown)
        # nobody reads later what was shown
        for text in (out.encode(), (self.folder / "run.h5").read_bytes(), *self.viewer.texts):
            for shown in (code, another):
                self.assertNotIn(shown.encode(), text)


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
