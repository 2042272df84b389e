"""Headless Chromium driven over WebDriver with nothing but Python's standard library."""

import base64
import json
import os
import pathlib
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.error
import urllib.request

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import shared_cache

# nothing is taken from the user's cache, or left in it: the tests of a build have one of their own
os.environ["PALPATE_CACHE"] = ""
for program in [os.environ.get("PALPATE", ""), *sys.argv[1:]]:
    if pathlib.Path(program).name == "palpate":
        shared_cache.share_prepared_models(program)
        break
ELEMENT = "element-6066-11e4-a52e-4f735466cecf"  # WebDriver's name for an element's id
SCRIPT_SECONDS = 300
ARGUMENTS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--force-device-scale-factor=1",
]


def missing_programs():
    """Message that names the programs a browser test needs and this machine lacks, or None."""
    absent = [program for program in ("chromium", "chromedriver") if shutil.which(program) is None]
    return ("not installed: " + ", ".join(absent)) if absent else None


def run_tests(also_needed=None, **options):
    """Runs the script's tests, or skips them with exit code 77, in CI with the failure 1.

    @param also_needed  why this machine cannot run the tests although it has a browser, or None
    @param options  those of unittest.main
    """
    if reason := missing_programs() or also_needed:
        print("skipped: " + reason)
        sys.exit(1 if os.environ.get("CI") == "true" else 77)
    unittest.main(verbosity=2, **options)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Browser:
    """A session in a fresh profile; a context manager."""

    def __enter__(self):
        self.port = free_port()
        self.profile = tempfile.mkdtemp(prefix="palpate-browser-")
        self.driver = subprocess.Popen(["chromedriver", f"--port={self.port}"], stdout=subprocess.DEVNULL,
                                       stderr=subprocess.DEVNULL)
        try:
            self._wait_for_driver()
            options = {"args": ARGUMENTS + [f"--user-data-dir={self.profile}"]}
            # on a slow machine that works on something else, a script may take long
            capabilities = {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"},
                            "timeouts": {"script": 1000 * SCRIPT_SECONDS}}
            answer = self._request("POST", "/session", {"capabilities": {"alwaysMatch": capabilities}})
            self.session = "/session/" + answer["sessionId"]
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(self, *_):
        try:
            self._request("DELETE", self.session)
        finally:
            self._stop()

    def _stop(self):
        self.driver.terminate()
        self.driver.wait()
        shutil.rmtree(self.profile, ignore_errors=True)

    def _request(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}{path}", method=method, data=data,
                                         headers={"Content-Type": "application/json"})
        # never through a proxy
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        try:
            with opener.open(request, timeout=SCRIPT_SECONDS + 60) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            raise RuntimeError(f"{path}: {error.read().decode(errors='replace')[:1000]}") from error

    def _wait_for_driver(self):
        deadline = time.monotonic() + 300
        while True:
            try:
                if self._request("GET", "/status")["ready"]:
                    return
            except OSError:
                pass
            if time.monotonic() > deadline:
                raise RuntimeError("chromedriver does not answer")
            time.sleep(0.05)

    def post(self, path, body):
        return self._request("POST", self.session + path, body)

    def open(self, path):
        self.post("/url", {"url": "file://" + os.path.abspath(path)})

    # ---- windows, of which each keeps its own token

    def window(self):
        """The window that is driven."""
        return self._request("GET", self.session + "/window")

    def open_window(self):
        """A further window, which is driven from here on; returns it."""
        opened = self.post("/window/new", {"type": "window"})["handle"]
        self.switch_to(opened)
        return opened

    def switch_to(self, window):
        self.post("/window", {"handle": window})

    def close_window(self):
        """Closes the window that is driven; drive another one next."""
        self._request("DELETE", self.session + "/window")

    def type(self, selector, text):
        element = self.post("/element", {"using": "css selector", "value": selector})
        self.post(f"/element/{element[ELEMENT]}/value", {"text": text})

    def run(self, script, *arguments):
        """Runs the body of a JavaScript function in the page; returns what it returns."""
        return self.post("/execute/sync", {"script": script, "args": list(arguments)})

    def wait(self, script, seconds=300):
        """Until the expression is true."""
        deadline = time.monotonic() + seconds
        while not self.run("return " + script):
            if time.monotonic() > deadline:
                raise AssertionError("never became true: " + script)
            time.sleep(0.02)

    def hear(self):
        """Collects in window.heard every text of the page's live region from now on, because the next text may replace
        one before a test reads it."""
        self.run("window.heard = []; const box = document.getElementById('spoken'); "
                 "new MutationObserver(() => window.heard.push(box.textContent)).observe(box, { childList: true })")

    def log(self):
        """Messages of the console since the last call."""
        return self.post("/se/log", {"type": "browser"})

    def developer_tools(self, command, **parameters):
        return self.post("/goog/cdp/execute", {"cmd": command, "params": parameters})

    def resize(self, width, height):
        self.developer_tools("Emulation.setDeviceMetricsOverride", width=width, height=height,
                             deviceScaleFactor=1, mobile=False)

    def dark(self, is_dark):
        self.developer_tools("Emulation.setEmulatedMedia", features=[
            {"name": "prefers-color-scheme", "value": "dark" if is_dark else "light"}])

    def press(self, key):
        """A key with its WebDriver code, e.g. ARROW_RIGHT, into what has the focus."""
        self.post("/actions", {"actions": [{"type": "key", "id": "keys", "actions": [
            {"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]}]})

    def pointer(self, *steps):
        """Mouse actions as WebDriver names them; pointerMove takes viewport pixels."""
        self.post("/actions", {"actions": [{"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"},
                                            "actions": list(steps)}]})

    def click(self, selector):
        element = self.post("/element", {"using": "css selector", "value": selector})
        self.post(f"/element/{element[ELEMENT]}/click", {})

    def screenshot(self, file):
        """The whole page as a PNG."""
        picture = self.developer_tools("Page.captureScreenshot", captureBeyondViewport=True)
        with open(file, "wb") as out:
            out.write(base64.b64decode(picture["data"]))

    def pdf(self, file):
        with open(file, "wb") as out:
            out.write(base64.b64decode(self.post("/print", {"background": True})))


ARROW_LEFT, ARROW_RIGHT, HOME, END = "\ue012", "\ue014", "\ue011", "\ue010"
