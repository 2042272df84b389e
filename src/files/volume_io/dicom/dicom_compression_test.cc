#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <optional>
#include <tuple>

#include "volume_io/dicom/test_dicom_series.h"

namespace palpate {
namespace {

using test::bytes_of;
using test::Dicom;
using test::DicomImage;
using test::DicomPacking;
using test::kSlices;
using test::slice;
using test::stored_at;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST_F(Dicom, EveryPackingWithoutLossGivesTheSameVoxels) {
  for (const DicomPacking packing :
       {DicomPacking::kImplicit, DicomPacking::kBigEndian, DicomPacking::kDeflated, DicomPacking::kRle,
        DicomPacking::kJpegLossless, DicomPacking::kJpegLosslessFirstOrder, DicomPacking::kJpegLs,
        DicomPacking::kJpeg2000Lossless, DicomPacking::kJpeg2000}) {
    SCOPED_TRACE(static_cast<int>(packing));
    write_series(packing);
    expect_voxels();
    EXPECT_THAT(warnings_, Not(HasSubstr("loss")));
  }
}

TEST_F(Dicom, Jpeg2000OfAnyBitsWithAndWithoutASign) {
  struct Case {
    int allocated, stored;
    bool is_signed;
    std::optional<int> packed_bits;
    std::optional<bool> packed_sign;
  };
  for (const Case& each :
       {Case{8, 8, false, {}, {}}, Case{8, 8, true, {}, {}}, Case{16, 12, false, {}, {}},
        Case{16, 12, true, {}, {}}, Case{16, 16, false, {}, {}}, Case{16, 16, true, {}, {}},
        // whole words; a sign known to the data set but not to the encoder, and the reverse
        Case{16, 12, true, 16, {}}, Case{16, 12, true, {}, false}, Case{16, 16, false, {}, true},
        // fewer bits than are stored, but sufficient
        Case{16, 16, true, 13, {}}}) {
    SCOPED_TRACE(std::to_string(each.stored) + " bits, sign " + std::to_string(each.is_signed));
    const int largest = each.packed_bits ? 12 : each.stored;
    const auto value = [&](int i, int j, int k) {
      const int stored = (stored_at(i, j, k) * 17) % (1 << largest);
      return each.is_signed && stored >> (largest - 1) ? stored - (1 << largest) : stored;
    };
    write_series(
        [&](DicomImage& image, int k) {
          image.bits_allocated = each.allocated;
          image.bits_stored = each.stored;
          image.high_bit = each.stored - 1;
          image.is_signed = each.is_signed;
          image.packed_bits = each.packed_bits;
          image.packed_sign = each.packed_sign;
          for (int n = 0; n < 48; ++n)
            image.frames[0].stored[static_cast<std::size_t>(n)] =
                static_cast<std::uint16_t>(value(n % 8, n / 8, k));
        },
        DicomPacking::kJpeg2000Lossless);
    expect_voxels(value);
  }
}

TEST_F(Dicom, Jpeg2000OfOtherBitsOrSizesIsRefused) {
  const auto write = [&](const auto& change) {
    write_series([&](DicomImage& image, int) { change(image); }, DicomPacking::kJpeg2000Lossless);
  };
  // more bits than are stored and fewer than a word has
  write([](DicomImage& image) {
    image.bits_stored = 12;
    image.high_bit = 11;
    image.packed_bits = 14;
  });
  EXPECT_THAT(refusal(), AllOf(HasSubstr("slice 1 of 5"), HasSubstr("contradicts its stated size or bits")));
  write([](DicomImage&) {});
  for (int k = 0; k < kSlices; ++k) {
    const auto file = folder_ / ("IM" + std::to_string(k));
    std::string bytes = bytes_of(file);
    // declares 9 columns instead of 8
    const auto at = bytes.find(std::string("\x28\0\x11\0US\2\0\x08\0", 10));
    ASSERT_NE(at, std::string::npos);
    bytes[at + 8] = 9;
    std::ofstream(file, std::ios::binary) << bytes;
  }
  EXPECT_THAT(refusal(), HasSubstr("contradicts its stated size or bits"));
  write([](DicomImage&) {});
  for (int k = 0; k < kSlices; ++k) {
    const auto file = folder_ / ("IM" + std::to_string(k));
    std::string bytes = bytes_of(file);
    const auto at = bytes.find("\xFF\x4F\xFF\x51");
    ASSERT_NE(at, std::string::npos);
    bytes[at + 6] = 0x40;
    std::ofstream(file, std::ios::binary) << bytes;
  }
  EXPECT_THAT(refusal(), HasSubstr("is compressed as High-Throughput JPEG 2000 (HTJ2K)"));
}

TEST_F(Dicom, ReportsLossyCompression) {
  const auto write = [&](DicomPacking packing, const std::string& declared) {
    write_series(
        [&](DicomImage& image, int) {
          image.bits_stored = 12;
          image.high_bit = 11;
          if (!declared.empty()) image.texts = {{0x0028, 0x2110, declared}};
        },
        packing);
    warnings_.clear();
    const auto list = list_volumes(folder_.path());
    ASSERT_TRUE(list && read());
    const bool reported = list->volumes[0].what.ends_with("compressed with loss");
    EXPECT_EQ(reported, warnings_.find("was compressed with loss") != std::string::npos);
  };
  for (const auto& [packing, declared, lossy] : {std::tuple{DicomPacking::kJpeg2000Lossy, "", true},
                                                 {DicomPacking::kJpeg2000, "", false},
                                                 {DicomPacking::kJpeg2000, "01", true},
                                                 {DicomPacking::kJpegExtended, "", true},
                                                 {DicomPacking::kJpegLsNear, "", true},
                                                 {DicomPacking::kExplicit, "01", true},
                                                 {DicomPacking::kExplicit, "00", false},
                                                 {DicomPacking::kJpegLs, "", false}}) {
    SCOPED_TRACE(static_cast<int>(packing));
    write(packing, declared);
    EXPECT_EQ(warnings_.find("with loss") != std::string::npos, lossy);
  }
}

TEST_F(Dicom, JpegOfEightBitsIsNear) {
  write_series(
      [](DicomImage& image, int k) {
        image.bits_allocated = image.bits_stored = 8;
        image.high_bit = 7;
        image.frames[0].stored.assign(48, static_cast<std::uint16_t>(100 + 10 * k));
      },
      DicomPacking::kJpegBaseline);
  const auto scan = read();
  ASSERT_TRUE(scan) << scan.error().message();
  for (int k = 0; k < kSlices; ++k) EXPECT_NEAR(scan->scan.at(4, 3, k), 100 + 10 * k, 2);
}

TEST_F(Dicom, AJpegMarkerThatDcmtkStaysAtIsDamage) {
  write_series(DicomPacking::kJpegLosslessFirstOrder);
  std::string bytes = bytes_of(folder_ / "IM1");
  const auto image = bytes.find("\xFF\xD8\xFF");
  ASSERT_NE(image, std::string::npos);
  bytes[image + 3] = 1;
  std::ofstream(folder_ / "IM1", std::ios::binary) << bytes;
  EXPECT_THAT(refusal(), AllOf(HasSubstr("slice 2 of 5"), HasSubstr("damaged PixelData (7FE0,0010)")));
}

TEST_F(Dicom, LossyOfTwelveBitsIsNear) {
  for (const auto& [packing, most] :
       {std::pair{DicomPacking::kJpegExtended, 8}, {DicomPacking::kJpegLsNear, 2}}) {
    SCOPED_TRACE(static_cast<int>(packing));
    const auto smooth = [](int i, int j, int k) {
      return static_cast<std::uint16_t>(300 * k + 20 * j + 10 * i);
    };
    write_series(
        [&](DicomImage& image, int k) {
          image.bits_stored = 12;
          image.high_bit = 11;
          for (int n = 0; n < 48; ++n)
            image.frames[0].stored[static_cast<std::size_t>(n)] = smooth(n % 8, n / 8, k);
        },
        packing);
    const auto scan = read();
    ASSERT_TRUE(scan) << scan.error().message();
    for (int k = 0; k < kSlices; ++k)
      for (int n = 0; n < 48; ++n) EXPECT_NEAR(scan->scan.at(n % 8, n / 8, k), smooth(n % 8, n / 8, k), most);
  }
}

TEST_F(Dicom, EightBitsOfOddSizeInEitherByteOrder) {
  for (const DicomPacking packing : {DicomPacking::kExplicit, DicomPacking::kBigEndian}) {
    write_series(
        [](DicomImage& image, int k) {
          image.bits_allocated = image.bits_stored = 8;
          image.high_bit = 7;
          image.rows = 3;
          image.columns = 5;
          image.frames[0].stored.clear();
          for (int n = 0; n < 15; ++n)
            image.frames[0].stored.push_back(static_cast<std::uint16_t>(20 * k + n));
        },
        packing);
    const auto scan = read();
    ASSERT_TRUE(scan) << scan.error().message();
    for (int k = 0; k < kSlices; ++k)
      for (int n = 0; n < 15; ++n) EXPECT_EQ(scan->scan.at(n % 5, n / 5, k), static_cast<float>(20 * k + n));
  }
}

TEST_F(Dicom, WithoutAPreamble) {
  for (int k = 0; k < kSlices; ++k) {
    const DicomPacking packing = k % 2 ? DicomPacking::kImplicit : DicomPacking::kExplicit;
    test::write_dicom(folder_ / ("IM" + std::to_string(k)), slice(k), packing, false);
  }
  expect_voxels();
}

// replaces the TransferSyntaxUID in the file's header
void claim_syntax(const std::filesystem::path& file, std::string uid) {
  std::string bytes = bytes_of(file);
  const auto at = bytes.find(std::string("\x02\0\x10\0UI", 6));
  ASSERT_NE(at, std::string::npos);
  const auto before = static_cast<std::size_t>(static_cast<unsigned char>(bytes[at + 6]));
  if (uid.size() % 2) uid += '\0';
  bytes.replace(at + 8, before, uid);
  bytes[at + 6] = static_cast<char>(uid.size());
  // length of the header
  bytes[140] = static_cast<char>(static_cast<unsigned char>(bytes[140]) + uid.size() - before);
  std::ofstream(file, std::ios::binary) << bytes;
}

TEST_F(Dicom, RefusesUnsupportedTransferSyntaxesByName) {
  for (const auto& [uid, name] : {std::pair{"1.2.840.10008.1.2.4.92", "JPEG 2000 of several components"},
                                  {"1.2.840.10008.1.2.4.201", "High-Throughput JPEG 2000 (HTJ2K)"},
                                  {"1.2.840.10008.1.2.4.102", "MPEG-4"},
                                  {"1.2.3.4.5", "TransferSyntaxUID (0002,0010)"}}) {
    SCOPED_TRACE(uid);
    write_series();
    for (int k = 0; k < kSlices; ++k) claim_syntax(folder_ / ("IM" + std::to_string(k)), uid);
    EXPECT_THAT(refusal(), HasSubstr(name));
  }
}

}  // namespace
}  // namespace palpate
