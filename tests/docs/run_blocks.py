#!/usr/bin/env python3
"""Runs the blocks of code of every page of the manual.

    run_blocks.py PALPATE [PAGE...]
    run_blocks.py PALPATE --part PART   the pages of one part (PARTS)

What a block is asked for, by its language:

sh       its commands run in the page's own folder, in the order of the page. Files that examples take for granted are there
         (fixtures.py). `palpate` is the program, as the page has it but for what makes it quick: phantoms are coarse, and a session
         lasts for a moment. Exit code 3, a figure out of its band, is a result and no failure, as is what doctor finds missing.
         The core, the C library and the Python package of the program's build folder are installed in ~/palpate.
console  the same of what stands behind `$ `, and what is printed is compared, figures aside; `...` stands for anything
python   runs there
json     is JSON
sql      is asked of records.db, which commands of the page have made
toml     is read by the program's own parsers, which is scene_test's (Docs.*)
text     is a picture, a formula, or, after <!-- output -->, what the commands before it print

Every other block says why it is not run (manual.py). Every option that is named exists; defaults in tables of options and versions are
those of the program. Prints each fault with its page and line, and at the end how many blocks
were run and why others were not; exit code 1 when there is any fault.
"""

import collections
import concurrent.futures
import copy
import json
import os
import pathlib
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True
ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "docs/site")]
import fixtures
import manual
import printed
import shared_cache
from named_options import wrong_names

PHANTOMS = "knee-phantom|shell-phantom|skull-phantom|gland-phantom|palpation-block|palpation-dome|abdominal-wall|temporal-bone"
COARSE = "spacing=2"
# a temple of 2 mm has to be thicker than a voxel's diagonal
FINER = "spacing=1.15"
# so has a plate of 1.2 mm
FINEST = "spacing=0.65"
# a busy machine compiles for some time
TIMEOUT_S = 240
# what --part runs: a page's blocks run in one of them, and `start` looks at the names in all pages
PARTS = ("start", "guide", "compiled")


def last_lines(text, count=8):
    return "".join("\n    " + line for line in text.strip().splitlines()[-count:])


class Program:
    """palpate in an isolated environment, with the help text of each verb."""

    def __init__(self, path, folder):
        self.path, self.folder = path, folder
        shared_cache.share_prepared_models(path)
        commands = folder / "commands"
        commands.mkdir()
        shutil.copy(pathlib.Path(__file__).parent / "palpate_wrapper.sh", commands / "palpate")
        (commands / "python3").symlink_to(sys.executable)
        self.environment = {"PATH": f"{commands}:{os.environ['PATH']}", "HOME": str(folder / "home"), "LANG": "C.UTF-8",
                            "PALPATE_PROGRAM": str(path), "PHANTOMS": PHANTOMS, "COARSE": COARSE, "FINER": FINER,
                            "FINEST": FINEST, "PALPATE_CACHE": os.environ["PALPATE_CACHE"],
                            "PALPATE_KNOWN_RUNS": str(folder / "known"), "PALPATE_RECORDS": "records.db", "MANUAL": str(ROOT / "docs"),
                            "PYTHONPATH": str(folder / "home/palpate/lib/python3/dist-packages"),
                            "PALPATE_SHORT": str(folder / "files" / "press.toml"), "PYTHONDONTWRITEBYTECODE": "1",
                            **{name: value for name, value in os.environ.items() if name.endswith("SAN_OPTIONS")}}
        self.helps = printed.helps(path)

    def with_cache(self, folder):
        other = copy.copy(self)
        other.environment = self.environment | {"PALPATE_CACHE": str(folder)}
        return other

    def options(self, verb):
        return set(re.findall(r"(?<![\w-])--?[a-zA-Z][\w-]*", re.sub(r"\nExamples:.*", "", self.helps[verb], flags=re.DOTALL)))

    def defaults(self, option):
        """What the helps tell as its default, in whichever verb: after '=' behind its type, or in words."""
        entry = rf"^ +(?:-\w,)?{option} (.*(?:\n {{20,}}.*)*)"
        entries = [match for text in self.helps.values() for match in re.findall(entry, text, re.MULTILINE)]
        return {value.rstrip(".,;") for entry in entries for value in
                re.findall(r"^[^\n]*?=(\S+?)(?=\s\s|$|\n)", entry) + re.findall(r"default:? (\S+)", entry)}

    def run(self, script, folder):
        """Runs a shell script in `folder` and returns (exit code, output). The script and its children are killed after
        TIMEOUT_S seconds."""
        with subprocess.Popen(["bash", "-e", "-o", "pipefail", "-c", script], cwd=folder, env=self.environment, text=True,
                              errors="replace", stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              start_new_session=True) as process:
            try:
                printed, _ = process.communicate(timeout=TIMEOUT_S)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                printed = process.communicate()[0] + f"\nis not done after {TIMEOUT_S} s\n"
        return process.returncode, printed

    def install_libraries(self):
        """What pages link and import, in ~/palpate: the core, the C library and the Python package of the program's build folder."""
        for component in ("library", "core", "c", "python"):
            subprocess.run(["cmake", "--install", self.path.parents[2], "--component", component, "--prefix", self.folder / "home/palpate"],
                           stdout=subprocess.PIPE, check=True)
        if shutil.which("ccache"):
            self.environment |= {"CMAKE_CXX_COMPILER_LAUNCHER": "ccache", "CCACHE_BASEDIR": str(self.folder), "CCACHE_NOHASHDIR": "1",
                                 "CCACHE_DIR": subprocess.run(["ccache", "-k", "cache_dir"], stdout=subprocess.PIPE, text=True, check=True).stdout.strip()}

    def must(self, folder, *arguments):
        code, printed = self.run("palpate " + " ".join(map(str, arguments)), folder)
        if code != 0:
            sys.exit(f"run_blocks.py: palpate {' '.join(arguments)} failed:{last_lines(printed)}")


