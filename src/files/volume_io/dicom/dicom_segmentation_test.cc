#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <optional>
#include <set>

#include "volume_io/dicom/test_dicom_series.h"

namespace palpate {
namespace {

using test::DicomPacking;
using test::mask_of;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

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

TEST(SharedSegmentations, AreTheirMasks) {
  expect_masks("liver.dcm", {"liver_seg.nrrd"});
  expect_masks("23x38x3/seg/label.seg", {"23x38x3/nrrd/label.nrrd"});
  expect_masks("24x38x3/seg/label.seg", {"24x38x3/nrrd/label.nrrd"});
  expect_masks("sparse-labelmap-noppv.dcm", {"sparse_labelmap_noppv_seg.nrrd"});
  expect_masks("sparse-labelmap-ppv5.dcm", {"sparse_labelmap_ppv5_seg.nrrd"});
  expect_masks("partial_overlaps.dcm",
               {"partial_overlaps-1.nrrd", "partial_overlaps-2.nrrd", "partial_overlaps-3.nrrd"}, 3);
}

}  // namespace
}  // namespace palpate
