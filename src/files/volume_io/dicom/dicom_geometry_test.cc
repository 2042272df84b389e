#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <fstream>

#include "volume_io/dicom/test_dicom_series.h"

namespace palpate {
namespace {

using test::Dicom;
using test::DicomImage;
using test::DicomPacking;
using test::kSlices;
using test::kStep_mm;
using test::mask_of;
using test::slice;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST_F(Dicom, SlicesAreSortedByTheirPlacesAlone) {
  // names, numbers and folders suggest another order
  for (int k = 0; k < kSlices; ++k) {
    DicomImage image = slice(k);
    image.instance_number = 100 - k * k;
    const auto folder = folder_ / ("d" + std::to_string((k * 3) % 5));
    std::filesystem::create_directories(folder);
    test::write_dicom(folder / std::string(1, static_cast<char>('z' - k)), image);
  }
  std::ofstream(folder_ / "README.txt") << "nothing of it";
  std::ofstream(folder_ / "empty");
  std::ofstream(folder_ / "picture.png") << "\x89PNG\r\n";
  expect_voxels();
  const auto header = read_header(folder_.path());
  ASSERT_TRUE(header);
  EXPECT_EQ(header->format, "DICOM");
  EXPECT_EQ(header->component_type, "uint16");
  const GridGeometry& g = header->geometry;
  EXPECT_LT((g.spacing_mm - Eigen::Vector3d(0.5, 0.7, kStep_mm)).norm(), 1e-9) << "of columns, then of rows";
  EXPECT_LT((g.origin - Point<Patient>(-10, 20, -30)).norm(), 1e-9);
  EXPECT_LT((g.direction - Eigen::Matrix3d::Identity()).norm(), 1e-9);
  EXPECT_TRUE(header->has_geometry);
}

TEST_F(Dicom, ObliqueSlicesLieWhereTheirFilesSay) {
  // a sagittal plane rotated by 20 degrees, whose normal points to the patient's right
  const double c = std::cos(20 * M_PI / 180), s = std::sin(20 * M_PI / 180);
  const Eigen::Vector3d row(s, c, 0), column(0, 0, -1), normal = row.cross(column);
  write_series([&](DicomImage& image, int k) {
    image.orientation = {row.x(), row.y(), row.z(), column.x(), column.y(), column.z()};
    const Eigen::Vector3d position = Eigen::Vector3d(12, -34, 56) + k * 2.5 * normal;
    image.frames[0].position = {position.x(), position.y(), position.z()};
  });
  expect_voxels();
  const auto header = read_header(folder_.path());
  ASSERT_TRUE(header);
  // formula of PS3.3 C.7.6.2.1.1
  const Eigen::Vector3d expected =
      Eigen::Vector3d(12, -34, 56) + 4 * 2.5 * normal + 7 * 0.5 * row + 5 * 0.7 * column;
  const Point<Patient> last = header->geometry.X_PatientVoxel() * Point<Voxel>(7, 5, 4);
  EXPECT_LT((last.eigen() - expected).norm(), 1e-3);
  EXPECT_TRUE(header->geometry.right_handed());
}

TEST_F(Dicom, AMissingSliceIsNamed) {
  write_series([](DicomImage& image, int k) {
    if (k >= 3) image.frames[0].position[2] += kStep_mm;
  });
  EXPECT_THAT(refusal(), AllOf(HasSubstr("a slice is missing between slice 3 of 5, at -27.50 mm"),
                               HasSubstr("the next at -25.00 mm"), HasSubstr("1.25 mm apart")));
}

TEST_F(Dicom, ADoubledSliceIsNamed) {
  write_series([](DicomImage& image, int k) { image.sop_instance = "1.2.3." + std::to_string(k); });
  const std::string what = "two slices are at the same position: slice 3 of 6, at -27.50 mm";
  // equal values with another identifier: not known to be the same image
  test::write_dicom(folder_ / "copy", slice(2));
  EXPECT_THAT(refusal(), HasSubstr(what));
  // the same identifier with another value
  DicomImage other = slice(2);
  other.sop_instance = "1.2.3.2";
  ++other.frames[0].stored[5];
  test::write_dicom(folder_ / "copy", other);
  EXPECT_THAT(refusal(), HasSubstr(what));
}

TEST_F(Dicom, CopiesOfASliceAreOne) {
  for (const bool compressed : {false, true}) {
    // a folder copied into itself, the copies compressed differently
    for (int k = 0; k < kSlices; ++k) {
      DicomImage image = slice(k);
      image.sop_instance = "1.2.3." + std::to_string(k);
      test::write_dicom(folder_ / ("IM" + std::to_string(k)), image);
      std::filesystem::create_directories(folder_ / "copy");
      test::write_dicom(folder_ / "copy" / ("IM" + std::to_string(k)), image,
                        compressed ? DicomPacking::kJpegLs : DicomPacking::kExplicit);
    }
    expect_voxels();
    EXPECT_THAT(warnings_, HasSubstr("5 files are exact copies of others and were left out"));
    const auto list = list_volumes(folder_.path());
    ASSERT_TRUE(list);
    EXPECT_EQ(list->volumes.size(), 1u);
    EXPECT_THAT(list->notes, ::testing::Contains(HasSubstr("5 files are exact copies")));
  }
}

TEST_F(Dicom, UnevenSlicesAreNamed) {
  write_series([](DicomImage& image, int k) {
    if (k == 4) image.frames[0].position[2] += 0.3;
  });
  EXPECT_THAT(refusal(), HasSubstr("its slices are unevenly spaced: slice 4 of 5, at -26.25 mm"));
}

TEST_F(Dicom, SmallDifferencesThatAddUpAreUnevenToo) {
  write_series([](DicomImage& image, int k) { image.frames[0].position[2] += k * k * 0.002; },
               DicomPacking::kExplicit, 12);
  EXPECT_THAT(refusal(), AllOf(HasSubstr("unevenly"), HasSubstr("off its position")));
}

TEST_F(Dicom, AThousandthOfAMillimetreIsRounding) {
  write_series([](DicomImage& image, int k) {
    image.frames[0].position[0] += k % 2 ? 1e-3 : -1e-3;
    image.frames[0].position[2] += k % 3 ? 1e-3 : -1e-3;
  });
  expect_voxels();
  EXPECT_NEAR(read()->scan.geometry().spacing_mm.z(), kStep_mm, 1e-3);
}

TEST_F(Dicom, ATiltedGantryIsAShearedGrid) {
  write_series([](DicomImage& image, int k) { image.frames[0].position[1] -= 0.25 * k; });
  expect_voxels();
  EXPECT_THAT(warnings_, AllOf(HasSubstr("gantry tilted by 11.31 degrees"), HasSubstr("its grid is sheared"),
                               HasSubstr("0.25 mm to the side of the one before")));
  const auto header = read_header(folder_.path());
  ASSERT_TRUE(header) << header.error().message();
  // every voxel is at the position given by PS3.3 C.7.6.2.1.1
  for (const int k : {0, 3, kSlices - 1}) {
    const Eigen::Vector3d expected(-10 + 7 * 0.5, 20 - 0.25 * k + 5 * 0.7, -30 + k * kStep_mm);
    EXPECT_LT((header->geometry.X_PatientVoxel() * Point<Voxel>(7, 5, k) - Point<Patient>(expected)).norm(),
              1e-9);
  }
}

TEST_F(Dicom, ASlantNoGantryHasIsRefused) {
  write_series([](DicomImage& image, int k) { image.frames[0].position[1] -= 2.5 * k; });
  EXPECT_THAT(refusal(),
              AllOf(HasSubstr("tilted by 63.43 degrees, which no scanner has"), HasSubstr("slice 2 of 5"),
                    HasSubstr("2.50 mm to the side of the one before")));
}

TEST_F(Dicom, AnOrientationRoundedToThousandthsIsTaken) {
  for (const std::array<double, 6>& orientation :
       {std::array<double, 6>{1, 0, 0.001, 0, 1, 0}, std::array<double, 6>{1, 0.001, 0, 0.001, 1, 0}}) {
    write_series([&](DicomImage& image, int) { image.orientation = orientation; });
    expect_voxels();
    EXPECT_THAT(warnings_, IsEmpty());
  }
}

// LIDC-IDRI after anonymisation
TEST_F(Dicom, AFrameOfReferenceForEachSliceIsOneVolume) {
  write_series([](DicomImage& image, int k) {
    image.texts = {{0x0020, 0x0052, "1.2.5." + std::to_string(k)}};
  });
  expect_voxels();
  EXPECT_THAT(warnings_, HasSubstr("different frames of reference (FrameOfReferenceUID (0020,0052))"));
  const auto list = list_volumes(folder_.path());
  ASSERT_TRUE(list);
  ASSERT_EQ(list->volumes.size(), 1u);
  EXPECT_EQ(list->volumes[0].fault, "");
  EXPECT_THAT(list->notes, ::testing::Contains(HasSubstr("different frames of reference")));
}

TEST_F(Dicom, TwoFramesOfReferenceOfSeveralSlicesAreTwoVolumes) {
  write_series([](DicomImage& image, int k) {
    image.texts = {{0x0020, 0x0052, k < 2 ? "1.2.5.1" : "1.2.5.2"}};
  });
  EXPECT_THAT(refusal(), AllOf(HasSubstr("holds 2 volumes"), HasSubstr("in a separate frame of reference")));
}

TEST_F(Dicom, PositionsWinOverSpacingBetweenSlices) {
  write_series([](DicomImage& image, int) { image.texts = {{0x0018, 0x0088, "2.5"}}; });
  expect_voxels();
  EXPECT_NEAR(read()->scan.geometry().spacing_mm.z(), kStep_mm, 1e-9);
  EXPECT_THAT(warnings_, AllOf(HasSubstr("states that slices are 2.50 mm apart"), HasSubstr("1.25 mm apart"),
                               HasSubstr("the positions are used")));
}

TEST_F(Dicom, TemporalPositionsOfFramesAreVolumes) {
  DicomImage image = slice(0);
  image.multi_frame = true;
  image.frames.clear();
  for (int k = 0; k < kSlices; ++k)
    for (std::uint32_t time = 1; time <= 3; ++time) {
      image.frames.push_back(slice(k).frames[0]);
      image.frames.back().temporal_position = time;
      image.frames.back().stored.assign(48,
                                        static_cast<std::uint16_t>(100 * time + static_cast<unsigned>(k)));
    }
  test::write_dicom(folder_ / "all", image);
  EXPECT_THAT(refusal(),
              AllOf(HasSubstr("holds 3 volumes"), HasSubstr("time point 1"), HasSubstr("time point 3")));
  EXPECT_EQ(read(2)->scan.at(1, 1, 4), 204);
}

TEST_F(Dicom, NamesADisplacedSlice) {
  write_series([](DicomImage& image, int k) {
    if (k == 2) image.frames[0].position[0] += 0.4;
  });
  EXPECT_THAT(refusal(), HasSubstr("slice 3 of 5, at -27.50 mm along its normal, lies 0.40 mm off"));
}

TEST_F(Dicom, ASingleSliceIsNoVolume) {
  test::write_dicom(folder_ / "one.dcm", slice(0));
  EXPECT_THAT(refusal(), HasSubstr("a single slice is not a volume"));
  const auto alone = read_scan(folder_ / "one.dcm");
  ASSERT_FALSE(alone);
  EXPECT_EQ(alone.error().where, (folder_ / "one.dcm").string());
}

// Seeds of dicom_fuzzer. PALPATE_WRITE_SEEDS=src/files/volume_io/dicom/dicom_fuzzer_corpus writes them again.
TEST(DicomSeeds, AreUnderstood) {
  const std::filesystem::path folder =
      std::filesystem::path(PALPATE_SOURCE_DIR) / "src/files/volume_io/dicom/dicom_fuzzer_corpus";
  if (const char* target = std::getenv("PALPATE_WRITE_SEEDS")) {
    const auto write = [&](const std::string& name, const auto& change, DicomPacking packing,
                           bool preamble = true) {
      DicomImage image = slice(0);
      image.sop_instance = "1.2.3";
      change(image);
      test::write_dicom(std::filesystem::path(target) / name, image, packing, preamble);
    };
    const auto frames = [](DicomImage& image) {
      image.multi_frame = true;
      image.frames.clear();
      for (int k = 0; k < 3; ++k) {
        image.frames.push_back(slice(k).frames[0]);
        image.frames.back().slope = 1 + k;
        image.frames.back().intercept = k;
      }
    };
    const auto resonance = [](DicomImage& image) {
      image.modality = "MR";
      image.echo_time_ms = 10;
      image.b_value = 1000;
      image.gradient = {{1, 0, 0}};
      image.trigger_time_ms = 30;
      image.acquisition = 2;
      image.is_signed = true;
      image.bits_stored = 12;
      image.high_bit = 11;
      image.padding = -2000;
    };
    write(
        "slice", [](DicomImage&) {}, DicomPacking::kExplicit);
    write("resonance", resonance, DicomPacking::kImplicit, false);
    write(
        "big", [](DicomImage&) {}, DicomPacking::kBigEndian);
    write("frames", frames, DicomPacking::kExplicit);
    write("deflated", frames, DicomPacking::kDeflated);
    write("rle", frames, DicomPacking::kRle);
    write("jpeg", frames, DicomPacking::kJpegLosslessFirstOrder);
    write("jpegls", frames, DicomPacking::kJpegLs);
    const auto bits = [](int stored) {
      return [stored](DicomImage& image) {
        image.bits_allocated = stored > 8 ? 16 : 8;
        image.bits_stored = stored;
        image.high_bit = stored - 1;
        for (std::uint16_t& word : image.frames[0].stored)
          word &= static_cast<std::uint16_t>((1 << stored) - 1);
      };
    };
    write("rle8", bits(8), DicomPacking::kRle);
    write("jpeg8", bits(8), DicomPacking::kJpegBaseline);
    write("jpeg12", bits(12), DicomPacking::kJpegExtended);
    write("jpeg14", bits(16), DicomPacking::kJpegLossless);
    write("jpegls_near", bits(12), DicomPacking::kJpegLsNear);
    write("jpeg2000", frames, DicomPacking::kJpeg2000Lossless);
    write("jpeg2000_lossy", bits(12), DicomPacking::kJpeg2000Lossy);
    test::DicomMasks masks;
    masks.segments = {{1, "bone", "71341001", "SCT", "Femur", "7771000"}, {2, "two"}};
    for (int n = 0; n < 3; ++n) masks.frames.push_back({1 + n % 2, {0, 0, 2.5 * n}, mask_of(n)});
    test::write_masks(std::filesystem::path(target) / "masks", masks);
    masks.type = "LABELMAP";
    masks.bits = 8;
    test::write_masks(std::filesystem::path(target) / "labels", masks);
    test::DicomContours contours;
    contours.structures = {{"Femur_L", "71341001", "SCT", "Femur", {}}, {"hole", "", "", "", {}}};
    for (int k = 0; k < 3; ++k)
      for (const double half : {3.0, 1.0})
        contours.structures[half < 2 ? 1 : 0].contours.push_back({{{-9 - half, 22, -28.0 + k},
                                                                   {-9, 22 - half, -28.0 + k},
                                                                   {-9 + half, 22, -28.0 + k},
                                                                   {-9, 22 + half, -28.0 + k}}});
    contours.frame_of_reference = "1.2.5";
    contours.series = "1.2.3";
    test::write_contours(std::filesystem::path(target) / "contours", contours);
  }
  int seeds = 0;
  for (const auto& seed : std::filesystem::directory_iterator(folder)) {
    SCOPED_TRACE(seed.path());
    ++seeds;
    if (!is_dicom(seed.path())) {
      GridGeometry grid;
      grid.dims = {16, 12, 10};
      grid.origin = Point<Patient>(-16, 16, -30);
      EXPECT_TRUE(read_labels(seed.path(), {}, {}, {}, AmbiguousLabels::kReject, VoxelCaching::kOff, &grid));
      continue;
    }
    const auto list = list_volumes(seed.path());
    ASSERT_TRUE(list) << list.error().message();
    ASSERT_EQ(list->volumes.size(), 1u);
    if (!list->volumes[0].fault.empty()) {
      EXPECT_EQ(list->volumes[0].fault, "a single slice is not a volume");
    }
  }
  EXPECT_EQ(seeds, 19);
}

}  // namespace
}  // namespace palpate
