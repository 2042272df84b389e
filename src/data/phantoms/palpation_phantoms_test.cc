#include "phantoms/palpation_phantoms.h"

#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <set>

#include "base/test_seed.h"
#include "palpate/phantoms/primitives.h"
#include "phantoms/phantom_plan.h"

namespace palpate {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

// parameters parsed from a name
PhantomParameters parameters_of(const std::string& name) {
  const auto parameters = parse_phantom(name);
  EXPECT_TRUE(parameters.ok()) << (parameters.ok() ? "" : parameters.error().message());
  return parameters.value();
}

Phantom palpated(const std::string& name) {
  auto phantom = make_phantom(parameters_of(name));
  PALPATE_CHECK(phantom.ok());
  return std::move(phantom).value();
}

std::map<std::string, SegmentStatistics> structures_of(const Phantom& phantom) {
  std::map<std::string, SegmentStatistics> by_name;
  for (const SegmentStatistics& s : segment_statistics(phantom.labels))
    by_name[phantom.labels.find(s.id)->name] = s;
  return by_name;
}

std::string label_at(const Phantom& phantom, const Point<Patient>& p) {
  const Volume<LabelId>& labels = phantom.labels.layers.front();
  const Point<Voxel> v = labels.geometry().X_PatientVoxel().inverse() * p;
  const LabelId label =
      labels.at_or(static_cast<int>(std::lround(v.x())), static_cast<int>(std::lround(v.y())),
                   static_cast<int>(std::lround(v.z())), 0);
  return label == 0 ? "" : phantom.labels.find(label)->name;
}

// thickness of each structure along y from a point on, in order
std::vector<std::pair<std::string, double>> layers_below(const Phantom& phantom, const Point<Patient>& from) {
  constexpr double kFar_mm = 120;
  const double step_mm = phantom.scan.geometry().spacing_mm.y();
  std::vector<std::pair<std::string, double>> layers;
  for (double deep_mm = 0.5 * step_mm; deep_mm < kFar_mm; deep_mm += step_mm) {
    const std::string label = label_at(phantom, from + Vector<Patient>(0, deep_mm, 0));
    if (layers.empty() || layers.back().first != label) layers.emplace_back(label, 0);
    layers.back().second += step_mm;
  }
  return layers;
}

const Shape& shape_of(const PhantomPlan& plan, const std::string& part) {
  return std::ranges::find(plan.parts, part, &PhantomPart::name)->shape;
}

TEST(PalpationPhantoms, NodulesHaveTheVolumeOfBalls) {
  for (const char* name : {"palpation-block:spacing=0.5,width=44,thickness=25",
                           "palpation-block:spacing=0.5,width=50,thickness=25,diameter=12,seed=9",
                           "palpation-block:spacing=0.5,width=50,thickness=25,nodules=3,seed=2",
                           "palpation-dome:spacing=0.5,radius=25,height=25,diameter=10"}) {
    SCOPED_TRACE(name);
    const PhantomParameters parameters = parameters_of(name);
    const NoduleParameters& nodules = *nodule_parameters(parameters);
    const auto found = structures_of(palpated(name));
    const double ball_mm3 = std::numbers::pi / 6 * std::pow(nodules.diameter_mm, 3);
    EXPECT_NEAR(found.at("nodule").volume_mm3 / (static_cast<double>(nodules.nodules) * ball_mm3), 1, 0.016);
    EXPECT_EQ(found.at("nodule").components, static_cast<int>(nodules.nodules));
    EXPECT_EQ(found.at("soft_tissue").components, 1);
    EXPECT_EQ(found.at("plate").components, 1);
  }
}

TEST(PalpationPhantoms, ABlocksNodulesLieAsDeepAsAsked) {
  for (const double depth_mm : {2.0, 5.0, 9.5}) {
    const std::string name = "palpation-block:spacing=0.5,width=56,thickness=30,nodules=4,diameter=6,depth=" +
                             std::to_string(depth_mm);
    SCOPED_TRACE(name);
    const Phantom block = palpated(name);
    const auto nodules = phantom_nodules(parameters_of(name)).value();
    ASSERT_EQ(nodules.size(), 4u);
    for (const PhantomNodule& nodule : nodules) {
      EXPECT_EQ(nodule.radius_mm, 3);
      const auto layers = layers_below(block, nodule.surface);
      ASSERT_GE(layers.size(), 4u);
      EXPECT_EQ(layers[0].first, "soft_tissue");
      EXPECT_NEAR(layers[0].second, depth_mm, 0.25);
      EXPECT_EQ(layers[1].first, "nodule");
      EXPECT_NEAR(layers[1].second, 6, 0.5);
      EXPECT_EQ(layers[2].first, "soft_tissue");
      EXPECT_EQ(layers[3], (std::pair<std::string, double>("plate", 5)));
      EXPECT_NEAR(layers[0].second + layers[1].second + layers[2].second, 30, 1e-9);
    }
  }
}

// below a curved surface, depth is along the normal
TEST(PalpationPhantoms, ADomesNodulesLieAsDeepAsAsked) {
  for (const char* name :
       {"palpation-dome", "palpation-dome:nodules=4", "palpation-dome:nodules=7,diameter=6,seed=5",
        "palpation-dome:nodules=5,depth=8,radius=50,height=40"}) {
    SCOPED_TRACE(name);
    const PhantomParameters parameters = parameters_of(name);
    const auto& dome = std::get<DomeParameters>(parameters);
    const PhantomPlan plan = plan_of(dome);
    const Shape& tissue = shape_of(plan, "soft_tissue");
    const auto nodules = phantom_nodules(parameters).value();
    ASSERT_EQ(nodules.size(), dome.nodules.nodules);
    const Phantom phantom = palpated(name);
    for (const PhantomNodule& nodule : nodules) {
      const Vector<Patient> inward = (nodule.centre - nodule.surface).normalized();
      EXPECT_NEAR(tissue.distance_mm(nodule.surface), 0, 1e-6);
      EXPECT_NEAR(tissue.distance_mm(nodule.centre - nodule.radius_mm * inward), -dome.nodules.depth_mm,
                  1e-6);
      EXPECT_NEAR((nodule.centre - nodule.surface).norm(), dome.nodules.depth_mm + nodule.radius_mm, 1e-9);
      EXPECT_LE(nodule.centre.y() + nodule.radius_mm, -2) << "soft tissue above the plate";
      // and so in the voxels
      const double mm = phantom.scan.geometry().spacing_mm.norm() / 2;
      EXPECT_EQ(label_at(phantom, nodule.surface - mm * inward), "");
      EXPECT_EQ(label_at(phantom, nodule.surface + mm * inward), "soft_tissue");
      const Point<Patient> top = nodule.surface + dome.nodules.depth_mm * inward;
      EXPECT_EQ(label_at(phantom, top - mm * inward), "soft_tissue");
      EXPECT_EQ(label_at(phantom, top + mm * inward), "nodule");
      EXPECT_EQ(label_at(phantom, nodule.centre), "nodule");
    }
  }
}

TEST(PalpationPhantoms, SeedsGiveOtherPlacesWithoutOverlap) {
  std::mt19937 random(test::test_seed());
  for (const std::string base : {"palpation-block:nodules=6", "palpation-dome:nodules=4,diameter=6"}) {
    std::vector<Point<Patient>> first;
    for (int n = 0; n < 30; ++n) {
      const std::string name = base + ",seed=" + std::to_string(n == 0 ? 0 : 1 + random() % 1'000'000);
      SCOPED_TRACE(name);
      const PhantomParameters parameters = parameters_of(name);
      const auto nodules = phantom_nodules(parameters).value();
      const double diameter_mm = nodule_parameters(parameters)->diameter_mm;
      ASSERT_EQ(nodules.size(), nodule_parameters(parameters)->nodules);
      for (std::size_t a = 0; a < nodules.size(); ++a) {
        const double from_middle_mm = std::hypot(nodules[a].centre.x(), nodules[a].centre.z());
        EXPECT_LE(from_middle_mm, 40 - 0.5 * diameter_mm - 4 + 1e-9) << "4 mm from the sides";
        for (std::size_t b = 0; b < a; ++b)
          EXPECT_GE((nodules[a].centre - nodules[b].centre).norm(), 1.5 * diameter_mm);
      }
      first.push_back(nodules.front().centre);
      const auto again = phantom_nodules(parameters).value();
      for (std::size_t a = 0; a < nodules.size(); ++a) EXPECT_EQ(again[a].centre, nodules[a].centre);
    }
    EXPECT_EQ(first[0].x(), 0) << "seed 0 has the first in the middle";
    EXPECT_EQ(first[0].z(), 0);
    int near_first = 0;
    for (std::size_t a = 1; a < first.size(); ++a) near_first += (first[a] - first[a - 1]).norm() < 1;
    EXPECT_LE(near_first, 2) << "they are spread over the surface";
  }
}

TEST(PalpationPhantoms, WithoutNodulesAllIsSoft) {
  // the second has whole blocks of voxels within a nodule
  for (const std::string base :
       {"palpation-block:spacing=1.5", "palpation-block:spacing=0.5,width=44,thickness=25",
        "palpation-dome:spacing=1.5"}) {
    SCOPED_TRACE(base);
    const Phantom with = palpated(base), without = palpated(base + ",nodules=0");
    EXPECT_TRUE(phantom_nodules(parameters_of(base + ",nodules=0")).value().empty());
    EXPECT_EQ(without.labels.find("nodule"), nullptr);
    const LabelId soft = with.labels.find("soft_tissue")->id, nodule = with.labels.find("nodule")->id;
    const auto &a = with.labels.layers.front().voxels(), &b = without.labels.layers.front().voxels();
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t v = 0; v < a.size(); ++v) ASSERT_EQ(b[v], a[v] == nodule ? soft : a[v]);
    // the scan alone does not distinguish the two
    EXPECT_EQ(with.scan.voxels(), without.scan.voxels());
    EXPECT_NE(palpated(base + ",visible=yes").scan.voxels(), without.scan.voxels());
  }
  EXPECT_TRUE(phantom_nodules(KneeParameters{}).value().empty());
  EXPECT_EQ(nodule_parameters(KneeParameters{}), nullptr);
}

