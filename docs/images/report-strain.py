"""Takes docs/guide/report.md's picture of a report whose tissue yields, in headless Chromium: the scan in the first contact's
sections, below it the same with its strain.

usage: report-strain.py REPORT.html PICTURE.png
"""

import os
import sys

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "..", "tests", "browser"))
import browser  # noqa: E402


def main(report, picture):
    with browser.Browser() as page:
        page.dark(False)
        page.resize(1280, 1000)
        page.open(os.path.abspath(report))
        page.wait("document.querySelectorAll('.uplot').length > 3")
        height = page.run("""
            document.getElementById("structures").value = 0;
            document.getElementById("structures").dispatchEvent(new Event("input"));
            const sections = document.querySelector(".sections"), below = sections.cloneNode(true);
            for (const strain of below.querySelectorAll(".strain")) strain.style.visibility = "visible";
            below.style.marginTop = "14px";
            sections.after(below);
            const panel = document.querySelector(".panel");
            document.body.replaceChildren(panel);
            document.body.style.padding = "16px";
            return panel.getBoundingClientRect().bottom + 16;""")
        page.resize(1280, round(height))
        page.screenshot(picture)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
