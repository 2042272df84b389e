#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include "base/test_files.h"
#include "base/test_seed.h"
#include "palpate/base/file.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;
using test::write_text;
using ::testing::HasSubstr;

GridGeometry grid_of_masks(const std::array<int, 3>& dims = {23, 31, 17}) {
  GridGeometry grid;
  grid.dims = dims;
  grid.spacing_mm = {0.7, 0.9, 1.3};
  grid.direction = Eigen::AngleAxisd(0.3, Eigen::Vector3d(2, 1, -1).normalized()).toRotationMatrix();
  grid.origin = Point<Patient>(12, -40, 7);
  return grid;
}

// random voxels with the given probability
Volume<std::uint8_t> random_mask(std::mt19937& random, double chance, std::uint8_t in = 1,
                                 const GridGeometry& grid = grid_of_masks()) {
  Volume<std::uint8_t> mask(grid);
  std::bernoulli_distribution is_in(chance);
  for (int k = 0; k < mask.geometry().dims[2]; ++k)
    for (int j = 0; j < mask.geometry().dims[1]; ++j)
      for (int i = 0; i < mask.geometry().dims[0]; ++i) mask.at(i, j, k) = is_in(random) ? in : 0;
  return mask;
}

Volume<float> as_floats(const Volume<std::uint8_t>& mask) {
  Volume<float> values(mask.geometry());
  for (int k = 0; k < mask.geometry().dims[2]; ++k)
    for (int j = 0; j < mask.geometry().dims[1]; ++j)
      for (int i = 0; i < mask.geometry().dims[0]; ++i) values.at(i, j, k) = mask.at(i, j, k);
  return values;
}

Result<LabelFile> read_masks(const fs::path& folder, std::vector<std::string>* declared = nullptr) {
  return read_labels(folder, {}, {}, [&](const std::string& warning) {
    if (declared) declared->push_back(warning);
  });
}

TEST(Masks, EachFileOfAFolderIsAStructure) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  // a voxel, a row, a slice, and more than one piece of a read
  for (const std::array<int, 3>& dims : {std::array{23, 31, 17}, std::array{1, 1, 1}, std::array{1, 40, 1},
                                         std::array{33, 29, 1}, std::array{80, 71, 60}}) {
    const GridGeometry grid = grid_of_masks(dims);
    const TemporaryFolder folder;
    // names in order; the last mask covers every voxel, including the first and the last
    const std::vector<std::pair<std::string, Volume<std::uint8_t>>> masks{
        {"femur_left.nii.gz", random_mask(random, 0.02, 1, grid)},
        {"kidney_right.nrrd", random_mask(random, 0.5, 255, grid)},
        {"liver.mha", random_mask(random, 0.1, 1, grid)},
        {"pancreas.nii", random_mask(random, 0, 1, grid)},
        {"spleen.nii.gz", random_mask(random, 1, 1, grid)}};
    for (const auto& [name, mask] : masks) {
      const auto written = name == "liver.mha" ? write_volume(folder / name, as_floats(mask))
                                               : write_volume(folder / name, mask);
      ASSERT_TRUE(written) << written.error().message();
    }
    write_text(folder / "statistics.json", "{}");
    EXPECT_TRUE(is_volume(folder.path()));
    std::vector<std::string> declared;
    const auto labels = read_masks(folder.path(), &declared);
    ASSERT_TRUE(labels) << labels.error().message();
    EXPECT_EQ(labels->header.format, "masks");
    EXPECT_TRUE(labels->header.has_geometry);
    EXPECT_TRUE(labels->labels.geometry().same_grid(grid));
    EXPECT_TRUE(labels->unnamed.empty());
    const auto& segments = labels->labels.segments;
    ASSERT_EQ(segments.size(), masks.size());
    const char* const kExpected[] = {"femur_left", "kidney_right", "liver", "pancreas", "spleen"};
    for (std::size_t n = 0; n < segments.size(); ++n) {
      EXPECT_EQ(segments[n].name, kExpected[n]);
      const Volume<LabelId>& layer = labels->labels.layers[static_cast<std::size_t>(segments[n].layer)];
      const Volume<std::uint8_t>& mask = masks[n].second;
      for (int k = 0; k < mask.geometry().dims[2]; ++k)
        for (int j = 0; j < mask.geometry().dims[1]; ++j)
          for (int i = 0; i < mask.geometry().dims[0]; ++i)
            ASSERT_EQ(layer.at(i, j, k) == segments[n].value, mask.at(i, j, k) != 0)
                << kExpected[n] << " " << i << " " << j << " " << k;
    }
    const std::string all = ::testing::PrintToString(declared);
    if (grid.voxel_count() > 100) {
      EXPECT_THAT(all, HasSubstr("segments overlap in"));
    }
    EXPECT_THAT(all, HasSubstr("pancreas"));
    EXPECT_THAT(all, HasSubstr("1 other file in it is no volume"));
    const auto scan = read_scan(folder.path());
    ASSERT_FALSE(scan);
    EXPECT_THAT(scan.error().message(), HasSubstr("give the scan in it: femur_left.nii.gz, kidney_right"));
  }
}

