"""A segmentation examined: in words, as JSON and as a page; mended into another file, never in place."""

import json
import os

import cli


class Lint(cli.KneeTest):
    def lint(self, *arguments, code=cli.OK):
        done = cli.run("lint", *arguments)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        return done

    def damaged(self, name):
        """The knee with stray islands and holes, in a file of its own."""
        folder = self.folder / name
        self.succeed("data", "fetch", "knee-phantom:islands=6,spacing=1.5", "-o", folder)
        return next(folder.glob("*.seg.nrrd"))

    def test_words_name_kinds_structures_and_places(self):
        done = self.lint(self.labels, self.scan, code=cli.LIMIT)
        self.assertRegex(done.stdout, r"^grade [A-D]: \d+ faults?, \d+ warnings?, \d+ that cannot be decided, in \d+ structures")
        self.assertIn("fault: Sheet one voxel thick", done.stdout)
        self.assertRegex(done.stdout, r"femoral_cartilage is one voxel thick over")
        self.assertIn("warning: Cut by the volume's border", done.stdout)
        self.assertIn("mm LPS (voxel", done.stdout)
        # a knee of one side has no partners
        self.assertIn("cannot tell: Swapped or mirrored sides", done.stdout)
        self.assertLessEqual(max(map(len, done.stdout.splitlines())), 100)

    def test_a_data_set_and_a_scene_are_examined_too(self):
        self.assertIn("grade A: 0 faults", self.lint("shell-phantom").stdout)
        self.new_scene(self.scan, self.labels)
        self.assertIn("femur", self.lint(self.scene, code=cli.LIMIT).stdout)

    def test_json_has_every_finding(self):
        labels = self.damaged("damaged")
        found = json.loads(self.lint(labels, "--json", "-", code=cli.LIMIT).stdout)
        kinds = {kind["kind"] for kind in found["kinds"]}
        self.assertGreaterEqual(len(kinds), 18)
        findings = found["findings"]
        self.assertTrue({"islands", "holes"} <= {finding["kind"] for finding in findings} <= kinds)
        numbers = {structure["id"] for structure in found["structures"]}
        for finding in findings:
            self.assertTrue(set(finding["structures"]) <= numbers)
            self.assertIn(finding["severity"], ("fault", "warning", "cannot tell"))
            self.assertTrue(finding["sentence"] and finding["effect"] and finding["remedy"])
        self.assertEqual(found["faults"], sum(finding["severity"] == "fault" for finding in findings))
        # a larger tool finds no fewer gaps
        def gaps(radius):
            done = self.lint(labels, "--json", "-", "--tool-radius", radius, code=cli.LIMIT)
            return sum(finding["kind"] == "narrow_gap" for finding in json.loads(done.stdout)["findings"])
        self.assertLess(gaps(0.5), gaps(3))

    def test_the_page_is_whole_and_loads_nothing(self):
        page = self.folder / "lint.html"
        self.lint(self.labels, self.scan, "--page", page, code=cli.LIMIT)
        text = page.read_text()
        self.assertIn("femoral_cartilage", text)
        self.assertIn("data:image/png;base64,", text)
        self.assertNotIn("http", text.replace("http-equiv", ""))
        self.assertNotIn(self.labels.name, text)

    def test_repairs_are_complete_and_change_nothing_else(self):
        labels, mended = self.damaged("damaged"), self.folder / "mended.seg.nrrd"
        before = labels.read_bytes()
        done = self.lint(labels, "--fix", mended, code=cli.LIMIT)
        self.assertRegex(done.stdout, r"repaired: removed \d+ islands? of")
        self.assertRegex(done.stdout, r"repaired: filled \d+ holes? of")
        self.assertIn("not repaired, because it needs a decision: ", done.stdout)
        self.assertEqual(labels.read_bytes(), before)
        kinds = {finding["kind"] for finding in
                 json.loads(self.lint(mended, "--json", "-", code=cli.LIMIT).stdout)["findings"]
                 if finding["severity"] == "fault"}
        self.assertTrue(kinds.isdisjoint({"islands", "holes", "no_name", "duplicate_name"}), kinds)
        # names, values and grid are those of before
        one, other = (json.loads(self.succeed("info", file, "--json").stdout) for file in (labels, mended))
        for key in ("dims", "spacing_mm", "origin_lps_mm", "direction_rows"):
            self.assertEqual(one[key], other[key])
        self.assertEqual([(s["id"], s["name"], s["colour"]) for s in one["labels"]],
                         [(s["id"], s["name"], s["colour"]) for s in other["labels"]])
        # a second time nothing is left to mend
        again = self.lint(mended, "--fix", self.folder / "again.seg.nrrd", code=cli.LIMIT)
        self.assertIn("nothing to repair", again.stdout)

    def test_what_cannot_be_done_is_one_error(self):
        link = self.folder / "link.seg.nrrd"
        os.symlink(self.labels, link)
        before = self.labels.read_bytes()
        for code, arguments, says in (
                (cli.USAGE, [self.labels, "--fix", self.labels], self.labels.name),
                (cli.USAGE, [self.labels, "--fix", link], "link.seg.nrrd"),
                (cli.USAGE, [self.labels, "--page", self.labels], self.labels.name),
                (cli.USAGE, [self.labels, "--page", self.folder / "one", "--json", self.folder / "one"], "give each output a different file"),
                (cli.USAGE, [self.labels, "--tool-radius", "0"], "--tool-radius"),
                (cli.USAGE, ["knee-phantom", self.scan], "a segmentation needs a scan"),
                (cli.OUTPUT, [self.labels, "--fix", self.folder / "none" / "new.nrrd"], "none"),
                (cli.BAD_INPUT, [self.folder / "missing.nrrd"], "missing.nrrd")):
            with self.subTest(arguments):
                self.expect_error(code, "lint", *arguments, message=says)
        self.assertEqual(self.labels.read_bytes(), before)
        self.assertEqual([path.name for path in self.folder.iterdir()], ["link.seg.nrrd"])


if __name__ == "__main__":
    cli.share_prepared_models()
    cli.main()
