"""Scripted trainees: an expert and three kinds of beginner do every task with the simulated hand, and the metrics must
distinguish each kind from the expert by its own weakness and by no other compared metric.

    PALPATE=build/release/apps/palpate/palpate python3 tests/e2e/trainees.py [--seeds 20] [--task NAME] [--markdown]

Exit code 1 where one is not told, or is told by what it should not be.
"""

import argparse
import concurrent.futures
import functools
import gzip
import json
import math
import os
import pathlib
import random
import subprocess
import sys
import tempfile

KINDS = ("heavy", "shaky", "incomplete")
# metric that must distinguish each kind of novice from the expert (AUC >= MIN_AUC); the metrics of the other kinds must
# not
DISTINGUISHED_BY = {"heavy": "excess_impulse", "shaky": "smoothness", "incomplete": "steps_done"}
# at the menisci the limit of 8.5 N is more than the simulated device gives
HEAVY_AT_THE_MENISCI = "peak_force of medial_meniscus, lateral_meniscus"
DISTINGUISHED_BY_TASK = {"meniscus-probing": {"heavy": HEAVY_AT_THE_MENISCI}, "scope-and-probe": {"incomplete": "unseen_time"},
               "bone-to-plan": {"heavy": "depth_past_plan", "incomplete": "removed_in_plan"},
               "cortical-mastoidectomy": {"heavy": "force_near of facial_nerve", "incomplete": "hidden_time"}}
MORE_IS_BETTER = {"smoothness", "steps_done", "economy", "coverage", "force_in_band", "longest_in_band", "removed_in_plan", "bone_left", "burr_distance"}
MIN_AUC = 0.95
# amplitude of tremor at 8 to 12 Hz, mm: what a hand has, and a hand that shakes
STEADY_MM, SHAKY_MM = 0.03, 0.25


def contact(where, force_N, draw, hold_s=0.3, slide=None, then_N=None):
    """Touches, presses, holds, runs along; a heavy hand is brief with that, and then pushes as hard as it likes."""
    heavy = then_N is not None
    steps = [{"approach": where[0], "speed": draw["speed"], **where[1]}, {"press": force_N, "settle": 0.1 if heavy else 0.3},
             {"hold": 0.1 if heavy and hold_s < 1 else hold_s}]
    if slide:
        steps.append({"slide": slide[0], "direction": slide[1], "speed": 11 if heavy else 8})
    if heavy:
        steps.append({"press": then_N, "settle": 0.05})
    return steps + [{"leave": True}]


def meniscus(draw, kind):
    force_N = draw["within"](2.1, 2.6)
    # once: what is pushed with so much makes the simulated motors too warm for more
    parts = [contact((name, {}), force_N, draw, hold_s=0.4, slide=(3, "anterior"), then_N=then_N)
             for name, then_N in (("medial_meniscus", 4.5 if kind == "heavy" else None), ("lateral_meniscus", None))]
    return parts[:1] if kind == "incomplete" else parts


def round_of_seven(draw, kind):
    force_N = draw["within"](0.6, 1.2)
    wheres = [("patella", {"landmark": "superior"}), ("patellar_cartilage", {}), ("femur", {"landmark": "left"}),
              ("femur", {"landmark": "right"}), ("medial_meniscus", {}), ("anterior_cruciate_ligament", {}),
              ("lateral_meniscus", {})]
    if kind == "incomplete":
        wheres = wheres[:draw["random"].randrange(3, 6)]
    return [contact(where, force_N, draw, then_N=4.0 if kind == "heavy" and n < 2 else None) for n, where in enumerate(wheres)]


def hold_steady(draw, kind):
    return [contact(("femoral_cartilage", {}), draw["within"](0.95, 1.05), draw, hold_s=0.8 if kind == "incomplete" else 3.2,
                    then_N=4.0 if kind == "heavy" else None)]


def trace(draw, kind):
    way = None if kind == "incomplete" else (draw["within"](6, 7), "right")
    return [contact(("patella", {"landmark": "superior"}), draw["within"](0.6, 1.0), draw, slide=way,
                    then_N=4.0 if kind == "heavy" else None)]


def nodule(draw, kind):
    force_N = draw["within"](0.4, 0.6)
    search = [contact(("soft_tissue", {"nearest": place, "from": "anterior"}), force_N, draw,
                      then_N=2.4 if kind == "heavy" and n == 0 else None) for n, place in enumerate(draw["places"])]
    if kind == "incomplete":
        return search[:1]
    return search + [contact(("soft_tissue", {"nearest": "nodule", "from": "anterior"}), force_N, draw, hold_s=1.6)]


