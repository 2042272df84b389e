#include "palpate/volume/overlaps.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <functional>
#include <numeric>
#include <random>
#include <string>

namespace palpate {
namespace {

constexpr int kEdge = 12;

using Shape = std::function<bool(const Eigen::Vector3d&)>;
struct NamedShape {
  std::string name;
  Shape holds;
  std::uint16_t preference = 1;
};

Shape ball(const Eigen::Vector3d& centre, double radius) {
  return [=](const Eigen::Vector3d& p) { return (p - centre).norm() < radius; };
}
Shape half_space(int axis, double from) {
  return [=](const Eigen::Vector3d& p) { return p[axis] >= from; };
}

// a layer each, in this order
LabelMap map_of(const std::vector<NamedShape>& shapes, const std::vector<std::size_t>& order) {
  GridGeometry grid;
  grid.dims = {kEdge, kEdge, kEdge};
  LabelMap map;
  for (std::size_t n = 0; n < order.size(); ++n) {
    const NamedShape& shape = shapes[order[n]];
    Volume<LabelId>& layer = map.layers.emplace_back(grid);
    for (int k = 0; k < kEdge; ++k)
      for (int j = 0; j < kEdge; ++j)
        for (int i = 0; i < kEdge; ++i) layer.at(i, j, k) = shape.holds(Eigen::Vector3d(i, j, k)) ? 1 : 0;
    map.segments.push_back({static_cast<LabelId>(n + 1), shape.name, {}, static_cast<int>(n), 1});
  }
  return map;
}

// names of the flattened voxels
std::vector<std::string> flat_names(const std::vector<NamedShape>& shapes,
                                    const std::vector<std::size_t>& order) {
  const LabelMap map = map_of(shapes, order);
  std::vector<std::uint16_t> preference(order.size() + 1);
  for (std::size_t n = 0; n < order.size(); ++n) preference[n + 1] = shapes[order[n]].preference;
  const Volume<LabelId> flat = flatten(map, segment_overlaps(map), preference);
  std::vector<std::string> names;
  for (const LabelId id : flat.voxels()) names.push_back(id == 0 ? "" : map.find(id)->name);
  return names;
}

std::vector<std::size_t> file_order(std::size_t count) {
  std::vector<std::size_t> order(count);
  std::iota(order.begin(), order.end(), 0u);
  return order;
}

const std::string& name_at(const std::vector<std::string>& names, int i, int j, int k) {
  return names[static_cast<std::size_t>((k * kEdge + j) * kEdge + i)];
}

const Eigen::Vector3d kMiddle(5, 5, 5);

TEST(SegmentOverlaps, CountsSharedVoxelsOfEachPair) {
  const std::vector<NamedShape> shapes{{"low", [](const auto& p) { return p.z() < 6; }},
                                       {"high", half_space(2, 4)},
                                       {"apart", [](const auto& p) { return p.z() < 1; }}};
  const auto overlaps = segment_overlaps(map_of(shapes, file_order(3)));
  ASSERT_EQ(overlaps.size(), 2u);
  EXPECT_EQ(overlaps[0].smaller, 1);
  EXPECT_EQ(overlaps[0].larger, 2);
  EXPECT_EQ(overlaps[0].voxels, 2u * kEdge * kEdge);
  EXPECT_DOUBLE_EQ(overlaps[0].fraction, 2.0 / 6);
  EXPECT_FALSE(overlaps[0].is_nested());
  EXPECT_EQ(overlaps[1].smaller, 3);
  EXPECT_EQ(overlaps[1].larger, 1);
  EXPECT_TRUE(overlaps[1].is_nested());
}

TEST(SegmentOverlaps, SingleLayerHasNone) {
  EXPECT_TRUE(segment_overlaps(map_of({{"one", ball(kMiddle, 3)}}, {0})).empty());
}

TEST(EnclosingSegments, AreOrderedBySize) {
  const std::vector<NamedShape> shapes{{"GTV", ball(kMiddle, 2)},
                                       {"CTV", ball(kMiddle, 4)},
                                       {"PTV", ball(kMiddle, 5.5)},
                                       {"crossing", half_space(2, 5)}};
  std::vector<std::size_t> order = file_order(shapes.size());
  do {
    const LabelMap map = map_of(shapes, order);
    const auto enclosing = enclosing_segments(segment_overlaps(map));
    const auto names_around = [&](const std::string& name) {
      std::vector<std::string> names;
      if (const LabelId id = map.find(name)->id; id < enclosing.size())
        for (const LabelId larger : enclosing[id]) names.push_back(map.find(larger)->name);
      return names;
    };
    EXPECT_EQ(names_around("GTV"), (std::vector<std::string>{"CTV", "PTV"}));
    EXPECT_EQ(names_around("CTV"), std::vector<std::string>{"PTV"});
    EXPECT_TRUE(names_around("PTV").empty());
    EXPECT_TRUE(names_around("crossing").empty());
  } while (std::ranges::next_permutation(order).found);
}

TEST(Flatten, InnermostNestedSegmentOwnsTheVoxel) {
  // the outer ones are preferred, as bone around a soft tumour is
  const std::vector<NamedShape> shapes{
      {"GTV", ball(kMiddle, 2), 1}, {"CTV", ball(kMiddle, 4), 2}, {"PTV", ball(kMiddle, 5.5), 3}};
  std::vector<std::size_t> order = file_order(shapes.size());
  do {
    const auto names = flat_names(shapes, order);
    EXPECT_EQ(name_at(names, 5, 5, 5), "GTV");
    EXPECT_EQ(name_at(names, 8, 5, 5), "CTV");
    EXPECT_EQ(name_at(names, 10, 5, 5), "PTV");
    EXPECT_EQ(name_at(names, 11, 11, 11), "");
  } while (std::ranges::next_permutation(order).found);
}

TEST(Flatten, CrossingSegmentsResolveByPreferenceThenSize) {
  const auto crossing = [](std::uint16_t of_low, std::uint16_t of_high) {
    return std::vector<NamedShape>{{"low", [](const auto& p) { return p.z() < 7; }, of_low},
                                   {"high", half_space(2, 6), of_high}};
  };
  for (const auto& order : {std::vector<std::size_t>{0, 1}, {1, 0}}) {
    EXPECT_EQ(name_at(flat_names(crossing(2, 1), order), 5, 5, 6), "low");
    EXPECT_EQ(name_at(flat_names(crossing(1, 2), order), 5, 5, 6), "high");
    EXPECT_EQ(name_at(flat_names(crossing(1, 1), order), 5, 5, 6), "high") << "6 slices and not 7";
  }
}

TEST(Flatten, NestedSegmentWithPreferenceZeroYieldsToTheOuter) {
  const std::vector<NamedShape> shapes{{"lumen", ball(kMiddle, 2), 0}, {"vessel", ball(kMiddle, 4), 1}};
  for (const auto& order : {std::vector<std::size_t>{0, 1}, {1, 0}})
    EXPECT_EQ(name_at(flat_names(shapes, order), 5, 5, 5), "vessel");
}

TEST(Flatten, RandomArrangementsAreIndependentOfOrder) {
  constexpr unsigned kSeed = 50;
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> coordinate(0, kEdge), radius(1, 7);
  std::uniform_int_distribution<std::uint16_t> preference(0, 2);
  for (int arrangement = 0; arrangement < 10; ++arrangement) {
    SCOPED_TRACE("seed " + std::to_string(kSeed) + ", arrangement " + std::to_string(arrangement));
    std::vector<NamedShape> shapes;
    for (int n = 0; n < 5; ++n)
      shapes.push_back({"s" + std::to_string(n),
                        ball({coordinate(random), coordinate(random), coordinate(random)}, radius(random)),
                        preference(random)});
    std::vector<std::size_t> order = file_order(shapes.size());
    const auto expected = flat_names(shapes, order);
    for (int n = 0; n < 8; ++n) {
      std::ranges::shuffle(order, random);
      EXPECT_EQ(flat_names(shapes, order), expected);
    }
  }
}

}  // namespace
}  // namespace palpate
