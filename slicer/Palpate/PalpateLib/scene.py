"""Slicer's scene: volumes, segmentations, lines and what palpate publishes, as plain values. The only file of the logic
that uses Slicer's classes."""

import numpy as np
import slicer
import vtk

from .errors import PalpateError
from .grid import Grid
from .labels import Labels
from .nrrd import TYPES

# tag of a segment: its label in palpate
LABEL_TAG = "Palpate.Label"
PROBE, ARROW, SLICE = "ProbeToRAS", "ForceArrow", "Slice"
PROBE_MODEL = "Palpate tool"
TOOL_RADIUS_MM = 2


# ---- volumes

def grid_of(volume):
    """Grid of a volume in the scene's frame: with its parent transform, if that is linear."""
    matrix = vtk.vtkMatrix4x4()
    volume.GetIJKToRASMatrix(matrix)
    ijk_to_ras = slicer.util.arrayFromVTKMatrix(matrix)
    transform = volume.GetParentTransformNode()
    if transform is not None:
        if not transform.IsLinear():
            raise PalpateError("is under a transform that is not linear", volume.GetName(),
                               "harden the transform (module Transforms)")
        transform.GetMatrixTransformToWorld(matrix)
        ijk_to_ras = slicer.util.arrayFromVTKMatrix(matrix) @ ijk_to_ras
    return Grid.from_ijk_to_ras(volume.GetImageData().GetDimensions(), ijk_to_ras)


def scan_of(volume):
    """@returns (Grid, voxels) of a volume with one value for each voxel"""
    if volume.GetImageData() is None:
        raise PalpateError("has no voxels", volume.GetName(), "choose another volume")
    voxels = slicer.util.arrayFromVolume(volume)
    if voxels.ndim != 3 or voxels.dtype.name not in TYPES:
        raise PalpateError("is no scan with one number for each voxel", volume.GetName(), "choose a scalar volume")
    return grid_of(volume), voxels


# ---- segmentations

def _segments(segmentation):
    return [segmentation.GetNthSegmentID(n) for n in range(segmentation.GetNumberOfSegments())]


def _label_of(segment):
    value = vtk.reference("")
    return int(str(value)) if segment.GetTag(LABEL_TAG, value) and str(value).isdigit() else None


def labels_of(node, volume):
    """@returns Labels of a segmentation on a volume's grid. Each segment's label becomes its tag, to stay the same"""
    if node.GetParentTransformNode() is not volume.GetParentTransformNode():
        raise PalpateError(f"is under another transform than {volume.GetName()}", node.GetName(),
                           "put both under the same one, or harden it (module Transforms)")
    segmentation = node.GetSegmentation()
    masks = []
    for identifier in _segments(segmentation):
        segment = segmentation.GetSegment(identifier)
        mask = slicer.util.arrayFromSegmentBinaryLabelmap(node, identifier, volume) != 0
        masks.append((identifier, segment.GetName(), segment.GetColor(), _label_of(segment), mask))
    if not masks:
        raise PalpateError("has no segments", node.GetName(), "segment the structures first (module Segment Editor)")
    labels = Labels.from_masks(grid_of(volume), masks)
    for segment in labels.segments:
        segmentation.GetSegment(segment.id).SetTag(LABEL_TAG, str(segment.label))
    return labels


def new_volume(grid, voxels, name):
    volume = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLLabelMapVolumeNode", name)
    volume.SetIJKToRASMatrix(slicer.util.vtkMatrixFromArray(grid.ijk_to_ras()))
    slicer.util.updateVolumeFromArray(volume, voxels)
    return volume


def new_segmentation(grid, voxels, names, name):
    """Makes a segmentation of received labels.

    @param names  {label: (name, colour)}; labels without a name get their number
    @returns (segmentation node, reference volume, Labels)
    """
    volume = new_volume(grid, voxels, f"{name} labels")
    node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLSegmentationNode", name)
    node.CreateDefaultDisplayNodes()
    node.SetReferenceImageGeometryParameterFromVolumeNode(volume)
    segmentation = node.GetSegmentation()
    masks = []
    for label in np.unique(voxels).tolist():
        if label == 0:
            continue
        text, colour = names.get(label, (f"label {label}", (0.8, 0.8, 0.8)))
        identifier = segmentation.AddEmptySegment(f"Segment_{label}", text, colour)
        segmentation.GetSegment(identifier).SetTag(LABEL_TAG, str(label))
        mask = voxels == label
        slicer.util.updateSegmentBinaryLabelmapFromArray(mask.astype(np.uint8), node, identifier, volume)
        masks.append((identifier, text, colour, label, mask))
    return node, volume, Labels.from_masks(grid, masks)


