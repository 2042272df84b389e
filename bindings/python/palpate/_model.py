"""Models: segmented volumes with the haptic properties of their structures."""

from __future__ import annotations

import ctypes
import dataclasses
import math
import os
import weakref
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from . import _library as c

_VOXELS = {np.dtype(kind): number for number, kind in enumerate("u1 i1 u2 i2 u4 i4 u8 i8".split())}

# (right, down) of planes and views in the patient
_X, _Y, _Z = np.eye(3)
_PLANES = {"axial": (_X, _Y), "sagittal": (_Y, -_Z), "coronal": (_X, -_Z)}
_VIEWS = {"anterior": (_X, -_Z), "posterior": (-_X, -_Z), "left": (_Y, -_Z), "right": (-_Y, -_Z), "superior": (-_X, _Y),
          "inferior": (_X, _Y)}


@dataclasses.dataclass(frozen=True)
class Tissue:
    """Haptic properties of structures; docs/guide/scene.md has their meaning and ranges.

    Attributes:
        labels: numbers of the structures made of it, 1 ... 65535.
        stiffness: force per depth, N/mm.
        friction: kinetic coefficient.
        static_friction: static coefficient, at least `friction`; None: equal to `friction`.
        viscosity: force per velocity within it, N s/mm.
        puncture: normal force above which the tool punctures it, N; infinite: never.
        touchable: False: displayed only, without contact.
    """

    labels: Tuple[int, ...] = ()
    stiffness: float = 1.0
    friction: float = 0.1
    static_friction: Optional[float] = None
    viscosity: float = 0.001
    puncture: float = math.inf
    touchable: bool = True


@dataclasses.dataclass(frozen=True)
class Tool:
    """Shape of an instrument, fixed in the tip's frame; at most 4 spheres and capsules.

    Attributes:
        points: centres of its spheres, mm.
        radius: radius of every sphere, mm; 0: points.
        capsules: (end, other end, radius) of each, mm.
        name: text.
    """

    points: Sequence[Sequence[float]] = ((0.0, 0.0, 0.0),)
    radius: float = 0.0
    capsules: Sequence[Tuple[Sequence[float], Sequence[float], float]] = ()
    name: str = "tool"


@dataclasses.dataclass(frozen=True)
class Structure:
    """A label with its name, the name of its tissue (None: none), and its colour (red, green, blue, 0 ... 255)."""

    label: int
    name: str
    tissue: Optional[str]
    colour: Tuple[int, int, int]


class _View:
    """NumPy array interface to the memory of a model; keeps the model alive."""

    def __init__(self, owner: "Model", address: int, shape: Tuple[int, ...], strides: Tuple[int, ...]) -> None:
        self.owner = owner
        self.__array_interface__ = {"version": 3, "typestr": "<f4", "shape": shape, "strides": strides, "data": (address, True)}


def _tissue_of(given: Union[Tissue, Mapping[str, Any]]) -> Tissue:
    if isinstance(given, Tissue):
        return given
    values = dict(given)
    labels = values.get("labels", ())
    values["labels"] = tuple(int(label) for label in np.atleast_1d(labels))
    return Tissue(**values)


def _labels_struct(labels: np.ndarray, spacing: Any, origin: Any, direction: Any) -> Any:
    if labels.ndim != 3:
        raise c.BadInput(f"labels: an array of {labels.ndim} dimensions\n  give one of shape (i, j, k)")
    if labels.dtype.newbyteorder("=") not in _VOXELS or not labels.dtype.isnative:
        raise c.BadInput(f"labels: an array of {labels.dtype}\n  give one of integers, in native byte order")
    try:
        matrix = np.eye(3) if direction is None else np.asarray(direction, float).reshape(3, 3)
        steps, first = np.broadcast_to(np.asarray(spacing, float), 3), np.broadcast_to(np.asarray(origin, float), 3)
    except ValueError as error:
        raise c.BadInput(f"spacing, origin or direction: {error}") from error
    return c.initialised(c.Labels, type=_VOXELS[labels.dtype], voxels=labels.ctypes.data, dims=labels.shape,
                         strides_bytes=labels.strides if labels.size else (1, 1, 1), spacing_mm=tuple(steps),
                         origin_mm=tuple(first), direction=tuple(matrix.ravel()))


