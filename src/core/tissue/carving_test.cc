#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <memory>
#include <mutex>
#include <numbers>
#include <random>
#include <set>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "base/test_process.h"
#include "base/test_seed.h"
#include "contact/test_model.h"
#include "palpate/tissue/carving.h"
#include "palpate/tissue/removed_volume.h"
#include "tissue/test_surfaces.h"

namespace palpate {
namespace {

using testing::kBone;
using testing::kBoneRadius_mm;
using testing::kCartilage;
using testing::kFat;

constexpr double kShell_mm = 3;

Model one_body() {
  return testing::as_one_body(testing::ball_model({1, 1, 1}, 1.0, kShell_mm), kShell_mm);
}

// groove by a ball of 4 mm whose lowest point is `below_mm` below the outer surface, at `x_mm`
std::vector<Cut> groove(double below_mm, double x_mm) {
  const double z = kBoneRadius_mm + kShell_mm + 2 - below_mm;
  return {{0, {{x_mm, -4, z}, {x_mm, 0, z}, 2}}, {1, {{x_mm, 0, z}, {x_mm, 4, z}, 2}}};
}

TEST(Carving, EverySurfaceIsCarvedAndTheRestIsShared) {
  const Model model = one_body();
  const auto none = std::make_shared<const Carving>(model);
  const std::vector<Cut> cuts = groove(2, -6);
  const auto carving = none->with(cuts);
  const auto next = carving->applied_to(model);
  EXPECT_EQ(next->version, model.version + 1);
  EXPECT_EQ(next->edits, 1u);
  EXPECT_NE(next->content_hash, model.content_hash);
  EXPECT_EQ(carving->sweeps(0), 1u);
  EXPECT_EQ(carving->sweeps(1), 1u);
  EXPECT_EQ(carving->sweeps(2), 0u);
  EXPECT_EQ(next->field, model.field);
  EXPECT_EQ(next->methods, model.methods);
  ASSERT_EQ(next->surfaces.size(), 3u);
  EXPECT_EQ(next->surfaces[1].surface, nullptr);
  for (const std::size_t s : {0u, 2u}) {
    const CarvedSurface alone =
        CarvedSurface(model.surfaces[s].surface).with(std::vector{cuts[0].sweep, cuts[1].sweep});
    EXPECT_EQ(next->surfaces[s].surface->content_hash(), alone.surface()->content_hash()) << s;
  }
  EXPECT_NE(next->surfaces[2].surface, model.surfaces[2].surface);
  // nothing in range: the surfaces are the same objects
  const auto far = none->with(std::vector<Cut>{{0, {{25, 25, 25}, {26, 25, 25}, 2}}})->applied_to(model);
  EXPECT_EQ(far->surfaces[2].surface, model.surfaces[2].surface);
  EXPECT_EQ(far->surfaces[2].original_surface, nullptr);
  EXPECT_EQ(far->labels, model.labels);
}

TEST(Carving, IncrementalVersionsEqualOneVersion) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> coordinate(-12, 12);
  std::vector<Cut> cuts;
  for (int n = 0; n < 12; ++n) {
    const Point<Patient> from(coordinate(random), coordinate(random),
                              kBoneRadius_mm + 0.1 * coordinate(random));
    cuts.push_back({static_cast<std::uint32_t>(n % 2), {from, from + Vector<Patient>(1, 0.5, -0.5), 2}});
  }
  const Model model = one_body();
  const auto none = std::make_shared<const Carving>(model);
  const auto at_once = none->with(cuts)->applied_to(model);
  auto carving = none;
  auto carved = std::make_shared<const Model>(model);
  for (std::size_t n = 0; n < cuts.size(); n += 3) {
    carving = carving->with(std::span(cuts).subspan(n, 3));
    carved = carving->applied_to(*carved);
  }
  EXPECT_EQ(carved->edits, 4u);
  EXPECT_EQ(carved->version, model.version + 4);
  EXPECT_EQ(carved->labels->content_hash(), at_once->labels->content_hash());
  for (const std::size_t s : {0u, 2u})
    EXPECT_EQ(carved->surfaces[s].surface->content_hash(), at_once->surfaces[s].surface->content_hash());
}

TEST(Carving, DistancesAreToTheRemainingMaterial) {
  Model model = one_body();
  // the bone by its contact surface, and both structures by surfaces without contact
  const auto own = [&](double radius_mm) {
    const SignedField field = testing::sampled_distance(
        model.labels->geometry(), [&](const Eigen::Vector3d& p) { return p.norm() - radius_mm; }, 4);
    return std::make_shared<const Surface>(field, field, testing::steepest_of(field));
  };
  const auto tree = [](const std::shared_ptr<const Surface>& surface) {
    return std::make_shared<const SurfaceTree>(surface);
  };
  const double outer_mm = kBoneRadius_mm + kShell_mm;
  model.distance_trees = {{{kBone, tree(model.surfaces[0].surface), true},
                           {kCartilage, tree(own(outer_mm)), true},
                           {kFat, tree(own(22)), true}},
                          20};
  const auto at = [](const Model& current, std::size_t structure, double z) {
    return current.distance_trees.structures()[structure].tree->nearest({-6, 0, z})->distance_mm;
  };
  const auto none = std::make_shared<const Carving>(model);
  const auto carving = none->with(groove(2, -6));
  const auto cut = carving->applied_to(model);
  // at the centre of the ball that cut, everything within its radius is removed
  const double z = outer_mm;
  EXPECT_NEAR(at(model, 1, z), std::hypot(6, z) - outer_mm, 0.05);
  EXPECT_NEAR(at(*cut, 1, z), 2, 0.3);
  EXPECT_GT(at(*cut, 0, z), at(model, 0, z) - 0.05) << "of the bone little is gone";
  EXPECT_EQ(cut->distance_trees.structures()[2].tree, model.distance_trees.structures()[2].tree)
      << "not felt, not cut";
  const auto back = carving->undone()->applied_to(*cut);
  for (std::size_t s = 0; s < 3; ++s) EXPECT_EQ(at(*back, s, z), at(model, s, z)) << s;
}

// a model with the cuts of several strokes applied at once
std::shared_ptr<const Model> cut_at_once(const Model& model, const std::vector<std::vector<Cut>>& strokes) {
  std::vector<Cut> cuts;
  for (const std::vector<Cut>& stroke : strokes) cuts.insert(cuts.end(), stroke.begin(), stroke.end());
  return Carving(model).with(cuts)->applied_to(model);
}

TEST(Carving, UndoAndRedoAreBitIdentical) {
  const unsigned seed = std::random_device()();
  RecordProperty("seed", static_cast<int>(seed));
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const auto below = [&](int largest) { return std::uniform_int_distribution<int>(0, largest - 1)(random); };
  const Model model = one_body();
  auto carving = std::make_shared<const Carving>(model);
  auto carved = carving->applied_to(model);
  EXPECT_EQ(carved->content_hash, model.content_hash);
  EXPECT_EQ(carving->undone(), nullptr);
  EXPECT_EQ(carving->redone(), nullptr);
  std::vector<std::vector<Cut>> done, undone;
  std::uint32_t stroke = 0;
  std::uint64_t swept = 0;
  for (int n = 0; n < 25; ++n) {
    if (const int action = below(4); action < 2) {
      // in one version or two, the second of which continues the stroke
      std::vector<Cut> cuts = groove(1 + below(2), 4.0 * below(4) - 8);
      for (Cut& cut : cuts) cut.sweep.stroke = stroke;
      ++stroke;
      swept += cuts.size();
      if (below(2) == 0)
        carving = carving->with(cuts);
      else
        carving = carving->with(std::span(cuts).first(1))->with(std::span(cuts).last(1));
      done.push_back(cuts);
      undone.clear();
    } else {
      auto &from = action == 2 ? done : undone, &to = action == 2 ? undone : done;
      const auto next = action == 2 ? carving->undone() : carving->redone();
      ASSERT_EQ(next != nullptr, !from.empty());
      if (!next) continue;
      carving = next;
      to.push_back(from.back());
      from.pop_back();
    }
    EXPECT_EQ(carving->strokes_to_undo(), done.size());
    EXPECT_EQ(carving->strokes_to_redo(), undone.size());
    // swept material is reported as carved even after an undo
    EXPECT_EQ(carving->sweeps(0) + carving->sweeps(1), swept);
    carved = carving->applied_to(*carved);
    const auto at_once = cut_at_once(model, done);
    EXPECT_EQ(carved->content_hash, at_once->content_hash);
    EXPECT_EQ(carved->labels->content_hash(), at_once->labels->content_hash());
    for (const std::size_t s : {0u, 2u}) {
      const ContactSurface &is = carved->surfaces[s], &oracle = at_once->surfaces[s];
      ASSERT_EQ(is.surface->content_hash(), oracle.surface->content_hash());
      ASSERT_EQ(is.original_surface, oracle.original_surface);
      ASSERT_EQ(is.original_labels == nullptr, oracle.original_labels == nullptr);
      ASSERT_EQ(is.clearance_error_mm, oracle.clearance_error_mm);
    }
  }
  while (carving->strokes_to_undo() > 0) carving = carving->undone();
  carved = carving->applied_to(*carved);
  EXPECT_EQ(carved->content_hash, model.content_hash);
  EXPECT_EQ(carved->surfaces[2].surface, model.surfaces[2].surface) << "the very same";
  EXPECT_EQ(carved->labels, model.labels);
}

// Values that one of several readers found in a version at a point and in a slice of its labels.
struct Reported {
  std::uint32_t edits = 0;
  Point<Patient> at;
  int k = 0;
  std::array<double, 2> distance_mm{};
  std::array<Vector<Patient>, 2> outward;
  std::size_t material = 0;  // voxels in the slice

