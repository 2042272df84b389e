"""Pictures as slices, and whether scan and labels belong together: from the files to the first touch."""

import struct
import zlib

import cli

SIZE = (40, 36, 30)  # columns, rows, slices
RADIUS = 12


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(rows, colour):
    """Rows of grey bytes, or of 3 bytes a pixel."""
    head = struct.pack(">IIBBBBB", SIZE[0], SIZE[1], 8, 2 if colour else 0, 0, 0, 0)
    packed = zlib.compress(b"".join(b"\0" + row for row in rows))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


def in_ball(i, j, k):
    return sum((p - s / 2) ** 2 for p, s in zip((i, j, k), SIZE)) < RADIUS ** 2


def nrrd(kind, origin, values):
    head = (f"NRRD0005\ntype: {kind}\ndimension: 3\nspace: left-posterior-superior\nsizes: {SIZE[0]} {SIZE[1]} {SIZE[2]}\n"
            "space directions: (1,0,0) (0,1,0) (0,0,1)\n"
            f"space origin: ({','.join(map(str, origin))})\nencoding: raw\n\n")
    return head.encode() + values


def nifti(q_handedness):
    """Two forms of one file, which differ by a mirror where the qform's handedness is -1."""
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, *SIZE, 1, 1, 1, 1)
    struct.pack_into("<hh", head, 70, 2, 8)
    struct.pack_into("<8f", head, 76, q_handedness, 1, 1, 1, 0, 0, 0, 0)
    struct.pack_into("<f", head, 108, 352)
    head[123] = 2
    struct.pack_into("<hh", head, 252, 1, 1)
    struct.pack_into("<12f", head, 280, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0)
    head[344:348] = b"n+1\0"
    return bytes(head)


class Belonging(cli.PalpateTest):
    def setUp(self):
        super().setUp()
        # of each voxel, i fastest
        places = [(i, j, k) for k in range(SIZE[2]) for j in range(SIZE[1]) for i in range(SIZE[0])]
        self.ball = bytes(1 if in_ball(*place) else 0 for place in places)
        self.noise = bytes((200 if inside else 20) + (n * 7919 >> 3) % 31 for n, inside in enumerate(self.ball))

    def write_stacks(self):
        """A folder of grey slices and one of colours, whose names sort otherwise as texts than as numbers."""
        scan, labels = self.folder / "grey", self.folder / "colours"
        width, area = SIZE[0], SIZE[0] * SIZE[1]
        for folder, values, colour in ((scan, self.noise, False), (labels, self.ball, True)):
            folder.mkdir()
            for k in range(SIZE[2]):
                slice_ = values[k * area:(k + 1) * area]
                rows = [slice_[j * width:(j + 1) * width] for j in range(SIZE[1])]
                if colour:
                    rows = [b"".join(b"\xfa\x0a\x00" if value else b"\0\0\0" for value in row) for row in rows]
                (folder / f"s{k + 1}.png").write_bytes(png(rows, colour))
        (self.folder / "names.ctbl").write_text("5 femur 250 10 0 255\n")
        return scan, labels

    def test_stacks_of_pictures_are_felt(self):
        scan, labels = self.write_stacks()
        self.fail_clearly(cli.BAD_INPUT, "info", scan, says="--spacing X,Y,Z")
        said = self.succeed("info", scan, "--spacing", "1,1,1.5")
        self.assertIn("40 x 36 x 30", said.stdout)
        self.assertIn("1 x 1 x 1.5 mm", said.stdout)
        scene = self.folder / "scene.toml"
        done = self.succeed("scene", "new", scan, labels, "--names", self.folder / "names.ctbl", "--spacing", "1,1,1.5",
                            "-o", scene)
        self.assertIn("100.0 % of the labelled voxels lie inside the scan", done.stdout + done.stderr)
        self.assertIn("image_spacing = [1, 1, 1.5]", scene.read_text())
        self.assertIn('"femur"', scene.read_text())
        # the scene says the spacing from here on
        self.assertIn("a valid scene", self.succeed("scene", "check", scene).stdout)
        self.succeed("section", scene, "-o", self.folder / "section.png")
        script = self.folder / "touch.toml"
        script.write_text(cli.TOUCH)
        self.succeed("simulate", scene, "--script", script, "-o", self.folder / "run.h5")

    def test_labels_elsewhere_are_refused_unless_the_scan_is_cropped(self):
        scan, labels = self.folder / "scan.nrrd", self.folder / "femur.nrrd"
        scan.write_bytes(nrrd("uchar", (0, 0, 0), self.noise))
        labels.write_bytes(nrrd("uchar", (20, 0, 0), self.ball))
        self.fail_clearly(cli.BAD_INPUT, "scene", "new", scan, labels, says="--cropped-scan")
        scene = self.folder / "scene.toml"
        done = self.succeed("scene", "new", scan, labels, "--cropped-scan", "-o", scene)
        self.assertIn("% of the labelled voxels lie inside the scan", done.stdout + done.stderr)
        self.assertIn("cropped_scan = true", scene.read_text())
        self.assertIn("only", self.succeed("scene", "check", scene).stderr)
        # and refused again where the scene does not say it
        scene.write_text(scene.read_text().replace("cropped_scan = true\n", ""))
        self.fail_clearly(cli.BAD_INPUT, "scene", "check", scene, says="cropped_scan = true")
        self.fail_clearly(cli.BAD_INPUT, "simulate", scene, "-o", self.folder / "run.h5", says="--cropped-scan")

    def test_a_mirror_between_two_forms_is_said_also_in_the_report(self):
        labels = self.folder / "femur.nii"
        labels.write_bytes(nifti(-1) + self.ball)
        self.assertIn("differ by a mirror", self.succeed("info", labels).stderr)
        self.assertNotIn("mirror", self.succeed("info", labels, "--form", "q").stderr)
        scene, recording, report = (self.folder / name for name in ("scene.toml", "run.h5", "run.html"))
        self.succeed("scene", "new", labels, "-o", scene)
        script = self.folder / "touch.toml"
        script.write_text(cli.TOUCH)
        self.succeed("simulate", scene, "--script", script, "-o", recording)
        self.succeed("report", recording, scene, "-o", report)
        self.assertIn("a qform and an sform that differ by a mirror", report.read_text())
        self.succeed("scene", "new", labels, "--form", "s", "-o", scene, "--force")
        self.assertIn('nifti_form = "s"', scene.read_text())
        self.assertNotIn("mirror", self.succeed("scene", "check", scene).stderr)


if __name__ == "__main__":
    cli.share_what_is_prepared()
    cli.main()