def _array(struct: Any, elements: Sequence[Any]) -> Tuple[Any, int]:
    """A C array of structs, or null, and its length."""
    return ((struct * len(elements))(*elements) if elements else None), len(elements)


def _tool_struct(tool: Tool, keep: List[Any]) -> Any:
    points = np.ascontiguousarray(tool.points, float).reshape(-1, 3)
    capsules = np.array([[*start, *end, radius] for start, end, radius in tool.capsules], float).reshape(-1, 7)
    keep += [points, capsules]
    return c.initialised(c.Tool, name=tool.name.encode(), points_mm=points.ctypes.data, point_count=len(points),
                         radius_mm=tool.radius, capsules=capsules.ctypes.data, capsule_count=len(capsules))


class Model:
    """A segmented volume with the haptic properties of its structures. Immutable; versions share unchanged data.

    Args:
        labels: integer array of shape (i, j, k), of any memory order and integer width: values 0 (background) ... 65535. It is
            read during the call, not copied as a whole. `sitk.GetArrayViewFromImage(image).T` has this shape.
        spacing: distance of voxel centres along i, j, k, mm.
        origin: centre of voxel (0, 0, 0) in the patient (LPS), mm.
        direction: 3 x 3; its columns are the unit vectors of i, j, k in the patient. None: those of the patient's axes.
        tissues: name to Tissue, or to a dict of Tissue's attributes. Labels without a tissue have no contact.
        tools: one for each device; none: a point.
        names: label to structure name; default: the name of its tissue.
        method: force method that the model is prepared for (docs/concepts/methods.md).
        title: text.
        max_force: limit of the force, N.

    Raises:
        BadInput: an argument that cannot be used.
    """

    def __init__(self, labels: Any, *, spacing: Any = 1.0, origin: Any = 0.0, direction: Any = None,
                 tissues: Mapping[str, Union[Tissue, Mapping[str, Any]]], tools: Sequence[Tool] = (),
                 names: Optional[Mapping[int, str]] = None, method: str = "proxy", title: str = "",
                 max_force: float = math.inf) -> None:
        keep: List[Any] = []
        volume = np.asarray(labels)
        made = {name: _tissue_of(tissue) for name, tissue in tissues.items()}
        options = c.initialised(c.ModelOptions, method=c.method_number(method), title=title.encode(), max_force_N=max_force)
        structures = [
            c.initialised(c.Structure, label=label, tissue=index,
                          name=(names or {}).get(label, name if len(tissue.labels) == 1 else f"{name} {label}").encode())
            for index, (name, tissue) in enumerate(made.items()) for label in tissue.labels]
        in_tissues, tissue_count = _array(c.Tissue, [
            c.initialised(c.Tissue, name=name.encode(), touchable=t.touchable, stiffness_N_per_mm=t.stiffness, friction=t.friction,
                          static_friction=t.friction if t.static_friction is None else t.static_friction,
                          viscosity_N_s_per_mm=t.viscosity, puncture_N=t.puncture) for name, t in made.items()])
        in_structures, structure_count = _array(c.Structure, structures)
        in_tools, tool_count = _array(c.Tool, [_tool_struct(tool, keep) for tool in tools])
        self._take(c.made(c.lib.plp_model_create, ctypes.byref(_labels_struct(volume, spacing, origin, direction)), in_tissues,
                          tissue_count, in_structures, structure_count, in_tools, tool_count, ctypes.byref(options)))

    def _take(self, handle: int) -> None:
        self._handle = handle
        self._finalizer = weakref.finalize(self, c.lib.plp_model_destroy, handle)
        self._info = c.sized(c.ModelInfo)
        c.check(c.lib.plp_model_info_get(handle, ctypes.byref(self._info)))

    @classmethod
    def _of(cls, handle: int) -> "Model":
        model = cls.__new__(cls)
        model._take(handle)
        return model

    def __repr__(self) -> str:
        return f"<palpate.Model {self.title!r}, version {self.version}, {'x'.join(map(str, self.shape))} voxels>"

    # ---- what it is

    @property
    def title(self) -> str:
        """Title of the scene."""
        return (self._info.title or b"").decode("utf-8", "replace")

    @property
    def version(self) -> int:
        """Version number: 1, incremented by each change."""
        return int(self._info.version)

    @property
    def hash(self) -> int:
        """64-bit hash of all data that determine forces."""
        return int(self._info.content_hash)

    @property
    def method(self) -> str:
        """Force method that it is prepared for."""
        return c.method_name(self._info.method)

    @property
    def shape(self) -> Tuple[int, int, int]:
        """Voxels along i, j, k."""
        return tuple(self._info.dims)  # type: ignore[return-value]

    @property
    def spacing(self) -> np.ndarray:
        """Distance of voxel centres along i, j, k, mm, shape (3,)."""
        return np.array(self._info.spacing_mm)

    @property
    def origin(self) -> np.ndarray:
        """Centre of voxel (0, 0, 0) in the patient (LPS), mm, shape (3,)."""
        return np.array(self._info.origin_mm)

    @property
    def direction(self) -> np.ndarray:
        """Its columns are the unit vectors of i, j, k in the patient, shape (3, 3)."""
        return np.array(self._info.direction).reshape(3, 3)

    @property
    def world_patient(self) -> np.ndarray:
        """Rigid map from the patient to World, homogeneous, shape (4, 4)."""
        return np.array(self._info.world_patient).reshape(4, 4)

    def points(self, indices: Any) -> np.ndarray:
        """Converts voxel indices to positions in the patient (LPS), mm; both of shape (..., 3)."""
        return np.asarray(indices, float) * self.spacing @ self.direction.T + self.origin

    @property
    def tissues(self) -> Dict[str, Tissue]:
        """Name to properties, in the order of the scene."""
        labels: Dict[Optional[str], List[int]] = {}
        for structure in self.structures:
            labels.setdefault(structure.tissue, []).append(structure.label)
        made = {}
        for raw in self._raw_tissues():
            name = raw.name.decode("utf-8", "replace")
            made[name] = Tissue(tuple(labels.get(name, ())), raw.stiffness_N_per_mm, raw.friction, raw.static_friction,
                                raw.viscosity_N_s_per_mm, raw.puncture_N, bool(raw.touchable))
        return made

    def _raw_tissues(self) -> List[Any]:
        raws = [c.initialised(c.Tissue) for _ in range(self._info.tissues)]
        for index, raw in enumerate(raws):
            c.check(c.lib.plp_model_tissue(self._handle, index, ctypes.byref(raw)))
        return raws

    @property
    def structures(self) -> List[Structure]:
        """Labels with their names and tissues, ascending."""
        names = [raw.name.decode("utf-8", "replace") for raw in self._raw_tissues()]
        made = []
        for index in range(self._info.structures):
            raw = c.initialised(c.Structure)
            c.check(c.lib.plp_model_structure(self._handle, index, ctypes.byref(raw)))
            made.append(Structure(raw.label, (raw.name or b"").decode("utf-8", "replace"),
                                  names[raw.tissue] if raw.tissue >= 0 else None, tuple(raw.rgb)))
        return made

    def labels_of(self, name: str) -> List[int]:
        """Labels of the structures of this name, or of the tissue of this name.

        Raises:
            BadInput: no structure or tissue has this name.
        """
        structures = self.structures
        found = ([s.label for s in structures if s.name == name] or [s.label for s in structures if s.tissue == name])
        if not found:
            known = ", ".join(sorted({s.name for s in structures if s.name} | {s.tissue for s in structures if s.tissue}))
            raise c.BadInput(f"name: there is no structure or tissue {name!r}\n  known are: {known}")
        return found

    def labels(self) -> np.ndarray:
        """A copy of the labels, uint16 of shape (i, j, k), i fastest."""
        voxels = np.empty(self.shape, np.uint16, order="F")
        c.check(c.lib.plp_model_labels(self._handle, voxels.ctypes.data, voxels.size))
        return voxels

    def scan(self) -> np.ndarray:
        """The scan on the labels' grid, float32 of shape (i, j, k), read-only: a view, which keeps the model alive.

        Raises:
            Unavailable: the model has no scan.
        """
        voxels, count = ctypes.c_void_p(), ctypes.c_size_t()
        c.check(c.lib.plp_model_scan(self._handle, ctypes.byref(voxels), ctypes.byref(count)))
        i, j, _ = self.shape
        return np.asarray(_View(self, int(voxels.value or 0), self.shape, (4, 4 * i, 4 * i * j)))

    def sample(self, points: Any, method: Optional[str] = None) -> Tuple[np.ndarray, np.ndarray]:
        """The field that a method renders, at points in the patient (LPS), mm, shape (..., 3).

        Returns:
            (values, gradients) of shapes (...) and (..., 3), per mm. For the proxy the value is the signed distance to the nearest
            contact surface, mm, negative inside and clamped to a few millimetres. For any other method it is
            0 in free space and 1 deep in
            the stiffest tissue.
        """
        at = np.ascontiguousarray(points, float)
        if at.shape[-1:] != (3,):
            raise c.BadInput(f"points: an array of shape {at.shape}\n  give one whose last axis has 3 coordinates")
        values, gradients = np.empty(at.shape[:-1]), np.empty(at.shape)
        c.check(c.lib.plp_model_sample(self._handle, c.method_number(method), at.ctypes.data, values.size, values.ctypes.data,
                                       gradients.ctypes.data))
        return values, gradients

    # ---- pictures

    def _middle(self) -> np.ndarray:
        return self.points((np.array(self.shape) - 1) / 2)

    def _window(self, struct: Any, place: str, at: Any, axes: Any, names: Mapping[str, Any], size: Optional[float], pixels: int,
                **more: Any) -> Any:
        if isinstance(axes, str) and axes not in names:
            raise c.BadInput(f"unknown plane or view {axes!r}\n  give one of {', '.join(names)}, or the vectors to the right and down")
        right, down = (np.asarray(axis, float) for axis in (names[axes] if isinstance(axes, str) else axes))
        centre = self._middle() if at is None else np.asarray(at, float)
        if right.shape != (3,) or down.shape != (3,) or centre.shape != (3,):
            raise c.BadInput("a position and two vectors of 3 coordinates are needed")
        width = float(np.max(self.spacing * self.shape)) if size is None else size
        return c.initialised(struct, width_px=pixels, height_px=pixels, width_mm=width, right=tuple(right), down=tuple(down),
                             **{place: tuple(centre)}, **more)

    def section(self, plane: Any = "axial", at: Any = None, *, size: Optional[float] = None, pixels: int = 512,
                opacity: float = 0.55, outlines: bool = True, window: Optional[Tuple[float, float]] = None) -> np.ndarray:
        """Scan and structures in a plane: uint8 of shape (pixels, pixels, 3), row 0 at the top.

        Args:
            plane: "axial", "sagittal" or "coronal", in radiological display convention,
                or two orthogonal unit vectors in the patient: to
                the right and down.
            at: centre in the patient (LPS), mm; None: the volume's.
            size: width and height, mm; None: the volume's longest side.
            opacity: of the structures' colours over the scan, 0 ... 1.
            outlines: whether structures are outlined.
            window: scan values shown black and white; None: the 1st and 99th percentile.
        """
        low, high = (0.0, 0.0) if window is None else window
        section = self._window(c.Section, "centre_mm", at, plane, _PLANES, size, pixels, label_opacity=opacity, outlines=outlines,
                               window_low=low, window_high=high)
        image = np.empty((pixels, pixels, 3), np.uint8)
        c.check(c.lib.plp_model_section(self._handle, ctypes.byref(section), image.ctypes.data, image.size))
        return image

    def section_labels(self, plane: Any = "axial", at: Any = None, *, size: Optional[float] = None,
                       pixels: int = 512) -> np.ndarray:
        """The label at each pixel of section(): uint16 of shape (pixels, pixels); 0: none."""
        section = self._window(c.Section, "centre_mm", at, plane, _PLANES, size, pixels)
        labels = np.empty((pixels, pixels), np.uint16)
        c.check(c.lib.plp_model_section_labels(self._handle, ctypes.byref(section), labels.ctypes.data, labels.size))
        return labels

    def picture(self, view: Any = "anterior", at: Any = None, *, size: Optional[float] = None, pixels: int = 512,
                eye: float = math.inf) -> Tuple[np.ndarray, np.ndarray]:
        """Renders the structures in three dimensions, without a GPU.

        Args:
            view: side of the viewer: "anterior", "posterior", "left", "right", "superior" or "inferior", or two orthogonal unit
                vectors in the patient: to the right and down.
            at: centre in the patient (LPS), mm; None: the volume's.
            size: width and height at the centre, mm; None: the volume's longest side.
            eye: distance of the eye from the centre, mm; infinite: parallel rays.

        Returns:
            (rgb, depth): uint8 of shape (pixels, pixels, 3), and float32 of shape (pixels, pixels): the distance of the visible
            surface
            from the eye, or with parallel rays from the plane through the centre, mm; infinite: nothing.
        """
        camera = self._window(c.Camera, "focus_mm", at, view, _VIEWS, size, pixels, eye_mm=eye)
        image, depth = np.empty((pixels, pixels, 3), np.uint8), np.empty((pixels, pixels), np.float32)
        c.check(c.lib.plp_model_picture(self._handle, ctypes.byref(camera), image.ctypes.data, image.size, depth.ctypes.data))
        return image, depth

    # ---- versions

    def with_(self, *, stiffness: Optional[Mapping[str, float]] = None, friction: Optional[Mapping[str, float]] = None,
              static_friction: Optional[Mapping[str, float]] = None,
              viscosity: Optional[Mapping[str, float]] = None) -> "Model":
        """Returns a version with changed contact properties of some tissues.
        Each argument maps a tissue's or structure's name to the value, in the
        units of Tissue; a structure's name selects its tissue.

        Raises:
            BadInput: an unknown name, or a value out of range.
        """
        raws = self._raw_tissues()
        index_of = {raw.name.decode("utf-8", "replace"): index for index, raw in enumerate(raws)}
        by_structure = {s.name: s.tissue for s in self.structures if s.tissue is not None}
        changed: Dict[int, Any] = {}
        for member, values in (("friction", friction), ("static_friction", static_friction), ("stiffness_N_per_mm", stiffness),
                               ("viscosity_N_s_per_mm", viscosity)):
            for name, value in (values or {}).items():
                index = index_of.get(name, index_of.get(by_structure.get(name, ""), -1))
                if index < 0:
                    raise c.BadInput(f"{member}: there is no tissue or structure {name!r}\n  known are: {', '.join(index_of)}")
                raw = changed.setdefault(index, raws[index])
                setattr(raw, member, float(value))
                if member == "friction":
                    raw.static_friction = max(raw.static_friction, raw.friction)
        model, before = self, len(changed)
        while changed:
            # a tissue must not be stiffer than its support: a change rejected now may be valid after another one
            refused: Optional[c.BadInput] = None
            for index, raw in list(changed.items()):
                try:
                    model = Model._of(c.made(c.lib.plp_model_change, model._handle, index, ctypes.byref(raw)))
                    del changed[index]
                except c.BadInput as error:
                    refused = refused or error
            if refused is not None and len(changed) == before:
                raise refused
            before = len(changed)
        return model

    def cut(self, path: Any, radius: float) -> "Model":
        """Returns a version without the volume swept by a ball of this radius, mm, along a path in the patient (LPS), mm, of
        shape (3,) or (n, 3).

        Raises:
            BadInput: an invalid path or radius, or a model that is not prepared for the proxy.
        """
        points = np.atleast_2d(np.asarray(path, float))
        if points.shape[-1] != 3 or points.ndim != 2:
            raise c.BadInput(f"path: an array of shape {points.shape}\n  give (3,) or (n, 3)")
        ends = points[1:] if len(points) > 1 else points
        cuts, count = _array(c.Cut, [c.initialised(c.Cut, from_mm=tuple(start), to_mm=tuple(end), radius_mm=radius)
                                     for start, end in zip(points, ends)])
        return Model._of(c.made(c.lib.plp_model_cut, self._handle, cuts, count))


def load(scene: Union[str, "os.PathLike[str]"], segmentation: Union[str, "os.PathLike[str]", None] = None, *,
         method: Optional[str] = None) -> Model:
    """Loads what the command `palpate` accepts: a data set ("knee-phantom:spacing=2"), a scene file, or a volume with or without its
    segmentation. Prepared data are cached on disk (docs/guide/cache.md).

    Args:
        method: force method that it is prepared for; None: the scene's.

    Raises:
        BadInput, Unavailable: an invalid scene, or a data set that is not installed.
    """
    options = c.initialised(c.ModelOptions, method=c.method_number(method))
    second = None if segmentation is None else os.fsencode(segmentation)
    return Model._of(c.made(c.lib.plp_model_load, os.fsencode(scene), second, ctypes.byref(options)))
