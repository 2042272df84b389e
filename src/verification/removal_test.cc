#include "verification/removal.h"

#include <gtest/gtest.h>

#include <atomic>

namespace palpate {
namespace {

TEST(RemovalFigures, KeepTheirLimits) {
  const auto figures = removal_figures({});
  ASSERT_TRUE(figures.ok());
  EXPECT_EQ(figures->size(), 10);
  for (const Figure& figure : *figures) {
    ASSERT_TRUE(figure.limit.has_value()) << figure.name;
    EXPECT_TRUE(figure.ok()) << figure.name << ": " << figure.value << " " << figure.unit << ", limit "
                             << *figure.limit;
  }
}

TEST(RemovalFigures, CanBeInterrupted) {
  const std::atomic<bool> stop = true;
  const auto figures = removal_figures(Progress({}, &stop));
  ASSERT_FALSE(figures.ok());
  EXPECT_EQ(figures.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
