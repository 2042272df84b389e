#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <optional>
#include <random>
#include <string>

#include "contact_body.h"
#include "palpate/model/make_model.h"
#include "palpate/servo/servo.h"
#include "palpate/tissue/soft_tissue_solver.h"
#include "soft_and_bone.h"

/// Free air through the whole tick, with tissue solved on the virtual clock as in a session: a press to 8 N,
/// then back along the path or aside, then rest. PALPATE_TEST_TICK_PRESSES: number of presses on each body.
namespace palpate::free_air_ticks {
namespace {

using namespace test;

constexpr unsigned kTicksSeed = 4949;
constexpr double kRate_hz = 1000, kPress_N = 8, kStep_mm = 0.05;
constexpr double kFadeIn_s = 0.6, kRest_s = 0.7;
constexpr double kFar_mm = 12, kDeepest_mm = 8, kLateral_mm = 30;
constexpr double kFree_mm = 1;  // distance from felt voxels, beyond the tool's radius
constexpr double kPerceptible_N = 0.02;
constexpr double kRounding_N = 1e-9;

int presses_on_each() {
  const char* value = std::getenv("PALPATE_TEST_TICK_PRESSES");
  return value != nullptr ? std::atoi(value) : 4;
}

struct TickFigures {
  int presses = 0, in_free_air = 0;
  int pressed = 0;        ///< presses that reached 1 N: without force nothing is tested
  int unexplained = 0;    ///< ticks that sent more than kPerceptible_N without a flag that explains the force
  int pulled = 0;         ///< presses after which more than kPerceptible_N outlasted the release
  int grown = 0;          ///< presses after which the force in free air grew
  double max_left_N = 0;  ///< force when free air was reached
};

/// Session of one tool without damping, friction and viscosity, whose tip is moved kinematically.
class DrivenSession {
 public:
  DrivenSession(std::shared_ptr<const Model> model, const Point<Patient>& start)
      : model_(std::move(model)), tip_(start) {
    parameters_.method = ForceMethod::kProxy;
    parameters_.friction = parameters_.viscosity = parameters_.passivity = false;
    parameters_.max_force_N = 20;
    parameters_.device[0].limits.peak_force_N = 20;
    for (int n = 0; n < kFadeIn_s * kRate_hz; ++n) move({});
  }

  void move(const Vector<Patient>& step) {
    tip_ += step;
    if (virtual_solver_.advance(*model_, state_.tick > 0 ? &record_ : nullptr))
      parameters_.compliance = virtual_solver_.frame();
    DeviceState device;
    device.tip = model_->X_WorldPatient * tip_;
    tick(*model_, parameters_, {&device, 1}, 1 / kRate_hz, state_, {&sent_, 1}, record_);
  }
  const Point<Patient>& tip() const { return tip_; }
  double force_N() const { return sent_.force_N.norm(); }
  bool is_explained_by_flags() const {
    // the slew limit may still be on its way to a force that has ended
    constexpr std::uint32_t kCauses = kFlagContact | kFlagRelease | kFlagSlew;
    return force_N() <= kPerceptible_N || (record_.device[0].flags & kCauses) != 0;
  }

