#include "palpate/tissue/fragments.h"

#include <gtest/gtest.h>

#include <array>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "base/test_seed.h"

namespace palpate {
namespace {

constexpr LabelId kSolid = 1, kAlarmed = 2, kUnfelt = 3;
constexpr double kBreakEnergy_mJ_per_mm3 = 100;

// labels without surfaces: bone, a structure with an alarm, and one that is not felt
Model model_to_break(const Volume<LabelId>& labels) {
  Model model;
  model.labels = std::make_shared<const Bricks<LabelId>>(labels, LabelId{0});
  model.tissues.resize(3);
  model.tissues[0].cutting_energy_mJ_per_mm3 = kBreakEnergy_mJ_per_mm3;
  model.tissues[1].protection = Protection::kAlarm;
  model.tissues[2].touchable = false;
  model.tissue_of_label = {-1, 0, 1, 2};
  return model;
}

Volume<LabelId> empty_grid(int size) {
  GridGeometry grid;
  grid.dims = {size, size, size};
  return Volume<LabelId>(grid);
}

bool holds_together(LabelId label) {
  return label == kSolid || label == kAlarmed;
}

// number of the 26-connected component of every felt voxel, from 1, by repeated passes over the volume
Volume<int> components_of(const Bricks<LabelId>& labels) {
  const GridGeometry& grid = labels.geometry();
  Volume<int> number(grid);
  int next = 0;
  const auto for_all = [&](const auto& run) {
    for (int k = 0; k < grid.dims[2]; ++k)
      for (int j = 0; j < grid.dims[1]; ++j)
        for (int i = 0; i < grid.dims[0]; ++i)
          if (holds_together(labels.at(i, j, k))) run(i, j, k);
  };
  for_all([&](int i, int j, int k) { number.at(i, j, k) = ++next; });
  for (bool changed = true; changed;) {
    changed = false;
    for_all([&](int i, int j, int k) {
      for (int n = 0; n < 27; ++n) {
        const int a = i + n % 3 - 1, b = j + n / 3 % 3 - 1, c = k + n / 9 - 1;
        if (!grid.contains(a, b, c) || number.at(a, b, c) <= number.at(i, j, k)) continue;
        number.at(i, j, k) = number.at(a, b, c);
        changed = true;
      }
    });
  }
  return number;
}

std::map<int, int> component_sizes(const Volume<int>& components) {
  std::map<int, int> sizes;
  for (const int number : components.voxels()) ++sizes[number];
  return sizes;
}

// labels without all fragments: the definition, voxel by voxel
Volume<LabelId> without_fragments(const Bricks<LabelId>& original, const Bricks<LabelId>& labels) {
  const Volume<int> before = components_of(original), now = components_of(labels);
  const std::map<int, int> sizes_before = component_sizes(before), sizes = component_sizes(now);
  const int most = static_cast<int>(kMaxFragment_mm3 / labels.geometry().spacing_mm.prod());
  std::map<int, bool> spared;
  const auto& dims = labels.geometry().dims;
  Volume<LabelId> left = labels.dense();
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i)
        if (left.at(i, j, k) == kAlarmed) spared[now.at(i, j, k)] = true;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i) {
        const int number = now.at(i, j, k);
        if (number != 0 && sizes.at(number) <= most && sizes_before.at(before.at(i, j, k)) > most &&
            !spared.contains(number))
          left.at(i, j, k) = 0;
      }
  return left;
}

std::shared_ptr<const Carving> carved_clean(const Model& model, const Carving& before,
                                            const std::vector<Cut>& cuts) {
  const auto cut = before.with(cuts);
  return cut->with(fragments_of(model, *cut, cuts));
}

TEST(Fragments, RandomLabelsLoseWhatIsCutLooseInAnyNumberOfVersions) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  int removed = 0, stayed = 0;
  for (int round = 0; round < 60; ++round) {
    Volume<LabelId> labels = empty_grid(16);
    const double density = std::uniform_real_distribution<double>(0.08, 0.3)(random);
    std::bernoulli_distribution is_bone(density), is_nerve(0.01);
    for (LabelId& label : labels.voxels())
      label = is_nerve(random) ? kAlarmed : is_bone(random) ? kSolid : is_bone(random) ? kUnfelt : LabelId{0};
    const Model model = model_to_break(labels);
    std::uniform_real_distribution<double> at(-2, 18), radius(1.1, 4);
    std::vector<Cut> cuts;
    for (int n = 0; n < 4; ++n) {
      const auto point = [&] { return Point<Patient>(at(random), at(random), at(random)); };
      cuts.push_back({0, {point(), point(), radius(random), 1}});
    }
    const Carving nothing(model);
    const auto at_once = carved_clean(model, nothing, cuts);
    const Volume<LabelId> expected = without_fragments(*model.labels, *nothing.with(cuts)->labels());
    ASSERT_EQ(at_once->labels()->dense().voxels(), expected.voxels());
    std::shared_ptr<const Carving> in_parts = std::make_shared<const Carving>(nothing);
    for (const Cut& cut : cuts) in_parts = carved_clean(model, *in_parts, {cut});
    ASSERT_EQ(in_parts->labels()->dense().voxels(), expected.voxels());
    const auto left = nothing.with(cuts)->labels()->dense();
    for (std::size_t n = 0; n < left.voxels().size(); ++n) {
      removed += left.voxels()[n] != expected.voxels()[n];
      stayed += holds_together(expected.voxels()[n]);
    }
  }
  EXPECT_GT(removed, 100);
  EXPECT_GT(stayed, 1000);
}

