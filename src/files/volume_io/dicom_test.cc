#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <random>
#include <set>
#include <tuple>

#include "base/test_files.h"
#include "base/test_folder.h"
#include "palpate/volume_io/volume_io.h"
#include "volume_io/test_dicom.h"

/// Series written by DCMTK, each with one difficulty, and the shared data sets.
namespace palpate {
namespace {

using test::DicomImage;
using test::DicomPacking;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr int kSlices = 5;
constexpr double kStep_mm = 1.25;

// stored value of a voxel, different everywhere, in 12 bits
std::uint16_t stored_at(int i, int j, int k) {
  return static_cast<std::uint16_t>((k * 611 + j * 83 + i * 7) % 4096);
}

std::vector<std::uint16_t> words_of(const DicomImage& image, int k) {
  std::vector<std::uint16_t> words;
  for (int j = 0; j < image.rows; ++j)
    for (int i = 0; i < image.columns; ++i) words.push_back(stored_at(i, j, k));
  return words;
}

// slice of a series, k steps along the normal of an axial plane
DicomImage slice(int k) {
  DicomImage image;
  image.frames[0].position = {-10, 20, -30 + k * kStep_mm};
  image.frames[0].stored = words_of(image, k);
  return image;
}

std::string bytes_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

class Dicom : public ::testing::Test {
 protected:
  // writes the slices of a series, each modified
  template <class Change>
  void write_series(const Change& change, DicomPacking packing = DicomPacking::kExplicit,
                    int slices = kSlices, const std::string& name = "IM") {
    for (int k = 0; k < slices; ++k) {
      DicomImage image = slice(k);
      change(image, k);
      test::write_dicom(folder_ / (name + std::to_string(k)), image, packing);
    }
  }
  void write_series(DicomPacking packing = DicomPacking::kExplicit) {
    write_series([](DicomImage&, int) {}, packing);
  }

  Result<ScanFile> read(std::optional<int> volume = {}) {
    return read_scan(
        folder_.path(), {}, [&](const std::string& message) { warnings_ += message + "\n"; },
        VoxelCaching::kOff, volume);
  }
  std::string refusal(std::optional<int> volume = {}) {
    const auto scan = read(volume);
    if (scan) return "no error";
    EXPECT_EQ(scan.error().where, folder_.path().string());
    EXPECT_THAT(scan.error().remedy, Not(IsEmpty()));
    return scan.error().what;
  }
  // compares every voxel with its expected value
  template <class Value>
  void expect_voxels(const Value& value) {
    const auto scan = read();
    ASSERT_TRUE(scan) << scan.error().message();
    const GridGeometry& g = scan->scan.geometry();
    ASSERT_EQ(g.dims, (std::array{8, 6, kSlices}));
    std::size_t wrong = 0;
    for (int k = 0; k < g.dims[2]; ++k)
      for (int j = 0; j < g.dims[1]; ++j)
        for (int i = 0; i < g.dims[0]; ++i)
          wrong += scan->scan.at(i, j, k) != static_cast<float>(value(i, j, k));
    EXPECT_EQ(wrong, 0u);
  }
  void expect_voxels() { expect_voxels(stored_at); }

