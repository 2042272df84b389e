#!/usr/bin/env python3
"""tools/check_comments must find comments that open with a fragment or name no quantity, and nothing else."""

import contextlib
import io
import pathlib
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
from load_tool import load_tool

tool = load_tool("check_comments")


def found(text):
    """(line, finding without its remedy) of a source."""
    return [(line, what.partition(":")[0]) for line, what in tool.findings_in(text)]


def run(*arguments):
    """Exit code and printed lines."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = tool.main([str(argument) for argument in arguments])
    return code, said.getvalue().splitlines()


class Openings(unittest.TestCase):
    def test_in_comments_of_each_kind(self):
        for comment in ("// {} a wall", "/// {} a wall", "int x;  ///< {} a wall", "int x;  // {} a wall", "//! {} a wall",
                        "/* {} a wall */", "/**\n * {} a wall\n */", "//{} a wall", "// ---- {} a wall ----"):
            for word in ("Of", "That", "those", "What", "whose", "So", "likewise"):
                with self.subTest(comment=comment, word=word):
                    line = 2 if "\n" in comment else 1
                    self.assertEqual(found(comment.format(word) + "\n"), [(line, f"opens with '{word}'")])

    def test_other_first_words(self):
        for text in ("// Offset of a wall", "// Software", "// a wall of that", "// `of` is a method", "// }  // namespace",
                     "// first line\n// of two", "int x;  // first line\n        // of two", "int x;  ///< first line\n"
                     "        ///< of two"):
            self.assertEqual(found(text + "\n"), [], text)

    def test_each_comment_is_its_own(self):
        self.assertEqual(found("int x;  // position\n// of a wall\n"), [(2, "opens with 'of'")])
        self.assertEqual(found("// position\n\n// of a wall\n"), [(3, "opens with 'of'")])
        self.assertEqual(found("int x;  // position\nint y;  // of a wall\n"), [(2, "opens with 'of'")])
        self.assertEqual(found("/// Position.\n// of a wall\n"), [(2, "opens with 'of'")])


class Phrases(unittest.TestCase):
    def test_wherever_they_stand(self):
        for phrase in ("so much", "So many", "so far as", "as it is told", "no more than so"):
            self.assertEqual(found(f"// position\n// and {phrase}\n"), [(2, f"says '{phrase}'")])
        self.assertEqual(found("// position, so\n// much of it\n"), [(1, "says 'so much'")])
        self.assertEqual(found("// so far, and as many\n"), [(1, "opens with 'so'")])


class Literals(unittest.TestCase):
    def test_are_no_comments(self):
        for text in ('"// of"', '"\\"// of"', 'R"(// of)"', 'R"x(")"\n// of)x"', "'\"' + \"// of\"", "1'000 + \"// of\"",
                     "`// of ${a ? `// of` : ''}`", "/[`//] of/", "f(/'\\// of/)"):
            self.assertEqual(found(f"x = {text};\n"), [], text)
        for text in ('"a"', "'\"'", "1'000'000", "'\\''", 'R"(")"', "`${a}'`", "/`/g", "f(\n  /[`'/]/)",
                     "a / b"):
            line = 1 + text.count("\n")
            self.assertEqual(found(f"x = {text};  // of a wall\n"), [(line, "opens with 'of'")], text)


class Paths(unittest.TestCase):
    def paths_of(self, comment):
        return [what for _, what in tool.findings_in(f"int x;\n// {comment}\n", tool.bases_of(tool.ROOT / "src/core/contact/proxy.cc"))]

    def test_existing_paths(self):
        for path in ("src/core/contact/proxy.cc", "contact/proxy.cc", "palpate/contact/proxy.h", "contact/proxy.h", "proxy.h",
                     "state/session.ts", "docs/reference/feel.md", "reference/feel.md", "https://a.org/b/c.md", "/usr/include/a/b.h",
                     "hwy/foreach_target.h", "no/such/folder", "<sys/none.h>"):
            self.assertEqual(self.paths_of(f"the table of {path}, row 3."), [], path)

    def test_missing_paths(self):
        for path in ("src/core/contact/none.cc", "contact/none.h", "src/contact/proxy.cc", "state/none.ts", "docs/reference/none.md"):
            self.assertEqual(self.paths_of(f"the table ({path})."), [f"names '{path}', which does not exist: correct the path"], path)
        self.assertEqual(tool.findings_in("// see contact/none.h\n"), [])


class Files(unittest.TestCase):
    def test_named_files(self):
        with tempfile.TemporaryDirectory() as folder:
            bad, good, other, page, mock = (pathlib.Path(folder) / name
                                            for name in ("bad.cc", "good.h", "page.md", "page.ts", "mock.mjs"))
            bad.write_text("int x;\n// of a wall\n", encoding="utf-8")
            good.write_text("// stiffness of a wall\n", encoding="utf-8")
            other.write_text("// of a wall\n", encoding="utf-8")
            page.write_text("/** What is near. */\n", encoding="utf-8")
            mock.write_text("const a = `// of ${b}`; // so many voxels\n", encoding="utf-8")
            code, lines = run(bad, good, other, page, mock)
            self.assertEqual(code, 1)
            self.assertEqual([line.split(": ")[:2] for line in lines],
                             [[f"{bad}:2", "opens with 'of'"], [f"{page}:1", "opens with 'What'"],
                              [f"{mock}:1", "opens with 'so'"], [f"{mock}:1", "says 'so many'"]])
            self.assertEqual(run(good, other), (0, ["comments of 1 files, no findings"]))
            self.assertEqual(run(pathlib.Path(folder) / "missing.cc")[0], 2)

    def test_default_files(self):
        files = [file.relative_to(tool.ROOT) for file in tool.default_files()]
        for folder, suffixes in tool.FOLDERS.items():
            with self.subTest(folder=folder):
                found_suffixes = {file.suffix for file in files if file.is_relative_to(folder)}
                self.assertTrue(found_suffixes)
                self.assertLessEqual(found_suffixes, set(suffixes))
        for name in ("src/viewer/server/redacted_labels.h", "web/src/page.ts", "web/src/volume/field.ts", "web/test/mock_server.mjs"):
            self.assertIn(pathlib.Path(name), files)
        self.assertFalse([file for file in files if "node_modules" in file.parts])


if __name__ == "__main__":
    unittest.main()
