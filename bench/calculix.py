"""Computes the compliance of soft tissue in five cases with CalculiX and compares bench's `tissue_truth` with it.

usage: calculix.py TISSUE_TRUTH FOLDER

TISSUE_TRUTH is that program (bench/README.md); decks and results go to FOLDER. CalculiX is `ccx`, of Debian's
calculix-ccx, which nothing of palpate needs otherwise.

Each case is a body on a plate, 48 x 48 mm, free at its sides, under a round patch of pressure p ~ sqrt(1 - r2 / rho2)
of 1 N in its middle. Told is W, the mean displacement under the patch weighted by its pressure, mm for 1 N. CalculiX
has hexahedra of 20 nodes (C3D20R), small under the patch, and a half or a quarter of what is symmetric.
"""

import json
import os
import shutil
import subprocess
import sys

import numpy as np

HALF_MM = 24.0
SAMPLES = 24  # of a face along each edge, by which the pressure is integrated

# all lines within elements: 0.5 mm under the patch, more beyond; every seam of the cases is one of them
ACROSS_MM = np.concatenate([np.arange(0, 6.01, 0.5), [7, 8.5, 10.5, 13, 16, 19.5, HALF_MM]])
DOWN_MM = np.concatenate([np.arange(0, 2.01, 0.5), [3, 4, 5], np.arange(6, 13.01), [15, 17.5, 20.5, 24]])
SHALLOW_MM = np.arange(0, 8.01, 0.5)


class Case:
    """A body given by its modulus as a function of position (x, y, z in mm; kPa; None: rigid); its surface is z = 0,
    the body is below."""

    def __init__(self, name, modulus, nu=0.45, rho=3.0, down=DOWN_MM, whole_x=False):
        self.name, self.modulus, self.nu, self.rho, self.down = name, modulus, nu, rho, down
        self.x = np.concatenate([-ACROSS_MM[:0:-1], ACROSS_MM]) if whole_x else ACROSS_MM
        self.share = 2 if whole_x else 4


def nodule(x, y, z):
    return 100 if abs(x) < 4 and abs(y) < 4 and -13 < z < -5 else 10


CASES = [
    Case("layer", lambda x, y, z: 10),
    Case("nodule", nodule),
    Case("skin", lambda x, y, z: 100 if z > -2 else 10),
    Case("hard-edge", lambda x, y, z: None if x > 1 and z < -5 else 10, whole_x=True),
    Case("thin-layer", lambda x, y, z: 10, nu=0.49, rho=4.0, down=SHALLOW_MM),
]

# of a hexahedron of 20 nodes, in half edges: CalculiX's order
CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
EDGES = [(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2),
         (0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)]


def halved(lines):
    """Lines of corners, with one in the middle between each two."""
    every = np.empty(2 * len(lines) - 1)
    every[::2] = lines
    every[1::2] = 0.5 * (lines[1:] + lines[:-1])
    return every


def face_functions(s, t):
    """Shape functions of a face of 8 nodes at (s, t) in 0 ... 2, by (i, j) in half edges."""
    a, b = s - 1, t - 1
    found = {}
    for i in (0, 2):
        for j in (0, 2):
            found[i, j] = 0.25 * (1 + (i - 1) * a) * (1 + (j - 1) * b) * ((i - 1) * a + (j - 1) * b - 1)
    for i in (0, 2):
        found[i, 1] = 0.5 * (1 + (i - 1) * a) * (1 - b * b)
        found[1, i] = 0.5 * (1 - a * a) * (1 + (i - 1) * b)
    return found


