"""Files, names and surroundings that somebody else has made."""

import importlib.util
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import time

import bombs
import cli
from cli import BAD_INPUT, OK, OUTPUT, SANITIZED, KneeTest, PalpateTest
from volume_files import nrrd_header


class NotAFileTest(KneeTest):
    def test_a_pipe_is_refused_wherever_a_file_is_read(self):
        # nobody writes into it: whoever opens it as a file waits for ever, and for no signal
        pipes = {}
        for ending in ["h5", "nrrd", "toml", "tsv", "txt", "pem"]:
            pipes[ending] = self.folder / f"pipe.{ending}"
            os.mkfifo(pipes[ending])
        self.new_scene(self.scan, self.labels)
        scene = self.folder / "scene.toml"
        scene.write_text('[data]\nlabels = "pipe.nrrd"\n[[tissue]]\nname = "bone"\nlabels = [1]\npreset = "bone"\n')
        text = self.folder / "text"
        text.write_text("x")
        out = self.folder / "out"
        for arguments in [
                ["info", pipes["nrrd"]],
                ["info", pipes["toml"]],
                ["info", self.labels, "--names", pipes["tsv"]],
                ["scene", "new", pipes["nrrd"], "-o", out.with_suffix(".toml")],
                ["scene", "check", pipes["toml"]],
                ["scene", "check", scene],
                ["simulate", pipes["toml"]],
                ["simulate", scene],
                ["simulate", self.scene, "--script", pipes["toml"]],
                ["explore", pipes["toml"]],
                ["explore", scene],
                ["explore", self.scene, "--token-file", pipes["txt"]],
                ["explore", self.scene, "--tls-cert", pipes["pem"], "--tls-key", text],
                ["section", pipes["nrrd"], "-o", out.with_suffix(".png")],
                ["section", pipes["toml"], "-o", out.with_suffix(".png")],
                ["forces", pipes["toml"], "-o", out.with_suffix(".svg")],
                ["hold", pipes["toml"], "--at", "0,0,0"],
                ["prepare", pipes["nrrd"], "-o", out.with_suffix(".nrrd")],
                ["replay", pipes["h5"]],
                ["replay", pipes["h5"], "--view"],
                ["report", pipes["h5"]],
        ]:
            with self.subTest(arguments=arguments):
                self.expect_error(BAD_INPUT, *arguments, message="is a pipe, not a file")


class BombTest(KneeTest):
    """What is refused is refused with little: no bomb gets more memory than is allowed it."""

    MOST_MIB = 2048

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.new_scene(cls.scan, cls.labels)
        cls.refused = []

    @classmethod
    def tearDownClass(cls):
        if cls.refused:
            (slow_s, slow), (large_mib, large) = max((s, what) for s, _, what in cls.refused), max((mib, what) for _, mib, what in cls.refused)
            print(f"{len(cls.refused)} refusals of {len({what.split()[1] for _, _, what in cls.refused})} bombs, "
                  f"{slow_s:.1f} s of processor time at most ({slow}), {large_mib:.0f} MiB at most ({large})", flush=True)
        super().tearDownClass()

    def bombs(self, kind, *more):
        done = subprocess.run([sys.executable, bombs.__file__, kind, self.folder, *more], stdout=subprocess.PIPE, check=True)
        return {name: pathlib.Path(file) for name, file in json.loads(done.stdout).items()}

    def refuse(self, *arguments):
        """One clear error, within the memory that any file may take. The processor time that it took is printed in the end."""
        with open(self.folder / "stdout", "w+") as out, open(self.folder / "stderr", "w+") as err:
            process = subprocess.Popen([cli.PALPATE, *map(str, arguments), "--memory", "1G"], stdout=out, stderr=err,
                                       stdin=subprocess.DEVNULL)
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            err.seek(0)
            text = err.read()
        self.assertEqual(process.returncode, BAD_INPUT, text)
        self.assertEqual(text.count("palpate: error:"), 1, text)
        self.assertNotIn("bug:", text)
        max_mib = used.ru_maxrss / 1024
        if not SANITIZED:
            self.assertLess(max_mib, self.MOST_MIB, text)
        # its readers included
        took_s = used.ru_utime + used.ru_stime
        what = f"{arguments[0]} {pathlib.Path(arguments[-1]).name}"
        self.refused.append((took_s, max_mib, what))
        if os.environ.get("PALPATE_TEST_SAY"):
            print(f"{took_s:6.1f} s {max_mib:7.0f} MiB  {what}: {text.splitlines()[0][-110:]}")

    @cli.long
    def test_volumes(self):
        for name, file in self.bombs("volumes").items():
            with self.subTest(name):
                self.refuse("info", file)
        self.refuse("section", "-o", self.folder / "x.png", self.folder / "full.nrrd")
        self.refuse("simulate", self.folder / "short.nii.gz")
        self.refuse("prepare", "-o", self.folder / "x.nrrd", self.folder / "short.mha")

    @cli.long
    def test_texts(self):
        for name, file in self.bombs("texts").items():
            with self.subTest(name):
                if file.suffix == ".toml":
                    self.refuse("scene", "check", file)
                    self.refuse("simulate", self.scene, "--script", file)
                else:
                    self.refuse("info", self.labels, "--names", file)

    @cli.long
    def test_recordings(self):
        whole = self.folder / "whole.h5"
        self.assertIn(cli.run("simulate", self.scene, "-s", self.script, "-o", whole).returncode, [OK, cli.LIMIT])
        if importlib.util.find_spec("h5py") is None:
            cli.missing("python3-h5py")
        for name, file in self.bombs("recordings", whole).items():
            with self.subTest(name):
                self.refuse("replay", file)
                self.refuse("report", "-o", self.folder / "x.html", file)
        self.assertFalse((self.folder / "x.html").exists())

    def test_the_refusal_says_how_to_allow_more(self):
        large = self.folder / "large.nrrd"
        large.write_bytes(nrrd_header("512 512 256", "encoding: gzip\n") + bombs.zeros(64, bombs.gzip.compress))
        said = self.expect_error(BAD_INPUT, "info", "--scan", large, "--memory", "128M", message="128.0 MiB are allowed")
        more = re.search(r"--memory \d+M", said.stderr).group().split()
        if not SANITIZED:
            self.succeed("info", "--scan", large, *more)
        self.expect_error(cli.USAGE, "info", large, "--memory", "much", message="write it as 800M or 4G")


