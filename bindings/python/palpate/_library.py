"""ctypes binding of libpalpate.so: lookup, struct types generated from its own descriptions, and exceptions for its errors."""

from __future__ import annotations

import ctypes
import os
import pathlib
import threading
from typing import Any, Dict, Tuple, Type

import numpy as np

LIBRARY = "libpalpate.so.1"


class Error(Exception):
    """A call that palpate refused. The text states the fault, its place and the remedy."""


class BadInput(Error, ValueError):
    """Invalid argument, file or setting."""


class Usage(Error, ValueError):
    """Inconsistent settings."""


class OutputError(Error, OSError):
    """A file could not be written."""


class Unavailable(Error, LookupError):
    """A data set, a library or a thread is not available."""


class OutOfMemory(Error, MemoryError):
    """Memory ran out; nothing was changed."""


class Internal(Error, RuntimeError):
    """Internal error of palpate."""


_ERRORS: Dict[int, Type[Error]] = {1: BadInput, 2: Usage, 3: OutputError, 4: Unavailable, 6: OutOfMemory, 7: Internal}


def _find() -> str:
    """Path of the library: PALPATE_LIBRARY, within a wheel, in the lib folder above it, else as the linker finds it."""
    if "PALPATE_LIBRARY" in os.environ:
        return os.environ["PALPATE_LIBRARY"]
    here = pathlib.Path(__file__).resolve().parent
    for folder in (here / "lib", *here.parents[1:4]):
        if (folder / LIBRARY).is_file():
            return str(folder / LIBRARY)
    return LIBRARY


def _load() -> ctypes.CDLL:
    try:
        return ctypes.CDLL(_find())
    except OSError as error:
        raise ImportError(f"{error}: install palpate's C library, or name it in PALPATE_LIBRARY") from error


lib = _load()

# ---- structs, as the library describes them

_C_TYPES = (ctypes.c_uint8, ctypes.c_int8, ctypes.c_uint16, ctypes.c_int16, ctypes.c_uint32, ctypes.c_int32, ctypes.c_uint64,
            ctypes.c_int64, ctypes.c_double, ctypes.c_char_p, ctypes.c_void_p)


class _Field(ctypes.Structure):
    _fields_ = [("size", ctypes.c_uint32), ("type", ctypes.c_int32), ("name", ctypes.c_char_p), ("offset", ctypes.c_uint32),
                ("count", ctypes.c_uint32)]


lib.plp_struct_field.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.POINTER(_Field)]
lib.plp_struct_size.argtypes = [ctypes.c_char_p]
lib.plp_struct_size.restype = ctypes.c_size_t


def _fields(name: str) -> Any:
    """(name, ctypes type, offset) of the members of a struct."""
    index = 0
    field = _Field(size=ctypes.sizeof(_Field))
    while lib.plp_struct_field(name.encode(), index, ctypes.byref(field)) == 0:
        kind = _C_TYPES[field.type]
        yield field.name.decode(), kind * field.count if field.count > 1 else kind, field.offset
        index += 1


def _struct(name: str) -> Type[ctypes.Structure]:
    members = list(_fields(name))
    made = type(name, (ctypes.Structure,), {"_fields_": [(member, kind) for member, kind, _ in members]})
    assert ctypes.sizeof(made) == lib.plp_struct_size(name.encode())
    assert all(getattr(made, member).offset == offset for member, _, offset in members)
    return made


def _dtype(name: str) -> np.dtype:
    return np.dtype(_struct(name))


Labels, Tissue, Structure, Tool = (_struct(name) for name in ("plp_labels", "plp_tissue", "plp_structure", "plp_tool"))
Section, Camera = _struct("plp_section"), _struct("plp_camera")
ModelOptions, ModelInfo, Cut = (_struct(name) for name in ("plp_model_options", "plp_model_info", "plp_cut"))
Pose, Wrench, SessionOptions = (_struct(name) for name in ("plp_pose", "plp_wrench", "plp_session_options"))
RunOptions, RunInfo = _struct("plp_run_options"), _struct("plp_run_info")
LoopOptions, LoopHealth, RecordingInfo = (_struct(name) for name in ("plp_loop_options", "plp_loop_health", "plp_recording_info"))
POSE, WRENCH, RECORD = _dtype("plp_pose"), _dtype("plp_wrench"), _dtype("plp_record")


def initialised(struct: Type[ctypes.Structure], **values: Any) -> Any:
    """A struct with the library's defaults, and these values."""
    made = struct()
    check(getattr(lib, struct.__name__ + "_init")(ctypes.byref(made), ctypes.c_size_t(ctypes.sizeof(struct))))
    for name, value in values.items():
        setattr(made, name, value)
    return made


def sized(struct: Type[ctypes.Structure]) -> Any:
    """An empty struct for the library to fill."""
    return struct(size=ctypes.sizeof(struct))


def records(count: int) -> np.ndarray:
    """Zeroed records for this number of ticks, with their size set."""
    made = np.zeros(count, RECORD)
    made["size"] = RECORD.itemsize
    return made


# ---- functions

