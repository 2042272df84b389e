"""Tools in the viewer page: shafts, two tools at once, burrs and their strokes.

usage: tools_test.py [--campaigns] palpate PALPATE [TEST ...]
       tools_test.py [--campaigns] mock NODE MOCK_SERVER PAGE_FOLDER [TEST ...]

viewer_test.py explains the arguments and runs these tests with those of the other scripts in one browser.
"""

import base64
import json
import math
import os
import random
import subprocess
import sys
import tempfile
import time

sys.dont_write_bytecode = True  # nothing is left in the source tree
import viewer_page  # noqa: E402
from viewer_page import SIZE, Server, Viewer, campaign, numpy, speak, test_seed  # noqa: E402


class WithShaft(Viewer):
    """The mock's pointer with a shaft of 40 mm: what is drawn over the volume, pixel by pixel."""

    uses_mock = True

    @classmethod
    def setUpClass(cls):
        cls.server = Server("pointer", extra=["--shaft", "yes"]).__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        scene = cls.server.scene()
        cls.labels, cls.patient_from_voxel = cls.server.labels(scene)
        cls.axis = numpy.array(scene["world_from_patient"])[2, :3]
        cls.radius = scene["tool"]["capsules"][0]["radius_mm"]
        cls.spacing = numpy.linalg.norm(cls.patient_from_voxel[:3, 0])
        cls.open_browser()

    def label_at(self, points):
        inverse = numpy.linalg.inv(self.patient_from_voxel)
        voxel = numpy.floor(points @ inverse[:3, :3].T + inverse[:3, 3] + 0.5).astype(int)
        inside = ((voxel >= 0) & (voxel < self.labels.shape)).all(-1)
        return numpy.where(inside, self.labels[tuple(numpy.moveaxis(numpy.where(inside[..., None], voxel, 0), -1, 0))], 0)

    def occluded(self, points, slack):
        """For each point, whether it is occluded by voxels more than `slack` mm in front of it; None near an edge,
        where the answer changes within 2 mm laterally or 1.5 mm in depth."""
        into = points - self.eye if self.is_perspective else numpy.broadcast_to(self.into, points.shape)
        into = into / numpy.linalg.norm(into, axis=1)[:, None]
        aside = numpy.cross(into, (0.3, 0.5, 0.8))
        aside /= numpy.linalg.norm(aside, axis=1)[:, None]
        ups = numpy.cross(into, aside)
        found = []
        for a, b in ((0, 0), (2, 0), (-2, 0), (0, 2), (0, -2)):
            places = points + a * aside + b * ups
            solid = self.label_at(places[:, None] - numpy.arange(0.2, 130, 0.4)[:, None] * into[:, None]) > 0
            found += [(solid & (numpy.arange(0.2, 130, 0.4) > slack + more)).any(1) for more in (-1.5, 0, 1.5)]
        found = numpy.array(found)
        return [None if found[:, n].min() != found[:, n].max() else bool(found[0, n]) for n in range(len(points))]

    def drawn(self, *ways):
        """Of points on each way: where they are in the picture of the volume, and RGBA of what is drawn over it there; the greatest alpha beside it."""
        at = numpy.array(self.page.run("return palpateViewer.pixelsOverVolume(arguments[0])", [q.tolist() for way in ways for q in way]))
        x, y = numpy.clip(numpy.floor(at).astype(int), -1, self.size).T + 3
        own = self.over[y, x].astype(int)
        beside = numpy.max([self.over[y + dy, x + dx, 3] for dx in (-1, 0, 1) for dy in (-1, 0, 1)], 0)
        ends = numpy.cumsum([len(way) for way in ways])[:-1]
        return zip(*(numpy.split(one, ends) for one in (at, own, beside)))

    def runs(self, points, at, whole_mm, slack):
        """Masks of the visible and of the hidden points of a line, without points closer than one dash (6 pixels, or
        1/80 of the line) to a change of visibility."""
        states = self.occluded(points, slack)
        step_mm = numpy.linalg.norm(points[1] - points[0])
        step_pixels = numpy.linalg.norm(at[-1] - at[0]) / (len(at) - 1)
        piece_mm = whole_mm / min(80, max(1, math.ceil(whole_mm / step_mm * step_pixels / 6)))
        near = math.ceil(piece_mm / step_mm) + 1
        is_all = lambda n, state: all(one is state for one in states[max(0, n - near):n + near + 1])  # noqa: E731
        return [numpy.array([is_all(n, state) for n in range(len(points))]) for state in (False, True)]

    def judge_shaft(self, p):
        into = self.into if not self.is_perspective else (p - self.eye) / numpy.linalg.norm(p - self.eye)
        side = numpy.cross(self.axis, into)
        axis = p + numpy.arange(8, 34, 0.25)[:, None] * self.axis
        side = self.radius * side / numpy.linalg.norm(side)
        (at, own, _), *sides = self.drawn(axis, axis + side, axis - side)
        is_filled = (own[:, 3] > 130) & (abs(own[:, :3] - (120, 142, 155)).max(1) < 60)
        seen, hidden = self.runs(axis, at, 40, 1.5 * self.spacing + self.radius)
        for which, is_right in ((seen, [is_filled] + [beside > 200 for _, _, beside in sides]), (hidden, [~is_filled] + [beside < 175 for _, _, beside in sides])):
            if which.sum() >= 6:
                # something else may lie over a part of it, or a plane's outline along a side that is hidden: both go along the volume's box
                shares = [one[which].mean() for one in is_right]
                yield which is hidden, shares[0] >= 0.85 and (max if which is hidden else min)(shares[1:]) >= 0.65, shares
        # dashed: drawn and left out by turns
        if hidden.sum() >= 40:
            shares = [((beside[hidden] > 60).mean(), (line[hidden, 3] < 30).mean()) for _, line, beside in sides]
            yield True, all(drawn > 0.3 and left_out > 0.1 for drawn, left_out in shares), shares

    def judge_plane(self, _):
        plane = self.plane
        centre, normal = numpy.array(plane["centre"]), numpy.array(plane["normal"])
        # the polygon in which it meets the volume's box
        dims = numpy.array(self.labels.shape)
        met = []
        for axis in range(3):
            for a, b in numpy.ndindex(2, 2):
                ends = numpy.zeros((2, 3))
                ends[:, (axis + 1) % 3], ends[:, (axis + 2) % 3] = a, b
                ends[1, axis] = 1
                ends = (ends * dims - 0.5) @ self.patient_from_voxel[:3, :3].T + self.patient_from_voxel[:3, 3]
                far = (ends - centre) @ normal
                if (far[0] < 0) != (far[1] < 0):
                    met.append(ends[0] + (ends[1] - ends[0]) * far[0] / (far[0] - far[1]))
        met = numpy.array(met)
        about = met - met.mean(0)
        met = met[numpy.arctan2(about @ plane["down"], about @ plane["right"]).argsort()]
        edges = [(a, b) for a, b in zip(met, numpy.roll(met, -1, 0)) if numpy.linalg.norm(b - a) >= 10]
        ways = [a + numpy.linspace(0.02, 0.98, 80)[:, None] * (b - a) for a, b in edges]
        for (a, b), points, (at, _, beside) in zip(edges, ways, self.drawn(*ways)):
            inside = (at > 40).all(1) & (at < numpy.array(self.size) - 40).all(1)
            for which, is_hidden in zip(self.runs(points, at, numpy.linalg.norm(b - a), 1), (False, True)):
                which &= inside
                if which.sum() < 6:
                    continue
                shares = [(beside[which] < 150).mean(), (beside[which] > 40).mean()] if is_hidden else [(beside[which] > 180).mean(), 1]
                yield is_hidden, shares[0] >= 0.65 and shares[1] > 0.3, shares

    @campaign
    def test_what_is_drawn_in_the_volume_is_hidden_where_something_is_in_front_of_it(self):
        self.let_another_viewer_lead()
        self.page.run("""const planes = document.getElementById("planes-in-volume");
            planes.checked = true;
            planes.dispatchEvent(new Event("change"));""")
        self.size = self.page.run("const { width, height } = document.querySelector('#picture-volume canvas'); return [width, height]")
        generator = random.Random(test_seed())
        judges = {"shaft": self.judge_shaft, "plane": self.judge_plane}
        places, states, wrong = {kind: 0 for kind in judges}, {kind: [0, 0] for kind in judges}, []
        for is_perspective in (False, True):
            self.is_perspective = is_perspective
            self.page.run("palpateViewer.lookFrom(110, 30, arguments[0]); palpateViewer.draw()", is_perspective)
            # the plane glides to where the tool wants it, and stays
            self.page.run("for (let n = 0; n < 60; n++) palpateViewer.draw()")
            self.page.wait("palpateViewer.isVolumeSharp")
            while places["shaft"] < (50 if is_perspective else 25):
                p = numpy.zeros(3)
                while self.label_at(p + 4 * (numpy.argwhere(numpy.ones((3, 3, 3))) - 1)).any():
                    p = numpy.array([generator.uniform(-40, 40), generator.uniform(-35, 45), generator.uniform(-35, 45)])
                self.page.run("window.lead(arguments[0])", p.tolist())
                self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, i) => x - %s[i])) < 0.01" % json.dumps(p.tolist()))
                # with the eye of that picture, wherever the camera is by now
                answer, self.plane, ray = self.page.run("palpateViewer.draw(); return [palpateViewer.drawnOverVolume(), palpateViewer.plane('oblique'), palpateViewer.volumeRay(0, 0)]")
                self.eye, self.into = numpy.array(ray["from"]), numpy.array(ray["into"])
                over = numpy.frombuffer(base64.b64decode(answer["rgba"]), numpy.uint8).reshape(answer["height"], answer["width"], 4)
                self.over = numpy.pad(over, ((3, 3), (3, 3), (0, 0)))
                for kind, judge in judges.items():
                    judged = list(judge(p))
                    places[kind] += len(judged) > 0
                    for is_hidden, is_right, shares in judged:
                        states[kind][is_hidden] += 1
                        if not is_right:
                            wrong.append((kind, is_perspective, is_hidden, p.round(1).tolist(), shares))
        print("  " + ", ".join(f"{kind}: {places[kind]} places, {states[kind][0]} parts seen, {states[kind][1]} hidden" for kind in judges), flush=True)
        self.assertEqual(wrong, [])
        self.assertGreaterEqual(places["plane"], 50)
        for kind in judges:
            self.assertGreater(min(states[kind]), 8, kind)

    @campaign
    def test_a_line_leads_from_the_tool_to_what_is_felt_nearest(self):
        self.let_another_viewer_lead()
        # alone, so that it is large
        self.page.click("[data-layout=volume]")
        self.addCleanup(self.page.click, "[data-layout=two]")
        self.page.wait("palpateViewer.draw() || document.querySelector('#picture-volume canvas').height > 400")
        self.size = self.page.run("const { width, height } = document.querySelector('#picture-volume canvas'); return [width, height]")
        generator = random.Random(test_seed())
        solid = numpy.pad(self.labels > 0, 1)
        inner = solid[1:-1, 1:-1, 1:-1].copy()
        for axis in range(3):
            for by in (-1, 1):
                inner &= numpy.roll(solid, by, axis)[1:-1, 1:-1, 1:-1]
        surface = numpy.argwhere((self.labels > 0) & ~inner) @ self.patient_from_voxel[:3, :3].T + self.patient_from_voxel[:3, 3]
        places, wrong, points = {"near": 0, "far": 0}, [], {"seen": 0, "hidden": 0}
        for is_perspective in (False, True):
            self.is_perspective = is_perspective
            self.page.run("palpateViewer.lookFrom(110, 30, arguments[0]); palpateViewer.draw()", is_perspective)
            self.page.wait("palpateViewer.isVolumeSharp")
            ray = self.page.run("return palpateViewer.volumeRay(0, 0)")
            self.eye, self.into = numpy.array(ray["from"]), numpy.array(ray["into"])
            wanted = {"near": 8, "far": 2}
            while sum(wanted.values()) > 0:
                p = numpy.array([generator.uniform(-54, 54), generator.uniform(-54, 54), generator.uniform(-60, 60)])
                far = numpy.linalg.norm(surface - p, axis=1)
                nearest = surface[far.argmin()]
                kind = "near" if 6 < far.min() < 18 else "far"
                # places that are as near, but for less than a voxel: the page looks at the nearest of some of them
                as_near = surface[far < far.min() + 0.8]
                if wanted[kind] == 0 or self.label_at(p[None])[0] or (kind == "far" and far.min() < 22) or numpy.linalg.norm(as_near - nearest, axis=1).max() > 8:
                    continue
                foot_of = lambda voxel: p + (voxel - p) * (1 - self.spacing / 2 / numpy.linalg.norm(voxel - p))  # noqa: E731
                foot = foot_of(nearest)
                begin, end, shaft = numpy.array(self.page.run("return palpateViewer.pixelsOverVolume(arguments[0])", [q.tolist() for q in (p, foot, p + 30 * self.axis)]))
                way, shaft = end - begin, shaft - begin
                cosine = way @ shaft / numpy.linalg.norm(way) / numpy.linalg.norm(shaft)
                if numpy.linalg.norm(way) < 30 or cosine > 0.5 or not ((numpy.array([begin, end]) > 10) & (numpy.array([begin, end]) < numpy.array(self.size) - 10)).all():
                    continue
                self.page.run("window.lead(arguments[0])", p.tolist())
                self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, i) => x - %s[i])) < 0.01" % json.dumps(p.tolist()))
                time.sleep(2.2)  # where the tool was is drawn so long
                answer = self.page.run("palpateViewer.draw(); return palpateViewer.drawnOverVolume()")
                over = numpy.frombuffer(base64.b64decode(answer["rgba"]), numpy.uint8).reshape(answer["height"], answer["width"], 4)
                self.over = numpy.pad(over, ((3, 3), (3, 3), (0, 0)))
                # from the tool's ring to the shadow, at whichever of them it is drawn
                mm = numpy.linalg.norm(foot - p) / numpy.linalg.norm(way)
                line_to = lambda foot: p + numpy.linspace(14 * mm / numpy.linalg.norm(foot - p), 1 - 1.5 / numpy.linalg.norm(foot - p), 60)[:, None] * (foot - p)  # noqa: E731
                # a disc across it where it ends, of which a bar is seen from the side
                angles = numpy.linspace(0, 2 * math.pi, 12, endpoint=False)
                rim_at = lambda foot: foot + 1.2 * numpy.stack([numpy.cos(angles), numpy.sin(angles)], 1) @ numpy.linalg.svd((foot - p)[None])[2][1:]  # noqa: E731
                feet = [foot_of(voxel) for voxel in as_near]
                marks = list(self.drawn(*map(line_to, feet), *map(rim_at, feet)))
                best = numpy.argmax([(on > 40).mean() + (rim > 50).mean() for (_, _, on), (_, _, rim) in zip(marks, marks[len(feet):])])
                foot, shadow = feet[best], (marks[len(feet) + best][2] > 50).mean()
                line, length = line_to(foot), numpy.linalg.norm(foot - p)
                into = self.into if not is_perspective else (p - self.eye) / numpy.linalg.norm(p - self.eye)
                aside = numpy.cross(foot - p, into)
                aside *= 7 * mm / numpy.linalg.norm(aside)
                (at, _, on), (_, _, left), (_, _, right) = self.drawn(line, line + aside, line - aside)
                places[kind] += 1
                wanted[kind] -= 1
                if kind == "far":
                    if (on > 40).mean() > 0.1:
                        wrong.append((kind, is_perspective, p.round(1).tolist(), (on > 40).mean()))
                    continue
                seen, hidden = self.runs(line, at, length, 2)
                # its length stands on one of its sides
                beside = min((left > 80).mean(), (right > 80).mean())
                shares = [(on[seen] > 80).mean() if seen.sum() > 5 else 1, (on[hidden] > 40).mean() if hidden.sum() > 5 else 0.6, beside]
                points["seen"] += int(seen.sum())
                points["hidden"] += int(hidden.sum())
                if shares[0] < 0.9 or shares[1] < 0.3 or beside > 0.2 or shadow < 0.5:
                    wrong.append((kind, is_perspective, p.round(1).tolist(), shares, shadow))
        print(f"  {places['near']} lines, {points['seen']} of their points seen and {points['hidden']} hidden; {places['far']} places without one", flush=True)
        self.assertEqual(wrong, [])
        self.assertGreater(points["seen"], 200)


