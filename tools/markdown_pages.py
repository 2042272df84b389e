"""Markdown pages of the manual, taken apart into headings, prose, tables and code."""

import collections
import pathlib
import re
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "docs/site"))
import printed

WIDTH = 120
LABEL = 5  # a cell of fewer words is a label or a figure
# a full stop after these ends no sentence
ABBREVIATIONS = re.compile(r"\b(?:e\.g|i\.e|c|cf|vs|ca|al|approx|incl|p|pp|vol|ed|eds|Fig|Eq|Tab|No|Nr|Dr|Prof|St)\.$")
SPAN = re.compile(r"(?<!`)(`+)(?!`)(?:(?!\n\n).)+?(?<!`)\1(?!`)", re.DOTALL)


class Block:
    """A piece of prose: a paragraph, an item of a list, a cell. `line` is where it begins; of what may be broken anew, `lines`
    are its lines and `margins` what stands before the first and before the others."""

    def __init__(self, line, text, margins=None):
        self.line, self.text, self.margins = line, text, margins
        self.lines = [line]

    def add(self, line, text):
        self.text += "\n" + text
        self.lines.append(line)

    def rewrapped(self):
        """The block's text wrapped to WIDTH. Code spans are not broken, and no line starts with a list, heading or
        table marker."""
        pieces, glued = re.findall(r"(?:[^\s`]|`[^`]*`)+|`", " ".join(self.text.split())), []
        for piece in pieces:
            if glued and re.match(r"[-+*#>|]|\d+[.)]", piece):
                glued[-1] += " " + piece
            else:
                glued.append(piece)
        lines, line = [], self.margins[0]
        for piece in glued:
            margin = self.margins[min(len(lines), 1)]
            longer = line + piece if line == margin else line + " " + piece
            if line != margin and shown_width(longer) > WIDTH:
                lines.append(line)
                line = self.margins[1] + piece
            else:
                line = longer
        return lines + [line]


class Page:
    """A Markdown file, taken apart. With a program its printed parts are in their places."""

    def __init__(self, path, name, program=None):
        self.name = name
        source = path.read_text(encoding="utf-8")
        self.is_complete = bool(program) or not printed.MARK.search(source)
        lines = []
        self.source_lines = []  # line of the file that each line of the text is from
        for number, line in enumerate(source.splitlines(), 1):
            shown = printed.fill(line, program).splitlines() or [""] if program else [line]
            lines += shown
            self.source_lines += [number] * len(shown)
        self.text = "\n".join(lines) + "\n"
        self.prose_lines = []  # (number, line) of what is neither code nor table
        self.blocks = []
        self.code = []  # (number, line) of its blocks
        self.fences = []  # (number, language) where one begins; without a fence None
        self.headings = []
        self.rows = []  # (number, cells)
        self._take_apart()
        code = {number for number, _ in self.code}
        self.without_blocks = "\n".join("" if number in code else line for number, line in enumerate(self._uncommented, 1))

    def _take_apart(self):
        # remove HTML comments, but keep their line breaks so that line numbers stay valid
        self._uncommented = re.sub(r"<!--.*?-->", lambda m: "\n" * m[0].count("\n"), self.text, flags=re.DOTALL).splitlines()
        block, fence, in_list, blank, indented = None, None, False, True, False
        for number, line in enumerate(self._uncommented, 1):
            stripped = line.strip()
            if fence:
                if stripped.startswith(fence) and not stripped.strip(fence[0]):
                    fence = None
                else:
                    self.code.append((number, line))
                continue
            opened = re.match(r"\s*(`{3,}|~{3,})", line)
            if opened:
                fence, block = opened[1], None
                self.fences.append((number, stripped.removeprefix(fence)))
                continue
            if not stripped:
                blank, block = True, None
                continue
            # four spaces after an empty line are code, and eight within an item of a list
            if re.match(r" {8}" if in_list else r" {4}", line) and (blank or indented):
                if not indented:
                    self.fences.append((number, None))
                indented = True
                self.code.append((number, line))
                continue
            indented = False
            if stripped.startswith("|"):
                block = None
                cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", stripped.strip("|"))]
                if not all(re.fullmatch(r":?-+:?", cell) for cell in cells):
                    self.rows.append((number, cells))
                    self.blocks += [Block(number, cell) for cell in cells if len(plain(cell).split()) >= LABEL]
                blank = False
                continue
            heading = re.match(r"(#+)\s+(.*)", line)
            item = re.match(r"(\s*(?:[-*+]|\d+[.)])\s+)(.*)", line)
            quoted = re.match(r"(\s*>\s?)(.*)", line)
            if heading:
                self.headings.append((number, heading[2].strip()))
                block, in_list = None, False
            elif item and (blank or in_list or block is None):
                block = Block(number, item[2], (item[1], " " * len(item[1])))
                self.blocks.append(block)
                in_list = True
            else:
                content = quoted[2] if quoted else stripped
                if blank and not line.startswith(" "):
                    in_list = False
                if block is None:
                    margin = quoted[1] if quoted else re.match(r" *", line)[0]
                    block = Block(number, content, (margin, margin))
                    self.blocks.append(block)
                else:
                    block.add(number, content)
            self.prose_lines.append((number, line))
            blank = False

    def anchors(self):
        """What '#...' may name, as GitHub and MyST make it of headings."""
        found, seen = set(), collections.Counter()
        for _, heading in self.headings:
            plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
            slug = re.sub(r"[^\w\- ]", "", plain.lower().replace("`", "")).replace(" ", "-")
            found.add(slug if not seen[slug] else f"{slug}-{seen[slug]}")
            seen[slug] += 1
        return found


def plain(text):
    """What is read of Markdown: a span of code is one word, a link its text, a picture nothing."""
    text = SPAN.sub(" CODE ", " ".join(text.split()))
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", " ", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    return re.sub(r"[*_]{1,3}(?=\S)|(?<=\S)[*_]{1,3}", "", text)


def sentences(text):
    """The sentences of a block as lists of words. A full stop, ! or ? ends one where a new one can begin."""
    found, words = [], []
    tokens = plain(text).split()
    for token, after in zip(tokens, tokens[1:] + [""]):
        if re.search(r"\w", token):
            words.append(token)
        ends = re.search(r"[.!?][\"')\]]*$", token) and not ABBREVIATIONS.search(token.strip("\"'()[]") if token[-1] == "." else "")
        if ends and (not after or not after.lstrip("\"'([")[:1].islower()):
            found.append(words)
            words = []
    if words:
        found.append(words)
    return [words for words in found if words]


def shown_width(line):
    """Columns of a line. The target of a link cannot be broken, so it does not count."""
    return len(re.sub(r"\]\([^)]*\)", "]()", line))