  bool operator==(const Reported&) const = default;
};

Reported reported_by(const Model& model, std::uint32_t edits, const Point<Patient>& at, int k) {
  Reported reported;
  reported.edits = edits;
  reported.at = at;
  reported.k = k;
  for (std::size_t n = 0; n < 2; ++n) {
    const Surface& surface = *model.surfaces[2 * n].surface;
    reported.distance_mm[n] = surface.distance_mm(at);
    reported.outward[n] = surface.outward(at);
  }
  const auto& dims = model.labels->geometry().dims;
  for (int j = 0; j < dims[1]; ++j)
    for (int i = 0; i < dims[0]; ++i) reported.material += model.labels->at(i, j, k) != 0;
  return reported;
}

// The current version, for readers on other threads.
class Published {
 public:
  explicit Published(std::shared_ptr<const Model> model) : model_(std::move(model)) {}
  void set(std::shared_ptr<const Model> model) {
    const std::lock_guard lock(mutex_);
    model_ = std::move(model);
  }
  std::shared_ptr<const Model> get() const {
    const std::lock_guard lock(mutex_);
    return model_;
  }

 private:
  mutable std::mutex mutex_;
  std::shared_ptr<const Model> model_;
};

TEST(Carving, ConcurrentReadersSeeConsistentVersions) {
  constexpr std::size_t kReaders = 3, kFixed = 4;
  constexpr std::uint32_t kVersions = 24;
  constexpr int kReportedOfEach = 40;
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  const auto model = std::make_shared<const Model>(one_body());
  Published published(model);
  std::atomic<bool> done{false};
  std::array<std::atomic<std::uint32_t>, kReaders> observed{};
  std::array<std::vector<Reported>, kReaders> reported;

  // each holds some versions and releases the oldest, possibly the last owner of its bricks
  const auto read = [&](std::size_t reader) {
    std::mt19937 random(seed + 1 + static_cast<unsigned>(reader));
    std::uniform_real_distribution<double> across(-12, 12), height(-4, 4);
    std::deque<std::shared_ptr<const Model>> retained;
    std::array<int, kVersions + 1> reported_of{};
    for (bool last = false; !last;) {
      last = done;
      auto newest = published.get();
      if (retained.empty() || retained.back() != newest) retained.push_back(std::move(newest));
      if (retained.size() > kFixed) retained.pop_front();
      for (const auto& version : retained) {
        const Point<Patient> at(across(random), across(random), kBoneRadius_mm + height(random));
        const int k = static_cast<int>(random() % static_cast<unsigned>(model->labels->geometry().dims[2]));
        const Reported now = reported_by(*version, version->edits, at, k);
        if (reported_of[version->edits]++ < kReportedOfEach) reported[reader].push_back(now);
      }
      observed[reader] = retained.back()->edits;
    }
  };
  std::vector<std::thread> readers;
  for (std::size_t reader = 0; reader < kReaders; ++reader) readers.emplace_back(read, reader);

  // grooves at random positions; each fifth version undoes a stroke
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> below_mm(1, 3), position_mm(-8, 8);
  std::vector<std::vector<Cut>> strokes;
  std::vector<std::vector<std::vector<Cut>>> strokes_of{{}};
  auto carving = std::make_shared<const Carving>(*model);
  auto carved = model;
  for (std::uint32_t n = 1; n <= kVersions; ++n) {
    if (n % 5 == 0) {
      carving = carving->undone();
      strokes.pop_back();
    } else {
      std::vector<Cut> cuts = groove(below_mm(random), position_mm(random));
      for (Cut& cut : cuts) cut.sweep.stroke = n;
      carving = carving->with(cuts);
      strokes.push_back(cuts);
    }
    carved = carving->applied_to(*carved);
    strokes_of.push_back(strokes);
    published.set(carved);
    // all readers have seen recent versions while more is carved, even on a busy machine
    for (const auto& edits : observed)
      while (edits + 2 < n) std::this_thread::yield();
  }
  done = true;
  for (std::thread& reader : readers) reader.join();

  // values read by one thread after carving the same strokes at once
  std::vector<std::shared_ptr<const Model>> oracle;
  for (const auto& of : strokes_of) oracle.push_back(cut_at_once(*model, of));
  for (const std::vector<Reported>& by_one : reported) {
    std::set<std::uint32_t> versions;
    for (const Reported& is : by_one) {
      ASSERT_EQ(is, reported_by(*oracle[is.edits], is.edits, is.at, is.k)) << "version " << is.edits;
      versions.insert(is.edits);
    }
    EXPECT_GT(versions.size(), kVersions / 3);
  }
}

// peak memory in MiB while a number of versions is made, each released when the next is ready
double peak_of_versions(const Model& model, unsigned versions) {
  return test::peak_memory_of([&] {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> angle(0, 2 * std::numbers::pi), deep_mm(0, 1);
    std::shared_ptr<const Model> current = std::make_shared<const Model>(model);
    auto carving = std::make_shared<const Carving>(model);
    for (unsigned n = 0; n < versions; ++n) {
      // strokes of two versions; each seventh action is an undo
      if (n % 7 == 6 && carving->strokes_to_undo() > 0) {
        carving = carving->undone();
      } else {
        const double r = kBoneRadius_mm + kShell_mm + 0.5 - deep_mm(random), turn = angle(random);
        const Point<Patient> at(r * std::cos(turn), r * std::sin(turn), 0);
        const Cut cut{0, {at, at + Vector<Patient>(0, 0, 0.2), 1, n / 2}};
        carving = carving->with({&cut, 1});
      }
      current = carving->applied_to(*current);
    }
    return current->edits == versions;
  });
}

TEST(Carving, MemoryDoesNotGrowWithVersions) {
  // PALPATE_TEST_VERSIONS=10000 runs the whole campaign
  const char* const value = std::getenv("PALPATE_TEST_VERSIONS");
  const unsigned many = value != nullptr ? static_cast<unsigned>(std::atoi(value)) : 1200;
  const Model model = one_body();
  // until the groove is cut everywhere and the undo history is full
  const double some_MiB = peak_of_versions(model, many / 2), all_MiB = peak_of_versions(model, many);
  std::printf("%u versions: %.1f MiB, %u: %.1f MiB\n", many / 2, some_MiB, many, all_MiB);
  ASSERT_GT(some_MiB, 0);
  EXPECT_LT(all_MiB - some_MiB, 4);
}

TEST(Carving, CutAfterUndoBeginsANewStroke) {
  const Model model = one_body();
  const std::vector<Cut> cuts = groove(1, 0);
  // the rest of a stroke that was undone before the rest arrived
  const auto rest = Carving(model).with(std::span(cuts).first(1))->undone()->with(std::span(cuts).last(1));
  EXPECT_EQ(rest->strokes_to_undo(), 1u);
  EXPECT_EQ(rest->strokes_to_redo(), 0u);
  EXPECT_EQ(rest->sweeps(0) + rest->sweeps(1), 2u);
  EXPECT_EQ(rest->applied_to(model)->content_hash, cut_at_once(model, {{cuts[1]}})->content_hash);
}

TEST(Carving, StrokesBeyondTheHistoryArePermanent) {
  const Model model = one_body();
  auto carving = std::make_shared<const Carving>(model);
  std::vector<Cut> first;
  for (std::uint32_t stroke = 0; stroke < kMaxUndoneStrokes + 2; ++stroke) {
    Cut cut = groove(1, 0)[0];
    // decreasing radius, so that hardly anything is carved
    cut.sweep.radius_mm = stroke < 2 ? 2 : 0.5;
    cut.sweep.stroke = stroke;
    if (stroke < 2) first.push_back(cut);
    carving = carving->with({&cut, 1});
  }
  EXPECT_EQ(carving->strokes_to_undo(), kMaxUndoneStrokes);
  while (carving->strokes_to_undo() > 0) carving = carving->undone();
  EXPECT_EQ(carving->applied_to(model)->content_hash, cut_at_once(model, {first})->content_hash);
}

TEST(Carving, SweptTouchableVoxelsAreCleared) {
  const Model model = one_body();
  const std::vector<Cut> cuts = groove(2, 0);
  const auto next = Carving(model).with(cuts)->applied_to(model);
  const auto X_PatientVoxel = model.labels->geometry().X_PatientVoxel();
  const auto& dims = model.labels->geometry().dims;
  int removed = 0, fat = 0;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i) {
        const Point<Patient> centre = X_PatientVoxel * Point<Voxel>(i, j, k);
        const bool swept =
            SweptShape(cuts[0].sweep).depth_mm(centre) > 0 || SweptShape(cuts[1].sweep).depth_mm(centre) > 0;
        const LabelId was = model.labels->at(i, j, k);
        const bool cut = swept && model.is_touchable(was);
        ASSERT_EQ(next->labels->at(i, j, k), cut ? LabelId{0} : was) << i << " " << j << " " << k;
        removed += cut;
        fat += swept && was == kFat;
      }
  EXPECT_GT(removed, 20);
  EXPECT_GT(fat, 5);
}

