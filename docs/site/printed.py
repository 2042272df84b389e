"""Parts of pages that the program prints: tables of keys, and the help of every verb. They are not committed. In the place of such a
part a page has a line of its own:

    <!-- printed: palpate scene keys -->      what the command writes on standard output
    <!-- printed: palpate help VERB -->       the help of every verb, each below a heading
"""

import re
import subprocess

MARK = re.compile(r"^<!-- printed: palpate (.+?) -->$", re.MULTILINE)
EVERY_HELP = "help VERB"


def run(program, *arguments):
    return subprocess.run([program, *arguments], stdout=subprocess.PIPE, text=True, check=True).stdout


def helps(program, verb=()):
    """{verb as a tuple of words: its help} of a verb and of those below it, in the order in which the help lists them."""
    text = run(program, *verb, "--help")
    found = {verb: text}
    for name in re.findall(r"^  ([\w-]+)", text.partition("\nSubcommands:\n")[2].partition("\n\n")[0], re.MULTILINE):
        found |= helps(program, (*verb, name))
    return found


def part(program, command):
    """Markdown that stands in the place of a mark."""
    if command != EVERY_HELP:
        return run(program, *command.split()).strip("\n")
    return "\n\n".join(f"{'###' if len(verb) > 1 else '##'} {' '.join(('palpate', *verb))}\n\n```text\n{text.rstrip()}\n```"
                       for verb, text in helps(program).items())


def fill(text, program):
    """A page with its printed parts in the places of their marks."""
    return MARK.sub(lambda mark: part(program, mark[1]), text)