class WithTwoTools(Viewer):
    """The mock's with a second device, which holds a ball of 4 mm radius on a shaft of 30 mm still."""

    uses_mock = True

    @classmethod
    def setUpClass(cls):
        cls.server = Server("script", extra=["--second", "yes"]).__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.scene = cls.server.scene()
        cls.open_browser()

    @campaign
    def test_each_device_is_drawn_with_its_own_tool(self):
        self.assertEqual(self.scene["tools"][0], self.scene["tool"])
        self.assertEqual(self.page.run("return palpateViewer.pose.devices.map(({ number }) => number)"), [0, 1])
        told = self.page.run("return document.getElementById('device').textContent")
        self.assertIn("probe tool · ball tool", told)
        # where the first one, its force and its trail are not
        drawn = self.page.run("""
            palpateViewer.draw();
            const [first, second] = palpateViewer.pose.devices, { right, down } = palpateViewer.plane("oblique");
            const sum = (...parts) => [0, 1, 2].map((i) => parts.reduce((all, [share, v]) => all + share * v[i], 0));
            const around = (mm) => Array.from({ length: 24 }, (_, n) => (n * Math.PI) / 12)
              .map((turn) => sum([1, second.tip], [mm * Math.cos(turn), right], [mm * Math.sin(turn), down]));
            const [from, to] = palpateViewer.pixelsOverVolume([second.tip, sum([1, second.tip], [30, arguments[0]])]);
            const drawn = palpateViewer.drawnOver("oblique", [...around(4), ...around(7)]);
            return { at: second.tip, ring: drawn.slice(0, 24), farther: drawn.slice(24), shaft: [from, to], over: palpateViewer.drawnOverVolume() };
            """, numpy.array(self.scene["world_from_patient"])[2, :3].tolist())
        self.assertEqual(drawn["at"], [20, -52, 20])
        self.assertGreater(min(drawn["ring"]), 60, drawn["ring"])
        # a shaft, and what the first one has left behind it, and no ring
        self.assertLess(sorted(drawn["farther"])[6], 60, drawn["farther"])
        over = drawn["over"]
        alpha = numpy.frombuffer(base64.b64decode(over["rgba"]), numpy.uint8).reshape(over["height"], over["width"], 4)[..., 3]
        x, y = numpy.mean(drawn["shaft"], 0).astype(int)
        self.assertGreater(alpha[y - 3:y + 4, x - 3:x + 4].max(), 60, "its shaft in the volume")

    @campaign
    def test_the_scope_is_the_second_one_and_may_be_the_first(self):
        stack = "document.querySelector('#picture-scope .stack')"
        holder = "document.querySelectorAll('#picture-scope select')[2]"
        seen = f"""palpateViewer.draw();
            const axis = ({{ orientation: [w, x, y, z] }}) => [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)];
            const {{ devices, rotation }} = palpateViewer.pose, holder = {holder};
            return {{ eye: palpateViewer.scopeFrame.eye, tips: devices.map(({{ tip }}) => tip), hidden: holder.hidden, chosen: holder.value,
                      names: [...holder.options].map(({{ text }}) => text) }};"""
        self.page.press("5")
        self.page.wait("document.querySelector('#picture-scope canvas')?.width > 50")
        at = self.page.run(seen)
        self.assertEqual((at["hidden"], at["chosen"], at["names"]), (False, "1", ["1: probe tool", "2: ball tool"]))
        # 8 mm back along the shaft of the one that is held still
        self.assertAlmostEqual(numpy.linalg.norm(numpy.subtract(at["eye"], at["tips"][1])), 8, delta=0.1)
        choose = f"const holder = {holder}; holder.value = arguments[0]; holder.dispatchEvent(new Event('change'));"
        self.page.run(choose, "0")
        self.page.run("const back = document.querySelector('#picture-scope select'); back.value = '0'; back.dispatchEvent(new Event('change'));")
        at = self.page.run(seen)
        self.assertLess(numpy.linalg.norm(numpy.subtract(at["eye"], at["tips"][0])), 8.1, "it may stand off what the first one touches")
        self.assertGreater(numpy.linalg.norm(numpy.subtract(at["eye"], at["tips"][1])), 10)
        # who holds it can be undone as well
        for _ in range(2):
            self.page.run("document.body.dispatchEvent(new KeyboardEvent('keydown', { key: 'z', ctrlKey: true, bubbles: true, cancelable: true }))")
        at = self.page.run(seen)
        self.assertEqual(at["chosen"], "1")
        self.assertAlmostEqual(numpy.linalg.norm(numpy.subtract(at["eye"], at["tips"][1])), 8, delta=0.1)


