"""The first step of a new user, with whatever file is at hand: it ends in a picture or a run, or in a sentence that
says what to do."""

import gzip
import io
import json
import os
import pathlib
import re
import struct
import tarfile
import zipfile

import cli
from volume_files import nifti1, nifti2, png, two_blocks, write_nrrd

SIZES = (24, 24, 24)


def noise(i, j, k):
    return 1000 + (i * 7919 + j * 104729 + k * 1299709) % 1777 if two_blocks(i, j, k) else (i * 31 + j * 17 + k * 7) % 97


def dicom(sop_class):
    """The beginning of a DICOM file of that class, and some of its data set."""
    uid = sop_class.encode() + b"\0" * (len(sop_class) % 2)
    meta = b"\x02\0\x02\0UI" + struct.pack("<H", len(uid)) + uid
    return (b"\0" * 128 + b"DICM" + b"\x02\0\0\0UL\x04\0" + struct.pack("<I", len(meta)) + meta
            + b"\x08\0\x05\0CS\x0a\0ISO_IR 100" + b"\0" * 500)


class FirstSteps(cli.PalpateTest):
    VERBS = {"section": ["-o", "picture.png"], "explore": ["--seconds", "0.2", "--no-viewer"],
             "forces": ["-o", "forces.svg"], "hold": ["--at=12,12,12"], "simulate": [], "info": [],
             "scene new": [], "prepare": ["-o", "field.nrrd"]}

    def run_verb(self, verb, file):
        arguments = [str(self.folder / a) if "." in a and not a.startswith("-") and verb != "explore" else a
                     for a in self.VERBS[verb]]
        return cli.run(*verb.split(), file, *arguments)

    def picture(self, *arguments):
        picture = self.folder / "picture.png"
        picture.unlink(missing_ok=True)
        done = self.succeed("section", *arguments, "-o", picture)
        self.assertEqual(picture.read_bytes()[:8], b"\x89PNG\r\n\x1a\n")
        return done

    # ---- what is no volume is named for what it is

    def foreign(self):
        """{file: (what it is, what to do)}"""
        kinds = {}

        def add(name, content, what, remedy):
            (self.folder / name).write_bytes(content)
            kinds[self.folder / name] = what, remedy

        storage = "1.2.840.10008.5.1.4.1.1."
        add("slice.dcm", dicom(storage + "2"), "DICOM", "")
        add("IM0001", dicom(storage + "4"), "DICOM", "")
        add("seg.dcm", dicom(storage + "66.4"), "DICOM segmentation", "")
        add("rt.dcm", dicom(storage + "481.3"), "a DICOM structure set (RTSTRUCT)", "after the scan")
        add("knee.off", b"OFF\n3 1 0\n", "a surface (OFF)", ".seg.nrrd")
        add("knee.glb", b"glTF\2\0\0\0", "a surface (glTF)", ".seg.nrrd")
        add("knee.vtu", b'<VTKFile type="UnstructuredGrid">', "a surface (VTK)", ".seg.nrrd")
        add("knee.stl.gz", gzip.compress(b"solid knee\nfacet normal 0 0 1\n"), "a surface (STL), compressed", "unpack")
        add("shot.png", png(1, 1, [b"\0"]), "a picture (PNG)", "volume")
        add("shot.nii", png(1, 1, [b"\0"]), "a picture (PNG)", "volume")
        add("photo.jpg", b"\xff\xd8\xff\xe0\0\x10JFIF", "a picture (JPEG)", "volume")
        add("brain.mnc", b"CDF\1" + b"\0" * 100, "MINC 1", "mnc2nii")
        add("brain2.mnc", b"\x89HDF\r\n\x1a\n" + b"\0" * 100, "MINC 2", "mnc2nii")
        add("aseg.mgz", gzip.compress(b"\0\0\0\1" + b"\0" * 300), "FreeSurfer", "mri_convert")
        add("empty.nii.gz", b"", "empty", "again")
        add("empty", b"", "empty", "again")
        add("other.nii.gz", gzip.compress(png(1, 1, [b"\0"])), "a picture (PNG), compressed by gzip", "volume")
        add("renamed.nii.gz", (b"NRRD0004\ntype: uint8\n\n"), "an NRRD volume", ".nrrd")
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as archive:
            archive.writestr("scan.nii", b"x")
        add("knee.zip", packed.getvalue(), "a zip archive", "unpack")
        packed = io.BytesIO()
        with tarfile.open(fileobj=packed, mode="w:gz") as archive:
            archive.addfile(tarfile.TarInfo("scan.nii"))
        add("knee.tar.gz", packed.getvalue(), "a tar archive, compressed by gzip", "unpack")
        return kinds

    def test_non_volume_files_are_named_with_a_remedy(self):
        for file, (what, remedy) in self.foreign().items():
            for verb in ("info", "section", "simulate", "scene new"):
                with self.subTest(file.name, verb=verb):
                    done = self.run_verb(verb, file)
                    self.assertEqual(done.returncode, cli.BAD_INPUT, done.stderr)
                    self.assertEqual(done.stderr.count("palpate: error:"), 1, done.stderr)
                    self.assertIn(what, done.stderr)
                    self.assertIn(remedy, done.stderr)
        self.assertFalse((self.folder / "picture.png").exists())

    def test_folders(self):
        series, mixed, empty = (self.folder / name for name in ("series", "mixed", "empty"))
        for folder in (series, mixed, empty):
            folder.mkdir()
        for n in range(3):
            (series / f"IM{n}").write_bytes(dicom("1.2.840.10008.5.1.4.1.1.4"))
        # volumes in a folder are masks, and below it are listed
        nested = self.folder / "nested"
        (nested / "below").mkdir(parents=True)
        for name in "liver", "spleen", "femur_left", "femur_right":
            for folder in mixed, nested / "below":
                (folder / f"{name}.nii.gz").write_bytes(b"")
        surfaces = self.folder / "surfaces" / "below"
        surfaces.mkdir(parents=True)
        (surfaces / "knee.off").write_bytes(b"OFF\n")
        for verb in ("info", "section", "explore", "scene new"):
            for folder, says in ((series, ["no DICOM image that can be read"]), (mixed, ["femur_left.nii.gz: "]),
                                 (nested, ["name a file in it: below/femur_left.nii.gz", "1 more"]),
                                 (empty, ["without a file"]), (surfaces.parent, ["surface (OFF)", ".seg.nrrd"])):
                with self.subTest(folder.name, verb=verb):
                    done = self.run_verb(verb, folder)
                    self.assertEqual(done.returncode, cli.BAD_INPUT, done.stderr)
                    for text in says:
                        self.assertIn(text, done.stderr)

    def test_a_folder_of_masks_is_felt(self):
        masks = self.folder / "masks"
        masks.mkdir()
        for name, which in ("femur", 1), ("DOE_CANARY_tibia", 2):
            write_nrrd(masks / f"{name}.nrrd", SIZES, lambda i, j, k, which=which: int(two_blocks(i, j, k) == which))
        scan = write_nrrd(self.folder / "scan.nrrd", SIZES, noise, "int16", "h")
        listed = json.loads(self.succeed("info", masks, "--json").stdout)
        self.assertEqual({label["name"]: label["voxels"] for label in listed["labels"]}, {"tibia": 2048, "femur": 2048})
        done = self.succeed("scene", "new", scan, masks, "-o", self.folder / "scene.toml")
        self.assertNotIn("CANARY", done.stderr + done.stdout + (self.folder / "scene.toml").read_text())
        for what in ((scan, masks), (masks,), (self.folder / "scene.toml",)):
            done = self.succeed("simulate", *what, "-o", self.folder / "run.h5")
            for name in "tibia", "femur":
                self.assertRegex(done.stdout, rf"\n{name} +1\.\d\d +0\.\d\d ")
            self.assertNotIn("CANARY", done.stderr + done.stdout)
            self.assertNotIn(b"CANARY", (self.folder / "run.h5").read_bytes())
        # a scan among them is no mask
        scan.rename(masks / "scan.nrrd")
        for verb in ("info", "simulate", "scene new"):
            done = self.run_verb(verb, masks)
            self.assertEqual(done.returncode, cli.BAD_INPUT, done.stderr)
            self.assertIn("scan.nrrd: has several values besides 0, but in a folder of masks each file is one structure", done.stderr)
            self.assertIn("a separate folder", done.stderr)

    @cli.long
    def test_shared_dicom_is_named(self):
        root = cli.need("edge/dicom/bad_sequence.dcm").parent.parent.parent
        for name, what in (("edge/rtstruct/mock_data/rt.dcm", "RTSTRUCT"), ("edge/dicom/bad_sequence.dcm", "a single slice is not a volume")):
            with self.subTest(name):
                self.expect_error(cli.BAD_INPUT, "section", root / name, "-o", self.folder / "x.png", message=what)
        for path in sorted((root / "edge").rglob("*.dcm")):
            with self.subTest(path.name):
                self.expect_error(cli.BAD_INPUT, "section", path, "-o", self.folder / "x.png")

    @cli.long
    def test_shared_dicom_is_read(self):
        root = cli.need("dicom_seg/ct-3slice")
        tilted = self.succeed("section", root.parent.parent / "edge/dicom/gantrytilting", "-o", self.folder / "tilted.png")
        self.assertIn("gantry tilted by 14 degrees", tilted.stderr)
        done = self.succeed("info", root)
        self.assertIn("series 1: CT, axial, 512 x 512 x 3, 0.8105 x 0.8105 x 1 mm", done.stdout)
        self.assertIn("format      DICOM", done.stdout)
        self.succeed("section", root, "-o", self.folder / "x.png")
        # a segmentation of it, by itself and on it
        self.assertRegex(self.succeed("info", root.parent / "liver.dcm").stdout, r"1  Liver +107098 ")
        self.succeed("scene", "new", root, root.parent / "liver.dcm", "-o", self.folder / "liver.toml")
        self.assertIn('preset = "liver"', (self.folder / "liver.toml").read_text())
        self.succeed("section", self.folder / "liver.toml", "-o", self.folder / "z.png")
        self.succeed("prepare", root.parent / "liver.dcm", "-o", self.folder / "field.nrrd")
        several = root.parent.parent / "edge/dicom/sliceorientation/001"
        self.expect_error(cli.BAD_INPUT, "section", several, "-o", self.folder / "x.png", message="holds 2 volumes")
        listed = json.loads(self.succeed("info", several, "--json").stdout)
        self.assertEqual([volume["number"] for volume in listed["volumes"] if volume["usable"]], [1, 2])
        self.succeed("section", several, "--volume", 2, "-o", self.folder / "x.png")
        self.succeed("scene", "new", "--scan", several, "--volume", 2, "-o", self.folder / "two.toml")
        self.assertIn("scan_volume = 2", (self.folder / "two.toml").read_text())
        self.succeed("section", self.folder / "two.toml", "-o", self.folder / "y.png")

    def test_what_reads_dicom_is_loaded_for_dicom_alone(self):
        root = cli.need("dicom_seg/ct-3slice")
        # an environment cannot lead DCMTK to a dictionary of its own
        environment = {**os.environ, "LD_DEBUG": "libs", "DCMDICTPATH": str(self.folder / "nothing")}
        label_map = write_nrrd(self.folder / "labels.nrrd", SIZES, two_blocks)
        for arguments, loads in ((["--version"], False), (["info", label_map], False), (["info", root], True)):
            with self.subTest(arguments=arguments):
                done = self.succeed(*arguments, runner=cli.spawn, env=environment)
                for library in ("libdcmdata", "libicuuc", "libpalpate_dicom"):
                    self.assertEqual(library in done.stderr, loads, library)

    @cli.long
    def test_any_bytes_end_in_a_sentence(self):
        """A prefix of every kind, whatever its name, is one clear error or works."""
        files = [file.read_bytes() for file in self.foreign()] + [nifti2(SIZES, two_blocks), os.urandom(4000)]
        seeds = [(content[:cut], ending) for content in files for cut in (1, 40, 133, 700)
                 for ending in (".nii", ".dcm", "")]
        for n, (content, ending) in enumerate(seeds[::7]):
            path = self.folder / f"bytes{n}{ending}"
            path.write_bytes(content)
            done = cli.spawn("info", path)
            self.assertIn(done.returncode, (cli.OK, cli.BAD_INPUT), done.stderr)
            self.assertNotIn("bug:", done.stderr)

    # ---- a volume where a scene is wanted gets a proposed one

    def test_a_label_map_by_itself_is_felt(self):
        labels = write_nrrd(self.folder / "labels.nrrd", SIZES, two_blocks)
        (self.folder / "labels.json").write_text(json.dumps({"femur": 1, "femoral_cartilage": 2}))
        done = self.picture(labels)
        self.assertIn("all 2 structures felt (bone, cartilage)", done.stderr)
        self.assertIn(f"palpate scene new {labels} -o scene.toml", done.stderr)
        run = self.folder / "run.h5"
        done = self.succeed("simulate", labels, "-o", run)
        self.assertIn("femur", done.stdout)
        self.assertIn("identical", self.succeed("replay", run, labels).stdout)
        self.succeed("report", run, labels)
        for verb in ("explore", "forces", "hold"):
            with self.subTest(verb):
                self.assertEqual(self.run_verb(verb, labels).returncode, cli.OK)
        # the command that was told writes the same scene
        scene = self.folder / "scene.toml"
        self.succeed("scene", "new", labels, "-o", scene)
        self.assertIn("identical", self.succeed("replay", run, scene).stdout)

    def test_a_scan_by_itself_is_felt_where_it_is_bright(self):
        scan = write_nrrd(self.folder / "scan.nrrd", SIZES, noise, "int16", "h")
        self.assertIn("is a scan, felt where it is brighter than", self.picture(scan).stderr)
        self.assertIn("surface", self.succeed("simulate", scan).stdout)
        scene = self.folder / "scene.toml"
        self.assertIn("taken as a scan", self.succeed("scene", "new", scan, "-o", scene).stderr)
        self.assertIn("threshold", scene.read_text())
        self.succeed("scene", "check", scene)

    def test_a_volume_without_its_ending_is_found(self):
        plain = write_nrrd(self.folder / "labels.nrrd", SIZES, two_blocks)
        bare = plain.rename(self.folder / "labels")
        self.expect_error(cli.BAD_INPUT, "section", bare, "-o", self.folder / "x.png", message="ends in .nrrd")

    def test_where_nothing_is_felt_it_is_shown(self):
        labels = write_nrrd(self.folder / "labels.nrrd", SIZES, two_blocks)
        self.assertIn("no label name matches a tissue", self.picture(labels).stderr)
        scene = self.folder / "scene.toml"
        self.assertIn("label 1, label 2", self.succeed("scene", "new", labels, "-o", scene).stderr)
        self.assertIn("this scene has no touchable tissue", self.succeed("scene", "check", scene).stderr)
        self.picture(scene)
        for verb in ("simulate", "forces", "hold", "prepare"):
            with self.subTest(verb):
                target = scene if verb == "prepare" else labels
                done = self.run_verb(verb, target)
                self.assertEqual(done.returncode, cli.BAD_INPUT, done.stdout)
                self.assertIn("the scene has no touchable tissue yet", done.stderr)
                self.assertIn("touchable = true", done.stderr)
        # the page shows it; without one there is nothing to do
        done = self.succeed("explore", scene, "--seconds", "0.5", "--port", "0", "--no-realtime")
        self.assertIn("the scene has no touchable tissue yet", done.stderr)
        self.assertIn("to see it, open http", done.stderr)
        self.expect_error(cli.BAD_INPUT, "explore", scene, "--no-viewer", message="the scene has no touchable tissue yet")
        # a tissue that is felt, but of no voxel
        scene.write_text(f'[data]\nlabels = "{labels}"\n[[tissue]]\nname = "a"\nlabels = [9]\noptional = true\n')
        self.picture(scene)
        self.expect_error(cli.BAD_INPUT, "simulate", scene, message="no voxel of the scene is touchable")

    def test_a_mask_is_called_after_its_file(self):
        mask = write_nrrd(self.folder / "femur_left.nrrd", SIZES, lambda i, j, k: two_blocks(i, j, k) > 0)
        self.assertIn("felt as bone", self.picture(mask).stderr)
        self.assertRegex(self.succeed("info", mask).stdout, r" 1  femur_left ")

    def test_a_file_that_is_not_there(self):
        for verb in ("section", "simulate", "info"):
            done = self.run_verb(verb, self.folder / "missing.nii.gz")
            self.assertEqual(done.returncode, cli.BAD_INPUT, done.stderr)
            self.assertIn("missing.nii.gz: no such file", done.stderr)

    def test_a_volume_where_a_scene_file_is_checked(self):
        labels = write_nrrd(self.folder / "labels.nrrd", SIZES, two_blocks)
        self.expect_error(cli.BAD_INPUT, "scene", "check", labels, message=f"palpate scene new {labels} -o scene.toml")

    # ---- NIfTI-2, and what a NIfTI says of its values

    def test_nifti_2(self):
        file = self.folder / "vertebrae_L5.nii.gz"
        file.write_bytes(gzip.compress(nifti2(SIZES, lambda i, j, k: int(two_blocks(i, j, k) > 0))))
        info = json.loads(self.succeed("info", file, "--json").stdout)
        self.assertEqual(info["kind"], "labels")
        self.assertEqual(info["labels"][0]["voxels"], 16**3)
        self.assertEqual(info["axes"], "RAS")
        self.assertIn("felt as bone", self.picture(file).stderr)

    def test_the_intent_decides(self):
        for name, content, kind in (("float_labels.nii", nifti1(SIZES, lambda i, j, k: float(noise(i, j, k) // 100), 1002, "f", 16), "labels"),
                                    ("statistic.nii", nifti1(SIZES, two_blocks, 3), "scan"), ("plain.nii", nifti1(SIZES, two_blocks), "labels")):
            with self.subTest(name):
                file = self.folder / name
                file.write_bytes(content)
                self.assertEqual(json.loads(self.succeed("info", file, "--json").stdout)["kind"], kind)

    def test_a_scan_taken_for_labels_is_noticed(self):
        scan = write_nrrd(self.folder / "scan.nrrd", SIZES, noise, "int16", "h")
        self.expect_error(cli.BAD_INPUT, "scene", "new", "--labels", scan, message="looks like a scan")
        self.assertIn("looks like a scan", self.succeed("info", "--labels", scan).stderr)
        fraction = self.folder / "fraction.nii"
        fraction.write_bytes(nifti1(SIZES, lambda i, j, k: 0.5 * noise(i, j, k), 0, "f", 16))
        self.expect_error(cli.BAD_INPUT, "scene", "new", "--labels", fraction, message="is it a scan?")

    # ---- words

    def test_what_people_type_names_the_verb(self):
        for words, verb in ((["import", "scan.nii.gz"], "palpate scene new"), (["open", "x"], "palpate explore"),
                            (["load", "x"], "palpate explore"), (["view", "x"], "palpate explore FILE, palpate section"),
                            (["show", "x"], "palpate explore"), (["run", "x"], "palpate simulate"),
                            (["play", "run.h5"], "palpate replay"), (["convert", "x"], "palpate prepare"),
                            (["list"], "palpate data list"), (["new"], "palpate scene new"), (["feel", "x"], "palpate explore"),
                            (["touch", "x"], "palpate explore"), (["record", "x"], "palpate simulate"),
                            (["imprt", "x"], "palpate scene new"), (["opne", "x"], "palpate explore"), (["conver"], "palpate prepare"),
                            (["simualte"], "simulate"), (["help", "simualte"], "simulate"), (["help", "import"], "palpate scene new")):
            with self.subTest(words):
                self.expect_error(cli.USAGE, *words, message="did you mean " + verb)
        labels = write_nrrd(self.folder / "labels.nrrd", SIZES, two_blocks)
        self.expect_error(cli.USAGE, labels, message="is a file, not a verb")

    def test_every_verb_that_is_named_is_one(self):
        """The commands that messages tell to type are commands."""
        source = (pathlib.Path(__file__).parents[2] / "apps/palpate/verbs.cc").read_text()
        told = set(re.findall(r"\"palpate ((?:scene |data )?[a-z]+) ", source))
        self.assertGreater(len(told), 6)
        for command in told - {"help"}:
            with self.subTest(command):
                self.succeed(*command.split(), "--help")

    def test_help(self):
        self.assertEqual(self.succeed("help").stdout, self.succeed("--help").stdout)
        self.assertEqual(self.succeed("help", "simulate").stdout, self.succeed("simulate", "--help").stdout)
        self.assertEqual(self.succeed("help", "data", "fetch").stdout, self.succeed("data", "fetch", "--help").stdout)
        self.expect_error(cli.USAGE, "help", "frobnicate", message="frobnicate: unknown verb")


if __name__ == "__main__":
    cli.main()
