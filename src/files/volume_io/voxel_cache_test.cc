#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>
#include <string>

#include "base/test_files.h"
#include "palpate/cache/cache.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate {
namespace {

class CachedVoxelsTest : public ::testing::Test {
 protected:
  CachedVoxelsTest() { set_cache({folder_ / "cache"}); }
  ~CachedVoxelsTest() override { set_cache({}); }

  // records whether voxels were decompressed, by the reported progress
  Progress progress() {
    unpacked_ = false;
    return Progress([this](std::string_view stage, double) { unpacked_ = unpacked_ || stage == "reading"; },
                    nullptr);
  }
  Result<LabelFile> labels(const std::filesystem::path& file) {
    return read_labels(file, {}, progress(), {}, AmbiguousLabels::kReject, VoxelCaching::kOn);
  }
  Result<ScanFile> scan(const std::filesystem::path& file) {
    return read_scan(
        file, progress(), [this](const std::string& text) { warnings_.push_back(text); }, VoxelCaching::kOn);
  }

  test::TemporaryFolder folder_;
  bool unpacked_ = false;
  std::vector<std::string> warnings_;
};

GridGeometry stored_grid() {
  GridGeometry grid;
  grid.dims = {9, 8, 7};
  grid.spacing_mm = {0.5, 0.5, 2};
  return grid;
}

LabelMap two_layers() {
  LabelMap map;
  map.layers.assign(2, Volume<LabelId>(stored_grid()));
  map.layers[0].at(1, 2, 3) = 1;
  map.layers[0].at(2, 2, 3) = 2;
  map.layers[1].at(1, 2, 3) = 1;
  map.segments = {{1, "a", {}, 0, 1}, {2, "b", {}, 0, 2}, {3, "c", {}, 1, 1}};
  return map;
}

TEST_F(CachedVoxelsTest, RestoresLayersAndFileMetadata) {
  ASSERT_TRUE(write_labels(folder_ / "a.seg.nrrd", two_layers()).ok());
  const auto first = labels(folder_ / "a.seg.nrrd");
  ASSERT_TRUE(first.ok()) << first.error().message();
  EXPECT_TRUE(unpacked_);
  const auto second = labels(folder_ / "a.seg.nrrd");
  ASSERT_TRUE(second.ok());
  EXPECT_FALSE(unpacked_);
  ASSERT_EQ(second->labels.layers.size(), 2u);
  for (std::size_t layer = 0; layer < 2; ++layer)
    EXPECT_EQ(second->labels.layers[layer].voxels(), first->labels.layers[layer].voxels());
  ASSERT_EQ(second->labels.segments.size(), 3u);
  EXPECT_EQ(second->labels.segments[2].name, "c");
}

TEST_F(CachedVoxelsTest, SegmentsThatTheFileDoesNotNameAreFoundAgain) {
  LabelMap map = two_layers();
  map.layers.pop_back();
  ASSERT_TRUE(write_labels(folder_ / "a.nii.gz", map).ok());
  const auto first = labels(folder_ / "a.nii.gz");
  const auto second = labels(folder_ / "a.nii.gz");
  ASSERT_TRUE(first.ok() && second.ok());
  EXPECT_FALSE(unpacked_);
  EXPECT_EQ(second->unnamed, first->unnamed);
  EXPECT_EQ(second->unnamed.size(), 2u);
}

TEST_F(CachedVoxelsTest, ARenamedStructureIsTheSameVoxelsAndOthersAreNot) {
  LabelMap map = two_layers();
  ASSERT_TRUE(write_labels(folder_ / "a.seg.nrrd", map).ok());
  ASSERT_TRUE(labels(folder_ / "a.seg.nrrd").ok());
  map.segments[0].name = "somebody else's";
  ASSERT_TRUE(write_labels(folder_ / "b.seg.nrrd", map).ok());
  const auto renamed = labels(folder_ / "b.seg.nrrd");
  EXPECT_FALSE(unpacked_);
  EXPECT_EQ(renamed->labels.segments[0].name, "somebody else's");
  map.layers[1].at(4, 4, 4) = 1;
  ASSERT_TRUE(write_labels(folder_ / "b.seg.nrrd", map).ok());
  const auto other = labels(folder_ / "b.seg.nrrd");
  EXPECT_TRUE(unpacked_);
  EXPECT_EQ(other->labels.layers[1].at(4, 4, 4), 1);
}

TEST_F(CachedVoxelsTest, KeysIncludeTheInterpretationOfTheBytes) {
  ASSERT_TRUE(write_volume(folder_ / "a.nrrd", Volume<std::int16_t>(stored_grid(), 3)).ok());
  ASSERT_TRUE(scan(folder_ / "a.nrrd").ok());
  std::string bytes = test::bytes_of_file(folder_ / "a.nrrd");
  const auto at = bytes.find("endian: little");
  ASSERT_NE(at, std::string::npos);
  test::write_text(folder_ / "b.nrrd", bytes.replace(at, 14, "endian: big"));
  const auto other = scan(folder_ / "b.nrrd");
  ASSERT_TRUE(other.ok()) << other.error().message();
  EXPECT_TRUE(unpacked_);
  EXPECT_EQ(other->scan.at(0, 0, 0), 768.f);
  // a cached scan is not a label map
  ASSERT_TRUE(labels(folder_ / "a.nrrd").ok());
  EXPECT_TRUE(unpacked_);
}

TEST_F(CachedVoxelsTest, ScansComeBackBitForBitWithTheirWarning) {
  Volume<float> whole(stored_grid()), fractions(stored_grid());
  for (std::size_t n = 0; n < whole.voxels().size(); ++n) {
    whole.voxels()[n] = static_cast<float>(static_cast<int>(n) - 200);
    fractions.voxels()[n] = 0.25f * static_cast<float>(n);
  }
  fractions.voxels()[5] = -0.f;
  fractions.voxels()[6] = std::numeric_limits<float>::quiet_NaN();
  for (const auto& [name, volume] : {std::pair{"whole.nii.gz", &whole}, {"fractions.nii.gz", &fractions}}) {
    ASSERT_TRUE(write_volume(folder_ / name, *volume).ok());
    warnings_.clear();
    const auto first = scan(folder_ / name);
    ASSERT_TRUE(first.ok()) << first.error().message();
    EXPECT_TRUE(unpacked_);
    const auto warned = warnings_;
    warnings_.clear();
    const auto second = scan(folder_ / name);
    ASSERT_TRUE(second.ok());
    EXPECT_FALSE(unpacked_);
    EXPECT_EQ(warnings_, warned);
    for (std::size_t n = 0; n < whole.voxels().size(); ++n) {
      EXPECT_EQ(second->scan.voxels()[n], first->scan.voxels()[n]);
      EXPECT_EQ(std::signbit(second->scan.voxels()[n]), std::signbit(first->scan.voxels()[n]));
    }
  }
}

TEST_F(CachedVoxelsTest, DamagedFilesAreNeverCached) {
  ASSERT_TRUE(write_labels(folder_ / "a.seg.nrrd", two_layers()).ok());
  std::string bytes = test::bytes_of_file(folder_ / "a.seg.nrrd");
  bytes.resize(bytes.size() - 12);
  test::write_text(folder_ / "a.seg.nrrd", bytes);
  EXPECT_FALSE(labels(folder_ / "a.seg.nrrd").ok());
  EXPECT_FALSE(labels(folder_ / "a.seg.nrrd").ok());
  EXPECT_EQ(cache_contents().entries, 0u);
}

TEST_F(CachedVoxelsTest, CachingIsOptIn) {
  ASSERT_TRUE(write_labels(folder_ / "a.seg.nrrd", two_layers()).ok());
  ASSERT_TRUE(read_labels(folder_ / "a.seg.nrrd").ok());
  EXPECT_EQ(cache_contents().entries, 0u);
}

}  // namespace
}  // namespace palpate
