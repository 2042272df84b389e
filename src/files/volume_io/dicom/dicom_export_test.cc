#include "palpate/volume_io/dicom_export.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sys/resource.h>

#include <algorithm>
#include <csignal>
#include <fstream>
#include <random>
#include <set>

#include "base/test_files.h"
#include "base/test_seed.h"
#include "palpate/volume_io/identifiers.h"
#include "palpate/volume_io/volume_io.h"
#include "volume_io/dicom/test_dicom.h"

namespace palpate {
namespace {

using test::TemporaryFolder;
using ::testing::HasSubstr;

GridGeometry oblique_export_grid(bool left_handed) {
  GridGeometry grid;
  grid.dims = {19, 14, 11};
  grid.spacing_mm = {0.7, 0.9, 2.1};
  grid.direction = Eigen::AngleAxisd(0.5, Eigen::Vector3d(2, 1, -1).normalized()).toRotationMatrix();
  if (left_handed) grid.direction.col(2) *= -1;
  grid.origin = Point<Patient>(-31.25, 12.5, 99.75);
  return grid;
}

// three overlapping segments, in layers; one only in the middle slices, one without voxels
LabelMap overlapping_labels(bool left_handed) {
  std::mt19937 random(test::test_seed());
  const GridGeometry grid = oblique_export_grid(left_handed);
  LabelMap labels;
  labels.layers.assign(2, Volume<LabelId>(grid));
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        if (k >= 3 && k < 7 && random() % 2) labels.layers[0].at(i, j, k) = 5;
        if (k >= 2 && labels.layers[0].at(i, j, k) == 0 && random() % 3 == 0)
          labels.layers[0].at(i, j, k) = 9;
        if (k >= 1 && k < 9 && random() % 4 == 0) labels.layers[1].at(i, j, k) = 2;
      }
  labels.segments = {{2, "my lesion", {250, 10, 20}, 1, 2},
                     {5, "femur_left", {241, 214, 145}, 0, 5},
                     {7, "nothing", {1, 2, 3}, 0, 7},
                     {9, "liver", {221, 130, 101}, 0, 9}};
  return labels;
}

bool is_in(const LabelMap& labels, const std::string& name, int i, int j, int k) {
  const Segment* segment = labels.find(name);
  return labels.layers[static_cast<std::size_t>(segment->layer)].at(i, j, k) == segment->value;
}

TEST(DicomExport, ASegmentationReadsBackAsItWas) {
  for (const bool left_handed : {false, true}) {
    const TemporaryFolder folder;
    const LabelMap labels = overlapping_labels(left_handed);
    const auto written = write_dicom_segmentation(folder / "out.dcm", labels);
    ASSERT_TRUE(written) << written.error().message();
    const auto back = read_labels(folder / "out.dcm");
    ASSERT_TRUE(back) << back.error().message();
    ASSERT_EQ(back->labels.segments.size(), 3u);
    const GridGeometry &grid = labels.geometry(), &again = back->labels.geometry();
    ASSERT_EQ(again.dims, grid.dims);
    for (const std::string name : {"my lesion", "femur_left", "liver"}) {
      const Segment* segment = back->labels.find(name);
      ASSERT_NE(segment, nullptr) << name;
      const Rgb was = labels.find(name)->colour;
      EXPECT_NEAR(segment->colour.r, was.r, 1);
      EXPECT_NEAR(segment->colour.g, was.g, 1);
      EXPECT_NEAR(segment->colour.b, was.b, 1);
      for (int k = 0; k < grid.dims[2]; ++k)
        for (int j = 0; j < grid.dims[1]; ++j)
          for (int i = 0; i < grid.dims[0]; ++i) {
            const int there = left_handed ? grid.dims[2] - 1 - k : k;
            ASSERT_EQ(is_in(back->labels, name, i, j, there), is_in(labels, name, i, j, k)) << name;
          }
    }
    const Point<Patient> corner = grid.X_PatientVoxel() * Point<Voxel>(18, 13, 10),
                         corner_again = again.X_PatientVoxel() * Point<Voxel>(18, 13, left_handed ? 0 : 10);
    EXPECT_LT((corner.eigen() - corner_again.eigen()).norm(), 1e-6);
  }
}

TEST(DicomExport, EveryObjectHasIdentifiersOfItsOwnAndNoPatient) {
  const TemporaryFolder folder;
  const LabelMap labels = overlapping_labels(false);
  std::set<std::string> uids;
  std::size_t several = 0;
  for (const char* name : {"a.dcm", "b.dcm"}) {
    ASSERT_TRUE(write_dicom_segmentation(folder / name, labels));
    const auto report = find_identifiers(folder / name, true);
    ASSERT_TRUE(report) << report.error().message();
    for (const IdentifierRow& row : report->rows) {
      EXPECT_NE(row.kind, IdentifierKind::kName) << row.what;
      EXPECT_NE(row.kind, IdentifierKind::kPatient) << row.what;
      EXPECT_NE(row.kind, IdentifierKind::kPrivate) << row.what;
      EXPECT_NE(row.kind, IdentifierKind::kInstitution) << row.what;
      // dates of the export only
      EXPECT_TRUE(row.kind != IdentifierKind::kDate || row.what.starts_with("Content")) << row.what;
      if (row.what.starts_with("SOPInstanceUID") || row.what.starts_with("StudyInstanceUID") ||
          row.what.starts_with("FrameOfReferenceUID")) {
        EXPECT_TRUE(row.example.starts_with("2.25.")) << row.example;
        EXPECT_LE(row.example.size(), 64u);
        uids.insert(row.example);
        ++several;
      }
    }
  }
  EXPECT_EQ(several, 6u);
  EXPECT_EQ(uids.size(), several);
}

TEST(DicomExport, RejectsLabelsThatSegCannotRepresent) {
  const TemporaryFolder folder;
  LabelMap labels = overlapping_labels(false);
  GridGeometry sheared = labels.geometry();
  sheared.direction.col(1) = (sheared.direction.col(1) + 0.2 * sheared.direction.col(0)).normalized();
  LabelMap tilted = labels;
  for (auto& layer : tilted.layers) layer = Volume<LabelId>(sheared, layer.voxels());
  const auto refused = write_dicom_segmentation(folder / "out.dcm", tilted);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message(), HasSubstr("orthogonal"));
  labels.segments = {{7, "nothing", {1, 2, 3}, 0, 7}};
  EXPECT_FALSE(write_dicom_segmentation(folder / "out.dcm", labels));
  EXPECT_FALSE(std::filesystem::exists(folder / "out.dcm"));
}