  const test::TemporaryFolder folder_;
  std::string warnings_;
};

// ---- geometry -----------------------------------------------------------------------------------

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

// ---- volumes of one series ----------------------------------------------------------------------

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

// ---- compression --------------------------------------------------------------------------------

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

// ---- values -------------------------------------------------------------------------------------

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

// ---- multi-frame --------------------------------------------------------------------------------

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

// ---- rejected files -----------------------------------------------------------------------------

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

// ---- patient identity ---------------------------------------------------------------------------

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

// ---- damage -------------------------------------------------------------------------------------

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

// ---- shared data --------------------------------------------------------------------------------

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

// ---- segmentations ------------------------------------------------------------------------------

// positions of the voxels of a segment, in voxels of a grid
std::set<std::array<int, 3>> places_of(const LabelMap& labels, const Segment& segment,
                                       const GridGeometry& grid) {
  std::set<std::array<int, 3>> positions;
  const auto X = grid.X_PatientVoxel().inverse() * labels.geometry().X_PatientVoxel();
  const auto& layer = labels.layers[static_cast<std::size_t>(segment.layer)];
  const auto& dims = labels.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i) {
        if (layer.at(i, j, k) != segment.value) continue;
        const Eigen::Vector3d at = (X * Point<Voxel>(i, j, k)).eigen(), near = at.array().round();
        EXPECT_LT((at - near).norm(), 1e-3);
        positions.insert(
            {static_cast<int>(near.x()), static_cast<int>(near.y()), static_cast<int>(near.z())});
      }
  return positions;
}

// every structure of the masks is a segment with the same voxels, and vice versa
void expect_masks(const std::string& segmentation, const std::vector<std::string>& masks,
                  std::size_t layers = 1) {
  SCOPED_TRACE(segmentation);
  PALPATE_SHARED_FILE(file, "dicom_seg/" + segmentation);
  const auto read = read_labels(file);
  ASSERT_TRUE(read) << read.error().message();
  EXPECT_EQ(read->header.format, "DICOM segmentation");
  EXPECT_EQ(read->labels.layers.size(), layers);
  std::multiset<std::set<std::array<int, 3>>> expected, found;
  std::optional<GridGeometry> grid;
  for (const std::string& mask : masks) {
    PALPATE_SHARED_FILE(reference, "dicom_seg/" + mask);
    const auto labels = read_labels(reference);
    ASSERT_TRUE(labels) << labels.error().message();
    if (!grid) grid = labels->labels.geometry();
    // 5 marks positions of omitted frames, which the file declares as background
    for (const Segment& segment : labels->labels.segments)
      if (segmentation != "sparse-labelmap-ppv5.dcm" || segment.value != 5)
        expected.insert(places_of(labels->labels, segment, *grid));
  }
  for (const Segment& segment : read->labels.segments) {
    EXPECT_THAT(segment.name, Not(IsEmpty()));
    found.insert(places_of(read->labels, segment, *grid));
  }
  EXPECT_EQ(found.size(), expected.size());
  EXPECT_TRUE(found == expected);
}

// 5 x 7 voxels: 35 bits, so that frames begin at any bit
std::vector<std::uint16_t> mask_of(int seed) {
  std::vector<std::uint16_t> values(35);
  for (int n = 0; n < 35; ++n) values[static_cast<std::size_t>(n)] = (n * n + seed * 7 + n / 3) % 5 < 2;
  return values;
}

class Segmentation : public ::testing::Test {
 protected:
  Result<LabelFile> read(const test::DicomMasks& masks, DicomPacking packing = DicomPacking::kExplicit) {
    test::write_masks(file_, masks, packing);
    return read_labels(file_, {}, {}, [&](const std::string& message) { warnings_ += message + "\n"; });
  }
  std::string refusal(const test::DicomMasks& masks) {
    const auto labels = read(masks);
    if (labels) return "no error";
    EXPECT_EQ(labels.error().where, file_.string());
    EXPECT_THAT(labels.error().remedy, Not(IsEmpty()));
    return labels.error().what;
  }
  // at slice k along z, on an axial grid
  static test::DicomMasks::Frame frame(int segment, int k, int seed) {
    return {segment, {-10, 20, -30 + k * 1.25}, mask_of(seed)};
  }
  static void expect_mask(const LabelFile& file, LabelId id, int k, int seed) {
    SCOPED_TRACE(k);
    const Segment* segment = file.labels.find(id);
    ASSERT_NE(segment, nullptr);
    const auto& layer = file.labels.layers[static_cast<std::size_t>(segment->layer)];
    const auto mask = mask_of(seed);
    for (int n = 0; n < 35; ++n)
      EXPECT_EQ(layer.at(n % 7, n / 7, k) == segment->value,
                seed >= 0 && mask[static_cast<std::size_t>(n)] != 0)
          << n;
  }

