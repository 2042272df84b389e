#!/usr/bin/env python3
"""tools/check_docs must see what is wrong with a page, and nothing else."""

import contextlib
import io
import pathlib
import sys
import tempfile
import textwrap
import unittest

sys.dont_write_bytecode = True
from load_tool import TOOLS, load_tool

WORDS = "one two three four five six seven eight nine ten "

tool = load_tool("check_docs")


def run(files, *options):
    """Exit code, and the lines that the tool prints of a tree of such files."""
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        for name, text in files.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text, encoding="utf-8")
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            code = tool.main([*options, str(root)])
    return code, said.getvalue().splitlines()


def faults(text, **others):
    """The faults of docs/guide/page.md, beside other files."""
    files = {"docs/guide/page.md": text, "docs/guide/other.md": "# Other page\n\n## A `key`, twice\n\n## A `key`, twice\n",
             "docs/a.png": "", "src/module/thing.cc": "", "src/module/thing_test.cc": "TEST(Suite, Passes) {\n}\n"}
    files.update({name.replace("__", "/").replace("_md", ".md"): value for name, value in others.items()})
    code, lines = run(files)
    lines = [line for line in lines if line.startswith("docs/guide/page.md:")]
    return [line.removeprefix("docs/guide/page.md:") for line in lines]


def wrapped(text):
    """Narrow enough."""
    return "\n".join(textwrap.wrap(text, 100)) + "\n"


class Links(unittest.TestCase):
    def test_what_is_there(self):
        self.assertEqual(faults("# Page\n[a](other.md) [b](other.md#a-key-twice) [c](other.md#a-key-twice-1) [d](#page)\n"
                                "[wrapped over\ntwo lines](other.md) ![text](../a.png) <https://example.org> [e](https://example.org/x)\n"
                                "`src/module/thing.cc` `src/MODULE/NAME_test.cc` `src/acme/acme_driver.cc` `test_acme_fake.h`\n`thing.cc` `mine.csv` `x/src/none.cc` `[f](gone.md)`\n\n"
                                "```sh\nroom_test --gtest_filter='Suite.P*'   [f](gone.md)\n```\n\n```sh\n[g](gone.md)\n```\n"), [])

    def test_what_is_not(self):
        for text, what in (("[a](gone.md)", "there is no gone.md"), ("[a](../../../etc)", "there is no ../../../etc"),
                           ("[a\nb](other.md#gone)", "nothing is headed #gone in other.md"), ("[a](#gone)", "nothing is headed #gone in this page"),
                           ("![text](gone.png)", "there is no gone.png"), ("![](../a.png)", "the picture ../a.png has no text in place of it"),
                           ("[![ ](../a.png)](other.md)", "the picture ../a.png has no text in place of it"),
                           ("<img src=\"../a.png\">", "write pictures and links as [text](path)"),
                           ("`src/module/gone.cc`", "there is no src/module/gone.cc"), ("`gone.cc`", "there is no source gone.cc"),
                           ("`palpate/module/gone.h`", "there is no palpate/module/gone.h"), 
                           ("```sh\ntools/gone\n```", "there is no tools/gone"), ("`--gtest_filter=Suite.F*`", "no test is Suite.F*")):
            with self.subTest(text):
                found = faults(text + "\n")
                self.assertEqual([fault.partition(": links: ")[2] for fault in found], [what])

    def test_all_pages_are_asked(self):
        for name in ("README.md", "CHANGELOG.md", "docs/decisions/x.md", "docs/deep/er/page.md", "web/README.md"):
            with self.subTest(name):
                self.assertEqual(run({name: "text\n\n[a](gone)\n"}), (1, [f"{name}:3: links: there is no gone"]))
        self.assertEqual(run({})[0], 1)


