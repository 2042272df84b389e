#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

#include "volume_io/dicom/test_dicom_series.h"

namespace palpate {
namespace {

using test::bytes_of;
using test::Dicom;
using test::DicomImage;
using test::DicomPacking;
using test::kSlices;
using test::kStep_mm;
using test::slice;
using test::stored_at;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST_F(Dicom, BitsThatAreNotStoredDoNotCount) {
  // 12 bits of 16: the bits above them are unrelated
  write_series([](DicomImage& image, int) {
    image.bits_stored = 12;
    image.high_bit = 11;
    for (std::uint16_t& word : image.frames[0].stored) word |= 0xA000;
  });
  expect_voxels();
  // and bits above if the unused ones are below
  write_series([](DicomImage& image, int) {
    image.bits_stored = 12;
    image.high_bit = 13;
    for (std::uint16_t& word : image.frames[0].stored) word = static_cast<std::uint16_t>(word << 2 | 3);
  });
  expect_voxels();
}

TEST_F(Dicom, SignedValuesWithAScale) {
  write_series([](DicomImage& image, int) {
    image.is_signed = true;
    image.bits_stored = 12;
    image.high_bit = 11;
    image.frames[0].slope = 2;
    image.frames[0].intercept = -1024;
  });
  expect_voxels([](int i, int j, int k) {
    const int stored = stored_at(i, j, k);
    return 2 * (stored < 2048 ? stored : stored - 4096) - 1024;
  });
  EXPECT_EQ(read()->header.component_type, "int16");
}

TEST_F(Dicom, AScaleThatIsNoNumberIsRefused) {
  for (const std::string text : {"1e40", "many"}) {
    write_series([&](DicomImage& image, int k) {
      if (k == 1) image.texts = {{0x0028, 0x1053, text}};
    });
    EXPECT_THAT(refusal(),
                AllOf(HasSubstr("slice 2 of 5"), HasSubstr("RescaleSlope (0028,1053) that is not a number")));
  }
  // an empty attribute has no effect
  write_series([&](DicomImage& image, int) { image.texts = {{0x0028, 0x1053, ""}}; });
  expect_voxels();
}

TEST_F(Dicom, EverySliceHasItsOwnScale) {
  write_series([](DicomImage& image, int k) {
    image.frames[0].slope = 0.5 + k;
    image.frames[0].intercept = -k;
  });
  expect_voxels([](int i, int j, int k) { return (0.5 + k) * stored_at(i, j, k) - k; });
}

TEST_F(Dicom, KeepsValuesOfMonochrome1) {
  // affects only the display (PS3.3 C.7.6.3.1.2), not the values
  write_series([](DicomImage& image, int) { image.photometric = "MONOCHROME1"; });
  expect_voxels();
}

TEST_F(Dicom, PaddingBecomesTheLowestValueWithANote) {
  write_series([](DicomImage& image, int) {
    image.is_signed = true;
    image.padding = -2000;
    for (std::uint16_t& word : image.frames[0].stored)
      word = word % 5 == 0 ? static_cast<std::uint16_t>(-2000) : static_cast<std::uint16_t>(word + 50);
    image.frames[0].slope = 1;
    image.frames[0].intercept = -1000;
  });
  const auto scan = read();
  ASSERT_TRUE(scan) << scan.error().message();
  const auto [low, high] = std::minmax_element(scan->scan.voxels().begin(), scan->scan.voxels().end());
  EXPECT_GE(*low, -950);
  EXPECT_EQ(scan->scan.at(0, 0, 0), *low) << "padding";
  EXPECT_EQ(scan->scan.at(1, 0, 0), 7 + 50 - 1000);
  EXPECT_THAT(warnings_, HasSubstr("are padding outside the scanned region (PixelPaddingValue (0028,0120))"));
}

TEST_F(Dicom, PaddingMayHaveMoreBitsThanAreStored) {
  // 12 bits, and padding of -2000 in all 16: the value of its lowest 12 bits is valid
  constexpr std::uint16_t kPadding = 0xF830, kLow = kPadding & 0xFFF;
  write_series([&](DicomImage& image, int) {
    image.bits_stored = 12;
    image.high_bit = 11;
    image.padding = kPadding;
    image.frames[0].stored[0] = kPadding;
    image.frames[0].stored[1] = kLow;
  });
  const auto scan = read();
  ASSERT_TRUE(scan) << scan.error().message();
  EXPECT_EQ(scan->scan.at(1, 0, 0), kLow);
  EXPECT_EQ(scan->scan.at(0, 0, 0),
            *std::min_element(scan->scan.voxels().begin(), scan->scan.voxels().end()));
  EXPECT_THAT(warnings_, HasSubstr("5 voxels are padding outside the scanned region"));
}

TEST_F(Dicom, FramesOfOneFile) {
  for (const DicomPacking packing :
       {DicomPacking::kExplicit, DicomPacking::kImplicit, DicomPacking::kRle,
        DicomPacking::kJpegLosslessFirstOrder, DicomPacking::kJpegLs, DicomPacking::kJpeg2000Lossless}) {
    SCOPED_TRACE(static_cast<int>(packing));
    DicomImage image = slice(0);
    image.multi_frame = true;
    image.frames.clear();
    for (const int k : {3, 0, 4, 1, 2}) {
      auto& frame = image.frames.emplace_back(slice(k).frames[0]);
      frame.slope = k + 1;
      frame.intercept = -k;
    }
    test::write_dicom(folder_ / "all.dcm", image, packing);
    expect_voxels([](int i, int j, int k) { return (k + 1) * stored_at(i, j, k) - k; });
    const auto alone = read_scan(folder_ / "all.dcm");
    ASSERT_TRUE(alone) << alone.error().message();
    EXPECT_NEAR(alone->scan.geometry().spacing_mm.z(), kStep_mm, 1e-9);
  }
}

TEST_F(Dicom, FramesOfSeveralPieces) {
  DicomImage image = slice(0);
  image.multi_frame = true;
  image.pieces = 3;
  image.frames.clear();
  for (const int k : {3, 0, 4, 1, 2}) image.frames.push_back(slice(k).frames[0]);
  test::write_dicom(folder_ / "all.dcm", image, DicomPacking::kJpeg2000Lossless);
  expect_voxels();
  // a contradictory offset table
  std::string bytes = bytes_of(folder_ / "all.dcm");
  const auto table = bytes.rfind(std::string("\xFE\xFF\0\xE0\x14\0\0\0", 8));
  ASSERT_NE(table, std::string::npos);
  bytes[table + 12] = static_cast<char>(bytes[table + 12] + 2);
  std::ofstream(folder_ / "all.dcm", std::ios::binary) << bytes;
  EXPECT_THAT(refusal(), HasSubstr("damaged PixelData (7FE0,0010)"));
  // all fragments belong to the only frame
  for (int k = 0; k < kSlices; ++k) {
    DicomImage one = slice(k);
    one.pieces = 2;
    test::write_dicom(folder_ / ("IM" + std::to_string(k)), one, DicomPacking::kJpeg2000Lossless);
  }
  std::filesystem::remove(folder_ / "all.dcm");
  expect_voxels();
}

TEST_F(Dicom, FramesOfAnOddNumberOfBytes) {
  for (const DicomPacking packing : {DicomPacking::kExplicit, DicomPacking::kBigEndian, DicomPacking::kRle,
                                     DicomPacking::kJpegLossless, DicomPacking::kJpeg2000Lossless}) {
    SCOPED_TRACE(static_cast<int>(packing));
    DicomImage image = slice(0);
    image.multi_frame = true;
    image.rows = 3;
    image.columns = 5;
    image.bits_allocated = image.bits_stored = 8;
    image.high_bit = 7;
    image.frames.clear();
    for (int k = 0; k < kSlices; ++k) {
      auto& frame = image.frames.emplace_back(slice(k).frames[0]);
      frame.stored.resize(15);
      for (std::size_t n = 0; n < 15; ++n) frame.stored[n] = static_cast<std::uint16_t>(16 * k + n);
    }
    test::write_dicom(folder_ / "all.dcm", image, packing);
    const auto scan = read();
    ASSERT_TRUE(scan) << scan.error().message();
    for (int k = 0; k < kSlices; ++k)
      for (int n = 0; n < 15; ++n) EXPECT_EQ(scan->scan.at(n % 5, n / 5, k), static_cast<float>(16 * k + n));
  }
}

TEST_F(Dicom, FramesThatAreNotThereAreMissed) {
  // 99 frames are declared, two are present
  for (const DicomPacking packing : {DicomPacking::kExplicit, DicomPacking::kRle, DicomPacking::kJpegLs}) {
    SCOPED_TRACE(static_cast<int>(packing));
    DicomImage image = slice(0);
    image.multi_frame = true;
    image.frames = {slice(0).frames[0], slice(1).frames[0]};
    test::write_dicom(folder_ / "all.dcm", image, packing);
    std::string bytes = bytes_of(folder_ / "all.dcm");
    const auto at = bytes.find(std::string("\x28\0\x08\0IS\2\0", 8));
    ASSERT_NE(at, std::string::npos);
    bytes.replace(at + 8, 2, "99");
    std::ofstream(folder_ / "all.dcm", std::ios::binary) << bytes;
    EXPECT_THAT(refusal(), AllOf(HasSubstr("a PixelData (7FE0,0010) of"), HasSubstr("ask for"),
                                 Not(HasSubstr("cut short"))));
  }
}

}  // namespace
}  // namespace palpate