  const test::TemporaryFolder folder_;
  const std::filesystem::path file_ = folder_ / "masks";
  std::string warnings_;
};

TEST_F(Segmentation, FramesInAnyOrderWithEmptyOnesLeftOut) {
  for (const DicomPacking packing : {DicomPacking::kExplicit, DicomPacking::kImplicit,
                                     DicomPacking::kBigEndian, DicomPacking::kDeflated}) {
    SCOPED_TRACE(static_cast<int>(packing));
    test::DicomMasks masks;
    masks.frames = {frame(1, 5, 5), frame(1, 0, 0), frame(1, 2, 2)};
    for (const std::optional<double> declared : {std::optional(1.25), std::optional<double>()}) {
      masks.slice_spacing_mm = declared;
      // without a stated distance, the smallest distance is that between slices
      if (!declared) masks.frames.push_back(frame(1, 3, 3));
      const auto labels = read(masks, packing);
      ASSERT_TRUE(labels) << labels.error().message();
      EXPECT_EQ(labels->labels.geometry().dims, (std::array{7, 5, 6}));
      EXPECT_LT((labels->labels.geometry().origin - Point<Patient>(-10, 20, -30)).norm(), 1e-9);
      EXPECT_LT((labels->labels.geometry().spacing_mm - Eigen::Vector3d(0.5, 0.7, 1.25)).norm(), 1e-9);
      for (const int k : {0, 2, 5}) expect_mask(*labels, 1, k, k);
      for (const int k : {1, 4}) expect_mask(*labels, 1, k, -1);
    }
  }
}

TEST_F(Segmentation, StoresOverlapsInLayersWithANote) {
  test::DicomMasks masks;
  masks.segments = {{7, "one"}, {3, "two"}, {9, "three"}};
  masks.frames = {frame(7, 0, 1), frame(3, 0, 3), frame(9, 1, 4)};
  const auto labels = read(masks);
  ASSERT_TRUE(labels) << labels.error().message();
  EXPECT_EQ(labels->labels.layers.size(), 2u);
  expect_mask(*labels, 7, 0, 1);
  expect_mask(*labels, 3, 0, 3);
  expect_mask(*labels, 9, 1, 4);
  int both = 0;
  for (std::size_t n = 0; n < 35; ++n) both += mask_of(1)[n] && mask_of(3)[n];
  ASSERT_GT(both, 0);
  EXPECT_THAT(warnings_, HasSubstr("segments overlap in " + std::to_string(both) + " voxels"));
}

TEST_F(Segmentation, HalfOfAFractionIsIn) {
  test::DicomMasks masks;
  masks.type = "FRACTIONAL";
  masks.bits = 8;
  masks.most = 200;
  masks.frames = {frame(1, 0, 0)};
  for (std::size_t n = 0; n < 35; ++n) masks.frames[0].values[n] = static_cast<std::uint16_t>(n * 6);
  for (const DicomPacking packing : {DicomPacking::kExplicit, DicomPacking::kRle}) {
    const auto labels = read(masks, packing);
    ASSERT_TRUE(labels) << labels.error().message();
    for (int n = 0; n < 35; ++n) EXPECT_EQ(labels->labels.layers[0].at(n % 7, n / 7, 0), n * 6 >= 100) << n;
    EXPECT_THAT(warnings_, HasSubstr("at half of MaximumFractionalValue"));
  }
}

TEST_F(Segmentation, LabelsAreTheirNumbers) {
  test::DicomMasks masks;
  masks.type = "LABELMAP";
  masks.bits = 16;
  masks.padding = 5;
  masks.segments = {{0, "Background", "125040", "DCM", "Background"}, {300, "bone"}};
  masks.frames = {{0, {0, 0, 0}, mask_of(1)}};
  for (std::uint16_t& value : masks.frames[0].values) value = value ? 300 : 5;
  const auto labels = read(masks);
  ASSERT_TRUE(labels) << labels.error().message();
  ASSERT_EQ(labels->labels.segments.size(), 1u);
  EXPECT_EQ(labels->labels.segments[0].name, "bone");
  expect_mask(*labels, 300, 0, 1);
}

TEST_F(Segmentation, NamesComeFromLabelsAndCodesWithTheirSides) {
  test::DicomMasks masks;
  masks.segments = {{1, "Segment_1", "71341001", "SCT", "Femur", "7771000"},
                    {2, "Femur", "T-12710", "SRT", "Femur", "G-A100"},
                    {3, "right tibia", "12611008", "SCT", "Tibia", "24028007"},
                    {4, "", "38266002", "SCT", "Entire body", ""},
                    {5, "", "", "", "", ""},
                    {6, "Segment_6", "64033007", "SCT", "Ren", "24028007"},
                    {7, "Segment_7", "T-71000", "SNM3", "Kidney", "G-A101"},
                    {8, "L3", "36470004", "SCT", "L3 vertebra", ""},
                    {9, "ROI 9", "99", "99LOCAL", "Medial meniscus", "7771000"},
                    {10, "what he drew", "99", "99LOCAL", "Medial meniscus", ""},
                    // a code of another scheme has another meaning
                    {11, "Segment_11", "64033007", "99LOCAL", "", ""}};
  for (int n = 1; n <= 11; ++n) masks.frames.push_back(frame(n, n, n));
  const auto labels = read(masks);
  ASSERT_TRUE(labels) << labels.error().message();
  std::vector<std::string> names;
  for (const Segment& segment : labels->labels.segments) names.push_back(segment.name);
  EXPECT_THAT(names, ::testing::ElementsAre("femur left", "Femur right", "right tibia", "Entire body",
                                            "segment 5", "kidney right", "kidney left", "vertebra L3",
                                            "Medial meniscus left", "what he drew", "Segment_11"));
}

TEST_F(Segmentation, NamesAreReadInTheirCharacterSet) {
  const auto names = [&](const std::string& set, const std::string& label, const std::string& meaning) {
    test::DicomMasks masks;
    masks.character_set = set;
    masks.segments = {{1, label, "71341001", "SCT", "Femur", ""},
                      {2, "Segment_2", "99", "99LOCAL", meaning, ""}};
    masks.frames = {frame(1, 0, 0), frame(2, 1, 1)};
    const auto labels = read(masks);
    if (!labels) return labels.error().message();
    return labels->labels.segments[0].name + ", " + labels->labels.segments[1].name;
  };
  EXPECT_EQ(names("ISO_IR 100", "F\xE9mur", "M\xE9nisque"), "femur, M\xC3\xA9nisque");
  EXPECT_EQ(names("ISO 2022 IR 100",
                  "Femur \xFC"
                  "ber",
                  "L\xF6"
                  "ffel"),
            "Femur \xC3\xBC"
            "ber, L\xC3\xB6"
            "ffel");
  EXPECT_EQ(names("ISO_IR 192",
                  "Femur \xC3\xBC"
                  "ber",
                  "M\xC3\xA9nisque"),
            "Femur \xC3\xBC"
            "ber, M\xC3\xA9nisque");
  // texts of PS3.5 H and I: Chinese, Japanese and Korean
  EXPECT_EQ(names("GB18030", "Femur \xB9\xC9\xB9\xC7", "\xB9\xC9\xB9\xC7"),
            "Femur \u80A1\u9AA8, \u80A1\u9AA8");
  EXPECT_EQ(names("GBK", "Femur \xB9\xC9", "\xB9\xC9"), "Femur \u80A1, \u80A1");
  EXPECT_EQ(names("\\ISO 2022 IR 87", "Femur \x1B$B4N\x1B(B", "\x1B$B4NB!\x1B(B"),
            "Femur \u809D, \u809D\u81D3");
  EXPECT_EQ(names("\\ISO 2022 IR 149", "Femur \x1B$)C\xB1\xE8", "\x1B$)C\xB1\xE8\xC8\xF1"),
            "Femur \uAE40, \uAE40\uD76C");
  EXPECT_EQ(names("ISO 2022 IR 6\\ISO 2022 IR 58", "Femur \x1B$)A\xB9\xC9", "\x1B$)A\xB9\xC9"),
            "Femur \u80A1, \u80A1");
  EXPECT_EQ(names("ISO 2022 IR 100\\ISO 2022 IR 144", "Femur \xFC\x1B-L\xBA", "\x1B-L\xBA\xDE\xE1\xE2\xEC"),
            "Femur \u00FC\u041A, \u041A\u043E\u0441\u0442\u044C");
  EXPECT_EQ(names("ISO_IR 144", "Femur \xBA", "\xBA\xDE\xE1\xE2\xEC"),
            "Femur \u041A, \u041A\u043E\u0441\u0442\u044C");
  EXPECT_EQ(names("ISO_IR 13", "Femur \xCE\xC8", "\xCE\xC8"), "Femur \uFF8E\uFF88, \uFF8E\uFF88");
  // unreadable text is not a name; the code determines the structure
  EXPECT_EQ(names("ISO_IR 999", "\xB9\xC9\xB9\xC7", "\xB9\xC9\xB9\xC7"), "femur, Segment_2");
  EXPECT_EQ(names("GB18030", "\xB9", "\xFF\xFF"), "femur, Segment_2");
  EXPECT_EQ(names("", "F\xE9mur", "Patella"), "femur, Patella");
}

// Supplement 243 allows PALETTE COLOR, which highdicom writes.
TEST_F(Segmentation, LabelsWithAPaletteHaveItsColours) {
  test::DicomMasks masks;
  masks.type = "LABELMAP";
  masks.bits = 8;
  masks.padding = 0;
  masks.palette = {{0, 0, 0}, {250, 51, 0}, {0, 102, 255}};
  masks.segments = {{1, "Liver"}, {2, "Spleen"}};
  masks.frames = {{0, {0, 0, 0}, mask_of(1)}};
  masks.frames[0].values[0] = 2;
  const auto labels = read(masks);
  ASSERT_TRUE(labels) << labels.error().message();
  ASSERT_EQ(labels->labels.segments.size(), 2u);
  EXPECT_EQ(labels->labels.segments[0].colour, (Rgb{250, 51, 0}));
  EXPECT_EQ(labels->labels.segments[1].colour, (Rgb{0, 102, 255}));
  EXPECT_EQ(labels->labels.layers[0].at(0, 0, 0), 2);
  // in an image a palette means a colour image
  masks.type = "BINARY";
  masks.bits = 1;
  masks.frames[0].segment = 1;
  EXPECT_THAT(refusal(masks), HasSubstr("PhotometricInterpretation (0028,0004)"));
}

TEST_F(Segmentation, PositionsWinOverSpacingBetweenSlices) {
  test::DicomMasks masks;
  masks.frames = {frame(1, 0, 0), frame(1, 1, 1), frame(1, 2, 2)};
  // half the distance, and a non-integer multiple
  for (const double declared : {0.625, 3.0}) {
    masks.slice_spacing_mm = declared;
    warnings_.clear();
    const auto labels = read(masks);
    ASSERT_TRUE(labels) << labels.error().message();
    EXPECT_EQ(labels->labels.geometry().dims, (std::array{7, 5, 3}));
    EXPECT_NEAR(labels->labels.geometry().spacing_mm.z(), 1.25, 1e-9);
    for (const int k : {0, 1, 2}) expect_mask(*labels, 1, k, k);
    EXPECT_THAT(warnings_, HasSubstr("the positions are used"));
  }
}

TEST_F(Segmentation, RoundedPositionsUseTheDeclaredSpacing) {
  test::DicomMasks masks;
  masks.slice_spacing_mm = 1.5;
  for (const double first_mm : {-98.5, -95.5, -97.0}) {
    SCOPED_TRACE(first_mm);
    masks.frames.clear();
    for (const int k : {0, 1, 2, 3, 4, 5, 6}) {
      masks.frames.push_back(frame(1, 0, k));
      masks.frames.back().position[2] = std::nearbyint(first_mm + 1.5 * k);
    }
    const auto labels = read(masks);
    ASSERT_TRUE(labels) << labels.error().message();
    EXPECT_EQ(labels->labels.geometry().dims, (std::array{7, 5, 7}));
    EXPECT_NEAR(labels->labels.geometry().spacing_mm.z(), 1.5, 1e-9);
    EXPECT_NEAR(labels->labels.geometry().origin.z(), first_mm, 0.51);
    for (const int k : {0, 1, 2, 3, 4, 5, 6}) expect_mask(*labels, 1, k, k);
    EXPECT_THAT(warnings_, HasSubstr("positions that are rounded to 1.00 mm"));
  }
}

TEST_F(Segmentation, LiesOnATiltedGantrysGrid) {
  test::DicomMasks masks;
  masks.frames = {frame(1, 0, 0), frame(1, 1, 1), frame(1, 3, 3)};
  for (std::size_t n = 0; n < 3; ++n) masks.frames[n].position[1] += std::array{0.0, 0.3, 0.9}[n];
  const auto labels = read(masks);
  ASSERT_TRUE(labels) << labels.error().message();
  const Point<Patient> last = labels->labels.geometry().X_PatientVoxel() * Point<Voxel>(0, 0, 3);
  EXPECT_LT((last - Point<Patient>(-10, 20.9, -26.25)).norm(), 1e-9);
  for (const int k : {0, 1, 3}) expect_mask(*labels, 1, k, k);
}

TEST_F(Segmentation, AFolderOfFilesIsOneSegmentation) {
  const auto folder = folder_ / "seg";
  std::filesystem::create_directories(folder);
  test::DicomMasks one, two, labels;
  one.segments = two.segments = {{1, "Nodule"}};
  one.frames = {frame(1, 0, 1)};
  two.frames = {frame(1, 0, 3), frame(1, 2, 2)};
  labels.type = "LABELMAP";
  labels.bits = 8;
  labels.segments = {{1, "Liver"}, {2, "Spleen"}};
  labels.frames = {{0, {-10, 20, -28.75}, mask_of(4)}};
  test::write_masks(folder / "a", one);
  test::write_masks(folder / "b", two);
  test::write_masks(folder / "c", labels);
  const auto read = [&] {
    return read_labels(folder, {}, {}, [&](const std::string& message) { warnings_ += message + "\n"; });
  };
  const auto all = read();
  ASSERT_TRUE(all) << all.error().message();
  EXPECT_THAT(
      warnings_,
      HasSubstr("is spread over 3 files of 1 series, which are read as one segmentation with 4 segments"));
  std::vector<std::string> names;
  for (const Segment& segment : all->labels.segments) names.push_back(segment.name);
  EXPECT_THAT(names, ::testing::ElementsAre("Nodule", "Nodule (2)", "Liver", "Spleen"));
  EXPECT_EQ(all->labels.layers.size(), 2u) << "the nodules overlap";
  expect_mask(*all, 1, 0, 1);
  expect_mask(*all, 2, 0, 3);
  expect_mask(*all, 2, 2, 2);
  expect_mask(*all, 3, 1, 4);
  EXPECT_TRUE(is_volume(folder));

  // the parts of a concatenation share their segments
  one.concatenation = two.concatenation = "1.2.9";
  two.frames = {frame(1, 2, 2)};
  test::write_masks(folder / "a", one);
  test::write_masks(folder / "b", two);
  std::filesystem::remove(folder / "c");
  const auto joined = read();
  ASSERT_TRUE(joined) << joined.error().message();
  ASSERT_EQ(joined->labels.segments.size(), 1u);
  expect_mask(*joined, 1, 0, 1);
  expect_mask(*joined, 1, 2, 2);

  // a fault of one file names that file
  std::filesystem::resize_file(folder / "b", std::filesystem::file_size(folder / "b") - 4);
  const auto cut = read();
  ASSERT_FALSE(cut);
  EXPECT_EQ(cut.error().where, (folder / "b").string());
  EXPECT_THAT(cut.error().what, HasSubstr("so it was cut short"));
  EXPECT_THAT(cut.error().remedy, Not(IsEmpty()));
}

TEST_F(Segmentation, RefusesInconsistentSegmentationsWithAReason) {
  test::DicomMasks masks;
  masks.frames = {frame(1, 0, 0), frame(1, 0, 1)};
  EXPECT_THAT(refusal(masks), HasSubstr("has two frames of segment 1 at the same position"));
  masks.frames = {frame(1, 0, 0), frame(2, 1, 1)};
  EXPECT_THAT(refusal(masks), HasSubstr("a segment 2 that it does not define"));
  masks.frames = {frame(1, 0, 0), frame(1, 1, 1), frame(1, 3, 1)};
  masks.frames[2].position[2] += 0.5;
  EXPECT_THAT(refusal(masks), HasSubstr("are not a whole number of slices apart"));
  masks.frames = {frame(1, 0, 0), frame(1, 1, 1)};
  masks.frames[1].position[0] += 0.3;
  EXPECT_THAT(refusal(masks), HasSubstr("frame 2 lies 0.30 mm to the side of the first one"));
  masks.frames = {frame(1, 0, 0)};
  masks.slice_spacing_mm.reset();
  EXPECT_THAT(refusal(masks), HasSubstr("the thickness of its one slice"));
  masks.slice_spacing_mm = 1;
  masks.segments = {{1, "one"}, {1, "two"}};
  EXPECT_THAT(refusal(masks), HasSubstr("SegmentNumber (0062,0004)"));
  test::write_masks(file_, {.frames = {frame(1, 0, 0), frame(1, 1, 1)}});
  std::filesystem::resize_file(file_, std::filesystem::file_size(file_) - 4);
  const auto cut = read_labels(file_);
  ASSERT_FALSE(cut);
  EXPECT_THAT(cut.error().what,
              ::testing::AnyOf(HasSubstr("cut short"), HasSubstr("damaged DICOM segmentation")));
}

// ---- studies ------------------------------------------------------------------------------------

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

TEST(SharedSegmentations, AreTheirMasks) {
  expect_masks("liver.dcm", {"liver_seg.nrrd"});
  expect_masks("23x38x3/seg/label.seg", {"23x38x3/nrrd/label.nrrd"});
  expect_masks("24x38x3/seg/label.seg", {"24x38x3/nrrd/label.nrrd"});
  expect_masks("sparse-labelmap-noppv.dcm", {"sparse_labelmap_noppv_seg.nrrd"});
  expect_masks("sparse-labelmap-ppv5.dcm", {"sparse_labelmap_ppv5_seg.nrrd"});
  expect_masks("partial_overlaps.dcm",
               {"partial_overlaps-1.nrrd", "partial_overlaps-2.nrrd", "partial_overlaps-3.nrrd"}, 3);
}

// ---- structure sets -----------------------------------------------------------------------------

class StructureSet : public Dicom {
 protected:
  StructureSet() {
    write_series([](DicomImage& image, int) {
      image.series = "1.2.3.9753";
      image.texts = {{0x0020, 0x0052, "1.2.5.9753"}};
    });
  }
  // around the centres of the given columns and rows, in a slice
  static test::DicomContours::Contour box(int i0, int i1, int j0, int j1, int k) {
    const double x0 = -10 + (i0 - 0.5) * 0.5, x1 = -10 + (i1 + 0.5) * 0.5, y0 = 20 + (j0 - 0.5) * 0.7,
                 y1 = 20 + (j1 + 0.5) * 0.7, z = -30 + k * kStep_mm;
    return {{{x0, y0, z}, {x1, y0, z}, {x1, y1, z}, {x0, y1, z}}};
  }
  static test::DicomContours two() {
    test::DicomContours contours;
    contours.structures = {{"Femur_L", "", "", "", {box(1, 4, 1, 3, 1), box(1, 4, 1, 3, 2)}},
                           {"roi", "10200004", "SCT", "Liver", {box(4, 6, 0, 4, 2), box(5, 5, 1, 2, 2)}}};
    contours.frame_of_reference = "1.2.5.9753";
    contours.series = "1.2.3.9753";
    return contours;
  }
  Result<LabelFile> labels(const test::DicomContours& contours) {
    test::write_contours(file_, contours);
    return labels();
  }
  Result<LabelFile> labels() {
    const auto grid = read_header(folder_.path());
    EXPECT_TRUE(grid);
    return read_labels(
        file_, {}, {}, [&](const std::string& message) { warnings_ += message + "\n"; },
        AmbiguousLabels::kReject, VoxelCaching::kOff, &grid->geometry);
  }
  std::string refusal(const test::DicomContours& contours) {
    const auto read = labels(contours);
    if (read) return "no error";
    EXPECT_EQ(read.error().where, file_.string());
    EXPECT_THAT(read.error().remedy, Not(IsEmpty()));
    return read.error().what;
  }
  static std::size_t voxels_of(const LabelFile& file, LabelId id) {
    const Segment* segment = file.labels.find(id);
    if (!segment) return 0;
    const auto layer = file.labels.layers[static_cast<std::size_t>(segment->layer)].voxels();
    return static_cast<std::size_t>(std::count(layer.begin(), layer.end(), segment->value));
  }

