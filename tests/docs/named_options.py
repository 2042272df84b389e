"""Options, their defaults and versions that pages of the manual name, compared with the help texts of palpate."""

import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs/site"))
import manual
import printed

VERSION = re.search(r"project\(palpate VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text(encoding="utf-8"))[1]
# options of other programs that the manual names by themselves
OTHERS = {"--gtest_filter", "--ulimit", "--device"}


def verb_of(words, program):
    """The verb that a command line of palpate begins, and the rest of it."""
    verb = ()
    rest = list(words)
    while rest and (*verb, rest[0]) in program.helps:
        verb = (*verb, rest.pop(0))
    return verb, rest


def wrong_names(root, page, program):
    """Faults of the options and versions that a page names: of a command in its verb, by themselves in some verb."""
    faults = []
    everything = set().union(*(program.options(verb) for verb in program.helps))
    for block in manual.blocks(root, page):
        if block.language not in ("sh", "console"):
            continue
        for command in manual.commands(block):
            for call in re.findall(r"(?:^|[|&;(]\s*)(?:\$P|palpate)\s+([^|&;)]*)", command.split(" #")[0]):
                verb, rest = verb_of([word for word in call.split() if word not in ("--no-cache", "-q", "--follow-links")], program)
                if not verb and rest and not rest[0].startswith("-") and rest[0] not in ("help", "..."):
                    faults.append(f"{block.where()}: palpate has no verb {rest[0]}")
                    continue
                for option in re.findall(r"(?:^|\s)(--[a-z][\w-]*)", " " + " ".join(rest)):
                    if option not in program.options(verb) | program.options(()):
                        faults.append(f"{block.where()}: palpate {' '.join(verb)} has no option {option}")
    text = printed.fill((root / page).read_text(encoding="utf-8"), program.path)
    for number, line in enumerate(text.splitlines(), 1):
        for option in re.findall(r"`(--[a-z][\w-]*)[^`]*`", line):
            if option not in everything and option not in OTHERS:
                faults.append(f"{page}:{number}: palpate has no option {option}")
        # a measurement names the commit that made it, of whatever version
        for version in re.findall(r"palpate[\"`]?:? [\"`]?(\d+\.\d+\.\d+)(?!, commit [0-9a-f]{12})", line):
            if version != VERSION:
                faults.append(f"{page}:{number}: version {version}, this is {VERSION}")
    return faults + wrong_defaults(page, text, program)


def wrong_defaults(page, text, program):
    """Where a table of options tells one number or word as a default, and no verb has it for that option."""
    faults, column = [], None
    for number, line in enumerate(text.splitlines(), 1):
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")] if line.startswith("|") else []
        if not cells:
            column = None
        elif cells[0] == "option":
            column = cells.index("default") if "default" in cells else None
        elif column is not None and column < len(cells):
            option = re.match(r"`(--[\w-]+)", cells[0])
            told = re.match(r"`?([\w.-]+)`?(?::|$)", cells[column])
            known = program.defaults(option[1]) if option else set()
            if told and known and told[1] not in known:
                faults.append(f"{page}:{number}: the default of {option[1]} is {' or '.join(sorted(known))}")
    return faults
