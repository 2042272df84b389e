#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "session/test_viewed.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;
using testing::kViewedCartilage;
using testing::soon;
using testing::Viewed;

TEST_F(Viewed, ViewerRequestsNeedConsentWhileADeviceIsArmed) {
  start(false);
  EXPECT_FALSE(live_->scene().simulated);
  EXPECT_TRUE(live_->state().armed);
  const Parameters before = loop_->parameters();
  const auto one = [](const auto& set) {
    SettingsRequest request;
    request.by = {3, true};
    request.id = 12;
    set(request);
    return request;
  };
  const std::pair<SettingsRequest, const char*> wishes[] = {
      {one([](auto& r) {
         r.rotation_wxyz = {std::cos(0.2), 0, 0, std::sin(0.2)};
       }),
       "viewer 3 wants to turn the object by 22.9 degrees"},
      {one([](auto& r) { r.paused = true; }), "viewer 3 wants to pause the force"},
      {one([](auto& r) { r.max_force_N = 2; }), "viewer 3 wants to set the force limit to 2 N, now 3"},
      {one([](auto& r) { r.max_force_N = 4; }), "viewer 3 wants to set the force limit to 4 N, now 3"},
      {one([](auto& r) { r.method = "trilinear"; }), "viewer 3 wants to use the method trilinear"},
      {one([](auto& r) {
         r.friction = false;
         r.viscosity = false;
         r.passivity = true;
       }),
       "viewer 3 wants to switch friction off, and switch viscosity off, and switch the passivity controller "
       "on"}};
  for (const auto& [wish, words] : wishes) {
    SCOPED_TRACE(words);
    const auto granted = live_->set(wish);
    ASSERT_TRUE(granted.ok());
    EXPECT_EQ(*granted, RequestOutcome::kAwaitingConsent);
    ASSERT_TRUE(live_->question());
    EXPECT_EQ(live_->question()->text, words);
    // declined: nothing has changed
    const LateAnswer requested = answer(false);
    EXPECT_FALSE(requested.outcome.ok());
    EXPECT_EQ(requested.id, 12);
    const Parameters now = loop_->parameters();
    EXPECT_EQ(now.rotation_target.coeffs(), before.rotation_target.coeffs());
    EXPECT_EQ(now.method, before.method);
    EXPECT_EQ(now.paused, before.paused);
    EXPECT_EQ(now.max_force_N, before.max_force_N);
    EXPECT_EQ(switches_of(now), switches_of(before));
  }
  EXPECT_TRUE(reported().empty());

  // agreed to: it takes effect, and the recording names the consent
  ASSERT_TRUE(live_->set(wishes[0].first).ok());
  EXPECT_TRUE(answer(true).outcome.ok());
  EXPECT_NEAR(loop_->parameters().rotation_target.z(), std::sin(0.2), 1e-12);
  ASSERT_EQ(reported().size(), 1u);
  EXPECT_EQ(reported().back().by, (RequestedBy{Originator::kViewerWithConsent, 3}));
  EXPECT_EQ(reported().back().changed, kSettingRotation);

  // a request for the current value changes nothing and needs no consent
  const auto same = live_->set(wishes[0].first);
  EXPECT_TRUE(same.ok() && *same == RequestOutcome::kDone);
  EXPECT_FALSE(live_->question());
  // and an invalid request is refused immediately
  SettingsRequest wild;
  wild.max_force_N = 99;
  EXPECT_EQ(error_of(wild).where, "max_force_N");
}

TEST_F(Viewed, TissuesWaitForConsentToo) {
  start(false);
  TissueRequest request;
  request.by = {5, true};
  request.id = 3;
  request.tissue = kViewedCartilage;
  request.changes[&ContactProperties::stiffness_N_per_mm] = 0.5;
  request.changes[&ContactProperties::static_friction] = 0.4;
  const auto granted = live_->set(request);
  ASSERT_TRUE(granted.ok() && *granted == RequestOutcome::kAwaitingConsent);
  EXPECT_EQ(live_->question()->text,
            "viewer 5 wants to change cartilage's stiffness from 0.75 to 0.5 N/mm, and change its static "
            "friction from 0.1 to 0.4");
  EXPECT_EQ(live_->state().model_version, 1u);
  EXPECT_TRUE(answer(true).outcome.ok());
  EXPECT_EQ(live_->state().model_version, 2u);
  EXPECT_EQ(live_->state().tissues[kViewedCartilage].stiffness_N_per_mm, 0.5);
  ASSERT_EQ(reported().size(), 1u);
  EXPECT_EQ(reported().back().by, (RequestedBy{Originator::kViewerWithConsent, 5}));

  // a request that has become impossible in the meantime is refused despite consent
  request.changes[&ContactProperties::stiffness_N_per_mm] = 0.6;
  ASSERT_TRUE(live_->set(request).ok());
  loop_->change([](Parameters& parameters) { parameters.method = ForceMethod::kTrilinear; });
  EXPECT_EQ(answer(true).outcome.error().where, "stiffness_N_per_mm");
  EXPECT_EQ(live_->state().model_version, 2u);
}