TEST(DicomExport, APictureIsASecondaryCapture) {
  const TemporaryFolder folder;
  std::vector<std::uint8_t> rgb(3 * 7 * 5);
  for (std::size_t n = 0; n < rgb.size(); ++n) rgb[n] = static_cast<std::uint8_t>(2 * n);
  ASSERT_TRUE(write_secondary_capture(folder / "picture.dcm", 7, 5, rgb, "Section"));
  const auto report = find_identifiers(folder / "picture.dcm", true);
  ASSERT_TRUE(report) << report.error().message();
  // the pixels have not been examined for annotations
  EXPECT_EQ(report->burnt_in_unstated, 1u);
  const bool marked = std::ranges::any_of(report->rows, [](const IdentifierRow& row) {
    return row.example.find("Not for clinical use") != std::string::npos;
  });
  EXPECT_TRUE(marked);
  const std::string bytes = test::bytes_of_file(folder / "picture.dcm");
  EXPECT_NE(bytes.find(std::string("\x28\0\x10\0US\2\0\5\0", 10)), std::string::npos) << "rows";
  EXPECT_NE(bytes.find(std::string("\x28\0\x11\0US\2\0\7\0", 10)), std::string::npos) << "columns";
  std::string pixels(rgb.begin(), rgb.end());
  pixels += '\0';
  EXPECT_TRUE(bytes.ends_with(pixels));
}

// fails as a full disk does
TEST(DicomExport, FailedWritesLeaveNoFile) {
  const TemporaryFolder folder;
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit little{800, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &little), 0);
  const std::vector<std::uint8_t> rgb(3 * 30 * 20, 7);
  const auto written = write_secondary_capture(folder / "picture.dcm", 30, 20, rgb, "Section");
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
  std::signal(SIGXFSZ, handler);
  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().kind, ErrorKind::kOutput) << written.error().message();
  EXPECT_FALSE(std::filesystem::exists(folder / "picture.dcm"));
}

