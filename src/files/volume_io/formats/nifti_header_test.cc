#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "volume_io/formats/headers.h"

namespace palpate::volume_io {
namespace {

// little-endian header of 4 x 3 x 2 int16 voxels with a qform
struct Bytes {
  std::string text = std::string(352, '\0');

  Bytes() {
    put<std::int32_t>(0, 348);
    const std::int16_t dims[] = {3, 4, 3, 2, 1, 1, 1, 1};
    for (std::size_t a = 0; a < 8; ++a) put<std::int16_t>(40 + 2 * a, dims[a]);
    put<std::int16_t>(70, 4);
    put<std::int16_t>(72, 16);
    for (std::size_t a = 0; a < 4; ++a) put<float>(76 + 4 * a, 1);
    put<float>(108, 352);
    text[123] = 2;
    put<std::int16_t>(252, 1);
    std::memcpy(text.data() + 344, "n+1", 4);
  }
  template <class T>
  Bytes& put(std::size_t at, T value) {
    std::memcpy(text.data() + at, &value, sizeof value);
    return *this;
  }
};

TEST(NiftiHeader, ReadsSizesTypeAndScale) {
  const auto header = parse_nifti_header(Bytes().put<float>(112, 2).put<float>(116, -5).text, "x");
  ASSERT_TRUE(header) << header.error().message();
  EXPECT_EQ(header->axes, (std::vector<std::int64_t>{4, 3, 2}));
  EXPECT_EQ(header->voxels.component, Component::kInt16);
  EXPECT_FALSE(header->voxels.big_endian);
  EXPECT_EQ(header->voxels.skip, 352u);
  EXPECT_EQ(header->voxels.slope, 2);
  EXPECT_EQ(header->voxels.intercept, -5);
  EXPECT_TRUE(header->has_geometry);
  EXPECT_FALSE(header->affine);
}

TEST(NiftiHeader, ASlopeOfZeroOrOfNoNumberMeansUnscaled) {
  for (const float slope : {0.0f, std::numeric_limits<float>::quiet_NaN()}) {
    const auto header = parse_nifti_header(Bytes().put<float>(112, slope).put<float>(116, 7).text, "x");
    ASSERT_TRUE(header);
    EXPECT_EQ(header->voxels.slope, 1);
    EXPECT_EQ(header->voxels.intercept, 0);
  }
}

TEST(NiftiHeader, VoxelSizesMayBeMissingWhereAnSformHoldsThem) {
  Bytes bytes;
  bytes.put<float>(84, 0);
  EXPECT_FALSE(parse_nifti_header(bytes.text, "x"));
  bytes.put<std::int16_t>(254, 1).put<float>(280, 2).put<float>(300, 3).put<float>(320, 4);
  const auto header = parse_nifti_header(bytes.text, "x");
  ASSERT_TRUE(header) << header.error().message();
  EXPECT_EQ((*header->affine)(1, 1), 3);
}

TEST(NiftiHeader, WithoutAFormItHasNoGeometry) {
  EXPECT_FALSE(parse_nifti_header(Bytes().put<std::int16_t>(252, 0).text, "x")->has_geometry);
}

TEST(NiftiHeader, RejectsInvalidHeaders) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const std::string& bad :
       {std::string(), Bytes().text.substr(0, 347), Bytes().put<std::int32_t>(0, 540).text,
        Bytes().put<std::int32_t>(0, 0).text, Bytes().put<std::int32_t>(344, 0).text,
        Bytes().put<std::int16_t>(40, 0).text, Bytes().put<std::int16_t>(40, 8).text,
        Bytes().put<std::int16_t>(70, 128).text, Bytes().put<std::int16_t>(72, 8).text,
        Bytes().put<float>(108, nan).text, Bytes().put<float>(108, -1).text, Bytes().put<float>(80, nan).text,
        Bytes().put<float>(88, -1).text, Bytes().put<float>(268, nan).text,
        Bytes().put<std::int16_t>(254, 1).put<float>(280, nan).text, Bytes().put<char>(123, 3).text,
        Bytes().put<char>(123, 1).text}) {
    const auto header = parse_nifti_header(bad, "x.nii");
    ASSERT_FALSE(header);
    EXPECT_EQ(header.error().where, "x.nii");
  }
}

TEST(NiftiHeader, IntentDeterminesTheMeaning) {
  for (const auto& [code, meaning] : {std::pair{0, ValueMeaning::kUnspecified},
                                      {1002, ValueMeaning::kLabels},
                                      {1003, ValueMeaning::kLabels},
                                      {3, ValueMeaning::kMeasured},
                                      {1001, ValueMeaning::kMeasured},
                                      {1007, ValueMeaning::kMeasured}})
    EXPECT_EQ(
        parse_nifti_header(Bytes().put<std::int16_t>(68, static_cast<std::int16_t>(code)).text, "x")->meaning,
        meaning)
        << code;
}

// NIfTI-2 header of the same voxels
struct Bytes2 {
  std::string text = std::string(544, '\0');

  Bytes2() {
    put<std::int32_t>(0, 540);
    std::memcpy(text.data() + 4, "n+2\0\r\n\x1a\n", 8);
    put<std::int16_t>(12, 4).put<std::int16_t>(14, 16);
    const std::int64_t dims[] = {3, 4, 3, 2, 1, 1, 1, 1};
    for (std::size_t a = 0; a < 8; ++a) put<std::int64_t>(16 + 8 * a, dims[a]);
    const double pixdim[] = {1, 0.5, 2, 3};
    for (std::size_t a = 0; a < 4; ++a) put<double>(104 + 8 * a, pixdim[a]);
    put<std::int64_t>(168, 544);
    put<std::int32_t>(344, 1).put<std::int32_t>(500, 2);
  }
  template <class T>
  Bytes2& put(std::size_t at, T value) {
    std::memcpy(text.data() + at, &value, sizeof value);
    return *this;
  }
};

