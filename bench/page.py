#!/usr/bin/env python3
"""Loading and drawing times of the viewer's page in Chromium with software rendering, compared with an earlier
palpate's page in the same run.

    bench/page.py PALPATE [--against PALPATE] [--scene NAME] [--stops N] [--repeat N]
    bench/page.py PALPATE --recording MINUTES|FILE [--places N]

Of each page, by turns: ms until the first section is seen and until the volume is; pictures of the volume a second while it is
turned by the same keys, and how many pixels they have; processor time from a changed opacity to the picture that shows it. Of PALPATE's
alone: from the space bar to the server's emergency stop while the page recolours and turns, and while it loads; its longest tasks.

With --recording instead: a simulated recording of knee-phantom of so many minutes, at 1 kHz, or one that is there, in the page of palpate replay --view. Of places at
random: ms from the slider's to the pose, and whether that is the recording's tick. Exit code 1 where one is not.
"""

import argparse
import contextlib
import json
import os
import pathlib
import random
import statistics
import subprocess
import sys
import tempfile
import threading
import time

sys.dont_write_bytecode = True  # nothing is left in the source tree
TESTS = pathlib.Path(__file__).resolve().parent.parent / "tests"
os.environ.setdefault("PALPATE", "")  # what the tests of the command line run: none of them here
sys.path[:0] = [str(TESTS / "browser"), str(TESTS / "e2e")]
import browser  # noqa: E402
from live_session import Viewer  # noqa: E402
from hour_recording import VISIT  # noqa: E402

