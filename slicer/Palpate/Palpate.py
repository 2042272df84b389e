"""Module of 3D Slicer: feels the scene's scan and segmentation with palpate (docs/guide/slicer.md).

The logic is in PalpateLib.
"""

import qt
import slicer
from PalpateLib import program
from PalpateLib.errors import PalpateError
from PalpateLib.logic import SceneSession
from slicer.ScriptedLoadableModule import (
    ScriptedLoadableModule,
    ScriptedLoadableModuleLogic,
    ScriptedLoadableModuleWidget,
)
from slicer.util import VTKObservationMixin

POLL_MS = 30
PROGRAM_SETTING = "Palpate/Program"


class Palpate(ScriptedLoadableModule):
    def __init__(self, parent):
        ScriptedLoadableModule.__init__(self, parent)
        self.parent.title = "Palpate"
        self.parent.categories = ["IGT"]
        self.parent.dependencies = ["Segmentations", "Markups", "Models"]
        self.parent.contributors = ["The authors of palpate"]
        self.parent.helpText = (
            "Feel the scan and the segmentation of the scene: choose both, and press Start. The tool, the force and "
            "the section are shown here, what a burr removes comes back into the segmentation, and lines become a "
            "plan. Research and education; not for clinical use.")
        self.parent.acknowledgementText = "palpate is free software under the Apache License 2.0."


class PalpateLogic(ScriptedLoadableModuleLogic):
    """The session in the scene; usable from Slicer's Python console without the widget."""

    def __init__(self):
        ScriptedLoadableModuleLogic.__init__(self)
        self.session = SceneSession()


class PalpateWidget(ScriptedLoadableModuleWidget, VTKObservationMixin):
    def __init__(self, parent=None):
        ScriptedLoadableModuleWidget.__init__(self, parent)
        VTKObservationMixin.__init__(self)

    def setup(self):
        ScriptedLoadableModuleWidget.setup(self)
        widget = slicer.util.loadUI(self.resourcePath("UI/Palpate.ui"))
        self.layout.addWidget(widget)
        self.ui = slicer.util.childWidgetVariables(widget)
        widget.setMRMLScene(slicer.mrmlScene)
        self.logic = PalpateLogic()
        self.ui.programPath.currentPath = slicer.util.settingsValue(PROGRAM_SETTING, "")
        self.ui.startButton.connect("clicked(bool)", self._start)
        self.ui.joinButton.connect("clicked(bool)", self._join)
        self.ui.stopButton.connect("clicked(bool)", self._stop)
        self.ui.pageButton.connect("clicked(bool)", self._open_page)
        self.ui.followTip.connect("toggled(bool)", self._follow)
        self.ui.planButton.connect("clicked(bool)", self._write_plan)
        self._timer = qt.QTimer()
        self._timer.setInterval(POLL_MS)
        self._timer.connect("timeout()", self._poll)
        self.addObserver(slicer.mrmlScene, slicer.mrmlScene.StartCloseEvent, self._stop)
        self._show_state()

    def cleanup(self):
        self.removeObservers()
        self._stop()

    def _start(self, *_):
        volume, segmentation = self.ui.volume.currentNode(), self.ui.segmentation.currentNode()
        if volume is None or segmentation is None:
            slicer.util.errorDisplay("Choose a volume and a segmentation first.")
            return
        qt.QSettings().setValue(PROGRAM_SETTING, self.ui.programPath.currentPath)
        device = self.ui.device.text.strip() or "pointer"
        self._begin(lambda: self.logic.session.start(volume, segmentation, self.ui.programPath.currentPath, device,
                                                     self.ui.burr.value))

    def _join(self, *_):
        self._begin(lambda: self.logic.session.attach(self.ui.host.text.strip(), self.ui.port.value))

    def _begin(self, begin):
        with slicer.util.tryWithErrorDisplay("palpate does not begin.", waitCursor=True):
            begin()
            self._timer.start()
        self._show_state()

    def _stop(self, *_):
        self._timer.stop()
        self.logic.session.stop()
        self._show_state()

    def _poll(self):
        try:
            self.logic.session.poll()
        except PalpateError as error:
            self._stop()
            slicer.util.errorDisplay(str(error))
        self.ui.removed.text = f"{self.logic.session.removed_voxels} voxels removed"

    def _follow(self, checked):
        self.logic.session.follow_tip = checked

    def _open_page(self, *_):
        qt.QDesktopServices.openUrl(qt.QUrl(self.logic.session.page))

    def _write_plan(self, *_):
        path = qt.QFileDialog.getSaveFileName(None, "Write a plan", "plan.toml", "Plan (*.toml)")
        if not path:
            return
        with slicer.util.tryWithErrorDisplay("No plan is written."):
            line = self.ui.line.currentNode()
            lines = [line] if line is not None else slicer.util.getNodesByClass("vtkMRMLMarkupsLineNode")
            self.logic.session.write_plan(lines, path)
            # palpate reads it as it will later
            palpate = program.find_program(self.ui.programPath.currentPath)
            program.run_program(palpate, ["plan", "show", path], slicer.util.startupEnvironment())

    def _show_state(self):
        active = self.logic.session.is_active
        self.ui.startButton.enabled = self.ui.joinButton.enabled = not active
        self.ui.stopButton.enabled = active
        self.ui.pageButton.enabled = self.logic.session.page is not None
