"""A second implementation of the metrics that docs/reference/metrics.md defines by forces, time and the tip's path, from the columns of a recording
alone. The metrics that need a scene's geometry (coverage, steps, answers, what was removed, what a scope sees) are not here.
"""

import pathlib
import tomllib

import h5py
import numpy

KNOWN = {"time", "idle_time", "path_length", "smoothness", "mean_force", "peak_force", "force_in_band", "longest_in_band", "excess_impulse", "protected_time"}
# in a run that was scored live and from the recording the filter's steps are solved exactly; here by Runge and Kutta
RELATIVE = 2e-5


class Run:
    """The ticks of a run. @param ticks  first and last, or None: all of the recording"""

    def __init__(self, recording, ticks=None):
        with h5py.File(recording) as file:
            number = file["ticks/tick"][:]
            of_run = slice(None) if ticks is None else slice(*numpy.searchsorted(number, [ticks[0], ticks[1] + 1]))
            column = lambda name: file[name][of_run]  # noqa: E731
            self.time_s = column("ticks/time_s")
            self.tip_mm = column("device0/tip_patient_mm")
            label, part, force_N = (column(f"device0/contact_{name}") for name in ("label", "part", "N"))
            place_mm = column("device0/contact_patient_mm").reshape(len(label), -1, 3)
            normal = column("device0/normal_patient")
            sent_N = numpy.linalg.norm(column("device0/force_N"), axis=1)
            gain = column("device0/force_gain")
            self.label_of = {name.decode(): int(value) for name, value in zip(file["structures/name"][:], file["structures/label"][:])}
        is_contact = numpy.cumprod(label != 0, axis=1).astype(bool) & (force_N > 0)
        at_device_N = numpy.where(is_contact, force_N, 0) * gain[:, None]
        # all contacts together are no more than what was sent
        most = numpy.minimum(1, sent_N / numpy.maximum(at_device_N.sum(axis=1), 1e-300))
        self.force_N = at_device_N * most[:, None]
        self.label = numpy.where(self.force_N > 0, label, 0)
        # what the outermost contact rests on: within 45 degrees below it, of the same part of the tool
        way = place_mm - place_mm[:, :1]
        below_mm = -(way * normal[:, None]).sum(axis=2)
        self.is_beneath = (part == part[:, :1]) & (below_mm > 0.1) & (below_mm > numpy.sqrt(0.5) * numpy.linalg.norm(way, axis=2))
        self.is_beneath[:, 0] = False

    def on(self, structures):
        """Force on structures in each tick, N. @param structures  names or labels; empty: all"""
        if not structures:
            return self.force_N.sum(axis=1)
        of_set = numpy.isin(self.label, [one if isinstance(one, int) else self.label_of.get(one, -1) for one in structures]) & (self.label != 0)
        return (self.force_N * (of_set | (self.is_beneath & of_set[:, :1]))).sum(axis=1)


def fraction_above(force_N, threshold_N):
    """Fraction of each interval between ticks in which the force, a straight line, is above."""
    a, b = force_N[:-1], force_N[1:]
    low, high = numpy.minimum(a, b), numpy.maximum(a, b)
    return numpy.where(low > threshold_N, 1.0, numpy.where(high <= threshold_N, 0.0, (high - threshold_N) / numpy.maximum(high - low, 1e-300)))


def excess_Ns(force_N, dt_s, limit_N):
    return float((0.5 * (numpy.maximum(0, force_N[:-1] - limit_N) + numpy.maximum(0, force_N[1:] - limit_N)) * fraction_above(force_N, limit_N) * dt_s).sum())


def longest_s(force_N, dt_s, band_N):
    """An interval that ends outside the band ends the stretch."""
    inside_s = dt_s * (fraction_above(force_N, band_N[0]) - fraction_above(force_N, band_N[1]))
    longest = stretch = 0.0
    for now_N, part_s in zip(force_N[1:], inside_s):
        stretch = stretch + part_s if band_N[0] <= now_N <= band_N[1] else 0.0
        longest = max(longest, stretch)
    return longest


