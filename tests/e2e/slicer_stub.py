"""Stand-in for 3D Slicer: the classes and functions of `slicer` and `vtk` that the module uses, with their signatures, on NumPy
arrays. It is no test of Slicer: what Slicer itself does may differ.

install() puts it in place; every call begins an empty scene.
"""

import os
import socket
import struct
import sys
import threading
import types

import numpy as np


class Matrix:
    def __init__(self):
        self.values = np.eye(4)

    def GetElement(self, row, column):
        return float(self.values[row, column])


class Reference:
    """vtk.reference: a value that a function changes."""

    def __init__(self, value):
        self.value = value

    def __str__(self):
        return str(self.value)


class Sphere:
    def SetRadius(self, radius):
        self.radius = radius

    def GetOutputPort(self):
        return self


class Node:
    count = 0

    def __init__(self, name):
        Node.count += 1
        self.name, self.id, self.parent = name, f"node{Node.count}", None

    def GetName(self):
        return self.name

    def SetName(self, name):
        self.name = name

    def GetID(self):
        return self.id

    def GetParentTransformNode(self):
        return self.parent

    def SetAndObserveTransformNodeID(self, identifier):
        self.parent = next(node for node in sys.modules["slicer"].mrmlScene.nodes if node.id == identifier)

    def GetTransformNodeID(self):
        return self.parent.id if self.parent is not None else None


class Image:
    def __init__(self, voxels):
        self.voxels = voxels

    def GetDimensions(self):
        return self.voxels.shape[2], self.voxels.shape[1], self.voxels.shape[0]


class Volume(Node):
    def __init__(self, name):
        super().__init__(name)
        self.image, self.matrix = None, np.eye(4)

    def GetImageData(self):
        return self.image

    def GetIJKToRASMatrix(self, matrix):
        matrix.values = self.matrix.copy()

    def SetIJKToRASMatrix(self, matrix):
        self.matrix = matrix.values.copy()


class Segment:
    def __init__(self, name, colour):
        self.name, self.colour, self.tags, self.mask = name, tuple(colour), {}, None

    def GetName(self):
        return self.name

    def GetColor(self):
        return self.colour

    def SetTag(self, key, value):
        self.tags[key] = value

    def GetTag(self, key, value):
        if key not in self.tags:
            return False
        value.value = self.tags[key]
        return True


class Segmentation(Node):
    """Node and vtkSegmentation in one."""

    def __init__(self, name):
        super().__init__(name)
        self.segments = {}

    def GetSegmentation(self):
        return self

    def CreateDefaultDisplayNodes(self):
        pass

    def SetReferenceImageGeometryParameterFromVolumeNode(self, volume):
        self.reference = volume

    def GetNumberOfSegments(self):
        return len(self.segments)

    def GetNthSegmentID(self, n):
        return list(self.segments)[n]

    def GetSegment(self, identifier):
        return self.segments[identifier]

    def AddEmptySegment(self, identifier, name, colour):
        self.segments[identifier] = Segment(name, colour)
        return identifier


class Transform(Node):
    linear = True

    def __init__(self, name):
        super().__init__(name)
        self.matrix = np.eye(4)

    def IsLinear(self):
        return self.linear

    def GetMatrixTransformToWorld(self, matrix):
        matrix.values = self.matrix.copy()


class Display:
    def SetColor(self, *colour):
        self.colour = colour

    def SetLineWidth(self, width):
        self.width = width

    def SetVisibility2D(self, visible):
        self.visible_2d = visible


class Model(Node):
    def __init__(self, name):
        super().__init__(name)
        self.display, self.points = Display(), None

    def GetDisplayNode(self):
        return self.display


class Line(Node):
    def __init__(self, name):
        super().__init__(name)
        self.points = []

    def GetNumberOfControlPoints(self):
        return len(self.points)

    def GetNthControlPointPositionWorld(self, n, position):
        position[:] = self.points[n]


