#include "palpate/base/result.h"

#include <gtest/gtest.h>

#include <memory>

namespace palpate {
namespace {

TEST(Result, HoldsAValueOrAnError) {
  const Result<int> value = 3;
  const Result<int> error = Error{ErrorKind::kBadInput, "is odd", "a.nrrd", "make it even"};
  EXPECT_TRUE(value.ok());
  EXPECT_EQ(*value, 3);
  EXPECT_FALSE(error.ok());
  EXPECT_EQ(error.error().message(), "a.nrrd: is odd\n  make it even");
}

TEST(Result, MovesWhatCannotBeCopied) {
  Result<std::unique_ptr<int>> result = std::make_unique<int>(7);
  const std::unique_ptr<int> taken = std::move(result).value();
  EXPECT_EQ(*taken, 7);
}

TEST(ResultDeathTest, ReadingTheSideThatIsNotThereNamesItself) {
  const Result<int> error = Error{};
  EXPECT_DEATH((void)error.value(), "bug: check 'ok\\(\\)' failed");
  const Result<void> success;
  EXPECT_DEATH((void)success.error(), "bug: check '!ok\\(\\)' failed");
}

}  // namespace
}  // namespace palpate
