"""Opens the viewer page in headless Chromium against a running server and uses it as a person would.

usage: viewer_test.py [--campaigns] palpate PALPATE [TEST ...]          (`palpate explore knee-phantom`, coarse)
       viewer_test.py [--campaigns] mock NODE MOCK_SERVER PAGE_FOLDER [TEST ...]

Runs the tests of volume_test.py, contact_test.py, planes_test.py, tools_test.py and session_test.py in one browser; each of these scripts
runs its own tests with the same arguments. Without TEST, which is a CLASS or a CLASS.METHOD, the journeys, or the campaigns. What the page
decides, writes and asks for without a picture, a layout or real input is tested in Node (web/test/page_*.test.ts).

Exit code 77 (a skip) where there is no browser, except in CI, where that is a failure.
"""

import sys

sys.dont_write_bytecode = True  # nothing is left in the source tree
import contact_test  # noqa: E402
import planes_test  # noqa: E402
import session_test  # noqa: E402
import tools_test  # noqa: E402
import viewer_page  # noqa: E402
import volume_test  # noqa: E402

if __name__ == "__main__":
    # the classes that share a server (PointerSession) follow each other at the end
    viewer_page.main(sys.argv[1:], session_test, planes_test, tools_test, contact_test, volume_test)
