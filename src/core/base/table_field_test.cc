#include "palpate/base/table_field.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

TEST(TableField, FormulaTextIsQuoted) {
  for (const std::string text : {"=cmd|' /C calc'!A0", "+1", "-1+1", "@SUM(A1)", "\t=1", "\r=1", "\n=1"})
    for (const std::string& field : {csv_field(text), tsv_field(text)}) {
      SCOPED_TRACE(text);
      EXPECT_EQ(field.front() == '"' ? field[1] : field[0], '\'');
    }
  for (const std::string text : {"", "case 7", "a=b", "é"}) {
    EXPECT_EQ(csv_field(text), text);
    EXPECT_EQ(tsv_field(text), text);
  }
}

TEST(TableField, SeparatorsAndQuotesAreEscaped) {
  EXPECT_EQ(csv_field("a,\"b\"\n"), "\"a,\"\"b\"\"\n\"");
  EXPECT_EQ(tsv_field("a\tb\n"), "a\\u0009b\\u000a");
}

}  // namespace
}  // namespace palpate
