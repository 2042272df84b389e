#!/usr/bin/env python3
"""tools/update_method_tables must fill every place, and write nothing where anything is missing."""

import importlib.machinery
import importlib.util
import json
import pathlib
import subprocess
import tempfile
import unittest

TOOL = pathlib.Path(__file__).resolve().parents[2] / "tools" / "update_method_tables"


def load_tool():
    loader = importlib.machinery.SourceFileLoader("update_method_tables", str(TOOL))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(loader.name, loader))
    loader.exec_module(module)
    return module


tool = load_tool()


def report():
    """A value for every figure that the tables hold, each its own."""
    names = [f"{variant}/{shape}/{spacing}/{quantity}/{leaf}"
             for variants in tool.VARIANTS.values() for variant, _ in variants
             for shape in tool.SHAPES for spacing in tool.SPACINGS
             for quantity in ("direction", "magnitude") for leaf in ("mean", "p99", "max")]
    names += [f"{variant}/{shape}/{tool.FOUNDING}/{quantity}/{leaf}"
              for variants in tool.CHOPPY.values() for variant, quantity, _ in variants
              for shape in tool.CHOPPINESS for leaf in ("p99", "max")]
    return {"suite": "accuracy",
            "figures": {name: {"value": 1 + n / 100, "unit": "deg", "n": 1} for n, name in enumerate(names)}}


DOCUMENT = "# Methods\n\nbefore °\n" + "".join(
    f"\n## {method}\n<!-- figures: {method} -->\nold text\n<!-- end -->\nafter {method}\n" for method in tool.VARIANTS)


class UpdateMethodTables(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.document = pathlib.Path(self.folder.name) / "methods.md"

    def run_tool(self, figures, document=DOCUMENT):
        """Exit code and what was said on stderr."""
        file = pathlib.Path(self.folder.name) / "figures.json"
        file.write_text(figures if isinstance(figures, str) else json.dumps(figures), encoding="utf-8")
        self.document.write_text(document, encoding="utf-8")
        result = subprocess.run([TOOL, file, self.document], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                text=True, check=False)
        return result.returncode, result.stderr

    def refuses(self, says, figures, document=DOCUMENT):
        code, err = self.run_tool(figures, document)
        self.assertEqual(code, 1)
        self.assertIn(says, err)
        self.assertNotIn("Traceback", err)
        self.assertEqual(self.document.read_text(encoding="utf-8"), document)
        self.assertEqual(len(list(pathlib.Path(self.folder.name).iterdir())), 2)

    def test_fills_every_place_and_nothing_else(self):
        figures = report()
        figures["figures"]["b-spline-exact-int16/sphere-20mm/0.625x0.625x0.9/direction/mean"]["value"] = 0.0124
        figures["figures"]["gaussian-sphere/sphere-20mm/0.625x0.625x0.9/choppiness-at-half-voxels/max"]["value"] = 1.79
        code, err = self.run_tool(figures)
        self.assertEqual((code, err), (0, ""))
        text = self.document.read_text(encoding="utf-8")
        self.assertNotIn("old text", text)
        self.assertIn("| sphere-20mm | 0.625x0.625x0.9 | exact, int16 coefficients | 0.012 |", text)
        self.assertRegex(" ".join(text.split()), r"across half voxels: sphere-20mm \d+\.\d\d / 1\.79,")
        self.assertTrue(text.startswith("# Methods\n\nbefore °\n"))
        for method, variants in tool.VARIANTS.items():
            place = text.split(f"<!-- figures: {method} -->\n")[1].split("<!-- end -->\nafter " + method)[0]
            # a head, the voxelised shapes on every spacing, the exact ones on one
            self.assertEqual(place.count("\n| "), 1 + 12 + 4 * (len(variants) - 1))
            self.assertEqual(place.count("Choppiness"), 1)

    def test_a_second_time_changes_nothing(self):
        self.run_tool(report())
        once = self.document.read_text(encoding="utf-8")
        self.assertEqual(self.run_tool(report(), once)[0], 0)
        self.assertEqual(self.document.read_text(encoding="utf-8"), once)

    def test_a_missing_figure(self):
        for name in ("trilinear/torus-20-8mm/0.3x0.3x0.3/magnitude/p99",
                     "stored-normals-oct24/torus-20-8mm/0.625x0.625x0.9/choppiness/max"):
            figures = report()
            del figures["figures"][name]
            self.refuses(name, figures)

    def test_a_missing_place(self):
        self.refuses("smooth-sphere", report(), DOCUMENT.replace("<!-- figures: smooth-sphere -->", ""))
        self.refuses("more than one", report(), DOCUMENT + DOCUMENT)
        # a place without its own end must not swallow the next one
        self.refuses("figures: trilinear", report(), DOCUMENT.replace("<!-- end -->", "", 1))

    def test_no_report(self):
        self.refuses("cannot be read", "{\"figures\"")
        self.refuses("cannot be read", {"suite": "accuracy"})
        self.refuses("no figure", {"figures": {}})


if __name__ == "__main__":
    unittest.main()
