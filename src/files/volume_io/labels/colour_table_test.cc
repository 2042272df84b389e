#include <gtest/gtest.h>

#include "palpate/volume_io/label_tables.h"

namespace palpate {
namespace {

TEST(ColourTable, ReadsSlicerFiles) {
  const auto labels = parse_colour_table(
      "# Color table file knee.ctbl\n"
      "# 2 values\r\n"
      "\n"
      "95 femur 197 189 177 255\r\n"
      "  83\tfemoral_cartilage 180 180 255 0",
      "knee.ctbl");
  ASSERT_TRUE(labels) << labels.error().message();
  ASSERT_EQ(labels->size(), 2u);
  EXPECT_EQ((*labels)[0].value, 95);
  EXPECT_EQ((*labels)[0].name, "femur");
  EXPECT_EQ((*labels)[0].colour, (Rgb{197, 189, 177}));
  EXPECT_EQ((*labels)[1].name, "femoral_cartilage") << "underscores are kept";
}

TEST(ColourTable, AnEmptyTableNamesNothing) {
  EXPECT_TRUE(parse_colour_table("", "t")->empty());
  EXPECT_TRUE(parse_colour_table("# nothing\n", "t")->empty());
}

TEST(ColourTable, EveryFaultNamesItsLine) {
  const std::string good = "1 femur 1 2 3 255\n";
  for (const std::string bad : {
           "2 tibia 1 2 3",           // no alpha
           "2 tibia left 1 2 3 255",  // a name of two words
           "x tibia 1 2 3 255",       // not a number
           "-1 tibia 1 2 3 255",      // below the range
           "65536 tibia 1 2 3 255",   // above the range
           "2.0 tibia 1 2 3 255",     // not an integer
           "2 tibia 256 2 3 255",     // colour above the range
           "2 tibia 0.5 2 3 255",     // colour not an integer
           "1 tibia 1 2 3 255",       // named twice
           "2 ti\x01"
           "bia 1 2 3 255",             // control character
           "2 tibia\xff 1 2 3 255",     // not UTF-8
           "2 tibia\xc2\x9b 1 2 3 255"  // two-byte control character
       }) {
    const auto labels = parse_colour_table(good + bad + "\n" + "3 patella 1 2 3 255\n", "knee.ctbl");
    ASSERT_FALSE(labels) << bad;
    EXPECT_EQ(labels.error().where, "knee.ctbl:2") << bad;
    EXPECT_EQ(labels.error().kind, ErrorKind::kBadInput);
  }
}

}  // namespace
}  // namespace palpate
