"""What `palpate info` foretells of memory, against the most that a run then has."""

import json
import os
import pathlib
import subprocess
import sys

import cli

# mm; PALPATE_TEST_SPACINGS="1.0 0.565 0.36" takes a minute, for knees of 1.5, 8 and 31 million voxels
SPACINGS = os.environ.get("PALPATE_TEST_SPACINGS", "1.0 0.7").split()


def max_bytes(*arguments):
    """The most memory that a run of palpate had."""
    process = subprocess.Popen([cli.PALPATE, "-q", *map(str, arguments)], stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode in (cli.OK, cli.LIMIT), process.returncode
    return used.ru_maxrss * 1024


class Memory(cli.PalpateTest):
    def test_a_run_takes_what_info_says(self):
        if cli.SANITIZED:
            self.skipTest("a sanitizer takes memory of its own")
        script = self.folder / "touch.toml"
        pathlib.Path(script).write_text(cli.TOUCH)
        for spacing in SPACINGS:
            with self.subTest(spacing):
                knee = f"knee-phantom:spacing={spacing}"
                foretold = json.loads(self.succeed("info", knee, "--json").stdout)["memory_bytes"]
                taken = max_bytes("simulate", knee, "--script", script)
                part = foretold["peak"] / taken
                print(f"{knee}: foretold {foretold['peak'] / 1e6:.0f} MB, taken {taken / 1e6:.0f} MB: {part:.2f}", file=sys.stderr)
                self.assertGreater(part, 0.92)
                self.assertLess(part, 1.25)
                self.assertLess(foretold["stays"], foretold["peak"])

    def test_prepare_says_it_first(self):
        out = self.succeed("prepare", "knee-phantom:spacing=1.5", "-o", self.folder / "field.nrrd").stdout
        self.assertRegex(out.splitlines()[0], r"^memory +up to [\d.]+ [MG]iB, of which the field keeps [\d.]+ [KMG]iB$")


if __name__ == "__main__":
    cli.main()
