#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "volume_io/headers.h"

namespace palpate::volume_io {
namespace {

// a little-endian header of 4 x 3 x 2 int16 voxels with a qform
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
  EXPECT_FALSE(header->sform);
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
  EXPECT_EQ((*header->sform)(1, 1), 3);
}

TEST(NiftiHeader, WithoutAFormItHasNoGeometry) {
  EXPECT_FALSE(parse_nifti_header(Bytes().put<std::int16_t>(252, 0).text, "x")->has_geometry);
}

TEST(NiftiHeader, WhatCannotBeRightIsAnError) {
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

}  // namespace
}  // namespace palpate::volume_io