class WithBurr(Viewer):
    """The mock's with a tool that cuts away 3 mm around the middle of the first structure when its motor is switched on, and 7 mm above the next time."""

    uses_mock = True

    def serve(self, source, burr="ball"):
        super().serve(source, extra=["--tool", "burr", "--burr", burr])

    def setUp(self):
        self.serve("pointer")
        scene = self.server.scene()
        labels, patient_from_voxel = self.server.labels(scene)
        middle = numpy.argwhere(labels == scene["structures"][0]["label"]).mean(0)
        self.place = (patient_from_voxel @ [*middle, 1])[:3].tolist()
        self.above = [*self.place[:2], self.place[2] + 7]
        super().setUp()

    @classmethod
    def setUpClass(cls):
        cls.open_browser()

    def switch(self, on):
        self.page.click("#motor")
        self.page.wait(f"[palpateViewer.state.motor, palpateViewer.state.motor_is_on].every((is) => is === {json.dumps(on)})")

    def told(self, name):
        return self.page.run("return document.getElementById(arguments[0]).textContent", name)

    def offered(self):
        """Which of undo and redo can be pressed."""
        return self.page.run("return ['undo-stroke', 'redo-stroke'].map((id) => !document.getElementById(id).disabled)")

    def wait_for_strokes(self, undo, redo):
        self.page.wait("JSON.stringify(palpateViewer.state.strokes) === '%s'" % json.dumps({"undo": undo, "redo": redo}, separators=(",", ":")))

    def wait_until_cut(self, place, is_cut):
        self.page.wait("(palpateViewer.structureAt(%s) === null) === %s" % (json.dumps(place), json.dumps(is_cut)))

    @campaign
    def test_strokes_are_undone_and_done_again(self):
        # a plane through the middle, and places in it within both strokes, and off them
        self.page.click("[data-layout=five]")
        self.let_another_viewer_lead()
        self.page.run("lead(arguments[0])", self.place)
        self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].tip.map((x, i) => x - %s[i])) < 1e-6" % json.dumps(self.place))
        aside = [(x, z) for x in (-1, 0, 1, 2) for z in (-1.5, 0, 1.5)]
        parts = {name: [[at[0] + x, at[1], at[2] + z] for x, z in aside] for name, at in (("first", self.place), ("second", self.above), ("none", [*self.place[:2], self.place[2] + 16]))}
        seen = lambda: {name: numpy.array(self.page.run("""palpateViewer.draw();
                return arguments[0].map((p) => { const { x, y } = palpateViewer.pixelOf("coronal", p); return palpateViewer.colourAt("coronal", x, y); })""", places))
                        for name, places in parts.items()}

        def changed(before, *names):
            """What is seen when as much of it is another as should be, and waits for that: a picture comes after its voxels."""
            deadline = time.monotonic() + 60
            while True:
                now = seen()
                other = [name for name in parts if (now[name] != before[name]).any(-1).all()]
                same = [name for name in parts if (now[name] == before[name]).all()]
                if (other, same) == (list(names), [name for name in parts if name not in names]):
                    return now
                self.assertLess(time.monotonic(), deadline, (other, same))

        whole = seen()
        self.assertEqual(self.offered(), [False, False])
        self.switch(True)
        self.wait_for_strokes(1, 0)
        self.assertEqual(self.offered(), [False, False])
        self.assertEqual(self.page.run("return ['undo-stroke', 'redo-stroke'].map((id) => document.getElementById(id).title)"), 2 * ["First switch the motor off, or release its pedal"])
        once = changed(whole, "first")
        # removed tissue is tinted
        self.assertGreater((once["first"][:, 0] - once["first"][:, 1]).min(), 30)
        self.assertGreater(numpy.ptp(whole["first"], 1).min(), 8)
        self.switch(False)
        self.assertEqual(self.offered(), [True, False])
        self.switch(True)
        self.switch(False)
        twice = changed(whole, "first", "second")

        self.page.click("#undo-stroke")
        self.wait_for_strokes(1, 1)
        self.assertEqual(self.offered(), [True, True])
        changed(whole, "first")
        changed(twice, "second")
        self.assertEqual(self.told("removed"), "170 mm³ of femur removed")
        # by keys, which can be switched off; those of the page's own history are other ones
        key = "document.body.dispatchEvent(new KeyboardEvent('keydown', { bubbles: true, cancelable: true, ...arguments[0] }))"
        self.assertTrue(self.page.run("return document.getElementById('undo').disabled"))
        self.page.run(key, {"key": "z", "ctrlKey": True})
        self.page.run("document.getElementById('letters').click()")
        self.page.run(key, {"key": "u"})
        self.page.run("document.getElementById('letters').click()")
        self.page.run(key, {"key": "U", "shiftKey": True})
        self.wait_for_strokes(2, 0)
        self.assertEqual(self.offered(), [True, False])
        changed(twice)
        # a key that is held asks for one stroke only: what is asked for next is answered after it
        self.page.run(key, {"key": "u", "repeat": True})
        self.page.click("#pause")
        self.page.wait("palpateViewer.state.paused")
        self.wait_for_strokes(2, 0)
        for left in (1, 0):
            self.page.run(key, {"key": "u"})
            self.wait_for_strokes(left, 2 - left)
        self.assertEqual(self.offered(), [False, True])
        changed(whole)
        self.assertEqual(self.told("removed"), "")
        self.page.click("#redo-stroke")
        self.wait_for_strokes(1, 1)
        changed(once)
        # another stroke is where the one that was undone had been
        self.switch(True)
        self.switch(False)
        self.wait_for_strokes(2, 0)
        self.assertEqual(self.offered(), [True, False])
        changed(twice)

    @campaign
    def test_the_buttons_of_strokes_fit_on_every_screen(self):
        self.addCleanup(self.page.resize, *SIZE)
        for language, width, height in [(language, *size) for language in ("de", "en") for size in ((390, 844), (768, 1024), (1024, 768), (1366, 768), (1920, 1080))]:
            with self.subTest(language=language, width=width):
                speak(self.page, language)
                self.page.resize(width, height)
                self.page.wait(f"innerWidth <= {width}")
                self.assertLessEqual(self.page.run("return document.documentElement.scrollWidth"), width)
                panel, *boxes = self.page.run("""return ["panel", "pause", "motor", "rearm", "undo-stroke", "redo-stroke"].map((id) => {
                    const one = document.getElementById(id), r = one.getBoundingClientRect();
                    return [id, r.left, r.top, r.right, r.bottom, one.scrollWidth - one.clientWidth];
                })""")
                self.assertEqual([a[0] for a in (panel, *boxes) if a[5] > 0], [], "clipped")
                self.assertEqual([a for a in boxes if a[1] < panel[1] or a[3] > panel[3] or a[3] - a[1] < 24 or a[4] - a[2] < 24], [])
                self.assertEqual([(a[0], b[0]) for n, a in enumerate(boxes) for b in boxes[n + 1:]
                                  if min(a[3], b[3]) > max(a[1], b[1]) and min(a[4], b[4]) > max(a[2], b[2])], [])


