#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <random>
#include <string>

#include "base/test_seed.h"
#include "palpate/model/changed_model.h"
#include "palpate/model/make_model.h"
#include "palpate/servo/servo.h"
#include "palpate/tissue/soft_tissue_solver.h"

/// Random patients, tools and hands on deformable tissue, and a search based on force and position only.
/// PALPATE_TEST_SCENES and PALPATE_TEST_SEARCHES increase their numbers; docs/contributing/testing.md.
namespace palpate {
namespace {

int requested_for(const char* name, int by_default) {
  const char* value = std::getenv(name);
  return value == nullptr ? by_default : std::max(1, std::atoi(value));
}

double between(std::mt19937& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

/// A tip moved at 1 kHz, with tissue solved as on a virtual clock.
class CampaignTip {
 public:
  CampaignTip(std::shared_ptr<const Model> model, double max_force_N) : model_(std::move(model)) {
    parameters_.method = ForceMethod::kProxy;
    parameters_.max_force_N = max_force_N;
    parameters_.device[0].limits.peak_force_N = max_force_N;
    parameters_.device[0].max_stiffness_N_per_mm = 2;
    parameters_.motor = model_->has_burr();
  }
  const TickRecord& at(const Eigen::Vector3d& tip) {
    constexpr std::uint64_t kCutEvery = 20;
    if (state_.tick % kCutEvery == 0)
      if (const auto cuts = finished_cuts(state_.device[0].burr, 0); !cuts.empty()) {
        model_ = carved_by(*model_, cuts)->applied_to(*model_);
        ++cut_;
      }
    const TickRecord* const before = state_.tick > 0 ? &record_ : nullptr;
    if (is_elastic(model_->tissue_law) ? solver_.advance(*model_, before) : solver_.publish_pending())
      parameters_.compliance = solver_.frame();
    DeviceState device;
    device.tip = model_->X_WorldPatient * Point<Patient>(tip);
    Wrench wrench;
    tick(*model_, parameters_, {&device, 1}, 1e-3, state_, {&wrench, 1}, record_);
    return record_;
  }
  /// Changes the law. Returns false if that is not possible at present, e.g. once something was cut.
  bool apply_law(TissueLaw law) {
    auto next = next_version({model_, model_}, change_of_law(*model_, law));
    if (next) model_ = next->current;
    return next.ok();
  }
  void pause(bool paused) { parameters_.paused = paused; }
  const ComplianceFrame& frame() const { return solver_.frame(); }
  int versions_cut() const { return cut_; }

 private:
  std::shared_ptr<const Model> model_;
  int cut_ = 0;
  Parameters parameters_;
  SessionState state_;
  TickRecord record_;
  VirtualClockSoftTissueSolver solver_{1000};
};

std::shared_ptr<const Model> model_of(const Volume<LabelId>& labels, std::vector<Tissue> tissues,
                                      double tool_mm, double cell_mm, TissueLaw law, bool burr = false) {
  ModelParts parts;
  parts.labels = label_bricks(labels);
  parts.tissue_of_label = {-1};
  for (std::size_t n = 0; n < tissues.size(); ++n) {
    const auto label = static_cast<LabelId>(n + 1);
    parts.segments.push_back({label, "structure " + std::to_string(label), {}, 0, label});
    parts.tissue_of_label.push_back(static_cast<std::int16_t>(n));
    tissues[n].name = "tissue " + std::to_string(n);
  }
  parts.tissues = std::move(tissues);
  parts.tissue_law = law;
  parts.tissue_cell_mm = cell_mm;
  Tool tool;
  tool.radius_mm = tool_mm;
  if (burr) tool.burr = BurrSettings{};
  parts.tools = {tool};
  auto made = make_model(std::move(parts));
  PALPATE_CHECK(made.ok());
  const ForceMethod proxy = ForceMethod::kProxy;
  auto ready = prepared_for(*made, {&proxy, 1});
  PALPATE_CHECK(ready.ok());
  return *std::move(ready);
}

// random regions of bone and of tissue of 1 kPa to 1 MPa, some of which relaxes, some separated by air
std::shared_ptr<const Model> random_patient(std::mt19937& random, TissueLaw law) {
  GridGeometry grid;
  grid.dims = {28, 28, 28};
  grid.spacing_mm =
      Eigen::Vector3d(between(random, 0.7, 1.6), between(random, 0.7, 1.6), between(random, 0.7, 2.4));
  grid.origin = Point<Patient>(-(13.5 * grid.spacing_mm));
  Volume<LabelId> labels(grid);
  std::vector<Tissue> tissues(1 + random() % 5);
  for (Tissue& tissue : tissues) {
    tissue.stiffness_N_per_mm = between(random, 0.2, 1.5);
    if (between(random, 0, 1) < 0.75)
      tissue.elastic = ElasticConstants{std::pow(10, between(random, 0, 3)), between(random, 0, 0.49)};
    if (between(random, 0, 1) < 0.2) tissue.puncture_N = between(random, 0.3, 2);
    if (tissue.elastic && between(random, 0, 1) < 0.5)
      for (RelaxationTerm& term : tissue.relaxation.term)
        term = {between(random, 0.02, 0.49), std::pow(10, between(random, -2, 1.5))};
  }
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (std::size_t n = 0; n < 3 * tissues.size(); ++n) {
    Eigen::Vector3d centre, radii;
    for (int axis = 0; axis < 3; ++axis) {
      const double half = 13.5 * grid.spacing_mm[axis];
      centre[axis] = between(random, -0.5, 0.5) * half;
      radii[axis] = between(random, 0.15, 0.5) * half;
    }
    for (int k = 1; k < 27; ++k)
      for (int j = 1; j < 27; ++j)
        for (int i = 1; i < 27; ++i) {
          const Eigen::Vector3d p = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen();
          if (((p - centre).cwiseQuotient(radii)).squaredNorm() < 1)
            labels.at(i, j, k) = static_cast<LabelId>(1 + n % tissues.size());
        }
  }
  const double cell_mm = between(random, 0.8, 2.5);
  // in one of three the tool is a burr, at least two voxels wide
  if (random() % 3 == 0) {
    for (Tissue& tissue : tissues) tissue.cutting_energy_mJ_per_mm3 = std::pow(10, between(random, 0, 2));
    return model_of(labels, tissues, between(random, 2.5, 4), cell_mm, law, true);
  }
  return model_of(labels, tissues, random() % 3 == 0 ? 0 : between(random, 0.5, 4), cell_mm, law);
}

TEST(TissueCampaign, RandomHandsGiveFiniteForcesWithinTheLimit) {
  const int scenes = requested_for("PALPATE_TEST_SCENES", 6);
  const unsigned seed = test::test_seed();
  constexpr double kMaxForce_N = 3, kTick_s = 1e-3;
  int touched = 0, solved = 0, cut = 0, changed = 0;
  for (int scene = 0; scene < scenes; ++scene) {
    SCOPED_TRACE("seed " + std::to_string(seed) + ", scene " + std::to_string(scene));
    std::mt19937 random(seed + static_cast<unsigned>(scene));
    const auto model = random_patient(random, scene % 2 == 0 ? TissueLaw::kElastic : TissueLaw::kNeoHookean);
    CampaignTip tip(model, kMaxForce_N);
    Eigen::Vector3d at(0, 0, 40);
    const auto lead = [&](const Eigen::Vector3d& to, double speed_mm_s) {
      const int ticks = std::max(1, static_cast<int>((to - at).norm() / (speed_mm_s * kTick_s)));
      const Eigen::Vector3d from = at;
      for (int n = 1; n <= ticks; ++n) {
        at = from + (to - from) * (static_cast<double>(n) / ticks);
        const TickRecord& tick = tip.at(at);
        const DeviceTick& device = tick.device[0];
        const Eigen::Vector3d force(device.force_N[0], device.force_N[1], device.force_N[2]);
        ASSERT_TRUE(force.allFinite());
        ASSERT_LE(force.norm(), kMaxForce_N * (1 + 1e-9));
        ASSERT_TRUE(std::isfinite(device.unclamped_force_N) && std::isfinite(device.energy_mJ));
        ASSERT_EQ(device.flags & kFlagNotFinite, 0u);
        touched += device.label != 0;
        const LocalCompliance& local = tip.frame().local_compliance[0];
        if (!local.is_known()) continue;
        ++solved;
        ASSERT_TRUE(std::isfinite(local.compliance_mm_per_N) && local.gradient_per_N.all_finite());
        ASSERT_GT(local.modulus_N_per_mm2, 0);
        ASSERT_TRUE(std::isfinite(local.stiffening_mm_per_N2) && local.stiffening_gradient.all_finite());
      }
    };
    for (int stroke = 0; stroke < 6 && !HasFatalFailure(); ++stroke) {
      Eigen::Vector3d to;
      for (int axis = 0; axis < 3; ++axis) to[axis] = between(random, -14, 14);
      // change of the law at any position of the tool
      if (random() % 4 == 0) changed += tip.apply_law(static_cast<TissueLaw>(random() % ModelChange::kLaws));
      lead(to, std::pow(10, between(random, 1.3, 2.7)));
    }
    if (HasFatalFailure()) return;
    // after lifting no force is left; a tool that was moved through a surface from below stays there until a
    // pause
    lead({0, 0, 60}, 300);
    tip.pause(true);
    for (int n = 0; n < 300; ++n) tip.at(at);
    tip.pause(false);
    EXPECT_EQ(tip.at(at).device[0].unclamped_force_N, 0);
    cut += tip.versions_cut();
  }
  RecordProperty("versions_cut", cut);
  RecordProperty("laws_changed", changed);
  if (scenes > 6)
    std::printf(
        "%d scenes: %d ticks that touched, %d with a solution, %d versions cut, %d changes of the law\n",
        scenes, touched, solved, cut, changed);
  EXPECT_GT(touched, 50 * scenes);
  EXPECT_GT(solved, 50 * scenes);
}

// tissue of 10 kPa on a plate, optionally with a nodule of 8 mm, 10 times as stiff, 5 mm deep
std::shared_ptr<const Model> patient_to_search(const Eigen::Vector2d* nodule_mm) {
  GridGeometry grid;
  grid.dims = {72, 72, 30};
  grid.spacing_mm = Eigen::Vector3d::Ones();
  grid.origin = Point<Patient>(-35.5, -35.5, -24.5);
  Volume<LabelId> labels(grid);
  for (int k = 0; k < 25; ++k)
    for (int j = 0; j < 72; ++j)
      for (int i = 0; i < 72; ++i) {
        const Eigen::Vector3d p(i - 35.5, j - 35.5, k - 24.5);
        const bool hard =
            nodule_mm != nullptr && (p - Eigen::Vector3d(nodule_mm->x(), nodule_mm->y(), -9)).norm() < 4;
        labels.at(i, j, k) = p.z() < -20 ? LabelId{3} : hard ? LabelId{2} : LabelId{1};
      }
  Tissue soft, hard, plate;
  soft.stiffness_N_per_mm = 0.3;
  soft.elastic = ElasticConstants{10, 0.45};
  hard.elastic = ElasticConstants{100, 0.45};
  return model_of(labels, {soft, hard, plate}, 3, 1, TissueLaw::kElastic);
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct Found {
  bool any = false;
  Eigen::Vector2d at_mm = Eigen::Vector2d::Zero();
};

// Slides 3 mm deep along lines 4 mm apart and finds where it is harder than elsewhere by at least a
// twentieth, a third of what a human can discriminate. Input is the force and the tip's position, each with
// noise.
Found search(const std::shared_ptr<const Model>& model, std::mt19937& random) {
  constexpr double kHalf_mm = 16, kSeparation_mm = 4, kSpeed_mm_s = 40, kCell_mm = 4, kHarder = 1.05;
  constexpr int kCells = static_cast<int>(2 * kHalf_mm / kCell_mm) + 1;
  std::normal_distribution<double> noise_N(0, 0.005), noise_mm(0, 0.1);
  CampaignTip tip(model, 10);
  const Eigen::Vector2d shift(between(random, -1.5, 1.5), between(random, -1.5, 1.5));
  std::vector<double> sum(static_cast<std::size_t>(kCells * kCells)), count(sum.size());
  Eigen::Vector3d at(shift.x() - kHalf_mm, shift.y() - kHalf_mm, 6);
  for (int n = 0; n < 600; ++n) tip.at(at);
  bool touched_yet = false;
  const auto lead = [&](const Eigen::Vector3d& to) {
    const int ticks = std::max(1, static_cast<int>((to - at).norm() / (1e-3 * kSpeed_mm_s)));
    const Eigen::Vector3d from = at;
    for (int n = 1; n <= ticks; ++n) {
      at = from + (to - from) * (static_cast<double>(n) / ticks);
      const double force_N = tip.at(at).device[0].unclamped_force_N + noise_N(random);
      if (!touched_yet) continue;
      const int i = static_cast<int>(
                    std::lround((at.x() + noise_mm(random) - shift.x() + kHalf_mm) / kCell_mm)),
                j = static_cast<int>(
                    std::lround((at.y() + noise_mm(random) - shift.y() + kHalf_mm) / kCell_mm));
      if (i < 0 || j < 0 || i >= kCells || j >= kCells) continue;
      sum[static_cast<std::size_t>(j * kCells + i)] += force_N;
      count[static_cast<std::size_t>(j * kCells + i)] += 1;
    }
  };
  lead({at.x(), at.y(), 0});
  touched_yet = true;
  for (int line = 0; line <= static_cast<int>(2 * kHalf_mm / kSeparation_mm); ++line) {
    const double y = shift.y() - kHalf_mm + kSeparation_mm * line, end = line % 2 == 0 ? kHalf_mm : -kHalf_mm;
    lead({at.x(), y, 0});
    lead({shift.x() + end, y, 0});
  }
  std::vector<double> mean;
  for (std::size_t n = 0; n < sum.size(); ++n) mean.push_back(count[n] > 0 ? sum[n] / count[n] : 0);
  const double usual_N = median(mean);
  // removes row and column means, because hardening towards an edge is not a nodule
  std::vector<double> rows, columns;
  for (int n = 0; n < kCells; ++n) {
    std::vector<double> row, column;
    for (int m = 0; m < kCells; ++m) {
      row.push_back(mean[static_cast<std::size_t>(n * kCells + m)]);
      column.push_back(mean[static_cast<std::size_t>(m * kCells + n)]);
    }
    rows.push_back(median(row));
    columns.push_back(median(column));
  }
  for (int j = 0; j < kCells; ++j)
    for (int i = 0; i < kCells; ++i)
      mean[static_cast<std::size_t>(j * kCells + i)] +=
          2 * usual_N - rows[static_cast<std::size_t>(j)] - columns[static_cast<std::size_t>(i)];
  Found found;
  double weight = 0;
  const auto hardest = static_cast<int>(std::max_element(mean.begin(), mean.end()) - mean.begin());
  if (mean[static_cast<std::size_t>(hardest)] < kHarder * usual_N) return found;
  found.any = true;
  // centroid of the harder cells around the hardest one
  for (int j = 0; j < kCells; ++j)
    for (int i = 0; i < kCells; ++i) {
      if (std::max(std::abs(i - hardest % kCells), std::abs(j - hardest / kCells)) > 2) continue;
      const double more = std::max(0.0, mean[static_cast<std::size_t>(j * kCells + i)] - 1.02 * usual_N);
      weight += more;
      found.at_mm += more * (Eigen::Vector2d(i, j) * kCell_mm + shift - Eigen::Vector2d::Constant(kHalf_mm));
    }
  found.at_mm /= weight;
  return found;
}

TEST(TissueCampaign, SearcherFindsPresentNodulesOnly) {
  const int searches = requested_for("PALPATE_TEST_SEARCHES", 1);
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  int found = 0, found_none = 0;
  const auto without = patient_to_search(nullptr);
  for (int n = 0; n < searches; ++n) {
    std::mt19937 random(seed + static_cast<unsigned>(n));
    const Eigen::Vector2d nodule(between(random, -11, 11), between(random, -11, 11));
    const Found with = search(patient_to_search(&nodule), random);
    found += with.any && (with.at_mm - nodule).norm() <= 3;
    found_none += !search(without, random).any;
  }
  std::printf("found %d of %d nodules within 3 mm, none in %d of %d\n", found, searches, found_none,
              searches);
  EXPECT_GE(found, searches - searches / 20);
  EXPECT_GE(found_none, searches - searches / 20);
}

}  // namespace
}  // namespace palpate
