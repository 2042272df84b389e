#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <random>
#include <tuple>

#include "volume_io/dicom/test_dicom_series.h"

namespace palpate {
namespace {

using test::bytes_of;
using test::Dicom;
using test::DicomImage;
using test::kStep_mm;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

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

}  // namespace
}  // namespace palpate
