"""A segmentation as label volumes, and what a burr changes in it."""

import dataclasses

import numpy as np

from .errors import PalpateError

MAX_LABEL = 65535


@dataclasses.dataclass
class Segment:
    """id      Slicer's identifier
    name    name of the structure
    colour  red, green, blue, 0 to 1
    label   value of its voxels, 1 to 65535, unique in the segmentation
    layer   index of the label volume that holds it"""

    id: str
    name: str
    colour: tuple
    label: int
    layer: int = 0


class Labels:
    """Segments as few label volumes: segments that overlap are in different layers.

    grid      Grid of the volumes
    segments  list of Segment
    layers    uint16 arrays of the grid's shape; never empty
    """

    def __init__(self, grid, segments, layers):
        self.grid, self.segments, self.layers = grid, segments, layers

    @classmethod
    def from_masks(cls, grid, masks):
        """Assigns labels and layers.

        @param masks  iterable of (id, name, colour, label or None, boolean array). A label that is missing or taken is
                      replaced by the lowest free number
        """
        masks = list(masks)
        asked = [label for _, _, _, label, _ in masks if label is not None and 1 <= label <= MAX_LABEL]
        free = iter(sorted(set(range(1, len(masks) + len(asked) + 1)) - set(asked)))
        segments, layers, taken = [], [], set()
        for identifier, name, colour, label, mask in masks:
            if label is None or not 1 <= label <= MAX_LABEL or label in taken:
                label = next(free)
            if label > MAX_LABEL:
                raise PalpateError(f"has more than {MAX_LABEL} segments", name, "remove those that are not to be felt")
            taken.add(label)
            for layer, voxels in enumerate(layers):
                if not voxels[mask].any():
                    break
            else:
                layer = len(layers)
                layers.append(np.zeros(grid.shape, dtype=np.uint16))
            layers[layer][mask] = label
            segments.append(Segment(identifier, name, tuple(colour), label, layer))
        return cls(grid, segments, layers or [np.zeros(grid.shape, dtype=np.uint16)])

    def occupied(self):
        """Voxels that any segment has."""
        return np.logical_or.reduce([layer != 0 for layer in self.layers])


class Removal:
    """Voxels that a burr has removed from a segmentation: those of a segment where palpate's labels are 0. An undone
    stroke restores a voxel in all its segments."""

    def __init__(self, labels):
        """@param labels  Labels before any cut"""
        self._labels = labels
        self._occupied = labels.occupied()
        self._removed = np.zeros(labels.grid.shape, dtype=bool)

    def update(self, voxels):
        """@param voxels  palpate's latest labels, of the grid's shape
        @returns [(segment, boolean array)], the segments that have changed, with their voxels"""
        removed = self._occupied & (voxels == 0)
        changed = removed != self._removed
        if not changed.any():
            return []
        self._removed = removed
        present = [set(np.unique(layer[changed]).tolist()) for layer in self._labels.layers]
        return [(segment, (self._labels.layers[segment.layer] == segment.label) & ~removed)
                for segment in self._labels.segments if segment.label in present[segment.layer]]

    @property
    def removed_voxels(self):
        return int(self._removed.sum())
