#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <random>

#include "base/test_files.h"
#include "palpate/volume_io/volume_io.h"
#include "volume/test_grids.h"

namespace palpate {
namespace {

using test::TemporaryFolder;
using test::write_text;

template <class T>
Volume<T> random_volume(const GridGeometry& g, double low, double high) {
  std::mt19937 random(11);
  Volume<T> volume(g);
  for (T& v : volume.voxels()) v = static_cast<T>(std::uniform_real_distribution<>(low, high)(random));
  return volume;
}

template <class T>
void expect_round_trip(const Volume<T>& volume, const std::string& type) {
  const bool square =
      (volume.geometry().direction.transpose() * volume.geometry().direction).isIdentity(1e-9);
  for (const char* ending : {".nrrd", ".nii", ".nii.gz", ".mha"}) {
    if (!square && std::string(ending).find("nii") != std::string::npos) continue;
    const TemporaryFolder folder;
    const auto file = folder / (std::string("v") + ending);
    const auto written = write_volume(file, volume);
    ASSERT_TRUE(written) << written.error().message();
    EXPECT_EQ(folder.count(), 1u) << "no temporary is left";
    const auto read = read_scan(file);
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_EQ(read->header.component_type, type);
    EXPECT_TRUE(read->header.has_geometry);
    EXPECT_TRUE(read->scan.geometry().same_grid(volume.geometry(), 1e-4)) << ending;
    EXPECT_EQ(read->scan.geometry().right_handed(), volume.geometry().right_handed());
    for (std::size_t n = 0; n < volume.voxels().size(); ++n)
      ASSERT_EQ(read->scan.voxels()[n], static_cast<float>(volume.voxels()[n])) << ending;
  }
}

TEST(WriteVolume, EveryFormatKeepsAnyGeometry) {
  for (const GridGeometry& g : testing::awkward_grids({7, 6, 5}))
    expect_round_trip(random_volume<std::int16_t>(g, -32768, 32767), "int16");
}

TEST(WriteVolume, EveryFormatKeepsEveryType) {
  GridGeometry g;
  g.dims = {5, 1, 3};
  expect_round_trip(random_volume<float>(g, -1e3, 1e3), "float32");
  expect_round_trip(random_volume<std::uint8_t>(g, 0, 255), "uint8");
  expect_round_trip(random_volume<std::uint16_t>(g, 0, 65535), "uint16");
  g.dims = {1, 1, 1};
  expect_round_trip(random_volume<std::int16_t>(g, -5, 5), "int16");
}

// NIfTI as written by ITK makes the axes orthogonal: rather no file than another geometry
TEST(WriteVolume, AGeometryThatAFormatCannotHoldIsAnError) {
  const TemporaryFolder folder;
  const Volume<float> sheared(testing::awkward_grids({4, 4, 4}).back());
  const auto written = write_volume(folder / "v.nii.gz", sheared);
  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().kind, ErrorKind::kOutput);
  EXPECT_EQ(folder.count(), 0u);
}

LabelMap labels_on(const GridGeometry& g, int layers) {
  LabelMap labels;
  labels.layers.assign(static_cast<std::size_t>(layers), Volume<LabelId>(g));
  for (int layer = 0; layer < layers; ++layer) {
    auto& voxels = labels.layers[static_cast<std::size_t>(layer)].voxels();
    for (std::size_t n = 0; n < voxels.size(); ++n)
      voxels[n] = static_cast<LabelId>((n + 3 * layer) % 4 == 1);
    labels.segments.push_back({static_cast<LabelId>(layer + 1), "part " + std::to_string(layer) + " \\ ü",
                               Rgb{10, static_cast<std::uint8_t>(100 + layer), 255}, layer, 1});
  }
  return labels;
}

TEST(WriteLabels, SlicersFormatKeepsNamesColoursAndLayers) {
  const auto grids = testing::awkward_grids({7, 6, 5});
  for (const GridGeometry& g : {grids[1], grids[3], grids[5]})
    for (const int layers : {1, 2, 12}) {
      const TemporaryFolder folder;
      const LabelMap labels = labels_on(g, layers);
      const auto written = write_labels(folder / "l.seg.nrrd", labels);
      ASSERT_TRUE(written) << written.error().message();
      const auto read = read_labels(folder / "l.seg.nrrd");
      ASSERT_TRUE(read) << read.error().message();
      EXPECT_TRUE(read->labels.geometry().same_grid(g));
      ASSERT_EQ(read->labels.layers.size(), labels.layers.size());
      for (std::size_t layer = 0; layer < labels.layers.size(); ++layer)
        EXPECT_EQ(read->labels.layers[layer].voxels(), labels.layers[layer].voxels());
      ASSERT_EQ(read->labels.segments.size(), labels.segments.size());
      for (std::size_t n = 0; n < labels.segments.size(); ++n) {
        EXPECT_EQ(read->labels.segments[n].id, labels.segments[n].id);
        EXPECT_EQ(read->labels.segments[n].name, labels.segments[n].name);
        EXPECT_EQ(read->labels.segments[n].colour, labels.segments[n].colour);
        EXPECT_EQ(read->labels.segments[n].layer, labels.segments[n].layer);
      }
    }
}

TEST(WriteLabels, OtherFormatsKeepOneLayerOfAnyValues) {
  const GridGeometry g = testing::awkward_grids({5, 4, 3})[1];
  LabelMap labels;
  labels.layers.emplace_back(g);
  labels.layers[0].at(1, 2, 0) = 65535;
  labels.layers[0].at(4, 3, 2) = 2;
  for (const char* name : {"l.nrrd", "l.nii.gz", "l.mha"}) {
    const TemporaryFolder folder;
    const auto written = write_labels(folder / name, labels);
    ASSERT_TRUE(written) << written.error().message();
    EXPECT_EQ(read_labels(folder / name)->labels.layers[0].voxels(), labels.layers[0].voxels()) << name;
    const auto layered = write_labels(folder / (std::string("x") + name), labels_on(g, 2));
    ASSERT_FALSE(layered);
    EXPECT_EQ(layered.error().kind, ErrorKind::kOutput);
    EXPECT_EQ(folder.count(), 1u);
  }
}

TEST(WriteVolume, AFailureIsAnOutputErrorAndLeavesTheOldFileAlone) {
  const TemporaryFolder folder;
  GridGeometry g;
  g.dims = {64, 64, 16};
  const Volume<float> noise = random_volume<float>(g, 0, 1);
  for (const char* name : {"v.xyz", "v.nhdr", "v.mhd", "v.hdr", "v.img", "missing/v.nrrd"}) {
    const auto written = write_volume(folder / name, noise);
    ASSERT_FALSE(written) << name;
    EXPECT_EQ(written.error().kind, ErrorKind::kOutput) << name;
  }
  const auto empty = write_volume(folder / "v.nrrd", Volume<float>());
  ASSERT_FALSE(empty);
  EXPECT_EQ(empty.error().kind, ErrorKind::kOutput);
  EXPECT_EQ(folder.count(), 0u);

  // a disk limited to 20 000 bytes
  rlimit before;
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  for (const char* name : {"v.nrrd", "v.nii.gz", "v.nii", "v.mha"}) {
    write_text(folder / name, "old");
    const rlimit small{20000, before.rlim_max};
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
    const auto written = write_volume(folder / name, noise);
    setrlimit(RLIMIT_FSIZE, &before);
    ASSERT_FALSE(written) << name;
    EXPECT_EQ(written.error().kind, ErrorKind::kOutput);
    EXPECT_EQ(test::bytes_of_file(folder / name), "old") << name;
  }
  std::signal(SIGXFSZ, handler);
  EXPECT_EQ(folder.count(), 4u) << "no temporary is left";
}

TEST(WriteVolume, AFolderThatTakesNoFilesIsAnOutputError) {
  if (::geteuid() == 0) {
    // root is not restricted by permissions, but /proc is not writable
    const auto written =
        write_volume("/proc/palpate.nrrd", Volume<float>(testing::awkward_grids({2, 2, 2})[0]));
    ASSERT_FALSE(written);
    EXPECT_EQ(written.error().kind, ErrorKind::kOutput);
    return;
  }
  const TemporaryFolder folder;
  ASSERT_EQ(::chmod((folder / "").c_str(), 0500), 0);
  const auto written = write_volume(folder / "v.nrrd", Volume<float>(testing::awkward_grids({2, 2, 2})[0]));
  ::chmod((folder / "").c_str(), 0700);
  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().kind, ErrorKind::kOutput);
}

}  // namespace
}  // namespace palpate
