#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <map>
#include <mutex>

#include "base/test_processors.h"
#include "palpate/phantoms/phantoms.h"
#include "phantoms/knee_phantom_anatomy.h"
#include "phantoms/shape_blocks.h"

namespace palpate {
namespace {

const Phantom& phantom_06() {
  static const Phantom phantom = make_knee_phantom(0.6).value();
  return phantom;
}

const std::map<std::string, SegmentStatistics>& statistics_06() {
  static const auto by_name = [] {
    std::map<std::string, SegmentStatistics> map;
    const LabelMap& labels = phantom_06().labels;
    for (const SegmentStatistics& s : segment_statistics(labels)) map[labels.find(s.id)->name] = s;
    return map;
  }();
  return by_name;
}

std::vector<PhantomPart> labelled_parts(std::uint64_t seed = 0) {
  std::vector<PhantomPart> parts = knee_phantom_parts(knee_shape(seed));
  std::erase_if(parts, [](const PhantomPart& part) { return part.label == 0; });
  return parts;
}

const Shape& shape_of(const std::vector<PhantomPart>& parts, const std::string& name) {
  for (const PhantomPart& part : parts) {
    if (part.name == name) return part.shape;
  }
  ADD_FAILURE() << "no part " << name;
  return parts.front().shape;
}

GridGeometry millimetre_grid() {
  GridGeometry grid;
  grid.dims = {110, 110, 120};
  grid.origin = Point<Patient>(-54.5, -58.5, -59.5);
  return grid;
}

// Smallest distance between two surfaces, over surface points of `from` about 1 mm apart.
double gap_mm(const Shape& from, const Shape& to) {
  const GridGeometry grid = millimetre_grid();
  std::mutex joining;
  double smallest = 1e9;
  const auto narrow = [](const Shape::Node::Ptr& node, const VoxelBlock&,
                         const Ball& ball) -> std::optional<Shape::Node::Ptr> {
    const auto within = node->within(node, ball);
    if (std::abs(within.distance) > ball.radius) return {};
    return within.node;
  };
  const auto leaf = [&](const Shape::Node::Ptr& node, const VoxelBlock& block) {
    double here = 1e9;
    block.for_each_voxel([&](int i, int j, int k) {
      const Eigen::Vector3d p = (grid.X_PatientVoxel() * Point<Voxel>(i, j, k)).eigen();
      const double d = node->distance(p);
      if (std::abs(d) > 0.9) return;
      const Eigen::Vector3d on_surface = p - d * node->gradient(p);
      if (std::abs(node->distance(on_surface)) < 0.05)
        here = std::min(here, to.distance_mm(Point<Patient>(on_surface)));
    });
    const std::scoped_lock lock(joining);
    smallest = std::min(smallest, here);
  };
  EXPECT_TRUE(visit_grid(grid, from.node(), "", {}, narrow, leaf));
  return smallest;
}

void expect_structures_of_the_atlas() {
  const Rgb bone{197, 189, 177}, cartilage{180, 180, 255}, meniscus{200, 205, 205}, ligament{255, 255, 255};
  const std::vector<Segment> expected = {{31, "anterior_cruciate_ligament", ligament, 0, 31},
                                         {32, "posterior_cruciate_ligament", ligament, 0, 32},
                                         {33, "fibular_collateral_ligament", ligament, 0, 33},
                                         {34, "tibial_collateral_ligament", ligament, 0, 34},
                                         {35, "patellar_ligament", ligament, 0, 35},
                                         {81, "lateral_meniscus", meniscus, 0, 81},
                                         {82, "medial_meniscus", meniscus, 0, 82},
                                         {83, "femoral_cartilage", cartilage, 0, 83},
                                         {84, "lateral_tibial_cartilage", cartilage, 0, 84},
                                         {85, "medial_tibial_cartilage", cartilage, 0, 85},
                                         {86, "patellar_cartilage", cartilage, 0, 86},
                                         {95, "femur", bone, 0, 95},
                                         {96, "tibia", bone, 0, 96},
                                         {97, "fibula", bone, 0, 97},
                                         {98, "patella", bone, 0, 98}};
  const std::vector<Segment>& segments = phantom_06().labels.segments;
  ASSERT_EQ(segments.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(segments[i].id, expected[i].id);
    EXPECT_EQ(segments[i].name, expected[i].name);
    EXPECT_EQ(segments[i].colour, expected[i].colour);
    EXPECT_EQ(segments[i].layer, 0);
    EXPECT_EQ(segments[i].value, expected[i].value);
    EXPECT_TRUE(statistics_06().contains(expected[i].name)) << expected[i].name << " has no voxel";
  }
}

void expect_left_knee() {
  const auto centroid = [](const char* name) { return statistics_06().at(name).centroid; };
  // +x is the patient's left: lateral in a left knee
  EXPECT_GT(centroid("fibula").x(), centroid("tibia").x() + 25);
  EXPECT_GT(centroid("lateral_meniscus").x(), centroid("medial_meniscus").x() + 30);
  EXPECT_GT(centroid("lateral_tibial_cartilage").x(), centroid("medial_tibial_cartilage").x() + 30);
  EXPECT_GT(centroid("fibular_collateral_ligament").x(), centroid("tibial_collateral_ligament").x() + 60);
  // -y is anterior, +z superior
  EXPECT_LT(centroid("patella").y(), centroid("femur").y() - 25);
  EXPECT_LT(centroid("patellar_ligament").y(), centroid("tibia").y() - 25);
  EXPECT_GT(centroid("fibula").y(), centroid("tibia").y() + 10);
  EXPECT_GT(centroid("femur").z(), centroid("tibia").z() + 40);
  EXPECT_GT(centroid("posterior_cruciate_ligament").y(), centroid("anterior_cruciate_ligament").y());
  EXPECT_TRUE(phantom_06().scan.geometry().right_handed());
  EXPECT_EQ(phantom_06().scan.geometry().direction, Eigen::Matrix3d::Identity());
}

TEST(KneePhantom, LigamentsOfEverySeedReachTheirBones) {
  const std::pair<const char*, const char*> joined[] = {
      {"anterior_cruciate_ligament", "femur"},  {"anterior_cruciate_ligament", "tibia"},
      {"posterior_cruciate_ligament", "femur"}, {"posterior_cruciate_ligament", "tibia"},
      {"fibular_collateral_ligament", "femur"}, {"fibular_collateral_ligament", "fibula"},
      {"tibial_collateral_ligament", "femur"},  {"tibial_collateral_ligament", "tibia"},
      {"patellar_ligament", "patella"},         {"patellar_ligament", "tibia"}};
  for (const std::uint64_t seed : {1u, 2u}) {
    const auto parts = labelled_parts(seed);
    for (const auto& [ligament, bone] : joined)
      EXPECT_LT(gap_mm(shape_of(parts, ligament), shape_of(parts, bone)), 0.2)
          << ligament << " to " << bone << ", seed " << seed;
  }
}

TEST(KneePhantom, CruciatesRunFromTheTibiaToTheirWallsOfTheNotch) {
  const auto parts = labelled_parts();
  const Shape &femur = shape_of(parts, "femur"), &tibia = shape_of(parts, "tibia");
  const auto ends_touch = [&](const char* name) {
    const Shape& ligament = shape_of(parts, name);
    EXPECT_LT(gap_mm(ligament, femur), 0.2) << name;
    EXPECT_LT(gap_mm(ligament, tibia), 0.2) << name;
  };
  ends_touch("anterior_cruciate_ligament");
  ends_touch("posterior_cruciate_ligament");
  EXPECT_LT(gap_mm(shape_of(parts, "fibular_collateral_ligament"), femur), 0.2);
  EXPECT_LT(gap_mm(shape_of(parts, "fibular_collateral_ligament"), shape_of(parts, "fibula")), 0.2);
  EXPECT_LT(gap_mm(shape_of(parts, "tibial_collateral_ligament"), femur), 0.2);
  EXPECT_LT(gap_mm(shape_of(parts, "tibial_collateral_ligament"), tibia), 0.2);
  EXPECT_LT(gap_mm(shape_of(parts, "patellar_ligament"), shape_of(parts, "patella")), 0.2);
  EXPECT_LT(gap_mm(shape_of(parts, "patellar_ligament"), tibia), 0.2);
}

TEST(KneePhantom, JointGapsAreThoseOfAKnee) {
  const auto parts = labelled_parts();
  const auto gap = [&](const char* a, const char* b) {
    return gap_mm(shape_of(parts, a), shape_of(parts, b));
  };
  const auto expect_within = [](double value, double smallest, double largest) {
    EXPECT_GE(value, smallest);
    EXPECT_LE(value, largest);
  };
  // between bones
  expect_within(gap("femur", "tibia"), 3.5, 5.2);
  expect_within(gap("patella", "femur"), 3.5, 5.6);
  expect_within(gap("fibula", "tibia"), 0.9, 1.5);
  // free gaps between cartilages
  expect_within(gap("medial_tibial_cartilage", "femoral_cartilage"), 0.6, 0.9);
  expect_within(gap("lateral_tibial_cartilage", "femoral_cartilage"), 0.6, 0.9);
  expect_within(gap("patellar_cartilage", "femoral_cartilage"), 0.6, 0.9);
  expect_within(gap("medial_meniscus", "femoral_cartilage"), 0.5, 0.8);
  expect_within(gap("lateral_meniscus", "lateral_tibial_cartilage"), 0.5, 0.8);
  // cartilage is in contact with its bone
  for (const auto& [cartilage, bone] : {std::pair{"femoral_cartilage", "femur"},
                                        {"medial_tibial_cartilage", "tibia"},
                                        {"lateral_tibial_cartilage", "tibia"},
                                        {"patellar_cartilage", "patella"}}) {
    EXPECT_NEAR(gap(cartilage, bone), 0, 0.05) << cartilage;
  }
}

TEST(KneePhantom, NoTwoStructuresShareAPoint) {
  const auto parts = labelled_parts();
  using Candidates = std::vector<std::pair<std::size_t, Shape::Node::Ptr>>;
  Candidates all;
  for (std::size_t i = 0; i < parts.size(); ++i) all.emplace_back(i, parts[i].shape.node());
  const auto narrow = [](const Candidates& candidates, const VoxelBlock&,
                         const Ball& ball) -> std::optional<Candidates> {
    Candidates near;
    for (const auto& [part, node] : candidates) {
      const auto within = node->within(node, ball);
      if (within.distance < ball.radius) near.emplace_back(part, within.node);
    }
    if (near.size() < 2) return {};
    return near;
  };
  std::atomic<int> shared = 0;
  std::atomic<int> requested = 0;
  const GridGeometry grid = millimetre_grid();
  const auto leaf = [&](const Candidates& candidates, const VoxelBlock& block) {
    block.for_each_voxel([&](int i, int j, int k) {
      const Eigen::Vector3d p = (grid.X_PatientVoxel() * Point<Voxel>(i, j, k)).eigen();
      int inside = 0;
      for (const auto& [part, node] : candidates) inside += node->distance(p) < 0 ? 1 : 0;
      if (inside > 1) ++shared;
      ++requested;
    });
  };
  ASSERT_TRUE(visit_grid(grid, all, "", {}, narrow, leaf));
  EXPECT_EQ(shared, 0);
  EXPECT_GT(requested, 20'000);
}

void expect_one_piece_each() {
  for (const auto& [name, statistics] : statistics_06()) EXPECT_EQ(statistics.components, 1) << name;
}

void expect_bones_cut_above_and_below() {
  const int top = phantom_06().labels.geometry().dims[2] - 1;
  EXPECT_EQ(statistics_06().at("femur").box_max[2], top);
  EXPECT_EQ(statistics_06().at("tibia").box_min[2], 0);
  EXPECT_EQ(statistics_06().at("fibula").box_min[2], 0);
  EXPECT_LT(statistics_06().at("patella").box_max[2], top);
  for (const auto& [name, statistics] : statistics_06()) {
    for (const std::size_t axis : {0u, 1u}) {
      EXPECT_GT(statistics.box_min[axis], 0) << name;
      EXPECT_LT(statistics.box_max[axis], phantom_06().labels.geometry().dims[axis] - 1) << name;
    }
  }
}

// Free space that a tip can reach from the border without crossing a structure; 6-connected.
std::vector<bool> reachable(const Volume<LabelId>& labels) {
  const GridGeometry& grid = labels.geometry();
  std::vector<bool> reached(grid.voxel_count(), false);
  std::vector<std::array<int, 3>> open;
  const auto enter = [&](int i, int j, int k) {
    if (!grid.contains(i, j, k) || labels.at(i, j, k) != 0 || reached[grid.offset(i, j, k)]) return;
    reached[grid.offset(i, j, k)] = true;
    open.push_back({i, j, k});
  };
  enter(0, 0, grid.dims[2] / 2);
  while (!open.empty()) {
    const auto [i, j, k] = open.back();
    open.pop_back();
    for (const int s : {-1, 1}) {
      enter(i + s, j, k);
      enter(i, j + s, k);
      enter(i, j, k + s);
    }
  }
  return reached;
}

void expect_every_structure_touchable() {
  const Volume<LabelId>& labels = phantom_06().labels.layers.front();
  const GridGeometry& grid = labels.geometry();
  const std::vector<bool> free = reachable(labels);
  std::map<LabelId, int> faces;
  for (int k = 1; k + 1 < grid.dims[2]; ++k) {
    for (int j = 1; j + 1 < grid.dims[1]; ++j) {
      for (int i = 1; i + 1 < grid.dims[0]; ++i) {
        if (!free[grid.offset(i, j, k)]) continue;
        for (const int s : {-1, 1}) {
          ++faces[labels.at(i + s, j, k)];
          ++faces[labels.at(i, j + s, k)];
          ++faces[labels.at(i, j, k + s)];
        }
      }
    }
  }
  for (const Segment& segment : phantom_06().labels.segments) {
    EXPECT_GT(faces[segment.id] * 0.36, 100) << segment.name << ", mm2 of free surface";
  }
}

void expect_plausible_volumes() {
  const auto millilitres = [](const char* name) { return statistics_06().at(name).volume_mm3 / 1000; };
  const auto expect_within = [&](const char* name, double smallest, double largest) {
    EXPECT_GE(millilitres(name), smallest) << name;
    EXPECT_LE(millilitres(name), largest) << name;
  };
  expect_within("femoral_cartilage", 9, 17);
  expect_within("medial_tibial_cartilage", 1.3, 3.5);
  expect_within("lateral_tibial_cartilage", 1.4, 4.5);
  expect_within("patellar_cartilage", 1.6, 5);
  expect_within("medial_meniscus", 1.3, 3.2);
  expect_within("lateral_meniscus", 1.3, 3.2);
  expect_within("patella", 9, 24);
  // 27 healthy men (Eckstein et al., Osteoarthritis and Cartilage 9:101-111, 2001)
  const double all = millilitres("femoral_cartilage") + millilitres("medial_tibial_cartilage") +
                     millilitres("lateral_tibial_cartilage") + millilitres("patellar_cartilage");
  EXPECT_GE(all, 16.6);
  EXPECT_LE(all, 31.4);
}

void expect_volumes_like_those_of_larger_voxels() {
  // at 1.5 mm a cartilage is two voxels thick
  for (const auto& [voxel_mm, tolerance] : {std::pair{0.9, 0.05}, {1.5, 0.2}}) {
    const auto other = make_knee_phantom(voxel_mm);
    ASSERT_TRUE(other.ok());
    for (const SegmentStatistics& s : segment_statistics(other->labels)) {
      const std::string& name = other->labels.find(s.id)->name;
      EXPECT_NEAR(s.volume_mm3 / statistics_06().at(name).volume_mm3, 1, tolerance)
          << name << " at " << voxel_mm << " mm";
    }
  }
}

TEST(KneePhantom, CoversTheSameSpaceAtAnyVoxelSize) {
  for (const double voxel_mm : {1.3, 2.2, 3.0}) {
    const auto phantom = make_knee_phantom(voxel_mm);
    ASSERT_TRUE(phantom.ok()) << voxel_mm;
    const GridGeometry& grid = phantom->labels.geometry();
    EXPECT_TRUE(grid.same_grid(phantom->scan.geometry()));
    EXPECT_NEAR((grid.centre() - Point<Patient>(0, -4, 0)).norm(), 0, 1e-9);
    EXPECT_NEAR(grid.dims[0] * voxel_mm, 110, 0.51 * voxel_mm);
    EXPECT_NEAR(grid.dims[2] * voxel_mm, 120, 0.51 * voxel_mm);
    EXPECT_EQ(segment_statistics(phantom->labels).size(), 15u) << voxel_mm;
  }
}

void expect_scan_as_labels_say() {
  const auto& labels = phantom_06().labels.layers.front().voxels();
  const auto& scan = phantom_06().scan.voxels();
  std::map<LabelId, std::pair<double, double>> sums;  // sums of intensities and number of voxels
  for (std::size_t v = 0; v < scan.size(); ++v) {
    ASSERT_TRUE(std::isfinite(scan[v]) && scan[v] >= 0);
    sums[labels[v]].first += scan[v];
    sums[labels[v]].second += 1;
  }
  const auto mean = [&](int label) {
    const auto& [intensity, voxels] = sums[static_cast<LabelId>(label)];
    return intensity / voxels;
  };
  for (const int bone : {95, 96, 98}) EXPECT_GT(mean(bone), 450) << bone;
  for (const int cartilage : {83, 84, 85, 86}) EXPECT_NEAR(mean(cartilage), 500, 80) << cartilage;
  for (const int dark : {31, 32, 33, 34, 35, 81, 82}) EXPECT_LT(mean(dark), 250) << dark;
}

// one test, because the phantom is generated once per test
TEST(KneePhantom, AtItsDefaultVoxelSizeIsAWholeLeftKnee) {
  expect_structures_of_the_atlas();
  expect_left_knee();
  expect_one_piece_each();
  expect_bones_cut_above_and_below();
  expect_every_structure_touchable();
  expect_plausible_volumes();
  expect_scan_as_labels_say();
  expect_volumes_like_those_of_larger_voxels();
}

TEST(KneePhantom, TheSameSeedGivesTheSameBitsWithAnyNumberOfThreads) {
  const auto many = make_knee_phantom(2, 7);
  const test::OneProcessor one;
  const auto single = make_knee_phantom(2, 7), other = make_knee_phantom(2, 8);
  ASSERT_TRUE(many.ok() && single.ok() && other.ok());
  EXPECT_EQ(many->scan.voxels(), single->scan.voxels());
  EXPECT_EQ(many->labels.layers.front().voxels(), single->labels.layers.front().voxels());
  EXPECT_NE(many->scan.voxels(), other->scan.voxels());
  EXPECT_EQ(many->labels.layers.front().voxels(), other->labels.layers.front().voxels());
}

TEST(KneePhantom, RefusesVoxelSizesOutOfRange) {
  for (const double voxel_mm : {0.0, 0.19, 3.01, -1.0, std::nan("")}) {
    const auto phantom = make_knee_phantom(voxel_mm);
    ASSERT_FALSE(phantom.ok());
    EXPECT_EQ(phantom.error().kind, ErrorKind::kBadInput);
    EXPECT_NE(phantom.error().what.find("0.2 ... 3 mm"), std::string::npos);
  }
}

TEST(KneePhantom, StopsWhenAsked) {
  std::atomic<bool> stop = false;
  // midway
  const Progress progress([&](std::string_view, double fraction) { stop = stop || fraction > 0.3; }, &stop);
  const auto phantom = make_knee_phantom(1, 1, progress);
  ASSERT_FALSE(phantom.ok());
  EXPECT_EQ(phantom.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