// ---- patient identity ---------------------------------------------------------------------------

void write_study_of(const std::filesystem::path& folder, const std::string& set, const std::string& name) {
  for (int k = 0; k < 4; ++k) {
    test::DicomImage image;
    image.frames[0].position = {0, 0, 1.0 * k};
    image.frames[0].stored.assign(48, static_cast<std::uint16_t>(k));
    image.texts = {{0x0010, 0x0010, name}};
    if (!set.empty()) image.texts.push_back({0x0008, 0x0005, set});
    test::write_dicom(folder / ("IM" + std::to_string(k)), image);
  }
}

TEST(DicomExport, NamesAreEncodedExactlyOrRejected) {
  const LabelMap labels = overlapping_labels(false);
  const auto name_in = [&](const std::string& set, const std::string& name) {
    const TemporaryFolder folder;
    std::filesystem::create_directory(folder / "study");
    write_study_of(folder / "study", set, name);
    const auto written =
        write_dicom_segmentation(folder / "out.dcm", labels, DicomAttachment{folder / "study", {}});
    if (!written) return written.error().message();
    const auto report = find_identifiers(folder / "out.dcm", true);
    if (!report) return report.error().message();
    for (const IdentifierRow& row : report->rows)
      if (row.what.starts_with("PatientName")) return row.example;
    return std::string("no name");
  };
  EXPECT_EQ(name_in("", "Doe^John"), "Doe^John");
  EXPECT_EQ(name_in("ISO_IR 100", "M\xFCller^J"), "M\xC3\xBCller^J");
  EXPECT_EQ(name_in("ISO_IR 192", "M\xC3\xBCller^J"), "M\xC3\xBCller^J");
  EXPECT_THAT(name_in("", "M\xFCller^J"), HasSubstr("character set that cannot be converted"));
  // requires DCMTK and its tables: "Lyuks" in Cyrillic
  EXPECT_THAT(name_in("ISO_IR 144", "\xBB\xEE\xDA\xE1"),
              ::testing::AnyOf(HasSubstr("\xD0\x9B\xD1\x8E\xD0\xBA\xD1\x81"),
                               HasSubstr("character set that cannot be converted")));
}

TEST(DicomExport, ALongNameIsNotCutWithinALetter) {
  const TemporaryFolder folder;
  LabelMap labels = overlapping_labels(false);
  labels.segments[0].name = std::string(63, 'a') + "\xC3\xA9";
  ASSERT_TRUE(write_dicom_segmentation(folder / "out.dcm", labels));
  const auto back = read_labels(folder / "out.dcm");
  ASSERT_TRUE(back) << back.error().message();
  EXPECT_NE(back->labels.find(std::string(63, 'a')), nullptr);
}

TEST(DicomIdentifiers, AreListedByKindAndTag) {
  const TemporaryFolder folder;
  test::DicomImage image;
  image.frames[0].stored.assign(48, 3);
  image.texts = {{0x0008, 0x0054, "SCANNER1"},  {0x0008, 0x0201, "+0100"},  {0x0010, 0x2299, "a firm"},
                 {0x0012, 0x0040, "subject 7"}, {0x0040, 0x0010, "room 3"}, {0x0040, 0x0512, "jar 9"}};
  test::write_dicom(folder / "one.dcm", image);
  {
    // an empty private sequence after the pixels
    std::ofstream more(folder / "one.dcm", std::ios::binary | std::ios::app);
    more << std::string("\xE1\x7F\x01\x10SQ\0\0\0\0\0\0", 12);
  }
  const auto report = find_identifiers(folder / "one.dcm", true);
  ASSERT_TRUE(report) << report.error().message();
  std::vector<std::pair<IdentifierKind, std::string>> order;
  std::string all;
  for (const IdentifierRow& row : report->rows) {
    order.emplace_back(row.kind, row.what.substr(row.what.rfind('(')));
    all += row.what + "\n";
  }
  EXPECT_TRUE(std::ranges::is_sorted(order)) << all;
  for (const char* what : {"(0008,0054)", "(0008,0201)", "(0010,2299)", "(0012,0040)", "(0040,0010)",
                           "(0040,0512)", "private (7fe1,1001)"})
    EXPECT_THAT(all, HasSubstr(what));
}

}  // namespace
}  // namespace palpate
