#include "palpate/phantoms/phantoms.h"

#include <gmock/gmock.h>

#include <map>
#include <numbers>
#include <random>
#include <set>

#include "base/test_seed.h"
#include "palpate/base/hash.h"
#include "palpate/phantoms/primitives.h"
#include "palpate/surfaces/surfaces.h"
#include "phantoms/knee_phantom_anatomy.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

Phantom made(const std::string& name) {
  const auto parameters = parse_phantom(name);
  EXPECT_TRUE(parameters.ok()) << parameters.error().message();
  auto phantom = make_phantom(parameters.value());
  EXPECT_TRUE(phantom.ok()) << phantom.error().message();
  return std::move(phantom).value();
}

const Volume<LabelId>& labels_of(const Phantom& phantom) {
  return phantom.labels.layers.front();
}

std::map<std::string, SegmentStatistics> statistics(const Phantom& phantom) {
  std::map<std::string, SegmentStatistics> by_name;
  for (const SegmentStatistics& s : segment_statistics(phantom.labels))
    by_name[phantom.labels.find(s.id)->name] = s;
  return by_name;
}

double volume_mm3(const Phantom& phantom, const std::string& name) {
  return statistics(phantom).at(name).volume_mm3;
}

std::size_t differing(const Phantom& a, const Phantom& b) {
  const auto &x = labels_of(a).voxels(), &y = labels_of(b).voxels();
  EXPECT_EQ(x.size(), y.size());
  std::size_t count = 0;
  for (std::size_t v = 0; v < std::min(x.size(), y.size()); ++v) count += x[v] != y[v];
  return count;
}

// ---- the knee -----------------------------------------------------------------------------------

// recordings of the knee are replayed, so it must not change
TEST(Phantoms, TheMeanKneeIsPinned) {
  const Phantom knee = make_knee_phantom(1.5).value();
  std::uint64_t hash = kHashSeed;
  const auto& voxels = labels_of(knee).voxels();
  hash_bytes(hash, voxels.data(), voxels.size() * sizeof(LabelId));
  EXPECT_EQ(hash_finish(hash), 1610356209104129574ull);
  EXPECT_EQ(differing(knee, made("knee-phantom:spacing=1.5")), 0u);
  EXPECT_EQ(knee.scan.voxels(), made("knee-phantom:spacing=1.5").scan.voxels());
}

TEST(Phantoms, ARightKneeIsTheMirrorImageOfTheLeft) {
  const std::string odd = "knee-phantom:spacing=2x1.5x2.5,seed=4,lesion=6,noise=0.5,islands=5";
  const Phantom left = made(odd), right = made(odd + ",side=right");
  const GridGeometry& grid = labels_of(left).geometry();
  EXPECT_TRUE(grid.same_grid(labels_of(right).geometry(), 1e-12));
  EXPECT_NEAR(grid.centre().x(), 0, 1e-12) << "mirrored about the middle of the joint";
  std::size_t wrong = 0;
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const int mirrored = grid.dims[0] - 1 - i;
        wrong += labels_of(left).at(i, j, k) != labels_of(right).at(mirrored, j, k);
        wrong += left.scan.at(i, j, k) != right.scan.at(mirrored, j, k);
      }
  EXPECT_EQ(wrong, 0u);
  // the fibula is lateral
  EXPECT_GT(statistics(left).at("fibula").centroid.x(), statistics(left).at("tibia").centroid.x() + 20);
  EXPECT_LT(statistics(right).at("fibula").centroid.x(), statistics(right).at("tibia").centroid.x() - 20);
}

TEST(Phantoms, VolumesAreThoseOfTheAnatomyWithAnySpacing) {
  // bones within 1.5 %, structures two voxels thick within 20 %, also with thick slices
  const auto fine = statistics(made("knee-phantom:spacing=1"));
  for (const char* spacing : {"1.5", "2x1x1"}) {
    const Phantom coarse = made("knee-phantom:spacing=" + std::string(spacing));
    const auto others = statistics(coarse);
    ASSERT_EQ(others.size(), 15u);
    for (const auto& [name, s] : others) {
      const bool bone = name == "femur" || name == "tibia" || name == "fibula" || name == "patella";
      EXPECT_NEAR(s.volume_mm3 / fine.at(name).volume_mm3, 1, bone ? 0.015 : 0.2)
          << name << " at " << spacing;
    }
  }
}