 private:
  const std::shared_ptr<const Model> model_;
  Parameters parameters_;
  SessionState state_;
  TickRecord record_;
  Wrench sent_;
  VirtualClockSoftTissueSolver virtual_solver_{kRate_hz};
  Point<Patient> tip_;
};

void press(const Body& body, double radius_mm, const Point<Patient>& start, const Vector<Patient>& outward,
           const std::optional<Vector<Patient>>& lateral, TickFigures& figures) {
  DrivenSession session(body.model, start);
  double max_N = 0;
  const auto move = [&](const Vector<Patient>& step) {
    session.move(step);
    figures.unexplained += !session.is_explained_by_flags();
    max_N = std::max(max_N, session.force_N());
  };
  const auto is_free = [&] { return is_clear_of_voxels(body, session.tip(), radius_mm + kFree_mm); };
  for (double distance_mm = 0; session.force_N() < kPress_N && distance_mm < kFar_mm + kDeepest_mm;
       distance_mm += kStep_mm)
    move(outward * -kStep_mm);
  ++figures.presses;
  figures.pressed += max_N > 1;
  const Vector<Patient> out = lateral.value_or(outward);
  for (double distance_mm = 0; distance_mm < kLateral_mm && !is_free(); distance_mm += kStep_mm)
    move(out * kStep_mm);
  if (!is_free()) return;
  ++figures.in_free_air;
  const double left_N = session.force_N();
  figures.max_left_N = std::max(figures.max_left_N, left_N);
  bool grown = false, pulled = false;
  for (int n = 0; n < kRest_s * kRate_hz; ++n) {
    const double before_N = session.force_N();
    move({});
    grown = grown || session.force_N() > before_N + kRounding_N;
    pulled = pulled || (n > 1 + kRate_hz * left_N / kProxySettings.max_slip_N_per_s &&
                        session.force_N() > kPerceptible_N);
  }
  figures.grown += grown;
  figures.pulled += pulled;
}

// a model prepared for a tick by the proxy
Body whole_body(const LabelMap& map, TissueLaw law, double radius_mm) {
  const Model proposed = soft_and_bone_model(map);
  ModelParts parts;
  parts.labels = proposed.labels;
  parts.segments = map.segments;
  parts.tissues = proposed.tissues;
  parts.tissues[0].elastic = ElasticConstants{20, 0.45};
  parts.tissue_of_label = proposed.tissue_of_label;
  parts.tissue_law = law;
  parts.tools[0].radius_mm = radius_mm;
  auto made = make_model(std::move(parts));
  PALPATE_CHECK(made.ok());
  const ForceMethod proxy = ForceMethod::kProxy;
  auto ready = prepared_for(*made, {&proxy, 1});
  PALPATE_CHECK(ready.ok());
  return {*ready, (*ready)->surfaces};
}

TickFigures press_all_over(const char* what, const LabelMap& map, TissueLaw law) {
  std::mt19937 random(kTicksSeed);
  std::uniform_real_distribution<double> turn(0, 6.283185307179586);
  TickFigures figures;
  for (const double radius_mm : {0.0, 1.5, 3.0}) {
    const Body body = whole_body(map, law, radius_mm);
    const ExposedVoxels voxels = exposed_voxels(body);
    const auto X_PatientVoxel = body.model->labels->geometry().X_PatientVoxel();
    for (int n = 0; n < presses_on_each(); ++n) {
      const Point<Patient> target = X_PatientVoxel * voxels.any(n % 2 == 0, random);
      // the bodies are convex from outside: straight away from the middle
      const Vector<Patient> outward = (target - Point<Patient>()).normalized();
      const Eigen::Vector3d normal = outward.eigen();
      const Vector<Patient> across(Eigen::AngleAxisd(turn(random), normal) * normal.unitOrthogonal());
      press(body, radius_mm, target + outward * kFar_mm, outward,
            n % 4 < 2 ? std::nullopt : std::optional(across), figures);
    }
  }
  std::printf(
      "%-13s %-11s %3d presses, %3d to 1 N and more, %3d in free air (at most %.2f N left): %d ticks "
      "unnamed, %d pulled, %d grown\n",
      what, law == TissueLaw::kElastic ? "elastic" : "layers", figures.presses, figures.pressed,
      figures.in_free_air, figures.max_left_N, figures.unexplained, figures.pulled, figures.grown);
  std::fflush(stdout);
  return figures;
}

class FreeAirTicks : public testing::TestWithParam<TissueLaw> {};

TEST_P(FreeAirTicks, FreeToolHasNoForce) {
  SCOPED_TRACE("seed " + std::to_string(kTicksSeed));
  for (const auto& [what, map] :
       {std::pair("cup", cup_in_a_ball(1.0)), {"cells, plates", cells_and_plates(kTicksSeed)}}) {
    const TickFigures figures = press_all_over(what, map, GetParam());
    EXPECT_GT(figures.pressed, figures.presses / 2);
    EXPECT_GT(figures.in_free_air, figures.presses / 2);
    EXPECT_EQ(figures.unexplained, 0);
    EXPECT_EQ(figures.pulled, 0);
    EXPECT_EQ(figures.grown, 0);
  }
}

INSTANTIATE_TEST_SUITE_P(Laws, FreeAirTicks, testing::Values(TissueLaw::kLayers, TissueLaw::kElastic),
                         [](const auto& law) {
                           return law.param == TissueLaw::kElastic ? "Elastic" : "Layers";
                         });

}  // namespace
}  // namespace palpate::free_air_ticks