TEST(Carving, ExposedPointsAreOwnedByTheirOriginalLabels) {
  // the shell is cartilage where x < 0
  const Model model = one_body();
  const auto owner = [](const Model& of, double x_mm, double below_mm) {
    const double r = kBoneRadius_mm + kShell_mm - below_mm;
    return owners_at(of.surfaces, 2, Point<Patient>(x_mm, 0, std::sqrt(r * r - x_mm * x_mm))).largest();
  };
  EXPECT_EQ(owner(model, -6, 0), 1);
  const auto next = Carving(model).with(groove(6, -6))->applied_to(model);
  EXPECT_EQ(owner(*next, -6, 0), 1);
  EXPECT_EQ(owner(*next, -6, 1.5), 1);
  EXPECT_EQ(owner(*next, -6, 4.5), 0) << "bone, through the shell";
}

TEST(Carving, AccountCountsNewlySweptVoxels) {
  Model model = testing::with_exact_surfaces(testing::ball_model({1, 1, 1}));
  const double mJ_per_mm3 = model.tissues[0].cutting_energy_mJ_per_mm3;
  const std::vector<Cut> cuts{{0, {{-3, 0, 17}, {3, 0, 17}, 2, 0}},
                              {1, {{-2, 0, 16}, {2, 0, 16}, 2, 0}},
                              {0, {{0, -3, 16}, {0, 3, 16}, 2, 1}}};
  const auto at_once = Carving(model).with(cuts);
  auto one_by_one = std::make_shared<const Carving>(model);
  for (const Cut& cut : cuts) one_by_one = one_by_one->with({&cut, 1});
  RemovedVolume removed(model);
  removed.add(cuts);
  const double bone_mm3 = removed.by_label_mm3().at(testing::kBone);
  ASSERT_GT(bone_mm3, 10);
  double all_mm3 = 0;
  for (const std::size_t device : {0, 1}) {
    const CarvedMaterial &all = at_once->carved(device), &parts = one_by_one->carved(device);
    EXPECT_EQ(all.sweeps, device == 0 ? 2u : 1u);
    EXPECT_EQ(all.volume_mm3, parts.volume_mm3);
    EXPECT_EQ(all.energy_mJ, parts.energy_mJ);
    EXPECT_NEAR(all.energy_mJ[kThick], all.volume_mm3[kThick] * mJ_per_mm3, 1e-6);
    EXPECT_EQ(all.volume_mm3[kThin], 0);
    all_mm3 += all.volume_mm3[kThick];
  }
  EXPECT_NEAR(all_mm3, bone_mm3, 1e-6);
  // restored material has to be paid for again
  const double first_mm3 = at_once->carved(0).volume_mm3[kThick];
  Cut again = cuts[2];
  again.sweep.stroke = 2;
  const auto repeated = at_once->undone()->with({&again, 1});
  EXPECT_EQ(at_once->undone()->carved(0).volume_mm3[kThick], first_mm3);
  const Carving first = *Carving(model).with(std::span(cuts).first(2));
  EXPECT_NEAR(repeated->carved(0).volume_mm3[kThick] - first_mm3,
              first_mm3 - first.carved(0).volume_mm3[kThick], 1e-6);
  EXPECT_GT(repeated->carved(0).volume_mm3[kThick], first_mm3 + 1);
}

}  // namespace
}  // namespace palpate