class LinkTest(PalpateTest):
    def test_a_data_file_stays_in_its_folder(self):
        home = self.folder / "home"
        home.mkdir()
        voxels = bytes(1000)
        (self.folder / "secret.raw").write_bytes(voxels)
        (home / "link.raw").symlink_to(self.folder / "secret.raw")
        (home / "way").symlink_to(self.folder)
        headers = {"link.nhdr": nrrd_header("10 10 10", "encoding: raw\ndata file: link.raw\n"),
                   "way.nhdr": nrrd_header("10 10 10", "encoding: raw\ndata file: way/secret.raw\n"),
                   "up.nhdr": nrrd_header("10 10 10", "encoding: raw\ndata file: ../secret.raw\n"),
                   "link.mhd": bombs.metaimage("10 10 10", "ElementDataFile = link.raw"),
                   "link.hdr": bombs.nifti(10, 10, 10, b"ni1\0")}
        (home / "link.img").symlink_to(self.folder / "secret.raw")
        for name, header in headers.items():
            with self.subTest(name):
                (home / name).write_bytes(header)
                self.expect_error(BAD_INPUT, "info", home / name, message="--follow-links")
                self.succeed("info", "--scan", home / name, "--follow-links")
        # what a person names is followed, and so is what stays inside
        (home / "real.raw").write_bytes(voxels)
        (home / "inside.raw").symlink_to("real.raw")
        (home / "inside.nhdr").write_bytes(nrrd_header("10 10 10", "encoding: raw\ndata file: inside.raw\n"))
        (self.folder / "named").symlink_to(home)
        self.succeed("info", "--scan", self.folder / "named" / "inside.nhdr")

    def test_a_scene_reaches_what_it_says_and_not_where_links_lead(self):
        home = self.folder / "home"
        home.mkdir()
        volume = self.folder / "labels.nrrd"
        volume.write_bytes(nrrd_header("10 10 10", "encoding: raw\n") + bytes(400) + b"\1" * 200 + bytes(400))
        (home / "link.nrrd").symlink_to(volume)
        tissue = '\n[[tissue]]\nname = "bone"\nlabels = [1]\npreset = "bone"\n'
        scene = home / "scene.toml"
        for name in ["../labels.nrrd", str(volume)]:
            scene.write_text(f'[data]\nlabels = "{name}"' + tissue)
            self.succeed("scene", "check", scene)
        scene.write_text('[data]\nlabels = "link.nrrd"' + tissue)
        self.expect_error(BAD_INPUT, "scene", "check", scene, message="--follow-links")
        self.succeed("scene", "check", scene, "--follow-links")


