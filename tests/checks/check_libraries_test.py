#!/usr/bin/env python3
"""check_libraries must see a strange, a forbidden and a moved library."""

import pathlib
import sys
import unittest

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).parent))
import check_libraries


class CheckLibraries(unittest.TestCase):
    allowed = {"libz": ("zlib1g", "Zlib"), "libITKCommon": ("libinsighttoolkit5.2", "Apache-2.0")}

    def faults(self, soname, package="zlib1g"):
        return check_libraries.faults(self.allowed, [(soname, "/lib/" + soname)], lambda path: package)

    def test_listed(self):
        self.assertEqual(self.faults("libz.so.1"), [])
        self.assertEqual(self.faults("libITKCommon-5.2.so.1", "libinsighttoolkit5.2"), [])
        # outside Debian nobody can tell the package
        self.assertEqual(self.faults("libz.so.1", None), [])

    def test_unknown(self):
        self.assertIn("check its licence", self.faults("libnew.so.3")[0])

    def test_forbidden_even_when_listed(self):
        self.allowed = dict(self.allowed, libfftw3=("libfftw3-double3", "GPL-2+"))
        self.assertIn("forbidden", self.faults("libfftw3.so.3")[0])
        self.assertIn("forbidden", self.faults("libITKFFT-5.2.so.1")[0])

    def test_other_package(self):
        self.assertIn("comes from elsewhere", self.faults("libz.so.1", "elsewhere")[0])

    def test_stems(self):
        self.assertEqual(check_libraries.stem("libldap-2.5.so.0"), "libldap-2.5")
        self.assertEqual(check_libraries.stem("/lib64/ld-linux-x86-64.so.2"), "ld-linux-x86-64")
        self.assertEqual(check_libraries.stem("libstdc++.so.6"), "libstdc++")
        self.assertEqual(check_libraries.stem("libITKVNLInstantiation-5.2.so.1"), "libITKVNLInstantiation")

    def test_reads_what_this_interpreter_loads(self):
        loaded = check_libraries.loaded_libraries("/bin/ls")
        self.assertIn("libc.so.6", [soname for soname, _ in loaded])


if __name__ == "__main__":
    unittest.main()
