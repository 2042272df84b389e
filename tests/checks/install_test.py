#!/usr/bin/env python3
"""What `cmake --install` brings of the program: it runs where it was put, reads DICOM there, and each verb has a man page.

    install_test.py CMAKE BUILD
"""

import os
import pathlib
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
TESTS = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "docs"), str(TESTS)]
import fixtures

CMAKE, BUILD = sys.argv[1:3]


class Install(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-install-")
        cls.addClassCleanup(folder.cleanup)
        cls.root = pathlib.Path(folder.name)
        for component in ("library", "program"):
            subprocess.run([CMAKE, "--install", BUILD, "--component", component, "--prefix", cls.root / "usr"], check=True,
                           stdout=subprocess.DEVNULL)
        cls.palpate = cls.root / "usr/bin/palpate"

    def run_palpate(self, *arguments):
        return subprocess.run([self.palpate, *arguments], stdout=subprocess.PIPE, text=True, check=True,
                              env={**os.environ, "PALPATE_CACHE": ""}).stdout

    def test_it_reads_dicom_by_the_library_beside_it(self):
        sizes = [4, 4, 4]
        fixtures.write_study(self.root / "study", (sizes, [1.0, 1.0, 1.0], [0.0, 0.0, 0.0], struct.pack("<64f", *range(64))))
        self.assertIn("4 x 4 x 4", self.run_palpate("info", self.root / "study"))
        (self.root / "usr/lib/palpate/libpalpate_dicom.so").rename(self.root / "elsewhere.so")
        self.addCleanup((self.root / "elsewhere.so").rename, self.root / "usr/lib/palpate/libpalpate_dicom.so")
        with self.assertRaises(subprocess.CalledProcessError):
            self.run_palpate("info", self.root / "study")

    def test_the_module_of_slicer_is_there(self):
        module = self.root / "usr/share/palpate/slicer/Palpate"
        self.assertEqual({file.name for file in module.rglob("*.py")}, {file.name for file in (TESTS.parent / "slicer/Palpate").rglob("*.py")} - {"PalpateSelfTest.py"})
        for resource in ("Icons/Palpate.png", "UI/Palpate.ui"):
            self.assertTrue((module / "Resources" / resource).is_file(), resource)

    def test_a_verb_that_is_a_program_of_its_own_is_found(self):
        self.assertIn("accuracy", self.run_palpate("verify", "--list"))
        self.assertEqual(self.run_palpate("help", "verify"), self.run_palpate("verify", "--help"))
        beside, elsewhere = self.root / "usr/bin/palpate-verify", self.root / "usr/libexec/palpate/palpate-verify"
        elsewhere.parent.mkdir(parents=True)
        beside.rename(elsewhere)
        self.addCleanup(elsewhere.rename, beside)
        self.assertIn("accuracy", self.run_palpate("-q", "verify", "--list"))

    def test_one_that_is_missing_is_named(self):
        alone = self.root / "alone"
        alone.mkdir()
        palpate = alone / "palpate"
        shutil.copy(self.palpate, palpate)
        for arguments in (["verify", "--help"], ["help", "verify"]):
            done = subprocess.run([palpate, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False)
            self.assertEqual((done.returncode, done.stderr), (0, ""), arguments)
            self.assertIn("palpate-verify is a separate program, which is not installed", done.stdout)
        for arguments in (["verify", "--list"], ["--memory", "1G", "verify", "accuracy"]):
            done = subprocess.run([palpate, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False)
            self.assertEqual((done.returncode, done.stdout), (5, ""), arguments)
            self.assertEqual(done.stderr.count("palpate: error: palpate-verify: "), 1, done.stderr)

    def configure(self, components):
        """What CMake says of a project that finds palpate, installed as C alone, by these components."""
        project = self.root / "consumer"
        project.mkdir(exist_ok=True)
        (project / "CMakeLists.txt").write_text(
            "cmake_minimum_required(VERSION 3.25)\nproject(consumer LANGUAGES C)\n"
            f"find_package(palpate 1.0 REQUIRED {components})\nget_target_property(found palpate::c LOCATION)\nmessage(\"at ${{found}}\")\n",
            encoding="utf-8")
        done = subprocess.run([CMAKE, "-S", project, "-B", project / "build", f"-DCMAKE_PREFIX_PATH={self.root / 'c'}"],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        return done.returncode, done.stdout

    def test_the_library_for_c_is_found_and_what_is_not_there_is_refused(self):
        prefix = self.root / "c"
        for component in ("library", "c"):
            subprocess.run([CMAKE, "--install", BUILD, "--component", component, "--prefix", prefix], check=True,
                           stdout=subprocess.DEVNULL)
        self.assertEqual(sorted(path.name for path in (prefix / "lib/palpate").iterdir()), ["libpalpate_dicom.so"])
        for components in ("", "COMPONENTS c", "COMPONENTS c OPTIONAL_COMPONENTS core"):
            with self.subTest(components):
                code, printed = self.configure(components)
                self.assertEqual(code, 0, printed)
                self.assertIn(f"at {prefix}/lib/libpalpate.so.", printed)
        for components, missing in (("COMPONENTS core c", "core"), ("COMPONENTS c nothing", "nothing")):
            with self.subTest(components):
                code, printed = self.configure(components)
                self.assertNotEqual(code, 0)
                self.assertIn(f"its component {missing} is not installed", re.sub(r"\s+", " ", printed))
        flags = subprocess.run(["pkg-config", "--cflags", "--libs", "palpate"], stdout=subprocess.PIPE, text=True, check=True,
                               env={**os.environ, "PKG_CONFIG_PATH": str(prefix / "lib/pkgconfig")}).stdout
        self.assertIn("-lpalpate", flags)

    def test_each_verb_has_a_man_page(self):
        listed = self.run_palpate("--help").partition("\nSubcommands:\n")[2].partition("\n\n")[0]
        verbs = re.findall(r"^  ([\w-]+)", listed, re.MULTILINE)
        pages = {path.name: path.read_text(encoding="utf-8") for path in (self.root / "usr/share/man/man1").iterdir()}
        self.assertEqual(sorted(pages), sorted(["palpate.1", *(f"palpate-{verb}.1" for verb in verbs)]))
        for name, text in pages.items():
            self.assertRegex(text, r'\A\.TH "PALPATE[A-Z\\-]*" 1 "" "palpate \d', name)
            for head in ("NAME", "SYNOPSIS", "OPTIONS", "SEE ALSO"):
                self.assertIn(f"\n.SH {head}\n", text, name)
            # a line of the help that begins as a request does, and a plain hyphen, which is shown as another sign
            self.assertNotRegex(text, r"(?m)^\.(?!TH|SH|B |nf|fi)", name)
            self.assertNotRegex(text.replace("\\-", ""), r"(?m)^(?!\.TH).*[^\\]-", name)
        self.assertIn("\\-\\-script", pages["palpate-simulate.1"])
        self.assertIn("PALPATE SCENE CHECK", pages["palpate-scene.1"])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
