#include <gtest/gtest.h>

#include "volume_io/formats/headers.h"

namespace palpate::volume_io {
namespace {

const std::string kGoodNrrd =
    "NRRD0004\n"
    "# comment\n"
    "type: short\n"
    "dimension: 3\n"
    "space: left-posterior-superior\n"
    "sizes: 4 3 2\n"
    "space directions: (1,0,0) (0,1,0) (0,0,1)\n"
    "kinds: domain domain domain\n"
    "endian: big\n"
    "encoding: gzip\n"
    "space origin: (0,0,0)\n";

std::string nrrd_with(const std::string& from, const std::string& to) {
  std::string header = kGoodNrrd;
  header.replace(header.find(from), from.size(), to);
  return header;
}

TEST(NrrdHeader, ReadsSizesTypeAndPlaceOfTheVoxels) {
  const auto header = parse_nrrd_header(kGoodNrrd + "byte skip: 7\nline skip: 2\n\nvoxels", "x");
  ASSERT_TRUE(header) << header.error().message();
  EXPECT_EQ(header->axes, (std::vector<std::int64_t>{4, 3, 2}));
  EXPECT_EQ(header->voxels.component, Component::kInt16);
  EXPECT_EQ(header->voxels.encoding, Encoding::kDeflate);
  EXPECT_TRUE(header->voxels.big_endian);
  EXPECT_TRUE(header->has_geometry);
  EXPECT_EQ(header->voxels.skip, 7u);
  EXPECT_EQ(header->line_skip, 2);
  EXPECT_EQ(header->voxels.offset, kGoodNrrd.size() + std::string("byte skip: 7\nline skip: 2\n\n").size());
}

TEST(NrrdHeader, ReadsLineEndsOfWindowsAndAnyCase) {
  std::string windows;
  for (const char c : nrrd_with("encoding: gzip", "Encoding: GZ"))
    windows += c == '\n' ? std::string("\r\n") : std::string(1, c);
  const auto header = parse_nrrd_header(windows + "\r\nvoxels", "x");
  ASSERT_TRUE(header) << header.error().message();
  EXPECT_EQ(header->voxels.offset, windows.size() + 2);
}

TEST(NrrdHeader, KeepsOnlyTheSegmentsOfTheFreeFields) {
  const auto header = parse_nrrd_header(
      kGoodNrrd + "Segment0_Name:=fe\\\\mur\\nleft\nDicom.PatientName:=DOE^CANARY\nbyte skip:= 12\n\n", "x");
  ASSERT_TRUE(header) << header.error().message();
  ASSERT_EQ(header->segment_fields.size(), 1u);
  EXPECT_EQ(header->segment_fields[0].second, "fe\\mur\nleft");
  EXPECT_EQ(header->voxels.skip, 0u) << "with := it is a free field, not the byte skip";
}

TEST(NrrdHeader, FindsTheLayerAxisAtEitherEnd) {
  std::string four = kGoodNrrd;
  four.replace(four.find("dimension: 3"), 12, "dimension: 4");
  four.replace(four.find("sizes: 4 3 2"), 12, "sizes: 5 4 3 2");
  four.replace(four.find("(1,0,0)"), 7, "none (1,0,0)");
  four.replace(four.find("kinds: domain"), 13, "kinds: list domain");
  const auto first = parse_nrrd_header(four, "x");
  ASSERT_TRUE(first) << first.error().message();
  EXPECT_EQ(first->layers, 5);
  EXPECT_TRUE(first->layers_first);
  EXPECT_EQ(first->axes, (std::vector<std::int64_t>{4, 3, 2}));

  std::string last = four;
  last.replace(last.find("kinds: list domain domain domain"), 32, "kinds: domain domain domain list");
  last.replace(last.find("none (1,0,0) (0,1,0) (0,0,1)"), 28, "(1,0,0) (0,1,0) (0,0,1) none");
  const auto header = parse_nrrd_header(last, "x");
  ASSERT_TRUE(header) << header.error().message();
  EXPECT_EQ(header->layers, 2);
  EXPECT_FALSE(header->layers_first);

  std::string middle = last;
  middle.replace(middle.find("domain domain domain list"), 25, "domain list domain domain");
  EXPECT_FALSE(parse_nrrd_header(middle, "x"));
}

TEST(NrrdHeader, CountsANegativeByteSkipFromTheEnd) {
  EXPECT_EQ(parse_nrrd_header(kGoodNrrd + "byte skip: -1\n", "x")->voxels.trailing_bytes, 0u);
  EXPECT_EQ(parse_nrrd_header(kGoodNrrd + "byteskip: -5\n", "x")->voxels.trailing_bytes, 4u);
}

TEST(NrrdHeader, WithoutDirectionsOrAPatientSpaceItHasNoGeometry) {
  std::string spaced = nrrd_with("space directions: (1,0,0) (0,1,0) (0,0,1)", "spacings: 1 1 2");
  EXPECT_FALSE(parse_nrrd_header(spaced, "x")) << "spacings and a space contradict each other";
  for (const std::string line : {"space: left-posterior-superior\n", "space origin: (0,0,0)\n"})
    spaced.erase(spaced.find(line), line.size());
  const auto header = parse_nrrd_header(spaced, "x");
  ASSERT_TRUE(header) << header.error().message();
  EXPECT_FALSE(header->has_geometry);
  EXPECT_FALSE(parse_nrrd_header(nrrd_with("left-posterior-superior", "3D-right-handed"), "x")->has_geometry);
  EXPECT_TRUE(parse_nrrd_header(nrrd_with("left-posterior-superior", "RAS"), "x")->has_geometry);
}

TEST(NrrdHeader, RejectsInvalidHeaders) {
  for (const std::string& bad : {std::string(),
                                 std::string("NRRD"),
                                 std::string("NRRD0004\n"),
                                 nrrd_with("NRRD", "NRDR"),
                                 nrrd_with("sizes: 4 3 2", "sizes: 4 3"),
                                 nrrd_with("sizes: 4 3 2", "sizes: 4 3 two"),
                                 nrrd_with("sizes: 4 3 2", "sizes: 4 3 99999999999999999999"),
                                 nrrd_with("dimension: 3", "dimension: -1"),
                                 nrrd_with("type: short", "type: block"),
                                 nrrd_with("type: short\n", ""),
                                 nrrd_with("endian: big\n", ""),
                                 nrrd_with("endian: big", "endian: middle"),
                                 nrrd_with("encoding: gzip", "encoding: zstd"),
                                 nrrd_with("(0,0,1)", "(0,0,nan)"),
                                 nrrd_with("(0,0,1)", "(0,0,inf)"),
                                 nrrd_with("(0,0,1)", "(0,0,1"),
                                 nrrd_with("(0,0,1)", "(0,1)"),
                                 nrrd_with("(0,0,1)", "none"),
                                 nrrd_with("(0,0,1)", ""),
                                 nrrd_with("origin: (0,0,0)", "origin: (0,nan,0)"),
                                 nrrd_with("kinds: domain", "kinds: RGB-color domain"),
                                 kGoodNrrd + "space units: \"um\" \"um\" \"um\"\n",
                                 kGoodNrrd + "spacings: 1 0 1\n",
                                 kGoodNrrd + "spacings: 1 -1 1\n",
                                 kGoodNrrd + "spacings: 1 nan 1\n",
                                 kGoodNrrd + "data file: LIST\n",
                                 kGoodNrrd + "data file: a%03d.raw 1 9 1\n",
                                 kGoodNrrd + "type: short\n",
                                 kGoodNrrd + "no colon\n",
                                 nrrd_with("space directions:", "space directionz:"),
                                 nrrd_with("space origin:", "spce origin:"),
                                 kGoodNrrd + "byte skip: x\n",
                                 kGoodNrrd + "line skip: -1\n"}) {
    const auto header = parse_nrrd_header(bad, "x.nrrd");
    ASSERT_FALSE(header) << bad;
    EXPECT_EQ(header.error().where.substr(0, 6), "x.nrrd");
  }
}

}  // namespace
}  // namespace palpate::volume_io
