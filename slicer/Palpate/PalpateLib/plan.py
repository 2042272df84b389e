"""Lines of the scene as a plan of palpate (docs/guide/rehearsal.md)."""

from .errors import PalpateError
from .grid import RAS_LPS


def _quoted(text):
    """A basic string of TOML."""
    escapes = {'"': '\\"', "\\": "\\\\"}
    return '"' + "".join(escapes.get(c, c if c.isprintable() else f"\\u{ord(c):04x}") for c in text) + '"'


def _point(ras_mm):
    """A position in LPS, as TOML."""
    return "[" + ", ".join(repr(round(float(x), 4)) for x in RAS_LPS @ ras_mm) + "]"


def plan_text(lines, title):
    """@param lines  [(name, positions in RAS, mm)]: a trajectory each, from its entry to its target
    @returns the plan's file. Requirements are added there by hand"""
    if not lines:
        raise PalpateError("no line is chosen", "", "draw a Line in Markups, first the entry and then the target")
    text, names = [f"title = {_quoted(title)}"], set()
    for name, positions in lines:
        if len(positions) != 2:
            raise PalpateError(f"has {len(positions)} points", name,
                               "a trajectory is a Line of two points: the entry, then the target")
        own, number = name or "trajectory", 2
        while own in names:
            own, number = f"{name or 'trajectory'} {number}", number + 1
        names.add(own)
        entry, target = map(_point, positions)
        text += ["", "[[trajectory]]", f"name = {_quoted(own)}", f"entry = {entry}  # LPS, mm", f"target = {target}"]
    return "\n".join(text) + "\n"
