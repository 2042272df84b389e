"""Touch a segmented scan from Python: forces on a tool, computed from voxels.

    import palpate as pp
    scene = pp.load("knee-phantom:spacing=2")
    depth, force = pp.simulate(scene, seed=1).press("patella")

Lengths are mm, forces N, torques N mm, times s. Positions are in the patient (LPS) unless a frame says otherwise. A call
that fails raises an Error with the fault and the remedy, and changes nothing. Needs NumPy and libpalpate.so.
"""

from ._library import (METHODS, BadInput, Error, Internal, OutOfMemory, OutputError, Unavailable, Usage, lib as _lib)
from ._env import Box, Env, Episodes
from ._model import Model, Structure, Tissue, Tool, load
from ._run import Recording, Run, read, simulate
from ._session import Loop, Session
from ._verify import verify

__version__: str = _lib.plp_version().decode()

__all__ = ["METHODS", "BadInput", "Box", "Env", "Episodes", "Error", "Internal", "Loop", "Model", "OutOfMemory", "OutputError", "Recording", "Run", "Session",
           "Structure", "Tissue", "Tool", "Unavailable", "Usage", "load", "read", "simulate", "verify"]
