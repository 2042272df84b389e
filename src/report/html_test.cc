#include "report/html.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace palpate::report {
namespace {

TEST(Escape, MarkupBecomesText) {
  EXPECT_EQ(escape("<b onload=\"x('&')\">"), "&lt;b onload=&quot;x(&#39;&amp;&#39;)&quot;&gt;");
  EXPECT_EQ(escape(std::string_view("a\0b\x1b\x7f\n\tc", 8)), "a b  \n\tc");
  EXPECT_EQ(escape("genou (gauche) \u00e9"), "genou (gauche) \u00e9");
}

TEST(JsonString, CannotLeaveAScriptElement) {
  EXPECT_EQ(json_string("</script><!--\"\\\n"), "\"\\u003c/script\\u003e\\u003c!--\\u0022\\u005c\\u000a\"");
  EXPECT_EQ(json_string("knee \u00e9"), "\"knee \u00e9\"");
}

TEST(Numbers, AreShortAndNeverNegativeZero) {
  EXPECT_EQ(number(1.005, 1), "1.0");
  EXPECT_EQ(number(-0.04, 1), "0.0");
  EXPECT_EQ(number(-0.06, 1), "-0.1");
  EXPECT_EQ(number(2.5, 0), "2");  // to even, as IEEE 754
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
  EXPECT_EQ(css_colour({1, 160, 255}), "#01a0ff");
}

TEST(Numbers, DepthsInFrontOfTheSurfaceAreExplained) {
  EXPECT_EQ(depth_text(0.625), "0.62 mm");
  EXPECT_EQ(depth_text(-0.634), "-0.63 mm, 0.63 mm in front of the segmented surface");
  EXPECT_EQ(depth_text(-0.001), "0.00 mm");
  EXPECT_EQ(depth_text(std::numeric_limits<double>::quiet_NaN()), "not measured");
}

TEST(Base64, MatchesRfc4648) {
  const auto encode = [](std::string_view text) {
    return base64({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  };
  EXPECT_EQ(encode(""), "");
  EXPECT_EQ(encode("f"), "Zg==");
  EXPECT_EQ(encode("fo"), "Zm8=");
  EXPECT_EQ(encode("foo"), "Zm9v");
  EXPECT_EQ(encode("foobar"), "Zm9vYmFy");
  EXPECT_EQ(encode("\xfb\xff\xbf"), "+/+/");
}

TEST(CspHash, IsBase64OfTheHash) {
  // of the empty text
  EXPECT_EQ(csp_hash("e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"),
            "'sha256-47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU='");
}

}  // namespace
}  // namespace palpate::report
