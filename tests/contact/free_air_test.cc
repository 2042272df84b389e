#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <optional>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "base/test_files.h"
#include "contact_body.h"
#include "palpate/phantoms/phantoms.h"
#include "soft_and_bone.h"

/// A tool in free air has no force: presses to 8 N on layered bodies, withdrawn along the entry path or out
/// through another side. PALPATE_TEST_PRESSES: number of presses on each body.
namespace palpate::free_air {
namespace {

using namespace test;

constexpr unsigned kFreeAirSeed = 49;
constexpr double kDt_s = 0.001, kPress_N = 8, kStep_mm = 0.02;
constexpr int kHold_ticks = 700;
constexpr double kFar_mm = 12, kDeepest_mm = 12, kLateral_mm = 30;
constexpr double kFree_mm = 1;  // clearance from every touchable structure, beyond the radius of the tool
constexpr double kResidual_N = 0.02;  // residual force below the threshold of perception
constexpr double kJump_N = 0.02;  // change of the force in a tick beyond stiffness times displacement of the
                                  // tip
// limit for all layers together; a place where no contact constrains the path has given 0.024 N
constexpr double kMaxJump_N = 0.03;
constexpr double kRounding_N = 1e-9;
constexpr double kSunk_mm = 0.1;  // a path deeper than this is not free
// one tick of the slip law
constexpr double kSlip_N = kProxySettings.max_slip_N_per_s * kDt_s;

int presses_requested() {
  const char* value = std::getenv("PALPATE_TEST_PRESSES");
  return value != nullptr ? std::atoi(value) : 200;
}

struct FreeAirFigures {
  int presses = 0, back = 0, lateral = 0;
  /// Exit paths that reached free air, where the tip then rested.
  int reached_free_back = 0, reached_free_lateral = 0;
  /// Withdrawals along the entry path of a tool that had slid around an obstacle, which then constrains it;
  /// not counted as failures.
  int hooked = 0;
  int within_while_free =
      0;                ///< Ticks in which an inner layer exerted force while the outermost proxy was free
  int unexplained = 0;  ///< Ticks with a force that neither a contact nor a release explains
  int jumps = 0, slow_releases = 0;
  /// Withdrawals and lateral exits after which more than kResidual_N remained.
  int residual_after_back = 0, residual_after_lateral = 0;
  int grown = 0;  ///< Withdrawals in which the force increased in free air
  double largest_jump_N = 0, max_released_N = 0, max_residual_N = 0, longest_residual_s = 0;
};

enum class ExitPath { kBack, kLateral };

/// One press, and the way out of it.
class FreeAirPress {
 public:
  FreeAirPress(const Body& body, double radius_mm, FreeAirFigures& figures)
      : body_(body), tool_{{}, radius_mm}, figures_(figures) {}

  void run(const Point<Patient>& target, const Vector<Patient>& outward, const Vector<Patient>& across,
           ExitPath path_out) {
    const auto start = body_.free_place(target, outward, tool_.radius_mm, kFar_mm);
    if (!start) return;
    ++figures_.presses;
    tip_ = start_ = *start;
    advance();
    double pressed_mm = 0;
    for (; result_.force_N.norm() < kPress_N && pressed_mm < kFar_mm + kDeepest_mm; pressed_mm += kStep_mm)
      lead(outward * -kStep_mm);
    if (path_out == ExitPath::kBack) {
      ++figures_.back;
      while ((tip_ - *start).norm() > 1.5 * kStep_mm) lead((*start - tip_).normalized() * kStep_mm);
      is_back_ = true;
      for (double distance_mm = 0; distance_mm < kFar_mm && !is_far_from_all(); distance_mm += kStep_mm)
        lead(outward * kStep_mm);
    } else {
      ++figures_.lateral;
      for (double lateral_mm = 0; lateral_mm < kLateral_mm && !(is_far_from_all() && lateral_mm > kFar_mm);
           lateral_mm += kStep_mm)
        lead(across * kStep_mm);
    }
    if (!is_far_from_all()) return;
    if (is_back_ && went_round_) {
      ++figures_.hooked;
      return;
    }
    ++(is_back_ ? figures_.reached_free_back : figures_.reached_free_lateral);
    for (int n = 0; n < kHold_ticks; ++n) hold();
    figures_.residual_after_back += is_back_ && has_residual_;
    figures_.residual_after_lateral += !is_back_ && has_residual_;
    figures_.grown += is_back_ && grown_;
  }

