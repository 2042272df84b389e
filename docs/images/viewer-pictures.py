"""Takes the pictures of the page in docs/guide/viewer.md, viewer-looking.md and docs/tutorials/training.md in headless Chromium.

usage: viewer-pictures.py [--language CODE] FOLDER COMMAND...

COMMAND is palpate explore, also with a --task that a hand does, a --plan, or palpate replay --view, also
of a scene with a no-go region or a palpation-block. It is run with a port of its own, and ended. CODE is one of the page's languages, as 'de'; en where none is named.
"""

import os
import socket
import subprocess
import sys
import time

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "..", "tests", "browser"))
import browser  # noqa: E402

browser.ARGUMENTS = [argument for argument in browser.ARGUMENTS if argument != "--disable-gpu"] + [
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]


def rest(page, where):
    """Plays a recording, and pauses it where something holds: what goes along with a hand is gone sooner than a processor draws it."""
    play = "document.getElementById('play').click()"
    for _ in range(8):
        if not page.run("return palpateViewer.state.playback.playing"):
            page.run(play)
            page.wait("palpateViewer.state.playback.playing", 60)
        page.wait(where, 120)
        page.run(play)
        page.wait("!palpateViewer.state.playback.playing", 60)
        time.sleep(1)
        if page.run("return " + where):
            return
    raise AssertionError("was never at rest: " + where)


def task(page, folder):
    """A run that is under way and then over."""
    page.resize(1440, 900)
    page.dark(True)
    page.run("document.querySelector('[data-layout=volume]').click()")
    page.wait("palpateViewer.training.run.done.every((done) => done)", 120)
    page.run("document.getElementById('task-end').click()")
    page.wait("palpateViewer.training.view === 'debriefing'")
    page.run("document.querySelector('#task-steps .where').click()")
    page.wait("palpateViewer.isVolumeSharp", 300)
    page.run("palpateViewer.draw()")
    time.sleep(0.5)
    page.screenshot(os.path.join(folder, "viewer-training.png"))


def no_go(page, folder):
    """A region that pushes, of a recording that rests there: a hand is pushed out sooner than pictures are drawn."""
    page.resize(1440, 900)
    page.dark(True)
    page.run("document.querySelector('[data-layout=two]').click()")
    rest(page, "palpateViewer.approach?.pushes && palpateViewer.approach.mm < -0.5")
    page.wait("palpateViewer.isVolumeSharp", 300)
    page.run("palpateViewer.draw()")
    time.sleep(0.3)
    page.screenshot(os.path.join(folder, "viewer-no-go.png"))


def plan(page, folder):
    """The tool on its way to what is planned, the card open."""
    page.resize(1440, 900)
    page.dark(True)
    page.run("document.querySelector('[data-layout=two]').click(); document.getElementById('plan-card').open = true;")
    page.wait("palpateViewer.pose.devices[0].label > 0 && /mm/.test(document.getElementById('plan-lateral').innerText)", 120)
    page.wait("palpateViewer.isVolumeSharp && palpateViewer.pose.devices[0].label > 0", 300)
    page.run("document.getElementById('plan-card').scrollIntoView(); palpateViewer.draw()")
    time.sleep(0.3)
    page.screenshot(os.path.join(folder, "viewer-plan.png"))


def strain(page, folder):
    """Soft tissue that yields, coloured by its strain."""
    page.resize(1280, 900)
    page.dark(False)
    page.run("document.querySelector('[data-layout=two]').click()")
    if not page.run("return document.getElementById('strain').checked"):
        page.run("document.getElementById('strain').click()")
    # the volume stays coarse while tissue yields
    pressed = "palpateViewer.yields && Math.abs(Math.hypot(...palpateViewer.pose.devices[0].force) - 0.5) < 0.02"
    page.wait(pressed, 300)
    time.sleep(12)  # the plots have something to show
    page.wait(pressed, 120)
    page.run("palpateViewer.draw()")
    time.sleep(0.3)
    page.screenshot(os.path.join(folder, "tissue-strain.png"))


def serve(command):
    """The command, and the address of its page, which answers."""
    port = browser.free_port()
    process = subprocess.Popen([*command, "--port", str(port)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    # a busy machine takes a while to prepare a scene
    deadline = time.monotonic() + 600
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), 1).close()
            return process, f"http://127.0.0.1:{port}/"
        except OSError:
            pass
        if process.poll() is not None:
            sys.exit(f"{' '.join(command)} ended with exit code {process.returncode}")
        if time.monotonic() > deadline:
            process.terminate()
            sys.exit(f"{' '.join(command)} serves no page")
        time.sleep(0.2)


def main(folder, command, language):
    process, url = serve(command)
    try:
        take(url, folder, language)
    finally:
        process.terminate()
        process.wait()


def take(url, folder, language):
    # what a browser asks for, which the page follows
    browser.ARGUMENTS.append(f"--accept-lang={language}")
    with browser.Browser() as page:
        page.post("/url", {"url": url})
        page.wait("window.palpateViewer !== undefined && palpateViewer.isLoaded && palpateViewer.isFresh", 300)
        if page.run("return palpateViewer.training.run?.phase === 'running'"):
            return task(page, folder)
        if page.run("return palpateViewer.plan.isShared && palpateViewer.plan.list.length > 0"):
            return plan(page, folder)
        if page.run("return palpateViewer.scene.no_go.length > 0"):
            return no_go(page, folder)
        if page.run("return palpateViewer.scene.structures.some((one) => one.name === 'plate')"):
            return strain(page, folder)
        is_recording = page.run("return palpateViewer.scene.recording !== null")
        of_session = (("viewer-dark", True, "two"), ("viewer-planes-light", False, "five"))
        of_recording = (("viewer-recording", True, "two"), ("viewer-inside", True, "inside"))
        for name, dark, layout in of_recording if is_recording else of_session:
            page.resize(1440, 900)
            page.dark(dark)
            page.post("/url", {"url": url})
            page.wait("window.palpateViewer !== undefined && palpateViewer.isLoaded && palpateViewer.isFresh", 300)
            page.run("document.querySelector(`[data-layout=${arguments[0]}]`).click()", layout)
            force = "Math.hypot(...palpateViewer.pose.devices[0].force) > 0.8"
            if is_recording and not page.run("return palpateViewer.state.playback.playing"):
                page.run("document.getElementById('play').click()")  # it goes on from page to page
            time.sleep(8)  # the plots have something to show
            if is_recording:
                rest(page, force)
            page.wait("palpateViewer.isVolumeSharp" + (" && palpateViewer.isScopeSharp" if layout == "inside" else ""), 300)
            page.wait(force, 60)
            page.run("palpateViewer.draw()")
            time.sleep(0.3)
            page.screenshot(os.path.join(folder, name + ".png"))


if __name__ == "__main__":
    arguments, spoken = sys.argv[1:], "en"
    if arguments[:1] == ["--language"]:
        spoken, arguments = "".join(arguments[1:2]), arguments[2:]
    if len(arguments) < 2:
        sys.exit(__doc__)
    main(arguments[0], arguments[1:], spoken)
