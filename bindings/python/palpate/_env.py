"""Environments for robot learning: a tool in contact with patients, by the conventions of Gymnasium and robomimic, without
depending on either."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import json
import math
import os
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple, Union

import numpy as np

from . import _library as c
from ._model import Model, load
from ._session import Session

Observation = Dict[str, np.ndarray]
# maps the observation of one environment to (reward, terminated)
Reward = Callable[[Observation], Tuple[Any, Any]]


@dataclasses.dataclass(frozen=True)
class Box:
    """Range of an array: of an action, or of an entry of an observation.

    Attributes:
        low, high: bounds of each element.
        shape: shape of the array, without the environment axis.
        dtype: type of its elements.
    """

    low: float
    high: float
    shape: Tuple[int, ...]
    dtype: Any = np.float64

    def contains(self, value: Any) -> bool:
        """Whether an array of this shape lies within the bounds."""
        array = np.asarray(value)
        return array.shape == self.shape and bool(np.all((array >= self.low) & (array <= self.high)))


def _slerp(start: np.ndarray, end: np.ndarray, fractions: np.ndarray) -> np.ndarray:
    """Interpolates between two unit quaternions at n fractions, shape (n, 4)."""
    cosine = float(start @ end)
    if cosine < 0:
        end, cosine = -end, -cosine
    angle = math.acos(min(cosine, 1.0))
    if angle < 1e-6:
        mixed = (1 - fractions)[:, None] * start + fractions[:, None] * end
    else:
        mixed = np.sin((1 - fractions) * angle)[:, None] * start + np.sin(fractions * angle)[:, None] * end
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)


def _up(model: Model) -> np.ndarray:
    """Unit vector upwards, World's +z, in the patient."""
    return model.world_patient[:3, :3].T @ np.array([0.0, 0.0, 1.0])


def _above(model: Model, clearance: float) -> np.ndarray:
    """Point above the middle of the volume, at a distance from the outermost contact surface, mm."""
    up = _up(model)
    middle = model.points((np.array(model.shape) - 1) / 2)
    reach = float(np.linalg.norm(model.spacing * model.shape)) / 2
    heights = np.arange(reach, -reach, -0.25)
    distances, _ = model.sample(middle + heights[:, None] * up, "proxy")
    below = np.flatnonzero(distances < clearance)
    if not below.size:
        raise c.BadInput("start: there is no contact surface below the middle of the volume\n  give the start in the patient, mm")
    return middle + (heights[below[0]] + 0.25) * up


class _SingleEnv:
    """One environment: a session, and the pose of the tool in it."""

    def __init__(self, model: Model, names: List[str], settings: "dict[str, Any]") -> None:
        self.model, self.session = model, Session(model, **settings)
        self.to_patient = model.world_patient[:3, :3].T
        index = {name: n for n, name in enumerate(names)}
        self.index_of_label = {s.label: index[s.name] for s in model.structures if s.name in index}
        self.names = names
        self.rng = np.random.default_rng()
        self.tip, self.velocity = np.zeros(3), np.zeros(3)
        self.orientation = np.array([1.0, 0, 0, 0])
        self.steps, self.is_over = 0, True

    def place(self, tip: np.ndarray, settle: int, dt: float) -> np.void:
        """Begins an episode: the tool rests at a pose, until the force has ramped in."""
        self.session.reset()
        self.tip, self.velocity, self.orientation = tip.copy(), np.zeros(3), np.array([1.0, 0, 0, 0])
        self.steps, self.is_over = 0, False
        return self.session.run(np.broadcast_to(tip, (settle, 3)), dt=dt)[-1]

    def move(self, target: np.ndarray, orientation: np.ndarray, ticks: int, dt: float) -> np.ndarray:
        """Moves the tool to a pose at constant velocity."""
        fractions = np.arange(1, ticks + 1) / ticks
        tips = self.tip + fractions[:, None] * (target - self.tip)
        records = self.session.run(tips, _slerp(self.orientation, orientation, fractions), dt)
        self.tip, self.orientation = target.copy(), orientation.copy()
        return records

    def push(self, force: np.ndarray, ticks: int, dt: float, mass: float, damping: float) -> np.ndarray:
        """Moves the tool under a force on a hand of this mass, kg, and damping, N s/m, against the contact force."""
        for _ in range(ticks):
            contact, _ = self.session.tick(self.tip, self.orientation, dt)
            # N/kg is m/s²; velocities are mm/s
            self.velocity += dt * 1e3 * (force + contact - 1e-3 * damping * self.velocity) / mass
            self.tip = self.tip + dt * self.velocity
        return np.array([self.session.record()])

    def observe(self, record: np.void, patch: int, patch_mm: float) -> Observation:
        by_structure = np.zeros(len(self.names))
        for label, force in zip(record["contact_label"], record["contact_N"]):
            if label in self.index_of_label:
                by_structure[self.index_of_label[label]] += force
        observation = {"tip": np.array(record["tip_patient_mm"]), "orientation": self.orientation.copy(),
                "velocity": np.array(record["velocity_patient_mm_s"]),
                "force": self.to_patient @ record["force_world_N"], "torque": self.to_patient @ record["torque_world_Nmm"],
                "force_by_structure": by_structure, "indentation": record["tip_patient_mm"] - record["proxy_patient_mm"]}
        if patch:
            observation["section"] = self.model.section_labels("axial", record["tip_patient_mm"], size=patch_mm, pixels=patch)
        return observation


