#include "volume_io/segment_fields.h"

#include <gtest/gtest.h>

#include "palpate/volume_io/volume_io.h"

namespace palpate {
namespace {

using Fields = std::vector<std::pair<std::string, std::string>>;

TEST(SegmentFields, ReadsWhatSlicerWrites) {
  const Fields fields{{"Segment0_Color", "0.501961 0.682353 0.501961"},
                      {"Segment0_Extent", "0 511 0 511 0 118"},
                      {"Segment0_ID", "Segment_1"},
                      {"Segment0_LabelValue", "3"},
                      {"Segment0_Layer", "0"},
                      {"Segment0_Name", "femoral cartilage"},
                      {"Segment0_Tags", "Segmentation.Status:inprogress|"},
                      {"Segment1_ID", "tibia"},
                      {"Segment1_LabelValue", "1"},
                      {"Segmentation_MasterRepresentation", "Binary labelmap"},
                      {"Segmenta_Name", "not ours"},
                      {"Segment2_Whatever", "of another program"}};
  const auto segments = parse_segment_fields(fields, 1, "knee.seg.nrrd");
  ASSERT_TRUE(segments) << segments.error().message();
  ASSERT_EQ(segments->size(), 2u);
  EXPECT_EQ((*segments)[0].id, 1);
  EXPECT_EQ((*segments)[0].name, "tibia") << "its ID, without a Name";
  EXPECT_EQ((*segments)[1].id, 3);
  EXPECT_EQ((*segments)[1].value, 3);
  EXPECT_EQ((*segments)[1].name, "femoral cartilage");
  EXPECT_EQ((*segments)[1].colour, (Rgb{128, 174, 128}));
}

TEST(SegmentFields, ValuesThatLayersShareGetIdsOfTheirOwn) {
  const Fields fields{{"Segment0_LabelValue", "1"}, {"Segment0_Layer", "0"}, {"Segment0_Name", "a"},
                      {"Segment1_LabelValue", "1"}, {"Segment1_Layer", "1"}, {"Segment1_Name", "b"},
                      {"Segment2_LabelValue", "2"}, {"Segment2_Layer", "0"}, {"Segment2_Name", "c"},
                      {"Segment3_LabelValue", "2"}, {"Segment3_Layer", "2"}, {"Segment3_Name", "d"}};
  const auto segments = parse_segment_fields(fields, 3, "x");
  ASSERT_TRUE(segments) << segments.error().message();
  ASSERT_EQ(segments->size(), 4u);
  const char* names[] = {"a", "c", "b", "d"};
  for (std::size_t n = 0; n < 4; ++n) {
    EXPECT_EQ((*segments)[n].id, n + 1);
    EXPECT_EQ((*segments)[n].name, names[n]);
  }
}

// 3D Slicer before 4.11: a layer of ones for each segment, nothing said about it
TEST(SegmentFields, WithoutLayersEachSegmentHasItsOwn) {
  const Fields fields{{"Segment0_ID", "a"}, {"Segment1_ID", "b"}};
  const auto segments = parse_segment_fields(fields, 2, "x");
  ASSERT_TRUE(segments) << segments.error().message();
  EXPECT_EQ((*segments)[1].layer, 1);
  EXPECT_EQ((*segments)[1].value, 1);
  EXPECT_FALSE(parse_segment_fields(fields, 1, "x")) << "two segments in one layer need values";
  EXPECT_FALSE(parse_segment_fields({{"Segment5_ID", "a"}}, 2, "x")) << "there is no layer 5";
}

TEST(SegmentFields, FaultsAreErrorsThatNameTheFieldAndTheFile) {
  for (const Fields& fields : {Fields{{"Segment0_LabelValue", "0"}}, Fields{{"Segment0_LabelValue", "65536"}},
                               Fields{{"Segment0_LabelValue", "one"}}, Fields{{"Segment0_Layer", "1"}},
                               Fields{{"Segment0_Layer", "-1"}}, Fields{{"Segment0_Color", "1 2 3"}},
                               Fields{{"Segment0_Color", "nan 0 0"}}, Fields{{"Segment0_Color", "0 0"}},
                               Fields{{"Segment0_Name", "a\nb"}}, Fields{{"Segment0_Name", "\xff"}},
                               Fields{{"Segment0_LabelValue", "1"}, {"Segment1_LabelValue", "1"}}}) {
    const auto segments = parse_segment_fields(fields, 1, "knee.seg.nrrd");
    ASSERT_FALSE(segments) << fields[0].first << " " << fields[0].second;
    EXPECT_EQ(segments.error().where, "knee.seg.nrrd");
    EXPECT_NE(segments.error().what.find("Segment"), std::string::npos);
  }
}

TEST(SegmentFields, NumberingRunsOutInsteadOfWrapping) {
  std::vector<Segment> segments{{0, "", {}, 0, 65535}, {0, "", {}, 1, 65535}};
  EXPECT_FALSE(volume_io::number_segments(segments));
}

}  // namespace
}  // namespace palpate