_HANDLE, _OUT = ctypes.c_void_p, ctypes.POINTER(ctypes.c_void_p)
_SIZE, _TEXT, _ANY, _U64 = ctypes.c_size_t, ctypes.c_char_p, ctypes.c_void_p, ctypes.c_uint64
_ARGUMENTS: Dict[str, Tuple[Any, ...]] = {
    "plp_model_create": (_ANY, _ANY, _SIZE, _ANY, _SIZE, _ANY, _SIZE, _ANY, _OUT),
    "plp_model_load": (_TEXT, _TEXT, _ANY, _OUT),
    "plp_model_change": (_HANDLE, _SIZE, _ANY, _OUT),
    "plp_model_cut": (_HANDLE, _ANY, _SIZE, _OUT),
    "plp_model_info_get": (_HANDLE, _ANY),
    "plp_model_tissue": (_HANDLE, _SIZE, _ANY),
    "plp_model_structure": (_HANDLE, _SIZE, _ANY),
    "plp_model_sample": (_HANDLE, ctypes.c_int32, _ANY, _SIZE, _ANY, _ANY),
    "plp_model_labels": (_HANDLE, _ANY, _SIZE),
    "plp_model_scan": (_HANDLE, ctypes.POINTER(_ANY), ctypes.POINTER(_SIZE)),
    "plp_model_section": (_HANDLE, _ANY, _ANY, _SIZE),
    "plp_model_section_labels": (_HANDLE, _ANY, _ANY, _SIZE),
    "plp_model_picture": (_HANDLE, _ANY, _ANY, _SIZE, _ANY),
    "plp_session_create": (_HANDLE, _ANY, _OUT),
    "plp_session_tick": (_HANDLE, _ANY, ctypes.c_double, _ANY),
    "plp_session_run": (_HANDLE, _ANY, _SIZE, ctypes.c_double, _ANY, _ANY),
    "plp_session_record": (_HANDLE, _SIZE, _ANY),
    "plp_session_reset": (_HANDLE,),
    "plp_session_set_model": (_HANDLE, _HANDLE),
    "plp_session_hash": (_HANDLE, ctypes.POINTER(_U64), ctypes.POINTER(_U64)),
    "plp_simulate": (_HANDLE, _ANY, _OUT),
    "plp_run_info_get": (_HANDLE, _ANY),
    "plp_run_records": (_HANDLE, _SIZE, _U64, _SIZE, _ANY),
    "plp_loop_start": (_HANDLE, _ANY, _OUT),
    "plp_loop_post": (_HANDLE, _ANY),
    "plp_loop_snapshot": (_HANDLE, _ANY),
    "plp_loop_set_model": (_HANDLE, _HANDLE),
    "plp_loop_emergency_stop": (_HANDLE,),
    "plp_loop_health_get": (_HANDLE, _ANY),
    "plp_loop_stop": (_HANDLE,),
    "plp_recording_open": (_TEXT, _OUT),
    "plp_recording_info_get": (_HANDLE, _ANY),
    "plp_recording_records": (_HANDLE, _SIZE, _U64, _SIZE, _ANY),
}
for _name, _types in _ARGUMENTS.items():
    getattr(lib, _name).argtypes = _types
for _name in ("model", "session", "run", "loop", "recording"):
    getattr(lib, f"plp_{_name}_destroy").argtypes = (_HANDLE,)
    getattr(lib, f"plp_{_name}_destroy").restype = None
lib.plp_run_trouble.argtypes = (_HANDLE, _SIZE)
lib.plp_set_cancel_flag.argtypes = (ctypes.POINTER(ctypes.c_uint8),)
lib.plp_set_cancel_flag.restype = None
# destroy function for the handle that each function creates
_DESTROYER = {"plp_model_create": "plp_model_destroy", "plp_model_load": "plp_model_destroy", "plp_model_change": "plp_model_destroy",
              "plp_model_cut": "plp_model_destroy", "plp_simulate": "plp_run_destroy", "plp_session_create": "plp_session_destroy",
              "plp_loop_start": "plp_loop_destroy", "plp_recording_open": "plp_recording_destroy"}
for _name in ("plp_run_trouble", "plp_last_error", "plp_version"):
    getattr(lib, _name).restype = ctypes.c_char_p


def check(status: int) -> None:
    """Raises the error of a call that failed."""
    if status:
        raise _ERRORS.get(status, Error)(lib.plp_last_error().decode("utf-8", "replace"))


def made(call: Any, *arguments: Any) -> int:
    """Returns the handle created by a possibly long call; Ctrl-C in the main thread cancels it."""
    handle = ctypes.c_void_p()
    arguments = (*arguments, ctypes.byref(handle))
    if threading.current_thread() is not threading.main_thread():
        check(call(*arguments))
        return int(handle.value or 0)
    # Python handles signals between its own instructions alone: this thread waits for another one, which calls
    flag, results, is_done = ctypes.c_uint8(0), [], threading.Event()

    def work() -> None:
        lib.plp_set_cancel_flag(ctypes.byref(flag))
        results.append((call(*arguments), lib.plp_last_error()))
        is_done.set()

    threading.Thread(target=work).start()
    interruption = None
    while not is_done.is_set():
        try:
            is_done.wait()
        except KeyboardInterrupt as error:
            flag.value, interruption = 1, error
    status, reason = results[0]
    if interruption is not None:
        # a handle created despite the cancellation would leak
        if status == 0:
            getattr(lib, _DESTROYER[call.__name__])(handle)
        raise interruption
    if status:
        raise _ERRORS.get(status, Error)(reason.decode("utf-8", "replace"))
    return int(handle.value or 0)


def address(array: np.ndarray) -> int:
    """Address of an array's first element."""
    return int(array.ctypes.data)


# ---- force methods, by their names in scenes and on the command line

METHODS = {"trilinear": 0, "b-spline": 1, "gaussian-sphere": 2, "smooth-sphere": 3, "stored-normals": 4, "proxy": 5}


def method_number(method: "str | None") -> int:
    """Number of a method; -1 for None."""
    if method is None:
        return -1
    if method not in METHODS:
        raise BadInput(f"method: there is no method {method!r}\n  give one of {', '.join(METHODS)}")
    return METHODS[method]


def method_name(number: int) -> str:
    """Name of a method."""
    return next(name for name, value in METHODS.items() if value == number)