class Env:
    """A rigid tool in contact with patients, with Gymnasium's reset() and step(): exact contact forces, deterministic.

    A step holds an action for 1 / control_rate and ticks at `rate` within it, without Python between the ticks where the action
    is a pose. Positions, orientations and forces are in the patient (LPS), mm, N and N mm.

    Observation, a dict of arrays:
        tip (3,), orientation (4,) w x y z, velocity (3,) mm/s; force (3,) and torque (3,) about the tip on the hand;
        force_by_structure (structures,): normal force with each of `structures`, N; indentation (3,): vector from the
        proxy to the tip, mm; with `patch`, section (patch, patch): labels around the tip, axial.

    Args:
        scenes: a model, or what load() takes, or a sequence of them: environment n uses scene n modulo the number of scenes.
        envs: number of environments; None: a single one, whose arrays have no environment axis.
        action: "pose": the tip's target, mm, and its orientation, w x y z, shape (7,). "wrench": force on the hand, N, shape (3,),
            which moves the tool against its contact (`hand_mass`, kg; `hand_damping`, N s/m).
        reward: observation of one environment to (reward, terminated); None: reward 0, never terminated.
        start: tip at the beginning of an episode, mm, shape (3,), or a function of a numpy Generator and the Model that returns
            it; None: `clearance` mm above the middle.
        randomise: function of a Generator and the Model that returns the model of the next episode, such as
            `lambda rng, model: model.with_(stiffness={"nodule": rng.uniform(1, 2)})`; None: the model.
        control_rate, rate: steps and ticks a second; their ratio is an integer.
        seconds: duration of an episode, after which it is truncated.
        patch, patch_mm: pixels and width of the section around the tip; 0: none.
        threads: number of environments stepped in parallel. Results do not depend on it.
        settings: settings of Session, such as max_force.

    Attributes:
        structures: names, in the order of force_by_structure: those of the first scene.
        up: unit vector upwards in the patient of the first scene, shape (3,).
        action_space, observation_space: Box of an action, and of each entry of an observation, of one environment.

    Raises:
        BadInput, Usage: arguments that cannot be used.
    """

    metadata: Dict[str, Any] = {"render_modes": []}

    def __init__(self, scenes: Any, *, envs: Optional[int] = None, action: str = "pose", reward: Optional[Reward] = None,
                 start: Any = None, randomise: Optional[Callable[[np.random.Generator, Model], Model]] = None,
                 control_rate: float = 50, rate: float = 1000, seconds: float = 10, clearance: float = 3,
                 hand_mass: float = 0.1, hand_damping: float = 5, patch: int = 0, patch_mm: float = 20, threads: int = 1,
                 **settings: Any) -> None:
        if action not in ("pose", "wrench"):
            raise c.BadInput(f"action: {action!r}\n  give 'pose' or 'wrench'")
        ticks = rate / control_rate if control_rate > 0 else math.nan
        if not (ticks >= 1 and ticks == int(ticks)):
            raise c.BadInput(f"control_rate: {control_rate} with a rate of {rate}\n  give rates whose ratio is an integer")
        if envs is not None and envs < 1 or not seconds > 0 or threads < 1 or not hand_mass > 0 or hand_damping < 0:
            raise c.BadInput("envs, seconds, threads, hand_mass or hand_damping: out of range\n  give positive numbers")
        several = isinstance(scenes, (list, tuple))
        self._models = [scene if isinstance(scene, Model) else load(scene) for scene in (scenes if several else [scenes])]
        if not self._models:
            raise c.BadInput("scenes: empty\n  give at least one scene")
        self.structures = [s.name for s in self._models[0].structures]
        self.up = _up(self._models[0])
        self.num_envs = 1 if envs is None else int(envs)
        self._has_axis = envs is not None
        self._single_envs = [_SingleEnv(self._models[n % len(self._models)], self.structures, settings) for n in range(self.num_envs)]
        self._action, self._reward, self._start, self._randomise = action, reward, start, randomise
        self._ticks, self._dt, self._settings = int(ticks), 1 / rate, settings
        self._steps = max(1, round(seconds * control_rate))
        self._clearance, self._mass, self._damping = clearance, hand_mass, hand_damping
        self._patch, self._patch_mm = int(patch), patch_mm
        self._settle = max(1, round(0.6 * rate))
        self._pool = concurrent.futures.ThreadPoolExecutor(threads) if threads > 1 else None
        self.action_space = Box(-math.inf, math.inf, (7,) if action == "pose" else (3,))
        shapes = {"tip": 3, "orientation": 4, "velocity": 3, "force": 3, "torque": 3, "force_by_structure": len(self.structures),
                  "indentation": 3}
        self.observation_space = {name: Box(-math.inf, math.inf, (size,)) for name, size in shapes.items()}
        if self._patch:
            self.observation_space["section"] = Box(0, 65535, (self._patch, self._patch), np.uint16)

    # ---- Gymnasium's

    def reset(self, *, seed: Optional[int] = None, options: Optional[Dict[str, Any]] = None) -> Tuple[Observation, Dict[str, Any]]:
        """Begins an episode in every environment.

        Args:
            seed: equal seeds give equal episodes; environment n draws from (seed, n). None: the generators continue.
            options: "tip": position of this episode, mm, shape (3,), instead of `start`.

        Returns:
            (observation, info).
        """
        if seed is not None:
            for n, env in enumerate(self._single_envs):
                env.rng = np.random.default_rng([int(seed), n])
        tip = (options or {}).get("tip")
        return self._stacked(self._each(lambda n: self._begin(self._single_envs[n], tip))), {}

    def step(self, action: Any) -> Tuple[Observation, Any, Any, Any, Dict[str, Any]]:
        """Applies an action for one control step.

        Args:
            action: array of shape action_space.shape; with `envs`, one such row per environment. An environment whose
                episode has ended starts a new episode and ignores the action.

        Returns:
            (observation, reward, terminated, truncated, info); info has "max_force", the largest force within the step, N, and
            "begun", whether an episode has begun instead.

        Raises:
            BadInput: an action of another shape or that is not finite. Usage: before reset().
        """
        shape = self.action_space.shape
        try:
            actions = np.asarray(action, float).reshape((self.num_envs, *shape))
        except ValueError as error:
            raise c.BadInput(f"action: an array of shape {np.shape(action)}\n  give {shape} for each environment") from error
        if not np.isfinite(actions).all() or (self._action == "pose" and not (np.linalg.norm(actions[:, 3:], axis=1) > 0.5).all()):
            raise c.BadInput("action: not finite, or a quaternion that is not of unit length")
        if any(env.is_over and env.steps == 0 for env in self._single_envs):
            raise c.Usage("step: there is no episode\n  call reset() first")
        results = self._each(lambda n: self._advance(self._single_envs[n], actions[n]))
        observation = self._stacked([result[0] for result in results])
        columns = [np.array(column) for column in zip(*(result[1:] for result in results))]
        if not self._has_axis:
            columns = [column[0].item() for column in columns]
        reward, terminated, truncated, max_force, begun = columns
        return observation, reward, terminated, truncated, {"max_force": max_force, "begun": begun}

    def close(self) -> None:
        """Stops the worker threads."""
        if self._pool is not None:
            self._pool.shutdown()

    # ---- one environment

    def _each(self, work: Callable[[int], Any]) -> List[Any]:
        numbers = range(self.num_envs)
        return list(self._pool.map(work, numbers)) if self._pool is not None else [work(n) for n in numbers]

    def _stacked(self, observation: Sequence[Observation]) -> Observation:
        return {name: np.stack([one[name] for one in observation]) for name in observation[0]} if self._has_axis else observation[0]

    def _begin(self, env: _SingleEnv, tip: Any) -> Observation:
        if self._randomise is not None:
            number = self._single_envs.index(env)
            model = self._randomise(env.rng, self._models[number % len(self._models)])
            fresh = _SingleEnv(model, self.structures, self._settings)
            env.model, env.session, env.index_of_label = fresh.model, fresh.session, fresh.index_of_label
        if tip is None:
            tip = self._start(env.rng, env.model) if callable(self._start) else self._start
        at = _above(env.model, self._clearance) if tip is None else np.array(tip, float)
        if at.shape != (3,) or not np.isfinite(at).all():
            raise c.BadInput("start: not a position\n  give 3 finite coordinates in mm")
        return env.observe(env.place(at, self._settle, self._dt), self._patch, self._patch_mm)

    def _advance(self, env: _SingleEnv, action: np.ndarray) -> Tuple[Observation, float, bool, bool, float, bool]:
        if env.is_over:
            return self._begin(env, None), 0.0, False, False, 0.0, True
        if self._action == "pose":
            orientation = action[3:] / np.linalg.norm(action[3:])
            records = env.move(action[:3], orientation, self._ticks, self._dt)
        else:
            records = env.push(action, self._ticks, self._dt, self._mass, self._damping)
        env.steps += 1
        observation = env.observe(records[-1], self._patch, self._patch_mm)
        reward, terminated = self._reward(observation) if self._reward is not None else (0.0, False)
        truncated = not terminated and env.steps >= self._steps
        env.is_over = bool(terminated or truncated)
        return observation, float(reward), bool(terminated), truncated, float(np.linalg.norm(records["force_world_N"], axis=1).max()), False


