#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <random>

#include "base/test_files.h"
#include "base/test_seed.h"
#include "palpate/volume_io/volume_io.h"
#include "volume_io/mesh/test_meshes.h"

namespace palpate {
namespace {

using test::TemporaryFolder;
using test::write_text;
using ::testing::HasSubstr;
namespace shapes = volume_io::test_meshes;

GridGeometry scan_for_meshes() {
  GridGeometry grid;
  grid.dims = {40, 36, 30};
  grid.spacing_mm = {1, 1.1, 1.2};
  grid.direction = Eigen::AngleAxisd(0.4, Eigen::Vector3d(1, -2, 1).normalized()).toRotationMatrix();
  grid.origin = Point<Patient>(-120, 50, -80);
  return grid;
}

// a sphere centred in that scan
volume_io::TriangleMesh ball_in_scan(double radius, const Eigen::Vector3d& beside = {0, 0, 0}) {
  const Eigen::Vector3d centre = scan_for_meshes().centre().eigen();
  return shapes::moved(shapes::sphere_mesh(radius, 64), Eigen::Matrix3d::Identity(), centre + beside);
}

std::vector<std::string> warnings_of(const std::filesystem::path& file, const GridGeometry* scan,
                                     Result<LabelFile>& labels,
                                     const MeshPlacementOptions& placement_options = {}) {
  std::vector<std::string> declared;
  labels = read_labels(
      file, {}, {}, [&](const std::string& warning) { declared.push_back(warning); },
      AmbiguousLabels::kReject, VoxelCaching::kOff, scan, PlacementOptions{.mesh = placement_options});
  return declared;
}

TEST(Meshes, EveryFormatBecomesTheSameLabels) {
  const TemporaryFolder folder;
  const GridGeometry scan = scan_for_meshes();
  std::optional<std::size_t> voxels;
  for (const auto& written : shapes::in_every_format(ball_in_scan(9))) {
    write_text(folder / written.name, written.bytes);
    EXPECT_TRUE(is_volume(folder / written.name)) << written.name;
    const auto labels =
        read_labels(folder / written.name, {}, {}, {}, AmbiguousLabels::kReject, VoxelCaching::kOff, &scan);
    ASSERT_TRUE(labels) << labels.error().message();
    EXPECT_EQ(labels->header.format, "surfaces");
    EXPECT_TRUE(labels->header.has_geometry);
    EXPECT_TRUE(labels->labels.geometry().same_grid(scan));
    const auto statistics = segment_statistics(labels->labels);
    ASSERT_EQ(statistics.size(), 1u) << written.name;
    if (!voxels) voxels = statistics[0].voxels;
    EXPECT_EQ(statistics[0].voxels, *voxels) << written.name;
    EXPECT_LT((statistics[0].centroid.eigen() - scan.centre().eigen()).norm(), 0.1);
    EXPECT_NEAR(statistics[0].volume_mm3, 4.0 / 3 * std::numbers::pi * 729, 90);
  }
}

TEST(Meshes, EachFileOfAFolderIsAStructure) {
  const TemporaryFolder folder;
  const GridGeometry scan = scan_for_meshes();
  write_text(folder / "tibia.stl", shapes::binary_stl(ball_in_scan(6, {0, 0, 7})));
  write_text(folder / "femur.ply", shapes::ply(ball_in_scan(7), "binary_big_endian"));
  write_text(folder / "read me", "nothing");
  Result<LabelFile> labels = Error{};
  const auto declared = warnings_of(folder.path(), &scan, labels);
  ASSERT_TRUE(labels) << labels.error().message();
  ASSERT_EQ(labels->labels.segments.size(), 2u);
  EXPECT_EQ(labels->labels.segments[0].name, "femur");
  EXPECT_EQ(labels->labels.segments[1].name, "tibia");
  // overlapping structures are preserved
  EXPECT_EQ(labels->labels.layers.size(), 2u);
  const std::string all = ::testing::PrintToString(declared);
  EXPECT_THAT(all, HasSubstr("segments overlap in"));
  EXPECT_THAT(all, HasSubstr("is read as LPS in mm"));
  EXPECT_THAT(all, HasSubstr("1 other file in it is no surface"));

  // the error names a damaged file
  write_text(folder / "patella.obj", "v 0 0 0\nf 1 2 3\n");
  const auto refused =
      read_labels(folder.path(), {}, {}, {}, AmbiguousLabels::kReject, VoxelCaching::kOff, &scan);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().where, (folder / "patella.obj").string());
}

TEST(Meshes, AStructureIsCalledAfterItsFileAndNotAfterTheFolder) {
  const TemporaryFolder folder;
  const GridGeometry scan = scan_for_meshes();
  write_text(folder / "femur.stl", shapes::binary_stl(ball_in_scan(7)));
  Result<LabelFile> labels = Error{};
  warnings_of(folder.path(), &scan, labels);
  ASSERT_TRUE(labels) << labels.error().message();
  EXPECT_EQ(labels->labels.segments[0].name, "femur");

  // files that state different axes are read as the user specifies
  write_text(folder / "femur.stl", shapes::binary_stl(ball_in_scan(7), "SPACE=LPS"));
  write_text(folder / "tibia.stl", shapes::binary_stl(ball_in_scan(7), "SPACE=RAS"));
  warnings_of(folder.path(), &scan, labels);
  ASSERT_FALSE(labels);
  EXPECT_THAT(labels.error().message(), HasSubstr("--mesh-space"));
  warnings_of(folder.path(), &scan, labels, {MeshSpace::kLps, {}});
  ASSERT_TRUE(labels) << labels.error().message();
  EXPECT_EQ(labels->labels.segments.size(), 2u);
}

// one solid or object per line: its name, and the part of it that may be used
TEST(Meshes, ObjectsWithinAFileAreNotCalledAfterAPatient) {
  const TemporaryFolder folder;
  const GridGeometry scan = scan_for_meshes();
  const std::vector<std::pair<std::string, std::string>> called{{"DOE^CANARY", "structure 1"},
                                                                {"canary_femur_left", "femur_left"},
                                                                {"tibia", "tibia"},
                                                                {"Femur_left 19570411 Canary", "Femur_left"},
                                                                {"canary tibia", "tibia (5)"},
                                                                {"Magnus Hoffa", "structure 6"}};
  std::string stl, obj;
  int points = 0;
  for (std::size_t n = 0; n < called.size(); ++n) {
    const auto mesh = ball_in_scan(3, {0, 0, 7.0 * static_cast<double>(n) - 17});
    stl += "solid " + called[n].first + "\n";
    obj += "o " + called[n].first + "\n";
    for (const auto& triangle : mesh.triangles) {
      stl += "facet normal 0 0 0\nouter loop\n";
      for (const auto corner : triangle) {
        const Eigen::Vector3d& p = mesh.points[static_cast<std::size_t>(corner)];
        const std::string at =
            std::to_string(p.x()) + " " + std::to_string(p.y()) + " " + std::to_string(p.z()) + "\n";
        stl += "vertex " + at;
        obj += "v " + at;
      }
      stl += "endloop\nendfacet\n";
      obj += "f " + std::to_string(points + 1) + " " + std::to_string(points + 2) + " " +
             std::to_string(points + 3) + "\n";
      points += 3;
    }
    stl += "endsolid " + called[n].first + "\n";
  }
  for (const auto& [name, text] :
       {std::pair("of a stranger.stl", stl), std::pair("of a stranger.obj", obj)}) {
    write_text(folder / name, text);
    Result<LabelFile> labels = Error{};
    const auto declared = warnings_of(folder / name, &scan, labels);
    ASSERT_TRUE(labels) << labels.error().message();
    ASSERT_EQ(labels->labels.segments.size(), called.size()) << name;
    for (std::size_t n = 0; n < called.size(); ++n)
      EXPECT_EQ(labels->labels.segments[n].name, called[n].second) << name;
    const std::string all = ::testing::PrintToString(declared);
    EXPECT_THAT(all, HasSubstr("not known anatomical words"));
    EXPECT_EQ(all.find("CANARY"), std::string::npos);
    EXPECT_EQ(all.find("Canary"), std::string::npos);
  }
}

TEST(Meshes, MoreStructuresThanAreComparedAreRefused) {
  const TemporaryFolder folder;
  std::string objects;
  for (int n = 0; n < 1025; ++n)
    objects += "o part" + std::to_string(n) + "\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n";
  write_text(folder / "many.obj", objects);
  const auto labels = read_labels(folder / "many.obj");
  ASSERT_FALSE(labels);
  EXPECT_THAT(labels.error().message(), HasSubstr("has 1025 structures, but at most 1024 can be read"));
}

TEST(Meshes, WithoutAScanTheyHaveAGridOfTheirOwn) {
  const TemporaryFolder folder;
  write_text(folder / "femur.stl", shapes::binary_stl(ball_in_scan(9)));
  Result<LabelFile> labels = Error{};
  const auto declared = warnings_of(folder / "femur.stl", nullptr, labels);
  ASSERT_TRUE(labels) << labels.error().message();
  EXPECT_FALSE(labels->header.has_geometry);
  ASSERT_EQ(labels->labels.segments.size(), 1u);
  EXPECT_EQ(labels->labels.segments[0].name, "femur");
  const auto statistics = segment_statistics(labels->labels);
  EXPECT_NEAR(statistics[0].volume_mm3, 4.0 / 3 * std::numbers::pi * 729, 45);
  EXPECT_LT((statistics[0].centroid.eigen() - scan_for_meshes().centre().eigen()).norm(), 0.05);
  EXPECT_THAT(::testing::PrintToString(declared), HasSubstr("its own grid of"));
  // specified as RAS it lies elsewhere, and its sides are known
  warnings_of(folder / "femur.stl", nullptr, labels, {MeshSpace::kRas, {}});
  ASSERT_TRUE(labels);
  EXPECT_TRUE(labels->header.has_geometry);
  const Eigen::Vector3d c = scan_for_meshes().centre().eigen();
  EXPECT_LT((segment_statistics(labels->labels)[0].centroid.eigen() - Eigen::Vector3d(-c.x(), -c.y(), c.z()))
                .norm(),
            0.05);
}

TEST(Meshes, AreNoScan) {
  const TemporaryFolder folder;
  write_text(folder / "femur.stl", shapes::binary_stl(ball_in_scan(9)));
  const auto scan = read_scan(folder / "femur.stl");
  ASSERT_FALSE(scan);
  EXPECT_THAT(scan.error().message(), HasSubstr("labels, not a scan"));
}

// in the confined process, a safeguard for unknown faults: none of these inputs may trigger it
TEST(Meshes, DamageIsOneErrorThatNamesTheFile) {
  const TemporaryFolder folder;
  std::mt19937 random(test::test_seed());
  const GridGeometry scan = scan_for_meshes();
  for (const auto& written : shapes::in_every_format(ball_in_scan(9)))
    for (int n = 0; n < 6; ++n) {
      std::string bytes = written.bytes;
      if (n % 2 == 0)
        bytes.resize(random() % bytes.size());
      else
        for (int flips = 0; flips < 3; ++flips)
          bytes[random() % bytes.size()] ^= static_cast<char>(1 << random() % 8);
      write_text(folder / written.name, bytes);
      const auto labels =
          read_labels(folder / written.name, {}, {}, {}, AmbiguousLabels::kReject, VoxelCaching::kOff, &scan);
      if (labels) continue;
      EXPECT_EQ(labels.error().what.find("its reader"), std::string::npos) << labels.error().message();
      EXPECT_EQ(labels.error().where, (folder / written.name).string());
    }
}

}  // namespace
}  // namespace palpate