browser.ARGUMENTS = [argument for argument in browser.ARGUMENTS if argument != "--disable-gpu"] + [
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--disable-gpu-compositing"]
SIZE = (1440, 900)
SWITCHES, EMERGENCY_STOP = 45, 8  # of a pose (docs/reference/viewer-messages.md)
TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")
# What is drawn into the two pictures, by any version of the page: when, and of how many pixels. A section counts that is not
# of one colour all over.
WATCH = """
window.drawn = { volume: [], section: 0, pressed: [], long: [] };
addEventListener("keydown", (event) => event.key === " " && drawn.pressed.push(performance.timeOrigin + event.timeStamp), { capture: true });
new PerformanceObserver((list) => drawn.long.push(...list.getEntries().map(({ startTime, duration }) => [startTime, duration]))).observe({ type: "longtask", buffered: true });
const honest = CanvasRenderingContext2D.prototype.drawImage;
CanvasRenderingContext2D.prototype.drawImage = function (image, ...rest) {
  honest.call(this, image, ...rest);
  if (this.canvas.closest("#picture-volume") && this.canvas === this.canvas.parentElement.firstChild) {
    drawn.volume.push([performance.now(), image.width * image.height]);
  } else if (!drawn.section && this.canvas.closest("#picture-oblique")) {
    const { width, height } = this.canvas;
    const { data } = this.getImageData(width / 4, height / 4, width / 2, height / 2);
    const words = new Uint32Array(data.buffer);
    if (words.some((word) => word !== words[0])) drawn.section = performance.now();
  }
};
"""


class Session:
    """palpate explore with a pointer, or a recording that is looked at; a context manager."""

    def __init__(self, program, scene, recording=None):
        self.program, self.scene, self.port = program, scene, browser.free_port()
        self.url = f"http://127.0.0.1:{self.port}/"
        self.does = ["replay", recording, "--view"] if recording else ["explore", scene, "--device", "pointer", "--seconds", "7200"]

    def __enter__(self):
        self.process = subprocess.Popen([self.program, *self.does, "--port", str(self.port)],
                                        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + 600
        while True:
            try:
                Viewer(self.url).close()
                return self
            except OSError:
                if self.process.poll() is not None or time.monotonic() > deadline:
                    raise RuntimeError(f"{self.program} {' '.join(self.does)} does not serve a page") from None
                time.sleep(0.1)

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait()


class Page:
    """The page of a session in a browser of its own, as it opens for the first time."""

    def __init__(self, session):
        self.session = session

    def __enter__(self):
        self.browser = browser.Browser().__enter__()
        self.browser.resize(*SIZE)
        self.browser.developer_tools("Page.addScriptToEvaluateOnNewDocument", source=WATCH)
        self.begin_to_open()
        return self

    def __exit__(self, *_):
        self.browser.__exit__()

    def begin_to_open(self):
        self.browser.developer_tools("Page.navigate", url=self.session.url)

    def wait_until_seen(self):
        """ms from the navigation to the first section and to the first picture of the volume."""
        self.browser.wait("window.drawn && drawn.section > 0 && drawn.volume.length > 0 && window.palpateViewer && palpateViewer.isLoaded")
        return self.browser.run("return [drawn.section, drawn.volume[0][0]]")

    def processor_seconds(self):
        """Of the page with its workers, and of the browser's graphics."""
        spent = {"renderer": 0.0, "gpu-process": 0.0}
        for process in pathlib.Path("/proc").iterdir():
            try:
                command = (process / "cmdline").read_bytes().decode(errors="replace")
                if self.browser.profile not in command:
                    continue
                fields = (process / "stat").read_text().rsplit(")", 1)[1].split()
            except (OSError, ValueError):
                continue
            for kind in spent:
                if f"--type={kind}" in command:
                    spent[kind] += (int(fields[11]) + int(fields[12])) / TICKS_A_SECOND
        return spent

    def turn(self, seconds):
        """Pictures of the volume a second, and the median of their pixels."""
        times = self.browser.post("/execute/async", {"script": """const done = arguments[1], stack = document.querySelector("#picture-volume .stack");
            const from = performance.now(), before = drawn.volume.length;
            const step = () => {
              stack.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true }));
              if (performance.now() - from < arguments[0]) requestAnimationFrame(step);
              else done([(performance.now() - from) / 1000, drawn.volume.slice(before).map(([, pixels]) => pixels)]);
            };
            step();""", "args": [1000 * seconds]})
        elapsed, pixels = times
        return len(pixels) / elapsed, statistics.median(pixels) if pixels else 0

    def change_opacity(self, n):
        """ms from a change of a structure's opacity to the next picture of the volume."""
        return self.browser.post("/execute/async", {"script": """const done = arguments[1], slider = document.querySelectorAll(".structure input[type=range]")[0];
            const from = performance.now(), before = drawn.volume.length;
            slider.value = arguments[0];
            slider.dispatchEvent(new Event("input", { bubbles: true }));
            slider.dispatchEvent(new Event("change", { bubbles: true }));
            const look = () => (drawn.volume.length > before ? done(drawn.volume[before][0] - from) : setTimeout(look, 2));
            look();""", "args": [0.4 + 0.3 * (n % 2)]})

    def opacity(self, count):
        """Cost of changing a structure's opacity: median time to the next picture, and mean processor time of the page
        and of the graphics process above their idle load, all ms."""
        waits, spent = [], dict.fromkeys(("renderer", "gpu-process"), 0.0)
        for n in range(count):
            time.sleep(1.5)  # the picture of before is sharp
            before, begun = self.processor_seconds(), time.monotonic()
            waits.append(self.change_opacity(n))
            elapsed, after = time.monotonic() - begun, self.processor_seconds()
            time.sleep(1.5)
            rests, begun = self.processor_seconds(), time.monotonic()
            time.sleep(1.0)
            of_rest, now = time.monotonic() - begun, self.processor_seconds()
            for kind in spent:
                spent[kind] += 1000 * (after[kind] - before[kind] - (now[kind] - rests[kind]) * elapsed / of_rest) / count
        return statistics.median(waits), spent["renderer"], spent["gpu-process"]


class Stops:
    """When the server's emergency stops began, in ms of the clock, as a viewer beside the page sees them."""

    def __init__(self, session):
        self.viewer, self.came, self.is_over = Viewer(session.url), [], False
        self.thread = threading.Thread(target=self.listen)
        self.thread.start()

    def listen(self):
        stopped = False
        while not self.is_over:
            kind, data = self.viewer.next()
            now = 1000 * time.time()
            if kind != "pose":
                continue
            stops = bool(data[SWITCHES] & EMERGENCY_STOP)
            if stops and not stopped:
                self.came.append(now)
            stopped = stops

    def close(self):
        self.is_over = True
        self.thread.join()
        self.viewer.close()


BUSY = """
const lines = document.querySelectorAll(".structure"), stack = document.querySelector("#picture-volume .stack");
let n = 0;
window.timers = [setInterval(() => stack.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true })), 40), setInterval(() => {
  const [colour, opacity] = lines[n++ % lines.length].querySelectorAll("input");
  colour.value = n % 2 ? "#3060c0" : "#c06030";
  opacity.value = n % 3 ? 1 : 0.5;
  for (const input of [colour, opacity]) input.dispatchEvent(new Event("input", { bubbles: true }));
  lines[n % lines.length].querySelector(".eye").click();
}, 350)];
"""


def stop_once(page, stops):
    """ms from a press of the space bar to the stop."""
    already = len(stops.came)
    pressed = page.browser.run("return drawn.pressed.length")
    page.browser.press(" ")
    deadline = time.monotonic() + 60
    while len(stops.came) == already:
        if time.monotonic() > deadline:
            raise RuntimeError("a stop did not come within a minute")
        time.sleep(0.005)
    at = page.browser.run("return drawn.pressed[arguments[0]]", pressed)
    # the page is told a little later than who watches beside it; whoever has the pointer arms it again
    page.browser.wait("palpateViewer.state.emergency_stop", 60)
    while page.browser.run("return palpateViewer.state.emergency_stop || palpateViewer.state.stop != null"):
        page.browser.run("document.querySelector('[data-tool=touch]').click(); document.getElementById('rearm').click()")
        time.sleep(0.1)
        if time.monotonic() > deadline:
            raise RuntimeError("it was not armed again within a minute")
    return stops.came[already] - at


def say_stops(scene, words, waits):
    waits = sorted(waits)
    print(f"{scene}: {len(waits)} stops while it {words}: median {statistics.median(waits):.1f} ms, p95 {waits[int(0.95 * len(waits))]:.1f}, largest {waits[-1]:.0f}", flush=True)


def measure_stops(program, scene, count):
    with Session(program, scene) as session:
        stops = Stops(session)
        try:
            with Page(session) as page:
                page.wait_until_seen()
                time.sleep(2)
                since = page.browser.run(BUSY + "return performance.now()")
                waits = []
                for n in range(count):
                    time.sleep(0.13 + 0.07 * (n % 7))
                    waits.append(stop_once(page, stops))
                say_stops(scene, "recolours and turns", waits)
                tasks = [duration for start, duration in page.browser.run("timers.forEach(clearInterval); return drawn.long") if start > since]
                print(f"{scene}: {len(tasks)} tasks of the main thread above 50 ms, the longest {max(tasks, default=0):.0f} ms", flush=True)
                waits, tasks = [], []
                for n in range(max(1, count // 5)):
                    page.begin_to_open()
                    # the page can be pressed as soon as it has a session
                    page.browser.wait("window.palpateViewer && palpateViewer.isFresh && palpateViewer.state")
                    time.sleep(0.05 * (n % 8))
                    waits.append(stop_once(page, stops))
                say_stops(scene, "loads", waits)
        finally:
            stops.close()


RATE_HZ = 1000
GO = """const [at_s, tick, done] = arguments, place = document.getElementById("place"), from = performance.now();
place.value = at_s;
place.dispatchEvent(new Event("input", { bubbles: true }));
const look = () => (palpateViewer.pose.tick === tick || performance.now() - from > 20000 ? done([performance.now() - from, palpateViewer.pose]) : setTimeout(look));
look();"""


def record(program, minutes, folder):
    """A recording of that long, or a little longer: two structures that are touched in turn."""
    script, run = os.path.join(folder, "script.toml"), os.path.join(folder, "run.h5")

    def simulate(visits):
        pathlib.Path(script).write_text("".join(VISIT.format(structure=("femur", "tibia")[n % 2]) for n in range(visits)), encoding="utf-8")
        pathlib.Path(run).unlink(missing_ok=True)
        said = subprocess.run([program, "simulate", "knee-phantom", "--script", script, "-o", run, "--rate", str(RATE_HZ)],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False).stdout
        if not os.path.exists(run):
            raise RuntimeError(said)
        return int(said.split(" ticks")[0].split()[-1])

    simulate(-(-int(60 * minutes * RATE_HZ) * 2 // simulate(2)))
    return run


def measure_places(program, asked, count, seed):
    """@return whether every place showed the recording's tick"""
    import h5py
    import numpy
    with tempfile.TemporaryDirectory() as folder:
        recording = asked
        if not os.path.exists(asked):
            begun = time.monotonic()
            recording = record(program, float(asked), folder)
            print(f"recorded in {time.monotonic() - begun:.0f} s, {os.path.getsize(recording) / 1e6:.0f} MB", flush=True)
        with h5py.File(recording) as run:
            time_s = run["ticks/time_s"][:]
            recorded = {shown: run[f"device0/{name}"][:] for shown, name in (("tip", "tip_patient_mm"), ("force", "force_N"), ("label", "label"))}
        begun = time.monotonic()
        with Session(program, "", recording) as session, Page(session) as page:
            page.browser.wait("window.palpateViewer && palpateViewer.isLoaded && palpateViewer.isFresh")
            print(f"{len(time_s)} ticks, {time_s[-1] - time_s[0]:.0f} s; the page is there {time.monotonic() - begun:.1f} s after the start", flush=True)
            chance = random.Random(seed)
            waits, wrong = [], 0
            for _ in range(count):
                tick = chance.randrange(len(time_s))
                # in its middle, for a slider rounds
                wait, pose = page.browser.post("/execute/async", {"script": GO, "args": [time_s[tick] + 0.5 / RATE_HZ, tick]})
                device = pose["devices"][0]
                same = pose["tick"] == tick and abs(pose["time"] - time_s[tick]) < 1e-9 and all(
                    (numpy.float32(values[tick]) == numpy.float32(device[shown])).all() for shown, values in recorded.items())
                wrong += not same
                waits.append(wait)
                time.sleep(0.3)
        waits.sort()
        print(f"{count} places at random (seed {seed}): median {statistics.median(waits):.0f} ms, p95 {waits[int(0.95 * count)]:.0f}, largest {waits[-1]:.0f}; "
              f"{count - wrong} of them the recording's tick", flush=True)
        return wrong == 0


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program")
    parser.add_argument("--against", help="an earlier palpate")
    parser.add_argument("--scene", action="append", help="knee-atlas unless given; several are measured one after another")
    parser.add_argument("--stops", type=int, default=100)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=4, help="of turning, each time")
    parser.add_argument("--json", help="writes the figures")
    parser.add_argument("--recording", metavar="MINUTES|FILE", help="a recording is looked at instead, one of 1 kHz")
    parser.add_argument("--places", type=int, default=40, help="of the recording")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if lack := browser.missing_programs():
        sys.exit(lack)
    if options.recording:
        sys.exit(not measure_places(options.program, options.recording, options.places, options.seed))
    figures = {}
    for scene in options.scene or ["knee-atlas"]:
        programs = {"now": options.program, **({"before": options.against} if options.against else {})}
        of = {name: {"section_ms": [], "volume_ms": [], "pictures_a_second": [], "pixels": [], "opacity_ms": [], "opacity_page_ms": [], "opacity_graphics_ms": []} for name in programs}
        with contextlib.ExitStack() as stack:
            sessions = {name: stack.enter_context(Session(program, scene)) for name, program in programs.items()}
            for _ in range(options.repeat):
                for name, session in sessions.items():
                    with Page(session) as page:
                        one = of[name]
                        section, volume = page.wait_until_seen()
                        time.sleep(2)
                        rate, pixels = page.turn(options.seconds)
                        wait, own, graphics = page.opacity(5)
                        for key, value in zip(one, (section, volume, rate, pixels, wait, own, graphics)):
                            one[key].append(value)
        median = {name: {key: statistics.median(values) for key, values in one.items()} for name, one in of.items()}
        figures[scene] = of
        for name, m in median.items():
            print(f"{scene}, {name}: first section {m['section_ms']:.0f} ms, volume {m['volume_ms']:.0f} ms; {m['pictures_a_second']:.1f} pictures a second of {m['pixels'] / 1e3:.0f} thousand pixels; "
                  f"opacity to picture {m['opacity_ms']:.0f} ms, {m['opacity_page_ms']:.0f} ms of processor on the page, {m['opacity_graphics_ms']:.0f} in the graphics", flush=True)
        if options.against:
            ratio = lambda key: statistics.median(a / b for a, b in zip(of["now"][key], of["before"][key]) if b)  # noqa: E731
            print(f"{scene}, now to before, medians of pairs: first section {ratio('section_ms'):.2f}, volume {ratio('volume_ms'):.2f}, pictures a second {ratio('pictures_a_second'):.2f}, "
                  f"their pixels {ratio('pixels'):.2f}", flush=True)
        if options.stops:
            measure_stops(options.program, scene, options.stops)
    if options.json:
        pathlib.Path(options.json).write_text(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
