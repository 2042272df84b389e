#include "volume_io/dicom/dicom_study.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace palpate::volume_io {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

// volume of two files, in a series and a frame of reference
DicomVolume volume_of_files(std::uint32_t first_file, int series, const std::string& space) {
  DicomVolume volume;
  for (std::uint32_t n = 0; n < 2; ++n) {
    DicomFrame& frame = volume.frames.emplace_back();
    frame.file = first_file + n;
    frame.series = series;
    frame.frame_of_reference = space;
  }
  volume.what = "series " + std::to_string(series + 1);
  return volume;
}

const DicomIdentifiers kIdentifiers{{"s0", "s1"}, {"i0", "i1", "i2", "i3", "i4", "i5"}};

// two echoes of a series, and another series with its own frame of reference
std::vector<DicomVolume> study() {
  return {volume_of_files(0, 0, "f0"), volume_of_files(2, 0, "f0"), volume_of_files(4, 1, "f1")};
}

TEST(DicomStudy, TheClosestBondCounts) {
  const auto bonds = [](const DicomReference& reference) {
    return relations_of(reference, study(), kIdentifiers);
  };
  EXPECT_THAT(bonds({{"s0"}, {"i3"}, {"f0"}}),
              ElementsAre(VolumeRelation::kSeries, VolumeRelation::kImages, VolumeRelation::kNone));
  EXPECT_THAT(bonds({{"s0"}, {}, {"f0"}}),
              ElementsAre(VolumeRelation::kSeries, VolumeRelation::kSeries, VolumeRelation::kNone));
  EXPECT_THAT(bonds({{}, {}, {"f1"}}),
              ElementsAre(VolumeRelation::kNone, VolumeRelation::kNone, VolumeRelation::kSpace));
  EXPECT_THAT(bonds({{}, {}, {}}), ElementsAre(VolumeRelation::kUnspecified, VolumeRelation::kUnspecified,
                                               VolumeRelation::kUnspecified));
  // references to another study
  EXPECT_THAT(bonds({{"s9"}, {"i9"}, {"f9"}}),
              ElementsAre(VolumeRelation::kNone, VolumeRelation::kNone, VolumeRelation::kNone));
}

TEST(DicomStudy, TheVolumeThatItWasMadeOnIsChosen) {
  const auto chosen = choose_segmented(
      study(), {VolumeRelation::kSeries, VolumeRelation::kImages, VolumeRelation::kNone}, {});
  ASSERT_TRUE(chosen);
  EXPECT_EQ(chosen->index, 1u);
  EXPECT_THAT(chosen->notes, ElementsAre("was made on volume 2 (series 1)"));
  EXPECT_TRUE(chosen->is_declared);
  const auto space =
      choose_segmented(study(), {VolumeRelation::kNone, VolumeRelation::kNone, VolumeRelation::kSpace}, {});
  ASSERT_TRUE(space);
  EXPECT_EQ(space->index, 2u);
  EXPECT_THAT(space->notes, ElementsAre(HasSubstr("it does not state the images")));
  EXPECT_TRUE(space->is_declared);
}

TEST(DicomStudy, ReportsMissingReferences) {
  auto volumes = study();
  volumes.resize(1);
  const auto unsaid = choose_segmented(volumes, {VolumeRelation::kUnspecified}, {});
  ASSERT_TRUE(unsaid);
  EXPECT_FALSE(unsaid->is_declared);
  EXPECT_THAT(unsaid->notes, ElementsAre(HasSubstr("was not checked")));
}

TEST(DicomStudy, AmbiguousStudiesAreErrors) {
  const auto alike = choose_segmented(
      study(), {VolumeRelation::kSeries, VolumeRelation::kSeries, VolumeRelation::kNone}, {});
  ASSERT_FALSE(alike);
  EXPECT_THAT(alike.error().what, HasSubstr("belongs to 2 volumes equally: 1) series 1; 2) series 1"));
  const auto other =
      choose_segmented(study(), {VolumeRelation::kNone, VolumeRelation::kNone, VolumeRelation::kNone}, {});
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().what, HasSubstr("was not made on these images"));
  // only one of several equally related volumes can be used
  auto volumes = study();
  volumes[0].fault = "a slice is missing";
  const auto usable = choose_segmented(
      volumes, {VolumeRelation::kSeries, VolumeRelation::kSeries, VolumeRelation::kNone}, {});
  ASSERT_TRUE(usable);
  EXPECT_EQ(usable->index, 1u);
  // the volume on which it was made cannot be used
  const auto broken = choose_segmented(
      volumes, {VolumeRelation::kImages, VolumeRelation::kSeries, VolumeRelation::kNone}, {});
  ASSERT_FALSE(broken);
  EXPECT_THAT(broken.error().what,
              HasSubstr("volume 1 (series 1), which cannot be used: a slice is missing"));
}

TEST(DicomStudy, VolumeNumberOverridesReferencesWithANote) {
  const auto chosen =
      choose_segmented(study(), {VolumeRelation::kSeries, VolumeRelation::kImages, VolumeRelation::kNone}, 3);
  ASSERT_TRUE(chosen);
  EXPECT_EQ(chosen->index, 2u);
  EXPECT_THAT(chosen->notes,
              ElementsAre(AllOf(HasSubstr("made on volume 2"), HasSubstr("volume 3 was requested")),
                          HasSubstr("a different frame of reference from volume 3")));
  EXPECT_FALSE(chosen->is_declared);
  const auto closest =
      choose_segmented(study(), {VolumeRelation::kSeries, VolumeRelation::kImages, VolumeRelation::kNone}, 2);
  EXPECT_THAT(closest->notes, ElementsAre("was made on volume 2 (series 1)"));
  EXPECT_FALSE(choose_segmented(
      study(), {VolumeRelation::kSeries, VolumeRelation::kImages, VolumeRelation::kNone}, 4));
}

}  // namespace
}  // namespace palpate::volume_io
