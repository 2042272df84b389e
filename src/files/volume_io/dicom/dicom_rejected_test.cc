#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <fstream>
#include <random>

#include "volume_io/dicom/test_dicom_series.h"

namespace palpate {
namespace {

using test::bytes_of;
using test::Dicom;
using test::DicomImage;
using test::DicomPacking;
using test::kSlices;
using test::slice;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST_F(Dicom, NamesMissingAttributes) {
  write_series([](DicomImage& image, int) { image.spacing_mm.reset(); });
  EXPECT_THAT(refusal(), AllOf(HasSubstr("PixelSpacing (0028,0030)"), HasSubstr("5 images")));
  write_series([](DicomImage& image, int) {
    image.samples = 3;
    image.bits_allocated = image.bits_stored = 8;
    image.high_bit = 7;
    image.photometric = "RGB";
  });
  EXPECT_THAT(refusal(), HasSubstr("SamplesPerPixel (0028,0002)"));
  write_series([](DicomImage& image, int k) {
    image.frames[0].slope = k == 2 ? 0 : 1;
    image.frames[0].intercept = 0;
  });
  EXPECT_THAT(refusal(),
              AllOf(HasSubstr("slice 3 of 5, at -27.50 mm"), HasSubstr("RescaleSlope (0028,1053)")));
}

TEST_F(Dicom, ASliceThatIsCutShortIsNamed) {
  write_series();
  std::filesystem::resize_file(folder_ / "IM2", std::filesystem::file_size(folder_ / "IM2") - 20);
  EXPECT_THAT(refusal(),
              AllOf(HasSubstr("slice 3 of 5, at -27.50 mm"), HasSubstr("PixelData (7FE0,0010) cut short")));
}

TEST_F(Dicom, OnlyAFileThatIsCutShortIsCalledSo) {
  write_series();
  // bytes after the pixels, as appended by some archives
  const std::string whole = bytes_of(folder_ / "IM2");
  std::ofstream(folder_ / "IM2", std::ios::binary) << whole << "padding of it";
  expect_voxels();
  // no pixels at all
  const auto pixels = whole.rfind(std::string("\xE0\x7F\x10\x00", 4));
  ASSERT_NE(pixels, std::string::npos);
  std::ofstream(folder_ / "IM2", std::ios::binary) << whole.substr(0, pixels);
  EXPECT_THAT(refusal(), AllOf(HasSubstr("slice 3 of 5"), HasSubstr("has no PixelData (7FE0,0010)"),
                               Not(HasSubstr("cut short"))));
  // fewer than required by rows and columns
  write_series([](DicomImage& image, int k) {
    if (k == 2) image.frames[0].stored.resize(40);
  });
  EXPECT_THAT(refusal(), AllOf(HasSubstr("slice 3 of 5"), HasSubstr("of 80 bytes"), HasSubstr("ask for 96"),
                               Not(HasSubstr("cut short"))));
}

TEST_F(Dicom, PackedImagesOfOtherBitsAreRefused) {
  // DCMTK decodes 8 bits into the first half of the memory for 16 bits, without an error
  write_series(
      [](DicomImage& image, int) {
        image.bits_allocated = image.bits_stored = 8;
        image.high_bit = 7;
        for (std::uint16_t& word : image.frames[0].stored) word &= 0xFF;
      },
      DicomPacking::kJpegLossless);
  EXPECT_TRUE(read());
  for (int k = 0; k < kSlices; ++k) {
    const auto file = folder_ / ("IM" + std::to_string(k));
    std::string bytes = bytes_of(file);
    const auto at = bytes.find(std::string("\x28\0\0\1US\2\0\x08\0", 10));
    ASSERT_NE(at, std::string::npos);
    bytes[at + 8] = 16;
    std::ofstream(file, std::ios::binary) << bytes;
  }
  EXPECT_THAT(refusal(), AllOf(HasSubstr("slice 1 of 5"), HasSubstr("contradicts its stated size or bits")));
}

TEST_F(Dicom, HostileTextLengthAllocatesNothing) {
  // ImageType declares a length of about 700 MiB
  write_series(DicomPacking::kImplicit);
  std::string bytes = bytes_of(folder_ / "IM0");
  const auto at = bytes.find(std::string("\x08\0\x08\0", 4));
  ASSERT_NE(at, std::string::npos);
  bytes.replace(at + 4, 4, "2.2.");
  std::ofstream(folder_ / "IM0", std::ios::binary) << bytes;
  EXPECT_TRUE(read());
  EXPECT_THAT(warnings_, HasSubstr("left out: 1 file that is a DICOM file that ends within an element"));
}

TEST_F(Dicom, ReportsATruncatedEnd) {
  // nothing indicates that another slice existed: this is reported wherever the volume is read
  write_series();
  std::filesystem::resize_file(folder_ / "IM4", 200);
  EXPECT_EQ(read()->scan.geometry().dims[2], 4);
  EXPECT_THAT(warnings_, AllOf(HasSubstr("left out: 1 file that is a DICOM file that ends within an element"),
                               HasSubstr("the first or the last slice of a volume")));
  const auto list = list_volumes(folder_.path());
  ASSERT_TRUE(list);
  EXPECT_THAT(list->notes, ::testing::Contains(HasSubstr("left out: 1 file")));
}

TEST_F(Dicom, TheFileThatItsReaderFailsOnIsNamed) {
  // sequences nested deeper than any stack allows
  write_series();
  std::string bytes = bytes_of(folder_ / "IM2");
  bytes.resize(bytes.find(std::string("\x28\0\2\0US", 6)));
  for (int level = 0; level < 300'000; ++level)
    bytes += std::string("\x28\0\0\x30SQ\0\0\xFF\xFF\xFF\xFF\xFE\xFF\0\xE0\xFF\xFF\xFF\xFF", 20);
  std::ofstream(folder_ / "IM2", std::ios::binary) << bytes;
  const auto scan = read();
  ASSERT_FALSE(scan);
  EXPECT_EQ(scan.error().where, (folder_ / "IM2").string());
  EXPECT_THAT(scan.error().what, HasSubstr("its reader fails to read it"));
  EXPECT_THAT(scan.error().remedy, HasSubstr("take it out of the folder"));
}

TEST_F(Dicom, OtherObjectsAreCountedAndImagesAreNoLabels) {
  write_series();
  std::string other(128, '\0');
  other += std::string("DICM\x02\0\x02\0UI\x1C\0", 12) + "1.2.840.10008.5.1.4.1.1.66.4";
  std::ofstream(folder_ / "seg", std::ios::binary) << other;
  std::ofstream(folder_ / "notes.txt") << "x";
  const auto list = list_volumes(folder_.path());
  ASSERT_TRUE(list) << list.error().message();
  EXPECT_THAT(list->notes,
              ::testing::ElementsAre("besides: a DICOM segmentation (SEG)", "besides: 1 other file"));
  const auto labels = read_labels(folder_.path());
  ASSERT_FALSE(labels);
  EXPECT_THAT(labels.error().what, HasSubstr("a scan, not labels"));
  EXPECT_TRUE(is_volume(folder_.path()));
  EXPECT_FALSE(is_dicom(folder_ / "notes.txt"));
}

TEST_F(Dicom, NonDicomFilesHaveNoVolumeNumber) {
  std::ofstream(folder_ / "a.nrrd") << "NRRD0004\n";
  const auto scan = read_scan(folder_ / "a.nrrd", {}, {}, VoxelCaching::kOff, 2);
  ASSERT_FALSE(scan);
  EXPECT_EQ(scan.error().kind, ErrorKind::kUsage);
}

TEST_F(Dicom, LinksThatLeadOutAreNotFollowed) {
  const test::TemporaryFolder elsewhere;
  write_series();
  std::filesystem::rename(folder_ / "IM4", elsewhere / "IM4");
  std::filesystem::create_symlink(elsewhere / "IM4", folder_ / "IM4");
  const auto scan = read();
  ASSERT_TRUE(scan) << scan.error().message();
  EXPECT_EQ(scan->scan.geometry().dims[2], 4);
  EXPECT_THAT(warnings_, HasSubstr("1 link leads out of the folder"));
}

TEST_F(Dicom, AFolderOfLinksThatLeadOutHoldsNoVolume) {
  const test::TemporaryFolder elsewhere;
  test::write_dicom(elsewhere / "IM0", slice(0));
  std::filesystem::create_symlink(elsewhere / "IM0", folder_ / "IM0");
  EXPECT_FALSE(is_dicom(folder_.path()));
}

TEST_F(Dicom, StopsWhenItIsAsked) {
  write_series();
  const std::atomic<bool> stop{true};
  const auto scan = read_scan(folder_.path(), Progress({}, &stop));
  ASSERT_FALSE(scan);
  EXPECT_EQ(scan.error().kind, ErrorKind::kInterrupted);
}

TEST_F(Dicom, OutputsContainNoIdentifiers) {
  const std::string canary = "DOE^CANARY";
  const auto with_patient = [&](const auto& change) {
    write_series([&](DicomImage& image, int k) {
      image.patient = canary;
      image.series = "1.2.3.4.5.9753";
      change(image, k);
    });
  };
  std::string reported;
  const auto report = [&] {
    const auto list = list_volumes(folder_.path());
    if (!list) {
      reported += list.error().message();
    } else {
      for (const auto& volume : list->volumes) reported += volume.what + volume.fault;
      for (const auto& note : list->notes) reported += note;
    }
    const auto scan = read();
    reported += scan ? scan->header.format + scan->header.component_type : scan.error().message();
  };
  with_patient([](DicomImage&, int) {});
  report();
  // terms of the standard are shown, others are not
  with_patient([&](DicomImage& image, int k) {
    image.modality = "DOE";
    image.image_type = k < 2 ? "ORIGINAL\\DOE^CANARY" : "ORIGINAL\\PRIMARY";
  });
  report();
  with_patient([](DicomImage& image, int k) {
    image.frames[0].position[2] += k == 3 ? 1 : 0;
    image.photometric = k == 1 ? "DOE^CANARY" : "MONOCHROME2";
  });
  report();
  with_patient([](DicomImage& image, int) { image.spacing_mm.reset(); });
  report();
  std::filesystem::resize_file(folder_ / "IM1", 900);
  report();
  reported += warnings_;
  EXPECT_THAT(reported, AllOf(Not(HasSubstr("DOE")), Not(HasSubstr("CANARY")), Not(HasSubstr("9753"))));
  EXPECT_GT(reported.size(), 300u);
}

TEST_F(Dicom, DamagedFilesAreRefusedOrReadAndNothingElse) {
  constexpr unsigned kSeed = 20;
  SCOPED_TRACE(kSeed);
  std::mt19937 random(kSeed);
  const std::array packings{DicomPacking::kExplicit,
                            DicomPacking::kImplicit,
                            DicomPacking::kDeflated,
                            DicomPacking::kRle,
                            DicomPacking::kJpegLosslessFirstOrder,
                            DicomPacking::kJpegLs,
                            DicomPacking::kJpeg2000Lossless};
  int refused = 0;
  for (int n = 0; n < 100; ++n) {
    const auto packing = packings[static_cast<std::size_t>(n) % packings.size()];
    DicomImage image = slice(0);
    image.multi_frame = true;
    image.frames.clear();
    for (int k = 0; k < 3; ++k) image.frames.push_back(slice(k).frames[0]);
    const auto file = folder_ / "damaged";
    test::write_dicom(file, image, packing);
    std::string bytes = bytes_of(file);
    if (n % 2) {
      bytes.resize(std::uniform_int_distribution<std::size_t>(0, bytes.size())(random));
    } else {
      for (int flips = 0; flips < 1 + n % 4; ++flips) {
        const auto at = std::uniform_int_distribution<std::size_t>(132, bytes.size() - 1)(random);
        bytes[at] = static_cast<char>(bytes[at] ^ (1 << std::uniform_int_distribution<int>(0, 7)(random)));
      }
    }
    std::ofstream(file, std::ios::binary | std::ios::trunc) << bytes;
    const auto scan = read_scan(file);
    refused += !scan;
    if (scan) continue;
    EXPECT_EQ(scan.error().where.find(file.string()), 0u) << n << scan.error().message();
  }
  EXPECT_GT(refused, 30);
  EXPECT_LT(refused, 100);
}

// every voxel of one volume lies in the other, with the same value
void expect_same_voxels(const Volume<float>& one, const Volume<float>& other) {
  ASSERT_EQ(one.voxels().size(), other.voxels().size());
  const auto X = other.geometry().X_PatientVoxel().inverse() * one.geometry().X_PatientVoxel();
  std::size_t wrong = 0;
  double off_mm = 0;
  const auto& dims = one.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; j += 3)
      for (int i = 0; i < dims[0]; i += 3) {
        const Eigen::Vector3d at = (X * Point<Voxel>(i, j, k)).eigen();
        const Eigen::Vector3d near = at.array().round();
        off_mm = std::max(off_mm, (at - near).norm() * other.geometry().spacing_mm.maxCoeff());
        const auto n = near.cast<int>();
        wrong += !other.geometry().contains(n.x(), n.y(), n.z()) ||
                 other.at(n.x(), n.y(), n.z()) != one.at(i, j, k);
      }
  EXPECT_EQ(wrong, 0u);
  EXPECT_LT(off_mm, 1e-3);
}

TEST(SharedDicom, SeriesAreTheirGroundTruth) {
  for (const auto& [series, truth] :
       {std::pair{"anatomical/001", "anatomical/001_ground_truth.nii.gz"},
        {"anatomical/001_implicit", "anatomical/001_implicit_ground_truth.nii.gz"},
        {"anatomical/002_non_isotropic", "anatomical/002_non_isotropic_ground_truth.nii.gz"},
        {"compressed_jpegls/001", "compressed_jpegls/001_ground_truth.nii.gz"},
        {"slicecount/001", "slicecount/001_ground_truth.nii.gz"}}) {
    SCOPED_TRACE(series);
    PALPATE_SHARED_FILE(folder, std::string("edge/dicom/") + series);
    PALPATE_SHARED_FILE(file, std::string("edge/dicom/") + truth);
    const auto scan = read_scan(folder), expected = read_scan(file);
    ASSERT_TRUE(scan) << scan.error().message();
    ASSERT_TRUE(expected) << expected.error().message();
    expect_same_voxels(scan->scan, expected->scan);
  }
}

TEST(SharedDicom, TrapsAreRefusedByASentence) {
  for (const auto& [series, what] :
       {std::pair{"missing_slice/001", "a slice is missing between slice 3 of 4, at 28.11 mm"},
        {"notavolume/001", "two slices are at the same position"},
        {"sliceorientation/001", "holds 2 volumes"},
        {"bad_sequence.dcm", "a single slice is not a volume"}}) {
    SCOPED_TRACE(series);
    PALPATE_SHARED_FILE(file, std::string("edge/dicom/") + series);
    const auto scan = read_scan(file);
    ASSERT_FALSE(scan);
    EXPECT_THAT(scan.error().what, HasSubstr(what));
  }
}

TEST(SharedDicom, ImagesOfSegmentationsLieOnTheirGrids) {
  for (const std::string size : {"23x38x3", "24x38x3"}) {
    SCOPED_TRACE(size);
    PALPATE_SHARED_FILE(slices, "dicom_seg/" + size + "/image");
    PALPATE_SHARED_FILE(frames, "dicom_seg/" + size + "/multiframe/mf.dcm");
    PALPATE_SHARED_FILE(labels, "dicom_seg/" + size + "/nrrd/label.nrrd");
    const auto classic = read_scan(slices), enhanced = read_scan(frames);
    const auto grid = read_header(labels);
    ASSERT_TRUE(classic) << classic.error().message();
    ASSERT_TRUE(enhanced) << enhanced.error().message();
    ASSERT_TRUE(grid);
    EXPECT_TRUE(classic->scan.geometry().same_grid(grid->geometry));
    EXPECT_TRUE(enhanced->scan.geometry().same_grid(grid->geometry));
    EXPECT_EQ(classic->scan.voxels(), enhanced->scan.voxels());
  }
  PALPATE_SHARED_FILE(ct, "dicom_seg/ct-3slice");
  PALPATE_SHARED_FILE(liver, "dicom_seg/liver_seg.nrrd");
  const auto scan = read_scan(ct);
  const auto grid = read_header(liver);
  ASSERT_TRUE(scan) << scan.error().message();
  EXPECT_TRUE(scan->scan.geometry().same_grid(grid->geometry));
}

}  // namespace
}  // namespace palpate