TEST_F(Viewed, ChangesThatNeedConsentAreRefusedWithoutATerminal) {
  asks_here_ = false;
  start(false);
  SettingsRequest request;
  request.rotation_wxyz = {std::cos(0.2), 0, 0, std::sin(0.2)};
  EXPECT_THAT(error_of(request).what, HasSubstr("cannot be confirmed"));
  EXPECT_FALSE(error_of(request).remedy.empty());
  EXPECT_EQ(loop_->parameters().rotation_target.z(), 0);
  // a stop needs no consent
  live_->emergency_stop({3, false});
  stopped();
}

// while stopped, only changes that could increase the force later need consent
TEST_F(Viewed, WhileItIsStoppedOnlyMoreNeedsConsent) {
  start(false);
  live_->emergency_stop({3, false});
  stopped();
  EXPECT_FALSE(live_->state().armed);
  SettingsRequest request;
  request.rotation_wxyz = {std::cos(0.2), 0, 0, std::sin(0.2)};
  request.max_force_N = 2;
  request.friction = false;
  request.paused = true;
  EXPECT_EQ(*live_->set(request), RequestOutcome::kDone);
  EXPECT_EQ(live_->state().max_force_N, 2);
  const auto wants = [&](const auto& set) {
    SettingsRequest more;
    set(more);
    return *live_->set(more);
  };
  EXPECT_EQ(wants([](auto& r) { r.max_force_N = 2.5; }), RequestOutcome::kAwaitingConsent);
  EXPECT_EQ(wants([](auto& r) { r.friction = true; }), RequestOutcome::kAwaitingConsent);
  EXPECT_EQ(wants([](auto& r) { r.paused = false; }), RequestOutcome::kAwaitingConsent);
  TissueRequest stiffer;
  stiffer.changes[&ContactProperties::stiffness_N_per_mm] = 1.6;
  EXPECT_EQ(*live_->set(stiffer), RequestOutcome::kAwaitingConsent);
  stiffer.changes[&ContactProperties::stiffness_N_per_mm] = 1.4;
  EXPECT_EQ(*live_->set(stiffer), RequestOutcome::kDone);
  EXPECT_EQ(live_->state().max_force_N, 2);
}

TEST_F(Viewed, DisconnectedViewerWithdrawsItsRequest) {
  start(false);
  SettingsRequest request;
  request.by = {6, true};
  request.paused = true;
  ASSERT_EQ(*live_->set(request), RequestOutcome::kAwaitingConsent);
  live_->forget(request.by);
  EXPECT_FALSE(live_->question());
  EXPECT_TRUE(live_->read_answers().empty());
}

TEST_F(Viewed, APhysicalDeviceIsArmedWhereItIs) {
  start(false);
  live_->emergency_stop({3, false});
  const std::uint32_t stop = stopped();
  EXPECT_THAT(error_in(live_->rearm({stop, {4, true}})).what, HasSubstr("at the device"));
  EXPECT_EQ(live_->state().stop, stop);
  // a code that was never displayed is invalid
  EXPECT_EQ(error_in(live_->rearm({stop, {4, true}, "000000"})).where, "code");
  EXPECT_EQ(live_->state().stop, stop);
  EXPECT_EQ(error_in(live_->rearm_by_key(stop)).what, "no error");
  EXPECT_TRUE(soon([&] { return (latest().switches & kSwitchEmergencyStop) == 0; }));
  EXPECT_TRUE(live_->state().armed);
  EXPECT_EQ(error_in(live_->claim_pointer(true, {1, true})).kind, ErrorKind::kUsage);
}

TEST_F(Viewed, ACodeThatIsShownThereArmsAPhysicalDeviceOnce) {
  start(false);
  EXPECT_EQ(live_->arming_code(), "") << "nothing is stopped";
  live_->emergency_stop({3, false});
  std::uint32_t stop = stopped();
  const std::string code = live_->arming_code();
  ASSERT_EQ(code.size(), 6u);
  EXPECT_EQ(error_in(live_->rearm({stop, {4, true}, code})).what, "no error");
  EXPECT_TRUE(soon([&] { return (latest().switches & kSwitchEmergencyStop) == 0; }));
  EXPECT_EQ(live_->arming_code(), "");
  live_->emergency_stop({3, false});
  stop = stopped();
  EXPECT_EQ(error_in(live_->rearm({stop, {4, true}, code})).where, "code") << "of the stop before";
  EXPECT_EQ(live_->state().stop, stop);
  const std::string next = live_->arming_code();
  EXPECT_EQ(error_in(live_->rearm({stop - 1, {4, true}, next})).where, "code") << "of another stop";
  EXPECT_EQ(error_in(live_->rearm({stop, {4, true}, live_->arming_code()})).what, "no error");
}

}  // namespace
}  // namespace palpate