def low_passed(time_s, tip_mm):
    """Position and speed after a Butterworth filter of second order at 10 Hz, at each tick; position every 0.01 s from the first one."""
    omega = 2 * numpy.pi * 10

    def rate(x, v, u):
        return v, omega * omega * (u - x) - numpy.sqrt(2) * omega * v

    def advanced(x, v, u0, u1, h):
        middle = (u0 + u1) / 2
        a = rate(x, v, u0)
        b = rate(x + h / 2 * a[0], v + h / 2 * a[1], middle)
        c = rate(x + h / 2 * b[0], v + h / 2 * b[1], middle)
        d = rate(x + h * c[0], v + h * c[1], u1)
        return x + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0]), v + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])

    x, v = tip_mm[0].copy(), numpy.zeros(3)
    places, speeds, grid = [x], [0.0], [x]
    for n in range(1, len(time_s)):
        begin_s, dt_s = time_s[n - 1], time_s[n] - time_s[n - 1]
        while (at_s := time_s[0] + 0.01 * len(grid)) <= time_s[n]:
            part = (at_s - begin_s) / dt_s
            grid.append(advanced(x, v, tip_mm[n - 1], tip_mm[n - 1] + part * (tip_mm[n] - tip_mm[n - 1]), at_s - begin_s)[0])
        x, v = advanced(x, v, tip_mm[n - 1], tip_mm[n], dt_s)
        places.append(x)
        speeds.append(float(numpy.linalg.norm(v)))
    return numpy.array(places), numpy.array(speeds), numpy.array(grid)


def smoothness(grid):
    """Of the path from 0.3 s on, when the filter has settled."""
    step_s, settled_s = 0.01, 0.3
    first = int(round(settled_s / step_s))
    jerk = (numpy.diff(grid, 3, axis=0) / step_s**3)[first:]
    length_s = len(grid) * step_s - settled_s - 3 * step_s
    speed = numpy.linalg.norm(numpy.diff(grid, axis=0), axis=1)[first + 1:-1] / step_s
    if length_s < 0.5 or not speed.max(initial=0) > 0:
        return None
    return float(-numpy.log(length_s**3 / speed.max() ** 2 * (jerk**2).sum() * step_s))


def scores(recording, task, ticks=None):
    """{metric's name: value, None if there is none} of what is KNOWN. @param task  a task's file"""
    task = tomllib.loads(pathlib.Path(task).read_text(encoding="utf-8"))
    run = Run(recording, ticks)
    dt_s = numpy.diff(run.time_s)
    places, speeds, grid = low_passed(run.time_s, run.tip_mm)
    forces = [(run.on(force.get("structures")), force) for force in task.get("force", [])]
    protections = [(run.on(one["structures"]), one.get("limit", 0.2)) for one in task.get("protected", [])]

    def contact_s(force_N):
        return float(dt_s[(force_N[1:] > 0) | (force_N[:-1] > 0)].sum())

    def value_of(name, structures):
        if name == "time":
            return float(run.time_s[-1] - run.time_s[0])
        if name == "path_length":
            return float(numpy.linalg.norm(numpy.diff(places, axis=0), axis=1).sum())
        if name == "smoothness":
            return smoothness(grid)
        if name == "idle_time":
            free = ~(run.label != 0).any(axis=1)
            return float(dt_s[free[1:] & free[:-1] & (speeds[1:] < 5)].sum())
        if name in ("mean_force", "peak_force"):
            on_N = run.on(structures)
            if not on_N.max(initial=0) > 0:
                return None
            return float(on_N.max()) if name == "peak_force" else float((0.5 * (on_N[1:] + on_N[:-1]) * dt_s).sum()) / contact_s(on_N)
        banded = [(on_N, force["band"]) for on_N, force in forces if "band" in force]
        if name == "force_in_band":
            whole_s = sum(contact_s(on_N) for on_N, _ in banded)
            inside_s = sum(float((dt_s * (fraction_above(on_N, low) - fraction_above(on_N, high))).sum()) for on_N, (low, high) in banded)
            return inside_s / whole_s if whole_s > 0 else None
        if name == "longest_in_band":
            return max((longest_s(on_N, dt_s, band) for on_N, band in banded), default=0.0)
        if name == "excess_impulse":
            return sum(excess_Ns(on_N, dt_s, force["limit"]) for on_N, force in forces if "limit" in force)
        return sum(float((dt_s * fraction_above(on_N, limit_N)).sum()) for on_N, limit_N in protections)

    found = {}
    for metric in task["metric"]:
        if metric["name"] in KNOWN:
            of = metric.get("structures", [])
            found[metric["name"] + (" of " + ", ".join(map(str, of)) if of else "")] = value_of(metric["name"], of)
    return found


def faults(recomputed, stated):
    """What differs, in words. @param stated  {metric's name: value}, of palpate"""
    said = []
    for name, value in recomputed.items():
        other = stated[name]
        # what sums crossings of a threshold is as exact as the forces' digits
        if (value is None) != (other is None) or (value is not None and abs(value - other) > RELATIVE * abs(value) + 1e-7):
            said.append(f"{name}: {value}, and palpate says {other}")
    return said


def peak_above_limit(recording, ticks=None):
    """By how much the greatest force on all structures exceeds the greatest limit of the run, N; below 0: by nothing."""
    with h5py.File(recording) as file:
        limit_N = float(file["device0/limit_N"][:].max())
    return float(Run(recording, ticks).on([]).max()) - limit_N

