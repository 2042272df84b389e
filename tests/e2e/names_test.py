"""Where names of structures are from, what a volume is taken as, and that both are said."""

import json
import math
import struct

import cli
from volume_files import nifti1, nifti_extension, two_blocks, write_nrrd

SIZES = (24, 24, 24)


def nifti_with_extension(text):
    return nifti1(SIZES, two_blocks, extension=nifti_extension(0, text.encode()))


LABEL_TABLE = ("<?xml version=\"1.0\"?><CaretExtension><VolumeInformation Index=\"0\"><LabelTable>"
               "<Label Key=\"1\" Red=\"0.2\" Green=\"0.3\" Blue=\"0.4\" Alpha=\"1\"><![CDATA[liver]]></Label>"
               "<Label Key=\"2\" Red=\"0.2\" Green=\"0.3\" Blue=\"0.4\" Alpha=\"1\"><![CDATA[liver_tumor]]></Label>"
               "</LabelTable></VolumeInformation></CaretExtension>")


class Names(cli.PalpateTest):
    def test_a_table_in_the_folder_is_said_and_named_by_the_scene(self):
        labels = write_nrrd(self.folder / "liver_and_tumour.nrrd", SIZES, two_blocks)
        table = self.folder / "knee.tsv"
        table.write_text("index\tname\n1\tfemur\n2\tfemoral_cartilage\n")
        said = f"2 labels have their names from {table}, the only table next to it"
        self.assertIn(said, " ".join(self.succeed("info", labels).stdout.split()))
        self.assertEqual(json.loads(self.succeed("info", labels, "--json").stdout)["names_table"], str(table))
        scene = self.folder / "scene.toml"
        self.assertIn(said, self.succeed("scene", "new", labels, "-o", scene).stderr)
        text = scene.read_text()
        self.assertIn('names = "knee.tsv"\n# names of the labels are from the only table next to it', text)
        self.assertIn('# preset guessed from the name\'s term "cartilage"', text)
        page = self.folder / "run.html"
        done = self.succeed("simulate", labels, "-o", self.folder / "run.h5", "--report", page)
        self.assertIn(said, done.stderr)
        self.assertIn("<dt>Names of structures</dt><dd>the only table next to it", page.read_text())
        self.assertNotIn("knee.tsv", page.read_text())

        # it is not used where it may be another's
        write_nrrd(self.folder / "knee.nrrd", SIZES, two_blocks)
        done = self.succeed("info", labels)
        self.assertIn(f"{table} was not used", done.stderr)
        self.assertIn("knee.nrrd", done.stderr)
        self.assertIn("no name for its 2 labels", done.stdout)
        self.assertIn("the given table", " ".join(self.succeed("info", labels, "--names", table).stdout.split()))
        # what a scene names is used
        self.assertNotIn("not used", self.succeed("scene", "check", scene).stderr)

    def test_a_table_of_another_map_is_an_error_where_it_is_named(self):
        labels = write_nrrd(self.folder / "labels.nrrd", SIZES, two_blocks)
        table = self.folder / "knee.ctbl"
        table.write_text("95 femur 1 2 3 255\n")
        for verb in (["info"], ["scene", "new"]):
            self.expect_error(cli.BAD_INPUT, *verb, labels, "--names", table, message="names none of the labels")

    def test_names_in_the_header_of_nifti(self):
        labels = self.folder / "segmentations.nii"
        labels.write_bytes(nifti_with_extension(LABEL_TABLE))
        info = json.loads(self.succeed("info", labels, "--json").stdout)
        self.assertEqual([label["name"] for label in info["labels"]], ["liver", "liver_tumor"])
        self.assertEqual(info["format"], "NIfTI")
        self.assertEqual(info["names_from"], "the file itself")
        self.assertIn("2 labels have their names from the file itself", self.succeed("scene", "new", labels).stderr)
        labels.write_bytes(nifti_with_extension(LABEL_TABLE.replace('Key="2"', 'Key="1"')))
        self.assertIn("names label 1 a second time", self.succeed("info", labels).stderr)

    # ---- scan or labels

    def test_labels_by_a_slope_of_nifti(self):
        labels = self.folder / "labels.nii"
        content = bytearray(nifti_with_extension(LABEL_TABLE))
        struct.pack_into("<f", content, 112, 1 / 85)
        begin = len(content) - math.prod(SIZES)
        content[begin:] = bytes(85 * value for value in content[begin:])
        labels.write_bytes(content)
        self.assertEqual([label["id"] for label in json.loads(self.succeed("info", labels, "--json").stdout)["labels"]], [1, 2])

    def test_the_evidence_is_said(self):
        labels = write_nrrd(self.folder / "labels.nrrd", SIZES, two_blocks)
        self.assertIn("kind        labels: its 2 values form patches", self.succeed("info", labels).stdout)
        self.assertIn("is taken as labels, because its 2 values", self.succeed("scene", "new", labels).stderr)
        noise = write_nrrd(self.folder / "noise.nrrd", SIZES, lambda i, j, k: (i * 79 + j * 1047 + k * 129) % 205)
        self.assertIn("scan: its 204 values change from voxel to voxel", self.succeed("info", noise).stdout)
        self.assertIn("taken as a scan because its 204 values", self.succeed("simulate", noise).stderr)

    def test_what_is_unclear_is_asked(self):
        shells = write_nrrd(self.folder / "shells.nrrd", SIZES, lambda i, j, k: 1 + i // 3 + 8 * (j // 3) + 64 * (k // 3),
                            "int16", "h")
        for verb in (["info"], ["scene", "new"], ["simulate"], ["section", "-o", self.folder / "x.png"]):
            self.expect_error(cli.BAD_INPUT, *verb, shells, message=f"--labels {shells}, or --scan {shells}")
        self.assertEqual(json.loads(self.succeed("info", "--json", "--labels", shells).stdout)["kind"], "labels")
        self.assertEqual(json.loads(self.succeed("info", "--json", "--scan", shells).stdout)["kind"], "scan")
        self.succeed("section", "--scan", shells, "-o", self.folder / "scan.png")
        self.succeed("section", "--labels", shells, "-o", self.folder / "labels.png")
        self.assertIn("threshold", self.succeed("scene", "new", "--scan", shells).stdout)

    def test_every_verb_that_takes_a_file_can_be_told(self):
        for verb in (["info"], ["scene", "new"], ["simulate"], ["explore"], ["section"], ["render"], ["prepare"],
                     ["export"], ["forces"], ["hold"], ["report"], ["replay"], ["plan", "show"]):
            help_text = self.succeed(*verb, "--help").stdout
            for option in ("--labels", "--scan"):
                self.assertIn(option, help_text, verb)
            if verb != ["scene", "new"]:  # there each has a file
                self.expect_error(cli.USAGE, *verb, "--labels", "--scan", "x", message="--labels")

    def test_an_atlas_with_its_table_is_labels(self):
        values = sorted({7 + (n * 7919) % 4093 for n in range(300)})
        atlas = write_nrrd(self.folder / "atlas.nrrd", SIZES,
                           lambda i, j, k: values[(i + 24 * j + 576 * k) % len(values)], "int16", "h")
        self.assertEqual(json.loads(self.succeed("info", atlas, "--json").stdout)["kind"], "scan")
        (self.folder / "atlas.ctbl").write_text("".join(f"{value} left_gyrus_{value} 1 2 3 255\n" for value in values))
        info = json.loads(self.succeed("info", atlas, "--json").stdout)
        self.assertEqual(info["kind"], "labels")
        self.assertIn(f"atlas.ctbl names {len(values)} of its {len(values)} values", info["evidence"])

    def test_ids_above_65535_are_refused_with_their_number(self):
        ids = write_nrrd(self.folder / "ids.nrrd", SIZES, lambda i, j, k: two_blocks(i, j, k) and 614454276 + two_blocks(i, j, k),
                         "uint32", "I")
        for verb in (["info"], ["scene", "new"], ["simulate"]):
            self.expect_error(cli.BAD_INPUT, *verb, ids, message="has 2 labels above 65535 (614454277, 614454278)")
        self.assertEqual(json.loads(self.succeed("info", "--scan", ids, "--json").stdout)["kind"], "scan")


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
