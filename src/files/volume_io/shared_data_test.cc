#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "base/test_files.h"
#include "palpate/volume_io/volume_io.h"
#include "volume_io/formats/itk_oracle.h"

/// Shared data sets as described by their README, and ITK's own reader as a reference for every voxel.
namespace palpate {
namespace {

using volume_io::ItkFormat;

ItkFormat itk_format(const std::string& name) {
  return name.find(".nii") != std::string::npos ? ItkFormat::kNifti : ItkFormat::kNrrd;
}

void expect_voxels_of_itk(const std::filesystem::path& file) {
  const auto scan = read_scan(file);
  ASSERT_TRUE(scan) << scan.error().message();
  const auto oracle = testing::itk_voxels(itk_format(file.filename().string()), file);
  ASSERT_TRUE(oracle);
  ASSERT_EQ(scan->scan.voxels().size(), oracle->size());
  std::size_t different = 0;
  for (std::size_t n = 0; n < oracle->size(); ++n)
    different += scan->scan.voxels()[n] != static_cast<float>((*oracle)[n]);
  EXPECT_EQ(different, 0u);
}

const SegmentStatistics& one(const std::vector<SegmentStatistics>& all, LabelId id) {
  for (const SegmentStatistics& s : all)
    if (s.id == id) return s;
  throw std::out_of_range("no label " + std::to_string(id));
}

TEST(SharedData, KneeOfTheAtlas) {
  PALPATE_SHARED_FILE(file, "knee_spl/seg.nrrd");
  const auto labels = read_labels(file);
  ASSERT_TRUE(labels) << labels.error().message();
  const GridGeometry& g = labels->labels.geometry();
  EXPECT_EQ(g.dims, (std::array{512, 512, 119}));
  EXPECT_LT((g.spacing_mm - Eigen::Vector3d(0.27734, 0.27734, 1)).norm(), 1e-5);
  EXPECT_FALSE(g.right_handed());
  EXPECT_EQ(labels->header.component_type, "int16");
  EXPECT_EQ(labels->labels.segments.size(), 49u);
  EXPECT_EQ(labels->unnamed, (std::vector<LabelId>{3}));
  EXPECT_EQ(empty_slices(labels->labels), (std::vector<int>{0, 118}));
  EXPECT_EQ(labels->labels.find("femur")->id, 95);
  EXPECT_EQ(labels->labels.find("femur")->colour, (Rgb{197, 189, 177}));

  const auto statistics = segment_statistics(labels->labels);
  EXPECT_EQ(statistics.size(), 49u);
  EXPECT_EQ(one(statistics, 3).voxels, 1531u);
  EXPECT_EQ(one(statistics, 96).components, 22);
  EXPECT_EQ(one(statistics, 96).voxels - one(statistics, 96).largest_component_voxels, 34u);
  // a left knee: the fibula lies to the patient's left (+x) of the tibia, the patella in front (-y)
  EXPECT_GT(one(statistics, 97).centroid.x(), one(statistics, 96).centroid.x() + 10);
  EXPECT_LT(one(statistics, 98).centroid.y(), one(statistics, 95).centroid.y() - 10);
  expect_voxels_of_itk(file);
}

TEST(SharedData, KneeWithPermutedObliqueAxes) {
  PALPATE_SHARED_FILE(file, "knee_dess/SAG_3D_DESS_RIGHT_bones_cart_men_fib-label.nrrd");
  const auto labels = read_labels(file);
  ASSERT_TRUE(labels) << labels.error().message();
  const GridGeometry& g = labels->labels.geometry();
  EXPECT_EQ(g.dims, (std::array{384, 384, 160}));
  EXPECT_LT((g.spacing_mm - Eigen::Vector3d(0.364583, 0.364583, 0.7)).norm(), 1e-5);
  EXPECT_EQ(labels->labels.segments.size(), 10u);
  EXPECT_TRUE(labels->unnamed.empty());
  // a right knee: the fibula lies to the right (-x) of the tibia, and the femur above (+z)
  const auto statistics = segment_statistics(labels->labels);
  const auto at = [&](const char* name) { return one(statistics, labels->labels.find(name)->id).centroid; };
  EXPECT_LT(at("fibula").x(), at("tibia").x() - 10);
  EXPECT_GT(at("femur").z(), at("tibia").z() + 30);
  EXPECT_LT(at("patella").y(), at("femur").y() - 10);
}

TEST(SharedData, TorsoScanAndItsLabelsLieOnOneGrid) {
  PALPATE_SHARED_FILE(scan_file, "torso_ct/example_ct_sm.nii.gz");
  PALPATE_SHARED_FILE(label_file, "torso_ct/example_seg.nii.gz");
  const auto scan = read_scan(scan_file);
  const auto labels = read_labels(label_file);
  ASSERT_TRUE(scan && labels);
  EXPECT_EQ(scan->scan.geometry().dims, (std::array{122, 101, 30}));
  EXPECT_EQ(scan->scan.geometry().spacing_mm, Eigen::Vector3d(3, 3, 3));
  EXPECT_TRUE(scan->scan.geometry().same_grid(labels->labels.geometry()));
  EXPECT_EQ(labels->labels.segments.size(), 41u);
  // from the label table that TotalSegmentator writes into the header
  EXPECT_TRUE(labels->unnamed.empty());
  EXPECT_EQ(labels->name_source, NameSource::kFile);
  EXPECT_NE(labels->labels.find("liver"), nullptr);
  expect_voxels_of_itk(scan_file);
  expect_voxels_of_itk(label_file);
}

TEST(SharedData, LabelsOfDicomSegmentations) {
  const std::map<std::string, std::map<LabelId, std::size_t>> voxels{
      {"heart_seg", {{3, 41449}}},
      {"liver_seg", {{1, 107098}}},
      {"liver_spine_gapped_seg", {{1, 107098}, {5, 12439}}},
      {"liver_spine_seg", {{1, 107098}, {2, 12439}}},
      {"partial_overlaps-1", {{1, 9602}, {4, 6693}, {5, 4713}}},
      {"partial_overlaps-2", {{2, 11888}}},
      {"partial_overlaps-3", {{3, 10743}}},
      {"spine_seg", {{2, 12439}}},
      {"spine_seg_label5", {{5, 12439}}},
      {"sparse_labelmap_noppv_seg", {{1, 630}}},
      {"sparse_labelmap_ppv5_seg", {{1, 630}, {5, 912}}}};
  for (const auto& [name, expected] : voxels) {
    SCOPED_TRACE(name);
    PALPATE_SHARED_FILE(file, "dicom_seg/" + name + ".nrrd");
    const auto labels = read_labels(file);
    ASSERT_TRUE(labels) << labels.error().message();
    std::map<LabelId, std::size_t> found;
    for (const SegmentStatistics& s : segment_statistics(labels->labels)) found[s.id] = s.voxels;
    EXPECT_EQ(found, expected);
    const bool sparse = name.find("sparse") == 0;
    EXPECT_EQ(labels->labels.geometry().dims, (sparse ? std::array{24, 38, 3} : std::array{512, 512, 3}));
    EXPECT_TRUE(labels->labels.geometry().right_handed());
    expect_voxels_of_itk(file);
  }
}

// Dimensions, spacing and the LPS position of the last voxel, which depends on origin and directions, from
// nibabel.
TEST(SharedData, NiftiOfEveryKindHasTheGeometryThatNibabelSees) {
  struct Expected {
    std::string name;
    std::array<int, 3> dims;
    Eigen::Vector3d spacing_mm;
    Point<Patient> last;
  };
  for (const Expected& e : {
           Expected{"nifti/big.nii.gz", {64, 64, 21}, {4, 4, 6}, {252, -252, 120}},
           Expected{"nifti/little.nii.gz", {64, 64, 21}, {4, 4, 6}, {252, -252, 120}},
           Expected{"nifti/niivue_low_res.nii.gz", {7, 5, 3}, {2, 2, 2}, {-12, -8, 4}},
           Expected{"nifti/with_extension.nii.gz", {161, 191, 151}, {1, 1, 1}, {80, 110, -65}},
           Expected{"nrrd_pynrrd/BallBinary30x30x30.nii.gz", {30, 30, 30}, {1, 1, 1}, {29, 29, 29}},
           Expected{"dicom/anatomical/001_ground_truth.nii.gz",
                    {256, 256, 4},
                    {1, 1, 1},
                    {-100.7942, 93.9253, -124.9487}},
           Expected{"dicom/anatomical/001_implicit_ground_truth.nii.gz",
                    {256, 256, 4},
                    {1, 1, 1},
                    {-100.7942, 93.9253, -124.9487}},
           Expected{"dicom/compressed_jpegls/001_ground_truth.nii.gz",
                    {256, 256, 4},
                    {1, 1, 1},
                    {-100.7942, 93.9253, -124.9487}},
           Expected{"dicom/slicecount/001_ground_truth.nii.gz",
                    {256, 256, 2},
                    {1, 1, 1},
                    {-102.7942, 93.9253, -124.9487}},
       }) {
    SCOPED_TRACE(e.name);
    PALPATE_SHARED_FILE(file, "edge/" + e.name);
    const auto header = read_header(file);
    ASSERT_TRUE(header) << header.error().message();
    const GridGeometry& g = header->geometry;
    EXPECT_EQ(g.dims, e.dims);
    EXPECT_LT((g.spacing_mm - e.spacing_mm).norm(), 1e-4);
    EXPECT_TRUE(header->has_geometry);
    const Point<Patient> last =
        g.X_PatientVoxel() * Point<Voxel>(g.dims[0] - 1, g.dims[1] - 1, g.dims[2] - 1);
    EXPECT_LT((last - e.last).norm(), 1e-3) << last.eigen().transpose();
    expect_voxels_of_itk(file);
  }
}

TEST(SharedData, ByteOrderDoesNotChangeAVoxel) {
  PALPATE_SHARED_FILE(big, "edge/nifti/big.nii.gz");
  PALPATE_SHARED_FILE(little, "edge/nifti/little.nii.gz");
  EXPECT_EQ(read_scan(big)->scan.voxels(), read_scan(little)->scan.voxels());
}

TEST(SharedData, ReadsNiftiWithoutGeometryWithANote) {
  PALPATE_SHARED_FILE(file, "edge/nifti/niivue_minimal.nii.gz");
  const auto scan = read_scan(file);
  ASSERT_TRUE(scan) << scan.error().message();
  EXPECT_EQ(scan->scan.geometry().dims, (std::array{64, 64, 10}));
  EXPECT_EQ(scan->scan.geometry().spacing_mm, Eigen::Vector3d(3, 3, 3));
  EXPECT_FALSE(scan->header.has_geometry);
}

TEST(SharedData, ObliqueNonIsotropicGroundTruth) {
  PALPATE_SHARED_FILE(file, "edge/dicom/anatomical/002_non_isotropic_ground_truth.nii.gz");
  const auto header = read_header(file);
  ASSERT_TRUE(header) << header.error().message();
  EXPECT_EQ(header->geometry.dims, (std::array{64, 28, 4}));
  EXPECT_LT((header->geometry.spacing_mm - Eigen::Vector3d(6.4, 4, 0.5)).norm(), 1e-4);
  EXPECT_LT((header->geometry.origin - Point<Patient>(-83.4297, -132.1349, -143.9253)).norm(), 1e-3);
  EXPECT_TRUE(header->geometry.right_handed());
  expect_voxels_of_itk(file);
}

TEST(SharedData, EveryWayToStoreTheBallGivesTheSameBall) {
  PALPATE_SHARED_FILE(reference, "edge/nrrd_pynrrd/BallBinary30x30x30.nrrd");
  const auto ball = read_scan(reference);
  ASSERT_TRUE(ball);
  EXPECT_EQ(std::count(ball->scan.voxels().begin(), ball->scan.voxels().end(), 257.0f), 14328);
  for (const char* name : {".nhdr", "_byteskip_minus_one.nhdr", "_byteskip_minus_one_nifti.nhdr", "_bz2.nrrd",
                           "_gz.nrrd", "_gz_byteskip_minus_one.nrrd", "_gz_lineskip.nrrd", ".nii.gz"}) {
    SCOPED_TRACE(name);
    PALPATE_SHARED_FILE(file, "edge/nrrd_pynrrd/BallBinary30x30x30" + std::string(name));
    const auto other = read_scan(file);
    ASSERT_TRUE(other) << other.error().message();
    EXPECT_EQ(other->scan.voxels(), ball->scan.voxels());
    EXPECT_TRUE(other->scan.geometry().same_grid(ball->scan.geometry()));
  }
}

TEST(SharedData, ASliceWrittenAsTextIsRead) {
  PALPATE_SHARED_FILE(file, "edge/nrrd_pynrrd/test2d_ascii.nrrd");
  const auto scan = read_scan(file);
  ASSERT_TRUE(scan) << scan.error().message();
  EXPECT_EQ(scan->scan.geometry().dims, (std::array{3, 9, 1}));
  for (std::size_t n = 0; n < 27; ++n) EXPECT_EQ(scan->scan.voxels()[n], static_cast<float>(n + 1));
}

TEST(SharedData, UnreadableFilesHaveAReason) {
  const std::map<std::string, std::string> reasons{
      {"nrrd_truncated/abdomen_ct_TRUNCATED_gzip.nrrd", "the voxel data end after 52 of 113 slices"},
      {"nrrd_pynrrd/BallBinary30x30x30_byteskip_minus_five.nhdr",
       "requires 54004 bytes of voxel data, but there are 54000"},
      {"nrrd_pynrrd/BallBinary30x30x30_nifti.nhdr", "holds more voxel data than stated in its header"},
      {"nrrd_pynrrd/test1d_ascii.nrrd", "has 1 axis"},
      {"nrrd_pynrrd/test_customFields.nrrd", "has 1 axis"},
      {"nrrd_pynrrd/test_simple4d_raw.nrrd", "axis 4 has no space direction"},
      {"nrrd_pynrrd/BallBinary30x30x30.raw", "has an unsupported format"},
      {"nifti/not-nifti.nii", "is not a NIfTI file"}};
  for (const auto& [name, reason] : reasons) {
    SCOPED_TRACE(name);
    PALPATE_SHARED_FILE(file, "edge/" + name);
    const auto scan = read_scan(file);
    ASSERT_FALSE(scan);
    EXPECT_EQ(scan.error().kind, ErrorKind::kBadInput);
    EXPECT_NE(scan.error().what.find(reason), std::string::npos) << scan.error().message();
    EXPECT_FALSE(scan.error().remedy.empty());
    EXPECT_FALSE(read_labels(file));
  }
}

TEST(SharedData, AbdomenIsNamedByTheTableInItsFolder) {
  PALPATE_SHARED_FILE(file, "edge/nrrd_truncated/abdomen_seg.nrrd");
  const auto labels = read_labels(file);
  ASSERT_TRUE(labels) << labels.error().message();
  EXPECT_EQ(labels->labels.segments.size(), 95u);
  EXPECT_EQ(labels->unnamed, (std::vector<LabelId>{699}));
  EXPECT_EQ(labels->labels.find("liver")->id, 3);
  EXPECT_EQ(labels->labels.geometry().dims, (std::array{256, 256, 113}));
  EXPECT_TRUE(labels->labels.geometry().right_handed());
  expect_voxels_of_itk(file);
}

}  // namespace
}  // namespace palpate