TEST(Phantoms, TheSpacingIsTheOneAskedFor) {
  const Phantom phantom = made("gland-phantom:spacing=0.9x1.1x2");
  EXPECT_EQ(labels_of(phantom).geometry().spacing_mm, Eigen::Vector3d(0.9, 1.1, 2));
  EXPECT_TRUE(labels_of(phantom).geometry().same_grid(phantom.scan.geometry()));
}

TEST(Phantoms, ScaleCubesTheVolume) {
  // with voxels scaled equally: the same phantom except for rounding; otherwise: within the accuracy of the
  // voxels
  const Phantom mean = made("knee-phantom:spacing=1.5");
  const Phantom child = made("knee-phantom:spacing=0.9,size=0.6");
  EXPECT_EQ(labels_of(mean).geometry().dims, labels_of(child).geometry().dims);
  EXPECT_LT(differing(mean, child), 20u);
  for (const double size : {1.2}) {
    const Phantom other = made("knee-phantom:spacing=1.4,size=" + std::to_string(size));
    for (const char* name : {"femur", "tibia"})
      EXPECT_NEAR(volume_mm3(other, name) / (size * size * size * volume_mm3(mean, name)), 1, 0.02)
          << name << " at " << size;
  }
}

TEST(Phantoms, TheSameSeedRepeatsAndSeedsDiffer) {
  for (const std::string name : {"knee-phantom", "shell-phantom", "skull-phantom", "gland-phantom"}) {
    const std::string coarse = name + ":spacing=3" + (name == "shell-phantom" ? ",thickness=6" : "") +
                               (name == "skull-phantom" ? ",temporal=6" : "");
    const auto hash_of = [&](int seed) {
      const Phantom phantom = made(coarse + ",noise=0.5,islands=3,seed=" + std::to_string(seed));
      std::uint64_t hash = kHashSeed;
      const auto& voxels = labels_of(phantom).voxels();
      hash_bytes(hash, voxels.data(), voxels.size() * sizeof(LabelId));
      hash_bytes(hash, phantom.scan.voxels().data(), phantom.scan.voxels().size() * sizeof(float));
      return hash_finish(hash);
    };
    std::set<std::uint64_t> hashes;
    for (const int seed : {0, 1}) hashes.insert(hash_of(seed));
    EXPECT_EQ(hashes.size(), 2u) << name;
    EXPECT_TRUE(hashes.contains(hash_of(1))) << name;
  }
}

// properties of the mean knee hold for every knee
TEST(Phantoms, KneesOfAllSeedsAreKnees) {
  std::mt19937 random(test::test_seed());
  double min_mL = 1e9, max_mL = 0;
  for (int n = 0; n < 3; ++n) {
    const std::string name = "knee-phantom:spacing=1.1,seed=" + std::to_string(1 + random() % 100000);
    SCOPED_TRACE(name);
    const Phantom knee = made(name);
    const auto found = statistics(knee);
    ASSERT_EQ(found.size(), 15u);
    // the thin border of a cartilage may break off
    for (const auto& [structure, s] : found)
      EXPECT_GT(static_cast<double>(s.largest_component_voxels), 0.98 * static_cast<double>(s.voxels))
          << structure;
    const auto mL = [&](const char* structure) { return found.at(structure).volume_mm3 / 1000; };
    const double cartilage = mL("femoral_cartilage") + mL("medial_tibial_cartilage") +
                             mL("lateral_tibial_cartilage") + mL("patellar_cartilage");
    // range of 27 healthy men (docs/reference/phantom.md), extended downwards for a small knee or thin layers
    EXPECT_GE(cartilage, 13);
    EXPECT_LE(cartilage, 31.4);
    min_mL = std::min(min_mL, mL("femur"));
    max_mL = std::max(max_mL, mL("femur"));
    EXPECT_GT(mL("medial_meniscus"), 1);
    EXPECT_GT(mL("lateral_meniscus"), 1);
  }
  EXPECT_GT(max_mL / min_mL, 1.03) << "they differ in size";
}

TEST(Phantoms, StructuresOfAllSeedsShareNoPoint) {
  std::mt19937 random(test::test_seed());
  GridGeometry grid;
  grid.dims = {37, 37, 40};
  grid.spacing_mm.setConstant(3);
  for (int n = 0; n < 4; ++n) {
    const std::uint64_t seed = 1 + random() % 100000;
    // another lattice position each time
    const auto shift = [&] { return static_cast<double>(random() % 30) / 10; };
    grid.origin = Point<Patient>(-54 + shift(), -58 + shift(), -58 + shift());
    std::vector<int> inside(grid.voxel_count(), 0);
    for (const PhantomPart& part : knee_phantom_parts(knee_shape(seed))) {
      if (part.label == 0) continue;
      const auto voxels = voxelize_binary(part.shape, grid).value();
      for (std::size_t v = 0; v < inside.size(); ++v) inside[v] += voxels.voxels()[v];
    }
    EXPECT_EQ(*std::ranges::max_element(inside), 1) << "seed " << seed;
  }
}

