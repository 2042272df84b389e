"""Takes docs/guide/cohort.md's picture of a cohort's page in headless Chromium: sorted by the thinnest place of a structure, two
cases compared.

usage: cohort.py INDEX.html PICTURE.png
"""

import os
import sys

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "..", "tests", "browser"))
import browser  # noqa: E402


def main(index, picture):
    with browser.Browser() as page:
        page.dark(False)
        page.resize(1480, 1000)
        page.log()
        page.open(os.path.abspath(index))
        page.wait("document.readyState === 'complete'")
        height = page.run("""
            document.querySelectorAll("thead button")[5].click();
            const ticks = [...document.querySelectorAll("tbody input")];
            for (const n of [0, 1]) ticks[n].click();
            return document.querySelector("main").getBoundingClientRect().bottom;""")
        page.resize(1480, round(height))
        page.screenshot(picture)
        print(page.log())


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