class PrintedParts(unittest.TestCase):
    FILES = {"docs/guide/page.md": "# Page\n\n[a](keys.md#tool) [b](keys.md#gone)\n",
             "docs/guide/keys.md": "# Keys\n\n<!-- printed: palpate scene keys -->\n\n[c](gone.md)\n"}

    def test_without_the_program_any_anchor_may_be_there(self):
        self.assertEqual(run(self.FILES), (1, ["docs/guide/keys.md:5: links: there is no gone.md"]))

    def test_with_it_they_are_checked(self):
        with tempfile.TemporaryDirectory() as folder:
            program = pathlib.Path(folder) / "palpate"
            program.write_text("#!/bin/sh\n[ \"$*\" = 'scene keys' ] && printf '### tool\\n\\n[d](away.md)\\n'\n")
            program.chmod(0o755)
            code, lines = run(self.FILES, "--program", str(program))
        self.assertEqual((code, lines), (1, ["docs/guide/keys.md:3: links: there is no away.md", "docs/guide/keys.md:5: links: there is no gone.md",
                                             "docs/guide/page.md:3: links: nothing is headed #gone in keys.md"]))


class Code(unittest.TestCase):
    def test_blocks_say_what_they_are(self):
        self.assertEqual(faults("text\n\n```sh\nls\n```\n\n1. item\n\n   ```text\n   x\n   ```\n"), [])
        self.assertEqual([fault.partition(" code: ")[2][:15] for fault in faults("text\n\n    ls\n    ls\n\n```\nls\n```\n\n```bash\nls\n```\n")],
                         ["a block without", "a block of '': ", "a block of 'bas"])


