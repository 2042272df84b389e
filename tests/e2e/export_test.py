"""What leaves: labels as DICOM SEG, sections as Secondary Capture, paths as CSV; DICOMDIR and what files carry."""

import csv
import json
import shutil
import struct
import subprocess

import cli
from canary_files import CANARY, dicom_with_canary

N = 40


def tool(name):
    """A program of DCMTK's or dicom3tools', by its path."""
    path = shutil.which(name)
    if path is None:
        cli.missing(f"{name} (dcmtk, dicom3tools)")
    return path


def dumped(path):
    """An object as dcmdump shows it, which has to read it without a warning."""
    done = subprocess.run([tool("dcmdump"), "-q", "+L", str(path)], capture_output=True, text=True, errors="replace")
    assert done.returncode == 0 and not done.stderr, done.stderr
    return done.stdout


class Export(cli.PalpateTest):
    def setUp(self):
        super().setUp()
        self.study = self.folder / "DISC" / "STUDY"
        self.study.mkdir(parents=True)
        for k in range(N):
            ball = [1000 if (i - 20) ** 2 + (j - 20) ** 2 + (k - 20) ** 2 < 150 else 7 for j in range(N) for i in range(N)]
            dicom_with_canary(self.study / f"IM{k}", N, k, struct.pack(f"<{N * N}H", *ball))
        self.labels = self.folder / "labels.seg.nrrd"
        voxels = bytes((1 if (i - 20) ** 2 + (j - 20) ** 2 + (k - 20) ** 2 < 100 else 2 if k < 9 else 0)
                       for k in range(N) for j in range(N) for i in range(N))
        head = ("NRRD0005\ntype: uchar\ndimension: 3\nspace: left-posterior-superior\n"
                f"sizes: {N} {N} {N}\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\nencoding: raw\n"
                "Segment0_Name:=femur_left\nSegment0_LabelValue:=1\nSegment0_Layer:=0\n"
                "Segment1_Name:=lesion\nSegment1_LabelValue:=2\nSegment1_Layer:=0\n\n")
        self.labels.write_bytes(head.encode() + voxels)

    def counts(self, path):
        info = json.loads(self.succeed("info", path, "--json").stdout)
        return info["dims"], {label["name"]: label["voxels"] for label in info["labels"]}

    def validated(self, path, kind):
        """dciodvfy's errors in an object, which it takes for that kind."""
        done = subprocess.run([tool("dciodvfy"), str(path)], capture_output=True, text=True, errors="replace")
        self.assertIn(kind, done.stdout + done.stderr)
        return [line for line in (done.stdout + done.stderr).splitlines() if line.startswith("Error")]

    def test_labels_become_a_segmentation_without_a_patient(self):
        seg = self.folder / "out.dcm"
        self.succeed("export", self.labels, "-o", seg)
        self.assertEqual(self.counts(seg), self.counts(self.labels))
        text = dumped(seg)
        self.assertIn("71341001", text)
        self.assertIn("7771000", text)
        self.assertIn("Not for clinical use", text)
        self.assertRegex(text, r"PN \(no value available\)")
        self.assertEqual(self.validated(seg, "Segmentation"), [])
        # back as .seg.nrrd
        back = self.folder / "back.seg.nrrd"
        self.succeed("export", seg, "-o", back)
        self.assertEqual(self.counts(back), self.counts(self.labels))

    def test_attached_to_its_study(self):
        seg = self.folder / "attached.dcm"
        self.succeed("export", self.labels, self.study, "--keep-identifiers", "-o", seg)
        text = dumped(seg)
        self.assertIn(CANARY, text)
        self.assertIn("1.2.3.19570411", text)
        self.assertIn("[1.2.3.7]", text, "the images that it lies on")
        self.assertEqual(self.validated(seg, "Segmentation"), [])
        # the study takes it for its own
        done = self.succeed("scene", "new", self.study, seg)
        self.assertIn("was made on volume 1", done.stderr)
        self.expect_error(cli.USAGE, "export", self.labels, "--keep-identifiers", "-o", seg, message="no study is given")
        self.expect_error(cli.USAGE, "export", self.labels, "--keep-identifiers", "-o", self.folder / "x.nrrd",
                          message="only DICOM can keep identifiers")

    def test_labels_of_somebody_else_are_not_attached(self):
        out = self.folder / "x.dcm"
        seg = self.folder / "attached.dcm"
        self.succeed("export", self.labels, self.study, "--keep-identifiers", "-o", seg)
        other = self.folder / "OTHER"
        other.mkdir()
        for k in range(N):
            data = (self.study / f"IM{k}").read_bytes()
            (other / f"IM{k}").write_bytes(data.replace(b"1.2.3.", b"1.2.4."))
        self.expect_error(cli.BAD_INPUT, "export", seg, other, "--keep-identifiers", "-o", out,
                          message="does not state that it was made on")
        for options in (), ("--keep-identifiers",):
            # elsewhere in space
            away = self.folder / "away.seg.nrrd"
            away.write_bytes(self.labels.read_bytes().replace(b"origin: (0,0,0)", b"origin: (900,0,0)"))
            self.expect_error(cli.BAD_INPUT, "export", away, self.study, *options, "-o", out)
        self.expect_error(cli.USAGE, "export", self.labels, "--volume", "1", "-o", out, message="--volume")
        self.assertFalse(out.exists())

    def test_a_section_is_a_secondary_capture(self):
        for options, there in ((), False), (("--keep-identifiers",), True):
            picture = self.folder / f"section{there}.dcm"
            self.succeed("section", self.study, "--pixels", "320", *options, "-o", picture)
            text = dumped(picture)
            self.assertIn("SecondaryCaptureImageStorage", text)
            self.assertIn("Not for clinical use", text)
            self.assertEqual(CANARY in text, there)
            self.assertEqual(self.validated(picture, "SCImage"), [])
            self.assertNotIn("BurnedInAnnotation", text, "nobody looked")

    def test_a_path_is_a_table_in_the_volume_s_space(self):
        run, path = self.folder / "run.h5", self.folder / "path.csv"
        script = self.folder / "touch.toml"
        script.write_text('[[step]]\napproach = "femur_left"\n[[step]]\npress = 0.5\n[[step]]\nleave = true\n')
        scene = self.folder / "scene.toml"
        self.succeed("scene", "new", self.labels, "-o", scene)
        self.succeed("simulate", scene, "--script", script, "-o", run)
        self.succeed("export", run, "-o", path)
        with path.open() as file:
            rows = list(csv.DictReader(file))
        self.assertGreater(len(rows), 100)
        pressed = max(rows, key=lambda row: float(row["force_N"]))
        self.assertGreater(float(pressed["force_N"]), 0.1)
        tip = [float(pressed[f"tip_{a}_mm"]) for a in "xyz"]
        # a point that touches a ball of 10 mm around (20, 20, 20)
        self.assertLess(abs(sum((t - 20) ** 2 for t in tip) ** 0.5 - 10), 3)
        self.assertEqual(int(pressed["label"]), 1)
        self.expect_error(cli.USAGE, "export", self.labels, "-o", self.folder / "y.csv", message="labels have no path")

    def test_a_dicomdir_names_the_files(self):
        disc = self.study.parent
        subprocess.run([tool("dcmmkdir"), "-q", "+r", "+id", str(disc), "+D", str(disc / "DICOMDIR"), "-W", "+I"],
                       check=True, capture_output=True)
        listed = self.succeed("info", disc / "DICOMDIR").stdout
        self.assertIn("CT, axial, 40 x 40 x 40, 1 x 1 x 1 mm", listed)
        self.assertEqual(json.loads(self.succeed("info", disc, "--json").stdout)["dims"], [N, N, N])
        self.succeed("section", disc / "DICOMDIR", "-o", self.folder / "x.png")
        # it names patients itself
        rows = json.loads(self.succeed("info", disc / "DICOMDIR", "--identifiers", "--json").stdout)
        self.assertEqual(rows["files"], N + 1)
        # names in small letters, as some discs are mounted
        (disc / "STUDY").rename(disc / "lower")
        for k in range(N):
            (disc / "lower" / f"IM{k}").rename(disc / "lower" / f"im{k}")
        (disc / "lower").rename(disc / "study")
        self.assertIn("40 x 40 x 40", self.succeed("info", disc / "DICOMDIR").stdout)
        # one that is missing is said, and the gap is found
        (disc / "study" / "im7").unlink()
        done = self.expect_error(cli.BAD_INPUT, "info", disc / "DICOMDIR")
        self.assertIn("names 1 file that is not there", done.stdout)
        # out of its folder it leads nowhere
        directory = (disc / "DICOMDIR").read_bytes()
        self.assertIn(b"STUDY\\IM0 ", directory)
        (disc / "DICOMDIR").write_bytes(directory.replace(b"STUDY\\IM0 ", b"..\\STUDY00"))
        self.expect_error(cli.BAD_INPUT, "info", disc / "DICOMDIR", message="not in its folder")

    def test_what_a_study_carries_is_told_without_values(self):
        said = self.succeed("info", self.study, "--identifiers").stdout
        for text in ("names of persons", "PatientName (0010,0010)", "PatientID (0010,0020)", "dates and times",
                     "PatientBirthDate (0010,0030)", "unique identifiers", "SOPInstanceUID (0008,0018)", "40 values",
                     "free text", "StudyDescription", "private (0029,1001)", "institution", "burnt into the pixels"):
            self.assertIn(text, said)
        self.assertNotIn("CANARY", said)
        self.assertNotIn("19570411", said)
        self.assertIn(CANARY, self.succeed("info", self.study, "--identifiers", "--keep-identifiers").stdout)
        rows = json.loads(self.succeed("info", self.study, "--identifiers", "--json").stdout)
        self.assertEqual(rows["files"], N)
        self.assertEqual(rows["burnt_in_unsaid"], N)
        self.assertTrue(all("example" not in row for row in rows["identifiers"]))
        self.expect_error(cli.USAGE, "info", self.study, "--keep-identifiers", message="--identifiers")
        self.expect_error(cli.BAD_INPUT, "info", self.labels, "--identifiers", message="holds no DICOM file")


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
