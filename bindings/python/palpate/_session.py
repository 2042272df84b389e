"""Sessions, ticked by the caller, and loops, ticked by their own thread."""

from __future__ import annotations

import ctypes
import weakref
from typing import Any, Optional, Tuple

import numpy as np

from . import _library as c
from ._model import Model

_FRAMES = {"world": 0, "patient": 1}


def _options(frame: str, method: Optional[str], settings: "dict[str, Any]") -> Any:
    if frame not in _FRAMES:
        raise c.BadInput(f"frame: {frame!r}\n  give 'patient' or 'world'")
    names = {"devices": "devices", "friction": "friction", "viscosity": "viscosity", "passivity": "passivity",
             "solve_soft_tissue": "solve_soft_tissue", "max_force": "max_force_N", "max_torque": "max_torque_Nmm",
             "max_stiffness": "max_stiffness_N_per_mm", "continuous_force": "continuous_force_N",
             "position_step": "position_step_mm", "slew": "slew_N_per_s"}
    unknown = set(settings) - set(names)
    if unknown:
        raise TypeError(f"unknown settings: {', '.join(sorted(unknown))}; known are {', '.join(names)}")
    return c.initialised(c.SessionOptions, frame=_FRAMES[frame], method=c.method_number(method),
                         **{names[name]: value for name, value in settings.items()})


class Session:
    """Devices in contact with a model, ticked by the caller. Equal inputs give equal forces, bit for bit.

    Args:
        model: model in contact.
        frame: frame of tips, orientations and forces: "patient" (LPS) or "world".
        method: force method that the model is prepared for; None: the model's.
        settings: devices=1, friction=True, viscosity=True, passivity=True, solve_soft_tissue=False, max_force=3 (N),
            max_torque=0 (N mm, 0: none), max_stiffness=inf (N/mm), continuous_force (N), position_step (mm), slew=2000 (N/s).

    Raises:
        BadInput, Usage: settings that cannot be used.
    """

    def __init__(self, model: Model, *, frame: str = "patient", method: Optional[str] = None, **settings: Any) -> None:
        options = _options(frame, method, settings)
        self._handle = c.made(c.lib.plp_session_create, model._handle, ctypes.byref(options))
        self._finalizer = weakref.finalize(self, c.lib.plp_session_destroy, self._handle)
        self._model = model
        self._devices = int(options.devices)
        # the buffers of every tick
        self._poses = self._empty_poses(1)
        self._wrenches = np.zeros(self._devices, c.WRENCH)
        self._wrenches["size"] = c.WRENCH.itemsize
        self._tips, self._orientations = self._poses["tip_mm"][0], self._poses["orientation_wxyz"][0]
        self._pose_address, self._wrench_address = c.address(self._poses), c.address(self._wrenches)

    @property
    def tip(self) -> np.ndarray:
        """Tip of the next advance(), mm, in the session's frame; shape (3,), with several devices (devices, 3). A view of the
        session's buffer, to write into; tick() writes its argument there."""
        return self._single(self._tips)

    @property
    def orientation(self) -> np.ndarray:
        """Orientation of the next advance(), unit quaternion w, x, y, z; shape (4,) or (devices, 4). A view as `tip` is."""
        return self._single(self._orientations)

    @property
    def force(self) -> np.ndarray:
        """Force of the last tick on the hand, N, in the session's frame; shape of `tip`. A view of the session's buffer, which the
        next tick overwrites."""
        return self._single(self._wrenches["force_N"])

    @property
    def torque(self) -> np.ndarray:
        """Torque of the last tick about the tip, N mm; a view as `force` is."""
        return self._single(self._wrenches["torque_Nmm"])

    def _single(self, each: np.ndarray) -> np.ndarray:
        return each[0] if self._devices == 1 else each

    def advance(self, dt: float = 1e-3) -> None:
        """One tick from `tip` and `orientation` to `force` and `torque`: tick() without copies, for a controller that keeps the
        four views.

        Args:
            dt: duration since the last tick, s.

        Raises:
            BadInput: a duration that is negative or not finite. Then the session has not changed.
        """
        status = c.lib.plp_session_tick(self._handle, self._pose_address, dt, self._wrench_address)
        if status:
            c.check(status)

    def _empty_poses(self, ticks: int) -> np.ndarray:
        poses = np.zeros((ticks, self._devices), c.POSE)
        poses["size"] = c.POSE.itemsize
        poses["orientation_wxyz"][..., 0] = 1
        return poses

    @property
    def model(self) -> Model:
        """The model of the next tick. Set it to a later version (Model.with_, Model.cut): the force blends over."""
        return self._model

    @model.setter
    def model(self, model: Model) -> None:
        c.check(c.lib.plp_session_set_model(self._handle, model._handle))
        self._model = model

    def tick(self, tip: Any, orientation: Any = None, dt: float = 1e-3) -> Tuple[np.ndarray, np.ndarray]:
        """Advances by one tick.

        Args:
            tip: mm, in the session's frame; shape (3,), with several devices (devices, 3).
            orientation: unit quaternion w, x, y, z from the tool's axes to the frame's; shape (4,) or (devices, 4). None: the
                identity.
            dt: duration since the last tick, s.

        Returns:
            (force, torque) on the hand, N and N mm about the tip, of the shape of `tip`.

        Raises:
            BadInput: a duration that is negative or not finite. Then nothing has changed.
        """
        self._tips[:] = tip
        self._orientations[:] = (1, 0, 0, 0) if orientation is None else orientation
        self.advance(dt)
        return self.force.copy(), self.torque.copy()

    def run(self, tips: Any, orientations: Any = None, dt: float = 1e-3) -> np.ndarray:
        """Advances by many ticks of equal duration in one native call.

        Args:
            tips: shape (n, 3), with several devices (n, devices, 3).
            orientations: shape (n, 4) or (n, devices, 4), or one orientation for all ticks. None: the identity.

        Returns:
            Structured array of shape (n,), or (n, devices), whose fields are the members of plp_record (include/palpate.h).
        """
        at = np.asarray(tips, float).reshape(-1, self._devices, 3)
        poses = self._empty_poses(len(at))
        poses["tip_mm"] = at
        if orientations is not None:
            turned = np.asarray(orientations, float)
            each = turned.size == 4 * self._devices * len(at)
            poses["orientation_wxyz"] = turned.reshape((-1 if each else 1, self._devices, 4))
        records = c.records(len(at) * self._devices)
        c.check(c.lib.plp_session_run(self._handle, poses.ctypes.data, len(at), dt, None, records.ctypes.data))
        return records if self._devices == 1 else records.reshape(len(at), self._devices)

    def record(self, device: int = 0) -> np.void:
        """Record of the last tick. Raises Usage before the first tick."""
        records = c.records(1)
        c.check(c.lib.plp_session_record(self._handle, device, records.ctypes.data))
        return records[0]

    def reset(self) -> None:
        """Resets the session: time 0, no contact; the model stays."""
        c.check(c.lib.plp_session_reset(self._handle))

    @property
    def hash(self) -> int:
        """64-bit hash over all ticks since creation or reset: equal for equal runs in every language binding."""
        ticks, run_hash = ctypes.c_uint64(), ctypes.c_uint64()
        c.check(c.lib.plp_session_hash(self._handle, ctypes.byref(ticks), ctypes.byref(run_hash)))
        return run_hash.value