class Prose(unittest.TestCase):
    def kinds(self, text, **others):
        return [fault.split(": ")[1] for fault in faults(text, **others)]

    def test_width(self):
        wide = "word " * 25 + "\n"
        self.assertEqual(faults("a word.\n" + wide)[0], "2: width: 125 columns, 120 at most")
        for text in ("| " + wide.strip().replace(" ", " | ") + " |\n", "```\n" + wide + "```\n", "text\n\n    " + wide,
                     f"a [link]({'x' * 100}) with words here\n".replace("x" * 100, "../" * 30 + "guide/other.md"),
                     "x" * 130 + "\n"):
            self.assertNotIn("width", self.kinds(text), text)

    def test_sentences(self):
        self.assertEqual(faults("Fine.\n\n" + wrapped(WORDS * 3 + "a b c d e. " + "Fine. " * 9)), [])
        self.assertEqual(len(faults(wrapped(WORDS * 3 + "a b c d e f."))), 1)
        # as items and cells, too, and wherever the line breaks
        for text in (wrapped("- " + WORDS * 4), "| a | " + WORDS * 4 + "|\n|---|---|\n", wrapped("> " + WORDS * 4), "# Page\n" + (WORDS * 4).replace(" ", "\n")):
            self.assertEqual(self.kinds(text), ["sentence"], text)
        # a full stop ends a sentence, within an abbreviation or a figure it does not
        self.assertEqual(faults(wrapped((WORDS * 2 + "end. ").capitalize() * 9)), [])
        self.assertEqual(self.kinds(wrapped(WORDS * 2 + "e.g. " + WORDS + "0.5 " + WORDS)), ["sentence"])
        # code is one word, a link its text
        self.assertEqual(faults(wrapped("Say `" + WORDS * 5 + "` or [link](../guide/other.md) there.")), [])

    def test_one_long_sentence_of_ten(self):
        long_one = wrapped(("word " * 26).strip().capitalize() + ".")
        self.assertEqual(self.kinds(long_one), [])
        self.assertEqual(self.kinds(long_one * 2 + "A short one.\n" * 17), ["sentence"])
        self.assertEqual(self.kinds(long_one * 2 + "A short one.\n" * 18), [])
        # labels are not sentences among which long ones may hide
        self.assertEqual(self.kinds(long_one * 2 + "\n| a | b |\n|---|---|\n" + "| 1 | 2 |\n" * 20), ["sentence"])

    def test_histories(self):
        for text in ("It is no longer so.", "It is now so.", "It used to be so.", "Formerly it was so."):
            self.assertEqual(self.kinds(text), ["history"], text)
        for text in ("It is used to measure.", "What is known.", "`now`", "```sh\nnow\n```"):
            self.assertEqual(self.kinds(text), [], text)

    def test_glossary(self):
        glossary = "# Glossary\n\n| not | but |\n|---|---|\n| god object, ghost | *proxy* |\n"
        others = {"docs__help__glossary_md": glossary}
        self.assertEqual(faults("A God\nobject here.\n", **others), ["1: glossary: 'god object': proxy"])
        self.assertEqual(faults("A ghostly `ghost` and a ghost-writer.\n", **others), [])
        # that of this tree is read
        self.assertIn("no-go region", [instead for _, _, instead in tool.Manual(TOOLS.parent).banned_words])
        # its own table may name what is not used, its text may not
        self.assertEqual(run({"docs/help/glossary.md": glossary})[0], 0)
        self.assertEqual(run({"docs/help/glossary.md": glossary + "\nThe ghost.\n"})[0], 1)

    def test_the_glossary_is_short(self):
        entries = "# Glossary\n\n" + "- a word\n" * 148
        self.assertEqual(run({"docs/help/glossary.md": entries})[1], ["1 pages, no findings"])
        self.assertEqual(run({"docs/help/glossary.md": entries + "- one more\n"})[1],
                         ["docs/help/glossary.md:151: glossary: 151 lines, 150 at most"])

    def test_who_is_asked(self):
        old = {name: "It is no longer so.\n" for name in ("CHANGELOG.md", "docs/decisions/x.md", "bench/README.md")}
        self.assertEqual(run(old)[0], 0)
        for name in ("README.md", "docs/page.md", "docs/deep/er/page.md"):
            self.assertEqual(run({name: "It is no longer so.\n"})[0], 1)
            self.assertEqual(run({name: "It is no longer so.\n"}, "--links")[0], 0)

    def test_fix_breaks_wide_lines_alone(self):
        text = ("# Page\n\n" + "word " * 15 + "`a span of code that stays whole` " + "- no item of a list, [a link](" + "x" * 50 + ") "
                + "word " * 15 + "\n\n- an item " + "word " * 30 + "\n\nshort\nlines stay\n\n| " + "cell " * 30 + "|\n\n    "
                + "code " * 30 + "\n")
        with tempfile.TemporaryDirectory() as folder:
            page = pathlib.Path(folder) / "README.md"
            page.write_text(text, encoding="utf-8")
            tool.main(["--fix", folder])
            fixed = page.read_text(encoding="utf-8")
        self.assertEqual(fixed.split(), text.split())
        self.assertEqual(fixed.splitlines()[-6:], text.splitlines()[-6:])
        self.assertIn("`a span of code that stays whole`", fixed)
        self.assertNotIn("\n- no item", fixed)
        self.assertIn("\n  word", fixed)
        self.assertNotIn("width", self.kinds(fixed.replace("x" * 50, "page.md")))

    def test_words_of_translations_are_no_faults(self):
        text = "# Page\n\nLe client est now ici, et now [ailleurs](gone.md).\n"
        glossary = {"docs/help/glossary.md": "# Glossary\n\n| not | but |\n|---|---|\n| client | viewer |\n"}
        kinds = {name: [line.split(": ")[1] for line in run({**glossary, name: text})[1]] for name in ("docs/fr/page.md", "docs/guide/page.md")}
        self.assertEqual(kinds["docs/fr/page.md"], ["links"])
        self.assertEqual(sorted(kinds["docs/guide/page.md"]), ["glossary", "history", "history", "links"])

    def test_report(self):
        code, lines = run({"docs/page.md": "It is no longer so. It is now so.\n[a](gone)\n", "README.md": "Fine.\n"}, "--report")
        self.assertEqual(code, 0)
        self.assertEqual([line.split() for line in lines[1:]], [["0", "0", "0", "0", "0", "README.md"],
                                                                ["1", "0", "0", "2", "0", "docs/page.md"]])