class WithMilling(Viewer):
    """palpate itself with a burr, and bone that is protected, which is cut all the same and said."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-burr-")
        cls.addClassCleanup(folder.cleanup)
        program, knee, scene = viewer_page.program, os.path.join(folder.name, "knee"), os.path.join(folder.name, "scene.toml")
        palpate = lambda *arguments: subprocess.run([program, "-q", *arguments], check=True, stdout=subprocess.DEVNULL)  # noqa: E731
        palpate("data", "fetch", "knee-phantom", "-o", knee, "--voxel", "1.5")
        palpate("scene", "new", os.path.join(knee, "knee-phantom.seg.nrrd"), "-o", scene)
        with open(scene, encoding="utf-8") as file:
            text = file.read().replace('preset = "bone"', 'preset = "bone"\nprotection = "alarm"', 1)
        with open(scene, "w", encoding="utf-8") as file:
            file.write(text + '\n[tool]\nkind = "burr"\ndiameter = 4\nspindle = [1, 0, 0]\n')
        cls.server = Server("pointer")
        cls.server.command = lambda: [program, "explore", scene, "--port", str(cls.server.port), "--seconds", "600", "--device", "pointer"]
        cls.server.__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.scene = cls.server.scene()
        cls.labels, cls.patient_from_voxel = cls.server.labels(cls.scene)
        cls.open_browser()

    def lead(self, place):
        """There, and it stays."""
        self.page.run("clearInterval(window.leading); window.leading = setInterval(lead, 30, arguments[0])", place)
        self.page.wait("Math.hypot(...palpateViewer.pose.devices[0].tip.map((mm, axis) => mm - %s[axis])) < 0.1" % json.dumps(place))

    def switch(self, on):
        self.page.click("#motor")
        self.page.wait(f"[palpateViewer.state.motor, palpateViewer.state.motor_is_on].every((is) => is === {json.dumps(on)})")

    def test_a_stroke_is_seen_undone_and_done_again(self):
        structure = next(structure for structure in self.scene["structures"] if structure["name"] == "patella")
        voxels = numpy.argwhere(self.labels == structure["label"])
        places = voxels @ self.patient_from_voxel[:3, :3].T + self.patient_from_voxel[:3, 3]
        front = places[places[:, 1].argmin()]  # anterior is -y
        place, before = front.tolist(), [front[0], front[1] - 12, front[2]]
        at_place = f"palpateViewer.structureAt({json.dumps(place)})"
        strokes = lambda undo, redo: "JSON.stringify(palpateViewer.state.strokes) === '%s'" % json.dumps(  # noqa: E731
            {"undo": undo, "redo": redo}, separators=(",", ":"))
        removed = f"(palpateViewer.state.removed.find(({{ label }}) => label === {structure['label']})?.mm3 ?? 0)"
        self.let_another_viewer_lead()
        self.lead(before)
        self.page.wait("(palpateViewer.pose.devices[0].flags & 256) === 0")  # its force has come in
        self.page.wait(f"{at_place} !== null")
        self.assertTrue(self.page.run("return document.getElementById('undo-stroke').disabled"))
        self.switch(True)
        self.lead([front[0], front[1] + 1, front[2]])
        self.page.wait(f"{removed} > 5 && {at_place} === null")
        self.assertIn("patella", self.page.run("return document.getElementById('damage').textContent").lower())
        self.assertTrue(self.page.run("return document.getElementById('undo-stroke').disabled"), "the stroke is not over")
        self.lead(before)
        self.switch(False)
        self.page.wait(strokes(1, 0))
        gone_mm3 = self.page.run(f"return {removed}")
        self.page.click("#undo-stroke")
        self.page.wait(f"{strokes(0, 1)} && {removed} === 0 && {at_place} !== null")
        self.page.click("#redo-stroke")
        self.page.wait(f"{strokes(1, 0)} && {removed} === {gone_mm3} && {at_place} === null")
        self.page.run("clearInterval(window.leading)")


if __name__ == "__main__":
    viewer_page.main(sys.argv[1:], sys.modules["__main__"])