class Loop:
    """Servo loop on its own thread. Python posts poses and reads the latest tick; the servo never waits for Python.

    Args:
        model: model in contact.
        frame: frame of the poses: "patient" (LPS) or "world".
        method: as for Session.
        rate: ticks a second, 250 ... 10000.
        realtime: request real-time scheduling and locked memory; if refused, it ticks without them.
        settings: settings of Session, for a single device.

    The loop stops at the end of a `with` block, on stop(), or when the object is destroyed.
    """

    def __init__(self, model: Model, *, frame: str = "patient", method: Optional[str] = None, rate: float = 1000,
                 realtime: bool = False, **settings: Any) -> None:
        session = _options(frame, method, settings)
        options = c.initialised(c.LoopOptions, realtime=realtime, rate_hz=rate, session=ctypes.addressof(session))
        self._handle = c.made(c.lib.plp_loop_start, model._handle, ctypes.byref(options))
        self._finalizer = weakref.finalize(self, c.lib.plp_loop_destroy, self._handle)
        self._model = model
        self._pose = c.initialised(c.Pose)

    def __enter__(self) -> "Loop":
        return self

    def __exit__(self, *_: Any) -> None:
        self.stop()

    @property
    def model(self) -> Model:
        """The model of the next tick. Set it to a later version (Model.with_, Model.cut): the force blends over."""
        return self._model

    @model.setter
    def model(self, model: Model) -> None:
        c.check(c.lib.plp_loop_set_model(self._handle, model._handle))
        self._model = model

    def post(self, tip: Any, orientation: Any = (1, 0, 0, 0), buttons: int = 0) -> None:
        """Sets the target pose: tip in mm, shape (3,), and unit quaternion w, x, y, z. The loop interpolates between poses; a
        pose expires after 0.1 s.

        Raises:
            BadInput: a pose that is not finite.
        """
        self._pose.tip_mm[:] = [float(x) for x in tip]
        self._pose.orientation_wxyz[:] = [float(x) for x in orientation]
        self._pose.buttons = buttons
        c.check(c.lib.plp_loop_post(self._handle, ctypes.byref(self._pose)))

    def snapshot(self) -> np.void:
        """The latest tick, with the members of plp_record (include/palpate.h) as fields."""
        records = c.records(1)
        c.check(c.lib.plp_loop_snapshot(self._handle, records.ctypes.data))
        return records[0]

    def health(self) -> "dict[str, float]":
        """Loop statistics: running, ticks, skipped, rate_hz, on_time (0 ... 1), lateness_p99_us and compute_p99_us."""
        health = c.sized(c.LoopHealth)
        c.check(c.lib.plp_loop_health_get(self._handle, ctypes.byref(health)))
        return {name: getattr(health, name) for name, *_ in health._fields_ if name != "size"}

    def emergency_stop(self) -> None:
        """Switches the force off permanently from the next tick on."""
        c.check(c.lib.plp_loop_emergency_stop(self._handle))

    def stop(self) -> None:
        """Fades the force out and ends the thread."""
        c.check(c.lib.plp_loop_stop(self._handle))
