#include "palpate/rendering/markup.h"

#include <gtest/gtest.h>

namespace palpate::markup {
namespace {

TEST(Escape, MarkupBecomesText) {
  EXPECT_EQ(escape("<b onload=\"x('&')\">"), "&lt;b onload=&quot;x(&#39;&amp;&#39;)&quot;&gt;");
  EXPECT_EQ(escape(std::string_view("a\0b\x1b\x7f\n\tc", 8)), "a\\u0000b\\u001b\\u007f\n\tc");
  EXPECT_EQ(escape("\u202e<\x9b"), "\\u202e&lt;\\x9b");
  EXPECT_EQ(escape("genou (gauche) \u00e9"), "genou (gauche) \u00e9");
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

TEST(Colour, IsOfSixDigits) {
  EXPECT_EQ(css_colour({1, 160, 255}), "#01a0ff");
}

TEST(SideMark, NeverGuesses) {
  EXPECT_EQ(side_text(Side::kLeft), "LEFT");
  EXPECT_EQ(side_text(Side::kRight), "RIGHT");
  EXPECT_EQ(side_text(Side::kUnknown), "SIDE UNKNOWN");
  EXPECT_EQ(side_text(Side::kBoth), "");
  EXPECT_EQ(side_mark(Side::kLeft, true), "Side: LEFT");
  EXPECT_EQ(side_mark(Side::kUnknown, true), "SIDE UNKNOWN");
  EXPECT_EQ(side_mark(Side::kBoth, true), "");
  EXPECT_EQ(side_mark(Side::kRight, false), "ORIENTATION UNKNOWN");
}

TEST(DoubtMarks, AreOfPlacementAndSideAlone) {
  Model model;
  model.caveats = {{CaveatKind::kForce, "two tissues are felt as one"}};
  EXPECT_TRUE(doubt_marks(model).empty());
  model.caveats.push_back({CaveatKind::kSide, "a left leg"});
  model.caveats.push_back({CaveatKind::kPlacement, "half of the labels lie outside"});
  model.caveats.push_back({CaveatKind::kPlacement, "two forms"});
  EXPECT_EQ(doubt_marks(model), (std::vector<std::string>{"PLACEMENT IN DOUBT", "SIDE IN DOUBT"}));
}

}  // namespace
}  // namespace palpate::markup
