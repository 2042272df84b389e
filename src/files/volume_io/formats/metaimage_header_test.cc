#include <gtest/gtest.h>

#include "volume_io/formats/headers.h"

namespace palpate::volume_io {
namespace {

const std::string kGood =
    "ObjectType = Image\n"
    "NDims = 3\n"
    "BinaryData = True\n"
    "BinaryDataByteOrderMSB = True\n"
    "CompressedData = False\n"
    "TransformMatrix = 1 0 0 0 1 0 0 0 1\n"
    "Offset = 0 0 0\n"
    "ElementSpacing = 1 1 2\n"
    "DimSize = 4 3 2\n"
    "ElementType = MET_SHORT\n";
const std::string kLocal = "ElementDataFile = LOCAL\n";

std::string replaced(const std::string& from, const std::string& to) {
  std::string header = kGood + kLocal;
  header.replace(header.find(from), from.size(), to);
  return header;
}

TEST(MetaImageHeader, ReadsSizesTypeAndPlaceOfTheVoxels) {
  const auto header = parse_metaimage_header(kGood + kLocal + "voxels", "x");
  ASSERT_TRUE(header) << header.error().message();
  EXPECT_EQ(header->axes, (std::vector<std::int64_t>{4, 3, 2}));
  EXPECT_EQ(header->voxels.component, Component::kInt16);
  EXPECT_EQ(header->voxels.encoding, Encoding::kRaw);
  EXPECT_TRUE(header->voxels.big_endian);
  EXPECT_TRUE(header->has_geometry);
  EXPECT_EQ(header->voxels.offset, kGood.size() + kLocal.size());
  EXPECT_FALSE(
      parse_metaimage_header(replaced("TransformMatrix = 1 0 0 0 1 0 0 0 1\n", ""), "x")->has_geometry);
  EXPECT_EQ(parse_metaimage_header(replaced("Data = False", "Data = True"), "x")->voxels.encoding,
            Encoding::kDeflate);
  EXPECT_EQ(parse_metaimage_header(replaced("BinaryData = True", "BinaryData = False"), "x")->voxels.encoding,
            Encoding::kText);
}

TEST(MetaImageHeader, FindsSeparateDataBehindAnotherHeader) {
  const auto header = parse_metaimage_header(kGood + "HeaderSize = 12\nElementDataFile = a.raw\n", "x");
  ASSERT_TRUE(header) << header.error().message();
  EXPECT_EQ(header->data_file, "a.raw");
  EXPECT_EQ(header->voxels.offset, 12u);
  EXPECT_EQ(parse_metaimage_header(kGood + "HeaderSize = -1\nElementDataFile = a.raw\n", "x")
                ->voxels.trailing_bytes,
            0u);
}

TEST(MetaImageHeader, RejectsInvalidHeaders) {
  for (const std::string& bad : {std::string(),
                                 kGood,
                                 replaced("= Image", "= Tube"),
                                 replaced("NDims = 3", "NDims = 2"),
                                 replaced("NDims = 3", "NDims = 11"),
                                 replaced("DimSize = 4 3 2", "DimSize = 4 3 x"),
                                 replaced("MET_SHORT", "MET_LONG"),
                                 replaced("MET_SHORT", "MET_STRING"),
                                 replaced("= 1 1 2", "= 1 1 nan"),
                                 replaced("= 1 1 2", "= 1 1 0"),
                                 replaced("= 1 1 2", "= 1 1"),
                                 replaced("0 0 0 1\n", "0 0 0\n"),
                                 replaced("Offset = 0 0 0", "Offset = 0 0 inf"),
                                 replaced("= LOCAL", "= LIST"),
                                 replaced("= LOCAL", "="),
                                 replaced("= LOCAL", "= a%03d.raw 1 9 1"),
                                 kGood + "ElementNumberOfChannels = 3\n" + kLocal,
                                 kGood + "HeaderSize = -2\n" + kLocal,
                                 kGood + "NDims = 3\n" + kLocal,
                                 kGood + "no equals\n" + kLocal,
                                 kGood + "Comment = " + std::string(5000, 'x') + "\n" + kLocal}) {
    const auto header = parse_metaimage_header(bad, "x.mha");
    ASSERT_FALSE(header) << bad;
    EXPECT_EQ(header.error().where.substr(0, 5), "x.mha");
  }
}

}  // namespace
}  // namespace palpate::volume_io