TEST(PalpationPhantoms, RejectsParametersThatDoNotFitWithARemedy) {
  const auto message = [](const std::string& name) {
    const auto parsed = parse_phantom(name);
    EXPECT_FALSE(parsed.ok()) << name;
    return parsed ? std::string() : parsed.error().message();
  };
  EXPECT_THAT(message("palpation-block:nodules=13"), HasSubstr("`nodules` is 0 ... 12"));
  EXPECT_THAT(message("palpation-block:diameter=1"), HasSubstr("`diameter` is 2 ... 30 mm"));
  EXPECT_THAT(message("palpation-block:depth=0"), HasSubstr("`depth` is 1 ... 40 mm"));
  EXPECT_THAT(message("palpation-block:stiffness=0.5"), HasSubstr("`stiffness` is 1 ... 100"));
  EXPECT_THAT(message("palpation-block:visible=maybe"), HasSubstr("`visible` is yes or no"));
  EXPECT_THAT(message("palpation-block:depth=31"),
              AllOf(HasSubstr("1 nodule of 8 mm with 31 mm of tissue over each"),
                    HasSubstr("a block of 80 mm by 40 mm"), HasSubstr("make `depth`, `diameter`")));
  EXPECT_TRUE(parse_phantom("palpation-block:depth=30").ok()) << "2 mm are left below it";
  EXPECT_THAT(message("palpation-block:nodules=12,diameter=20,thickness=60"),
              HasSubstr("12 nodules of 20 mm"));
  EXPECT_THAT(message("palpation-block:nodules=12,diameter=20,thickness=60,seed=4"), HasSubstr("do not fit"));
  EXPECT_THAT(message("palpation-block:width=30,diameter=28"), HasSubstr("do not fit"));
  EXPECT_THAT(message("palpation-block:diameter=2.9"), HasSubstr("too small for voxels of 1 mm"));
  EXPECT_THAT(message("palpation-block:depth=1.5"), HasSubstr("`depth` of 1.5 mm is less than the diagonal"));
  EXPECT_TRUE(parse_phantom("palpation-block:depth=1.5,nodules=0").ok()) << "there is none";
  EXPECT_THAT(message("palpation-dome:depth=30"), HasSubstr("a dome of radius 40 mm and height 35 mm"));
  EXPECT_THAT(message("palpation-dome:height=15,diameter=10"), HasSubstr("`height` or `radius`"));
  EXPECT_THAT(message("abdominal-wall:skin=1"), HasSubstr("`skin` of 1 mm is less than the diagonal"));
  EXPECT_THAT(message("abdominal-wall:fat=1,spacing=0.6"), HasSubstr("`fat` of 1 mm"));
  EXPECT_THAT(message("abdominal-wall:nodules=1"), HasSubstr("no key `nodules`"));
  // also for parameters that do not come from a name
  BlockParameters block;
  block.nodules.depth_mm = 35;
  EXPECT_FALSE(make_phantom(block).ok());
  EXPECT_FALSE(phantom_nodules(block).ok());
}

