"""Prepared models are cached and reused; a missing, limited or shared cache never changes a result."""

import os
import stat
import subprocess

import cli
from canary_files import CANARY


class Cache(cli.KneeTest):
    def setUp(self):
        super().setUp()
        self.kept = self.folder / "home" / ".cache" / "palpate"
        self.environment = {name: value for name, value in os.environ.items()
                            if name not in ("PALPATE_CACHE", "PALPATE_CACHE_LIMIT", "XDG_CACHE_HOME")}
        self.environment["HOME"] = str(self.folder / "home")

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.new_scene(cls.scan, cls.labels)

    def simulate(self, *options, scene=None, **environment):
        """The hash of a run, and what was said besides how far it has got."""
        done = self.succeed(*options, "simulate", scene or self.scene, "--script", self.script,
                            env={**self.environment, **environment})
        said = [line for line in done.stderr.splitlines() if not line.endswith(" %")]
        return cli.run_hash(done.stdout), said

    def entries(self):
        return sorted(path.name for path in self.kept.iterdir()) if self.kept.exists() else []

    def palpate_cache(self, verb):
        return self.succeed("cache", verb, env=self.environment).stdout

    def test_a_second_run_is_the_same_and_keeps_nothing_more(self):
        first, said = self.simulate()
        entries = self.entries()
        self.assertGreater(len(entries), 4)
        self.assertEqual(self.simulate(), (first, said))
        self.assertEqual(self.entries(), entries)
        self.assertEqual(self.simulate("--no-cache"), (first, said))
        # for its owner alone
        self.assertEqual(stat.S_IMODE(self.kept.stat().st_mode), 0o700)
        for path in self.kept.iterdir():
            self.assertEqual(stat.S_IMODE(path.stat().st_mode), 0o600)

    def test_the_stable_stiffness_of_a_device_is_searched_once(self):
        # in processes of their own, since a process also keeps the number in memory
        def run():
            return subprocess.run([cli.PALPATE, "simulate", self.scene, "--script", self.script, "--rate", "250"],
                                  stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=self.environment, check=True).stdout

        first = run()
        # one number, behind the header of an entry
        entry, = [path for path in self.kept.iterdir() if path.stat().st_size == 64 + 8]
        number = entry.stat().st_ino
        os.utime(entry, (0, 0))
        self.assertEqual(run(), first)
        # used, which makes it recent, and not written again
        self.assertGreater(entry.stat().st_mtime, 0)
        self.assertEqual(entry.stat().st_ino, number)

    def test_it_is_shown_and_emptied(self):
        self.assertIn("kept\t0 entries", self.palpate_cache("show"))
        self.simulate()
        shown = self.palpate_cache("show")
        self.assertIn(f"folder\t{self.kept}\n", shown)
        self.assertIn(f"kept\t{len(self.entries())} entries", shown)
        self.assertIn(f"removed {len(self.entries())} entries", self.palpate_cache("empty"))
        self.assertEqual(self.entries(), [])

    def test_nothing_is_kept_where_that_is_asked_for(self):
        self.simulate("--no-cache")
        self.simulate(PALPATE_CACHE="")
        self.assertEqual(self.entries(), [])
        self.assertIn("the cache is off", self.succeed("--no-cache", "cache", "show", env=self.environment).stdout)

    @cli.long
    def test_it_stands_where_the_environment_says(self):
        self.simulate(XDG_CACHE_HOME=str(self.folder / "xdg"))
        self.assertTrue(any((self.folder / "xdg" / "palpate").iterdir()))
        self.simulate(PALPATE_CACHE=str(self.folder / "named"))
        self.assertTrue(any((self.folder / "named").iterdir()))
        self.assertEqual(self.entries(), [])

    @cli.long
    def test_it_takes_no_more_than_its_limit(self):
        self.simulate()
        whole = sum(path.stat().st_size for path in self.kept.iterdir())
        self.assertGreater(whole, 1 << 20)
        self.palpate_cache("empty")
        first, _ = self.simulate(PALPATE_CACHE_LIMIT=f"{whole // 2048}K")
        self.assertLessEqual(sum(path.stat().st_size for path in self.kept.iterdir()), whole // 2)
        self.assertEqual(self.simulate(PALPATE_CACHE_LIMIT=f"{whole // 2048}K")[0], first)

    def test_a_folder_that_takes_nothing_is_one_warning(self):
        first, said = self.simulate("--no-cache")
        (self.folder / "file").write_text("no folder")
        for folder in (self.folder / "file" / "palpate", "/proc/palpate"):
            with self.subTest(folder):
                again, now = self.simulate(PALPATE_CACHE=str(folder))
                self.assertEqual(again, first)
                self.assertEqual(len(now), len(said) + 1, now)
                self.assertEqual(sum("prepared scenes are not cached" in line for line in now), 1)

    @cli.long
    def test_two_at_once(self):
        command = [cli.PALPATE, "simulate", self.scene, "--script", self.script]
        both = [subprocess.Popen(command, env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
                for _ in range(2)]
        done = [process.communicate(timeout=600) for process in both]
        self.assertEqual([process.returncode for process in both], [0, 0], done)
        hashes = {cli.run_hash(out) for out, _ in done} | {self.simulate()[0]}
        self.assertEqual(len(hashes), 1)
        self.assertTrue(all("warning" not in err for _, err in done), done)
        self.assertTrue(all(name.endswith(".kept") for name in self.entries()))

    def test_no_name_stands_in_it(self):
        text = self.scene_without_title(CANARY)
        for place in ('name = "', 'rests_on = ["'):
            text = text.replace(place, f"{place}{CANARY} ")
        self.assertIn(f'name = "{CANARY} ', text)
        scene = self.scene.with_name(f"{CANARY}.toml")
        scene.write_text(text)
        self.simulate(scene=scene)
        words = [CANARY.encode(), b"femur", b"cartilage", str(self.folder).encode(), self.labels.name.encode()]
        for path in self.kept.iterdir():
            content = path.read_bytes()
            for word in words:
                self.assertNotIn(word, content)
                self.assertNotIn(word.decode(), path.name)


if __name__ == "__main__":
    cli.main()