class Pictures(unittest.TestCase):
    FILES = {"docs/images/a.png": "", "docs/page.md": "![a](images/a.png)\n"}
    HEAD = "# Pictures\n\n| picture | made by | data | commit | tried |\n|---|---|---|---|---|\n"

    def faults(self, *rows, **others):
        files = {**self.FILES, **others, "docs/help/pictures.md": self.HEAD + "".join(rows)}
        return [line.partition("pictures: ")[2] for line in run(files, "--links")[1] if "pictures: " in line]

    def test_the_list(self):
        a, b = ("| [{0}.png](../images/{0}.png) | `x` | none | 1 | 1 |\n".format(name) for name in "ab")
        self.assertEqual(self.faults(a), [])
        self.assertEqual(self.faults(), ["a.png has no row"])
        self.assertEqual(self.faults(a, b), ["there is no b.png"])
        self.assertEqual(self.faults(a, b, **{"docs/images/b.png": ""}), ["no page shows b.png"])
        self.assertEqual(run(self.FILES, "--links")[1], ["docs/help/pictures.md:1: pictures: there is no list"])


class Decisions(unittest.TestCase):
    PAGES = {"docs/decisions/archive/0001-first.md": "# 1. First\n\nText.\n",
             "docs/decisions/0002-second.md": "# 2. Second\n\n*Amends [1](archive/0001-first.md).*\n",
             "docs/decisions/archive/0003-third.md": "# 3. Third\n\n*Amends [2](../0002-second.md).*\n"}
    HEAD = "# Decisions\n\n| number | decision | amended by |\n|---|---|---|\n"
    ARCHIVE_HEAD = "# Archive\n\n| number | decision | why it is here | amended by |\n|---|---|---|---|\n"
    ROW = "| 2 | [Second](0002-second.md) | [3](archive/0003-third.md) |\n"
    ARCHIVED = ("| 1 | [First](0001-first.md) | superseded by 2 | [2](../0002-second.md) |\n"
                "| 3 | [Third](0003-third.md) | a measurement | |\n")

    def faults(self, row=ROW, archived=ARCHIVED, **pages):
        files = {**self.PAGES, **{f"docs/decisions/{name[1:].replace('__', '/').replace('_', '-')}.md": text for name, text in pages.items()},
                 "docs/decisions/README.md": self.HEAD + row, "docs/decisions/archive/README.md": self.ARCHIVE_HEAD + archived}
        return [line.partition("decisions: ")[2] for line in run(files, "--links")[1] if "decisions: " in line]

    def test_whole_indices(self):
        self.assertEqual(self.faults(), [])

    def test_what_lacks(self):
        self.assertEqual(self.faults(""), ["decision 2 has no row"])
        self.assertEqual(self.faults(archived=""), ["decision 1 has no row", "decision 3 has no row"])
        self.assertEqual(self.faults(self.ROW + self.ROW.replace("2 |", "3 |", 1)), ["decision 3 is not in this folder"])
        self.assertEqual(self.faults(self.ROW.replace("[Second]", "[Worst]")), ["title of decision 2 is [Second](0002-second.md)"])
        self.assertEqual(self.faults(self.ROW.replace("[3](archive/0003-third.md)", "")),
                         ["amended by of decision 2 is [3](archive/0003-third.md)"])
        self.assertEqual(self.faults(archived=self.ARCHIVED.replace("[2](../0002-second.md)", "")),
                         ["amended by of decision 1 is [2](../0002-second.md)"])
        self.assertEqual(self.faults(archived=self.ARCHIVED.replace("a measurement", "")),
                         ["decision 3 does not say why it is in the archive"])
        self.assertEqual(self.faults(self.ROW.replace("Second", "second"), _0002_second="# 4. Second\n\n*Amends [1](archive/0001-first.md).*\n")[0],
                         "is not headed '2. …'")

    def test_numbers_are_contiguous_over_both_folders(self):
        self.assertCountEqual(self.faults(_0005_fifth="# 5. Fifth\n"), ["there is no decision 4", "decision 5 has no row"])
        self.assertCountEqual(self.faults(_archive__0005_fifth="# 5. Fifth\n"), ["there is no decision 4", "decision 5 has no row"])
        self.assertIn("decision 2 is docs/decisions/0002-second.md, too", self.faults(_archive__0002_twice="# 2. Twice\n"))

    def test_each_folder_has_an_index(self):
        self.assertEqual(run(self.PAGES, "--links")[1], ["docs/decisions/README.md:1: decisions: there is no index",
                                                         "docs/decisions/archive/README.md:1: decisions: there is no index"])


if __name__ == "__main__":
    unittest.main()
