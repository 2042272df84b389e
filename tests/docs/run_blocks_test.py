#!/usr/bin/env python3
"""run_blocks must see a block that fails, prints something else, or is neither run nor excused."""

import pathlib
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).parent))
import named_options
import run_blocks

# stands in for palpate: says its help, and what it was called with
PROGRAM = """#!/bin/sh
case "$*" in
  --help) printf 'Options:\\n  --quiet       Says nothing\\n\\nSubcommands:\\n  press      Press\\n  leave      Leave\\n\\nExamples:\\n  --no-option\\n' ;;
  'press --help') printf '  -f,--force FLOAT:0 ... 9=3\\n                     How much\\n  --seconds FLOAT      How long; default: 0.5\\n' ;;
  'leave --help') printf '  --at X    Where\\n' ;;
  leave*) echo "no: $*"; exit 1 ;;
  *) echo "did: $*, 12.5 s" ;;
esac
"""


class RunBlocks(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)
        (self.root / "docs/images").mkdir(parents=True)
        (self.root / "files").mkdir()
        (self.root / "palpate").write_text(PROGRAM)
        (self.root / "palpate").chmod(0o755)
        self.addCleanup(setattr, run_blocks, "ROOT", run_blocks.ROOT)
        run_blocks.ROOT = self.root
        self.program = run_blocks.Program(self.root / "palpate", self.root)

    def faults(self, text):
        """Of a page: its faults without where they are, and how many blocks were run."""
        (self.root / "docs/page.md").write_text(text)
        faults, counts = run_blocks.try_page("docs/page.md", self.program, self.root / "files")
        self.counts = counts
        return [fault.partition(": ")[2] for fault in faults]

    def test_commands_that_pass(self):
        self.assertEqual(self.faults("```sh\npalpate press --force 2 > a.txt\n```\n\ntext\n\n```sh\ngrep -q 'force 2' a.txt \\\n  && true\n```\n"), [])
        self.assertEqual(self.counts["run"], 2)

    def test_commands_that_fail(self):
        for text in ("palpate leave\ntrue", "palpate leave | cat\ntrue", "false"):
            self.assertRegex(self.faults(f"```sh\n{text}\n```\n")[0], "ends with exit code 1", text)
        self.assertRegex(self.faults("```python\nraise SystemExit(4)\n```\n")[0], "ends with exit code 4")

    def test_what_is_printed(self):
        block = "```console\n$ palpate press\n{}\n```\n"
        for same in ("did: press, 3 s", "did: ..., 0.1 s", "...", "...\ndid: press, 3 s\n..."):
            self.assertEqual(self.faults(block.format(same)), [], same)
        for other in ("did: press, 3 mm", "did: press, 3 s\nmore", "done", "did: press ..."):
            self.assertEqual(len(self.faults(block.format(other))), other != "did: press ...", other)
        self.assertEqual(len(self.faults("```console\n$ palpate leave\n```\n")), 1)
        text = "```sh\npalpate press\n```\n\n<!-- output -->\n```text\n{}\n```\n"
        self.assertEqual(self.faults(text.format("did: press, 1 s")), [])
        self.assertEqual(len(self.faults(text.format("did: hold, 1 s"))), 1)

    def test_marks(self):
        self.assertEqual(self.faults("<!-- not run: needs a device -->\n```sh\nfalse\n```\n"), [])
        self.assertEqual(dict(self.counts), {"needs a device": 1})
        self.assertEqual(self.faults("<!-- file: a.txt -->\n```toml\nx = 1\n```\n\n```sh\ngrep 'x = 1' a.txt\n```\n"), [])
        self.assertEqual(self.faults("<!-- before: echo 1 > b.txt -->\n```sh\nrm b.txt\n```\n"), [])
        self.assertEqual(len(self.faults("<!-- before: false -->\n```sh\ntrue\n```\n")), 1)
        # a mark is of the block below it alone
        self.assertEqual(len(self.faults("<!-- not run: no -->\ntext\n```sh\nfalse\n```\n")), 1)
        self.assertEqual(len(self.faults("<!-- not run: no -->\n```sh\nfalse\n```\n```sh\nfalse\n```\n")), 1)

    def test_other_languages(self):
        self.assertEqual(self.faults("```json\n{\"a\": [1]}\n```\n"), [])
        self.assertRegex(self.faults("```json\n{\"a\": [1}\n```\n")[0], "is no JSON")
        self.assertRegex(self.faults("```sql\nSELECT 1 FROM runs;\n```\n")[0], "is not taken by SQLite")
        self.assertRegex(self.faults("```cpp\nint main() {}\n```\n")[0], "say why")

    def test_names(self):
        self.assertEqual(self.faults("`--force 2` and `--at`, --nothing\n"), [])
        self.assertEqual(self.faults("`--farce 2`\n"), ["palpate has no option --farce"])
        self.assertEqual(self.faults("`--no-option`\n"), ["palpate has no option --no-option"])
        marked = "<!-- not run: no -->\n```sh\n{}\n```\n"
        self.assertEqual(self.faults(marked.format("palpate --quiet; palpate press --force 2   # --any\n$P leave --at")), [])
        self.assertEqual(self.faults(marked.format("palpate leave --force 2")), ["palpate leave has no option --force"])
        self.assertEqual(self.faults(marked.format("palpate pess")), ["palpate has no verb pess"])
        self.assertEqual(self.faults(f"`palpate {named_options.VERSION}` \"palpate\": \"{named_options.VERSION}\"\n"), [])
        self.assertEqual(len(self.faults("palpate 9.9.9\n\n\"palpate\": \"9.9.9\"\n")), 2)

    def test_defaults(self):
        table = "| option | means | default |\n|---|---|---|\n| `--force N` | how much | {} |\n| `--seconds S` | | {} |\n"
        for row in (("3", "0.5"), ("`3`: more", "none, or 0.5 s"), ("", "")):
            self.assertEqual(self.faults(table.format(*row)), [], row)
        self.assertEqual(self.faults(table.format(2, 5)), ["the default of --force is 3", "the default of --seconds is 0.5"])


if __name__ == "__main__":
    unittest.main()