def softened(draw, kind):
    force_N = draw["within"](0.4, 0.6)
    cartilages = ["femoral_cartilage", "patellar_cartilage", "medial_tibial_cartilage", "lateral_tibial_cartilage"]
    search = [contact((cartilage, {}), force_N, draw, then_N=4.0 if kind == "heavy" and n == 0 else None) for n, cartilage in enumerate(cartilages)]
    return search[:2] if kind == "incomplete" else search + [contact(("lesion", {}), force_N, draw, hold_s=1.6)]


def watched(draw, kind):
    """Three structures, with a scope in the other hand; who forgets it leaves it where it is."""
    force_N = draw["within"](0.7, 1.0)
    wheres = [(("femoral_cartilage", {"landmark": "anterior"}), [0.3, -1, 0]), (("medial_meniscus", {"from": "posterior"}), [-0.3, 1, 0.2]),
              (("lateral_meniscus", {"from": "posterior"}), [0.3, 1, 0.2])]
    parts = []
    for n, (where, side) in enumerate(wheres):
        scope = [{"scope": "probe" if kind != "incomplete" else [0, -90, 60], "from": side, "distance": draw["within"](18, 22), "speed": 60}]
        parts.append((scope if n == 0 or kind != "incomplete" else []) + contact(where, force_N, draw, hold_s=0.6, then_N=4.0 if kind == "heavy" and n == 0 else None))
    return parts


def pocket(draw, kind):
    """A pocket is milled, and the bone above it is felt; a heavy hand goes too deep, and comes to the cartilage below with the motor on.
    Who does half of it takes too little off."""
    heavy = kind == "heavy"
    hold_s = {"heavy": 0.8, "incomplete": 0.4}.get(kind, draw["within"](1.3, 1.6))
    below = [draw["within"](35.2, 35.6), draw["within"](-7.2, -6.8), draw["within"](18.1, 18.5)]
    # what is milled there is soon gone, and the bone beneath it is touched: a step that fails, as a slip does
    then = ([{"approach": "femoral_cartilage", "nearest": below, "from": [1, -0.3, -0.2], "speed": draw["speed"]}, {"motor": True},
             {"press": 1.0, "settle": 0.1}, {"motor": False}] if heavy
            else [{"approach": [37.0, -3.0, 29.0], "speed": draw["speed"]}, {"press": 0.2, "settle": 0.1}])
    return [[{"approach": [37.5, -3.7, 23.6], "speed": draw["speed"]}, {"motor": True}, {"press": 3.0 if heavy else 1.0, "settle": 0.1},
             {"hold": hold_s}, {"motor": False}, {"leave": True}],
            then + [{"leave": True}]]


BURR_MM = 2.5  # radius
SPINE_MM = 11  # the suprameatal spine, to which places are relative, is at x = 11 mm


@functools.lru_cache
def anatomy(data_set):
    """{structure: positions of its voxels, mm from the spine, as LPS}: what a surgeon sees in the scan before an operation."""
    import numpy
    with tempfile.TemporaryDirectory() as folder:
        palpate("data", "fetch", data_set, "-o", folder)
        head, data = next(pathlib.Path(folder).glob("*.seg.nrrd")).read_bytes().split(b"\n\n", 1)
    field = dict(line.replace(":=", ": ").split(": ", 1) for line in head.decode().splitlines() if ": " in line or ":=" in line)
    labels = numpy.frombuffer(gzip.decompress(data) if field["encoding"].startswith("gz") else data,
                              {"unsigned char": "u1", "uint8": "u1", "unsigned short": "<u2", "uint16": "<u2"}[field["type"]])
    labels = labels.reshape([int(size) for size in field["sizes"].split()][::-1])
    origin = numpy.array([float(x) for x in field["space origin"].strip("()").split(",")])
    spacing = numpy.array([max(abs(float(x)) for x in axis.strip("()").split(",")) for axis in field["space directions"].split()])
    names = {int(field[f"Segment{n}_LabelValue"]): field[f"Segment{n}_Name"] for n in range(64) if f"Segment{n}_Name" in field}
    return {name: numpy.argwhere(labels == label)[:, ::-1] * spacing + origin - [SPINE_MM, 0, 0] for label, name in names.items()}


