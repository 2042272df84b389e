"""The manual as a site, by Sphinx with MyST: `make manual`. The source is the whole repository, so that links between pages hold
as they stand in the files; what is read of it are the pages alone. The parts that the program prints are put in."""

import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs/site"))
import printed

PROGRAM = ROOT / "build/release/apps/palpate/palpate"  # built by tools/build_program

project = "palpate"
release = version = re.search(r"project\(palpate VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text(encoding="utf-8"))[1]
copyright = "the authors of palpate, Apache-2.0"
extensions = ["myst_parser"]
root_doc = "docs/README"
include_patterns = ["docs/**.md", "README.md", "CHANGELOG.md", "SECURITY.md", "bench/README.md", "web/README.md",
                    "third_party/uplot/README.md"]
exclude_patterns = ["build", "out", "**/node_modules"]
# anchors as GitHub makes them of headings
myst_heading_anchors = 4
# tables of keys, which the program prints, have headings of the third level wherever they stand
suppress_warnings = ["myst.header"]
html_theme = "furo"
html_title = f"palpate {release}"
html_show_sourcelink = False
html_copy_source = False

FOLDERS = {"start": "Start", "tutorials": "Tutorials", "guide": "Guide", "concepts": "Concepts", "reference": "Reference",
           "results": "Results", "help": "Help", "contributing": "Contributing", "decisions": "Decisions",
           "decisions/archive": "Archived decisions"}


def add_contents(app, name, source):
    """The map gets the lists of pages from which the site's sidebar is made, in the order in which the map names them; behind them
    those of each language that the manual is translated to, in docs/ by its name of two or three letters."""
    if name != root_doc:
        return
    named = re.findall(r"^- .*?\]\(([\w/.-]+)\.md", source[0], re.MULTILINE)
    for folder, caption in FOLDERS.items():
        pages = sorted(path.relative_to(ROOT / "docs").with_suffix("").as_posix() for path in (ROOT / "docs" / folder).glob("*.md"))
        pages.sort(key=lambda page: named.index(page) if page in named else len(named))
        if folder.startswith("decisions"):
            pages.sort(key=lambda page: page != f"{folder}/README")
        if pages:
            source[0] += "\n```{toctree}\n:hidden:\n:caption: " + caption + "\n" + "\n".join(pages) + "\n```\n"
    for folder in sorted(path for path in (ROOT / "docs").iterdir() if re.fullmatch(r"[a-z]{2,3}", path.name)):
        pages = sorted(path.relative_to(ROOT / "docs").with_suffix("").as_posix() for path in folder.rglob("*.md"))
        if pages:
            source[0] += "\n```{toctree}\n:hidden:\n:caption: In " + folder.name + "\n" + "\n".join(pages) + "\n```\n"
    source[0] += "\n```{toctree}\n:hidden:\n:caption: Beside the manual\n../README\n../bench/README\n../SECURITY\n../CHANGELOG\n../web/README\n../third_party/uplot/README\n```\n"


def add_printed_parts(app, name, source):
    if printed.MARK.search(source[0]):
        app.env.note_dependency(str(PROGRAM))  # such a page is read again when the program changes
        source[0] = printed.fill(source[0], PROGRAM)


def setup(app):
    app.connect("source-read", add_contents)
    app.connect("source-read", add_printed_parts)