TEST(PalpationPhantoms, TheAbdominalWallHasItsLayersOverRibAndLiver) {
  for (const char* variant : {"", ":seed=4", ":skin=3,fat=20,muscle=12,spacing=1"}) {
    SCOPED_TRACE(variant);
    const std::string name = "abdominal-wall" + std::string(variant);
    const PhantomParameters parameters = parameters_of(name);
    const auto& requested = std::get<AbdomenParameters>(parameters);
    const Phantom wall = palpated(name);
    const auto found = structures_of(wall);
    ASSERT_EQ(found.size(), 8u);
    for (const auto& [structure, s] : found)
      EXPECT_GT(static_cast<double>(s.largest_component_voxels), 0.99 * static_cast<double>(s.voxels))
          << structure;

    // the wall has the same thickness everywhere, whatever is below
    std::set<std::string> below;
    for (double x = -35.5; x < 36; x += 7)
      for (double z = -38.5; z < 39; z += 1) {
        const auto layers = layers_below(wall, Point<Patient>(x, 0, z));
        ASSERT_GE(layers.size(), 5u);
        EXPECT_EQ(layers[0], (std::pair<std::string, double>("skin", requested.skin_mm)));
        EXPECT_EQ(layers[1], (std::pair<std::string, double>("fat", requested.fat_mm)));
        EXPECT_EQ(layers[2], (std::pair<std::string, double>("muscle", requested.muscle_mm)));
        below.insert(layers[3].first);
        double inside_mm = 0;
        std::size_t n = 3;
        for (; layers[n].first != "back"; ++n) inside_mm += layers[n].second;
        EXPECT_NEAR(inside_mm, 25, 1e-9);
      }
    EXPECT_THAT(below, ::testing::UnorderedElementsAre("rib", "liver", "liver_edge", "viscera"));
    // superior: the liver, and in it the rib; inferior: the edge, and beyond it soft tissue
    EXPECT_GT(found.at("rib").centroid.z(), found.at("liver_edge").centroid.z() + 20);
    EXPECT_GT(found.at("liver").centroid.z(), found.at("liver_edge").centroid.z() + 5);
    EXPECT_LT(found.at("viscera").centroid.z(), found.at("liver").centroid.z());
  }
  const Phantom plain = palpated("abdominal-wall:edge=0,rib=no,fat=0,spacing=1.1");
  EXPECT_EQ(structures_of(plain).size(), 5u);
  for (const char* absent : {"liver_edge", "rib", "fat"})
    EXPECT_EQ(plain.labels.find(absent), nullptr) << absent;
}

}  // namespace
}  // namespace palpate