def beside(structure, place, gap_mm):
    """Where the burr's centre is when its head, coming from `place`, is `gap_mm` before a structure."""
    import numpy
    place = numpy.array(place, float)
    away = place - structure
    nearest = away[numpy.linalg.norm(away, axis=1).argmin()]
    return [round(float(x), 3) for x in place - nearest + nearest / numpy.linalg.norm(nearest) * (BURR_MM + gap_mm)]


def mastoid(draw, kind):
    """A cavity is drilled in layers, then the bone over the sinus is thinned, and the nerve is approached gently. A heavy hand presses on towards
    the nerve. Who does not widen the opening drills under its edge, unseen."""
    within, parts = draw["within"], anatomy(draw["data_set"])
    force_N, speed = within(2.0, 2.4), within(12, 15)
    mill = lambda place, force=force_N, fast=speed: {"mill": [round(float(x), 3) for x in (place[0] + SPINE_MM, *place[1:])], "force": force, "speed": fast}
    y, z = 7 + within(-0.4, 0.4), -4 + within(-0.6, 0.6)
    steps = [{"approach": "mastoid_cortex", "nearest": [1 + SPINE_MM, y, z], "from": [1, 0, 0], "speed": draw["speed"]}, {"motor": True}]
    if kind == "incomplete":
        # a keyhole, and from its bottom to all sides
        steps += [mill([x, y, z]) for x in (0, -3, -6.5)]
        steps += [mill([-6.5, y + a, z + b]) for a, b in ((4.5, 0), (0, 0), (0, -7), (0, 0), (1, 5), (0, 0))]
    else:
        behind = min(beside(parts["sigmoid_sinus"], [-3.5, 4, z], 1.5)[1], y + 4)
        for depth, x in enumerate((0.8, -1.4, -3.4)):
            for row, up in enumerate((-4, -0.5, 3)):
                ends = [4 + 0.4 * depth, behind - 0.4 * depth]
                steps += [mill([x, end, z + up * (1 - 0.15 * depth)]) for end in (ends if row % 2 == 0 else ends[::-1])]
        cavity, deep = [-3.4, y, z], [-5.5, 6, -2]
        steps += [mill(cavity), mill(beside(parts["sigmoid_sinus"], cavity, within(1.0, 1.4)), 1.0, 6), mill(cavity), mill(deep)]
        if kind == "heavy":
            steps += [mill(beside(parts["facial_nerve"], deep, within(0.3, 0.7)), 3.0, 15), mill(deep)]
        else:
            steps += [mill(beside(parts["facial_nerve"], deep, within(2.0, 2.4)), within(0.4, 0.55), 5), mill(deep)]
    return [steps + [mill([-3, y, z]), mill([5, y, z], force_N, 30), {"motor": False}, {"leave": True}]]


# task: what is done, most force of the session, N
TASKS = {"meniscus-probing": (meniscus, 9), "diagnostic-round": (round_of_seven, 6), "hold-steady": (hold_steady, 6),
         "trace-an-edge": (trace, 6), "find-the-nodule": (nodule, 4),
         "find-the-softened-cartilage": (softened, 6), "scope-and-probe": (watched, 6), "bone-to-plan": (pocket, 6),
         "cortical-mastoidectomy": (mastoid, 6)}
# what is to be found, or the patient, is drawn each time; otherwise four knees, so that what was prepared is found again
COARSER = {"cortical-mastoidectomy": ",spacing=0.6"}  # which is sooner cut
DRAWN_EACH_TIME = {"find-the-nodule", "find-the-softened-cartilage", "cortical-mastoidectomy"}


def script_text(task, kind, seed, data_set=None):
    """The script by which a trainee of that kind does a task, in a data set where that matters."""
    drawn = random.Random(f"{task} {kind} {seed}")
    draw = {"random": drawn, "data_set": data_set, "speed": round(drawn.uniform(35, 50), 3),
            "places": [[round(side * drawn.uniform(12, 25), 3), -20, round(drawn.uniform(-20, 20), 3)] for side in (-1, 1)],
            "within": lambda low, high: round(drawn.uniform(low, high), 3)}
    lines = ['device = "premium-1.5"', f"tremor = {SHAKY_MM if kind == 'shaky' else STEADY_MM}", f"seed = {drawn.randrange(1, 10**6)}"]
    for part in TASKS[task][0](draw, kind):
        for step in part:
            lines += ["", "[[step]]", *(f"{key} = {json.dumps(value)}" for key, value in step.items())]
    return "\n".join(lines) + "\n"


