#include <gtest/gtest.h>

#include <random>

#include "base/test_files.h"
#include "palpate/volume_io/volume_io.h"
#include "reader/test_confine.h"
#include "volume/test_grids.h"

namespace palpate {
namespace {

using test::bytes_of_file;
using test::TemporaryFolder;
using test::write_text;

constexpr const char* kNames[] = {"v.nrrd", "v.nii", "v.nii.gz", "v.mha", "v.seg.nrrd"};

// one valid file of each format; noise, so that compression does not hide a truncation
void write_good(const TemporaryFolder& folder) {
  std::mt19937 random(3);
  const GridGeometry g = testing::awkward_grids({9, 8, 10})[1];
  Volume<std::uint16_t> volume(g);
  for (auto& v : volume.voxels()) v = static_cast<std::uint16_t>(random() % 3000);
  LabelMap labels;
  labels.layers.push_back(volume);
  labels.layers.push_back(volume);
  labels.segments = {{5, "femur", {}, 0, 5}, {6, "tibia", {}, 1, 6}};
  for (const std::string name : kNames)
    ASSERT_TRUE(name == "v.seg.nrrd" ? write_labels(folder / name, labels)
                                     : write_volume(folder / name, volume));
}

// the confined process is a safeguard for unknown faults: none of these inputs may trigger it
void expect_understood(const Error& error) {
  EXPECT_FALSE(error.what.empty());
  EXPECT_EQ(error.what.find("its reader"), std::string::npos) << error.message();
}

TEST(DamagedFiles, ACutAnywhereIsAnErrorNeverZeros) {
  const TemporaryFolder folder;
  write_good(folder);
  for (const std::string name : kNames) {
    const std::string whole = bytes_of_file(folder / name);
    for (std::size_t size = 0; size < whole.size(); size += 1 + size / 15) {
      write_text(folder / ("cut-" + name), whole.substr(0, size));
      const auto labels = read_labels(folder / ("cut-" + name));
      ASSERT_FALSE(labels) << name << " cut to " << size << " of " << whole.size() << " bytes";
      expect_understood(labels.error());
    }
  }
}

TEST(DamagedFiles, ErrorStatesTheNumberOfSlices) {
  const TemporaryFolder folder;
  write_good(folder);
  const std::string whole = bytes_of_file(folder / "v.nii");
  const std::size_t slice = 9 * 8 * 2;
  write_text(folder / "cut.nii", whole.substr(0, whole.size() - 2 * slice - slice / 2));
  const auto scan = read_scan(folder / "cut.nii");
  ASSERT_FALSE(scan);
  EXPECT_EQ(scan.error().what, "the voxel data end after 7 of 10 slices");
  EXPECT_TRUE(read_header(folder / "cut.nii")) << "the header is whole";
}

// flipped, inserted and removed bytes: a volume of the promised size or an error, never a crash
TEST(DamagedFiles, RandomDamageNeverCrashes) {
  const unsigned seed = 20240601;
  // starting a process takes long in a sanitized program
  const std::size_t rounds = reader::sanitized() ? 50 : 200;
  std::mt19937 random(seed);
  const TemporaryFolder folder;
  write_good(folder);
  std::size_t errors = 0, read = 0;
  for (const std::string name : kNames) {
    const std::string whole = bytes_of_file(folder / name);
    // mostly in the header, where damage has the largest effect
    const std::size_t header = std::min<std::size_t>(whole.size(), 500);
    for (std::size_t round = 0; round < rounds; ++round) {
      std::string bytes = whole;
      for (unsigned n = 1 + random() % 4; n > 0; --n) {
        const std::size_t at = random() % (round % 4 == 0 ? bytes.size() : header);
        const char byte =
            static_cast<char>(random() % 3 == 0 ? random() % 256 : "0123456789-. \n()=:,nan"[random() % 22]);
        if (random() % 3 == 0)
          bytes.insert(at, 1 + random() % 12, byte);
        else if (random() % 3 == 0)
          bytes.erase(at, 1 + random() % 12);
        else
          bytes[at] = byte;
      }
      SCOPED_TRACE("seed " + std::to_string(seed) + ", " + name + ", round " + std::to_string(round));
      const auto file = write_text(folder / ("bad-" + name), bytes);
      // damaged labels may look like a scan
      const auto labels = read_labels(file, {}, {}, {}, AmbiguousLabels::kWarn);
      ++(labels ? read : errors);
      if (!labels) {
        expect_understood(labels.error());
        continue;
      }
      for (const auto& layer : labels->labels.layers)
        EXPECT_EQ(layer.voxels().size(), labels->labels.geometry().voxel_count());
      EXPECT_GT(labels->labels.geometry().voxel_volume_mm3(), 0);
      EXPECT_TRUE(labels->labels.geometry().origin.all_finite());
    }
  }
  EXPECT_GT(errors, rounds * 3 / 2);
  EXPECT_GT(read, rounds / 8);
}

std::string promise(const std::string& sizes, const std::string& encoding, const std::string& data) {
  return "NRRD0004\ntype: uint8\ndimension: 3\nspace: LPS\nsizes: " + sizes +
         "\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\nencoding: " + encoding +
         "\n\n" + data;
}

// nothing is allocated because of a header alone
TEST(DamagedFiles, APromiseThatTheFileCannotKeepIsAnErrorBeforeMemoryIsTaken) {
  const TemporaryFolder folder;
  const std::string some(300, 'x');
  for (const std::string encoding : {"raw", "gzip", "bzip2", "ascii", "hex"})
    for (const std::string sizes :
         {"4000 4000 4000", "2000000000 2000000000 2000000000", "9223372036854775807 1 1", "0 1 1", "-1 1 1",
          "2 2 -9223372036854775808"}) {
      const auto file = write_text(folder / "p.nrrd", promise(sizes, encoding, some));
      EXPECT_FALSE(read_scan(file)) << encoding << " " << sizes;
      EXPECT_FALSE(read_labels(file)) << encoding << " " << sizes;
    }
}

TEST(DamagedFiles, SurplusVoxelsAreAnError) {
  const TemporaryFolder folder;
  EXPECT_TRUE(read_scan(write_text(folder / "a.nrrd", promise("2 2 1", "ascii", "1 2 3 4\n"))));
  EXPECT_FALSE(read_scan(write_text(folder / "b.nrrd", promise("2 2 1", "ascii", "1 2 3 4 5\n"))));
  EXPECT_FALSE(read_scan(write_text(folder / "c.nrrd", promise("2 2 1", "ascii", "1 2 3 4 x\n"))));
  EXPECT_FALSE(read_scan(write_text(folder / "d.nrrd", promise("2 2 1", "ascii", "1 2 x 4\n"))));
  EXPECT_FALSE(read_scan(write_text(folder / "e.nrrd", promise("2 2 1", "ascii", "1 2 256 4\n"))));
  EXPECT_FALSE(read_scan(write_text(folder / "f.nrrd", promise("2 2 1", "raw", "abcde"))));
  EXPECT_FALSE(read_scan(write_text(folder / "g.nrrd", promise("2 2 1", "hex", "01020304 05"))));
  EXPECT_FALSE(read_scan(write_text(folder / "h.nrrd", promise("2 2 1", "hex", "0102030g"))));
}

TEST(DamagedFiles, AxesInOnePlaneAreAnError) {
  const TemporaryFolder folder;
  std::string flat = promise("2 2 1", "ascii", "1 2 3 4");
  flat.replace(flat.find("(0,0,1)"), 7, "(1,1,0)");
  EXPECT_FALSE(read_scan(write_text(folder / "f.nrrd", flat)));
  std::string null = promise("2 2 1", "ascii", "1 2 3 4");
  null.replace(null.find("(0,0,1)"), 7, "(0,0,0)");
  EXPECT_FALSE(read_scan(write_text(folder / "n.nrrd", null)));
}

}  // namespace
}  // namespace palpate