TEST(Masks, NamesAreAnatomicalWordsOrFromATable) {
  std::mt19937 random(5);
  const TemporaryFolder folder;
  for (const char* name : {"DOE_CANARY_liver.nii.gz", "DOE_CANARY_liver_2.nii.gz", "DOE_CANARY.nii.gz"})
    ASSERT_TRUE(write_volume(folder / name, random_mask(random, 0.1)));
  std::vector<std::string> declared;
  const auto labels = read_masks(folder.path(), &declared);
  ASSERT_TRUE(labels) << labels.error().message();
  ASSERT_EQ(labels->labels.segments.size(), 3u);
  EXPECT_EQ(labels->labels.segments[0].name, "structure 1");
  EXPECT_EQ(labels->labels.segments[1].name, "liver");
  EXPECT_EQ(labels->labels.segments[2].name.find("CANARY"), std::string::npos);
  EXPECT_NE(labels->labels.segments[2].name, "liver");
  EXPECT_THAT(::testing::PrintToString(declared), HasSubstr("--names TABLE"));

  const TemporaryFolder beside;
  const auto table = beside / "names.tsv";
  write_text(table, "value\tname\n1\ttumour\n3\tcyst\n");
  const auto named = read_labels(folder.path(), table);
  ASSERT_TRUE(named) << named.error().message();
  EXPECT_EQ(named->labels.segments[0].name, "tumour");
  EXPECT_EQ(named->labels.segments[2].name, "cyst");
}

TEST(Masks, RejectsFilesThatAreNoMasksByName) {
  std::mt19937 random(7);
  const auto refusal = [&](const std::string& name, const auto& write) {
    const TemporaryFolder folder;
    EXPECT_TRUE(write_volume(folder / "aorta.nii.gz", random_mask(random, 0.1)));
    write(folder / name);
    const auto labels = read_masks(folder.path());
    EXPECT_FALSE(labels) << name;
    if (labels) return std::string();
    EXPECT_THAT(labels.error().where, HasSubstr(name));
    EXPECT_FALSE(labels.error().remedy.empty());
    return labels.error().what;
  };
  const auto volume = [&](const auto& change) {
    return [&, change](const fs::path& file) {
      auto values = as_floats(random_mask(random, 0.1));
      change(values);
      ASSERT_TRUE(write_volume(file, values));
    };
  };
  EXPECT_THAT(refusal("ct.nii.gz", volume([](auto& v) { v.at(1, 2, 3) = -1000; })),
              HasSubstr("a mask cannot have, such as -1000"));
  EXPECT_THAT(refusal("liver.nrrd", volume([](auto& v) { v.at(22, 30, 16) = 0.5F; })),
              HasSubstr("a mask cannot have, such as 0.5"));
  EXPECT_THAT(refusal("liver.mha", volume([](auto& v) { v.at(0, 0, 0) = std::nanf(""); })),
              HasSubstr("a mask cannot have"));
  EXPECT_THAT(refusal("labels.nii.gz", volume([](auto& v) { v.at(5, 5, 5) = 2; })),
              HasSubstr("several values"));
  EXPECT_THAT(refusal("spleen.nii.gz",
                      [&](const fs::path& file) {
                        GridGeometry other = grid_of_masks();
                        other.origin = Point<Patient>(12, -40, 8);
                        ASSERT_TRUE(write_volume(file, Volume<std::uint8_t>(other)));
                      }),
              HasSubstr("a different grid from aorta.nii.gz"));
  EXPECT_THAT(refusal("spleen.nhdr",
                      [&](const fs::path& file) {
                        write_text(file,
                                   "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n"
                                   "data file: spleen.raw\n");
                        write_text(file.parent_path() / "spleen.raw", std::string(8, '\0'));
                      }),
              HasSubstr("voxels in another file"));
}

// no crash: one error that names the file, or a complete read
TEST(Masks, DamagedOnesAreRefused) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const TemporaryFolder folder;
  ASSERT_TRUE(write_volume(folder / "aorta.nii.gz", random_mask(random, 0.1)));
  ASSERT_TRUE(write_volume(folder / "liver.nii.gz", random_mask(random, 0.1)));
  const auto whole = read_file(folder / "liver.nii.gz", 1 << 24);
  ASSERT_TRUE(whole);
  int refused = 0;
  for (int n = 0; n < 40; ++n) {
    std::string bytes = *whole;
    if (n % 2 == 0)
      bytes.resize(random() % bytes.size());
    else
      bytes[random() % bytes.size()] ^= static_cast<char>(1 << random() % 8);
    write_text(folder / "liver.nii.gz", bytes);
    const auto labels = read_masks(folder.path());
    if (labels) {
      EXPECT_EQ(labels->labels.segments.size(), 2u);
      continue;
    }
    ++refused;
    EXPECT_THAT(labels.error().where, HasSubstr("liver.nii.gz"));
    EXPECT_EQ(labels.error().kind, ErrorKind::kBadInput);
  }
  EXPECT_GE(refused, 20);
}

