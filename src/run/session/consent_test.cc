#include "session/consent.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace palpate {
namespace {

using ::testing::HasSubstr;
using std::chrono_literals::operator""s;

// questions on a simulated clock
struct Asked {
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

TEST(Consent, NothingIsDoneBeforeSomebodyAgrees) {
  Asked asked;
  EXPECT_EQ(asked.shown(), "");
  asked.ask(3, 7, "turn the object by 20 degrees");
  EXPECT_EQ(asked.shown(), "viewer 3 wants to turn the object by 20 degrees");
  EXPECT_EQ(asked.granted, 0);
  EXPECT_TRUE(asked.consent.take_answers(asked.now).empty());
  asked.consent.answer(asked.number(), true, asked.now);
  EXPECT_EQ(asked.granted, 1);
  const auto answers = asked.consent.take_answers(asked.now);
  ASSERT_EQ(answers.size(), 1u);
  EXPECT_EQ(answers[0].by.number, 3u);
  EXPECT_EQ(answers[0].id, 7);
  EXPECT_TRUE(answers[0].outcome.ok());
  EXPECT_EQ(asked.shown(), "");
  EXPECT_TRUE(asked.consent.take_answers(asked.now).empty()) << "each once";
}

TEST(Consent, DecliningAndSilenceAreToldInWords) {
  Asked asked;
  asked.ask(1, 5, "pause the force");
  asked.consent.answer(asked.number(), false, asked.now);
  asked.ask(2, 6, "resume the force");
  asked.now += Consent::kPatience - 1s;
  EXPECT_NE(asked.shown(), "");
  const std::uint64_t last = asked.number();
  asked.now += 1s;
  EXPECT_EQ(asked.shown(), "");
  asked.consent.answer(last, true, asked.now);
  const auto answers = asked.consent.take_answers(asked.now);
  ASSERT_EQ(answers.size(), 2u);
  EXPECT_THAT(answers[0].outcome.error().what, HasSubstr("declined at the terminal of palpate"));
  EXPECT_THAT(answers[1].outcome.error().what, HasSubstr("was not accepted at the terminal"));
  EXPECT_EQ(asked.granted, 0);
}

// a key press answers the question displayed at that moment
TEST(Consent, AnAnswerIsToWhatWasShown) {
  Asked asked;
  asked.ask(1, 5, "turn the object by 3 degrees");
  const std::uint64_t shown = asked.number();
  asked.ask(1, 6, "turn the object by 80 degrees");
  asked.consent.answer(shown, true, asked.now);
  EXPECT_EQ(asked.granted, 0);
  EXPECT_EQ(asked.shown(), "viewer 1 wants to turn the object by 80 degrees");
  const auto answers = asked.consent.take_answers(asked.now);
  ASSERT_EQ(answers.size(), 1u);
  EXPECT_EQ(answers[0].id, 5);
  EXPECT_THAT(answers[0].outcome.error().what, HasSubstr("was replaced by another one"));
  asked.consent.answer(0, true, asked.now);
  asked.consent.answer(asked.number() + 1, true, asked.now);
  EXPECT_EQ(asked.granted, 0) << "no such question";
}

// repeated requests of one viewer do not delay the others
TEST(Consent, EachViewerHasOnePlaceInTheOrderOfTheFirstQuestion) {
  Asked asked;
  asked.ask(1, 1, "one");
  asked.ask(2, 1, "two");
  asked.ask(1, 2, "one again");
  EXPECT_THAT(asked.shown(), HasSubstr("one again"));
  asked.consent.answer(asked.number(), true, asked.now);
  asked.ask(1, 3, "one more");
  EXPECT_THAT(asked.shown(), HasSubstr("two"));
  asked.consent.forget({2, true});
  EXPECT_THAT(asked.shown(), HasSubstr("one more"));
  asked.consent.forget({1, true});
  EXPECT_EQ(asked.shown(), "");
  EXPECT_EQ(asked.granted, 1);
}

TEST(Consent, WhatCannotBeGrantedAnyMoreIsRefused) {
  Consent consent;
  consent.ask({4, true}, 9, "use the method trilinear", []() -> Result<void> {
    return Error{ErrorKind::kUsage, "it has changed meanwhile", "method", ""};
  });
  consent.answer(consent.question()->number, true);
  const auto answers = consent.take_answers();
  ASSERT_EQ(answers.size(), 1u);
  EXPECT_EQ(answers[0].outcome.error().where, "method");
}

}  // namespace
}  // namespace palpate