TEST(Phantoms, ALesionTakesItsLabelFromItsStructure) {
  const Phantom mean = made("knee-phantom:spacing=1.5");
  for (const char* structure : {"femur", "tibia"}) {
    SCOPED_TRACE(structure);
    const std::string requested = "knee-phantom:spacing=1.5,lesion=6,lesion-in=" + std::string(structure);
    const Phantom deep = made(requested + ",lesion-depth=6");
    ASSERT_NE(deep.labels.find("lesion"), nullptr);
    EXPECT_EQ(deep.labels.find("lesion")->id, 200);
    const LabelId from = mean.labels.find(structure)->id;
    std::size_t used = 0, specks = 0;
    for (std::size_t v = 0; v < labels_of(mean).voxels().size(); ++v) {
      const LabelId before = labels_of(mean).voxels()[v], after = labels_of(deep).voxels()[v];
      if (before == after) continue;
      ASSERT_EQ(before, from);
      (after == 200 ? used : specks) += 1;
    }
    EXPECT_LT(specks, 15u) << "voxels that the ball cut off";
    const double ball_mm3 = 4 * std::numbers::pi / 3 * 216;
    const double removed_mm3 = static_cast<double>(used) * 3.375;
    EXPECT_LE(removed_mm3, 1.06 * ball_mm3);
    EXPECT_GE(removed_mm3, 0.9 * ball_mm3);
    // with its centre on the surface about half of it remains, and it is accessible
    const double half = volume_mm3(made(requested), "lesion");
    EXPECT_GT(half, 0.25 * ball_mm3);
    EXPECT_LT(half, 0.6 * ball_mm3);
  }
}

TEST(Phantoms, ALesionIsThereInEveryStructureOfEveryKnee) {
  std::mt19937 random(test::test_seed());
  for (const PhantomPart& part : knee_phantom_parts()) {
    if (part.label == 0) continue;
    for (int n = 0; n < 10; ++n) {
      const auto parts = knee_phantom_parts(knee_shape(n == 0 ? 0 : 1 + random() % 100000));
      const auto found = std::ranges::find(parts, part.name, &PhantomPart::name);
      std::vector<KneeSite> sites;
      for (std::size_t index = 0; index < knee_site_count(part.name); ++index) {
        const KneeSite site = knee_site(part.name, found->shape, index);
        EXPECT_NEAR(found->shape.distance_mm(site.point), 0, 1e-5) << part.name << index;
        EXPECT_LT(found->shape.distance_mm(site.point - 0.3 * site.normal), 0) << part.name << index;
        EXPECT_GT(found->shape.distance_mm(site.point + 0.3 * site.normal), 0) << part.name << index;
        for (const KneeSite& other : sites)
          EXPECT_GT((site.point - other.point).norm(), 5) << part.name << index;
        sites.push_back(site);
      }
      EXPECT_EQ(sites.size(), part.name.ends_with("_cartilage") ? 4u : 1u) << part.name;
    }
  }
}

TEST(Phantoms, ALesionThatIsNotVisibleIsInTheLabelsAlone) {
  const Phantom without = made("knee-phantom:spacing=1.5,seed=5");
  for (const char* at : {"", ",lesion-at=2"}) {
    const std::string requested =
        "knee-phantom:spacing=1.5,seed=5,lesion=4,lesion-in=patellar_cartilage" + std::string(at);
    const Phantom hidden = made(requested + ",visible=no");
    EXPECT_NE(hidden.labels.find("lesion"), nullptr);
    EXPECT_EQ(hidden.scan.voxels(), without.scan.voxels());
    EXPECT_NE(made(requested).scan.voxels(), without.scan.voxels());
  }
}

