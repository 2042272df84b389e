#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <utility>

#include "palpate/model/changed_model.h"
#include "palpate/model/make_model.h"
#include "palpate/servo/servo.h"
#include "palpate/tissue/soft_tissue_solver.h"

/// Soft tissue that becomes deformable under the tool, or ceases to be: other surfaces, the same contact.
namespace palpate {
namespace {

using ::testing::HasSubstr;

constexpr LabelId kSkin = 1, kMuscle = 2, kBone = 3;
constexpr double kRadius_mm = 3;

// Skin of 4 mm on muscle of 6 mm on bone, with the surface at z = 0: three layers under kLayers, two if soft
// tissue is deformable.
std::shared_ptr<const Model> limb(TissueLaw law,
                                  double puncture_N = std::numeric_limits<double>::infinity()) {
  static std::map<std::pair<TissueLaw, double>, std::shared_ptr<const Model>> made_before;
  std::shared_ptr<const Model>& known = made_before[{law, puncture_N}];
  if (known != nullptr) return known;
  GridGeometry grid;
  grid.dims = {44, 44, 24};
  grid.spacing_mm = Eigen::Vector3d::Ones();
  grid.origin = Point<Patient>(-21.5, -21.5, -18.5);
  Volume<LabelId> labels(grid);
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 1; j + 1 < grid.dims[1]; ++j)
      for (int i = 1; i + 1 < grid.dims[0]; ++i) {
        const double z = k - 18.5;
        labels.at(i, j, k) = z > 0 ? LabelId{0} : z > -4 ? kSkin : z > -10 ? kMuscle : kBone;
      }
  ModelParts parts;
  parts.labels = label_bricks(labels);
  for (const auto& [label, name] : {std::pair(kSkin, "skin"), {kMuscle, "muscle"}, {kBone, "bone"}})
    parts.segments.push_back({label, name, {}, 0, label});
  Tissue skin, muscle, bone;
  skin.name = "skin";
  skin.stiffness_N_per_mm = 0.2;
  skin.elastic = ElasticConstants{30, 0.45};
  skin.puncture_N = puncture_N;
  muscle.name = "muscle";
  muscle.stiffness_N_per_mm = 0.5;
  muscle.elastic = ElasticConstants{60, 0.45, 20};
  bone.name = "bone";
  bone.stiffness_N_per_mm = 2;
  parts.tissues = {skin, muscle, bone};
  parts.tissue_of_label = {-1, 0, 1, 2};
  parts.tissue_law = law;
  Tool tool;
  tool.radius_mm = kRadius_mm;
  parts.tools = {tool};
  auto made = make_model(std::move(parts));
  PALPATE_CHECK(made.ok());
  const ForceMethod proxy = ForceMethod::kProxy;
  known = prepared_for(*made, {&proxy, 1}).value();
  return known;
}

/// A tip moved at 1 kHz, with frames as in a session.
class GuidedTip {
 public:
  explicit GuidedTip(std::shared_ptr<const Model> model) : model_(std::move(model)) {
    parameters_.method = ForceMethod::kProxy;
    parameters_.friction = parameters_.viscosity = false;
    parameters_.max_force_N = parameters_.device[0].limits.peak_force_N = 20;
    parameters_.device[0].max_stiffness_N_per_mm = 2;
    stay(0.6);
  }
  /// Moves the tip's sphere to a depth below the surface at rest.
  void press(double depth_mm, double speed_mm_s = 20) {
    const double to = kRadius_mm - depth_mm, step_mm = speed_mm_s * 1e-3;
    while (std::abs(to - z_) > step_mm) {
      z_ += to > z_ ? step_mm : -step_mm;
      tick();
    }
    z_ = to;
    tick();
  }
  void stay(double time_s) {
    for (int n = 0; n < 1000 * time_s; ++n) tick();
  }
  Result<void> apply_law(TissueLaw law) {
    auto next = next_version({model_, model_}, change_of_law(*model_, law));
    if (!next) return next.error();
    model_ = next->current;
    return {};
  }
  const TickRecord& record() const { return record_; }
  const ProxyState& proxy() const { return state_.device[0].proxy; }
  const Model& model() const { return *model_; }
  /// Largest step of all ticks since the last call.
  double take_largest_step_N() { return std::exchange(largest_step_N_, 0); }
  std::function<void()> after_tick;

 private:
  void tick() {
    const bool is_deformable = ticked_ != nullptr && is_elastic(ticked_->tissue_law);
    if (is_deformable ? solver_.advance(*ticked_, &record_) : solver_.publish_pending())
      parameters_.compliance = solver_.frame();
    DeviceState device;
    device.tip = model_->X_WorldPatient * Point<Patient>(0, 0, z_);
    Wrench wrench;
    const auto norm_N = [&] {
      return Eigen::Map<const Eigen::Vector3d>(record_.device[0].force_N.data()).norm();
    };
    const double before_N = norm_N();
    palpate::tick(*model_, parameters_, {&device, 1}, 1e-3, state_, {&wrench, 1}, record_);
    ticked_ = model_;
    largest_step_N_ = std::max(largest_step_N_, std::abs(norm_N() - before_N));
    if (after_tick) after_tick();
  }