def masked(line):
    """A line of output without its figures, and without what made it quick."""
    line = re.sub(rf"[:,_](?:{COARSE}|{FINER}|{FINEST})\b", "", line)
    line = re.sub(r"\b[0-9a-f]{16}\b", "#", line)
    return " ".join(re.sub(r"-?\d+(?:[.,]\d+)*(?:e[+-]?\d+)?", "#", line).split())


def differs(expected, printed):
    """Where printed lines are not as expected: a text, or nothing. A line of '...' stands for any number of lines."""
    pattern = ""
    for line in expected:
        if line.strip() == "...":
            pattern += r"(?:.*\n)*"
        else:
            pattern += ".*".join(re.escape(masked(part)) for part in line.split("...")).replace(r"\ .*", ".*").replace(r".*\ ", ".*") + r"\n"
    # how far long work has got is told on a busy machine alone
    text = "".join(masked(line) + "\n" for line in printed if line.strip() and not re.fullmatch(r"[a-z][a-z ,]* \d+ %", line))
    return "" if re.fullmatch(pattern, text) else "prints something else:" + last_lines("\n".join(printed), 12)


def split_console(text):
    """(command, lines that it prints) of a block with prompts."""
    found = []
    for line in re.sub(r"\\\n\s*", " ", text).splitlines():
        if line.startswith("$ "):
            found.append((line[2:], []))
        elif found and line.strip():
            found[-1][1].append(line)
    return found


def exit_fault(code, printed):
    return [f"ends with exit code {code}:{last_lines(printed)}"] if code != 0 else []


def run_console(block, program, folder):
    """Faults of the commands behind prompts, and what the last of them printed."""
    faults, printed = [], ""
    for command, expected in split_console(block.text):
        code, printed = program.run(command, folder)
        # an error that is shown is what is wanted
        wrong = [differs(expected, printed.splitlines())] if expected else exit_fault(code, printed)
        faults += [f"{command}: {what}" for what in wrong if what]
    return faults, printed


