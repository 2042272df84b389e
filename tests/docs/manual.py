"""The blocks of code of the manual's pages, and what their author says of each.

A comment before a block says how it is taken; without one it is run as its language asks (run_blocks.py):

    <!-- not run: REASON -->   it is read by nobody but people
    <!-- file: NAME -->        it is written to NAME in the page's folder, where later blocks find it
    <!-- before: COMMANDS -->  these are run before it, for what a reader has and the folder has not; $MANUAL is docs/
    <!-- output -->            it is what the block of commands before prints
"""

import dataclasses
import pathlib
import re

MARKS = re.compile(r"<!--\s*(?:(not run|file|before):\s*(\S.*?)|(output))\s*-->")


@dataclasses.dataclass
class Block:
    page: str  # from the root
    line: int  # of its first line within the fences
    language: str
    text: str
    not_run: str = ""
    file: str = ""
    before: str = ""
    output: bool = False

    def where(self):
        return f"{self.page}:{self.line}"


def pages(root):
    """The manual: the README and all of docs/ but the decisions, as paths from the root."""
    found = [root / "README.md", *sorted((root / "docs").rglob("*.md"))]
    return [path.relative_to(root).as_posix() for path in found if path.is_file() and "decisions" not in path.parts]


def blocks(root, page):
    """Every block between fences of a page, in its order."""
    found, marks, opened = [], {}, None
    for number, line in enumerate((pathlib.Path(root) / page).read_text(encoding="utf-8").splitlines(), 1):
        if opened:
            indent, fence, block = opened
            if line.strip() == fence:
                found.append(block)
                opened, marks = None, {}
            else:
                block.text += line.removeprefix(indent) + "\n"
            continue
        if match := re.match(r"(\s*)(`{3,})(\w*)\s*$", line):
            opened = match[1], match[2], Block(page, number + 1, match[3], "", **marks)
        elif match := MARKS.fullmatch(line.strip()):
            marks |= {"output": True} if match[3] else {match[1].replace(" ", "_"): match[2]}
        elif line.strip():
            marks = {}
    return found


def commands(block):
    """Command lines of a block; of a console block, the text after each `$ `. A trailing backslash joins the next line.
    """
    lines = re.sub(r"\\\n\s*", " ", block.text).splitlines()
    if block.language == "console":
        return [line[2:] for line in lines if line.startswith("$ ")]
    return [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