  std::shared_ptr<const Model> model_, ticked_;
  Parameters parameters_;
  SessionState state_;
  TickRecord record_;
  VirtualClockSoftTissueSolver solver_{1000};
  double z_ = kRadius_mm + 3, largest_step_N_ = 0;
};

double sent_N(const GuidedTip& tip) {
  return Eigen::Map<const Eigen::Vector3d>(tip.record().device[0].force_N.data()).norm();
}

TEST(LawChange, SurfacesEqualThoseOfASceneWithTheNewLaw) {
  const auto layers = limb(TissueLaw::kLayers), elastic = limb(TissueLaw::kElastic);
  ASSERT_NE(layers->surfaces.size(), elastic->surfaces.size());
  for (const auto& [from, to] : {std::pair(layers, elastic), std::pair(elastic, layers)}) {
    EXPECT_TRUE(has_other_surfaces(*from, to->tissue_law));
    const auto under = under_law(*from, to->tissue_law);
    ASSERT_TRUE(under.ok()) << under.error().message();
    const Model& is = **under;
    EXPECT_EQ(is.label_of_surface, to->label_of_surface);
    ASSERT_EQ(is.surfaces.size(), to->surfaces.size());
    for (std::size_t s = 0; s < is.surfaces.size(); ++s) {
      const ContactSurface &a = is.surfaces[s], &b = to->surfaces[s];
      ASSERT_EQ(a.surface == nullptr, b.surface == nullptr) << s;
      if (a.surface != nullptr) {
        EXPECT_EQ(a.surface->content_hash(), b.surface->content_hash()) << s;
      }
      EXPECT_EQ(a.layer, b.layer) << s;
      EXPECT_EQ(a.lower_N_per_mm, b.lower_N_per_mm) << s;
      EXPECT_EQ(a.upper_N_per_mm, b.upper_N_per_mm) << s;
      EXPECT_EQ(a.stiffness_N_per_mm, b.stiffness_N_per_mm) << s;
      EXPECT_EQ(a.plane_strain_modulus_N_per_mm2, b.plane_strain_modulus_N_per_mm2) << s;
      EXPECT_EQ(a.strain_stiffening, b.strain_stiffening) << s;
    }
  }
}

TEST(LawChange, StiffeningAppliesOnlyUnderTheExponentialLaw) {
  const auto of_muscle = [](const Model& model) {
    for (std::size_t s = 0; s < model.label_of_surface.size(); ++s)
      if (model.label_of_surface[s] == kMuscle) return model.surfaces[s].strain_stiffening;
    return -1.0;
  };
  const auto finite = limb(TissueLaw::kNeoHookean), exponential = limb(TissueLaw::kExponential);
  EXPECT_EQ(of_muscle(*finite), 0);
  EXPECT_EQ(of_muscle(*exponential), 20);
  EXPECT_EQ(of_muscle(*under_law(*finite, TissueLaw::kExponential).value()), 20);
  EXPECT_EQ(of_muscle(*under_law(*exponential, TissueLaw::kElastic).value()), 0);
}

// Depths at which the tip lies in each layer in turn, and in the bone's.
TEST(LawChange, ForceBlendsToTheNewLaw) {
  for (const double depth_mm : {5.0, 11.0}) {
    for (const auto& [from, to] : {std::pair(TissueLaw::kLayers, TissueLaw::kElastic),
                                   std::pair(TissueLaw::kElastic, TissueLaw::kLayers),
                                   std::pair(TissueLaw::kNeoHookean, TissueLaw::kChainMail)}) {
      SCOPED_TRACE(std::to_string(depth_mm) + " mm, from law " + std::to_string(static_cast<int>(from)));
      GuidedTip reference(limb(to));
      reference.press(depth_mm);
      reference.stay(0.4);
      GuidedTip tip(limb(from));
      tip.press(depth_mm);
      tip.stay(0.4);
      const double before_N = sent_N(tip), expected_N = sent_N(reference);
      ASSERT_GT(before_N, 0.1);
      ASSERT_TRUE(tip.apply_law(to).ok());
      tip.take_largest_step_N();
      tip.stay(0.4);
      EXPECT_NEAR(sent_N(tip), expected_N, is_elastic(to) ? 0.02 * expected_N : 1e-3);
      // within about 20 ms, as for any change of force source, plus the change of a frame for a new contact
      EXPECT_LT(tip.take_largest_step_N(), 0.3 * std::abs(expected_N - before_N) + 0.03);
      EXPECT_EQ(tip.record().device[0].flags & kFlagInside, 0u);
      // change back
      ASSERT_TRUE(tip.apply_law(from).ok());
      tip.stay(0.4);
      EXPECT_NEAR(sent_N(tip), before_N, is_elastic(from) ? 0.02 * before_N : 1e-3);
      tip.press(-3, 100);
      EXPECT_EQ(sent_N(tip), 0);
    }
  }
}

// Compressed to half their height and more, neo-Hookean cells have no solution in some attempts. That the law
// is in force at all shows in the ratio to the linear force, which grows with depth.
TEST(LawChange, FailedNeoHookeanAttemptsDoNotChangeARestingForce) {
  double previous_ratio = 1.01;
  for (const double depth_mm : {4.0, 5.0, 6.0}) {
    GuidedTip tip(limb(TissueLaw::kNeoHookean));
    tip.press(depth_mm);
    tip.stay(0.4);
    double min_N = sent_N(tip), max_N = min_N;
    tip.after_tick = [&] {
      min_N = std::min(min_N, sent_N(tip));
      max_N = std::max(max_N, sent_N(tip));
    };
    tip.stay(1);
    EXPECT_LT(max_N - min_N, 0.02) << depth_mm << " mm";
    GuidedTip linear(limb(TissueLaw::kElastic));
    linear.press(depth_mm);
    linear.stay(0.2);
    const double ratio = max_N / sent_N(linear);
    EXPECT_GT(ratio, previous_ratio) << depth_mm << " mm";
    previous_ratio = ratio;
  }
}

TEST(LawChange, PuncturesPersistAcrossALawChange) {
  for (const auto& [from, to] : {std::pair(TissueLaw::kLayers, TissueLaw::kElastic),
                                 std::pair(TissueLaw::kElastic, TissueLaw::kLayers)}) {
    constexpr double kDepth_mm = 7, kPuncture_N = 0.3;
    GuidedTip reference(limb(to, kPuncture_N)), tip(limb(from, kPuncture_N));
    for (GuidedTip* one : {&reference, &tip}) {
      bool ruptured = false;
      one->after_tick = [&] { ruptured = ruptured || (one->record().device[0].flags & kFlagRuptured) != 0; };
      one->press(kDepth_mm);
      one->stay(0.5);
      one->after_tick = {};
      ASSERT_TRUE(ruptured);
    }
    ASSERT_TRUE(tip.apply_law(to).ok());
    tip.stay(0.5);
    EXPECT_NEAR(sent_N(tip), sent_N(reference), is_elastic(to) ? 0.02 * sent_N(reference) : 1e-3);
    EXPECT_EQ(tip.proxy().punctured, reference.proxy().punctured);
  }
}

// a frame solved before tissue ceased to be deformable is ignored when it becomes deformable again
TEST(LawChange, StaleSolverFramesAreIgnored) {
  GuidedTip tip(limb(TissueLaw::kElastic));
  tip.press(4);
  tip.stay(0.3);
  const double elastic_N = sent_N(tip);
  ASSERT_TRUE(tip.apply_law(TissueLaw::kLayers).ok());
  tip.press(-3);
  tip.press(4);
  const std::uint32_t last = tip.record().solver_frame;
  tip.stay(0.2);
  EXPECT_EQ(tip.record().solver_frame, last);
  ASSERT_TRUE(tip.apply_law(TissueLaw::kElastic).ok());
  tip.stay(0.005);
  EXPECT_EQ(tip.record().solver_frame, last);
  EXPECT_EQ(tip.proxy().compliance.surroundings_mm_per_N, 0) << "a half space, until there is a new one";
  tip.stay(0.3);
  EXPECT_GT(tip.record().solver_frame, last + 10);
  EXPECT_NEAR(sent_N(tip), elastic_N, 0.02 * elastic_N);
}

TEST(LawChange, UncoupledTipStaysUncoupled) {
  const auto model = limb(TissueLaw::kLayers);
  SessionState state;
  Parameters parameters;
  parameters.method = ForceMethod::kProxy;
  TickRecord record;
  const auto tick_of = [&](const Model& current) {
    DeviceState device;
    device.tip = current.X_WorldPatient * Point<Patient>(0, 0, -5);
    Wrench wrench;
    palpate::tick(current, parameters, {&device, 1}, 1e-3, state, {&wrench, 1}, record);
  };
  tick_of(*model);
  ASSERT_NE(record.device[0].flags & kFlagInside, 0u);
  const auto next = next_version({model, model}, change_of_law(*model, TissueLaw::kElastic));
  ASSERT_TRUE(next.ok());
  for (int n = 0; n < 600; ++n) tick_of(*next->current);
  EXPECT_NE(record.device[0].flags & kFlagInside, 0u);
  EXPECT_EQ(Eigen::Map<const Eigen::Vector3d>(record.device[0].force_N.data()).norm(), 0);
}

TEST(LawChange, IsRejectedAfterRemoval) {
  const auto model = limb(TissueLaw::kElastic);
  const Cut cut{0, {Point<Patient>(0, 0, 1), Point<Patient>(0, 0, -1), 2, 1}};
  const auto carved = carved_by(*model, {&cut, 1})->applied_to(*model);
  EXPECT_TRUE(check_law(*carved, TissueLaw::kNeoHookean).ok());
  for (const TissueLaw law : {TissueLaw::kLayers, TissueLaw::kChainMail}) {
    EXPECT_THAT(check_law(*carved, law).error().what, HasSubstr("tissue was cut"));
    EXPECT_FALSE(next_version({carved, carved}, change_of_law(*carved, law)).ok());
  }
}

}  // namespace
}  // namespace palpate
