#include "volume_io/label_names.h"

#include <gtest/gtest.h>

#include "base/test_files.h"
#include "palpate/volume_io.h"

namespace palpate {
namespace {

using test::TemporaryFolder;
using test::write_text;

// 4 x 1 x 1 voxels with labels 0 1 2 3
std::filesystem::path write_labels_file(const TemporaryFolder& folder) {
  return write_text(
      folder / "labels.nrrd",
      "NRRD0004\ntype: uint8\ndimension: 3\nspace: LPS\nsizes: 4 1 1\n"
      "space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\nencoding: ascii\n\n0 1 2 3\n");
}

TEST(LabelNames, ATableIsReadByItsEnding) {
  const TemporaryFolder folder;
  const std::string ctbl = "1 femur 1 2 3 255\n", tsv = "value\tname\n1\tfemur\n";
  EXPECT_EQ(read_label_names(write_text(folder / "a.ctbl", ctbl))->size(), 1u);
  EXPECT_EQ(read_label_names(write_text(folder / "a.txt", ctbl))->size(), 1u);
  EXPECT_EQ(read_label_names(write_text(folder / "a.TSV", tsv))->size(), 1u);
  EXPECT_FALSE(read_label_names(write_text(folder / "a.csv", tsv)));
  EXPECT_FALSE(read_label_names(folder / "missing.ctbl"));
}

TEST(LabelNames, TheOnlyTableInTheFolderNamesTheLabels) {
  const TemporaryFolder folder;
  const auto file = write_labels_file(folder);
  EXPECT_EQ(read_labels(file)->unnamed, (std::vector<LabelId>{1, 2, 3}));

  write_text(folder / "names.ctbl", "1 femur 10 20 30 255\n2 tibia 1 2 3 255\n9 absent 0 0 0 255\n");
  const auto labels = read_labels(file);
  ASSERT_TRUE(labels) << labels.error().message();
  EXPECT_EQ(labels->unnamed, (std::vector<LabelId>{3}));
  ASSERT_EQ(labels->labels.segments.size(), 3u) << "a name without voxels makes no segment";
  EXPECT_EQ(labels->labels.segments[0].name, "femur");
  EXPECT_EQ(labels->labels.segments[0].colour, (Rgb{10, 20, 30}));
  EXPECT_EQ(labels->labels.segments[2].name, "");

  // of two tables neither is taken unless it is named
  const auto other = write_text(folder / "other.tsv", "value\tname\n3\tpatella\n");
  EXPECT_EQ(read_labels(file)->unnamed, (std::vector<LabelId>{1, 2, 3}));
  EXPECT_EQ(read_labels(file, other)->unnamed, (std::vector<LabelId>{1, 2}));
}

TEST(LabelNames, ABadTableIsAnErrorWhenNamedAndAWarningWhenOnlyLyingThere) {
  const TemporaryFolder folder;
  const auto file = write_labels_file(folder);
  const auto table = write_text(folder / "participants.tsv", "participant_id\tage\nsub-1\t34\n");
  EXPECT_FALSE(read_labels(file, table));
  std::string warning;
  const auto labels = read_labels(file, {}, {}, [&](const std::string& message) { warning = message; });
  ASSERT_TRUE(labels);
  EXPECT_EQ(labels->unnamed.size(), 3u);
  EXPECT_NE(warning.find("participants.tsv:1"), std::string::npos) << warning;
}

}  // namespace
}  // namespace palpate
