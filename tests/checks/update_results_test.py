#!/usr/bin/env python3
"""tools/update_results must make every table, find every sentence that says another number, and write nothing where
anything is missing. It runs on copies of the manual's own pages and figures."""

import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
from load_tool import TOOLS, load_tool

ROOT = pathlib.Path(__file__).resolve().parents[2]
TOOL, RESULTS = TOOLS / "update_results", ROOT / "docs" / "results"

load_tool("update_results")
from results.claims import compare  # noqa: E402
from results.figures import Figures, Missing  # noqa: E402
from results import numbers  # noqa: E402


class UpdateResults(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.results = pathlib.Path(folder.name) / "results"
        shutil.copytree(RESULTS, self.results)

    def text(self, page):
        return (self.results / page).read_text(encoding="utf-8")

    def edit(self, page, old, new):
        text = self.text(page)
        self.assertEqual(text.count(old), 1, f"{page} has '{old}' once")
        (self.results / page).write_text(text.replace(old, new), encoding="utf-8")

    def change(self, suite, edit):
        """Lets `edit` change the JSON of a suite."""
        file = self.results / "figures" / f"{suite}.json"
        report = json.loads(file.read_text(encoding="utf-8"))
        edit(report)
        file.write_text(json.dumps(report), encoding="utf-8")

    def set(self, suite, name, value):
        def edit(report):
            report["figures"][name]["value"] = value
        self.change(suite, edit)

    def all_text(self):
        return {file.name: file.read_text(encoding="utf-8") for file in self.results.glob("*.md")}

    def run_tool(self, *options):
        """Exit code and what was said on stderr."""
        result = subprocess.run([TOOL, *options, self.results], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                check=False)
        self.assertNotIn("Traceback", result.stderr)
        return result.returncode, result.stderr

    def refuses(self, says):
        before = self.all_text()
        code, err = self.run_tool()
        self.assertEqual(code, 1)
        self.assertIn(says, err)
        self.assertIn("nothing was written", err)
        self.assertEqual(self.all_text(), before)

    def test_the_pages_are_what_the_figures_make_of_them(self):
        before = self.all_text()
        self.assertEqual(self.run_tool(), (0, ""))
        self.assertEqual(self.all_text(), before)

    def test_a_table_that_is_made_whole(self):
        self.set("accuracy", "b-spline-exact-int16/cylinder-10mm/0.625x0.625x0.9/direction/max", 7.777)
        before = self.all_text()
        self.assertEqual(self.run_tool(), (0, ""))
        after = self.all_text()
        self.assertIn("| 7.78 |", after["accuracy.md"])
        changed = [(old, new) for page, text in before.items()
                   for old, new in zip(text.splitlines(), after[page].splitlines(), strict=True) if old != new]
        self.assertEqual(len(changed), 1, "that row and nothing else")
        self.assertTrue(changed[0][1].startswith("| cylinder-10mm | 0.625x0.625x0.9 | exact, int16 coefficients |"))

    def test_a_table_whose_rows_people_write(self):
        self.edit("removal.md", "energy of what is gone beyond the motor's work", "some other words")
        self.set("removal", "removal/energy/beyond-work", 0.0071)
        self.assertEqual(self.run_tool(), (0, ""))
        self.assertIn("| `removal/energy/beyond-work` | some other words | 0.01 % | 0.007 % |", self.text("removal.md"))

    def test_what_ran_where_and_when_stands_in_each_place(self):
        self.change("removal", lambda report: report.update(machine="a machine", build="a build", date="2031-02-03"))
        self.assertEqual(self.run_tool(), (0, ""))
        self.assertEqual(self.text("removal.md").count("*`removal`: a build;\na machine; 2031-02-03.*"), 4)

    def test_limits_that_are_not_kept_are_named(self):
        self.set("removal", "removal/energy/beyond-work", 0.05)
        self.assertEqual(self.run_tool(), (0, ""))
        self.assertRegex(self.text("removal.md"), r"\*\*1 of \d+ limits were not kept:\*\*\n\n"
                                                  r"- `removal/energy/beyond-work`: 0\.050, limit 0\.01\n")

    def test_a_sentence_that_says_another_number(self):
        self.set("contact", "contact/terraces/sink/0.36x0.36x0.7/2deg", 0.31)
        code, err = self.run_tool()
        self.assertEqual(code, 1)
        self.assertRegex(err, r"contact\.md: '`sink` is at most {} mm.*' says 0\.\d+, contact 0\.31\n")
        self.assertEqual(err.count("\n"), 1)

    def test_numbers_are_compared_as_they_are_rounded(self):
        claim = ("removal", "a.md", "is {} of {} mm", lambda f: f["x"], lambda f: f["y"])

        class Of(Figures):
            def __init__(self, **figures):  # pylint: disable=super-init-not-called
                self.suite, self.figures = "removal", {name: {"value": value} for name, value in figures.items()}

        def wrong(text, **figures):
            return len(compare({"a.md": text}, {"removal": Of(**figures)}, [claim]))
        self.assertEqual(wrong("it is 0.25 of\n39 105 mm", x=0.2549, y=39105), 0)
        self.assertEqual(wrong("it is −0.3 of 4 mm", x=-0.25, y=4.4), 0)
        self.assertEqual(wrong("it is 0.25 of 4 mm", x=0.2551, y=4.6), 2)
        with self.assertRaises(Missing):
            wrong("it is nowhere", x=1, y=1)
        with self.assertRaises(Missing):
            wrong("is 1 of 1 mm, is 1 of 1 mm", x=1, y=1)

    def test_a_sentence_that_is_gone(self):
        self.edit("contact.md", "`sink` is at most", "`sink` is never more than")
        self.refuses("contact.md has the sentence '`sink` is at most {} mm")

    def test_a_check_writes_nothing(self):
        self.edit("removal.md", "| cone, drilling | ", "| cone, drilling | 9")
        before = self.all_text()
        code, err = self.run_tool("--check")
        self.assertEqual(code, 1)
        self.assertIn("removal.md: is not what docs/results/figures makes of it", err)
        self.assertEqual(self.all_text(), before)
        self.run_tool()
        self.assertEqual(self.run_tool("--check"), (0, ""))

    def test_a_missing_figure(self):
        for suite, name in (("accuracy", "stored-normals-oct24/torus-20-8mm/0.625x0.625x0.9/choppiness/max"),
                            ("removal", "removal/volume/beside-its-sweeps")):
            with self.subTest(name):
                self.change(suite, lambda report, name=name: report["figures"].pop(name))
                self.refuses(f"{suite}.json has no figure '{name}'")
                shutil.copy(RESULTS / "figures" / f"{suite}.json", self.results / "figures")

    def test_a_missing_limit(self):
        self.change("removal", lambda report: report["figures"]["removal/volume/beside-its-sweeps"].pop("limit"))
        self.refuses("'removal/volume/beside-its-sweeps' has no limit")

    def test_a_missing_place(self):
        self.edit("accuracy.md", "<!-- figures: accuracy smooth-sphere -->", "")
        self.refuses("no page has the place '<!-- figures: accuracy smooth-sphere -->'")

    def test_a_place_that_is_there_twice(self):
        place = "\n<!-- figures: accuracy glance -->\n<!-- end -->\n"
        (self.results / "contact.md").write_text(self.text("contact.md") + place, encoding="utf-8")
        self.refuses("'<!-- figures: accuracy glance -->' is there more than once")

    def test_a_place_without_its_end_does_not_swallow_the_next(self):
        text = self.text("accuracy.md")
        (self.results / "accuracy.md").write_text(text.replace("<!-- end -->", "", 1), encoding="utf-8")
        self.refuses("accuracy.md: a place has no '<!-- end -->'")

    def test_a_place_that_nobody_knows(self):
        self.edit("accuracy.md", "<!-- figures: accuracy glance -->", "<!-- figures: accuracy glanze -->")
        self.refuses("is no place that this tool knows")

    def test_rows_that_have_no_figures_and_figures_that_have_no_row(self):
        self.edit("removal.md", "| `removal/energy/beyond-work` |", "| `removal/energy/beyond` |")
        self.refuses("no figures for the row '`removal/energy/beyond`'")
        self.edit("removal.md", "| `removal/energy/beyond` |", "| `removal/volume/beside-its-sweeps` |")
        self.refuses("two rows '`removal/volume/beside-its-sweeps`'")
        lines = [line for line in self.text("removal.md").splitlines() if "beside-its-sweeps" not in line]
        (self.results / "removal.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
        self.refuses("there is no row")

    def test_a_column_that_is_gone(self):
        self.edit("contact.md", "| figure | is | limit | measured |", "| figure | is | limit | found |")
        self.refuses("has no column 'measured'")

    def test_no_report(self):
        for key in ("date", "machine", "build"):
            with self.subTest(key):
                self.change("removal", lambda report, key=key: report.pop(key))
                self.refuses(f"removal.json has no {key}")
                shutil.copy(RESULTS / "figures" / "removal.json", self.results / "figures")
        shutil.copy(RESULTS / "figures" / "contact.json", self.results / "figures" / "removal.json")
        self.refuses("removal.json is of the suite 'contact'")
        (self.results / "figures" / "removal.json").write_text("{\"figures\"", encoding="utf-8")
        self.refuses("cannot be read")

    def test_a_suite_without_figures_is_left_as_it_is(self):
        (self.results / "figures" / "removal.json").unlink(missing_ok=True)
        self.edit("removal.md", "(`pressed`): ", "(`pressed`): 9 to ")
        before = self.all_text()
        self.assertEqual(self.run_tool(), (0, ""))
        self.assertEqual(self.all_text(), before)

    def test_numbers(self):
        for write, cases in ((numbers.two_digits, {0: "0", 9e-16: "0", 2e-5: "0.00002", 0.0084: "0.008", 0.0304: "0.030", 0.0996: "0.10",
                                           0.996: "1.0", 1.74: "1.7", 9.96: "10", 15.6: "16", 99.6: "100", 384: "384"}),
                             (numbers.three_digits, {0.729: "0.73", 7.781: "7.78", 9.996: "10.0", 16.56: "16.6", 99.96: "100", 100: "100"}),
                             (numbers.hundredths, {0.0124: "0.012", 0.0996: "0.10", 12.84: "12.84"}),
                             (numbers.as_chosen, {2.0: "2", 0.060000000000000005: "0.06", 0.001: "0.001"}),
                             (numbers.signed_percent, {6.7: "+7 %", -0.31: "−0.3 %", -12.4: "−12 %", 0: "0.0 %"})):
            for value, text in cases.items():
                with self.subTest(f"{write.__name__}({value})"):
                    self.assertEqual(write(value), text)
        self.assertEqual(numbers.fixed(-0.001, 2), "0.00")


if __name__ == "__main__":
    unittest.main()