 private:
  void lead(const Vector<Patient>& step) {
    tip_ += step;
    advance();
    went_round_ = went_round_ || (is_free() && !is_straight_path());
  }

  bool is_free() const {
    return state_.contact_count == 0 && (state_.position - tip_).norm() <= kProxySettings.arrived_mm;
  }
  // whether the straight path from the start to the tip is free
  bool is_straight_path() const {
    const Vector<Patient> displacement = tip_ - start_;
    for (double at_mm = 0; at_mm < displacement.norm(); at_mm += 0.1)
      if (body_.clearance_mm(start_ + displacement.normalized() * at_mm, tool_.radius_mm) < -kSunk_mm)
        return false;
    return true;
  }

  // one tick at rest in free air: the residual force may only decrease, at the rate of the slip limit
  void hold() {
    const double before_N = result_.force_N.norm();
    advance();
    const double now_N = result_.force_N.norm();
    grown_ = grown_ || now_N > before_N + kRounding_N;
    held_s_ += kDt_s;
    if (held_s_ * kProxySettings.max_slip_N_per_s <= residual_N_ + kSlip_N || now_N <= kResidual_N) return;
    has_residual_ = true;
    figures_.max_residual_N = std::max(figures_.max_residual_N, now_N);
    figures_.longest_residual_s = std::max(figures_.longest_residual_s, held_s_);
  }

  void advance() {
    const ProxyResult before = result_;
    const Vector<Patient> moved = tip_ - state_.tip;
    result_ = advance_proxy(body_.surfaces, {&tool_, 1}, tip_, state_);
    const double K = std::max(before.stiffness_N_per_mm, result_.stiffness_N_per_mm);
    const double jump_N = begun_ ? (result_.force_N - before.force_N).norm() - K * moved.norm() : 0;
    begun_ = true;
    figures_.largest_jump_N = std::max(figures_.largest_jump_N, jump_N);
    figures_.jumps += jump_N > kJump_N;
    // unexplained force: no contact of the outer layer, no force of an inner layer, no release
    figures_.unexplained += result_.force_N != Vector<Patient>() && state_.contact_count == 0 &&
                            within_N(result_) == 0 && result_.release.force_N == Vector<Patient>();
    figures_.within_while_free += is_free() && within_N(result_) > 0;
    // a releasing force decreases by the full slip limit per tick, unless a layer is released in the same
    // tick
    const double released_N = result_.release.force_N.norm();
    figures_.max_released_N = std::max(figures_.max_released_N, released_N);
    const double expected_N = std::max(0.0, before.release.force_N.norm() - kSlip_N);
    if (!has_released_layer(before, result_)) figures_.slow_releases += released_N > expected_N + kRounding_N;
    if (is_far_from_all()) {
      if (held_s_ == 0) residual_N_ = result_.force_N.norm();
    } else {
      residual_N_ = held_s_ = 0;
    }
  }

  // whether a layer has stopped giving force
  static bool has_released_layer(const ProxyResult& before, const ProxyResult& now) {
    for (std::size_t n = 0; n < kMaxLayers; ++n)
      if (before.of_layer[n].force_N != Vector<Patient>() && now.of_layer[n].force_N == Vector<Patient>())
        return true;
    return false;
  }

  // force of all layers except the outermost
  static double within_N(const ProxyResult& result) {
    double all_N = 0;
    for (const ProxyForce& layer : std::span(result.of_layer).subspan(1)) all_N += layer.force_N.norm();
    return all_N;
  }

