"""Opens a cohort's page in headless Chromium and sorts, finds, chooses and compares as a reader would.

usage: PALPATE=PROGRAM cohort_test.py

Exit code 77 (a skip) where there is no browser, except in CI, where that is a failure.
"""

import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True  # nothing is left in the source tree
import browser  # noqa: E402

SCRIPT = '[[step]]\napproach = "femur"\nspeed = 200.0\n[[step]]\npress = 0.8\n[[step]]\nleave = true\n'


class CohortInABrowser(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-cohort-")
        cls.addClassCleanup(folder.cleanup)
        path = pathlib.Path(folder.name)
        (path / "touch.toml").write_text(SCRIPT)
        (path / "broken.nrrd").write_text("NRRD0005\n")
        (path / "cases.tsv").write_text(
            "case\tstudy\tscript\nbig\tknee-phantom:spacing=3,size=1.15\ttouch.toml\nbroken\tbroken.nrrd\ttouch.toml\n"
            "small\tknee-phantom:spacing=3,size=0.9\ttouch.toml\n")
        done = subprocess.run([os.environ["PALPATE"], "cohort", str(path / "cases.tsv"), "-o", str(path / "out")],
                              env=dict(os.environ, PALPATE_CACHE=""), capture_output=True, text=True)
        assert done.returncode == 3, done.stdout + done.stderr
        cls.file = str(path / "out" / "index.html")
        cls.page = browser.Browser().__enter__()
        cls.addClassCleanup(cls.page.__exit__)

    def setUp(self):
        self.page.dark(False)
        self.page.resize(1280, 900)
        self.page.log()
        self.page.open(self.file)
        self.page.wait("document.readyState === 'complete'")

    def tearDown(self):
        # an error, a refused style or script, or a request is a message in the console
        self.assertEqual(self.page.log(), [])

    def order(self):
        return self.page.run("return [...document.querySelectorAll('tbody tr')].filter((row) => !row.hidden)"
                             ".map((row) => row.cells[1].textContent.trim())")

    def sort_by(self, title):
        self.page.run("[...document.querySelectorAll('thead button')].find((button) => button.textContent.startsWith(arguments[0])"
                      " && button.offsetParent !== null).click()", title)

    def test_sorts_and_puts_what_is_not_there_last(self):
        self.assertEqual(self.order(), ["big", "broken", "small"])
        self.sort_by("volume")
        self.assertEqual(self.order(), ["small", "big", "broken"])
        self.sort_by("volume")
        self.assertEqual(self.order(), ["big", "small", "broken"])

    def test_finds_by_name_and_fault(self):
        self.page.run("const find = document.getElementById('find'); find.value = 'failed';"
                      "find.dispatchEvent(new Event('input'))")
        self.assertEqual(self.order(), ["broken"])

    def test_a_structures_columns_take_the_place_of_the_wholes(self):
        shown = "return [...document.querySelectorAll('thead th')].filter((head) => head.offsetParent !== null).map((head) => head.textContent)"
        self.assertIn("structures", self.page.run(shown))
        self.page.run("const all = document.getElementById('structure');"
                      "all.value = [...all.options].find((one) => one.text === 'femur').value; all.dispatchEvent(new Event('change'))")
        titles = self.page.run(shown)
        self.assertNotIn("structures", titles)
        self.assertEqual(len(titles), 3 + 7)
        self.assertEqual(len(self.page.run("return [...document.querySelectorAll('tbody tr')[0].cells].filter((cell) => cell.offsetParent !== null)"
                                           ".map((cell) => cell.textContent)")), 3 + 7)

    def test_compares_what_is_ticked(self):
        self.assertTrue(self.page.run("return document.getElementById('compare').hidden"))
        self.page.run("for (const n of [0, 2]) document.querySelectorAll('tbody input')[n].click()")
        text = self.page.run("return document.getElementById('compared').textContent")
        self.assertIn("big", text)
        self.assertIn("small", text)
        self.assertRegex(text, r"-\d+ \(-\d+ %\)")
        self.assertEqual(self.page.run("return document.querySelectorAll('#compared img').length"), 2)


if __name__ == "__main__":
    browser.run_tests()