TEST(Phantoms, OmittedStructuresChangeNothingElse) {
  const Phantom mean = made("knee-phantom:spacing=1.6,seed=3");
  const Phantom odd = made("knee-phantom:spacing=1.6,seed=3,missing=patellar_cartilage+lateral_meniscus");
  EXPECT_EQ(odd.labels.find("patellar_cartilage"), nullptr);
  EXPECT_EQ(odd.labels.find("lateral_meniscus"), nullptr);
  EXPECT_EQ(odd.labels.segments.size(), 13u);
  const LabelId removed[] = {mean.labels.find("patellar_cartilage")->id,
                             mean.labels.find("lateral_meniscus")->id};
  for (std::size_t v = 0; v < labels_of(mean).voxels().size(); ++v) {
    const LabelId before = labels_of(mean).voxels()[v];
    const bool left_out = before == removed[0] || before == removed[1];
    ASSERT_EQ(labels_of(odd).voxels()[v], left_out ? 0 : before);
  }
}

TEST(Phantoms, DefectEndsAtTheBone) {
  const Phantom mean = made("knee-phantom:spacing=1.4");
  const auto parts = knee_phantom_parts();
  for (const char* cartilage : {"femoral_cartilage", "patellar_cartilage"}) {
    SCOPED_TRACE(cartilage);
    const Phantom odd = made("knee-phantom:spacing=1.4,defect=5,defect-in=" + std::string(cartilage));
    const LabelId from = mean.labels.find(cartilage)->id;
    const auto shape = std::ranges::find(parts, std::string(cartilage), &PhantomPart::name)->shape;
    const KneeSite site = knee_site(cartilage, shape);
    const auto X = labels_of(mean).geometry().X_PatientVoxel();
    const auto& dims = labels_of(mean).geometry().dims;
    std::size_t used = 0, far = 0, left_inside = 0;
    for (int k = 0; k < dims[2]; ++k)
      for (int j = 0; j < dims[1]; ++j)
        for (int i = 0; i < dims[0]; ++i) {
          const LabelId before = labels_of(mean).at(i, j, k), after = labels_of(odd).at(i, j, k);
          const Vector<Patient> from_site = X * Point<Voxel>(i, j, k) - site.point;
          const double along = from_site.dot(site.normal);
          const double across = (from_site - along * site.normal).norm();
          if (before != after) {
            ASSERT_TRUE(before == from && after == 0);
            far += across > 5.01;
            ++used;
          }
          left_inside += after == from && across < 4.99 && std::abs(along) < 5.9;
        }
    EXPECT_EQ(left_inside, 0u);
    EXPECT_LT(far, 8u) << "voxels that it cut off";
    // a disc of its radius, one to four millimetres thick
    const double disc_mm2 = std::numbers::pi * 25, removed_mm3 = 2.744 * static_cast<double>(used);
    EXPECT_GT(removed_mm3, 0.9 * disc_mm2);
    EXPECT_LT(removed_mm3, 4 * disc_mm2);
  }
}

// ---- segmentation noise --------------------------------------------------------------------------

TEST(Phantoms, NoiseMovesBordersOnly) {
  const Phantom clean = made("knee-phantom:spacing=1.2"), noisy = made("knee-phantom:spacing=1.2,noise=0.5");
  EXPECT_GT(differing(clean, noisy), 5000u);
  EXPECT_EQ(clean.scan.voxels(), noisy.scan.voxels()) << "the scan is what it was";
  const auto before = statistics(clean), after = statistics(noisy);
  for (const auto& [name, s] : after) {
    const bool bone = name == "femur" || name == "tibia" || name == "fibula" || name == "patella";
    EXPECT_NEAR(s.volume_mm3 / before.at(name).volume_mm3, 1, bone ? 0.02 : 0.15) << name;
    // hand segmentations contain fragments; otherwise the structure stays connected
    EXPECT_GT(static_cast<double>(s.largest_component_voxels), 0.97 * static_cast<double>(s.voxels)) << name;
  }
}

TEST(Phantoms, IslandsAndHolesAreCounted) {
  const Phantom clean = made("knee-phantom:spacing=1.2"), odd = made("knee-phantom:spacing=1.2,islands=25");
  const auto pieces = [](const Phantom& phantom) {
    int count = 0;
    for (const auto& [name, s] : statistics(phantom)) count += s.components;
    return count;
  };
  EXPECT_EQ(pieces(odd), pieces(clean) + 25);
  // holes are components of the background, counted as a structure of its own
  const auto background_pieces = [](const Phantom& phantom) {
    LabelMap inverted = phantom.labels;
    for (LabelId& label : inverted.layers.front().voxels()) label = label == 0 ? 1 : 0;
    inverted.segments = {{1, "background", {}, 0, 1}};
    return segment_statistics(inverted).front().components;
  };
  EXPECT_EQ(background_pieces(odd), background_pieces(clean) + 25);
}

// ---- the other three phantoms --------------------------------------------------------------------

