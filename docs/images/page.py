"""Takes a picture of a page in headless Chromium.

usage: page.py PAGE.html PICTURE.png WIDTH HEIGHT [SELECTOR]    the size in pixels, and CSS of what is left out
"""

import base64
import os
import sys

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "..", "tests", "browser"))
import browser  # noqa: E402


def main(source, picture, width, height, left_out=None):
    with browser.Browser() as page:
        page.dark(False)
        page.resize(int(width), int(height))
        page.open(os.path.abspath(source))
        page.wait("document.readyState === 'complete'")
        if left_out:
            page.run("for (const one of document.querySelectorAll(arguments[0])) one.remove()", left_out)
        # of a page that is longer, its beginning
        clip = {"x": 0, "y": 0, "width": int(width), "height": int(height), "scale": 1}
        data = page.developer_tools("Page.captureScreenshot", captureBeyondViewport=True, clip=clip)["data"]
        with open(picture, "wb") as file:
            file.write(base64.b64decode(data))


if __name__ == "__main__":
    if len(sys.argv) not in (5, 6):
        sys.exit(__doc__)
    main(*sys.argv[1:])