  bool is_far_from_all() const {
    return body_.clearance_mm(tip_, tool_.radius_mm) > 0.5 * kFree_mm &&
           is_clear_of_voxels(body_, tip_, tool_.radius_mm + kFree_mm);
  }

  const Body& body_;
  ToolPart tool_;
  FreeAirFigures& figures_;
  ProxyState state_;
  ProxyResult result_;
  Point<Patient> tip_, start_;
  bool went_round_ = false;  // the tool has slid round to where the tip had come out on another side
  bool begun_ = false, is_back_ = false, has_residual_ = false, grown_ = false;
  double residual_N_ = 0, held_s_ = 0;
};

FreeAirFigures press_all_over(const Body& body, int presses, double radius_mm) {
  std::mt19937 random(kFreeAirSeed);
  FreeAirFigures figures;
  const ExposedVoxels voxels = exposed_voxels(body);
  const auto X_PatientVoxel = body.model->labels->geometry().X_PatientVoxel();
  std::uniform_real_distribution<double> turn(0, 6.283185307179586), tilt(0, 0.6);
  for (int n = 0; n < presses; ++n) {
    const Point<Patient> target = X_PatientVoxel * voxels.any(n % 2 == 0, random);
    const Eigen::Vector3d normal = body.outward(target).eigen();
    const Eigen::Vector3d lateral = Eigen::AngleAxisd(turn(random), normal) * normal.unitOrthogonal();
    const Eigen::Vector3d outward = Eigen::AngleAxisd(tilt(random), lateral) * normal;
    const Eigen::Vector3d across = Eigen::AngleAxisd(turn(random), outward) * outward.unitOrthogonal();
    FreeAirPress(body, radius_mm, figures)
        .run(target, Vector<Patient>(outward), Vector<Patient>(across),
             n % 4 < 2 ? ExitPath::kBack : ExitPath::kLateral);
  }
  return figures;
}

void expect_no_force_in_free_air(const char* what, const Model& model) {
  SCOPED_TRACE(std::string(what) + ", seed " + std::to_string(kFreeAirSeed));
  const Body body = one_body(model);
  for (const double radius_mm : {0.0, 0.5, 1.5, 3.0}) {
    const FreeAirFigures f = press_all_over(body, presses_requested() / 4, radius_mm);
    std::printf(
        "%-13s tool %.1f mm: %5d presses, %5d back, %5d aside in free air; %d ticks of force within while "
        "free, %d jumps "
        "(largest "
        "%.3f N), %d slow releases (largest %.2f N); drawn %d (%.3f N, %.2f s), grown %d; hooked %d, held "
        "outside %d\n",
        what, radius_mm, f.presses, f.reached_free_back, f.reached_free_lateral, f.within_while_free, f.jumps,
        f.largest_jump_N, f.slow_releases, f.max_released_N, f.residual_after_back, f.max_residual_N,
        f.longest_residual_s, f.grown, f.hooked, f.residual_after_lateral);
    std::fflush(stdout);
    EXPECT_GT(f.presses, presses_requested() / 16) << "of a quarter for each tool";
    EXPECT_EQ(f.within_while_free, 0);
    EXPECT_LT(f.largest_jump_N, kMaxJump_N);
    EXPECT_EQ(f.slow_releases, 0);
    EXPECT_GT(f.reached_free_back, f.back / 2) << "too few withdrawals reached free air to test them";
    EXPECT_EQ(f.unexplained, 0);
    // one of 5256 was (docs/decisions/0076-layers-hold-while-covered.md)
    EXPECT_LE(f.residual_after_back, f.reached_free_back / 80);
    EXPECT_EQ(f.grown, 0);
  }
}

TEST(FreeAir, FreeToolHasNoForceNearPlatesInSoftTissue) {
  expect_no_force_in_free_air("cells, plates", soft_and_bone_model(cells_and_plates(kFreeAirSeed)));
}

TEST(FreeAir, FreeToolHasNoForceNearThePhantomKnee) {
  const auto parameters = parse_phantom("knee-phantom:spacing=0.8");
  ASSERT_TRUE(parameters.ok());
  const auto phantom = make_phantom(*parameters);
  ASSERT_TRUE(phantom.ok());
  expect_no_force_in_free_air("knee-phantom", model_of(phantom->labels, as_proposed));
}

void expect_no_force_in_free_air_near(const char* what, const std::string& name, double min_N_per_mm) {
  PALPATE_SHARED_FILE(file, name);
  const auto labels = labels_of(file);
  ASSERT_TRUE(labels);
  expect_no_force_in_free_air(what, model_of(*labels, [&](const Segment& segment) {
                                const auto stiffness = as_proposed(segment);
                                return stiffness && *stiffness >= min_N_per_mm ? stiffness : std::nullopt;
                              }));
}

TEST(FreeAir, FreeToolHasNoForceNearTheHandSegmentedKnee) {
  expect_no_force_in_free_air_near("knee_spl", "knee_spl/seg.nrrd", presses_requested() >= 1000 ? 0 : 0.2);
}

TEST(FreeAir, FreeToolHasNoForceNearTheObliqueKnee) {
  expect_no_force_in_free_air_near("knee_dess", "knee_dess/SAG_3D_DESS_RIGHT_bones_cart_men_fib-label.nrrd",
                                   0);
}

TEST(FreeAir, FreeToolHasNoForceNearAHeadOfFourStiffnesses) {
  const std::filesystem::path file = "/usr/share/mricron/templates/aal.nii.gz";
  if (!std::filesystem::exists(file)) {
    if (in_ci()) FAIL() << "the package mricron-data is not installed";
    GTEST_SKIP() << "needs the package mricron-data";
  }
  const auto labels = labels_of(file);
  ASSERT_TRUE(labels);
  expect_no_force_in_free_air(
      "head", model_of(*labels, [](const Segment& segment) { return 0.2 + 0.3 * (segment.id % 4); }));
}

// into the cup from above, out through its thin wall into free air
TEST(FreeAir, ToolThatExitedThroughACupIsReleased) {
  for (const double wall_mm : {1.0, 1.5})
    for (const double radius_mm : {0.0, 0.5, 1.5}) {
      SCOPED_TRACE(testing::Message() << "wall " << wall_mm << " mm, tool " << radius_mm << " mm");
      const Body body = one_body(soft_and_bone_model(cup_in_a_ball(wall_mm)));
      const ToolPart tool{{}, radius_mm};
      ProxyState state;
      ProxyResult result;
      Point<Patient> tip(0, 0, 12);
      const auto lead = [&](const Point<Patient>& to) {
        while ((to - tip).norm() > 1e-9) {
          tip += (to - tip) * std::min(1.0, kStep_mm / (to - tip).norm());
          result = advance_proxy(body.surfaces, {&tool, 1}, tip, state);
        }
      };
      lead({0, 0, 0});
      lead({7.5, 0, 0});
      const double within_N = result.of_layer[1].force_N.norm();
      EXPECT_GT(within_N, 1) << "the wall holds while the soft ball does";
      lead({12.5 + radius_mm, 0, 0});
      const double left_N = result.force_N.norm();
      const int max_ticks = static_cast<int>(left_N / kSlip_N) + 1;
      for (int n = 0; n < max_ticks; ++n) {
        const double before_N = result.force_N.norm();
        result = advance_proxy(body.surfaces, {&tool, 1}, tip, state);
        EXPECT_LE(result.force_N.norm(), before_N);
        EXPECT_EQ(result.force_N, result.release.force_N);
      }
      EXPECT_EQ(result.force_N, Vector<Patient>());
      EXPECT_EQ(state.layer(1).position, tip);
    }
}

}  // namespace
}  // namespace palpate::free_air
