"""Sections as pictures: what is where in them, for every plane, and what is said when there is none."""

import struct
import zlib

import cli
import png


class Picture:
    """A PNG, decoded: rows of (red, green, blue)."""

    CHANNELS = {0: 1, 2: 3, 3: 1}

    def __init__(self, path):
        data = path.read_bytes()
        assert data[:8] == b"\x89PNG\r\n\x1a\n"
        self.chunks, at = [], 8
        while at < len(data):
            length, kind = struct.unpack(">I4s", data[at:at + 8])
            self.chunks.append((kind, data[at + 8:at + 8 + length]))
            at += 12 + length
        self.width, self.height, depth, kind = struct.unpack(">IIBB", self.chunk(b"IHDR")[:10])
        assert depth == 8 or kind == 3
        palette = self.chunk(b"PLTE")
        channels = self.CHANNELS[kind]
        self.rows = []
        for row in png.unfiltered_rows(zlib.decompress(self.chunk(b"IDAT")), self.height, (self.width * channels * depth + 7) // 8,
                                       channels):
            if depth < 8:
                row = bytes(byte >> shift & (1 << depth) - 1 for byte in row for shift in range(8 - depth, -1, -depth))
                row = row[:self.width]
            pixels = [row[n:n + channels] for n in range(0, len(row), channels)]
            if kind == 3:
                pixels = [palette[3 * p[0]:3 * p[0] + 3] for p in pixels]
            self.rows.append([tuple(p) if len(p) == 3 else (p[0],) * 3 for p in pixels])

    def chunk(self, kind):
        return b"".join(content for name, content in self.chunks if name == kind)

    def columns_of(self, colour, rows=slice(None)):
        return [x for row in self.rows[rows] for x, pixel in enumerate(row) if pixel == colour]


class Section(cli.KneeTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.new_scene(cls.scan, cls.labels)

    def draw(self, *arguments):
        return Picture(super().draw("section", "section.png", *arguments))

    def test_every_plane_has_its_size(self):
        for arguments, width, height in (([], 3 * 320, 320), (["--plane", "axial"], 320, 320),
                                         (["--plane", "sagittal"], 320, 320), (["--plane", "coronal"], 320, 320),
                                         (["--direction", "1,2,3"], 320, 320),
                                         (["--direction=-1,0.5,-3", "--view", "across"], 320, 320)):
            with self.subTest(arguments):
                picture = self.draw(self.scene, "--pixels", "320", *arguments)
                self.assertEqual((picture.width, picture.height), (width, height))
                # something is to be seen
                self.assertGreater(len({pixel for row in picture.rows for pixel in row}), 100)
                # no text, no time
                self.assertLessEqual({kind for kind, _ in picture.chunks}, {b"IHDR", b"PLTE", b"IDAT", b"IEND", b"sRGB", b"gAMA", b"cHRM"})

    def test_the_fibula_of_a_left_knee_is_on_the_right(self):
        # of the labels alone, so that structures have their own colours
        scene = self.scene.with_name("labels.toml")
        done = cli.run("scene", "new", self.labels, "-o", scene)
        self.assertEqual(done.returncode, cli.OK, done.stderr)
        text = scene.read_text()
        tissues = text.split("[[tissue]]")
        mark = {"fibula": "#12fe34", "tibia": "#fe1298"}
        alone = "".join(f'[[tissue]]\nname = "{name}"\nlabels = ["{name}"]\npreset = "bone"\ncolour = "{colour}"\n\n'
                        for name, colour in mark.items())
        scene.write_text(tissues[0] + alone)
        self.succeed("scene", "check", scene)
        fibula_mm = self.centroid("fibula")
        for plane in ("coronal", "axial"):
            with self.subTest(plane):
                picture = self.draw(scene, "--plane", plane, "--at=" + ",".join(map(str, fibula_mm)), "--outline")
                middle = slice(picture.height // 4, picture.height * 3 // 5)
                fibula, tibia = picture.columns_of((0x12, 0xfe, 0x34), middle), picture.columns_of((0xfe, 0x12, 0x98), middle)
                self.assertGreater(len(fibula), 50)
                self.assertGreater(len(tibia), 50)
                self.assertGreater(min(fibula), sum(tibia) / len(tibia))

    def centroid(self, name):
        import json
        info = json.loads(self.succeed("info", "--json", self.labels).stdout)
        found = [s for s in self.walk(info) if isinstance(s, dict) and s.get("name") == name]
        self.assertEqual(len(found), 1, info)
        return found[0]["centroid_lps_mm"]

    def walk(self, node):
        yield node
        for child in node.values() if isinstance(node, dict) else node if isinstance(node, list) else []:
            yield from self.walk(child)

    def test_fill_outline_window_and_size_change_the_picture(self):
        seen = set()
        for arguments in ([], ["--fill"], ["--outline"], ["--fill", "--opacity", "0"], ["--window", "0,300"],
                          ["--size", "50"], ["--at", "5,5,5"]):
            self.draw(self.scene, "--plane", "coronal", "--pixels", "320", *arguments)
            seen.add((self.folder / "section.png").read_bytes())
        self.assertEqual(len(seen), 7)

    def test_the_same_command_makes_the_same_picture(self):
        pictures = []
        for name in ("a.png", "b.png"):
            self.succeed("section", self.scene, "--direction=-0.2,1e0,.5", "-o", self.folder / name)
            pictures.append((self.folder / name).read_bytes())
        self.assertEqual(*pictures)

    def test_labels_alone_and_scan_alone(self):
        for files in ([self.labels], ["--scan", self.scan]):
            scene = self.scene.with_name("alone.toml")
            scene.unlink(missing_ok=True)
            done = cli.run("scene", "new", *files, "-o", scene)
            self.assertEqual(done.returncode, cli.OK, done.stderr)
            self.assertEqual(self.draw(scene, "--plane", "axial").width, 768)

    def test_neither_title_nor_path_is_in_it(self):
        scene = self.scene.with_name("CANARY.toml")
        scene.write_text(self.scene_without_title("CANARY"))
        self.draw(scene)
        titled = (self.folder / "section.png").read_bytes()
        self.assertNotIn(b"CANARY", titled)
        # not as letters either: without the title it is the same picture
        scene.write_text(self.scene_without_title())
        self.draw(scene)
        self.assertEqual((self.folder / "section.png").read_bytes(), titled)

    def test_what_cannot_be_drawn(self):
        self.check_what_cannot_be_drawn("section", ".png", [
            (cli.USAGE, ["--direction", "1,2,nan"], "nan is not a number"),
            (cli.USAGE, ["--direction", "0,0,0"], "0,0,0 is not a direction"),
            (cli.USAGE, ["--plane", "oblique"], "needs a direction"),
            (cli.USAGE, ["--plane", "axial", "--direction", "1,2,3"], "only an oblique section"),
            (cli.USAGE, ["--plane", "diagonal"], "axial"),
            (cli.USAGE, ["--window", "5,5"], "--window: the lower end of the window"),
            (cli.USAGE, ["--fill", "--outline"], "--outline"),
            (cli.USAGE, ["--pixels", "100"], "whole number between 320 and 4096")])

    def test_outputs_that_cannot_be_written(self):
        self.check_outputs_that_cannot_be_written("section", ".png", ".svg")


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
