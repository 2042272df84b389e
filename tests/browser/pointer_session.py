"""A session of palpate's knee in which a test leads the tip, and the server that the classes of such tests share."""

import atexit
import json
import time

from viewer_page import BLENDING, Server, Viewer, numpy


class PointerSession(Viewer):
    """The object stands still, and the tip is where the test leads it."""

    @classmethod
    def setUpClass(cls):
        if PointerSession.server is None:
            PointerSession.server = Server("pointer").__enter__()
            atexit.register(PointerSession.server.__exit__)
        cls.scene = cls.server.scene()
        cls.labels, cls.patient_from_voxel = cls.server.labels(cls.scene)
        cls.open_browser()

    def setUp(self):
        super().setUp()
        self.page.run("if (palpateViewer.state.rotation_wxyz[0] < 1) document.getElementById('unturn').click()")
        self.page.wait("palpateViewer.pose.rotation[0] > 0.9999999")
        # the picture's middle is where the object's was when the page opened
        self.page.run("document.querySelector('#picture-volume .stack').dispatchEvent(new KeyboardEvent('keydown', { key: 'Home' }));"
                      "palpateViewer.draw()")

    def points_of(self, mask):
        return numpy.argwhere(mask) @ self.patient_from_voxel[:3, :3].T + self.patient_from_voxel[:3, 3]

    def approaches(self, label, count, generator):
        """Places where a straight way through free space ends `depth` inside a structure: [(start, end)], patient, mm."""
        voxel = numpy.linalg.norm(self.patient_from_voxel[:3, 0])
        deep, free = max(2, round(1.0 / voxel)), round(5 / voxel)
        candidates = numpy.argwhere(self.labels == label)
        order = list(range(len(candidates)))
        generator.shuffle(order)
        directions = [(dx, dy, dz) for dx in (-1, 0, 1) for dy in (-1, 0, 1) for dz in (-1, 0, 1) if (dx, dy, dz) != (0, 0, 0)]
        sides = numpy.vstack([numpy.eye(3, dtype=int), -numpy.eye(3, dtype=int)])
        found = []
        for index in order:
            generator.shuffle(directions)
            for direction in directions:
                end = candidates[index]
                way = end + numpy.outer(numpy.arange(0, deep + free), direction)
                if (way < 1).any() or (way >= numpy.array(self.labels.shape) - 1).any():
                    continue
                passed = self.labels[tuple(way.T)]
                # inside to its own surface, and beside where the tip ends; in front of it room, as between two structures that touch
                # a slit of voxels that share edges alone is closed
                beside = [self.labels[tuple(end + side)] for side in sides]
                room = all(numpy.isin(self.labels[tuple((way[deep:] + side).T)], (0, label)).all() for side in sides)
                if (passed[:deep] == label).all() and (passed[deep:] == 0).all() and all(b == label for b in beside) and room:
                    place = lambda v: (self.patient_from_voxel[:3, :3] @ v + self.patient_from_voxel[:3, 3]).tolist()  # noqa: E731
                    found.append((place(way[-1]), place(end)))
                    break
            if len(found) == count:
                return found
        return found

    def take_hand(self):
        """Passes the tip to a second viewer, which lead() then moves. The page holds the tip when it opens, and
        releases it when another tool is chosen."""
        # the page requests the tip once, on opening. Wait for it: a release before the grant would be ineffective. If
        # the previous test's viewer still held the tip, the request was refused and is not repeated
        asked_s = time.monotonic()
        while not self.page.run("return palpateViewer.state.pointer") and time.monotonic() < asked_s + 2:
            time.sleep(0.02)
        self.page.run("document.querySelector('button[data-tool=window]').click()")
        self.page.wait("!palpateViewer.state.pointer")
        self.page.run("""
            const socket = new WebSocket(`ws://${location.host}/ws`, "palpate.v1");
            let way = null, step = 0;
            const timer = setInterval(() => {
              if (!way) return;
              const at = Math.min(step++ / 30, way.length - 1), i = Math.max(0, Math.min(Math.floor(at), way.length - 2));
              const next = way[Math.min(i + 1, way.length - 1)];
              socket.send(JSON.stringify({ type: "tip", patient_mm: way[i].map((x, c) => x + (at - i) * (next[c] - x)) }));
            }, 16);
            socket.onopen = () => {
              socket.send(JSON.stringify({ type: "hello", protocol: 3, poses_hz: 1 }));
              socket.send(JSON.stringify({ type: "pointer", id: 1, take: true }));
            };
            socket.onmessage = ({ data }) => {
              if (typeof data !== "string") return;
              const message = JSON.parse(data);
              if (message.id !== undefined) window.hand.answers[message.id] = message;
              window.hand.isTaken ||= message.type === "done";
            };
            window.hand = { isTaken: false, answers: {}, lead(points) { way = points; step = 0; },
                            ask: (message) => socket.send(JSON.stringify(message)), letGo() { clearInterval(timer); socket.close(); } };""")
        self.page.wait("window.hand.isTaken")

    def lead(self, way):
        """Along points, half a second from each to the next; it stays at the last."""
        self.page.run("window.hand.lead(arguments[0])", way)
        self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, i) => x - %s[i])) < 0.05" % json.dumps(way[-1]))

    def choose_method(self, name):
        self.page.run("const method = document.getElementById('method'); method.value = arguments[0];"
                      "method.dispatchEvent(new Event('change', { bubbles: true }));", name)
        self.page.wait(f"palpateViewer.state.method === '{name}'")
        # one force turns into the other
        time.sleep(0.2)
        self.page.wait("(palpateViewer.pose.devices[0].flags & %d) === 0" % BLENDING)

    def come_to(self, place):
        """Comes to a place in free space without minding what is on the way."""
        self.choose_method("trilinear")  # which holds no proxy back behind what lies between
        self.lead([place])
        self.choose_method("proxy")

    def press_on(self, label, start, end):
        """Presses from a place in free space towards another."""
        self.come_to(start)
        self.lead([start, end])
        self.page.wait(f"palpateViewer.pose.devices[0].label === {label}")

    def resting_plane(self):
        """The section's, which glides to what it follows: after the object was turned, too. From old poses it does not."""
        look = ("for (let n = 0; n < 20; n++) palpateViewer.draw();"
                "return { isFresh: palpateViewer.isFresh, ...palpateViewer.plane('oblique') }")
        before = None
        for _ in range(100):
            now = self.page.run(look)
            if before and now["isFresh"] and numpy.linalg.norm(numpy.subtract(now["centre"], before["centre"])) < 1e-5:
                return now
            before = now
            time.sleep(0.1)
        raise AssertionError(f"the section goes on gliding: {before}")
