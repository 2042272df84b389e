#include "palpate/stability/hold.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "base/test_folder.h"
#include "contact/test_model.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;
using testing::kBoneRadius_mm;

// a ball of 15 mm radius and 1.5 N/mm
const Model& ball_to_palpate() {
  static const Model model = testing::with_exact_surfaces(testing::ball_model());
  return model;
}

Hold hold_at(ForceMethod method, const Point<Patient>& from, const Point<Patient>& at) {
  Hold hold;
  hold.device = *find_plant_device("premium-1.5");
  hold.hand = *find_plant_hand("firm-grip");
  hold.method = method;
  hold.from = from;
  hold.at = at;
  return hold;
}

// from outside, to a depth where the proxy exerts 1 N and the hand's spring is 2 mm longer
Hold pressed_ball(double force_gain = 1) {
  const double depth_mm = 1 / (1.5 * force_gain) + 1 / 0.5;
  Hold hold =
      hold_at(ForceMethod::kProxy, Point<Patient>(0, 18, 0), Point<Patient>(0, kBoneRadius_mm - depth_mm, 0));
  hold.force_gain = force_gain;
  return hold;
}

TEST(Hold, AHandInFreeSpaceStandsStill) {
  const Point<Patient> free(0, 25, 0);
  const auto result = hold_tip(ball_to_palpate(), hold_at(ForceMethod::kTrilinear, free, free));
  ASSERT_TRUE(result.ok());
  EXPECT_EQ(result->buzz.peak_to_peak_um, 0);
  EXPECT_EQ(result->buzz.energy_mJ, 0);
  EXPECT_EQ(result->buzz.force_N, 0);
  EXPECT_TRUE(result->quiet());
  ASSERT_EQ(result->tip.size(), 2001u) << "2 s at 1 kHz";
  for (const Point<Patient>& tip : result->tip) EXPECT_LT((tip - free).norm(), 1e-9);
}

TEST(Hold, AWallIsHeldQuietlyAtTheForceOfItsSpring) {
  for (const double force_gain : {1.0, 0.5}) {
    const auto result = hold_tip(ball_to_palpate(), pressed_ball(force_gain));
    ASSERT_TRUE(result.ok());
    EXPECT_TRUE(result->quiet());
    // tolerance for Coulomb friction and an encoder step
    EXPECT_NEAR(result->buzz.force_N, 1, 0.1);
    EXPECT_NEAR(result->tip.back().y(), kBoneRadius_mm - 1 / (1.5 * force_gain), 0.1);
    EXPECT_FALSE(result->inside);
  }
}

TEST(Hold, AWallThatIsTooStiffForRateAndDelayIsNotHeld) {
  const auto quiet = hold_tip(ball_to_palpate(), pressed_ball(1));
  Hold hard = pressed_ball(1);
  hard.force_gain = 6;
  hard.delay_s = 3e-3;
  const auto swings = hold_tip(ball_to_palpate(), hard);
  ASSERT_TRUE(quiet.ok() && swings.ok());
  EXPECT_FALSE(swings->quiet());
  EXPECT_GT(swings->buzz.peak_to_peak_um, 10 * quiet->buzz.peak_to_peak_um);
  // four times the rate, a delay of one sample
  hard.rate_hz = 4000;
  hard.delay_s = 0.25e-3;
  const auto fast = hold_tip(ball_to_palpate(), hard);
  ASSERT_TRUE(fast.ok());
  EXPECT_TRUE(fast->quiet());
  EXPECT_EQ(fast->tip.size(), 8001u);
}

TEST(Hold, ReportsAStartInside) {
  const Point<Patient> deep(0, 5, 0);
  const auto result = hold_tip(ball_to_palpate(), hold_at(ForceMethod::kProxy, deep, deep));
  ASSERT_TRUE(result.ok());
  EXPECT_TRUE(result->inside);
  EXPECT_EQ(result->buzz.force_N, 0);
}

TEST(Hold, RejectsInvalidOptions) {
  Hold slow = pressed_ball(), late = pressed_ball();
  slow.rate_hz = std::nan("");
  late.delay_s = 1;
  for (const Hold& hold : {slow, late}) {
    const auto refused = hold_tip(ball_to_palpate(), hold);
    ASSERT_FALSE(refused.ok());
    EXPECT_EQ(refused.error().kind, ErrorKind::kBadInput);
  }
  const std::atomic<bool> stop = true;
  const auto stopped = hold_tip(ball_to_palpate(), pressed_ball(), Progress({}, &stop));
  ASSERT_FALSE(stopped.ok());
  EXPECT_EQ(stopped.error().kind, ErrorKind::kInterrupted);
}

TEST(HoldPicture, HasAPanelForEachTip) {
  const Point<Patient> free(0, 25, 0);
  const std::array tips{*hold_tip(ball_to_palpate(), hold_at(ForceMethod::kTrilinear, free, free)),
                        *hold_tip(ball_to_palpate(), pressed_ball())};
  const test::TemporaryFolder folder;
  ASSERT_TRUE(write_hold_picture(folder / "hold.svg", tips, "by <hand> & eye").ok());
  std::ifstream file(folder / "hold.svg");
  const std::string svg{std::istreambuf_iterator<char>(file), {}};
  for (const char* part : {"by &lt;hand&gt; &amp; eye", ">trilinear<", ">proxy<", "two encoder steps, 60",
                           "not for clinical use"})
    EXPECT_THAT(svg, HasSubstr(part));
  const auto refused = write_hold_picture(folder / "missing" / "hold.svg", tips, "");
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().kind, ErrorKind::kOutput);
}

}  // namespace
}  // namespace palpate