// values are scaled as everywhere
TEST(Masks, OfScaledValuesTheMaskIsTheSame) {
  std::mt19937 random(8);
  const TemporaryFolder folder;
  ASSERT_TRUE(write_volume(folder / "liver.nii", random_mask(random, 0.1)));
  ASSERT_TRUE(write_volume(folder / "spleen.nii", random_mask(random, 0.1)));
  const auto plain = read_masks(folder.path());
  ASSERT_TRUE(plain) << plain.error().message();
  for (const auto& [slope, intercept, is_mask] :
       {std::tuple(7.F, 0.F, true), std::tuple(-3.F, 3.F, true), std::tuple(0.5F, 0.F, false)}) {
    auto bytes = read_file(folder / "liver.nii", 1 << 20);
    ASSERT_TRUE(bytes);
    // scl_slope and scl_inter of NIfTI-1
    std::memcpy(bytes->data() + 112, &slope, sizeof slope);
    std::memcpy(bytes->data() + 116, &intercept, sizeof intercept);
    const TemporaryFolder scaled;
    write_text(scaled / "liver.nii", *bytes);
    fs::copy_file(folder / "spleen.nii", scaled / "spleen.nii");
    const auto labels = read_masks(scaled.path());
    ASSERT_EQ(labels.ok(), is_mask) << slope;
    if (!is_mask) continue;
    std::size_t in = 0, of_plain = 0;
    const auto count = [](const LabelFile& file) { return segment_statistics(file.labels).front().voxels; };
    in = count(*labels);
    of_plain = count(*plain);
    // the former zeros are then the structure
    EXPECT_EQ(in, slope > 0 ? of_plain : grid_of_masks().voxel_count() - of_plain);
  }
}

TEST(Masks, IgnoresSystemFilesAndOutsideLinks) {
  std::mt19937 random(9);
  const TemporaryFolder folder, elsewhere;
  ASSERT_TRUE(write_volume(folder / "liver.nii.gz", random_mask(random, 0.1)));
  write_text(folder / "._liver.nii.gz", "of macOS");
  EXPECT_FALSE(is_volume(folder.path())) << "one volume is none";
  ASSERT_TRUE(write_volume(folder / "spleen.nii.gz", random_mask(random, 0.1)));
  write_text(folder / "._spleen.nii.gz", "of macOS");
  const auto labels = read_masks(folder.path());
  ASSERT_TRUE(labels) << labels.error().message();
  EXPECT_EQ(labels->labels.segments.size(), 2u);

  // a volume of two files is not a folder of masks
  const TemporaryFolder pair;
  for (const char* name : {"knee.hdr", "knee.img"}) write_text(pair / name, "");
  EXPECT_FALSE(is_volume(pair.path()));

  const TemporaryFolder links;
  for (const char* name : {"liver.nii.gz", "spleen.nii.gz"}) fs::create_symlink(folder / name, links / name);
  EXPECT_FALSE(is_volume(links.path()));
  const auto refused = read_masks(links.path());
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message(), HasSubstr("liver.nii.gz, spleen.nii.gz"));
  // links within the folder are treated as files
  for (const char* name : {"heart.nii.gz", "aorta.nii.gz"}) fs::create_symlink("liver.nii.gz", folder / name);
  const auto linked = read_masks(folder.path());
  ASSERT_TRUE(linked) << linked.error().message();
  EXPECT_EQ(linked->labels.segments.size(), 4u);
}

TEST(Masks, ReadingThemCanBeInterrupted) {
  std::mt19937 random(9);
  const TemporaryFolder folder;
  for (const char* name : {"liver.nii.gz", "spleen.nii.gz"})
    ASSERT_TRUE(write_volume(folder / name, random_mask(random, 0.1, 1, grid_of_masks({80, 71, 60}))));
  // immediately, and midway
  for (const bool at_once : {true, false}) {
    std::atomic<bool> stop{at_once};
    const Progress progress([&](std::string_view, double) { stop = true; }, &stop);
    const auto labels = read_labels(folder.path(), {}, progress);
    ASSERT_FALSE(labels) << at_once;
    EXPECT_EQ(labels.error().kind, ErrorKind::kInterrupted);
  }
}

}  // namespace
}  // namespace palpate
