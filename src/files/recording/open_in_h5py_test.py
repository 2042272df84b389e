"""Opens recordings with h5py and holds them against docs/reference/: the layout, the flags, the examples.

usage: open_in_h5py_test.py RECORDING_EXAMPLE PAGE...
"""

import os
import re
import subprocess
import sys
import tempfile
import unittest

try:
    import h5py
    import numpy
except ImportError as error:
    print(f"python3-h5py is missing: {error}")
    # a skip, which is a failure where everything must be there
    sys.exit(1 if os.environ.get("CI") == "true" else 77)

EXAMPLE, *PAGES = sys.argv[1:]
ROWS = 2500


def text_of_pages():
    text = ""
    for page in PAGES:
        with open(page, encoding="utf-8") as file:
            text += file.read()
    return text


def rows_of_tables(prefix):
    """Cells of every table row of the pages whose first cell is `prefix...`, without back quotes."""
    for line in text_of_pages().splitlines():
        cells = [cell.strip().strip("`") for cell in line.strip().strip("|").split(" | ")]
        if line.startswith("| `" + prefix):
            yield cells


def python_examples():
    """Those of any recording: one that has a line `before:` is of a run of its own, and docs.blocks runs it."""
    return re.findall(r"(?<!-->\n)```python\n(.*?)```", text_of_pages(), re.DOTALL)


def type_name(data_set_or_attribute):
    dtype = data_set_or_attribute.dtype
    return "text" if dtype.kind == "S" else dtype.name


def column_shape(shape, row_dimension):
    """The pages' way to write a shape."""
    text = str(list(shape))
    return text.replace(str(row_dimension), "N", 1) if shape else "one"


