"""Takes a picture of a page in headless Chromium.

usage: page.py PAGE.html PICTURE.png WIDTH HEIGHT    the size in pixels
"""

import os
import sys

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "..", "tests", "browser"))
import browser  # noqa: E402


def main(source, picture, width, height):
    with browser.Browser() as page:
        page.dark(False)
        page.resize(int(width), int(height))
        page.open(os.path.abspath(source))
        page.wait("document.readyState === 'complete'")
        page.screenshot(picture)


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    main(*sys.argv[1:])