// All `open` voxels connected with `start`; 26-connected, so also across corners.
std::vector<bool> reached(const Volume<LabelId>& labels, const std::array<int, 3>& start) {
  const GridGeometry& grid = labels.geometry();
  std::vector<bool> visited(grid.voxel_count(), false);
  std::vector<std::array<int, 3>> open;
  const auto enter = [&](int i, int j, int k) {
    if (!grid.contains(i, j, k) || labels.at(i, j, k) == 1 || visited[grid.offset(i, j, k)]) return;
    visited[grid.offset(i, j, k)] = true;
    open.push_back({i, j, k});
  };
  enter(start[0], start[1], start[2]);
  while (!open.empty()) {
    const auto [i, j, k] = open.back();
    open.pop_back();
    for (int z = -1; z <= 1; ++z)
      for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) enter(i + x, j + y, k + z);
  }
  return visited;
}

std::array<int, 3> middle_of(const GridGeometry& grid) {
  return {grid.dims[0] / 2, grid.dims[1] / 2, grid.dims[2] / 2};
}

TEST(Phantoms, TheShellIsClosedEvenAcrossCorners) {
  // as thin as the voxels allow
  for (const char* name :
       {"shell-phantom:spacing=1,thickness=1.74", "shell-phantom:spacing=0.8x0.8x2,thickness=2.3",
        "shell-phantom:spacing=1,thickness=1.74,seed=5", "shell-phantom:spacing=1.1,radius=14"}) {
    SCOPED_TRACE(name);
    const Phantom shell = made(name);
    const GridGeometry& grid = labels_of(shell).geometry();
    const auto outside = reached(labels_of(shell), {0, 0, 0});
    const auto m = middle_of(grid);
    EXPECT_EQ(labels_of(shell).at(m[0], m[1], m[2]), 0);
    EXPECT_FALSE(outside[grid.offset(m[0], m[1], m[2])]);
    EXPECT_EQ(statistics(shell).at("shell").components, 1);
  }
}

TEST(Phantoms, TheShellIsAsThickAsAsked) {
  const double radius = 20;
  for (const double thickness : {1.5, 3.0, 6.0}) {
    const Phantom shell = made("shell-phantom:spacing=0.8,radius=20,thickness=" + std::to_string(thickness));
    const double inner = radius - thickness;
    const double exact = 4 * std::numbers::pi / 3 * (radius * radius * radius - inner * inner * inner);
    EXPECT_NEAR(volume_mm3(shell, "shell") / exact, 1, 0.02) << thickness;
  }
  // for every shell, along any ray from the middle outwards, the wall is never thinner than specified
  ShellParameters varied;
  varied.settings.seed = 7;
  const PhantomPlan plan = plan_of(varied);
  const Shape& wall = plan.parts.front().shape;
  std::mt19937 random(test::test_seed());
  std::normal_distribution<double> normal;
  for (int n = 0; n < 60; ++n) {
    const Vector<Patient> ray = Vector<Patient>(normal(random), normal(random), normal(random)).normalized();
    double inside = 0;
    for (double r = 0; r < 40; r += 0.01)
      inside += wall.distance_mm(Point<Patient>(0, 0, 0) + r * ray) < 0 ? 0.01 : 0;
    EXPECT_GT(inside, varied.thickness_mm - 0.02);
    EXPECT_LT(inside, 1.05 * varied.thickness_mm);
  }
}

// Smallest thickness of the wall along x at the temple, and along z at the top; mm.
TEST(Phantoms, TheSkullIsThinAtTheTemples) {
  for (const char* name : {"skull-phantom", "skull-phantom:temporal=3,thickness=8,size=0.8,seed=6"}) {
    SCOPED_TRACE(name);
    const auto parameters = parse_phantom(name).value();
    const auto& skull = std::get<SkullParameters>(parameters);
    const PhantomPlan plan = plan_of(skull);
    const Shape& bone = plan.parts.back().shape;
    ASSERT_EQ(plan.parts.back().name, "skull");
    // from a point in the cavity outwards
    const auto wall_mm = [&](const Point<Patient>& from, const Vector<Patient>& ray) {
      double inside = 0;
      for (double r = 0; r < 120; r += 0.02) inside += bone.distance_mm(from + r * ray) < 0 ? 0.02 : 0;
      return inside * skull.size;
    };
    double smallest = 1e9;
    for (double y = -30; y < 10; y += 4)
      for (double z = -20; z < 15; z += 4)
        for (const double side : {-1.0, 1.0}) {
          const Point<Patient> inside(side * 40, y, z);
          smallest = std::min(smallest, wall_mm(inside, Vector<Patient>(side, 0, 0)));
        }
    EXPECT_NEAR(smallest, skull.temporal_mm, 0.15 * skull.temporal_mm);
    EXPECT_GE(smallest, skull.temporal_mm - 0.05);
    EXPECT_NEAR(wall_mm({0, 0, 30}, {0, 0, 1}), skull.thickness_mm, 0.05);
    EXPECT_NEAR(wall_mm({0, 40, 10}, {0, 1, 0}), skull.thickness_mm, 0.5);
  }
}

