#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "volume_io/dicom/test_dicom_series.h"

namespace palpate {
namespace {

using test::Dicom;
using test::DicomImage;
using test::DicomPacking;
using test::kSlices;
using test::slice;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST_F(Dicom, TwoEchoesAreTwoVolumes) {
  for (const int echo : {1, 2})
    write_series(
        [&](DicomImage& image, int k) {
          image.modality = "MR";
          image.echo_time_ms = 10 * echo;
          image.frames[0].stored.assign(48, static_cast<std::uint16_t>(100 * echo + k));
        },
        DicomPacking::kExplicit, kSlices, "echo" + std::to_string(echo) + "_");
  EXPECT_THAT(refusal(), AllOf(HasSubstr("holds 2 volumes"), HasSubstr("1) series 1: MR, axial, 8 x 6 x 5"),
                               HasSubstr("echo time 10 ms"), HasSubstr("echo time 20 ms")));
  for (const int number : {1, 2}) {
    const auto scan = read(number);
    ASSERT_TRUE(scan) << scan.error().message();
    EXPECT_EQ(scan->scan.at(3, 3, 4), static_cast<float>(100 * number + 4));
  }
  EXPECT_THAT(refusal(3), HasSubstr("has no volume 3"));
}

TEST_F(Dicom, TimesOfAHeartAreVolumes) {
  // trigger times vary from position to position, and file names carry no information
  for (int k = 0; k < kSlices; ++k)
    for (int time = 0; time < 3; ++time) {
      DicomImage image = slice(k);
      image.modality = "MR";
      image.trigger_time_ms = 33.3 * time + k * time;
      image.frames[0].stored.assign(48, static_cast<std::uint16_t>(100 * time + k));
      test::write_dicom(folder_ / std::to_string((7 * (3 * k + time)) % 15), image);
    }
  EXPECT_THAT(refusal(), AllOf(HasSubstr("holds 3 volumes"), HasSubstr("trigger time 0 ms"),
                               HasSubstr("trigger time 33.3 ms"), HasSubstr("trigger time 66.6 ms")));
  for (int time = 0; time < 3; ++time) {
    const auto scan = read(time + 1);
    ASSERT_TRUE(scan) << scan.error().message();
    for (int k = 0; k < kSlices; ++k) EXPECT_EQ(scan->scan.at(3, 3, k), static_cast<float>(100 * time + k));
  }
}

TEST_F(Dicom, TriggerTimesOfASingleVolumeDivideNothing) {
  write_series([](DicomImage& image, int k) {
    image.modality = "MR";
    image.trigger_time_ms = 17.5 * k;
    image.acquisition = k;
  });
  expect_voxels();
}

TEST_F(Dicom, TimesOfAHeartInOneFile) {
  DicomImage image = slice(0);
  image.multi_frame = true;
  image.frames.clear();
  for (int time = 1; time >= 0; --time)
    for (int k = 0; k < kSlices; ++k) {
      image.frames.push_back(slice(k).frames[0]);
      image.frames.back().trigger_time_ms = 40.0 * time;
      image.frames.back().stored.assign(48, static_cast<std::uint16_t>(100 * time + k));
    }
  test::write_dicom(folder_ / "all", image);
  EXPECT_THAT(refusal(), HasSubstr("holds 2 volumes"));
  EXPECT_EQ(read(2)->scan.at(1, 1, 4), 104);
}

TEST_F(Dicom, AcquisitionsAtTheSamePlacesAreVolumes) {
  for (const int number : {4, 9})
    write_series(
        [&](DicomImage& image, int k) {
          image.acquisition = number;
          image.frames[0].stored.assign(48, static_cast<std::uint16_t>(100 * number + k));
        },
        DicomPacking::kExplicit, kSlices - (number == 9), "a" + std::to_string(number) + "_");
  EXPECT_THAT(refusal(), AllOf(HasSubstr("8 x 6 x 5"), HasSubstr("acquisition 4"), HasSubstr("8 x 6 x 4"),
                               HasSubstr("acquisition 9")));
  EXPECT_EQ(read(2)->scan.at(0, 0, 3), 903);
}

TEST_F(Dicom, DirectionsOfDiffusionAreVolumes) {
  const double s = std::sqrt(0.5);
  const std::array<std::array<double, 3>, 3> gradients{{{1, 0, 0}, {-1, 0, 0}, {0, s, s}}};
  for (std::size_t n = 0; n < gradients.size(); ++n)
    write_series(
        [&](DicomImage& image, int k) {
          image.modality = "MR";
          image.b_value = 1000;
          image.gradient = gradients[n];
          (*image.gradient)[2] += 1e-5 * k;
          image.frames[0].stored.assign(48, static_cast<std::uint16_t>(100 * n));
        },
        DicomPacking::kExplicit, kSlices, "g" + std::to_string(n) + "_");
  EXPECT_THAT(refusal(), AllOf(HasSubstr("holds 3 volumes"), HasSubstr("diffusion along (1.00, 0.00, 0.00)"),
                               HasSubstr("diffusion along (-1.00, 0.00, 0.00)"),
                               HasSubstr("diffusion along (0.00, 0.71, 0.71)")));
  EXPECT_EQ(read(3)->scan.at(2, 2, 2), 200);
}

TEST_F(Dicom, IgnoresLocalizers) {
  write_series();
  DicomImage localizer = slice(0);
  localizer.series += ".7";
  localizer.orientation = {0, 1, 0, 0, 0, -1};
  localizer.image_type = "ORIGINAL\\PRIMARY\\LOCALIZER";
  test::write_dicom(folder_ / "localizer", localizer);
  expect_voxels();
  const auto list = list_volumes(folder_.path());
  ASSERT_TRUE(list) << list.error().message();
  ASSERT_EQ(list->volumes.size(), 2u);
  EXPECT_THAT(list->volumes[0].what, HasSubstr("series 1: CT, axial, 8 x 6 x 5, 0.5 x 0.7 x 1.25 mm"));
  EXPECT_THAT(list->volumes[0].fault, IsEmpty());
  EXPECT_THAT(list->volumes[1].what, AllOf(HasSubstr("sagittal"), HasSubstr("localizer")));
  EXPECT_THAT(list->volumes[1].fault, HasSubstr("single slice"));
  EXPECT_THAT(refusal(2), HasSubstr("volume 2 cannot be used"));
}

TEST_F(Dicom, SplitsVolumesByAttributes) {
  const auto volumes = [&] {
    const auto list = list_volumes(folder_.path());
    return list ? list->volumes.size() : 0;
  };
  write_series();
  EXPECT_EQ(volumes(), 1u);
  const auto add = [&](const std::string& name, const auto& change) {
    write_series([&](DicomImage& image, int) { change(image); }, DicomPacking::kExplicit, 2, name);
  };
  add("b", [](DicomImage& image) { image.b_value = 1000; });
  EXPECT_EQ(volumes(), 2u);
  add("type", [](DicomImage& image) { image.image_type = "DERIVED\\PRIMARY\\MPR"; });
  EXPECT_EQ(volumes(), 3u);
  add("spacing", [](DicomImage& image) { image.spacing_mm = {{0.8, 0.5}}; });
  EXPECT_EQ(volumes(), 4u);
  add("size", [](DicomImage& image) {
    image.rows = 4;
    image.frames[0].stored.resize(32);
  });
  EXPECT_EQ(volumes(), 5u);
  add("series", [](DicomImage& image) { image.series += ".2"; });
  EXPECT_EQ(volumes(), 6u);
}

}  // namespace
}  // namespace palpate
