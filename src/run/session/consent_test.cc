#include "session/consent.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace palpate {
namespace {

using ::testing::HasSubstr;
using std::chrono_literals::operator""s;

// questions on a simulated clock
struct Request {
  Consent consent;
  Consent::Clock::time_point now{};
  int granted = 0;

  void ask(std::uint32_t viewer, std::int64_t id, const std::string& what) {
    consent.ask(
        {viewer, true}, id, what,
        [this]() -> Result<void> {
          ++granted;
          return {};
        },
        now);
  }
  std::string shown() {
    const auto question = consent.question(now);
    return question ? question->text : "";
  }
  std::uint64_t number() { return consent.question(now).value_or(ConsentQuestion{}).number; }
};

TEST(Consent, RequestsWaitForConsent) {
  Request requested;
  EXPECT_EQ(requested.shown(), "");
  requested.ask(3, 7, "turn the object by 20 degrees");
  EXPECT_EQ(requested.shown(), "viewer 3 wants to turn the object by 20 degrees");
  EXPECT_EQ(requested.granted, 0);
  EXPECT_TRUE(requested.consent.read_answers(requested.now).empty());
  requested.consent.answer(requested.number(), true, requested.now);
  EXPECT_EQ(requested.granted, 1);
  const auto answers = requested.consent.read_answers(requested.now);
  ASSERT_EQ(answers.size(), 1u);
  EXPECT_EQ(answers[0].by.number, 3u);
  EXPECT_EQ(answers[0].id, 7);
  EXPECT_TRUE(answers[0].outcome.ok());
  EXPECT_EQ(requested.shown(), "");
  EXPECT_TRUE(requested.consent.read_answers(requested.now).empty()) << "each once";
}

TEST(Consent, DeclinedAndExpiredRequestsAreAnswered) {
  Request requested;
  requested.ask(1, 5, "pause the force");
  requested.consent.answer(requested.number(), false, requested.now);
  requested.ask(2, 6, "resume the force");
  requested.now += Consent::kTimeout - 1s;
  EXPECT_NE(requested.shown(), "");
  const std::uint64_t last = requested.number();
  requested.now += 1s;
  EXPECT_EQ(requested.shown(), "");
  requested.consent.answer(last, true, requested.now);
  const auto answers = requested.consent.read_answers(requested.now);
  ASSERT_EQ(answers.size(), 2u);
  EXPECT_THAT(answers[0].outcome.error().what, HasSubstr("declined at the terminal of palpate"));
  EXPECT_THAT(answers[1].outcome.error().what, HasSubstr("was not accepted at the terminal"));
  EXPECT_EQ(requested.granted, 0);
}

// a key press answers the question displayed at that moment
TEST(Consent, AnswerAppliesToTheDisplayedQuestion) {
  Request requested;
  requested.ask(1, 5, "turn the object by 3 degrees");
  const std::uint64_t shown = requested.number();
  requested.ask(1, 6, "turn the object by 80 degrees");
  requested.consent.answer(shown, true, requested.now);
  EXPECT_EQ(requested.granted, 0);
  EXPECT_EQ(requested.shown(), "viewer 1 wants to turn the object by 80 degrees");
  const auto answers = requested.consent.read_answers(requested.now);
  ASSERT_EQ(answers.size(), 1u);
  EXPECT_EQ(answers[0].id, 5);
  EXPECT_THAT(answers[0].outcome.error().what, HasSubstr("was replaced by another one"));
  requested.consent.answer(0, true, requested.now);
  requested.consent.answer(requested.number() + 1, true, requested.now);
  EXPECT_EQ(requested.granted, 0) << "no such question";
}

// repeated requests of one viewer do not delay the others
TEST(Consent, EachViewerKeepsItsQueuePosition) {
  Request requested;
  requested.ask(1, 1, "one");
  requested.ask(2, 1, "two");
  requested.ask(1, 2, "one again");
  EXPECT_THAT(requested.shown(), HasSubstr("one again"));
  requested.consent.answer(requested.number(), true, requested.now);
  requested.ask(1, 3, "one more");
  EXPECT_THAT(requested.shown(), HasSubstr("two"));
  requested.consent.forget({2, true});
  EXPECT_THAT(requested.shown(), HasSubstr("one more"));
  requested.consent.forget({1, true});
  EXPECT_EQ(requested.shown(), "");
  EXPECT_EQ(requested.granted, 1);
}

TEST(Consent, RevalidatesAtGrant) {
  Consent consent;
  consent.ask({4, true}, 9, "use the method trilinear", []() -> Result<void> {
    return Error{ErrorKind::kUsage, "it has changed meanwhile", "method", ""};
  });
  consent.answer(consent.question()->number, true);
  const auto answers = consent.read_answers();
  ASSERT_EQ(answers.size(), 1u);
  EXPECT_EQ(answers[0].outcome.error().where, "method");
}

}  // namespace
}  // namespace palpate