  const test::TemporaryFolder elsewhere_;
  const std::filesystem::path file_ = elsewhere_ / "structures";
};

TEST_F(StructureSet, NamesAreReadInTheirCharacterSet) {
  auto contours = two();
  contours.character_set = "ISO_IR 100";
  contours.structures[0].name =
      "L\xF6"
      "ffel";
  const auto read = labels(contours);
  ASSERT_TRUE(read) << read.error().message();
  EXPECT_EQ(read->labels.segments[0].name,
            "L\xC3\xB6"
            "ffel");
}

TEST_F(StructureSet, ContoursBecomeLabelsOnTheScansGrid) {
  const auto read = labels(two());
  ASSERT_TRUE(read) << read.error().message();
  EXPECT_EQ(read->header.format, "DICOM structure set");
  EXPECT_TRUE(read->labels.geometry().same_grid(read_header(folder_.path())->geometry));
  ASSERT_EQ(read->labels.segments.size(), 2u);
  EXPECT_EQ(read->labels.segments[0].name, "Femur_L");
  EXPECT_EQ(read->labels.segments[1].name, "liver") << "by its code";
  EXPECT_EQ(read->labels.segments[0].colour, (Rgb{255, 51, 0}));
  EXPECT_EQ(voxels_of(*read, 1), 24u);
  EXPECT_EQ(voxels_of(*read, 2), 13u) << "with a hole of two";
  // they overlap in a column of three voxels, two of which are in the hole's rows and none in its column
  EXPECT_EQ(read->labels.layers.size(), 2u);
  EXPECT_THAT(warnings_, HasSubstr("segments overlap in 3 voxels"));
  EXPECT_EQ(read->labels.layers[0].at(1, 1, 1), 1);
  EXPECT_EQ(read->labels.layers[0].at(0, 1, 1), 0);
  EXPECT_EQ(read->labels.layers[1].at(4, 0, 2), 2);
  EXPECT_EQ(read->labels.layers[1].at(5, 1, 2), 0);
}

TEST_F(StructureSet, ReportsOmittedAndInterpolatedContours) {
  auto contours = two();
  contours.structures.push_back({"point", "", "", "", {{{{-9, 21, -30}}, "POINT"}}});
  contours.structures.push_back({"nothing"});
  contours.structures.push_back({"far", "", "", "", {box(100, 120, 1, 2, 1)}});
  contours.structures.push_back(
      {"beyond",
       "",
       "",
       "",
       {box(5, 20, 5, 5, 0), box(5, 20, 5, 5, 1), box(5, 20, 5, 5, 3), box(5, 20, 5, 5, 4)}});
  contours.structures[0].contours.push_back({{{-9, 21, -30}, {-8, 21, -30}}});
  const auto read = labels(contours);
  ASSERT_TRUE(read) << read.error().message();
  EXPECT_EQ(read->labels.segments.size(), 4u);
  EXPECT_EQ(voxels_of(*read, 6), 15u);
  EXPECT_THAT(warnings_,
              AllOf(HasSubstr("structures without a closed contour, which were left out: point, nothing"),
                    HasSubstr("2 contours are open, points or less than a triangle"),
                    HasSubstr("lacks contours in 1 plane between others"), HasSubstr("are used: beyond"),
                    HasSubstr("extend beyond the scan and are cut off there: beyond"),
                    HasSubstr("lie outside the scan: far")));
}

TEST_F(StructureSet, RejectsInconsistentStructureSetsWithAReason) {
  auto contours = two();
  contours.structures[1].contours[0].declared_points = 5;
  EXPECT_THAT(refusal(contours), HasSubstr("damaged DICOM structure set"));
  for (const char* x : {"1.5x", "one", "1e7", ""}) {
    SCOPED_TRACE(x);
    contours = two();
    contours.structures[1].contours[0].points.resize(3);
    contours.structures[1].contours[0].data = std::string(x) + "\\1\\1\\2\\1\\1\\2\\2\\1";
    EXPECT_THAT(refusal(contours), HasSubstr("damaged DICOM structure set"));
  }
  contours = two();
  contours.structures[1].contours[0].points[1][2] += 3;
  EXPECT_THAT(refusal(contours), HasSubstr("contour 1 of liver is not planar"));
  contours.structures = {{"nothing"}};
  EXPECT_THAT(refusal(contours), HasSubstr("holds no closed contour"));
  // without the scan on which they were drawn
  test::write_contours(file_, two());
  const auto alone = read_labels(file_);
  ASSERT_FALSE(alone);
  EXPECT_THAT(alone.error().what, HasSubstr("is a DICOM structure set (RTSTRUCT)"));
  EXPECT_THAT(alone.error().remedy, HasSubstr("scene new STUDY STRUCTURES"));
}

TEST_F(StructureSet, BelongsToItsScan) {
  test::write_contours(file_, two());
  const auto study = find_study(folder_.path(), file_, {});
  ASSERT_TRUE(study) << study.error().message();
  EXPECT_EQ(study->volume, 1);
  EXPECT_THAT(study->notes, ::testing::ElementsAre(HasSubstr("was made on the series of volume 1")));
  auto other = two();
  other.frame_of_reference = "1.2.6";
  other.series = "1.2.7";
  test::write_contours(file_, other);
  EXPECT_FALSE(find_study(folder_.path(), file_, {}));
}

TEST_F(StructureSet, ContainsNoPatientData) {
  auto contours = two();
  contours.patient = "DOE^CANARY";
  contours.structures[0].contours[0].points[1][2] += 3;
  std::string reported = refusal(contours);
  contours = two();
  contours.patient = "DOE^CANARY";
  ASSERT_TRUE(labels(contours));
  reported += warnings_;
  const auto study = find_study(folder_.path(), file_, {});
  ASSERT_TRUE(study);
  for (const std::string& note : study->notes) reported += note;
  EXPECT_THAT(reported, AllOf(Not(HasSubstr("CANARY")), Not(HasSubstr("9753"))));
}

TEST_F(StructureSet, DamagedOnesAreRefusedOrReadAndNothingElse) {
  constexpr unsigned kSeed = 21;
  SCOPED_TRACE(kSeed);
  std::mt19937 random(kSeed);
  test::write_contours(file_, two());
  const std::string whole = bytes_of(file_);
  int refused = 0;
  for (int n = 0; n < 60; ++n) {
    std::string bytes = whole;
    if (n % 2) {
      bytes.resize(std::uniform_int_distribution<std::size_t>(300, bytes.size())(random));
    } else {
      for (int flips = 0; flips < 1 + n % 4; ++flips) {
        const auto at = std::uniform_int_distribution<std::size_t>(400, bytes.size() - 1)(random);
        bytes[at] = static_cast<char>(bytes[at] ^ (1 << std::uniform_int_distribution<int>(0, 7)(random)));
      }
    }
    std::ofstream(file_, std::ios::binary | std::ios::trunc) << bytes;
    const auto read = labels();
    refused += !read;
    if (read) continue;
    EXPECT_EQ(read.error().where, file_.string()) << n << read.error().message();
  }
  EXPECT_GT(refused, 20);
  EXPECT_LT(refused, 60);
}

// a square from -51 to -27 mm containing a smaller one with cut corners, in the first of two slices
TEST(SharedStructureSets, AreTheirContours) {
  PALPATE_SHARED_FILE(first, "edge/rtstruct/mock_data/ct_1.dcm");
  PALPATE_SHARED_FILE(second, "edge/rtstruct/mock_data/ct_2.dcm");
  PALPATE_SHARED_FILE(structures, "edge/rtstruct/mock_data/rt.dcm");
  const test::TemporaryFolder folder;
  std::filesystem::copy_file(first, folder / "1");
  std::filesystem::copy_file(second, folder / "2");
  const auto study = find_study(folder.path(), structures, {});
  ASSERT_TRUE(study) << study.error().message();
  EXPECT_THAT(study->notes, ::testing::ElementsAre(HasSubstr("was made on volume 1")));
  const auto grid = read_header(folder.path());
  ASSERT_TRUE(grid) << grid.error().message();
  const auto read =
      read_labels(structures, {}, {}, {}, AmbiguousLabels::kReject, VoxelCaching::kOff, &grid->geometry);
  ASSERT_TRUE(read) << read.error().message();
  const auto& layer = read->labels.layers.at(0);
  const double spacing_mm = grid->geometry.spacing_mm.x();
  const int low = static_cast<int>(std::ceil((125 - 51) / spacing_mm)),
            high = static_cast<int>(std::floor((125 - 27) / spacing_mm)),
            middle = static_cast<int>(std::lround((125 - 39) / spacing_mm));
  for (const auto& [i, j, in] : {std::tuple{low, low, 1},
                                 {high, high, 1},
                                 {low, high, 1},
                                 {low - 1, low, 0},
                                 {high + 1, high, 0},
                                 {low, high + 1, 0},
                                 {middle, middle, 0},
                                 {middle, low + 3, 1}})
    EXPECT_EQ(layer.at(i, j, 0), in) << i << ", " << j;
  EXPECT_EQ(layer.at(low, low, 1), 0);
}

// Seeds of dicom_fuzzer. PALPATE_WRITE_SEEDS=src/files/volume_io/dicom_fuzzer_corpus writes them again.
TEST(DicomSeeds, AreUnderstood) {
  const std::filesystem::path folder =
      std::filesystem::path(PALPATE_SOURCE_DIR) / "src/files/volume_io/dicom_fuzzer_corpus";
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
