"""A session of palpate in Slicer's scene."""

import pathlib
import shutil
import tempfile

from . import nrrd, plan, program, scene
from .errors import PalpateError
from .labels import Removal
from .openigtlink import LabelsClient

SEGMENTATION = "Palpate"


class SceneSession:
    """Feels a volume and a segmentation of the scene, or joins a session that runs already, here or on another machine.

    poll() is called some 30 times a second, on Slicer's own thread. The connections are read on threads of their own.
    """

    def __init__(self):
        self.follow_tip = True  # whether the slice views follow the tip
        self._folder = None  # files of the started session
        self._session = self._connector = self._client = None
        self._node = self._volume = self._labels = self._removal = None
        self._decorated = {"probe": False, "arrow": False, "slice": False}
        self._tip = None

    # ---- begin and end

    def start(self, volume, segmentation, path="", device="pointer", burr_mm=0, arguments=()):
        """Writes the scan and the segmentation, starts palpate with them, and shows what it publishes.

        volume, segmentation  nodes of the scene; both under the same transform, or none
        path                  the program; empty: searched for
        device                of palpate explore
        burr_mm               diameter of a ball burr; 0: a point
        arguments             further ones of palpate explore
        """
        self._refuse_second()
        environment = scene.environment()
        found = program.find_program(path)
        self._folder = pathlib.Path(tempfile.mkdtemp(prefix="palpate-slicer-"))
        try:
            scene_file = self._write(found, environment, volume, segmentation, burr_mm)
            command = [scene_file, "--device", device, "--port", "0", *arguments]
            self._session = program.Session(found, command, environment)
            self._join("127.0.0.1", self._session.port)
        except BaseException:
            self.stop()
            raise

    def attach(self, host, port):
        """Joins a session. Its labels become a new segmentation."""
        self._refuse_second()
        try:
            self._join(host, port)
        except BaseException:
            self.stop()
            raise

    def stop(self):
        """Ends a started session, and leaves one that was joined. What has been cut stays in the segmentation."""
        if self._client is not None:
            self._client.close()
        if self._connector is not None:
            scene.disconnect(self._connector)
        if self._session is not None:
            self._session.end()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
        follow = self.follow_tip
        self.__init__()
        self.follow_tip = follow

    @property
    def page(self):
        """Address of the started session's page; None: not known."""
        return self._session.page if self._session is not None else None

    @property
    def is_active(self):
        return self._client is not None

    @property
    def segmentation(self):
        """Node of the segmentation that is cut; None: it has not come yet."""
        return self._node

    @property
    def removed_voxels(self):
        return self._removal.removed_voxels if self._removal is not None else 0

    # ---- while it runs

    def poll(self):
        """Takes over what has arrived. @returns names of the structures that a burr has changed since the last call"""
        if not self.is_active:
            return []
        if self._session is not None and (fault := self._session.fault()):
            raise PalpateError(fault, "palpate")
        self._decorate()
        # names come first; without them a joined session's labels wait
        if self._node is None and self._client.names() is None:
            return []
        image = self._client.take()
        return self._take(*image) if image is not None else []

    def write_plan(self, lines, path, title="Plan"):
        """Writes lines of the scene as a plan. @param lines  line nodes, from entry to target"""
        text = plan.plan_text([scene.line_of(line) for line in lines], title)
        pathlib.Path(path).write_text(text, encoding="utf-8")

    # ---- parts

    def _refuse_second(self):
        if self.is_active:
            raise PalpateError("a session is active", "", "stop it first")

    def _write(self, found, environment, volume, segmentation, burr_mm):
        grid, voxels = scene.scan_of(volume)
        labels = scene.labels_of(segmentation, volume)
        names = ("scan.nrrd", "labels.seg.nrrd", "scene.toml")
        scan_file, labels_file, scene_file = (self._folder / name for name in names)
        nrrd.write_scan(scan_file, grid, voxels)
        nrrd.write_segmentation(labels_file, grid, labels)
        command = ["scene", "new", "--scan", scan_file, "--labels", labels_file, "-o", scene_file]
        program.run_program(found, command, environment)
        if burr_mm > 0:
            with open(scene_file, "a", encoding="utf-8") as file:
                file.write(f'\n[tool]\nkind = "burr"\ndiameter = {float(burr_mm)!r}\n')
        self._hold(segmentation, volume, labels)
        return scene_file

    def _hold(self, node, volume, labels):
        self._node, self._volume, self._labels, self._removal = node, volume, labels, Removal(labels)

    def _join(self, host, port):
        self._client = LabelsClient(host, port)
        self._connector = scene.connect(host, port)

    def _take(self, grid, voxels):
        if self._node is None:
            self._hold(*scene.new_segmentation(grid, voxels, self._client.names(), SEGMENTATION))
            return [segment.name for segment in self._labels.segments]
        if not grid.is_same(self._labels.grid):
            raise PalpateError("palpate's labels are on another grid than the segmentation", self._node.GetName(),
                               "start the session again")
        changed = self._removal.update(voxels)
        for segment, mask in changed:
            scene.change_segment(self._node, self._volume, segment, mask)
        return [segment.name for segment, _ in changed]

    def _decorate(self):
        # nodes come with the first messages; each is set up once
        show = {"probe": scene.show_probe, "arrow": scene.show_arrow}
        if self._session is None:
            show["slice"] = scene.show_slice
        for name, each in show.items():
            self._decorated[name] = self._decorated[name] or each() is not None
        tip = scene.tip_ras_mm()
        if self.follow_tip and tip is not None and tip != self._tip:
            scene.show_sections_at(tip)
        self._tip = tip