class OneWriterTest(KneeTest):
    @cli.long
    def test_a_second_run_on_one_output_is_refused_at_its_start(self):
        self.new_scene(self.scan, self.labels)
        recording = self.folder / "run.h5"
        with subprocess.Popen([cli.PALPATE, "explore", self.scene, "-o", recording, "--no-viewer", "--seconds", "300"],
                              stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL) as first:
            try:
                while not recording.exists() and first.poll() is None:
                    time.sleep(0.05)
                says = f"is being written by another run (process {first.pid})"
                self.expect_error(OUTPUT, "simulate", self.scene, "-o", recording, message=says)
                self.expect_error(OUTPUT, "explore", self.scene, "-o", recording, message=says)
                (self.folder / "link.h5").symlink_to("run.h5")
                self.expect_error(OUTPUT, "simulate", self.scene, "-o", self.folder / "link.h5", message=says)
                self.assertIsNone(first.poll())
            finally:
                first.kill()
        # a killed run claims nothing, and what it left goes
        self.assertIn(cli.run("simulate", self.scene, "-s", self.script, "-o", recording).returncode, [OK, cli.LIMIT])
        self.assertEqual(sorted(p.name for p in self.folder.iterdir()), ["link.h5", "run.h5"])


class SurroundingsTest(KneeTest):
    def test_no_library_is_loaded_that_the_environment_names(self):
        code = pathlib.Path(os.environ["FOREIGN_CODE"])
        shutil.copy(code, self.folder)
        proof = self.folder / "proof"
        settings = self.folder / "openssl.cnf"
        settings.write_text("openssl_conf = init\n[init]\nproviders = all\n[all]\nforeign = it\n"
                            f"[it]\nmodule = {code}\nactivate = 1\n")
        tokens = self.folder / "tokens"
        tokens.write_text("control " + "a" * 40 + "\nnonsense\n")
        tokens.chmod(0o600)
        environment = {**os.environ, "FOREIGN_CODE_RAN": str(proof), "OPENSSL_CONF": str(settings)}
        for name in ["ITK_AUTOLOAD_PATH", "HDF5_PLUGIN_PATH", "OPENSSL_MODULES", "OPENSSL_ENGINES", "GCONV_PATH"]:
            environment[name] = str(self.folder)
        self.new_scene(self.scan, self.labels)
        for arguments in [["info", self.labels], ["section", self.scan, "-o", self.folder / "x.png"],
                          ["simulate", self.scene, "-s", self.script, "-o", self.folder / "x.h5"], ["replay", self.folder / "x.h5", self.scene],
                          ["explore", self.scene, "--token-file", tokens, "--listen", "127.0.0.1"]]:
            with self.subTest(arguments=arguments):
                proof.unlink(missing_ok=True)
                cli.run(*arguments, env=environment)
                self.assertFalse(proof.exists(), f"palpate {arguments} loaded it")
        # the proof itself: who loads the code makes the file
        subprocess.run([shutil.which("python3"), "-c", f"import ctypes; ctypes.CDLL('{code}')"], env=environment,
                       check=not SANITIZED)
        self.assertTrue(proof.exists() or SANITIZED)


# what a terminal or a page would obey, each as Python says it in a text; the byte 0x9b is no UTF-8 by itself
CANARIES = "\x1b\r\x07\x7f\u009b\u202e\u2066\udc9b"


