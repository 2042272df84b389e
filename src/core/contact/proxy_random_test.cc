#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>

#include "contact/test_proxy_floor.h"

namespace palpate {
namespace {

using testing::cube_grid;
using testing::kKnee_mm;
using testing::kProxySeed;
using testing::make_contact_surface;
using testing::ProxyRun;
using testing::random_direction;

// the cache of a resting proxy may only affect the time
TEST(Proxy, CachedContactAtRestEqualsAFreshSearch) {
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  std::uniform_real_distribution<double> unit(0, 1), about(-1, 1);
  long rests = 0, ticks = 0, ruptures = 0;
  for (int scene = 0; scene < 30; ++scene) {
    ProxyRun run;
    for (int s = 0; s < 4; ++s) {
      const Eigen::Vector3d centre(2 * about(random), 2 * about(random), 2 * about(random));
      const double radius_mm = 1.5 + 2 * unit(random);
      run.surfaces.push_back(make_contact_surface(
          cube_grid(9, {0.5, 0.5, 0.5}),
          [=](const Eigen::Vector3d& p) { return (p - centre).norm() - radius_mm; }, 2));
      ContactSurface& surface = run.surfaces.back();
      surface.friction = 0.4 * unit(random);
      surface.static_friction = surface.friction + 0.3 * unit(random);
      surface.layer = s / 2;
      if (scene % 3 == 0 && s == 0) surface.puncture_N = 1.5;
    }
    // in some scenes friction and stiffness vary along the surface by ownership shares
    if (scene % 4 == 2) {
      Volume<LabelId> halves(cube_grid(9, {0.5, 0.5, 0.5}));
      const auto X_PatientVoxel = halves.geometry().X_PatientVoxel();
      const auto& dims = halves.geometry().dims;
      for (int k = 0; k < dims[2]; ++k)
        for (int j = 0; j < dims[1]; ++j)
          for (int i = 0; i < dims[0]; ++i) {
            const Eigen::Vector3d p = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen();
            if (p.norm() < 4) halves.at(i, j, k) = p.x() < 0.3 * p.y() ? 1 : 2;
          }
      run.surfaces[0].owners =
          std::make_shared<const Owners>(*label_bricks(halves), std::vector<std::int16_t>{-1, 0, 1});
      run.surfaces[1].stiffness_N_per_mm = 0.6;
    }
    // one sphere, three that rotate, or two with a shaft
    const double radius_mm = unit(random);
    run.parts = {{{}, radius_mm}};
    if (scene % 3 == 1) run.parts.insert(run.parts.end(), {{{2, 0, 0}, 0.5}, {{0, 2, 1}, 0.7}});
    if (scene % 5 == 4) run.parts.push_back({{0, 0, 0.5}, 0.3, {0, 0, 4}});
    ProxyState without_cache;
    Holes holes;
    Point<Patient> tip(0, 0, 12);
    Vector<Patient> displacement;
    Eigen::Quaterniond attitude = Eigen::Quaterniond::Identity();
    for (int n = 0; n < 1500; ++n) {
      // alternately held still with a tremor, and moving
      const bool is_jittering = n % 300 > 120;
      displacement = displacement * 0.97 + random_direction(random) * 0.05 + (Point<Patient>() - tip) * 0.003;
      tip += is_jittering ? random_direction(random) * 0.002 : displacement;
      if (!is_jittering && scene % 2 == 1)
        attitude = Eigen::AngleAxisd(0.01, random_direction(random).eigen()) * attitude;
      const ToolPose hand(tip, attitude);
      const auto parts = run.turned(hand.attitude);
      const bool knew =
          !run.state.cache(0).at_rest.find(run.state.position, run.state.punctured, parts.parts()).empty();
      const ProxyResult is =
          advance_proxy(run.surfaces, parts.parts(), hand, run.state, {.holes = &run.holes});
      for (int layer = 0; layer < kMaxLayers; ++layer) without_cache.cache(layer).at_rest.invalidate();
      const ProxyResult expected =
          advance_proxy(run.surfaces, parts.parts(), hand, without_cache, {.holes = &holes});
      ASSERT_EQ(is.force_N, expected.force_N) << "scene " << scene << ", tick " << n;
      ASSERT_EQ(is.torque_Nmm, expected.torque_Nmm);
      ASSERT_EQ(is.normal, expected.normal);
      ASSERT_EQ(is.friction, expected.friction);
      ASSERT_EQ(is.stiffness_N_per_mm, expected.stiffness_N_per_mm);
      ASSERT_EQ(is.stored_mJ, expected.stored_mJ);
      ASSERT_EQ(is.wedged, expected.wedged);
      ASSERT_EQ(is.lagging, expected.lagging);
      ASSERT_EQ(is.ruptured, expected.ruptured);
      for (int m = 0; m < 2; ++m) {
        const ProxyLayer &layer = run.state.layer(m), &other = without_cache.layer(m);
        ASSERT_EQ(layer.position, other.position) << "scene " << scene << ", tick " << n << ", layer " << m;
        ASSERT_EQ(layer.attitude.coeffs(), other.attitude.coeffs());
        ASSERT_EQ(layer.last_displacement, other.last_displacement);
        ASSERT_EQ(layer.coupled, other.coupled);
        ASSERT_EQ(layer.sticking, other.sticking);
        ASSERT_EQ(layer.punctured, other.punctured);
        ASSERT_EQ(layer.stretch_fraction, other.stretch_fraction);
        ASSERT_EQ(layer.spring_N_per_mm, other.spring_N_per_mm);
        ASSERT_EQ(layer.catch_up_mm, other.catch_up_mm);
        ASSERT_EQ(layer.stranded_s, other.stranded_s);
        ASSERT_EQ(layer.contact_count, other.contact_count);
        for (int c = 0; c < layer.contact_count; ++c) {
          const ProxyContact &contact = layer.contacts[static_cast<std::size_t>(c)],
                             &again = other.contacts[static_cast<std::size_t>(c)];
          ASSERT_EQ(contact.surface, again.surface);
          ASSERT_EQ(contact.part, again.part);
          ASSERT_EQ(contact.axis_fraction, again.axis_fraction);
          ASSERT_EQ(contact.normal, again.normal);
          ASSERT_EQ(contact.multiplier_mm, again.multiplier_mm);
        }
      }
      rests += knew && run.state.contact_count > 0;
      ruptures += is.ruptured;
      ++ticks;
    }
  }
  EXPECT_GT(rests, ticks / 10);
  EXPECT_GT(ruptures, 0);
}

TEST(Proxy, RestCacheIsKeyedByToolAndPosition) {
  const Point<Patient> position(1, 2, 3);
  const ToolPart part{{0, 0, 1}, 0.5};
  const RestingContacts::Constraint plane{{0, 0, 1}, 2.5, 4, 0};
  RestingContacts touched;
  EXPECT_TRUE(touched.find(position, {}, {&part, 1}).empty());
  touched.store(position, {}, {&part, 1}, {&plane, 1});
  ASSERT_EQ(touched.find(position, {}, {&part, 1}).size(), 1u);
  EXPECT_EQ(touched.find(position, {}, {&part, 1})[0].surface, 4);
  EXPECT_TRUE(touched.find({1, 2, 3.0000001}, {}, {&part, 1}).empty());
  EXPECT_TRUE(touched.find(position, SurfaceSet(1), {&part, 1}).empty());
  const ToolPart wider{{0, 0, 1}, 0.6}, turned{{0, 1, 0}, 0.5}, capsule{{0, 0, 1}, 0.5, {0, 0, 2}};
  for (const ToolPart& other : {wider, turned, capsule})
    EXPECT_TRUE(touched.find(position, {}, {&other, 1}).empty());
  const std::array two{part, part};
  EXPECT_TRUE(touched.find(position, {}, two).empty());
  touched.invalidate();
  EXPECT_TRUE(touched.find(position, {}, {&part, 1}).empty());
}

// whatever is touched, the work of a tick is bounded and the penetration within tolerance
TEST(Proxy, RandomPathsOverRandomSurfacesStayOutside) {
  SCOPED_TRACE("seed " + std::to_string(kProxySeed));
  std::mt19937 random(kProxySeed);
  std::uniform_real_distribution<double> unit(0, 1), about(-1, 1);
  for (int scene = 0; scene < 24; ++scene) {
    ProxyRun run;
    const auto turned = Eigen::AngleAxisd(3 * unit(random), random_direction(random).eigen());
    for (int s = 0; s < 3; ++s) {
      // overlapping or separate balls and rods, well inside the volume
      const Eigen::Vector3d centre(3 * about(random), 3 * about(random), 3 * about(random));
      const Eigen::Vector3d axis = random_direction(random).eigen();
      const double radius_mm = 1 + 2 * unit(random);
      const double half_length_mm = unit(random) < 0.5 ? 3 : 0;
      run.surfaces.push_back(make_contact_surface(
          cube_grid(14, kKnee_mm, turned.toRotationMatrix()),
          [=](const Eigen::Vector3d& p) {
            const Eigen::Vector3d v = p - centre;
            return (v - axis * std::clamp(axis.dot(v), -half_length_mm, half_length_mm)).norm() - radius_mm;
          },
          2));
      run.surfaces.back().static_friction = 0.3 * unit(random);
    }
    run.parts = {{{}, 1.5 * unit(random)}};
    Point<Patient> tip(0, 0, 20);
    run.at(tip);
    ASSERT_TRUE(run.state.coupled);
    Vector<Patient> velocity_mm;
    for (int n = 0; n < 3000; ++n) {
      // at most 0.5 m/s at 1 kHz, attracted to the centre
      velocity_mm = velocity_mm * 0.97 + random_direction(random) * 0.06 + (Point<Patient>() - tip) * 0.002;
      if (velocity_mm.norm() > 0.5) velocity_mm = velocity_mm * (0.5 / velocity_mm.norm());
      tip += velocity_mm;
      run.at(tip);
      ASSERT_TRUE(run.result.force_N.all_finite());
      ASSERT_LT(run.deepest_mm, kProxySettings.max_penetration_mm) << "scene " << scene << ", tick " << n;
    }
  }
}

}  // namespace
}  // namespace palpate