TEST(Phantoms, TheSkullHoldsABrainAndOpensThroughItsOrbitsOnly) {
  const Phantom skull = made("skull-phantom:spacing=1.7,temporal=3");
  const auto found = statistics(skull);
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found.at("skull").components, 1);
  EXPECT_EQ(found.at("brain").components, 1);
  // adults have 1.0 to 1.7 litres
  EXPECT_GT(found.at("brain").volume_mm3, 0.9e6);
  EXPECT_LT(found.at("brain").volume_mm3, 1.7e6);
  for (const std::size_t axis : {0u, 1u, 2u}) {
    EXPECT_GT(found.at("brain").box_min[axis], found.at("skull").box_min[axis]);
    EXPECT_LT(found.at("brain").box_max[axis], found.at("skull").box_max[axis]);
  }
  // bone and brain are never in contact: there is fluid between them
  const GridGeometry& grid = labels_of(skull).geometry();
  const auto outside = reached(labels_of(skull), {0, 0, 0});
  const auto m = middle_of(grid);
  EXPECT_TRUE(outside[grid.offset(m[0], m[1], m[2])]) << "by the optic canals";
  // filled orbits close it
  Volume<LabelId> closed = labels_of(skull);
  const auto X = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Point<Patient> p = X * Point<Voxel>(i, j, k);
        if (p.y() < -35 && p.z() < 5) closed.at(i, j, k) = 1;
      }
  EXPECT_FALSE(reached(closed, {0, 0, grid.dims[2] - 1})[grid.offset(m[0], m[1], m[2])]);
  EXPECT_EQ(made("skull-phantom:spacing=2,temporal=4,brain=no").labels.segments.size(), 1u);
}

// number of voxel faces shared by two structures
std::size_t shared_faces(const Phantom& phantom, const char* one, const char* other) {
  const Volume<LabelId>& labels = labels_of(phantom);
  const Segment *a = phantom.labels.find(one), *b = phantom.labels.find(other);
  if (a == nullptr || b == nullptr) return 0;
  const auto& dims = labels.geometry().dims;
  std::size_t faces = 0;
  const auto count = [&](LabelId x, LabelId y) {
    faces += (x == a->id && y == b->id) || (x == b->id && y == a->id);
  };
  for (int k = 0; k + 1 < dims[2]; ++k)
    for (int j = 0; j + 1 < dims[1]; ++j)
      for (int i = 0; i + 1 < dims[0]; ++i) {
        count(labels.at(i, j, k), labels.at(i + 1, j, k));
        count(labels.at(i, j, k), labels.at(i, j + 1, k));
        count(labels.at(i, j, k), labels.at(i, j, k + 1));
      }
  return faces;
}

TEST(Phantoms, TheGlandTouchesTheJawAndTheLayersTouchEachOther) {
  for (const char* variant : {"", ",seed=3", ",size=0.8,gland=18"}) {
    SCOPED_TRACE(variant);
    const Phantom bare = made("gland-phantom:spacing=1" + std::string(variant));
    ASSERT_EQ(statistics(bare).size(), 2u);
    for (const auto& [name, s] : statistics(bare)) EXPECT_EQ(s.components, 1) << name;
    EXPECT_GT(shared_faces(bare, "gland", "mandible"), 60u);
    // in front: no part of it is behind its bone
    EXPECT_LT(statistics(bare).at("gland").centroid.y(), statistics(bare).at("mandible").centroid.y());

    const Phantom covered = made("gland-phantom:spacing=1,fat=4,skin=2" + std::string(variant));
    EXPECT_GT(shared_faces(covered, "gland", "fat"), 200u);
    EXPECT_GT(shared_faces(covered, "mandible", "fat"), 1000u);
    EXPECT_GT(shared_faces(covered, "fat", "skin"), 1000u);
    EXPECT_EQ(shared_faces(covered, "gland", "skin"), 0u) << "fat lies between";
    EXPECT_EQ(volume_mm3(covered, "gland"), volume_mm3(bare, "gland"));
    EXPECT_EQ(volume_mm3(covered, "mandible"), volume_mm3(bare, "mandible"));
  }
  const Phantom skin = made("gland-phantom:spacing=1,skin=3");
  EXPECT_GT(shared_faces(skin, "gland", "skin"), 200u);
  // approximately the requested length
  const auto box = statistics(made("gland-phantom:spacing=1")).at("gland");
  double longest = 0;
  for (const std::size_t axis : {0u, 1u, 2u})
    longest = std::max<double>(longest, box.box_max[axis] - box.box_min[axis] + 1);
  EXPECT_GT(longest, 18);
  EXPECT_LE(longest, 26);
}

