"""The manual as a site, by Sphinx with MyST: `make manual`. The source is the whole repository, so that links between pages hold
as they stand in the files; what is read of it are the pages alone."""

import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[2]

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


def setup(app):
    app.connect("source-read", add_contents)