class Connector(Node):
    """A client that makes nodes of what it receives, as SlicerOpenIGTLink does: by a reader of its own."""

    HEAD = struct.Struct(">H12s20sQQQ")

    RECEIVED = {"TRANSFORM": "vtkMRMLLinearTransformNode", "POLYDATA": "vtkMRMLModelNode", "IMAGE": "vtkMRMLScalarVolumeNode"}

    def __init__(self, name):
        super().__init__(name)
        self.incoming = []

    def GetNumberOfIncomingMRMLNodes(self):
        return len(self.incoming)

    def GetIncomingMRMLNode(self, n):
        return self.incoming[n]

    def SetTypeClient(self, host, port):
        self.address = (host, port)

    def Start(self):
        self.socket = socket.create_connection(self.address)
        self.thread = threading.Thread(target=self.receive, daemon=True)
        self.thread.start()

    def Stop(self):
        try:
            self.socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self.thread.join()
        self.socket.close()

    def receive(self):
        with self.socket.makefile("rb") as stream:
            while len(head := stream.read(self.HEAD.size)) == self.HEAD.size:
                _, kind, name, _, size, _ = self.HEAD.unpack(head)
                body = stream.read(size)
                kind, name = (field.split(b"\0")[0].decode() for field in (kind, name))
                if len(body) == size and kind in self.RECEIVED:
                    self.take(kind, name, body)

    def take(self, kind, name, body):
        scene = sys.modules["slicer"].mrmlScene
        node = next((node for node in self.incoming if node.name == name), None)
        if node is None:
            node = scene.AddNewNodeByClass(self.RECEIVED[kind], name)
            self.incoming.append(node)
        if kind == "TRANSFORM":
            matrix = np.eye(4)
            matrix[:3] = np.array(struct.unpack(">12f", body), dtype=float).reshape(4, 3).T
            node.matrix = matrix
            if name == "ProbeToRAS":
                scene.tips.append(matrix[:3, 3])


class Scene:
    CLASSES = {"vtkMRMLScalarVolumeNode": Volume, "vtkMRMLLabelMapVolumeNode": Volume, "vtkMRMLSegmentationNode": Segmentation,
               "vtkMRMLLinearTransformNode": Transform, "vtkMRMLModelNode": Model, "vtkMRMLMarkupsLineNode": Line,
               "vtkMRMLIGTLConnectorNode": Connector}

    def __init__(self):
        self.nodes, self.tips, self.jumps = [], [], []

    def AddNewNodeByClass(self, kind, name=""):
        self.nodes.append(self.CLASSES[kind](name))
        return self.nodes[-1]

    def GetFirstNodeByName(self, name):
        return next((node for node in list(self.nodes) if node.name == name), None)

    def RemoveNode(self, node):
        self.nodes.remove(node)

    def Clear(self, _singletons):
        self.__init__()


class LogicModule:
    """slicer.modules.NAME, whose logic() is itself."""

    def logic(self):
        return self

    def AddModel(self, _port):
        return sys.modules["slicer"].mrmlScene.AddNewNodeByClass("vtkMRMLModelNode", "Model")


def _mask(node, identifier, volume):
    mask = node.GetSegment(identifier).mask
    if mask is None:
        return np.zeros(volume.image.voxels.shape, dtype=np.uint8)
    assert mask.shape == volume.image.voxels.shape, "the stand-in does not resample"
    return mask.copy()


def _set_mask(voxels, node, identifier, volume):
    assert voxels.shape == volume.image.voxels.shape and voxels.dtype == np.uint8
    node.GetSegment(identifier).mask = voxels.copy()


def _set_voxels(volume, voxels):
    volume.image = Image(voxels.copy())


def _matrix(values):
    matrix = Matrix()
    matrix.values = np.array(values, dtype=float)
    return matrix


def install():
    """Modules `slicer` and `vtk` with an empty scene. @returns the scene"""
    vtk = types.ModuleType("vtk")
    vtk.vtkMatrix4x4, vtk.reference, vtk.vtkSphereSource = Matrix, Reference, Sphere
    scene = Scene()

    class SliceNode:
        @staticmethod
        def JumpAllSlices(of, *position):
            of.jumps.append(position)

    slicer = types.ModuleType("slicer")
    slicer.mrmlScene, slicer.vtkMRMLSliceNode = scene, SliceNode
    slicer.modules = types.SimpleNamespace(models=LogicModule())
    slicer.app = types.SimpleNamespace(processEvents=lambda: None)
    slicer.util = types.SimpleNamespace(
        arrayFromVolume=lambda volume: volume.image.voxels, updateVolumeFromArray=_set_voxels, arrayFromSegmentBinaryLabelmap=_mask,
        updateSegmentBinaryLabelmapFromArray=_set_mask, arrayFromVTKMatrix=lambda matrix: matrix.values.copy(), vtkMatrixFromArray=_matrix,
        setSliceViewerLayers=lambda background: setattr(scene, "background", background), startupEnvironment=lambda: dict(os.environ))
    sys.modules.update(vtk=vtk, slicer=slicer)
    return scene
