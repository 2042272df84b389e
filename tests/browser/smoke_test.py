"""Opens the viewer page in headless Chromium: a section is shown, a press is felt, the page is light.

usage: smoke_test.py PALPATE

The one test of the page in a browser that runs with every change; the journeys are in viewer_test.py and training_test.py.
Exit code 77 (a skip) where there is no browser, except in CI, where that is a failure.
"""

import sys

sys.dont_write_bytecode = True  # nothing is left in the source tree
import browser  # noqa: E402
import viewer_page  # noqa: E402


class Smoke(viewer_page.Viewer):
    @classmethod
    def setUpClass(cls):
        cls.server = viewer_page.Server("pointer").__enter__()
        cls.addClassCleanup(cls.server.__exit__)
        cls.open_browser()

    def test_a_light_page_shows_a_section_and_a_press_is_felt(self):
        self.assert_light()
        # some of the scan and of the structures is in the section
        colours = self.page.run("""palpateViewer.draw();
            const { width, height } = document.querySelector("#picture-oblique canvas");
            return Array.from({ length: 400 }, (_, n) => palpateViewer.colourAt("oblique", ((n % 20) + 0.5) / 20 * width, (Math.floor(n / 20) + 0.5) / 20 * height).join());""")
        self.assertGreater(len(set(colours)), 20)
        # the patella is in front of all else
        self.page.wait("palpateViewer.state.pointer && palpateViewer.isVolumeSharp")
        scene = self.server.scene()
        labels, patient_from_voxel = self.server.labels(scene)
        label = next(structure["label"] for structure in scene["structures"] if structure["name"] == "patella")
        middle = (patient_from_voxel @ [*viewer_page.numpy.argwhere(labels == label).mean(0), 1])[:3].tolist()
        left, top, width, height = self.box("#picture-volume .stack")
        x, y = self.page.run("return palpateViewer.project(arguments[0])", middle)
        self.page.pointer({"type": "pointerMove", "x": round(left + width / 2 + x), "y": round(top + height / 2 + y)}, {"type": "pointerDown", "button": 0})
        self.page.wait(f"palpateViewer.pose.devices[0].label === {label} && Math.hypot(...palpateViewer.pose.devices[0].force) > 0")
        self.page.wait("document.getElementById('touched').textContent === 'patella'")
        self.page.pointer({"type": "pointerUp", "button": 0})
        self.page.press(" ")
        self.page.wait("palpateViewer.state.emergency_stop")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    viewer_page.use_program(sys.argv.pop(1), lambda program: lambda port, *_: [
        program, "explore", "knee-phantom:spacing=2", "--device", "pointer", "--port", str(port), "--seconds", "600"])
    browser.run_tests(viewer_page.NUMPY_NEEDED)
