"""A scan and its segmentation, named in either order: every verb takes them alike, and refuses the same alike."""

import json
import math
import re
import struct

import cli
import dicom_files
from canary_files import dicom_with_canary
from volume_files import ball, grid, write_nrrd

N = 32
SIZES = (N, N, N)
RADIUS = 9
SCRIPT = ('[[step]]\napproach = "femur"\nspeed = 200.0\n[[step]]\npress = 0.4\nsettle = 0.1\n[[step]]\nhold = 0.1\n'
          '[[step]]\nleave = true\n')


def noise(n, inside):
    return (900 if inside else 30) + (n * 7919 >> 3) % 61


def circle(radius, x=N / 2, y=N / 2):
    return [(x + radius * math.cos(a), y + radius * math.sin(a)) for a in (n * 2 * math.pi / 40 for n in range(40))]


class TwoFiles(cli.PalpateTest):
    def setUp(self):
        super().setUp()
        labelled = ball(SIZES, RADIUS)
        values = [noise(n, inside) for n, inside in enumerate(labelled)]
        self.scan = write_nrrd(self.folder / "scan.nrrd", SIZES, [v - 40 for v in values], "int16", "h")
        self.other_scan = write_nrrd(self.folder / "repeat.nrrd", SIZES, [v - 50 for v in values], "int16", "h")
        self.labels = write_nrrd(self.folder / "labels.nrrd", SIZES, labelled)
        self.other_labels = write_nrrd(self.folder / "again.nrrd", SIZES, [2 * v for v in labelled])
        self.elsewhere = write_nrrd(self.folder / "elsewhere.nrrd", SIZES, labelled, geometry=grid(origin=(900, 0, 0)))
        self.names, self.wrong_names = self.folder / "names.csv", self.folder / "wrong.csv"
        self.names.write_text("value,name\n1,femur\n")
        self.wrong_names.write_text("value,name\n77,femur\n")
        self.script = self.folder / "script.toml"
        self.script.write_text(SCRIPT)
        self.study = self.folder / "STUDY"
        self.study.mkdir()
        for k in range(N):
            dicom_with_canary(self.study / f"IM{k}", N, k, struct.pack(f"<{N * N}H", *values[k * N * N:(k + 1) * N * N]))
        self.structures = self.folder / "structures.dcm"
        outlines = [(k, circle(math.sqrt(RADIUS ** 2 - (k - N / 2) ** 2))) for k in range(N // 2 - 8, N // 2 + 9)]
        structures = [("femur", outlines), ("lesion", [(k, circle(4, 6, 6)) for k in range(4, 9)])]
        dicom_files.write_structure_set(self.structures, structures, "1.2.3.19570411.1")
        self.out = self.folder / "out"
        self.out.mkdir()

    # ---- one line a verb: what it writes of two files, which does not depend on their order

    def written(self, verb, code, *files_and_options):
        """Runs a verb on files. @return what is to be the same in any order where it succeeds, else its message"""
        files = list(files_and_options)
        page, field = self.out / "x.png", self.out / "x.nrrd"
        if verb == "cohort":
            return self.written_by_cohort(code, *files)
        command, result = {
            "simulate": (["simulate", *files, "--script", self.script], lambda done: cli.run_hash(done.stdout)),
            "explore": (["explore", *files, "--script", self.script, "--no-viewer", "--no-supervisor"],
                        lambda done: re.findall("femur", done.stdout)[:1]),
            "section": (["section", *files, "-o", page, "--pixels", "320"], lambda done: page.read_bytes()),
            "render": (["render", *files, "-o", page, "--pixels", "320"], lambda done: page.read_bytes()),
            "prepare": (["prepare", *files, "-o", field], lambda done: field.read_bytes()),
            "export": (["export", *files, "-o", self.out / "x.seg.nrrd"], lambda done: (self.out / "x.seg.nrrd").read_bytes()),
            "forces": (["forces", *files, "-o", self.out / "x.svg"], lambda done: (self.out / "x.svg").read_bytes()),
            "hold": (["hold", *files, "--at", "16,16,6", "--json"], lambda done: done.stdout),
            "scene new": (["scene", "new", *files], lambda done: done.stdout),
        }[verb]
        if code != cli.OK:
            done = self.expect_error(code, *command)
            self.assertEqual(list(self.out.iterdir()), [], "nothing half-written")
            return done.stderr[done.stderr.index("palpate: error:"):]
        found = result(self.succeed(*command))
        for file in self.out.iterdir():
            file.unlink()
        return found

    def written_by_cohort(self, code, study, segmentation, *options):
        table, results = self.folder / "cases.tsv", self.folder / "results"
        names = options[options.index("--names") + 1] if options else ""
        table.write_text(f"study\tsegmentation\tnames\tscript\n{study}\t{segmentation}\t{names}\t{self.script}\n")
        done = cli.run("cohort", table, "-o", results)
        self.assertEqual(done.returncode, cli.OK if code == cli.OK else cli.LIMIT, done.stdout + done.stderr)
        result = json.loads((results / "cases" / "0001" / "result.json").read_text())
        return result["run_hash"] if code == cli.OK else result["fault"]

    QUICK = ("simulate", "section", "render", "prepare", "export", "forces", "hold", "scene new")
    SLOWER = ("explore", "cohort")
    VERBS = QUICK + SLOWER

    def check_either_order(self, verbs, first, second, *options):
        for verb in verbs:
            with self.subTest(verb):
                written = self.written(verb, cli.OK, first, second, *options)
                self.assertTrue(written)
                self.assertEqual(self.written(verb, cli.OK, second, first, *options), written)

    def test_are_taken_in_either_order_and_named_by_a_table(self):
        self.check_either_order(self.QUICK, self.scan, self.labels, "--names", self.names)

    def test_of_dicom_are_taken_in_either_order(self):
        self.check_either_order(self.QUICK, self.study, self.structures)

    @cli.long
    def test_of_dicom_are_taken_by_slower_verbs(self):
        self.check_either_order(self.SLOWER, self.study, self.structures)

    def test_what_does_not_go_together_is_refused_by_every_verb_alike(self):
        missing = self.folder / "missing.nrrd"
        for files, options, says in (
                ((self.scan, self.other_scan), (), "two scans"),
                ((self.study, self.scan), (), "two scans"),
                ((self.labels, self.other_labels), (), "two label maps"),
                ((self.structures, self.labels), (), "two label maps"),
                ((self.scan, missing), (), "no such file"),
                ((self.scan, self.elsewhere), (), "of the labelled voxels lie inside the scan"),
                ((self.scan, self.labels), ("--names", self.wrong_names), "names none of the labels")):
            for order in (files, files[::-1]):
                said = {}
                for verb in self.VERBS:
                    with self.subTest(f"{verb}: {says}"):
                        # export names the segmentation first
                        named = order[::-1] if verb == "export" else order
                        said[verb] = self.written(verb, cli.BAD_INPUT, *named, *options)
                        self.assertIn(says, said[verb])
                alike = {verb: text for verb, text in said.items() if verb != "cohort"}
                self.assertEqual(len(set(alike.values())), 1, alike)

    def test_options_say_what_looks_like_something_else(self):
        # by its position, whatever it looks like
        self.assertIn("threshold", self.succeed("scene", "new", "--scan", self.other_labels).stdout)
        self.succeed("section", self.other_labels, self.labels, "--scan", "-o", self.out / "x.png")
        self.expect_error(cli.USAGE, "section", self.scan, self.scan, "-o", self.out / "y.png", message="the same file is given as the scan")
        self.expect_error(cli.USAGE, "section", self.scan, "--names", self.names, "-o", self.out / "y.png",
                          message="a table of names needs a label map")
        for target in ("knee-phantom", self.folder / "scene.toml"):
            if target != "knee-phantom":
                self.succeed("scene", "new", self.scan, self.labels, "--names", self.names, "-o", target)
            self.expect_error(cli.USAGE, "section", target, self.labels, "-o", self.out / "y.png", message="needs a scan")
            self.expect_error(cli.USAGE, "section", target, "--names", self.names, "-o", self.out / "y.png", message="a table of names")

    def test_a_run_is_replayed_and_reported_with_them(self):
        run, named = self.out / "run.h5", ("--names", self.names)
        self.succeed("simulate", self.scan, self.labels, *named, "--script", self.script, "-o", run)
        self.assertIn("identical", self.succeed("replay", run, self.labels, self.scan, *named).stdout)
        self.succeed("report", run, self.scan, self.labels, *named, "-o", self.out / "run.html")
        self.succeed("export", run, self.scan, self.labels, *named, "-o", self.out / "left.seg.nrrd")
        self.assertEqual(self.counts(self.out / "left.seg.nrrd"), self.counts(self.labels, *named))

    # ---- RTSTRUCT to SEG

    def counts(self, *files):
        return {label["name"]: label["voxels"] for label in json.loads(self.succeed("info", *files, "--json").stdout)["labels"]}

    def test_a_structure_set_becomes_a_segmentation_of_its_study(self):
        seg, drawn, read = (self.folder / name for name in ("seg.dcm", "drawn.seg.nrrd", "read.seg.nrrd"))
        self.succeed("export", self.structures, self.study, "--keep-identifiers", "-o", seg)
        counts = self.counts(seg)
        self.assertEqual(set(counts), {"femur", "lesion"})
        self.assertAlmostEqual(counts["femur"] / (4 / 3 * math.pi * RADIUS ** 3), 1, delta=0.05)
        # voxel by voxel what is read of the structure set itself
        self.succeed("export", self.structures, self.study, "-o", drawn)
        self.succeed("export", seg, self.study, "-o", read)
        self.assertEqual(read.read_bytes(), drawn.read_bytes())
        # it names the study's images
        done = self.succeed("scene", "new", self.study, seg)
        self.assertIn("was made on volume 1", done.stderr)
        # whole or not at all
        self.expect_error(cli.USAGE, "export", self.structures, self.study, "-o", self.structures, message="would replace an input")
        self.expect_error(cli.BAD_INPUT, "export", self.structures, "-o", self.out / "x.dcm", message="RTSTRUCT")
        self.assertEqual(list(self.out.iterdir()), [])


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