def palpate(*arguments):
    done = subprocess.run([os.environ["PALPATE"], "-q", *map(str, arguments)], capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False)
    if done.returncode not in (0, 3):
        raise RuntimeError(f"palpate {' '.join(map(str, arguments))}: {done.stderr}")
    return done.stdout


def recording_of(task, kind, seed, folder, data_set):
    """What a trainee did, recorded."""
    name = folder / f"{task}-{kind}-{seed}"
    script, recording = name.with_suffix(".toml"), name.with_suffix(".h5")
    script.write_text(script_text(task, kind, seed, data_set), encoding="utf-8")
    palpate("simulate", data_set, "--script", script, "-o", recording, "--max-force", TASKS[task][1])
    return recording


def scores_of(task, recordings):
    """{metric: value} of each, as palpate task score --json has it."""
    runs = json.loads(palpate("task", "score", *recordings, "--task", task, "--json"))["runs"]
    return [{metric["name"]: metric["value"] for metric in run["metrics"]} for run in runs]


def auc(better, worse, more_is_better):
    """Probability that one of `worse` is worse than one of `better`, ties by half; what has no value is worst."""
    def badness(value):
        return math.inf if value is None else -value if more_is_better else value
    pairs = [(badness(b), badness(w)) for b in better for w in worse]
    return sum(1 if w > b else 0.5 if w == b else 0 for b, w in pairs) / len(pairs)


def aucs_of(task, seeds, folder, workers, data_set=None):
    """{kind: {metric: AUC}} and the values. @param data_set  for every run; else as the seed draws it"""
    jobs = [(kind, seed) for kind in ("expert", *KINDS) for seed in range(seeds)]
    data_sets = [data_set or palpate("task", "draw", task, "--seed", seed if task in DRAWN_EACH_TIME else seed % 4).strip() + COARSER.get(task, "")
                 for seed in range(seeds)]
    found = {}
    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        recordings = dict(zip(jobs, pool.map(lambda job: recording_of(task, *job, folder, data_sets[job[1]]), jobs)))
        # those of one scene together: it is loaded once
        groups = [[job for job in jobs if data_sets[job[1]] == name] for name in dict.fromkeys(data_sets)]
        for group, scores in zip(groups, pool.map(lambda group: scores_of(task, [recordings[job] for job in group]), groups)):
            found.update(zip(group, scores))
    values = {kind: [found[kind, seed] for seed in range(seeds)] for kind in ("expert", *KINDS)}
    metrics = list(values["expert"][0])
    return {kind: {metric: auc([v[metric] for v in values["expert"]], [v[metric] for v in values[kind]], metric in MORE_IS_BETTER)
                   for metric in metrics} for kind in KINDS}, values


def distinguishing_metrics(task):
    return DISTINGUISHED_BY | DISTINGUISHED_BY_TASK.get(task, {})


def faults_of(task, aucs):
    """What is not as it should be, in words."""
    faults = []
    for kind in KINDS:
        for metric in distinguishing_metrics(task).values():
            value, is_distinguishing = aucs[kind][metric], distinguishing_metrics(task)[kind] == metric
            if is_distinguishing != (value >= MIN_AUC):
                faults.append(f"{task}: the {kind} trainee is {'not ' if is_distinguishing else ''}distinguished by {metric}: AUC {value:.3f}")
    return faults


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--task", choices=TASKS, action="append")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--values", action="store_true", help="the mean of every metric, too")
    options = parser.parse_args()
    faults = []
    with tempfile.TemporaryDirectory() as folder:
        os.environ.setdefault("PALPATE_CACHE", folder)
        print("| task | metric | " + " | ".join(KINDS) + " |\n|---|---|" + "---|" * len(KINDS))
        for task in options.task or TASKS:
            aucs, values = aucs_of(task, options.seeds, pathlib.Path(folder), options.workers)
            for metric in aucs[KINDS[0]]:
                cells = [f"**{aucs[kind][metric]:.2f}**" if distinguishing_metrics(task)[kind] == metric else f"{aucs[kind][metric]:.2f}" for kind in KINDS]
                print(f"| {task} | `{metric}` | " + " | ".join(cells) + " |", flush=True)
                if options.values:
                    for kind in ("expert", *KINDS):
                        known = [v[metric] for v in values[kind] if v[metric] is not None]
                        print(f"  {kind}: " + " ".join(f"{v:.4g}" for v in known), file=sys.stderr)
            faults += faults_of(task, aucs)
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
