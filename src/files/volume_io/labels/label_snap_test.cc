#include <gtest/gtest.h>

#include "palpate/volume_io/label_tables.h"

namespace palpate {
namespace {

TEST(SnapLabels, ReadsItkSnapFiles) {
  const auto labels = parse_snap_labels(
      "################################################\n"
      "# ITK-SnAP Label Description File\r\n"
      "    0     0    0    0        0  0  0    \"Clear Label\"\r\n"
      "    1   255    0  128        1  1  1    \"Left femur\"\n"
      "    9     1    2    3     0.25  1  0    \"hyoid\"",
      "labels.txt");
  ASSERT_TRUE(labels) << labels.error().message();
  ASSERT_EQ(labels->size(), 3u);
  EXPECT_EQ((*labels)[1].value, 1);
  EXPECT_EQ((*labels)[1].name, "Left femur");
  EXPECT_EQ((*labels)[1].colour, (Rgb{255, 0, 128}));
  EXPECT_EQ((*labels)[2].name, "hyoid");
}

TEST(SnapLabels, EveryFaultNamesItsLine) {
  for (const char* bad :
       {"2 1 2 3 1 1 1 femur", "2 1 2 3 1 1 1 \"femur", "2 1 2 3 1 1 \"femur\"", "2 1 2 3 1 1 1 \"",
        "2 1 2 3 1 1 1 \"\"", "x 1 2 3 1 1 1 \"a\"", "65536 1 2 3 1 1 1 \"a\"", "2 256 2 3 1 1 1 \"a\"",
        "1 1 2 3 1 1 1 \"a\"", "2 1 2 3 1 1 1 \"a\x01\"", "2 1 2 3 1 1 1 \"\xff\""}) {
    const auto labels = parse_snap_labels("1 1 2 3 1 1 1 \"tibia\"\n" + std::string(bad) + "\n", "l.label");
    ASSERT_FALSE(labels) << bad;
    EXPECT_EQ(labels.error().where, "l.label:2") << bad;
  }
}

}  // namespace
}  // namespace palpate