def change_segment(node, volume, segment, mask):
    slicer.util.updateSegmentBinaryLabelmapFromArray(mask.astype(np.uint8), node, segment.id, volume)


# ---- lines

def line_of(node):
    """@returns (name, positions in RAS, mm) of a line in the scene's frame"""
    positions = []
    for n in range(node.GetNumberOfControlPoints()):
        position = [0.0, 0.0, 0.0]
        node.GetNthControlPointPositionWorld(n, position)
        positions.append(position)
    return node.GetName(), positions


# ---- what palpate publishes

def connect(host, port):
    """@returns a connector, which receives poses, forces and sections into nodes of their names"""
    try:
        connector = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLIGTLConnectorNode", "Palpate connection")
    except RuntimeError:
        connector = None
    if connector is None:
        raise PalpateError("Slicer has no OpenIGTLink", "",
                           "install the extension SlicerOpenIGTLink (Extensions Manager)")
    connector.SetTypeClient(host, port)
    connector.Start()
    return connector


def disconnect(connector):
    """Removes the connector with the nodes that it has received: the next one makes nodes of its own."""
    connector.Stop()
    for node in [connector.GetIncomingMRMLNode(n) for n in range(connector.GetNumberOfIncomingMRMLNodes())]:
        slicer.mrmlScene.RemoveNode(node)
    model = slicer.mrmlScene.GetFirstNodeByName(PROBE_MODEL)
    if model is not None:
        slicer.mrmlScene.RemoveNode(model)
    slicer.mrmlScene.RemoveNode(connector)


def show_probe():
    """A ball at the tool's tip, once the first pose has come. @returns its model; None: no pose yet"""
    probe = slicer.mrmlScene.GetFirstNodeByName(PROBE)
    if probe is None:
        return None
    model = slicer.mrmlScene.GetFirstNodeByName(PROBE_MODEL)
    if model is None:
        ball = vtk.vtkSphereSource()
        ball.SetRadius(TOOL_RADIUS_MM)
        model = slicer.modules.models.logic().AddModel(ball.GetOutputPort())
        model.SetName(PROBE_MODEL)
        model.GetDisplayNode().SetColor(0.95, 0.75, 0.1)
    if model.GetTransformNodeID() != probe.GetID():
        model.SetAndObserveTransformNodeID(probe.GetID())
    return model


def show_arrow():
    """The force's arrow as a line that is visible in slices too. @returns its model; None: it has not come yet"""
    arrow = slicer.mrmlScene.GetFirstNodeByName(ARROW)
    display = arrow.GetDisplayNode() if arrow is not None else None
    if display is None:
        return None
    display.SetColor(1.0, 0.2, 0.1)
    display.SetLineWidth(5)
    display.SetVisibility2D(True)
    return arrow


def show_slice():
    """The received section as the background of the slice views. @returns its volume; None: it has not come yet"""
    received = slicer.mrmlScene.GetFirstNodeByName(SLICE)
    if received is not None:
        slicer.util.setSliceViewerLayers(background=received)
    return received


def tip_ras_mm():
    """Position of the tool's tip; None: no pose yet."""
    probe = slicer.mrmlScene.GetFirstNodeByName(PROBE)
    if probe is None:
        return None
    matrix = vtk.vtkMatrix4x4()
    probe.GetMatrixTransformToWorld(matrix)
    return tuple(matrix.GetElement(row, 3) for row in range(3))


def show_sections_at(position):
    slicer.vtkMRMLSliceNode.JumpAllSlices(slicer.mrmlScene, *position)


def environment():
    """The environment outside of Slicer: its own has Slicer's libraries, which palpate must not load."""
    return slicer.util.startupEnvironment()
