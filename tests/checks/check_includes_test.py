#!/usr/bin/env python3
"""tools/check_includes must flag each wrong include of a small bad tree, and nothing of a good one."""

import pathlib
import subprocess
import tempfile
import unittest

TOOL = pathlib.Path(__file__).resolve().parents[2] / "tools" / "check_includes"


def run(files):
    """Lays out {path: text} in a new folder; returns (exit code, lines printed)."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            file = pathlib.Path(folder) / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
        result = subprocess.run([TOOL, folder], stdout=subprocess.PIPE, text=True, check=False)
    return result.returncode, result.stdout.splitlines()


GOOD = {
    "include/palpate/base/result.h": "#include <optional>\n",
    "include/palpate/volume/volume.h": '#include "palpate/base/result.h"\n#include <Eigen/Core>\n',
    "include/palpate/session/session.h": '#include "palpate/volume/volume.h"\n',
    "include/palpate/device/telemetry.h": "#include <array>\n",
    "include/palpate/base/file.h": '#include "palpate/base/result.h"\n',
    "src/files/volume_io/formats/nrrd.cc": '#include <itkImage.h>\n#include "palpate/base/file.h"\n#include "palpate/volume/volume.h"\n',
    "src/core/servo/tick.cc": '#include "palpate/device/telemetry.h"\n#include "servo/tick.h"\n#include <sys/mman.h>\n',
    "src/core/volume/volume_test.cc": '#include <gtest/gtest.h>\n#include "palpate/session/session.h"\n',
    "src/core/volume/test_grids.h": "#include <gmock/gmock.h>\n",
    "src/files/volume_io/formats/nrrd_test.cc": '#include "volume/test_grids.h"\n#include "volume_io/formats/nrrd.h"\n',
    "tests/servo/two_test.cc": '#include "servo/test_loop.h"\n',
    "apps/palpate/verb.h": '#include <CLI/CLI.hpp>\n#include "palpate/base/result.h"\n',
    "apps/palpate/info.cc": '#include "verb.h"\n#include "palpate/session/session.h"\n',
    "src/viewer/server/CMakeLists.txt": "palpate_module(server_messages\n  SOURCES pose.cc wire.h\n          request.cc\n  LINK palpate_base)\n",
    "src/viewer/server/pose.cc": '#include "server/pose.h"\n#include "server/wire.h"\n#include <nlohmann/json.hpp>\n#include <vector>\n',
    "src/viewer/server/network.cc": '#include <boost/asio.hpp>\n#include <openssl/ssl.h>\n#include "server/pose.h"\n',
    "include/palpate.h": "#include <stdint.h>\n",
    "src/bindings/c/model.cc": '#include "c/guard.h"\n#include "palpate.h"\n#include "palpate/base/result.h"\n',
    "bench/gaussian_bench.cc": '#include <itkImage.h>\n#include <CLI/CLI.hpp>\n',
}

# (path, include line, a word of the complaint)
BAD = [
    ("src/core/base/a.cc", '#include "palpate/volume/volume.h"', "may not know 'volume'"),
    ("src/run/session/a.cc", '#include "servo/tick.h"', "is private to 'servo'"),
    ("src/core/volume/a.cc", '#include "servo/test_loop.h"', "is private to 'servo'"),
    ("src/core/volume/a.cc", '#include "palpate/session/session.h"', "may not know 'session'"),
    ("src/core/volume/a.cc", '#include "palpate/device/telemetry.h"', "may not know 'device'"),
    ("src/core/volume/a.cc", '#include "palpate/absent.h"', "no public header"),
    ("src/core/volume/a.cc", "#include <itkImage.h>", "may not include ITK"),
    ("src/core/volume/a_test.cc", "#include <itkImage.h>", "may not include ITK"),
    ("src/run/session/a_test.cc", '#include "servo/tick.h"', "is private to 'servo'"),
    ("src/run/session/a.cc", "#include <hdf5.h>", "may not include HDF5"),
    ("src/run/session/a.cc", "#include <toml++/toml.h>", "may not include toml++"),
    ("src/run/session/a.cc", "#include <curl/curl.h>", "may not include curl"),
    ("src/files/recording/a.cc", "#include <openssl/evp.h>", "may not include OpenSSL"),
    ("src/core/volume/a.cc", "#include <tbb/parallel_for.h>", "may not include TBB"),
    ("src/core/volume/a.cc", "#  include <execution>", "may not include TBB"),
    ("src/core/base/a.cc", "#include <Eigen/Core>", "may not include Eigen"),
    ("src/data/scene/a.cc", "#include <nlohmann/json.hpp>", "may not include nlohmann"),
    ("src/core/volume/a.cc", "#include <gtest/gtest.h>", "may not include GoogleTest"),
    ("src/core/volume/test_grids.cc", "#include <gtest/gtest.h>", "may not include GoogleTest"),
    ("src/core/volume/a.cc", "#include <boost/asio.hpp>", "may not include Boost"),
    ("src/viewer/server/hub.cc", "#include <boost/asio.hpp>", "may not include Boost"),
    ("src/viewer/server/hub.h", "#include <boost/asio.hpp>", "may not include Boost"),
    ("src/viewer/server/hub_test.cc", "#include <boost/asio.hpp>", "may not include Boost"),
    ("src/viewer/server/pose.cc", "#include <boost/asio.hpp>", "may not include Boost"),
    ("src/viewer/server/pose.h", "#include <openssl/evp.h>", "may not include OpenSSL"),
    ("src/viewer/server/wire.h", '#include "server/network.h"', "is not of 'server_messages'"),
    ("src/viewer/server/request.cc", "#include <zlib.h>", "'server_messages' may not include zlib"),
    ("src/core/volume/a.cc", '#include "../servo/tick.h"', "'..'"),
    ("src/core/volume/a.cc", "#include <palpate/base/result.h>", "is ours"),
    ("src/core/volume/a.cc", '#include "test_grids.h"', 'write it as "volume/test_grids.h"'),
    ("include/palpate/volume/volume.h", '#include "base/file.h"', "may not show the inside"),
    ("apps/palpate/a.cc", '#include "base/file.h"', "not the inside of 'base'"),
    ("tests/a.cc", '#include "servo/tick.h"', "not the inside of 'servo'"),
    ("apps/palpate/a.cc", "#include <itkImage.h>", "may not include ITK"),
    ("src/core/volume/a.cc", '#include "palpate.h"', "may not know 'c'"),
    ("include/palpate.h", '#include "palpate/server/site.h"', "no public header"),
    ("src/newmodule/a.cc", "#include <vector>", "stands in no module"),
]


class CheckIncludes(unittest.TestCase):
    def test_good_tree(self):
        self.assertEqual(run(GOOD), (0, []))

    def test_each_bad_include(self):
        for path, line, complaint in BAD:
            with self.subTest(path=path, line=line):
                code, lines = run({**GOOD, path: "// one\n" + line + "\n"})
                self.assertEqual(code, 1)
                self.assertEqual(len(lines), 1, lines)
                place = f"{path}:1:" if "no module" in complaint else f"{path}:2:"
                self.assertTrue(lines[0].startswith(place), lines)
                self.assertIn(complaint, lines[0])

    def test_a_part_without_sources_is_a_fault(self):
        code, lines = run({**GOOD, "src/viewer/server/CMakeLists.txt": "palpate_module(server SOURCES hub.cc)\n"})
        self.assertEqual((code, lines), (1, ["src/viewer/server/CMakeLists.txt:1: lists no sources of server_messages"]))

    def test_empty_tree_is_a_fault(self):
        self.assertEqual(run({"README.md": ""})[0], 1)


if __name__ == "__main__":
    unittest.main()
