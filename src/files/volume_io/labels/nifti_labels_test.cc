#include <gtest/gtest.h>

#include <cstring>
#include <random>

#include "palpate/volume_io/label_tables.h"
#include "volume_io/formats/headers.h"

namespace palpate::volume_io {
namespace {

// extension written by TotalSegmentator
const std::string kXml =
    R"(<?xml version="1.0" encoding="UTF-8"?> <CaretExtension>  <Date><![CDATA[2013-07-14T05:45:09]]></Date>   )"
    R"(<VolumeInformation Index="0">   <LabelTable>)"
    R"(<Label Key="1" Red="0.2" Green="0.4" Blue="1" Alpha="1"><![CDATA[liver]]></Label>)"
    R"(<Label Key="7" Red="0.2" Green="0.3" Blue="0.4" Alpha="1"><![CDATA[kidney_left]]></Label></LabelTable>  )"
    R"(<StudyMetaDataLinkSet>  </StudyMetaDataLinkSet>  <VolumeType><![CDATA[Label]]></VolumeType>   )"
    R"(</VolumeInformation></CaretExtension>)";

// data after a header of 348 bytes: the flag, and each extension preceded by its size and code
std::string with_extensions(const std::vector<std::string>& extensions, bool swap = false) {
  std::string bytes(348, '\0');
  bytes += std::string("\1\0\0\0", 4);
  for (const std::string& data : extensions) {
    std::uint32_t size = (static_cast<std::uint32_t>(data.size()) + 8 + 15) / 16 * 16;
    const std::size_t padding = size - 8 - data.size();
    if (swap) size = __builtin_bswap32(size);
    char field[4];
    std::memcpy(field, &size, 4);
    bytes += std::string(field, 4) + std::string(4, '\0') + data + std::string(padding, '\0');
  }
  return bytes;
}

TEST(NiftiLabels, NamesOfTotalSegmentatorsExtension) {
  const auto fields = parse_caret_labels(kXml, "x");
  ASSERT_TRUE(fields) << fields.error().message();
  const auto segments = parse_segment_fields(*fields, 1, "x");
  ASSERT_TRUE(segments) << segments.error().message();
  ASSERT_EQ(segments->size(), 2u);
  EXPECT_EQ((*segments)[0].name, "liver");
  EXPECT_EQ((*segments)[0].colour, (Rgb{51, 102, 255}));
  EXPECT_EQ((*segments)[1].id, 7);
  EXPECT_EQ((*segments)[1].name, "kidney_left");
}

TEST(NiftiLabels, TheExtensionIsFoundAmongOthersInEitherByteOrder) {
  for (const bool swap : {false, true}) {
    const std::string bytes = with_extensions({"AFNI attributes", kXml, "more"}, swap);
    EXPECT_TRUE(find_caret_extension(bytes, 348, swap).starts_with(kXml)) << swap;
  }
  EXPECT_EQ(find_caret_extension(with_extensions({"a comment"}), 348, false), "");
  EXPECT_EQ(find_caret_extension(std::string(352, '\0') + kXml, 348, false), "") << "no flag";
  EXPECT_EQ(find_caret_extension("", 348, false), "");
  // a size beyond the end of the file, or zero
  std::string damaged = with_extensions({kXml});
  damaged[352] = damaged[353] = '\x7f';
  EXPECT_EQ(find_caret_extension(damaged, 348, false), "");
  damaged[352] = damaged[353] = 0;
  EXPECT_EQ(find_caret_extension(damaged, 348, false), "");
}

TEST(NiftiLabels, TextsAreThoseOfXml) {
  const auto name_of = [](const std::string& element) {
    const auto fields = parse_caret_labels("<LabelTable>" + element + "</LabelTable>", "x");
    return !fields ? "error: " + fields.error().what : fields->empty() ? "" : (*fields)[1].second;
  };
  EXPECT_EQ(name_of(R"(<Label Key="3">bone &amp; marrow &lt;left&gt;</Label>)"), "bone & marrow <left>");
  EXPECT_EQ(name_of(R"(<Label Red='1' Key='3'> tibia </Label>)"), "tibia");
  EXPECT_EQ(name_of(R"(<Label Key="0">???</Label>)"), "") << "background";
  EXPECT_NE(name_of(R"(<Label Key="70000">x</Label>)").find("key that is not a whole number"),
            std::string::npos);
  EXPECT_NE(name_of(R"(<Label Key="1">x</Label><Label Key="1">y</Label>)").find("second time"),
            std::string::npos);
  EXPECT_NE(name_of(R"(<Label Key="1"></Label>)").find("the name is empty"), std::string::npos);
  EXPECT_NE(name_of(R"(<Label Key="1"><b>x</b></Label>)").find("not a text"), std::string::npos);
  EXPECT_NE(name_of(R"(<Label Key="1">&copy;</Label>)").find("not a text"), std::string::npos);
  EXPECT_NE(name_of("<Label Key=\"1\">\x1b[2J</Label>").find("control character"), std::string::npos);
  EXPECT_NE(name_of(R"(<Label Key="1")").find("cut short"), std::string::npos);
  EXPECT_TRUE(parse_caret_labels("<CaretExtension></CaretExtension>", "x")->empty());
}

TEST(NiftiLabels, DamageIsAnErrorOrNamesAndNothingElse) {
  const std::string whole = with_extensions({kXml});
  std::mt19937 random(50);
  for (int n = 0; n < 600; ++n) {
    std::string bytes = whole;
    if (n % 2 == 0) {
      bytes.resize(random() % bytes.size());
    } else {
      for (int flip = 0; flip < 3; ++flip)
        bytes[348 + random() % (bytes.size() - 348)] ^= static_cast<char>(1 << random() % 8);
    }
    const auto fields = parse_caret_labels(find_caret_extension(bytes, 348, false), "x");
    if (!fields) {
      EXPECT_FALSE(fields.error().what.empty());
      continue;
    }
    for (const auto& [key, text] : *fields) EXPECT_TRUE(key.starts_with("Segment"));
    EXPECT_LE(parse_segment_fields(*fields, 1, "x")->size(), 2u);
  }
}

}  // namespace
}  // namespace palpate::volume_io