class CanaryTest(PalpateTest):
    """Names that command terminals, in every place where a name can stand."""

    def say(self, *arguments, files=()):
        """Runs palpate; nothing that it prints or writes commands anything."""
        done = subprocess.run([cli.PALPATE, *map(str, arguments)], capture_output=True, stdin=subprocess.DEVNULL, timeout=600)
        said = {"stdout": done.stdout, "stderr": done.stderr}
        said.update({str(file): file.read_bytes() for file in files if file.exists()})
        for where, content in said.items():
            self.assert_tame(content, f"{where} of {arguments}")
        self.assertNotIn(b"bug:", done.stderr)
        return done

    def assert_tame(self, content, what):
        # strict: whatever is no UTF-8 is an error of its own
        found = [ascii(c) for c in CANARIES if c in content.decode()]
        self.assertEqual(found, [], f"{what}: {ascii(content[:400])}")

    def everything(self, name):
        """Every verb on files of that name, with structures, titles and fields of that name."""
        folder = self.folder / f"folder {name}"
        folder.mkdir()
        written = name.encode(errors="surrogateescape")
        in_toml = "".join(f"\\u{ord(c):04x}" if c in CANARIES else c for c in name if c != "\udc9b")
        side = 32
        block = bytearray(side**3)
        for k in range(8, 24):
            for j in range(8, 24):
                block[(k * side + j) * side + 8:(k * side + j) * side + 24] = b"\1" * 16
        geometry = "space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\nencoding: raw\n"
        labels = folder / f"{name}.seg.nrrd"
        fields = b"Segment0_ID:=a" + written + b"\nSegment0_Name:=" + written + b"\nSegment0_LabelValue:=1\n" + written + b":=x\n"
        labels.write_bytes(nrrd_header(f"{side} {side} {side}", geometry + "content: ")[:-1] + written + b"\n" + fields + b"\n" + block)
        plain = folder / f"plain {name}.nrrd"
        plain.write_bytes(nrrd_header(f"{side} {side} {side}", geometry) + block)
        table = folder / f"{name}.tsv"
        table.write_bytes(b"value\tname\n1\t" + written + b"\n")
        scene, script = folder / f"{name}.toml", folder / f"script {name}.toml"
        scene.write_text(f'title = "{in_toml}"\n[data]\nlabels = "{plain.name if name.isprintable() else "plain.nrrd"}"\n'
                         f'[tool]\nname = "{in_toml}"\n[[tissue]]\nname = "{in_toml}"\nlabels = [1]\npreset = "bone"\n')
        (folder / "plain.nrrd").write_bytes(plain.read_bytes())
        (folder / "plain.tsv").write_bytes(table.read_bytes())
        script.write_text(f'title = "{in_toml}"\n[[step]]\napproach = "{in_toml}"\n')
        run, page = folder / f"{name}.h5", folder / f"{name}.html"
        picture, field = folder / f"{name}.svg", folder / f"{name}.nrrd"

        for target in [labels, plain, table, scene, script, folder, folder / f"no {name}"]:
            self.say("info", target)
            self.say("info", target, "--json")
            self.say("scene", "check", target)
        self.say("info", plain, "--names", table)
        self.say("scene", "new", labels, "-o", folder / f"new {name}.toml")
        self.say("scene", "new", labels)
        self.say("scene", "check", folder / f"new {name}.toml")
        self.say("prepare", labels, "-o", field)
        self.say("section", scene, "-o", folder / f"{name}.png")
        self.say("forces", scene, "-o", picture, files=[picture])
        self.say("hold", scene, "--voxel", "15,15,23", "-o", picture, files=[picture])
        done = self.say("simulate", scene, "-o", run, "--report", page, files=[page])
        self.say("simulate", scene, "--script", script)
        self.say("replay", run, scene)
        self.say("report", run, scene, "-o", page, files=[page])
        self.say("replay", scene)
        self.say("report", folder / f"no {name}")
        self.say("explore", scene, "--seconds", "0.3", "--port", "0", "-o", folder / f"live {name}.h5")
        self.say("explore", scene, "--token-file", table, "--listen", name)
        self.say("explore", scene, "--tls-cert", table, "--tls-key", labels)
        self.say("data", "fetch", name)
        self.say("data", "path", name)
        self.say("verify", name)
        self.say(name)
        self.say("info", f"--{name}", labels)
        self.say("info", labels, "--memory", name)
        self.say("help", name)
        return done

    def test_no_name_commands_the_terminal(self):
        done = self.everything("a" + "b".join(CANARIES) + "z")
        self.assertIn(b"\\u001b", done.stderr)

    @cli.long
    def test_nor_where_names_are_taken(self):
        # a structure's name may hold these
        done = self.everything("a\u202eb\u2066c")
        self.assertEqual(done.returncode in (OK, cli.LIMIT), True, done.stderr)
        self.assertIn(b"\\u202e", done.stdout)

    def test_the_bar_on_a_terminal_is_ours_alone(self):
        master, slave = os.openpty()
        file = self.folder / f"a{CANARIES}.nrrd"
        file.write_bytes(nrrd_header("128 128 128", "encoding: gzip\n") + bombs.zeros(16, bombs.gzip.compress))
        with subprocess.Popen([cli.PALPATE, "info", "--scan", file], stdin=subprocess.DEVNULL, stdout=slave, stderr=slave):
            os.close(slave)
            said = b""
            try:
                while piece := os.read(master, 65536):
                    said += piece
            except OSError:
                pass  # Linux's way to say that nobody is there any more
        os.close(master)
        self.assert_tame(said.replace(b"\r\x1b[K", b"").replace(b"\r\n", b"\n"), "the terminal")


if __name__ == "__main__":
    cli.spawn_only()
    cli.main()