def run_block(block, program, folder, printed):
    """Its faults, and what it printed; `printed` is what the block before did."""
    if block.output:
        what = differs(block.text.splitlines(), printed.splitlines())
        return [what] if what else [], printed
    if block.language == "sh":
        code, printed = program.run(block.text, folder)
        return exit_fault(code, printed), printed
    if block.language == "console":
        return run_console(block, program, folder)
    if block.language == "python":
        (folder / "block.py").write_text(block.text, encoding="utf-8")
        code, printed = program.run("python3 block.py", folder)
        return exit_fault(code, printed), printed
    if block.language == "json":
        try:
            json.loads(block.text)
        except ValueError as error:
            return [f"is no JSON: {error}"], ""
    elif block.language == "sql":
        try:
            found = sqlite3.connect(f"file:{folder / 'records.db'}?mode=ro", uri=True).execute(block.text).fetchall()
        except sqlite3.Error as error:
            return [f"is not taken by SQLite: {error}"], ""
        return [] if found else ["finds nothing in records.db"], ""
    elif block.language not in ("toml", "text") and not block.file:
        return [f"'{block.language}' is not run here: say why by <!-- not run: REASON -->"], ""
    return [], ""


def part_of(page):
    """The part that runs a page's blocks: `compiled` where they compile programs, `start` where a reader begins."""
    if any(command.lstrip().startswith("cmake ") for block in manual.blocks(ROOT, page) if not block.not_run
           for command in manual.commands(block)):
        return "compiled"
    return "start" if page == "README.md" or page.startswith("docs/start/") else "guide"


def needs_libraries(page):
    """Whether blocks of a page compile programs, or import the Python package."""
    return part_of(page) == "compiled" or any(re.search(r"^import palpate\b", block.text, re.MULTILINE)
                                              for block in manual.blocks(ROOT, page) if not block.not_run)


def run_page(page, program, files):
    """Faults of its blocks, and how many were run or, by their reason, not."""
    faults, counts, printed = [], collections.Counter(), ""
    folder = pathlib.Path(tempfile.mkdtemp(dir=program.folder))
    shutil.copytree(files, folder, dirs_exist_ok=True)
    # where the cache is the subject, the page has one of its own
    if any("palpate cache" in block.text for block in manual.blocks(ROOT, page)):
        program = program.with_cache(folder / "cache")
    shutil.copytree(ROOT / "docs/images", folder / "docs/images", ignore=shutil.ignore_patterns("*.png", "*.svg"))
    # where the program stands for who has built it
    (folder / "build/release/apps/palpate").mkdir(parents=True)
    (folder / "build/release/apps/palpate/palpate").symlink_to(program.folder / "commands/palpate")
    for block in manual.blocks(ROOT, page):
        if block.file:
            (folder / block.file).write_text(block.text, encoding="utf-8")
        if block.not_run:
            counts[block.not_run] += 1
            continue
        counts["run"] += 1
        wrong = []
        if block.before:
            wrong += [f"what is run before it {what}" for what in exit_fault(*program.run(block.before, folder))]
        of_block, printed = run_block(block, program, folder, printed)
        faults += [f"{block.where()}: {what}" for what in wrong + of_block]
    return faults, counts


def try_page(page, program, files, part=None):
    """Faults of a page, and how many blocks were run: of all it has, or of what a part asks."""
    faults, counts = run_page(page, program, files) if part in (None, part_of(page)) else ([], collections.Counter())
    return faults + (wrong_names(ROOT, page, program) if part in (None, PARTS[0]) else []), counts


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    faults, counts = [], collections.Counter()
    part = sys.argv[3] if sys.argv[2:3] == ["--part"] else None
    if part not in (None, *PARTS):
        sys.exit(__doc__)
    asked = sys.argv[2:] if part is None and sys.argv[2:] else manual.pages(ROOT)
    with tempfile.TemporaryDirectory(prefix="palpate-docs-") as folder:
        program = Program(pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(folder))
        if any(part in (None, part_of(page)) and needs_libraries(page) for page in asked):
            program.install_libraries()
        files = pathlib.Path(folder) / "files"
        files.mkdir()
        fixtures.make(files, lambda *arguments: program.must(files, *arguments))
        # a session waits for the clock: two pages at a time
        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            for page, (lines, taken) in zip(asked, pool.map(lambda page: try_page(page, program, files, part), asked)):
                faults += lines
                counts += taken
    print("".join(fault + "\n" for fault in faults), end="")
    print(f"{counts.pop('run')} blocks run; not run: {sum(counts.values())}")
    for reason, count in sorted(counts.items(), key=lambda item: (-item[1], item[0])):
        print(f"  {count}  {reason}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