class Mesh:
    """Hexahedra between lines, a node where an element needs it."""

    def __init__(self, case):
        self.case = case
        self.x, self.y, self.z = halved(case.x), halved(ACROSS_MM), halved(-case.down[::-1])
        self.number, self.elements, self.rigid = {}, {}, []
        for k in range(0, len(self.z) - 2, 2):
            for j in range(0, len(self.y) - 2, 2):
                for i in range(0, len(self.x) - 2, 2):
                    kpa = case.modulus(self.x[i + 1], self.y[j + 1], self.z[k + 1])
                    places = [(i + a, j + b, k + c) for a, b, c in CORNERS + EDGES]
                    if kpa is None:
                        self.rigid += places
                    else:
                        nodes = [self.number.setdefault(p, len(self.number) + 1) for p in places]
                        self.elements.setdefault(kpa, []).append(nodes)

    def loads(self):
        """{node: force} of 1 N of the patch, or of the part of it that is there."""
        rho, top = self.case.rho, len(self.z) - 1
        forces = {}
        steps = 2 * (np.arange(SAMPLES) + 0.5) / SAMPLES
        for j in range(0, len(self.y) - 2, 2):
            for i in range(0, len(self.x) - 2, 2):
                wide, long = self.x[i + 2] - self.x[i], self.y[j + 2] - self.y[j]
                for s in steps:
                    for t in steps:
                        r2 = (self.x[i] + 0.5 * s * wide) ** 2 + (self.y[j] + 0.5 * t * long) ** 2
                        if r2 >= rho * rho:
                            continue
                        pressure = 1.5 / (np.pi * rho * rho) * np.sqrt(1 - r2 / (rho * rho))
                        share = pressure * wide * long / SAMPLES**2
                        for (a, b), value in face_functions(s, t).items():
                            node = self.number[i + a, j + b, top]
                            forces[node] = forces.get(node, 0.0) + share * value
        # what sampling leaves out of 1 N
        off = 1 / self.case.share / sum(forces.values())
        return {node: force * off for node, force in forces.items()}

    def deck(self, forces):
        lines = [f"** {self.case.name}: mm, N, N/mm2", "*NODE, NSET=ALL"]
        places = {number: place for place, number in self.number.items()}
        for number in range(1, len(places) + 1):
            i, j, k = places[number]
            lines.append(f"{number}, {self.x[i]:.6g}, {self.y[j]:.6g}, {self.z[k]:.6g}")
        count = 0
        for kpa, elements in self.elements.items():
            lines.append(f"*ELEMENT, TYPE=C3D20R, ELSET=E{kpa}")
            for nodes in elements:
                count += 1
                lines.append(f"{count}, " + ", ".join(map(str, nodes[:10])) + ",")
                lines.append(", ".join(map(str, nodes[10:])))
            lines += [f"*MATERIAL, NAME=M{kpa}", "*ELASTIC", f"{1e-3 * kpa:.6g}, {self.case.nu}",
                      f"*SOLID SECTION, ELSET=E{kpa}, MATERIAL=M{kpa}"]
        lines.append("*BOUNDARY")
        held = set(self.rigid)
        for place, number in self.number.items():
            i, j, k = place
            if k == 0 or place in held:
                lines.append(f"{number}, 1, 3")
                continue
            if self.x[i] == 0 and self.case.share == 4:
                lines.append(f"{number}, 1, 1")
            if self.y[j] == 0:
                lines.append(f"{number}, 2, 2")
        lines += ["*NSET, NSET=PRESSED"] + [f"{node}," for node in sorted(forces)]
        lines += ["*STEP", "*STATIC", "*CLOAD"]
        lines += [f"{node}, 3, {-force:.9g}" for node, force in sorted(forces.items())]
        lines += ["*NODE PRINT, NSET=PRESSED", "U", "*END STEP", ""]
        return "\n".join(lines)


def compliance(case, folder):
    """W of CalculiX, mm/N."""
    mesh = Mesh(case)
    forces = mesh.loads()
    with open(os.path.join(folder, case.name + ".inp"), "w", encoding="ascii") as deck:
        deck.write(mesh.deck(forces))
    ran = subprocess.run(["ccx", "-i", case.name], cwd=folder, capture_output=True, text=True, check=False)
    if ran.returncode != 0:
        sys.exit(f"{case.name}: ccx has not solved it\n{ran.stdout[-2000:]}")
    sunk, seen = 0.0, 0
    with open(os.path.join(folder, case.name + ".dat"), encoding="ascii") as results:
        for line in results:
            words = line.split()
            if len(words) == 4 and words[0].isdigit():
                sunk -= forces[int(words[0])] * float(words[3])
                seen += 1
    if seen != len(forces):
        sys.exit(f"{case.name}: ccx has told of {seen} nodes of {len(forces)}")
    return sunk * case.share


def main(truth, folder):
    if shutil.which("ccx") is None:
        sys.exit("ccx is not installed: apt install calculix-ccx")
    if shutil.which(truth) is None:
        sys.exit(f"{truth}: no such program; the preset bench builds tissue_truth")
    os.makedirs(folder, exist_ok=True)
    ours = json.loads(subprocess.run([truth], capture_output=True, text=True, check=True).stdout)
    print(f"{'case':12} {'CalculiX':>9}" + "".join(f" {'cells ' + h + ' mm':>13} {'off':>7}" for h in ours))
    for case in CASES:
        theirs = compliance(case, folder)
        row = f"{case.name:12} {theirs:9.3f}"
        for values in ours.values():
            row += f" {values[case.name]:13.3f} {100 * (values[case.name] / theirs - 1):+6.2f}%"
        print(row, flush=True)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(os.path.abspath(sys.argv[1]), sys.argv[2])
