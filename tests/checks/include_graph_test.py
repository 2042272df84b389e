#!/usr/bin/env python3
"""tools/include_graph must print the edges of a small tree and find its cycles; this repository has none."""

import pathlib
import subprocess
import tempfile
import unittest

TOOL = pathlib.Path(__file__).resolve().parents[2] / "tools" / "include_graph"


def run(files, *options):
    """Lays out {path: text} in a new folder; returns (exit code, standard output, standard error)."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            file = pathlib.Path(folder) / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
        result = subprocess.run([TOOL, *options, folder], capture_output=True, text=True, check=False)
    return result.returncode, result.stdout, result.stderr


MODULES = {
    "include/palpate/volume/volume.h": '#include "palpate/base/result.h"\n#include <vector>\n',
    "src/core/sampling/sampling.cc": '#include "palpate/volume/volume.h"\n#include "sampling/sampling.h"\n',
    "src/data/scene/scene.cc": '#include "palpate/volume/volume.h"\n',
    # a test may include any public header
    "src/core/volume/volume_test.cc": '#include "palpate/scene/scene.h"\n',
}
PAGE = {
    "web/src/page.ts": 'import { Panel } from "./panels/panel.js";\n',
    "web/src/panels/panel.tsx": 'import type { Message } from "../protocol/wire.js";\nimport { h } from "preact";\n',
    "web/src/protocol/wire.ts": "export type Message = string;\n",
}


class IncludeGraph(unittest.TestCase):
    def test_modules(self):
        code, printed, complaint = run(MODULES)
        self.assertEqual((code, complaint), (0, ""))
        self.assertIn("  volume -> base (1)\n", printed)
        self.assertIn("  sampling -> volume (1)\n", printed)
        self.assertIn("  scene -> volume (1)\n", printed)

    def test_groups(self):
        code, printed, _ = run(MODULES, "--groups")
        self.assertEqual(code, 0)
        self.assertIn("data -> core (1)\n", printed)
        self.assertIn("core -> nothing\n", printed)

    def test_page(self):
        self.assertEqual(run(PAGE, "--web"), (0, "entry -> panels (1)\npanels -> protocol (1)\nprotocol -> nothing\n", ""))

    def test_formats(self):
        self.assertIn('  "data" -> "core" [label=1];', run(MODULES, "--groups", "--format", "dot")[1])
        self.assertIn("  data -->|1| core", run(MODULES, "--groups", "--format", "mermaid")[1])

    def test_a_cycle_of_modules(self):
        code, _, complaint = run({**MODULES, "src/core/base/file.cc": '#include "palpate/sampling/sampling.h"\n'})
        self.assertEqual((code, complaint), (1, "cycle: base -> sampling -> volume -> base\n"))

    def test_a_cycle_of_groups_whose_modules_have_none(self):
        code, _, complaint = run({**MODULES, "src/core/surfaces/a.cc": '#include "palpate/phantoms/phantoms.h"\n'}, "--groups")
        self.assertEqual((code, complaint), (1, "cycle: core -> data -> core\n"))

    def test_a_cycle_of_the_page(self):
        code, _, complaint = run({**PAGE, "web/src/protocol/wire.ts": 'import { Panel } from "../panels/panel.js";\n'}, "--web")
        self.assertEqual((code, complaint), (1, "cycle: panels/panel.tsx -> protocol/wire.ts -> panels/panel.tsx\n"))

    def test_this_repository_has_none(self):
        for options in ([], ["--groups"], ["--web"]):
            with self.subTest(options):
                result = subprocess.run([TOOL, *options], capture_output=True, text=True, check=False)
                self.assertEqual((result.returncode, result.stderr), (0, ""))


if __name__ == "__main__":
    unittest.main()
