"""Pictures of the volume: from every side, cut, of some structures alone, all around, and what is said when there is none."""

import json
import pathlib
import struct
import zlib

import cli
import png


def unfiltered(rows, side):
    """The pixels of filtered rows, 8 bits of red, green and blue."""
    return b"".join(png.unfiltered_rows(rows, side, 3 * side, 3))


def pixels_of(png, side):
    at, data = 8, b""
    while at < len(png):
        size, kind = struct.unpack(">I4s", png[at:at + 8])
        data += png[at + 8:at + 8 + size] if kind == b"IDAT" else b""
        at += 12 + size
    return unfiltered(zlib.decompress(data), side)


class Render(cli.KneeTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.new_scene(cls.scan, cls.labels)

    def render(self, *arguments, name="volume.png"):
        self.succeed("render", self.scene, "--pixels", "320", "-o", self.folder / name, *arguments)
        return (self.folder / name).read_bytes()

    def test_every_option_changes_the_picture(self):
        seen = {self.render(*arguments) for arguments in (
            [], ["--from", "left"], ["--from", "superior"], ["--turn", "30"], ["--tilt=-20"], ["--perspective"], ["--at", "5,5,5"],
            ["--cut", "anterior"], ["--size", "60"], ["--only", "femur"], ["--hide", "femur"], ["--hide", "femur", "--hide", "tibia"],
            ["--scan-opacity", "1"], ["--scan-opacity", "0.6"], ["--scan-opacity", "1", "--window=0,100"])}
        self.assertEqual(len(seen), 15)

    def test_the_same_command_makes_the_same_picture(self):
        self.assertEqual(self.render("--turn", "33", name="a.png"), self.render("--turn", "33", name="b.png"))

    def test_an_orbit_is_a_folder_of_pictures(self):
        folder = self.folder / "orbit"
        self.succeed("render", self.scene, "--pixels", "320", "--orbit", "4", "-o", folder)
        frames = sorted(folder.iterdir())
        self.assertEqual([frame.name for frame in frames], [f"frame-00{n}.png" for n in range(4)])
        self.assertEqual(len({frame.read_bytes() for frame in frames}), 4)
        done = cli.run("render", self.scene, "--orbit", "4", "-o", folder)
        self.assertEqual(done.returncode, cli.OUTPUT)
        self.assertIn("need a new or empty folder", done.stderr)

    def test_an_orbit_is_an_animated_png(self):
        animated, frames = self.folder / "orbit.png", self.folder / "orbit-frames"
        self.succeed("render", self.scene, "--pixels", "320", "--orbit", "3", "-o", animated)
        self.succeed("render", self.scene, "--pixels", "320", "--orbit", "3", "-o", frames)
        data, at, chunks = animated.read_bytes(), 8, []
        while at < len(data):
            size, kind = struct.unpack(">I4s", data[at:at + 8])
            chunks.append((kind, data[at + 8:at + 8 + size]))
            self.assertEqual(zlib.crc32(data[at + 4:at + 8 + size]), struct.unpack(">I", data[at + 8 + size:at + 12 + size])[0])
            at += 12 + size
        self.assertEqual([kind for kind, _ in chunks],
                         [b"IHDR", b"sRGB", b"acTL", b"fcTL", b"IDAT", b"fcTL", b"fdAT", b"fcTL", b"fdAT", b"IEND"])
        self.assertEqual(chunks[2][1], struct.pack(">II", 3, 0))
        # its first frame is the first picture, whatever filters their rows went through
        pictures = sorted(frames.iterdir())
        self.assertEqual(len(pictures), 3)
        self.assertEqual(unfiltered(zlib.decompress(chunks[4][1]), 320), pixels_of(pictures[0].read_bytes(), 320))

    def test_an_orbit_is_an_animated_png_in_letters_of_any_case(self):
        animated = self.folder / "ORBIT.PNG"
        self.succeed("render", self.scene, "--pixels", "320", "--orbit", "2", "-o", animated)
        self.assertTrue(animated.is_file())
        self.assertIn(b"acTL", animated.read_bytes())

    def test_a_moment_of_a_recording(self):
        recording, picture, script = (self.folder / name for name in ("run.h5", "moment.png", "script.toml"))
        script.write_text(cli.TOUCH + "[[step]]\nhold = 2.0\n")
        self.succeed("simulate", self.scene, "--script", script, "-o", recording)

        def drawn(*arguments):
            self.succeed("render", recording, "--made-with", self.scene, "--pixels", "320", "-o", picture, *arguments)
            return picture.read_bytes()
        pictures = {drawn("--time", time) for time in ("0", "0.5", "1.5")}
        self.assertEqual(len(pictures), 3)
        self.assertNotIn(self.render(), pictures)
        # at its ends, and beyond them
        self.assertEqual(drawn("--time=-1"), drawn("--time", "0"))
        self.assertNotEqual(drawn("--time", "1.5", "--turn", "40"), drawn("--time", "1.5"))
        other = self.folder / "run.txt"
        other.write_text("no recording")
        for target, arguments, code in ((other, ["--time", "1"], cli.BAD_INPUT), (recording, ["--time", "soon"], cli.USAGE),
                                        (self.scene, ["--made-with", self.scene], cli.USAGE)):
            done = cli.run("render", target, "-o", self.folder / "none.png", *arguments)
            self.assertEqual(done.returncode, code, done.stderr)
            self.assertFalse((self.folder / "none.png").exists())
        # it is not written over
        self.assertNotEqual(cli.run("render", recording, "--made-with", self.scene, "--time", "1", "-o", recording).returncode, 0)

    def test_neither_title_nor_path_is_in_it(self):
        scene = self.scene.with_name("CANARY.toml")
        pictures = []
        for title in ("CANARY", None):
            scene.write_text(self.scene_without_title(title) if title else self.scene_without_title())
            self.succeed("render", scene, "--pixels", "320", "-o", self.folder / "titled.png")
            pictures.append((self.folder / "titled.png").read_bytes())
        self.assertNotIn(b"CANARY", pictures[0])
        self.assertEqual(*pictures)

    def test_what_cannot_be_drawn(self):
        for arguments, words in ((["--from", "above"], "--from"), (["--only", "femurr"], 'no structure is called "femurr"'),
                                 (["--tilt", "91"], "--tilt"), (["--orbit", "1"], "--orbit"), (["--pixels", "100"], "--pixels"), (["--scan-opacity", "2"], "--scan-opacity"), (["--window=0,100"], "draw it with --scan-opacity"),
                                 (["--scan-opacity", "1", "--window=5,5"], "--window")):
            with self.subTest(arguments):
                output = self.folder / "none.png"
                done = cli.run("render", self.scene, "-o", output, *arguments)
                self.assertEqual(done.returncode, cli.USAGE, done.stderr)
                self.assertIn(words, done.stderr)
                self.assertFalse(output.exists())

    @cli.long
    def test_a_page_shows_every_data_set(self):
        page = self.folder / "data.html"
        self.succeed("data", "list", "--page", page)
        text = page.read_text(encoding="utf-8")
        listed = json.loads(cli.run("data", "list", "--json").stdout)
        for entry in listed:
            self.assertIn(f"<h2>{entry['name']}</h2>", text)
        drawn = sum(entry["here"] or entry["source"] == "generated" for entry in listed)
        self.assertGreaterEqual(drawn, 7)
        self.assertEqual(text.count("data:image/png;base64,"), drawn)
        self.assertEqual(text.count("no picture"), len(listed) - drawn)
        # no folder of this machine
        for entry in listed:
            if entry["here"]:
                self.assertNotIn(str(pathlib.Path(entry["labels"]).parent), text)
        done = cli.run("data", "list", "--page", page, "--json")
        self.assertEqual(done.returncode, cli.USAGE)

    def test_outputs_that_cannot_be_written(self):
        self.check_outputs_that_cannot_be_written("render", ".png", ".svg")


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
