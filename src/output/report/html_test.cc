#include "report/html.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace palpate::report {
namespace {

TEST(JsonString, CannotLeaveAScriptElement) {
  EXPECT_EQ(json_string("</script><!--\"\\\n"), "\"\\u003c/script\\u003e\\u003c!--\\u0022\\u005c\\u000a\"");
  EXPECT_EQ(json_string("\u202e\x9b"), "\"\\u005cu202e\\u005cx9b\"") << "spelled out, and read as such";
  EXPECT_EQ(json_string("knee \u00e9"), "\"knee \u00e9\"");
}

TEST(Numbers, AreShortAndNeverNegativeZero) {
  EXPECT_EQ(number(1.005, 1), "1.0");
  EXPECT_EQ(number(-0.04, 1), "0.0");
  EXPECT_EQ(number(-0.06, 1), "-0.1");
  EXPECT_EQ(number(2.5, 0), "2");  // round half to even, as IEEE 754
  EXPECT_EQ(number(std::numeric_limits<double>::quiet_NaN(), 1), "-");
  EXPECT_EQ(number(1e308, 2).size(), 309u + 3u);
  EXPECT_EQ(json_number(1.2000, 4), "1.2");
  EXPECT_EQ(json_number(-0.00001, 4), "0");
  EXPECT_EQ(json_number(100, 0), "100");
  EXPECT_EQ(json_number(1000, 3), "1000");
  EXPECT_EQ(json_number(std::numeric_limits<double>::infinity(), 4), "null");
  EXPECT_EQ(grouped(0), "0");
  EXPECT_EQ(grouped(999), "999");
  EXPECT_EQ(grouped(1234567), "1\u202f234\u202f567");
  EXPECT_EQ(hex(0x0123456789abcdefull), "0123456789abcdef");
}

TEST(Numbers, DepthsInFrontOfTheSurfaceAreExplained) {
  EXPECT_EQ(depth_text(0.625), "0.62 mm");
  EXPECT_EQ(depth_text(-0.634), "-0.63 mm, 0.63 mm in front of the segmented surface");
  EXPECT_EQ(depth_text(-0.001), "0.00 mm");
  EXPECT_EQ(depth_text(std::numeric_limits<double>::quiet_NaN()), "not measured");
}

TEST(CspHash, IsTheBase64Hash) {
  // hash of the empty text
  EXPECT_EQ(csp_hash("e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"),
            "'sha256-47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU='");
}

TEST(ThreeDigits, HasThreeSignificantDigits) {
  EXPECT_EQ(three_digits(0), "0");
  EXPECT_EQ(three_digits(1234), "1230");
  EXPECT_EQ(three_digits(99.96), "100");
  EXPECT_EQ(three_digits(12.34), "12.3");
  EXPECT_EQ(three_digits(9.996), "10.0");
  EXPECT_EQ(three_digits(1), "1.00");
  EXPECT_EQ(three_digits(0.012345), "0.0123");
  EXPECT_EQ(three_digits(-0.5), "-0.500");
  EXPECT_EQ(three_digits(std::numeric_limits<double>::quiet_NaN()), "-");
}

}  // namespace
}  // namespace palpate::report
