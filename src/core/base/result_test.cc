#include "palpate/base/result.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <stdexcept>
#include <system_error>

#include "palpate/base/reason.h"

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

TEST(Result, SupportsMoveOnlyValues) {
  Result<std::unique_ptr<int>> result = std::make_unique<int>(7);
  const std::unique_ptr<int> used = std::move(result).value();
  EXPECT_EQ(*used, 7);
}

TEST(ResultDeathTest, AccessToTheInactiveAlternativeAborts) {
  const Result<int> error = Error{};
  EXPECT_DEATH((void)error.value(), "bug: check 'ok\\(\\)' failed");
  const Result<void> success;
  EXPECT_DEATH((void)success.error(), "bug: check '!ok\\(\\)' failed");
}

TEST(ReasonOf, OmitsTheFileName) {
  const std::error_code failed = std::make_error_code(std::errc::no_such_file_or_directory);
  EXPECT_EQ(reason_of(std::filesystem::filesystem_error("cannot open", "/home/DOE^CANARY", failed)),
            failed.message());
  EXPECT_EQ(reason_of(std::runtime_error("out of luck")), "out of luck");
}

}  // namespace
}  // namespace palpate
