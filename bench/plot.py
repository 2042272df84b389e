#!/usr/bin/python3
"""Draws what the programs of bench/ measured: bench/plot.py [FOLDER] [--out FOLDER]

Reads the JSON files in FOLDER (out/bench), which `tools/bench` writes, and puts the pictures beside them or
into another folder. A picture whose figures are missing is left out. Needs Matplotlib.
"""
import argparse
import json
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.patches import Patch

# ours, plain code, other libraries; the second shade is for what is further from the caches, or stored apart
OURS, PLAIN, OTHERS = ("#1f5fa8", "#9cc3ec"), ("#5b5b5b", "#bdbdbd"), ("#b45f06", "#f0c28e")
THREE = ("#b45f06", "#7a7a7a", "#1f5fa8")
INK, GRID = "#222222", "#dddddd"

plt.rcParams.update(
    {
        "font.size": 9,
        "text.color": INK,
        "axes.edgecolor": "#999999",
        "axes.labelcolor": INK,
        "axes.titlesize": 10,
        "axes.titlelocation": "left",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "xtick.color": INK,
        "ytick.color": INK,
        "legend.frameon": False,
        "figure.dpi": 130,
    }
)


def shades_of(name):
    if name.startswith("palpate"):
        return OURS
    return OTHERS if name.split()[0] in ("ITK", "VTK", "OpenVDB", "NanoVDB") else PLAIN


def number(x):
    return f"{x:.0f}" if x >= 100 or x == int(x) else f"{x:.1f}" if x >= 2 else f"{x:.2f}"


def bars(axes, rows, series, unit, log=True, text_of=number):
    """One group of bars a row, the first on top; series: (values, colours, hatch), None where a row has none."""
    height = 0.8 / len(series)
    biggest = max(v for values, _, _ in series for v in values if v)
    for s, (values, colours, hatch) in enumerate(series):
        for r, value in enumerate(values):
            if value is None:
                continue
            y = r + (s - (len(series) - 1) / 2) * height
            axes.barh(y, value, 0.92 * height, color=colours[r], hatch=hatch, edgecolor="white", linewidth=0)
            axes.text(value * 1.04 if log else value + 0.01 * biggest, y, text_of(value), va="center", fontsize=7)
    axes.set_yticks(range(len(rows)), rows)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    if log:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
        # bars of a logarithm begin where they must: half the shortest one
        axes.set_xlim(0.5 * min(v for values, _, _ in series for v in values if v), 1.5 * biggest)
    else:
        axes.set_xlim(0, 1.15 * biggest)
    axes.set_xlabel(unit)
    axes.xaxis.grid(True, color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)


def legend_above(axes, handles):
    axes.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0, 1),
        ncols=len(handles),
        borderaxespad=0.1,
        columnspacing=1.2,
        handlelength=1.4,
        fontsize=8,
    )


def draw_sampling(figures):
    tables = figures["tables"]
    sizes = [len(table["rows"]) for table in tables]
    figure, panels = plt.subplots(
        len(tables), 1, figsize=(8, 0.33 * sum(sizes) + 2.2), height_ratios=sizes, layout="constrained", squeeze=False
    )
    for axes, table in zip(panels[:, 0], tables):
        rows = table["rows"]
        names = [row["name"] for row in rows]
        column = lambda key: [row["ns"].get(key) for row in rows]
        # whoever takes many points at once has no latency of its own
        together = lambda key, other: [row["ns"][key] if other not in row["ns"] else None for row in rows]
        dark, light = ([shades_of(name)[shade] for name in names] for shade in (0, 1))
        single = [
            [a if a is not None else b for a, b in zip(column(lat), together(thr, lat))]
            for lat, thr in (("probe LAT", "probe THR"), ("random LAT", "random THR"))
        ]
        bars(axes, names, [(single[0], dark, None), (single[1], light, None)], "ns a query")
        axes.set_title(table["title"], pad=26 if axes is panels[0, 0] else None)
    legend_above(
        panels[0, 0],
        [
            Patch(color=OURS[0], label="palpate"),
            Patch(color=PLAIN[0], label="plain code"),
            Patch(color=OTHERS[0], label="other libraries"),
            Patch(color=PLAIN[1], label="pale: anywhere; full: along a surface"),
        ],
    )
    figure.supxlabel(
        f"Each query waits for the last; “many points”: a batch, per point. {figures['simd_target']} unless named;"
        f" medians of {figures['rounds']} rounds.",
        fontsize=8,
    )
    return figure


def draw_label_methods(figures):
    # a mask and a set of two runs of labels are in the table
    rows = [row for row in figures["rows"] if not row["name"].endswith((", mask", "runs"))]
    names = [row["name"].removesuffix(", labels") for row in rows]
    colours = lambda colour: [colour] * len(rows)
    figure, axes = plt.subplots(figsize=(8, 0.62 * len(rows) + 1.2), layout="constrained")
    bars(
        axes,
        names,
        [
            ([row["literal_latency_ns"] for row in rows], colours(PLAIN[0]), None),
            ([row["surface_latency_ns"] for row in rows], colours(OURS[0]), None),
            ([row["surface_batch_ns"] for row in rows], colours(OURS[1]), None),
        ],
        "ns a query",
    )
    axes.legend(
        handles=[
            Patch(color=PLAIN[0], label="literal form"),
            Patch(color=OURS[0], label="palpate, one point after the other"),
            Patch(color=OURS[1], label="palpate, many points"),
        ],
        loc="lower right",
    )
    axes.set_title(f"Methods on raw labels and stored normals, along a surface; {figures['simd_target']}")
    return figure


