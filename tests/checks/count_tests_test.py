#!/usr/bin/env python3
"""tools/count_tests must count what ctest and the other stages left, and miss no failure."""

import pathlib
import subprocess
import tempfile
import unittest

TOOL = pathlib.Path(__file__).resolve().parents[2] / "tools" / "count_tests"
# as ctest 3.25 writes it: passed, failed, skipped, disabled, and one whose program is missing
JUNIT = """<?xml version="1.0" encoding="UTF-8"?>
<testsuite name="Linux-c++" tests="5" failures="1" disabled="1" skipped="2" hostname="" time="0">
  <testcase name="a" classname="a" time="0.1" status="run"/>
  <testcase name="b" classname="b" time="0.1" status="fail"><failure message=""/></testcase>
  <testcase name="c" classname="c" time="0" status="notrun"><skipped message="SKIP_REGULAR_EXPRESSION"/></testcase>
  <testcase name="d" classname="d" time="0" status="disabled"/>
  <testcase name="e" classname="e" time="0" status="notrun"><skipped message="Unable to find executable"/></testcase>
</testsuite>
"""
PASSED = '<testsuite><testcase name="a" status="run"/></testsuite>'


def run(files, *options):
    """Runs the tool on the stages of `files`; returns its exit code and the lines printed."""
    stages = list(dict.fromkeys(name.partition(".")[0] for name in files)) or ["release"]
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            (pathlib.Path(folder) / name).write_text(text)
        result = subprocess.run([TOOL, *options, folder, *stages], stdout=subprocess.PIPE, text=True, check=False)
    return result.returncode, result.stdout.splitlines()


class CountTests(unittest.TestCase):
    def test_counts_every_outcome(self):
        code, lines = run({"release.xml": JUNIT, "fuzz.tsv": "fuzz\ty\tpassed\nfuzz\tx\tfailed\n"})
        self.assertEqual(code, 1)
        self.assertEqual(lines[-1], "2 passed, 3 failed, 2 skipped")
        self.assertIn("failed: release: b", lines)
        self.assertIn("failed: release: e", lines)
        self.assertIn("failed: fuzz: x", lines)
        self.assertIn("skipped: release: c", lines)

    def test_all_passed(self):
        self.assertEqual(run({"release.xml": PASSED})[0], 0)
        self.assertEqual(run({"release.xml": PASSED})[1][-1], "1 passed, 0 failed, 0 skipped")

    def test_a_skip_is_a_failure_only_where_asked(self):
        files = {"release.xml": PASSED, "checks.tsv": "checks\tformat\tskipped\n"}
        self.assertEqual(run(files)[0], 0)
        code, lines = run(files, "--no-skips")
        self.assertEqual((code, lines[-1]), (1, "1 passed, 1 failed, 0 skipped"))

    def test_a_stage_counts_ctest_and_other_tests(self):
        code, lines = run({"ci.xml": PASSED, "ci.tsv": "ci\tsources stand alone\tpassed\n"})
        self.assertEqual((code, lines[-1]), (0, "2 passed, 0 failed, 0 skipped"))

    def test_a_stage_that_did_not_run_fails(self):
        with tempfile.TemporaryDirectory() as folder:
            (pathlib.Path(folder) / "release.xml").write_text(PASSED)
            (pathlib.Path(folder) / "asan.xml").write_text(JUNIT)
            result = subprocess.run([TOOL, folder, "release", "fuzz"], stdout=subprocess.PIPE, text=True, check=False)
        self.assertEqual(result.returncode, 1)
        self.assertIn("failed: fuzz: the stage did not run", result.stdout)
        self.assertTrue(result.stdout.endswith("1 passed, 1 failed, 0 skipped\n"), result.stdout)

    def test_nothing_ran(self):
        self.assertEqual(run({})[0], 1)
        self.assertEqual(run({"release.xml": "<testsuite/>"})[0], 1)

    def test_damaged_results(self):
        code, lines = run({"release.xml": JUNIT[:200], "asan.xml": PASSED})
        self.assertEqual((code, lines[-1]), (1, "1 passed, 1 failed, 0 skipped"))


if __name__ == "__main__":
    unittest.main()
