"""Runs of the simulated hand, in memory and from recordings."""

from __future__ import annotations

import ctypes
import os
import weakref
from typing import Any, List, Mapping, Optional, Tuple, Union

import numpy as np

from . import _library as c
from ._model import Model, load

_AXES = ("x", "y", "z")


def _frame(records: np.ndarray) -> Any:
    """A pandas.DataFrame of ticks: a vector becomes one column for each component."""
    import pandas  # pylint: disable=import-outside-toplevel

    columns = {}
    for name in records.dtype.names or ():
        values = records[name]
        if name == "size" or values.ndim == 1:
            columns[name] = values
        else:
            parts = _AXES if values.shape[1] == 3 else [str(n) for n in range(values.shape[1])]
            columns.update({f"{name}_{part}": values[:, n] for n, part in enumerate(parts)})
    columns.pop("size", None)
    return pandas.DataFrame(columns)


def _loading(records: np.ndarray, labels: List[int]) -> Tuple[np.ndarray, np.ndarray]:
    """Depth and force of the contact with these labels that had the largest force, from first touch to that maximum."""
    force = np.linalg.norm(records["force_world_N"], axis=1)
    touched = np.isin(records["label"], labels)
    if not touched.any():
        return np.empty(0), np.empty(0)
    last = int(np.argmax(np.where(touched, force, -1)))
    gaps = np.flatnonzero(~touched[:last])
    first = int(gaps[-1]) + 1 if gaps.size else 0
    return records["depth_mm"][first:last + 1].copy(), force[first:last + 1]


class Run:
    """A finished run of the simulated hand.

    Attributes:
        model: the model at the beginning.
        records: structured array, one element a tick, whose fields are the members of plp_record (include/palpate.h).
        hash: 64-bit hash over all ticks, equal to that of `palpate simulate` for equal inputs.
        rate: ticks a second.
        max_force, limit: greatest force, and the limit of the force, N.
        failed_steps: number of steps of the script that failed.
        trouble: messages about failed steps and unreachable forces.
    """

    def __init__(self, model: Model, handle: int) -> None:
        finalizer = weakref.finalize(self, c.lib.plp_run_destroy, handle)
        info = c.sized(c.RunInfo)
        c.check(c.lib.plp_run_info_get(handle, ctypes.byref(info)))
        self.model = model
        self.records = c.records(info.ticks)
        if info.ticks:
            c.check(c.lib.plp_run_records(handle, 0, 0, info.ticks, self.records.ctypes.data))
        self.hash, self.rate = int(info.run_hash), float(info.rate_hz)
        self.max_force, self.limit, self.failed_steps = info.max_force_N, info.limit_N, int(info.failed_steps)
        self.trouble = [c.lib.plp_run_trouble(handle, n).decode("utf-8", "replace") for n in range(info.troubles)]
        finalizer()

    def __repr__(self) -> str:
        return f"<palpate.Run of {len(self.records)} ticks, hash {self.hash:016x}>"

    def press(self, name: str) -> Tuple[np.ndarray, np.ndarray]:
        """Depth in mm and force in N of the contact with a structure that had the largest force, from first touch to that
        maximum. Empty if it was not touched.

        Args:
            name: name of a structure or tissue.

        Raises:
            BadInput: no structure or tissue has this name.
        """
        return _loading(self.records, self.model.labels_of(name))

    def frame(self) -> Any:
        """The records as a pandas.DataFrame."""
        return _frame(self.records)


def simulate(scene: Union[Model, str, "os.PathLike[str]"], script: Union[str, "os.PathLike[str]", None] = None, *,
             seed: Optional[int] = None, stiffness: Optional[Mapping[str, float]] = None, max_force: Optional[float] = None,
             rate: Optional[float] = None, method: Optional[str] = None,
             recording: Union[str, "os.PathLike[str]", None] = None) -> Run:
    """Runs a script with the simulated hand on the virtual clock, as `palpate simulate` does; bitwise reproducible.

    Args:
        scene: a model, or what load() takes.
        script: file of a palpation script (docs/guide/script.md), or its text (recognised by a line break). None: a default
            script planned for the scene.
        seed: seed of the hand's tremor; None: the script's.
        stiffness: tissue or structure to N/mm (Model.with_).
        max_force: limit, N; None: the lesser of the device's continuous rating and 3 N.
        rate: ticks a second; None: the script's.
        method: initial force method; None: the scene's.
        recording: HDF5 file to write, or None.

    Raises:
        BadInput, Usage, Unavailable, OutputError.
    """
    model = scene if isinstance(scene, Model) else load(scene)
    if stiffness:
        model = model.with_(stiffness=stiffness)
    options = c.initialised(c.RunOptions, method=c.method_number(method))
    if script is not None:
        is_text = isinstance(script, str) and "\n" in script
        setattr(options, "script_text" if is_text else "script_file", os.fsencode(script))
    if seed is not None:
        options.seed = int(seed)
        if options.seed != seed or seed < 0:
            raise c.BadInput(f"seed: {seed}\n  give 0 to 2**53")
    if max_force is not None:
        options.max_force_N = max_force
    if rate is not None:
        options.rate_hz = rate
    if recording is not None:
        options.recording = os.fsencode(recording)
    return Run(model, c.made(c.lib.plp_simulate, model._handle, ctypes.byref(options)))


class Recording:
    """A recording of a run, opened by read().

    Attributes:
        hash: as Run.hash; 0 if it is incomplete.
        model_hash: Model.hash of its model.
        ticks, devices, rate: numbers of ticks and devices, and ticks a second.
        data_set, title, script: texts.
        complete: False: the program ended before the run did.
    """

    def __init__(self, handle: int) -> None:
        self._handle = handle
        self._finalizer = weakref.finalize(self, c.lib.plp_recording_destroy, handle)
        info = c.sized(c.RecordingInfo)
        c.check(c.lib.plp_recording_info_get(handle, ctypes.byref(info)))
        self.hash, self.model_hash, self.ticks = int(info.run_hash), int(info.model_hash), int(info.ticks)
        self.devices, self.rate, self.complete = int(info.devices), float(info.rate_hz), bool(info.complete)
        self.data_set, self.title, self.script = (
            (text or b"").decode("utf-8", "replace") for text in (info.data_set, info.title, info.script))

    def records(self, first: int = 0, count: Optional[int] = None, device: int = 0) -> np.ndarray:
        """Ticks of a device, from `first` on; count None: to the end. Fields are the members of plp_record (include/palpate.h).

        Raises:
            BadInput: ticks out of range, or a damaged file.
        """
        if first < 0 or (count is not None and count < 0):
            raise c.BadInput("first or count: negative")
        made = c.records(max(0, self.ticks - first) if count is None else count)
        c.check(c.lib.plp_recording_records(self._handle, device, first, len(made), made.ctypes.data))
        return made

    def frame(self, device: int = 0) -> Any:
        """All ticks of a device as a pandas.DataFrame."""
        return _frame(self.records(device=device))


def read(file: Union[str, "os.PathLike[str]"]) -> Recording:
    """Opens a recording (HDF5). A damaged file is an error, never a crash.

    Raises:
        BadInput: the file is not a recording, or is damaged.
    """
    return Recording(c.made(c.lib.plp_recording_open, os.fsencode(file)))