def draw_memory(figures):
    rows = figures["memory"]
    names = [row["name"] for row in rows]
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(8.6, 0.42 * len(rows) + 1.3), sharey=True, width_ratios=(1, 2.2), layout="constrained"
    )
    bytes_per_voxel = [row["bytes_per_voxel"] for row in rows]
    bars(left, names, [(bytes_per_voxel, [PLAIN[0]] * len(rows), None)], "bytes a voxel", False)
    bars(
        right,
        names,
        [
            ([row["MB"] for row in rows], [OURS[0]] * len(rows), None),
            ([row["occupied_MB"] for row in rows], [OURS[1]] * len(rows), None),
        ],
        "MB (10⁶ bytes)",
        False,
    )
    for r, row in enumerate(rows):
        right.text(
            1, r, f"{row['occupied_voxels'] / 1e6:.2f} M occupied", transform=right.get_yaxis_transform(), ha="right",
            va="center", fontsize=7, color="#666666"
        )
    legend_above(
        right,
        [
            Patch(color=OURS[0], label="every voxel, as kept"),
            Patch(color=OURS[1], label="occupied voxels alone"),
        ],
    )
    left.set_title(f"{figures['voxels'] / 1e6:.1f} M voxels")
    right.set_xlim(0, 1.5 * max(row["MB"] for row in rows))
    return figure


def draw_stored_normals(figures):
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.9), width_ratios=(1.5, 1), layout="constrained")
    true_tilts = figures["true_tilt_degrees"]
    encodings = figures["encodings"]
    left.plot(true_tilts, true_tilts, color="#bbbbbb", linewidth=4, solid_capstyle="round", label="true")
    for encoding, colour, style in zip(encodings, THREE, ("-", "--", "-")):
        stored_tilts = encoding["stored_tilt_degrees"]
        left.plot(true_tilts, stored_tilts, style, color=colour, linewidth=1.4, label=encoding["name"])
    left.set_xlabel("true tilt of the surface from an axis, degrees")
    left.set_ylabel("tilt of the stored normal, degrees")
    left.set_aspect("equal")
    left.grid(color=GRID, linewidth=0.6)
    left.legend(loc="upper left")
    left.set_title("Curves nearly parallel to an axis turn into facets")

    bars(
        right,
        [e["name"] if e["name"].endswith("bytes") else f"{e['name']}\n({e['normal_bytes']} bytes)" for e in encodings],
        [
            ([e["mean_degrees"] for e in encodings], THREE, None),
            ([e["p99_degrees"] for e in encodings], ["#8a8a8a"] * 3, None),
            ([e["max_degrees"] for e in encodings], ["#c9c9c9"] * 3, None),
        ],
        "error over all directions, degrees",
        False,
        lambda degrees: f"{degrees:.3f}",
    )
    right.set_title("mean, 99th percentile, maximum")
    return figure


def draw_servo(figures):
    volumes, pace = figures["volumes"], figures["pace"]
    shades = ("#9cc3ec", "#5a93cf", "#16447a")
    rows = [f"{row['rate_hz'] / 1000:g} kHz" for row in pace] + ["without a clock"]
    series = []
    for v in range(len(volumes)):
        times = [row["volumes"][v]["compute"]["p50_us"] for row in pace]
        times.append(figures["free_running"][v]["update_ns"] / 1e3)
        series.append((times, [shades[v % 3]] * len(rows), None))
    figure, axes = plt.subplots(figsize=(8, 0.55 * len(rows) + 1.6), layout="constrained")
    bars(axes, rows, series, "µs from samples in to commands out, median", False)
    legend_above(
        axes,
        [
            Patch(
                color=shades[v % 3],
                label=f"{volume['voxels'] / 1e6:.0f} M voxels: {volume['field_lines_in_1000_ticks']:.0f} +"
                f" {volume['label_lines_in_1000_ticks']:.0f} lines",
            )
            for v, volume in enumerate(volumes)
        ],
    )
    axes.set_title(
        "A tick on three sizes of one volume, and the cache lines that 1000 ticks read, field + labels", pad=26
    )
    return figure


PICTURES = {
    "bench-sampling": ("sampling_bench", draw_sampling),
    "bench-label-methods": ("label_methods_bench", draw_label_methods),
    "bench-memory": ("label_methods_bench", draw_memory),
    "bench-servo": ("servo_bench", draw_servo),
    "stored-normals": ("stored_normals_curve", draw_stored_normals),
}


def main():
    parser = argparse.ArgumentParser(description="Draws what the programs of bench/ measured.")
    parser.add_argument("folder", nargs="?", type=Path, default=Path("out/bench"), help="where the JSON files are")
    parser.add_argument("--out", type=Path, help="where the pictures go; default: beside the JSON files")
    options = parser.parse_args()
    out = options.out or options.folder
    drawn = 0
    for picture, (program, draw) in PICTURES.items():
        file = options.folder / f"{program}.json"
        if not file.exists():
            continue
        draw(json.loads(file.read_text())).savefig(out / f"{picture}.png")
        drawn += 1
    if drawn == 0:
        sys.exit(f"plot.py: no figures of the comparisons in {options.folder}")


main()