// ---- the temporal bone --------------------------------------------------------------------------

// distance between the nearest voxel centres of two structures, mm
double apart_mm(const Phantom& phantom, const std::string& a, const std::string& b) {
  const auto X = labels_of(phantom).geometry().X_PatientVoxel();
  const auto voxels_of = [&](const std::string& name) {
    const LabelId label = statistics(phantom).at(name).id;
    std::vector<Eigen::Vector3d> at;
    const auto& dims = labels_of(phantom).geometry().dims;
    for (int k = 0; k < dims[2]; ++k)
      for (int j = 0; j < dims[1]; ++j)
        for (int i = 0; i < dims[0]; ++i) {
          if (labels_of(phantom).at(i, j, k) != label) continue;
          bool border = false;
          for (const auto& [x, y, z] :
               {std::array{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}})
            border |= labels_of(phantom).at_or(i + x, j + y, k + z, 0) != label;
          if (border) at.push_back((X * Point<Voxel>(i, j, k)).eigen());
        }
    return at;
  };
  const auto first = voxels_of(a), second = voxels_of(b);
  double min_mm2 = 1e9;
  for (const Eigen::Vector3d& p : first)
    for (const Eigen::Vector3d& q : second) min_mm2 = std::min(min_mm2, (p - q).squaredNorm());
  return std::sqrt(min_mm2);
}

// the published spread of each dimension (docs/reference/temporal-bone.md), for any patient
TEST(TemporalBone, ItsDimensionsAreThoseOfPublications) {
  std::set<std::uint64_t> hashes;
  for (const int seed : {0, 1, 2, 3, 4, 5}) {
    const std::string name = "temporal-bone:spacing=0.8,plate=1.4,seed=" + std::to_string(seed);
    SCOPED_TRACE(name);
    const Phantom phantom = made(name);
    const auto found = statistics(phantom);
    ASSERT_EQ(found.size(), 9u);
    for (const char* one : {"temporal_bone", "dura", "sigmoid_sinus", "facial_nerve"})
      EXPECT_EQ(found.at(one).components, 1) << one;
    // centres of voxels are half a voxel inside each surface
    constexpr double kSpacing_mm = 0.8;
    // by micro-CT (10.1186/s40463-019-0324-0): canal to sinus 13.7 with 3.4, nerve to sinus 7.2 with 1.8 mm
    const double canal_mm = apart_mm(phantom, "ear_canal_wall", "sigmoid_sinus");
    EXPECT_GT(canal_mm, 13.7 - 1.6 - 3.4 - kSpacing_mm);
    EXPECT_LT(canal_mm, 15.3 - 1.6 + 2.7 + kSpacing_mm);
    const double nerve_mm = apart_mm(phantom, "facial_nerve", "sigmoid_sinus");
    EXPECT_GT(nerve_mm, 7.2 - 2 * 1.8 - kSpacing_mm);
    EXPECT_LT(nerve_mm, 8.1 + 2 * 2.3 + kSpacing_mm);
    // plates close what the cavity would open
    EXPECT_GT(apart_mm(phantom, "mastoid_cells", "sigmoid_sinus"), 1.4 - kSpacing_mm / 2);
    EXPECT_GT(apart_mm(phantom, "mastoid_cells", "dura"), 1.4 - kSpacing_mm / 2);
    EXPECT_GT(apart_mm(phantom, "mastoid_cells", "facial_nerve"), 1.2 - kVoxel_mm / 2);
    EXPECT_GT(apart_mm(phantom, "mastoid_cortex", "sigmoid_sinus"), 1.4 - kVoxel_mm / 2);
    std::uint64_t hash = kHashSeed;
    hash_bytes(hash, labels_of(phantom).voxels().data(),
               labels_of(phantom).voxels().size() * sizeof(LabelId));
    hashes.insert(hash_finish(hash));
  }
  EXPECT_EQ(hashes.size(), 6u) << "every seed is another patient";
}

