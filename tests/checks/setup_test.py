#!/usr/bin/env python3
"""tools/setup with a made-up apt: what it lists, asks, installs, and how it says that it cannot."""

import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

TOOL = pathlib.Path(__file__).resolve().parents[2] / "tools" / "setup"
LIST = "# comment\n[run]\nalpha   a compiler\nbeta    a library\n\n[test]\ngamma   a test library\n"

# the stand-ins keep their state in files: installed (names), known (names), calls (what was run)
DPKG_QUERY = """#!/bin/bash
for name in "${@:3}"; do
  if grep -qx "$name" "$STATE/installed"; then echo "$name ii "; else missing=1; fi
done
exit ${missing:-0}
"""
APT_CACHE = """#!/bin/bash
name="${@: -1}"
grep -qx "$name" "$STATE/known" || exit 100
printf 'Package: %s\\nInstalled-Size: 2500\\nSize: 1500000\\n' "$name"
"""
APT_GET = """#!/bin/bash
echo "apt-get $*" >>"$STATE/calls"
case "$*" in
  *--print-uris*)
    echo '0 upgraded, 4 newly installed, 0 to remove and 0 not upgraded.'
    echo 'Need to get 3000 kB of archives.'
    echo 'After this operation, 5000 kB of additional disk space will be used.' ;;
  update*) [[ -f $STATE/offline ]] && { echo 'W: Failed to fetch'; exit 0; }; cat "$STATE/archive" >>"$STATE/known" ;;
  install*)
    [[ -f $STATE/broken ]] && { echo 'E: dpkg was interrupted'; exit 100; }
    for name in "$@"; do grep -qx "$name" "$STATE/known" && echo "$name" >>"$STATE/installed"; done ;;
esac
exit 0
"""
SUDO = """#!/bin/bash
[[ $1 == -n || $1 == -v ]] && exit 0
echo "sudo $*" >>"$STATE/calls"
exec "$@"
"""


class Setup(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.root = pathlib.Path(self.folder.name)
        (self.root / "bin").mkdir()
        for name, text in {"dpkg-query": DPKG_QUERY, "apt-cache": APT_CACHE, "apt-get": APT_GET, "sudo": SUDO}.items():
            self.program(name, text)
        # the rest of the system, without its real apt
        for name in ("bash", "awk", "cat", "cut", "dirname", "env", "grep", "head", "mktemp", "rm", "sed", "tail"):
            for place in ("/usr/bin", "/bin"):
                if os.path.exists(f"{place}/{name}"):
                    os.symlink(f"{place}/{name}", self.root / "bin" / name)
                    break
        (self.root / "packages.txt").write_text(LIST)
        # a copy, because another user may not be able to read where this stands
        self.tool = self.root / "setup"
        shutil.copy(TOOL, self.tool)
        self.state(installed="alpha\n", known="", archive="alpha\nbeta\ngamma\n", calls="")

    def program(self, name, text):
        file = self.root / "bin" / name
        file.write_text(text)
        file.chmod(0o755)

    def state(self, **files):
        for name, text in files.items():
            (self.root / name).write_text(text)

    def run_setup(self, *options, **environment):
        result = subprocess.run(
            [self.tool, *options], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env={"PATH": str(self.root / "bin"), "STATE": str(self.root), "TMPDIR": str(self.root),
                 "PALPATE_PACKAGES": str(self.root / "packages.txt"), **environment}, check=False)
        return result.returncode, result.stdout, result.stderr

    def calls(self):
        return (self.root / "calls").read_text()

    def test_silent_when_nothing_is_missing(self):
        self.state(installed="alpha\nbeta\n")
        self.assertEqual(self.run_setup(), (0, "", ""))
        self.assertEqual(self.calls(), "")

    def test_not_what_is_there_from_elsewhere(self):
        (self.root / "packages.txt").write_text(LIST.replace("beta ", "beta?betas "))
        self.program("betas", "#!/bin/bash\n")
        (self.root / "installed").write_text("alpha\n")
        self.assertEqual(self.run_setup()[0], 0)
        self.assertEqual(self.calls(), "")
        (self.root / "bin" / "betas").unlink()
        self.assertEqual(self.run_setup()[0], 0)
        self.assertIn("beta", (self.root / "installed").read_text().split())

    def test_installs_the_missing_one_without_a_terminal(self):
        code, _, said = self.run_setup()
        self.assertEqual(code, 0, said)
        self.assertIn("beta", said)
        self.assertIn("1.5 MB", said)
        self.assertIn("2.5 MB", said)
        self.assertIn("4 packages, download 3000 kB, on disk 5000 kB", said)
        self.assertNotIn("gamma", said)
        self.assertIn("--no-install-recommends", self.calls())
        self.assertEqual((self.root / "installed").read_text().split(), ["alpha", "beta"])

    def test_test_group(self):
        code, _, said = self.run_setup("--test")
        self.assertEqual(code, 0, said)
        self.assertEqual((self.root / "installed").read_text().split(), ["alpha", "beta", "gamma"])

    def test_lists_are_fetched_only_when_they_are_missing(self):
        self.run_setup()
        self.assertIn("apt-get update", self.calls())
        self.state(installed="alpha\n", known="beta\n", calls="")
        self.assertEqual(self.run_setup()[0], 0)
        self.assertNotIn("apt-get update", self.calls())

    def test_list_only(self):
        code, out, _ = self.run_setup("--test", "--list")
        self.assertEqual((code, out.split()), (1, ["beta", "gamma"]))
        self.assertEqual(self.calls(), "")

    def test_offline(self):
        self.state(offline="")
        code, _, said = self.run_setup()
        self.assertEqual(code, 1)
        self.assertIn("beta", said)
        self.assertIn("offline", said)

    def test_apt_fails(self):
        self.state(broken="", known="beta\n")
        code, _, said = self.run_setup()
        self.assertEqual(code, 1)
        self.assertIn("dpkg was interrupted", said)
        self.assertIn("Still missing: beta", said)

    def test_not_debian(self):
        (self.root / "bin" / "apt-get").unlink()
        code, _, said = self.run_setup()
        self.assertEqual(code, 1)
        self.assertIn("not a Debian system", said)
        self.assertIn("alpha beta", said)
        self.assertEqual(self.run_setup(PALPATE_NO_SETUP="1"), (0, "", ""))

    def test_unknown_option(self):
        self.assertEqual(self.run_setup("--tset")[0], 2)

    def test_not_root(self):
        if os.geteuid() == 0:
            self.as_nobody()
        else:
            self.not_root(None)

    def as_nobody(self):
        """Root looks at the other side by a user number that owns nothing."""
        for path in [self.root, *self.root.rglob("*")]:
            os.chown(path, 65534, 65534, follow_symlinks=False)
        self.not_root(65534)

    def not_root(self, user):
        def run():
            return subprocess.run(
                [self.root / "bin" / "bash", self.tool], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                user=user, env={"PATH": str(self.root / "bin"), "STATE": str(self.root), "TMPDIR": str(self.root),
                                "PALPATE_PACKAGES": str(self.root / "packages.txt")}, check=False)
        # with sudo it goes through sudo
        result = run()
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("sudo apt-get update", self.calls())
        # without it, it says what root would have to run
        self.state(installed="alpha\n")
        (self.root / "bin" / "sudo").unlink()
        result = run()
        self.assertEqual(result.returncode, 1)
        self.assertIn("apt-get install --no-install-recommends beta", result.stderr)


if __name__ == "__main__":
    unittest.main()
