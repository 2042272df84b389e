#!/usr/bin/env python3
"""check_threat_model must see a test that is not there, and a hazard without one."""

import pathlib
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).parent))
import check_threat_model

HEAD = "# Threats\n\n| hazard | cause | effect | measure | test |\n|---|---|---|---|---|\n"


class CheckThreatModel(unittest.TestCase):
    def faults(self, *rows):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            (root / "a_test.cc").write_text("TEST(Suite, Here) {\n}\nTEST_F(Fixture, There) {\n}\n// TEST(Suite, Not)\n")
            (root / "b_test.py").write_text("class One(Base):\n    def test_here(self):\n        pass\n\n\n"
                                            "class Two(Base):\n    def test_there(self):\n        pass\n")
            document = root / "model.md"
            document.write_text(HEAD + "".join(row + "\n" for row in rows) + "\nMore.\n\n| x | y |\n")
            return [fault.removeprefix(f"{document}:") for fault in check_threat_model.faults(document, root)]

    def test_names_that_are_there(self):
        self.assertEqual(self.faults("| h | c | e | m | `a_test.cc: Suite.Here`, `a_test.cc: Fixture.There` |",
                                     "| | c | e | m | `b_test.py: One.test_here` |"), [])

    def test_names_that_are_not(self):
        for name in ("a_test.cc: Suite.There", "a_test.cc: Suite.Her", "a_test.cc: Suite.Not", "c_test.cc: Suite.Here",
                     "b_test.py: One.test_there", "b_test.py: Three.test_here", "b_test.py: One.test_her", "Suite.Here"):
            with self.subTest(name):
                self.assertEqual(self.faults(f"| h | c | e | m | `{name}` |"), [f"5: there is no test {name}"])

    def test_rows_that_say_too_little(self):
        self.assertEqual(self.faults("| h | c | e | m | later |"), ["5: names no test"])
        self.assertEqual(self.faults("| h | c | e | | `a_test.cc: Suite.Here` |"), ["5: says nothing of the measure"])
        self.assertEqual(self.faults("| h | c | e | `a_test.cc: Suite.Here` |"), ["5: has 4 cells instead of 5"])
        self.assertEqual(len(self.faults()), 1)


if __name__ == "__main__":
    unittest.main()