TEST(TemporalBone, CellsAreAirInBoneAndCanBeLeftOut) {
  const Phantom cellular = made("temporal-bone"), dense = made("temporal-bone:cells=0");
  const double septa_mm3 = volume_mm3(cellular, "mastoid_cells"),
               all_mm3 = volume_mm3(dense, "mastoid_cells");
  // mean air volume 4 mL, 1.3 to 10.8, of the whole mastoid
  EXPECT_GT(all_mm3 - septa_mm3, 1300);
  EXPECT_LT(all_mm3 - septa_mm3, 10800);
  EXPECT_GT(septa_mm3, 0.2 * all_mm3);
  for (const char* same : {"dura", "sigmoid_sinus", "facial_nerve", "ossicles", "mastoid_cortex"})
    EXPECT_EQ(volume_mm3(cellular, same), volume_mm3(dense, same)) << same;
  // CT values: air in the cells, bone in the septa
  const auto& scan = cellular.scan.voxels();
  std::size_t air = 0;
  for (std::size_t v = 0; v < scan.size(); ++v)
    air += labels_of(cellular).voxels()[v] == 0 && labels_of(dense).voxels()[v] != 0 && scan[v] < -500;
  EXPECT_GT(static_cast<double>(air) * std::pow(0.4, 3), 0.5 * (all_mm3 - septa_mm3));
}

TEST(TemporalBone, ARightOneIsTheMirrorImageOfTheLeft) {
  const std::string odd = "temporal-bone:spacing=1.1,plate=2,seed=4,noise=0.3,cells=4";
  const Phantom left = made(odd), right = made(odd + ",side=right");
  const GridGeometry& grid = labels_of(left).geometry();
  EXPECT_NEAR(grid.centre().x(), 0, 1e-12);
  std::size_t wrong = 0;
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        wrong += labels_of(left).at(i, j, k) != labels_of(right).at(grid.dims[0] - 1 - i, j, k);
  EXPECT_EQ(wrong, 0u);
  EXPECT_GT(statistics(left).at("mastoid_cortex").centroid.x(), 0) << "lateral is to the left";
}

// ---- all phantoms ---------------------------------------------------------------------------------

TEST(Phantoms, AnyCombinationIsAValidLabelMapWithSurfaces) {
  std::mt19937 random(test::test_seed());
  const auto one_of = [&](std::vector<std::string> choices) { return choices[random() % choices.size()]; };
  std::vector<std::string> names;
  for (int n = 0; n < 3; ++n) {
    const std::string common = ",seed=" + std::to_string(random() % 1000) +
                               one_of({"", ",noise=0.4", ",noise=1"}) + one_of({"", ",islands=8"});
    const std::string spacing = one_of({"spacing=2", "spacing=1.5x1.5x2.5", "spacing=2.2x1.8x1.8"});
    names.push_back("knee-phantom:" + spacing + common + one_of({"", ",side=right"}) +
                    one_of({"", ",size=0.8", ",size=1.15"}) +
                    one_of({"", ",lesion=5", ",lesion=6,lesion-in=tibia,lesion-depth=4"}) +
                    one_of({"", ",defect=5", ",missing=patellar_cartilage"}));
    if (n >= 1) continue;
    names.push_back("shell-phantom:" + spacing + common + ",thickness=4" + one_of({"", ",radius=20"}));
    names.push_back("skull-phantom:" + spacing + common + ",temporal=4" + one_of({"", ",brain=no"}));
    names.push_back("gland-phantom:" + spacing + common + one_of({"", ",fat=5", ",fat=5,skin=4"}));
  }
  for (const std::string& name : names) {
    SCOPED_TRACE(name);
    const Phantom phantom = made(name);
    std::set<LabelId> known{0};
    for (const Segment& segment : phantom.labels.segments) known.insert(segment.id);
    std::set<LabelId> present;
    for (const LabelId label : labels_of(phantom).voxels()) present.insert(label);
    EXPECT_EQ(present, known) << "every structure has voxels, and every voxel a structure";
    for (const float value : phantom.scan.voxels()) ASSERT_TRUE(std::isfinite(value));
    std::vector<LabelId> touchable(++known.begin(), known.end());
    const auto surfaces = prepare_surfaces(*label_bricks(labels_of(phantom)), touchable, {});
    EXPECT_TRUE(surfaces.ok()) << surfaces.error().message();
  }
}

}  // namespace
}  // namespace palpate
