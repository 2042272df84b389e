#include "palpate/contact/holes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "palpate/base/hash.h"
#include "palpate/contact/contact_settings.h"

namespace palpate {
namespace {

// through structure 2 at the origin, upwards, 2 mm long, radius 1 mm
Hole made() {
  return {2, {0, 0, 0}, {0, 0, 1}, 2, 1};
}

std::uint64_t hash_of(const Holes& holes) {
  std::uint64_t hash = kHashSeed;
  holes.hash_into(hash);
  return hash_finish(hash);
}

TEST(Holes, AdmitToolsThatFitAtAnyOffset) {
  const Hole hole = made();
  const double play_mm = kProxySettings.hole_play_mm;
  EXPECT_TRUE(hole.fits({0, 0, 0}, 1));
  EXPECT_TRUE(hole.fits({0.9 * play_mm, 0, 0}, 1));
  EXPECT_FALSE(hole.fits({1.1 * play_mm, 0, 0}, 1));
  EXPECT_TRUE(hole.fits({0.9 + play_mm, 0, 0}, 0.1)) << "a thin one has room";
  EXPECT_FALSE(hole.fits({0, 0, 0}, 1.2)) << "wider than the hole";
  EXPECT_TRUE(hole.fits({0, 0, 2 + 0.9 * play_mm}, 1)) << "from the other end";
  EXPECT_FALSE(hole.fits({0, 0, 2 + 1.1 * play_mm}, 1));
  EXPECT_FALSE(hole.fits({0, 0, -1.1 * play_mm}, 1));
}

TEST(Holes, ReachAsDeepAsTheToolHasAdvanced) {
  Holes holes;
  holes.add(made());
  holes.extend(2, {0.3, 0, 5});
  EXPECT_EQ(holes.all()[0].length_mm, 5);
  holes.extend(2, {0.3, 0, 3});
  EXPECT_EQ(holes.all()[0].length_mm, 5) << "it does not grow shorter";
  holes.extend(1, {0, 0, 9});
  holes.extend(2, {4, 0, 9});
  EXPECT_EQ(holes.all()[0].length_mm, 5) << "another structure's, and one beside it";
}

TEST(Holes, OldestHoleClosesBeyondTheMaximum) {
  Holes holes;
  const auto number = static_cast<int>(Holes::kCapacity) + 3;
  for (int n = 0; n < number; ++n) {
    Hole hole = made();
    hole.at = Point<Patient>(10.0 * n, 0, 0);
    holes.add(hole);
  }
  ASSERT_EQ(holes.all().size(), Holes::kCapacity);
  std::vector<double> coordinates;
  for (const Hole& hole : holes.all()) coordinates.push_back(hole.at.x());
  std::sort(coordinates.begin(), coordinates.end());
  EXPECT_EQ(coordinates.front(), 30);
  EXPECT_EQ(coordinates.back(), 10.0 * (number - 1));
}

TEST(Holes, FollowTheirStructureWhenSurfacesAreReordered) {
  Holes holes;
  holes.add(made());
  Hole other = made();
  other.structure = 0;
  holes.add(other);
  const std::uint64_t first = hash_of(holes);
  // structure 0 no longer exists, structure 2 has index 1
  const std::vector<SurfaceCorrespondence> before{{1, true}, {2, false}};
  holes.transfer(before);
  ASSERT_EQ(holes.all().size(), 1u);
  EXPECT_EQ(holes.all()[0].structure, 1);
  EXPECT_NE(hash_of(holes), first);
}

}  // namespace
}  // namespace palpate