class OpenInH5py(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.file = os.path.join(self.folder.name, "run.h5")

    def write(self):
        subprocess.run([EXAMPLE, "write", self.file], check=True)
        return h5py.File(self.file, "r")

    def test_every_data_set_is_documented(self):
        documented = {}
        for name, shape, kind, unit, frame, description in rows_of_tables("/"):
            for device in (0, 1):
                documented[name.replace("deviceD", f"device{device}")] = (shape, kind, unit, frame, description)
        found = {}
        with self.write() as file:

            def visit(name, item):
                if not isinstance(item, h5py.Dataset):
                    return
                attributes = {key: value.decode("ascii") for key, value in item.attrs.items()}
                if attributes:
                    self.assertEqual(set(attributes), {"unit", "frame", "description"}, name)
                few = name.startswith(("structures/", "events/")) or name == "summary/trouble"
                rows = 2 if few else ROWS
                found["/" + name] = (
                    column_shape(item.shape, rows),
                    type_name(item),
                    attributes.get("unit", "-"),
                    attributes.get("frame", "-"),
                    attributes.get("description"),
                )

            file.visititems(visit)
        self.assertEqual(set(found), set(documented))
        for name, (*layout, description) in found.items():
            self.assertEqual(layout, list(documented[name][:4]), name)
            if description is not None:
                # where there are bits, another page lists them
                meaning, bits, _ = documented[name][4].partition(" ([bits](")
                self.assertEqual(description.rpartition(": ")[0] if bits else description, meaning, name)

    def test_every_bit_is_documented(self):
        """The table of bits holds what the descriptions of the columns list, by value and by name."""
        columns = {
            "flags": "device0/flags",
            "switches": "ticks/switches",
            "status": "device0/status",
            "changed": "events/changed",
        }
        with self.write() as file:
            for of, column in columns.items():
                documented = [f"{value} {name}" for _, value, name, *_ in rows_of_tables(of + "` | ")]
                listed = file[column].attrs["description"].decode("ascii").split(": ")[-1].split(", ")
                self.assertEqual(documented, listed)
                self.assertEqual([int(bit.split()[0]) for bit in listed], [1 << n for n in range(len(listed))])

    def test_every_attribute_is_documented(self):
        documented = {name: kind for name, kind, _ in rows_of_tables("@")}
        with self.write() as file:
            found = {}
            for prefix, group in (("@", file), ("@header/", file["header"])):
                for name in group.attrs:
                    attribute = group.attrs.get_id(name)
                    found[prefix + name] = "text" if attribute.dtype.kind == "S" else attribute.dtype.name
                    self.assertEqual(attribute.shape, ())
            for name in ("ticks", "device0", "device1", "structures", "events", "summary"):
                self.assertEqual(len(file[name].attrs), 0)
        self.assertEqual(found, documented)

    def test_only_plain_types(self):
        """Numbers and texts of fixed length: what MATLAB's h5read and h5readatt open."""
        with self.write() as file:

            def visit(name, item):
                kinds = [item.dtype] if isinstance(item, h5py.Dataset) else []
                kinds += [item.attrs.get_id(key).dtype for key in item.attrs]
                for dtype in kinds:
                    self.assertIn(dtype.kind, "uifS", name)
                    self.assertIsNone(h5py.check_vlen_dtype(dtype), name)
                    self.assertIsNone(h5py.check_enum_dtype(dtype), name)

            file.visititems(visit)

    def test_values(self):
        with self.write() as file:
            time_s = file["ticks/time_s"][:]
            numpy.testing.assert_array_equal(time_s, numpy.arange(ROWS) / 1000)
            numpy.testing.assert_array_equal(file["ticks/tick"][:], numpy.arange(ROWS))
            # the example touches a plane of 0.5 N/mm, limited to 1.4 N
            for device in ("device0", "device1"):
                depth_mm = file[device]["depth_mm"][:]
                force_N = file[device]["force_N"][:]
                expected = numpy.clip(0.5 * depth_mm, 0, 1.4)
                numpy.testing.assert_allclose(force_N[:, 2], expected, rtol=0, atol=1e-12)
                numpy.testing.assert_array_equal(depth_mm, -file[device]["tip_world_mm"][:, 2])
                self.assertTrue((file[device]["label"][:] == numpy.where(depth_mm > 0, 7, 0)).all())
            header = file["header"].attrs
            self.assertEqual(header["scene_title"].decode(), "Knee, ünïcode")
            self.assertEqual(header["rate_hz"], 1000)
            self.assertEqual(header["seed"], 2**64 - 1)
            self.assertEqual(header["clock"].decode(), "real")
            self.assertEqual(header["scheduler"].decode(), "SCHED_FIFO 80")
            self.assertEqual(file["ticks/lateness_s"][99], 2e-3)
            self.assertEqual(file["device1/peak_force_N"][7], 8.5)
            self.assertTrue(numpy.isnan(file["device0/gripper_rad"][:]).all())
            names = [name.decode() for name in file["structures/name"][:]]
            self.assertEqual(names, ["femur", "knorpel-größe"])
            self.assertEqual(file["structures/label"][:].tolist(), [7, 65535])
            self.assertEqual(file["structures/colour"][:].tolist(), [[221, 200, 170], [0, 255, 1]])
            self.assertTrue(file["header/script"][()].decode().startswith("[[step]]\n"))
            self.assertEqual(file["summary/complete"][()], 1)
            self.assertEqual(file["summary/ticks"][()], ROWS)
            self.assertEqual(file["summary/clamped"][()], 1000)
            self.assertEqual(file["summary/skipped"][()], 1021)
            trouble = [sentence.decode() for sentence in file["summary/trouble"][:]]
            events = file["events"]
            self.assertEqual(events["tick"][:].tolist(), [3, 7])
            self.assertEqual(events["kind"][:].tolist(), [0, 1])
            self.assertEqual(events["requested_by"][:].tolist(), [3, 2])
            self.assertEqual(events["viewer"][:].tolist(), [2, 0])
            self.assertEqual(events["number"][:].tolist(), [4, 1])
            self.assertEqual(events["stiffness_N_per_mm"][0], 0.8)
            self.assertEqual(events["changed"][1], 48)
            self.assertEqual(events["max_force_N"][1], 1.25)
            self.assertEqual(events["rotation_target_wxyz"][1].tolist(), [0, 1, 0, 0])
            self.assertEqual(trouble, ["line 3: asked for 2.00 N, felt 1.40 N", "größer"])

    def test_a_killed_one_opens(self):
        killed = subprocess.run([EXAMPLE, "killed", self.file], check=False)
        self.assertLess(killed.returncode, 0)
        with h5py.File(self.file, "r") as file:
            self.assertEqual(file["summary/complete"][()], 0)
            self.assertEqual(file["summary/ticks"][()], 0)
            self.assertEqual(file["summary/trouble"].shape, (0,))
            for group in ("ticks", "device0", "device1"):
                for name, data_set in file[group].items():
                    self.assertEqual(data_set.shape[0], 2400, name)
            numpy.testing.assert_array_equal(file["ticks/time_s"][:], numpy.arange(2400) / 1000)
            for name, data_set in file["events"].items():
                self.assertEqual(data_set.shape[0], 2, name)

    def test_copies_by_other_tools_are_read(self):
        """What h5repack or h5py make of a recording: other chunks, no compression, or other compression."""
        self.write().close()
        for number, options in enumerate(({}, {"chunks": True, "compression": "gzip", "compression_opts": 9})):
            copy = os.path.join(self.folder.name, f"copy{number}.h5")
            with h5py.File(self.file, "r") as file, h5py.File(copy, "w") as target:
                for key in file.attrs:
                    target.attrs.create(key, file.attrs[key], dtype=file.attrs.get_id(key).dtype)
                for group in ("header", "structures", "summary"):
                    file.copy(group, target)
                for group in ("ticks", "device0", "device1", "events"):
                    for name, data_set in file[group].items():
                        target.create_dataset(f"{group}/{name}", data=data_set[...], **options)
            subprocess.run([EXAMPLE, "same", self.file, copy], check=True)

    def test_examples_of_the_pages(self):
        self.write().close()
        examples = python_examples()
        self.assertGreater(len(examples), 1)
        for example in examples:
            subprocess.run([sys.executable, "-c", example], check=True, cwd=self.folder.name, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
