"""Figures that one run of a suite measured, and the rows of tables."""

import re

from results.numbers import as_chosen, span, two_digits

SUITES = ("accuracy", "contact", "stability", "removal", "tissue")


class Missing(Exception):
    """A figure, a marker or a row that is not there."""


class Figures:
    """What one run of a suite has measured, by name. In a pattern '*' stands for anything but '/', '**' for anything."""

    def __init__(self, suite, report):
        if report["suite"] != suite:
            raise Missing(f"{suite}.json is of the suite '{report['suite']}'")
        self.suite = suite
        self.figures = report["figures"]
        missing = [key for key in ("build", "machine", "date") if not report.get(key)]
        if missing:
            raise Missing(f"{suite}.json has no {missing[0]}: let the palpate of this commit write it")
        self.head = f"*`{suite}`: {report['build']};\n{report['machine']}; {report['date']}.*"

    def _entry(self, name):
        if name not in self.figures:
            raise Missing(f"{self.suite}.json has no figure '{name}'")
        return self.figures[name]

    def __getitem__(self, name):
        return float(self._entry(name)["value"])

    def limit(self, name):
        if "limit" not in self._entry(name):
            raise Missing(f"'{name}' has no limit in {self.suite}.json")
        return float(self.figures[name]["limit"])

    def names(self, *patterns):
        found = []
        for pattern in patterns:
            parts = [".*" if part == "**" else "[^/]*" if part == "*" else re.escape(part)
                     for part in re.split(r"(\*\*|\*)", pattern)]
            here = [name for name in self.figures if re.fullmatch("".join(parts), name)]
            if not here:
                raise Missing(f"{self.suite}.json has no figure '{pattern}'")
            found += here
        return found

    def maximum(self, *patterns):
        return max(self[name] for name in self.names(*patterns))

    def minimum(self, *patterns):
        return min(self[name] for name in self.names(*patterns))

    def span(self, write, *patterns):
        return span(write(self.minimum(*patterns)), write(self.maximum(*patterns)))

    def beyond_limits(self, *patterns):
        """The names of those beyond their limits."""
        return [name for name in self.names(*patterns or ("**",))
                if "limit" in self.figures[name] and self[name] > self.limit(name)]

    def count_within_limits(self, *patterns):
        """How many keep a limit, or have none."""
        return len(self.names(*patterns)) - len(self.beyond_limits(*patterns))


def row(*cells):
    return "|" + "".join(f" {cell} |" if cell else " |" for cell in cells)


def table(head, rows):
    return [row(*head), "|" + "---|" * len(head), *(row(*cells) for cells in rows)]


def limits(f):
    """Whether the limits were kept, and which were not."""
    count = sum("limit" in figure for figure in f.figures.values())
    beyond_limits = f.beyond_limits()
    if not beyond_limits:
        return [f"All {count} limits were kept."]
    return [f"**{len(beyond_limits)} of {count} limits were not kept:**", "",
            *(f"- `{name}`: {two_digits(f[name])}, limit {as_chosen(f.limit(name))}" for name in beyond_limits)]
