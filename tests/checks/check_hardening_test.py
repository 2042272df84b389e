#!/usr/bin/env python3
"""check_hardening must see each protection that a build leaves out.

    check_hardening_test.py COMPILER
"""

import pathlib
import platform
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).parent))
import check_hardening

COMPILER = sys.argv.pop() if len(sys.argv) > 1 else "c++"
SOURCE = """
#include <cstring>
namespace palpate {
void fill(char* from, unsigned long size);
int copy(const char* text) { char small[16]; std::strcpy(small, text); fill(small, sizeof small); return small[3]; }
int large() { char frame[40000]; fill(frame, sizeof frame); return frame[20000]; }
void fill(char* to, unsigned long size) { std::memset(to, static_cast<int>(size), size); }
}
int main(int, char** arguments) { return palpate::copy(arguments[0]) + palpate::large(); }
"""
# each with what undoes it, and words of the complaint
FLAGS = {
    "-fstack-protector-strong": ("-fno-stack-protector", "looks after its frame"),
    "-fstack-clash-protection": ("-fno-stack-clash-protection", "guard page"),
    "-fcf-protection=full": ("-fcf-protection=none", "in their middle"),
    "-D_FORTIFY_SOURCE=3": ("-U_FORTIFY_SOURCE", "sizes of copies"),
    "-Wl,-z,relro": ("-Wl,-z,norelro", "stays writable"),
    "-Wl,-z,now": ("-Wl,-z,lazy", "late"),
    "-Wl,-z,noexecstack": ("-Wl,-z,execstack", "may be executed"),
    "-pie": ("-no-pie", "fixed address"),
}


@unittest.skipUnless(platform.machine() == "x86_64", "flags of x86-64")
class CheckHardening(unittest.TestCase):
    def faults(self, left_out=None):
        flags = [undone if flag == left_out else flag for flag, (undone, _) in FLAGS.items()]
        with tempfile.TemporaryDirectory() as folder:
            source, program = pathlib.Path(folder) / "program.cc", pathlib.Path(folder) / "program"
            source.write_text(SOURCE)
            subprocess.run([COMPILER, "-O1", "-fno-inline", "-fPIE", *flags, source, "-o", program], check=True,
                           stderr=subprocess.DEVNULL)
            return check_hardening.faults(program)

    def test_a_program_with_all_of_them_has_no_fault(self):
        self.assertEqual(self.faults(), [])

    def test_each_that_is_left_out_is_seen(self):
        for flag, (_, words) in FLAGS.items():
            with self.subTest(flag):
                found = self.faults(left_out=flag)
                self.assertEqual(len(found), 1, found)
                self.assertIn(words, found[0])


if __name__ == "__main__":
    unittest.main()