TEST(NiftiHeader, ReadsTheSecondVersion) {
  const auto header = parse_nifti_header(
      Bytes2().put<double>(176, 2).put<double>(184, -5).put<std::int32_t>(504, 1002).text, "x");
  ASSERT_TRUE(header) << header.error().message();
  EXPECT_EQ(header->axes, (std::vector<std::int64_t>{4, 3, 2}));
  EXPECT_EQ(header->voxels.component, Component::kInt16);
  EXPECT_EQ(header->voxels.skip, 544u);
  EXPECT_EQ(header->voxels.slope, 2);
  EXPECT_EQ(header->voxels.intercept, -5);
  EXPECT_EQ(header->meaning, ValueMeaning::kLabels);
  EXPECT_TRUE(header->has_geometry);
  EXPECT_FALSE(header->has_detached_data);
  EXPECT_EQ(parse_nifti_header(Bytes2().put<std::int64_t>(168, 0).text, "x")->voxels.skip, 544u);
}

TEST(NiftiHeader, TheSecondVersionsGeometryIsItsSformElseItsQformElseItsVoxelSizes) {
  // a quarter turn about z: i along +y (anterior), j along -x, the third axis flipped by pixdim[0]
  Bytes2 bytes;
  bytes.put<double>(368, std::sqrt(0.5)).put<double>(376, 10).put<double>(384, 20).put<double>(392, 30);
  bytes.put<double>(104, -1);
  Eigen::Matrix<double, 3, 4> expected;
  expected << 0, -2, 0, 10,  //
      0.5, 0, 0, 20,         //
      0, 0, -3, 30;
  const auto quarter = parse_nifti_header(bytes.text, "x");
  ASSERT_TRUE(quarter && quarter->affine);
  EXPECT_TRUE(quarter->affine->isApprox(expected, 1e-12)) << *quarter->affine;

  // a half turn about x whose numbers were rounded up
  const auto half = parse_nifti_header(Bytes2().put<double>(352, 1.0000001).text, "x");
  EXPECT_TRUE(
      half->affine->leftCols<3>().isApprox(Eigen::Vector3d(0.5, -2, -3).asDiagonal().toDenseMatrix(), 1e-9));

  // neither transform: axes as LPS, sides unknown
  const auto silent = parse_nifti_header(Bytes2().put<std::int32_t>(344, 0).text, "x");
  EXPECT_FALSE(silent->has_geometry);
  EXPECT_TRUE(
      silent->affine->leftCols<3>().isApprox(Eigen::Vector3d(-0.5, -2, 3).asDiagonal().toDenseMatrix()));

  // the sform takes precedence over both
  bytes.put<std::int32_t>(348, 1).put<double>(400, 7).put<double>(440, 8).put<double>(480, 9);
  EXPECT_EQ((*parse_nifti_header(bytes.text, "x")->affine)(1, 1), 8);
}

TEST(NiftiHeader, RejectsInvalidNifti2Headers) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const std::string& bad :
       {Bytes2().text.substr(0, 539), Bytes2().put<char>(5, 'x').text, Bytes2().put<std::int64_t>(16, 0).text,
        Bytes2().put<std::int64_t>(16, 8).text, Bytes2().put<std::int16_t>(12, 128).text,
        Bytes2().put<std::int16_t>(14, 8).text, Bytes2().put<std::int64_t>(168, -1).text,
        Bytes2().put<double>(112, nan).text, Bytes2().put<double>(120, -1).text,
        Bytes2().put<double>(352, nan).text, Bytes2().put<std::int32_t>(348, 1).put<double>(400, nan).text,
        Bytes2().put<std::int32_t>(500, 3).text}) {
    const auto header = parse_nifti_header(bad, "x.nii");
    ASSERT_FALSE(header);
    EXPECT_EQ(header.error().where, "x.nii");
  }
}

TEST(NiftiHeader, TheFormThatIsAskedForCounts) {
  Bytes both;
  both.put<std::int16_t>(254, 1);
  // an identity as sform, and a qform whose first voxel is 20 mm away
  for (std::size_t a = 0; a < 3; ++a) both.put<float>(280 + 16 * a + 4 * a, 1);
  both.put<float>(268, 20);
  const auto unasked = parse_nifti_header(both.text, "x");
  ASSERT_TRUE(unasked) << unasked.error().message();
  EXPECT_EQ((*unasked->affine)(0, 3), 0);
  ASSERT_TRUE(unasked->other_affine.has_value());
  EXPECT_EQ((*unasked->other_affine)(0, 3), 20);
  const auto q = parse_nifti_header(both.text, "x", NiftiForm::kQform),
             s = parse_nifti_header(both.text, "x", NiftiForm::kSform);
  ASSERT_TRUE(q) << q.error().message();
  ASSERT_TRUE(s) << s.error().message();
  EXPECT_EQ((*q->affine)(0, 3), 20);
  EXPECT_EQ((*s->affine)(0, 3), 0);
  EXPECT_FALSE(q->other_affine || s->other_affine) << "who asks for one has no doubt";
}

}  // namespace
}  // namespace palpate::volume_io
