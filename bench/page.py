#!/usr/bin/python3
"""What the viewer's page takes in headless Chromium without a graphics card, of `palpate explore` on a scene.

usage: page.py [--palpate PROGRAM] [--old PROGRAM] [--scene SCENE] [--tries 100] [--only PART ...]
       page.py --recording RUN.h5 [--palpate PROGRAM]

Prints a line for each part. Nothing is a limit: what a busy machine does is in the figures, and its load is printed with them.
--old is another palpate, whose page is loaded and turned by turns with this one's.
"""

import argparse
import json
import os
import pathlib
import random
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "tests" / "browser"))
import browser  # noqa: E402

browser.ARGUMENTS = [argument for argument in browser.ARGUMENTS if argument != "--disable-gpu"] + [
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--disable-gpu-compositing"]
PARTS = ("script", "load", "frames", "stops", "early-stops", "slab", "graphics", "opacity")
LOADED = "window.palpateViewer !== undefined && palpateViewer.isLoaded && palpateViewer.isFresh"
SIZE = (1440, 900)
# when each picture of the volume or of a section came to the page, and when the first section was seen
WATCH = """{
  window.long = [];
  window.pressed = [];
  window.pictures = { volume: [], oblique: [] };
  const honest = CanvasRenderingContext2D.prototype.drawImage;
  CanvasRenderingContext2D.prototype.drawImage = function (source, ...rest) {
    honest.call(this, source, ...rest);
    if (!this.canvas.isConnected) return;
    const picture = this.canvas.closest("[id^=picture-]")?.id.slice(8);
    window.pictures[picture]?.push(performance.now());
    if (picture === "oblique" && window.firstSection === undefined) {
      window.firstSection = null;
      requestAnimationFrame(() => setTimeout(() => { window.firstSection = performance.now(); }));
    }
  };
  addEventListener("keydown", (event) => event.key === " " && window.pressed.push(performance.timeOrigin + event.timeStamp), { capture: true });
  new PerformanceObserver((list) => window.long.push(...list.getEntries().map((entry) => entry.duration))).observe({ type: "longtask" });
}"""
KEEP_BUSY = """{
  const stack = document.querySelector("#picture-volume .stack"), lines = document.querySelectorAll(".structure");
  let n = 0;
  window.timers = [setInterval(() => stack.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" })), 40), setInterval(() => {
    const [colour, opacity] = lines[n++ % lines.length].querySelectorAll("input");
    colour.value = n % 2 ? "#3060c0" : "#c06030";
    opacity.value = n % 3 ? 1 : 0.5;
    for (const input of [colour, opacity]) input.dispatchEvent(new Event("input", { bubbles: true }));
    lines[n % lines.length].querySelector(".eye").click();
  }, 350)];
}"""


def spread(values, unit="ms"):
    values = sorted(values)
    at = lambda share: values[min(len(values) - 1, int(share * len(values)))]  # noqa: E731
    return f"median {at(0.5):.1f}, 95th percentile {at(0.95):.1f}, largest {values[-1]:.1f} {unit} of {len(values)}"


def say(part, text):
    print(f"{part}: {text} (load {os.getloadavg()[0]:.1f})", flush=True)


class Server:
    """palpate explore, or replay --view; a context manager."""

    def __init__(self, *command):
        self.port = browser.free_port()
        self.url = f"http://127.0.0.1:{self.port}/"
        self.command = [*command, "--port", str(self.port)]

    def __enter__(self):
        self.process = subprocess.Popen(self.command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while True:
            try:
                urllib.request.build_opener(urllib.request.ProxyHandler({})).open(self.url, timeout=300).read()
                return self
            except OSError:
                if self.process.poll() is not None:
                    raise RuntimeError(f"ended with {self.process.returncode}: {' '.join(self.command)}") from None
                time.sleep(0.05)

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait()


class Viewer(threading.Thread):
    """Another viewer, which notes when the server told it of each stop: ms since 1970. So each is late by what telling takes."""

    def __init__(self, port):
        super().__init__(daemon=True)
        self.stops = []
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.socket.sendall((f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                             "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Protocol: palpate.v1\r\n\r\n").encode())
        self.file = self.socket.makefile("rb")
        while self.file.readline() not in (b"\r\n", b""):
            pass
        hello = json.dumps({"type": "hello", "protocol": 3, "poses_hz": 1}).encode()
        self.socket.sendall(bytes([0x81, 0x80 | len(hello)]) + bytes(4) + hello)
        self.start()

    def run(self):
        last = None
        while head := self.file.read(2):
            size = head[1] & 127
            if size > 125:
                size = struct.unpack(">H" if size == 126 else ">Q", self.file.read(2 if size == 126 else 8))[0]
            body = self.file.read(size)
            if head[0] & 15 == 1:
                stop = json.loads(body).get("stop")
                if stop is not None and stop != last:
                    self.stops.append((stop, 1000 * time.time()))
                last = stop


def open_page(page, server, wait=LOADED):
    page.resize(*SIZE)
    page.dark(True)
    page.post("/url", {"url": server.url})
    if wait:
        page.wait(wait)


def choose_slab(page, kind, mm=10):
    page.run("for (const [id, value, type] of [['slab-mm', arguments[1], 'input'], ['slab', arguments[0], 'change']]) {"
             "const one = document.getElementById(id); one.value = value; one.dispatchEvent(new Event(type)); }", kind, mm)


def stop_latencies(page, viewer, count):
    """ms from each press of the space bar until another viewer has been told of its stop, and how many tasks were long."""
    page.run("window.pressed.length = 0; window.long.length = 0")
    already = len(viewer.stops)
    for n in range(count):
        page.press(" ")
        # at another moment of what goes on each time, and apart, so that each is told of
        time.sleep(0.25 + 0.07 * (n % 5))
    time.sleep(2)
    came = [ms for _, ms in viewer.stops[already:]]
    pressed, long = page.run("return [window.pressed, window.long]")
    if len(came) != count or len(pressed) != count:
        raise RuntimeError(f"{len(pressed)} presses, {len(came)} stops of {count}")
    return [b - a for a, b in zip(pressed, came)], long


def rate(page, picture, seconds):
    page.run("window.pictures[arguments[0]].length = 0", picture)
    time.sleep(seconds)
    return page.run("return window.pictures[arguments[0]].length", picture) / seconds


def processor_s(page):
    """Seconds of processor time of the browser's threads: of the page's own, of workers and of the graphics."""
    parents = {}
    for folder in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            parents[int(folder.name)] = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
        except OSError:
            pass  # it has ended
    sums = {"page": 0.0, "worker": 0.0, "graphics": 0.0}
    for process in parents:
        above = process
        while above not in (0, 1, page.driver.pid):
            above = parents.get(above, 0)
        try:
            command = pathlib.Path(f"/proc/{process}/cmdline").read_bytes() if above == page.driver.pid else b""
            kind = "graphics" if b"--type=gpu-process" in command else "page" if b"--type=renderer" in command else None
            for task in pathlib.Path(f"/proc/{process}/task").iterdir() if kind else ():
                name = (task / "comm").read_text()
                sums["worker" if name.startswith("DedicatedWorker") else kind] += int((task / "schedstat").read_text().split()[0]) / 1e9
        except OSError:
            pass
    return sums


def measure(options, page):
    explore = lambda program, *more: Server(program, "explore", options.scene, "--seconds", "3600", *more)  # noqa: E731
    wanted = lambda part: part in options.only  # noqa: E731
    programs = {"now": options.palpate, **({"old": options.old} if options.old else {})}
    servers = {name: explore(program, "--repeat").__enter__() for name, program in programs.items()}
    try:
        if wanted("script"):
            for name, server in servers.items():
                open_page(page, server)
                sent = page.run("return performance.getEntriesByType('resource').filter(({ name }) => name.endsWith('.js')).map(({ name, encodedBodySize }) => [name.split('/').pop(), encodedBodySize])")
                say("script", f"{name}: {sum(size for _, size in sent) / 1000:.1f} kB as sent: {sent}")
        if wanted("load"):
            took = {name: [] for name in servers}
            for _ in range(options.rounds):
                for name, server in servers.items():
                    page.post("/url", {"url": "about:blank"})
                    page.developer_tools("Network.clearBrowserCache")
                    open_page(page, server, "window.firstSection > 0")
                    took[name].append(page.run("return window.firstSection"))
            for name, times in took.items():
                say("load", f"{name}: first section {spread(times)}")
            if "old" in took:
                say("load", f"now over old, round by round: {[round(a / b, 2) for a, b in zip(took['now'], took['old'])]}")
        if wanted("frames"):
            for layout in ("two", "volume"):
                rates = {name: [] for name in servers}
                for _ in range(min(3, options.rounds)):
                    for name, server in servers.items():
                        open_page(page, server)
                        page.click(f"[data-layout={layout}]")
                        page.wait("window.pictures.volume.length > 0")
                        page.run("setInterval(() => document.querySelector('#picture-volume .stack').dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowRight' })), 40)")
                        rates[name].append(rate(page, "volume", 10))
                for name, each in rates.items():
                    say("frames", f"{name}: layout {layout}, pictures of the volume a second while it turns {[round(one, 2) for one in each]}")
        server = servers["now"]
        if wanted("stops"):
            viewer = Viewer(server.port)
            open_page(page, server)
            page.wait("palpateViewer.volumeWork.pictures > 0")
            for busy, slab in ((False, "none"), (True, "none"), (True, "maximum")):
                choose_slab(page, slab)
                page.run(KEEP_BUSY if busy else "")
                took, long = stop_latencies(page, viewer, options.tries if busy else 30)
                page.run("(window.timers ?? []).forEach(clearInterval)")
                say("stops", f"{'recolouring, hiding, orbiting' if busy else 'at rest'}{'' if slab == 'none' else ', slab of 10 mm'}: {spread(took)}; "
                    f"tasks above 100 ms: {sum(task > 100 for task in long)}, longest {max(long, default=0):.0f} ms")
            viewer.socket.close()
        if wanted("early-stops"):
            viewer, took, seen = Viewer(server.port), [], []
            generator = random.Random(1)
            for _ in range(options.tries // 5):
                page.post("/url", {"url": "about:blank"})
                page.developer_tools("Network.clearBrowserCache")
                open_page(page, server, "window.palpateViewer?.link === 'connected'")
                # while it loads, and until what it has loaded is where it is drawn
                for _ in range(5):
                    time.sleep(generator.uniform(0, 0.25))
                    already = len(viewer.stops)
                    page.press(" ")
                    seen.append(page.run("return palpateViewer.isLoaded"))
                    while len(viewer.stops) == already:
                        time.sleep(0.002)
                    took.append(viewer.stops[-1][1] - page.run("return window.pressed.at(-1)"))
            say("early-stops", f"while it loads: {spread(took)}, {seen.count(False)} before the volume had come")
            viewer.socket.close()
        if wanted("slab"):
            open_page(page, server)
            for slab in ("none", "maximum", "mean"):
                choose_slab(page, slab)
                time.sleep(2)
                text = f"{rate(page, 'oblique', 8):.1f} pictures of the section a second while the tip moves"
                page.run("document.getElementById('follow').click(); window.since = performance.now()")
                page.wait("palpateViewer.areSectionsSharp")
                text += f", sharp {page.run('return performance.now() - window.since'):.0f} ms after the planes rest"
                page.run("document.getElementById('follow').click()")
                say("slab", f"{slab}: {text}")
        if wanted("graphics"):
            open_page(page, server)
            page.wait("palpateViewer.volumeWork.pictures > 0")
            page.run("document.getElementById('follow').click()")
            page.wait("(palpateViewer.draw(), palpateViewer.areSectionsSharp)")
            pixels = """palpateViewer.draw();
                const { width, height } = document.querySelector("#picture-oblique canvas"), n = 55;
                const section = Array.from({ length: n * n }, (_, at) => palpateViewer.colourAt("oblique", width * (at % n + 0.5) / n, height * (Math.floor(at / n) + 0.5) / n));
                return palpateViewer.volumePicture(n, n, 2).then((volume) => [JSON.stringify(section), volume]);"""
            before, told, sections, volume, same = page.run(pixels), [], [], [], []
            for _ in range(options.rounds):
                times = page.run("""return (async () => {
                    const note = document.getElementById("graphics"), until = async (is) => {
                      const begun = performance.now();
                      while (!is()) await new Promise((later) => setTimeout(later, 2));
                      return performance.now() - begun;
                    };
                    for (const which of ["sections", "volume"]) palpateViewer.loseGraphics(which, false);
                    const told = await until(() => !note.hidden);
                    await new Promise((later) => setTimeout(later, 500));
                    const both = note.textContent;
                    for (const which of ["sections", "volume"]) palpateViewer.loseGraphics(which, true);
                    const begun = performance.now();
                    window.pictures.volume.length = 0;
                    await until(() => note.hidden || note.textContent !== both);
                    window.pictures.oblique.length = 0;
                    await until(() => window.pictures.oblique.length > 0);
                    const sections = performance.now() - begun;
                    await until(() => window.pictures.volume.some((at) => at > begun) && note.hidden);
                    return [told, sections, performance.now() - begun];
                  })()""")
                for kept, took in zip((told, sections, volume), times):
                    kept.append(took)
                after = page.run(pixels)
                alike = sum(a == b for a, b in zip(json.loads(before[0]), json.loads(after[0])))
                same.append((alike, before[1] == after[1]))
            say("graphics", f"lost: told of, {spread(told)}; given back: sections, {spread(sections)}; the volume, {spread(volume)}; "
                f"of {55 * 55} pixels of the section as before {[alike for alike, _ in same]}, the volume's picture of {55 * 55} {'the same' if all(v for _, v in same) else 'another one'}")
    finally:
        for server in servers.values():
            server.__exit__()
    if wanted("opacity"):
        # nothing else is drawn: nobody moves the tip
        with explore(options.palpate, "--device", "pointer") as still:
            open_page(page, still)
            for layout in ("volume", "two"):
                page.click(f"[data-layout={layout}]")
                time.sleep(4)
                sums, took, count = {}, [], 30
                rest = processor_s(page)
                begun = time.monotonic()
                time.sleep(5)
                idle = {kind: (s - rest[kind]) / (time.monotonic() - begun) for kind, s in processor_s(page).items()}
                for n in range(count):
                    before, begun = processor_s(page), time.monotonic()
                    took.append(page.run("""return new Promise((done) => {
                        const input = document.querySelectorAll(".structure")[arguments[0] % 3].querySelector("input[type=range]");
                        input.value = input.value === "1" ? 0.6 : 1;
                        const at = performance.now(), { length } = window.pictures.volume;
                        input.dispatchEvent(new Event("input", { bubbles: true }));
                        const timer = setInterval(() => {
                          if (window.pictures.volume.length === length) return;
                          clearInterval(timer);
                          done(performance.now() - at);
                        }, 1);
                      })""", n))
                    for kind, s in processor_s(page).items():
                        sums[kind] = sums.get(kind, 0) + s - before[kind] - idle[kind] * (time.monotonic() - begun)
                    page.wait("palpateViewer.isVolumeSharp")
                    time.sleep(0.3)
                say("opacity", f"layout {layout}: to the first picture {spread(took)}; processor time of each, less what it takes at rest: "
                    + ", ".join(f"{kind} {1000 * s / count:.1f}" for kind, s in sums.items()) + " ms")


def play(options, page):
    begun = time.monotonic()
    with Server(options.palpate, "replay", options.recording, "--view") as server:
        say("playback", f"served {time.monotonic() - begun:.1f} s after the start")
        open_page(page, server)
        begin_s, end_s = page.run("return [palpateViewer.scene.recording.begin_s, palpateViewer.scene.recording.end_s]")
        generator, took = random.Random(1), []
        for _ in range(60):
            took.append(page.run("""return new Promise((done) => {
                const place = document.getElementById("place"), at = performance.now();
                place.value = arguments[0];
                place.dispatchEvent(new Event("input", { bubbles: true }));
                const timer = setInterval(() => {
                  if (Math.abs(palpateViewer.pose.time - arguments[0]) > 0.0025) return;
                  clearInterval(timer);
                  done(performance.now() - at);
                }, 1);
              })""", generator.uniform(begin_s, end_s)))
            time.sleep(0.5)
        say("playback", f"a place of {(end_s - begin_s) / 60:.1f} minutes: {spread(took)}")


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    arguments.add_argument("--palpate", default="build/release/apps/palpate/palpate")
    arguments.add_argument("--old", help="another palpate")
    arguments.add_argument("--scene", default="knee-phantom", help="a data set or a scene file")
    arguments.add_argument("--recording", help="measures the places of a recording instead")
    arguments.add_argument("--tries", type=int, default=100, help="of stops")
    arguments.add_argument("--rounds", type=int, default=5, help="of loads and losses")
    arguments.add_argument("--only", nargs="+", choices=PARTS, default=PARTS)
    options = arguments.parse_args()
    with browser.Browser() as page:
        page.developer_tools("Page.addScriptToEvaluateOnNewDocument", source=WATCH)
        (play if options.recording else measure)(options, page)


if __name__ == "__main__":
    main()