class Episodes:
    """Writes the episodes of an environment in robomimic's HDF5 layout: a wrapper used in place of the environment. Needs h5py.

    The file has /data with a group demo_0, demo_1, ... for each episode that has ended: actions, rewards, dones, obs/NAME and
    next_obs/NAME, each with an entry for each step, and the attribute num_samples; /data has `total` and `env_args`.

    Args:
        env: an Env.
        file: HDF5 file to create.

    Raises:
        Unavailable: h5py is missing. OutputError: the file cannot be created.
    """

    def __init__(self, env: Env, file: Union[str, "os.PathLike[str]"]) -> None:
        try:
            import h5py  # pylint: disable=import-outside-toplevel
        except ImportError as error:
            raise c.Unavailable("Episodes: needs h5py\n  install python3-h5py, or pip install palpate[episodes]") from error
        self.env = env
        try:
            self._file = h5py.File(os.fspath(file), "w")
        except OSError as error:
            raise c.OutputError(f"{os.fspath(file)}: {error}") from error
        self._data = self._file.create_group("data")
        self._data.attrs["total"] = 0
        self._data.attrs["env_args"] = json.dumps({"env_name": "palpate.Env", "type": 2, "env_kwargs": {
            "structures": env.structures, "action": env._action, "seconds_per_step": env._ticks * env._dt}})
        self._open: List[List[Tuple[Any, ...]]] = [[] for _ in range(env.num_envs)]
        self._before: Optional[Observation] = None
        self.count = 0

    def __enter__(self) -> "Episodes":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def reset(self, **options: Any) -> Tuple[Observation, Dict[str, Any]]:
        """As Env.reset(). Episodes that have not ended are not written."""
        observation, info = self.env.reset(**options)
        self._open = [[] for _ in range(self.env.num_envs)]
        self._before = observation
        return observation, info

    def step(self, action: Any) -> Tuple[Observation, Any, Any, Any, Dict[str, Any]]:
        """As Env.step()."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        axis = self.env._has_axis
        before = self._before or {}
        actions = np.asarray(action, float).reshape(self.env.num_envs, -1)
        for n in range(self.env.num_envs):
            def of(values: Any, number: int = n) -> Any:
                return values[number] if axis else values

            if of(info["begun"]):
                continue
            is_over = bool(of(terminated)) or bool(of(truncated))
            self._open[n].append((actions[n], of(reward), is_over, {k: of(v) for k, v in before.items()},
                                  {k: of(v) for k, v in observation.items()}))
            if is_over:
                self._write(self._open[n])
                self._open[n] = []
        self._before = observation
        return observation, reward, terminated, truncated, info

    def _write(self, steps: List[Tuple[Any, ...]]) -> None:
        demo = self._data.create_group(f"demo_{self.count}")
        self.count += 1
        actions, rewards, dones, before, after = zip(*steps)
        demo.attrs["num_samples"] = len(steps)
        self._data.attrs["total"] += len(steps)
        demo["actions"], demo["rewards"], demo["dones"] = np.stack(actions), np.array(rewards), np.array(dones, np.uint8)
        for group, observation in (("obs", before), ("next_obs", after)):
            for name in observation[0]:
                demo[f"{group}/{name}"] = np.stack([one[name] for one in observation])
        self._file.flush()

    def close(self) -> None:
        """Closes the file; episodes that have not ended are not in it."""
        self._file.close()
