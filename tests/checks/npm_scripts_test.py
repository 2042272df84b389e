#!/usr/bin/env python3
"""Building the page runs no script of the packages that it fetches.

    npm_scripts_test.py CMAKE NPM
"""

import json
import os
import pathlib
import subprocess
import sys
import tarfile
import tempfile
import unittest

NPM = sys.argv.pop() if len(sys.argv) > 2 else "npm"
CMAKE = sys.argv.pop() if len(sys.argv) > 1 else "cmake"
WEB = pathlib.Path(__file__).resolve().parents[2] / "web"
FAKE_NPM = """#!/bin/sh
echo "$@" >>"$NPM_CALLS"
mkdir -p node_modules
"""


class NpmScripts(unittest.TestCase):
    def setUp(self):
        self.holder = tempfile.TemporaryDirectory()
        self.addCleanup(self.holder.cleanup)
        self.folder = pathlib.Path(self.holder.name)

    def ran_when_installing(self, settings):
        """The scripts that `npm ci` ran, of the project and of a package that it needs."""
        project, package = self.folder / "project", self.folder / "package"
        for where, name in ((project, "project"), (package, "needed")):
            where.mkdir()
            manifest = {"name": name, "version": "1.0.0",
                        "scripts": {"postinstall": f"echo {name} >>{self.folder}/ran"}}
            if where == project:
                manifest["dependencies"] = {"needed": "file:../needed.tgz"}
            (where / "package.json").write_text(json.dumps(manifest))
        with tarfile.open(self.folder / "needed.tgz", "w:gz") as archive:
            archive.add(package / "package.json", "package/package.json")
        environment = {**os.environ, "HOME": str(self.folder), "npm_config_cache": str(self.folder / "cache"),
                       "npm_config_offline": "true", "npm_config_update_notifier": "false"}
        run = {"cwd": project, "env": environment, "check": True, "stdout": subprocess.DEVNULL,
               "stderr": subprocess.DEVNULL}
        subprocess.run([NPM, "install", "--package-lock-only", "--ignore-scripts"], **run)
        if settings is not None:
            (project / ".npmrc").write_text(settings)
        subprocess.run([NPM, "ci", "--no-audit", "--no-fund"], **run)
        self.assertTrue((project / "node_modules/needed/package.json").is_file())
        ran = self.folder / "ran"
        return sorted(ran.read_text().split()) if ran.exists() else []

    def test_npm_runs_them_where_nobody_says_otherwise(self):
        self.assertIn("needed", self.ran_when_installing(None))

    def test_none_runs_in_the_page_s_folder(self):
        self.assertEqual(self.ran_when_installing((WEB / ".npmrc").read_text()), [])

    def test_the_build_asks_for_none_whatever_the_settings(self):
        fake, calls, web = self.folder / "npm", self.folder / "calls", self.folder / "web"
        fake.write_text(FAKE_NPM)
        fake.chmod(0o755)
        web.mkdir()
        (web / "package-lock.json").write_text("{}")
        subprocess.run([CMAKE, f"-DNPM={fake}", f"-DWEB={web}", f"-DSHARED={self.folder / 'shared'}", "-DSTEP=test",
                        "-P", WEB / "page.cmake"], check=True, env={**os.environ, "NPM_CALLS": str(calls)})
        installing = [line.split() for line in calls.read_text().splitlines() if line.startswith("ci")]
        self.assertEqual(len(installing), 1)
        self.assertIn("--ignore-scripts", installing[0])


if __name__ == "__main__":
    unittest.main()