// a plate with a rod on it, which a cut through its foot severs
Volume<LabelId> plate_and_rod() {
  Volume<LabelId> labels = empty_grid(24);
  for (int i = 0; i < 24; ++i)
    for (int j = 0; j < 24; ++j)
      for (int k = 0; k < 4; ++k) labels.at(i, j, k) = kSolid;
  for (int k = 4; k < 16; ++k) labels.at(12, 12, k) = kSolid;
  return labels;
}
const std::vector<Cut> kThroughTheFoot{{0, {Point<Patient>(12, 12, 6), Point<Patient>(12, 12, 6), 1.5, 7}}};

TEST(Fragments, ARodThatIsCutThroughIsRemovedWithoutWorkAndComesBackWithTheStroke) {
  const Model model = model_to_break(plate_and_rod());
  const Carving nothing(model);
  const auto cut = nothing.with(kThroughTheFoot);
  const std::vector<Cut> fragments = fragments_of(model, *cut, kThroughTheFoot);
  ASSERT_FALSE(fragments.empty());
  for (const Cut& fragment : fragments) {
    EXPECT_EQ(fragment.device, Cut::kBrokenOff);
    EXPECT_EQ(fragment.sweep.stroke, 7u);
  }
  const auto after = cut->with(fragments);
  for (int k = 8; k < 16; ++k) {
    EXPECT_EQ(cut->labels()->at(12, 12, k), kSolid);
    EXPECT_EQ(after->labels()->at(12, 12, k), 0);
  }
  EXPECT_EQ(after->labels()->at(12, 12, 4), kSolid) << "the stump stands on the plate";
  EXPECT_EQ(after->carved(0).sweeps, cut->carved(0).sweeps);
  EXPECT_EQ(after->carved(0).energy_mJ, cut->carved(0).energy_mJ);
  EXPECT_NE(after->content_hash(1), cut->content_hash(1));
  const auto undone = after->undone();
  ASSERT_NE(undone, nullptr);
  EXPECT_EQ(undone->labels()->dense().voxels(), model.labels->dense().voxels());
  EXPECT_EQ(undone->undone(), nullptr) << "one stroke";
  EXPECT_EQ(undone->redone()->labels()->dense().voxels(), after->labels()->dense().voxels());
}

TEST(Fragments, AFragmentThatIsSweptLaterCostsNothing) {
  const Model model = model_to_break(plate_and_rod());
  const auto after = carved_clean(model, Carving(model), kThroughTheFoot);
  const std::vector<Cut> along{{0, {Point<Patient>(12, 12, 10), Point<Patient>(12, 12, 14), 1.2, 8}}};
  EXPECT_EQ(after->with(along)->carved(0).energy_mJ, after->carved(0).energy_mJ);
}

TEST(Fragments, WhatWasSmallFromTheBeginningStays) {
  Volume<LabelId> labels = plate_and_rod();
  for (int k = 4; k < 7; ++k) labels.at(12, 12, k) = 0;  // the rod floats
  const Model model = model_to_break(labels);
  const auto cut = Carving(model).with(kThroughTheFoot);
  EXPECT_TRUE(fragments_of(model, *cut, kThroughTheFoot).empty());
}

TEST(Fragments, WhatHoldsAProtectedStructureOrIsTooLargeStays) {
  Volume<LabelId> labels = plate_and_rod();
  labels.at(12, 12, 15) = kAlarmed;
  const Model with_nerve = model_to_break(labels);
  EXPECT_TRUE(fragments_of(with_nerve, *Carving(with_nerve).with(kThroughTheFoot), kThroughTheFoot).empty());
  labels = plate_and_rod();
  for (int i = 11; i < 14; ++i)
    for (int j = 11; j < 14; ++j)
      for (int k = 13; k < 16; ++k) labels.at(i, j, k) = kSolid;
  const Model with_head = model_to_break(labels);
  EXPECT_TRUE(fragments_of(with_head, *Carving(with_head).with(kThroughTheFoot), kThroughTheFoot).empty());
}

}  // namespace
}  // namespace palpate
