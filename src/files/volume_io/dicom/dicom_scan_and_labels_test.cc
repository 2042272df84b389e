#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <optional>

#include "volume_io/dicom/test_dicom_series.h"

namespace palpate {
namespace {

using test::bytes_of;
using test::Dicom;
using test::DicomImage;
using test::DicomPacking;
using test::kSlices;
using test::mask_of;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

// two echoes of a series in one frame of reference, and objects that may have been made on them
class IdentifyScanAndLabels : public Dicom {
 protected:
  IdentifyScanAndLabels() {
    for (const int echo : {1, 2})
      write_series(
          [&](DicomImage& image, int k) {
            image.modality = "MR";
            image.series = "1.2.3.9753";
            image.echo_time_ms = 10 * echo;
            image.sop_instance = "1.2.4.9753." + std::to_string(10 * echo + k);
            image.texts = {{0x0020, 0x0052, "1.2.5.9753"}};
          },
          DicomPacking::kExplicit, kSlices, "echo" + std::to_string(echo) + "_");
  }
  std::filesystem::path write(const test::DicomMasks& made_on, const std::string& name = "seg") {
    test::DicomMasks masks = made_on;
    masks.frames = {{1, {-10, 20, -30}, mask_of(1)}, {1, {-10, 20, -28.75}, mask_of(2)}};
    test::write_masks(elsewhere_ / name, masks);
    return elsewhere_ / name;
  }
  Result<Study> study(const test::DicomMasks& made_on, std::optional<int> volume = {}) {
    auto found = find_study(folder_.path(), write(made_on), volume);
    for (const std::string& note : found ? found->notes : std::vector<std::string>{found.error().message()})
      EXPECT_THAT(note, Not(HasSubstr("9753"))) << "identifiers are not shown";
    return found;
  }
  const test::TemporaryFolder elsewhere_;
};

TEST_F(IdentifyScanAndLabels, TheVolumeThatASegmentationWasMadeOnIsFound) {
  test::DicomMasks masks;
  masks.series = "1.2.3.9753";
  masks.images = {"1.2.4.9753.20", "1.2.4.9753.21"};
  const auto images = study(masks);
  ASSERT_TRUE(images) << images.error().message();
  EXPECT_EQ(images->volume, 2);
  EXPECT_THAT(images->notes, ::testing::ElementsAre(AllOf(HasSubstr((elsewhere_ / "seg").string()),
                                                          HasSubstr("was made on volume 2 (series 1: MR"))));
  // the series alone matches both
  masks.images.clear();
  const auto series = study(masks);
  ASSERT_FALSE(series);
  EXPECT_EQ(series.error().where, (elsewhere_ / "seg").string());
  EXPECT_THAT(series.error().what, HasSubstr("belongs to 2 volumes equally: 1) series 1"));
  const auto requested = study(masks, 2);
  ASSERT_TRUE(requested) << requested.error().message();
  EXPECT_EQ(requested->volume, 2);
}

TEST_F(IdentifyScanAndLabels, AnotherFrameOfReferenceIsRefusedUnlessAVolumeIsAskedFor) {
  test::DicomMasks masks;
  masks.frame_of_reference = "1.2.6.9753";
  const auto other = study(masks);
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().what, HasSubstr("was not made on these images"));
  const auto requested = study(masks, 1);
  ASSERT_TRUE(requested);
  EXPECT_THAT(requested->notes,
              ::testing::ElementsAre(HasSubstr("in a different frame of reference from volume 1")));
  // the same frame of reference, and none
  masks.frame_of_reference = "1.2.5.9753";
  EXPECT_THAT(study(masks, 1)->notes,
              ::testing::ElementsAre(HasSubstr("lies in the frame of reference of volume 1")));
  masks.frame_of_reference.clear();
  EXPECT_THAT(study(masks, 1)->notes, ::testing::ElementsAre(HasSubstr("was not checked")));
}

TEST_F(IdentifyScanAndLabels, ASegmentationInTheFolderIsFound) {
  EXPECT_FALSE(find_study(folder_.path(), {}, {})->labels);
  test::DicomMasks masks;
  masks.images = {"1.2.4.9753.11"};
  std::filesystem::create_directories(folder_ / "more");
  std::filesystem::copy_file(write(masks), folder_ / "more" / "a");
  const auto found = find_study(folder_.path(), {}, {});
  ASSERT_TRUE(found) << found.error().message();
  EXPECT_EQ(found->labels, folder_ / "more" / "a");
  EXPECT_EQ(found->volume, 1);
  // several files of one series in a folder of their own are one segmentation
  std::filesystem::copy_file(elsewhere_ / "seg", folder_ / "more" / "b");
  const auto spread = find_study(folder_.path(), {}, {});
  ASSERT_TRUE(spread) << spread.error().message();
  EXPECT_EQ(spread->labels, folder_ / "more");
  EXPECT_EQ(spread->volume, 1);
  // files of several series may be different readings
  masks.own_series = "1.2.33";
  std::filesystem::copy_file(write(masks), folder_ / "more" / "c");
  const auto readings = find_study(folder_.path(), {}, {});
  ASSERT_FALSE(readings);
  EXPECT_THAT(readings.error().what, HasSubstr("holds 3 segmentations of 2 series"));
  EXPECT_THAT(readings.error().remedy, HasSubstr("this folder to read all of them as one"));
  const auto requested = find_study(folder_.path(), folder_ / "more", {});
  ASSERT_TRUE(requested) << requested.error().message();
  EXPECT_EQ(requested->volume, 1);
  // and so may files among the images
  std::filesystem::rename(folder_ / "more" / "c", folder_ / "c");
  const auto several = find_study(folder_.path(), {}, {});
  ASSERT_FALSE(several);
  EXPECT_THAT(several.error().what,
              AllOf(HasSubstr("holds 3 segmentations"), HasSubstr((folder_ / "more" / "b").string())));
}

TEST_F(IdentifyScanAndLabels, NonDicomFilesAreNotScannedForIdentifiers) {
  const auto seg = write({});
  ASSERT_TRUE(write_volume(elsewhere_ / "scan.nrrd", read(1)->scan));
  const auto beside = find_study(elsewhere_ / "scan.nrrd", seg, {});
  ASSERT_TRUE(beside);
  EXPECT_THAT(beside->notes, ::testing::ElementsAre(HasSubstr("was not checked")));
  const auto labels = find_study(folder_.path(), elsewhere_ / "labels.nii.gz", 1);
  ASSERT_TRUE(labels);
  EXPECT_THAT(labels->notes, IsEmpty());
  EXPECT_EQ(labels->volume, 1);
}

TEST_F(IdentifyScanAndLabels, DamagedSegmentationsAreRefusedByAMessage) {
  const auto seg = write({});
  const std::string whole = bytes_of(seg);
  for (std::size_t length = 140; length < whole.size(); length += 97) {
    std::ofstream(seg, std::ios::binary) << whole.substr(0, length);
    const auto found = find_study(folder_.path(), seg, 1);
    if (found) continue;
    EXPECT_EQ(found.error().where, seg.string()) << length;
  }
}

TEST(SharedSegmentations, BelongToTheirImages) {
  for (const auto& [images, labels] :
       {std::pair{"dicom_seg/23x38x3/image", "dicom_seg/23x38x3/seg/label.seg"},
        {"dicom_seg/24x38x3/image", "dicom_seg/24x38x3/seg/label.seg"},
        {"dicom_seg/ct-3slice", "dicom_seg/liver.dcm"}}) {
    SCOPED_TRACE(labels);
    PALPATE_SHARED_FILE(scan, images);
    PALPATE_SHARED_FILE(seg, labels);
    const auto found = find_study(scan, seg, {});
    ASSERT_TRUE(found) << found.error().message();
    EXPECT_EQ(found->volume, 1);
    EXPECT_THAT(found->notes, ::testing::ElementsAre(HasSubstr("was made on")));
  }
}

}  // namespace
}  // namespace palpate
