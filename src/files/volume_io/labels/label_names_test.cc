#include "volume_io/labels/label_names.h"

#include <gtest/gtest.h>

#include "base/test_files.h"
#include "palpate/base/file.h"
#include "palpate/volume_io/volume_io.h"

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
  EXPECT_EQ(read_label_names(write_text(folder / "a.csv", "value,name\n1,femur\n"))->size(), 1u);
  EXPECT_EQ(read_label_names(write_text(folder / "a.json", R"({"1": "femur"})"))->size(), 1u);
  const std::string snap = "# ITK-SnAP\n1 1 2 3 1 1 1 \"femur\"\n";
  EXPECT_EQ(read_label_names(write_text(folder / "a.label", snap))->size(), 1u);
  EXPECT_EQ(read_label_names(write_text(folder / "snap.txt", snap))->front().name, "femur");
  // FreeSurfer's format
  const std::string lut = "#No. Label Name:   R   G   B   A\n\n17  Left-Hippocampus   220 216 20  0\n";
  EXPECT_EQ(read_label_names(write_text(folder / "FreeSurferColorLUT.txt", lut))->front().name,
            "Left-Hippocampus");
  EXPECT_FALSE(read_label_names(write_text(folder / "a.xls", tsv)));
  EXPECT_FALSE(read_label_names(folder / "missing.ctbl"));
}

TEST(LabelNames, TheOnlyTableInTheFolderNamesTheLabelsWhereItNamesAll) {
  const TemporaryFolder folder;
  const auto file = write_labels_file(folder);
  EXPECT_EQ(read_labels(file)->unnamed, (std::vector<LabelId>{1, 2, 3}));
  EXPECT_EQ(origin_of_names(*read_labels(file)), "no name for its 3 labels");

  const auto names =
      write_text(folder / "names.ctbl", "1 femur 10 20 30 255\n2 tibia 1 2 3 255\n9 absent 0 0 0 255\n");
  std::string warning;
  const auto warn = [&](const std::string& declared) { warning = declared; };
  EXPECT_EQ(read_labels(file, {}, {}, warn)->unnamed.size(), 3u) << "of another patient, perhaps";
  EXPECT_NE(warning.find("names.ctbl was not used"), std::string::npos) << warning;
  EXPECT_NE(warning.find("it names 2 of its 3 labels"), std::string::npos) << warning;
  EXPECT_NE(warning.find("--names " + names.string()), std::string::npos) << warning;
  const auto supplied = read_labels(file, names);
  ASSERT_TRUE(supplied) << supplied.error().message();
  EXPECT_EQ(supplied->unnamed, (std::vector<LabelId>{3}));
  ASSERT_EQ(supplied->labels.segments.size(), 3u) << "a name without voxels makes no segment";
  EXPECT_EQ(supplied->labels.segments[0].name, "femur");
  EXPECT_EQ(supplied->labels.segments[0].colour, (Rgb{10, 20, 30}));
  EXPECT_EQ(supplied->labels.segments[2].name, "");
  EXPECT_EQ(origin_of_names(*supplied),
            "2 of 3 labels have their names from " + names.string() + ", the given table");

  write_text(folder / "names.ctbl", "1 femur 10 20 30 255\n2 tibia 1 2 3 255\n3 fibula 0 0 0 255\n");
  const auto all = read_labels(file);
  EXPECT_TRUE(all->unnamed.empty());
  EXPECT_EQ(all->name_source, NameSource::kOnlyTable);
  EXPECT_EQ(all->names_table, names);

  // with two tables, neither is used unless it is given
  const auto other = write_text(folder / "other.tsv", "value\tname\n3\tpatella\n");
  EXPECT_EQ(read_labels(file)->unnamed, (std::vector<LabelId>{1, 2, 3}));
  EXPECT_EQ(read_labels(file, other)->unnamed, (std::vector<LabelId>{1, 2}));
}

// with two volumes in a folder, its table may belong to either
TEST(LabelNames, IgnoresTheOnlyTableIfThereAreSeveralLabelMaps) {
  const TemporaryFolder folder;
  const auto file = write_labels_file(folder);
  write_text(folder / "names.ctbl", "1 femur 10 20 30 255\n2 tibia 1 2 3 255\n3 fibula 0 0 0 255\n");
  const auto other = folder / "other.nrrd";
  std::filesystem::copy_file(file, other);
  EXPECT_TRUE(read_labels(file)->unnamed.empty())
      << "the other's values change from voxel to voxel as a scan's";
  std::string text = *read_file(file, 1000);
  write_text(other, text.replace(text.rfind("0 1 2 3"), 7, "1 1 2 2"));
  std::string warning;
  const auto warn = [&](const std::string& declared) { warning = declared; };
  EXPECT_EQ(read_labels(file, {}, {}, warn)->unnamed.size(), 3u);
  EXPECT_NE(warning.find("belong to other.nrrd"), std::string::npos) << warning;
  // the scan is not a label map
  const auto of_scan =
      read_labels(file, {}, {}, warn, AmbiguousLabels::kReject, VoxelCaching::kOff, nullptr, {}, other);
  EXPECT_TRUE(of_scan->unnamed.empty());
}

TEST(LabelNames, RejectsTablesWithoutMatchingNames) {
  const TemporaryFolder folder;
  const auto file = write_labels_file(folder);
  const auto wrong =
      read_labels(file, write_text(folder / "knee.ctbl", "95 femur 1 2 3 255\n83 tibia 1 2 3 255\n"));
  ASSERT_FALSE(wrong.ok());
  EXPECT_NE(wrong.error().what.find("names none of the labels of " + file.string() +
                                    ", which are 1, 2, 3, but 95, 83"),
            std::string::npos)
      << wrong.error().message();
  for (const auto& [name, text] : {std::pair{"a.ctbl", "# value name\n"},
                                   {"a.tsv", "value\tname\n"},
                                   {"a.csv", "value,name\n"},
                                   {"a.label", "# ITK-SnAP\n"},
                                   {"a.json", "{}"}}) {
    const auto none = read_label_names(write_text(folder / name, text));
    ASSERT_FALSE(none.ok()) << name;
    EXPECT_NE(none.error().what.find("names no label"), std::string::npos) << none.error().message();
  }
  // a table with the map's own name causes a warning
  write_text(folder / "labels.ctbl", "95 femur 1 2 3 255\n");
  std::string warning;
  EXPECT_EQ(
      read_labels(file, {}, {}, [&](const std::string& declared) { warning = declared; })->unnamed.size(),
      3u);
  EXPECT_NE(warning.find("labels.ctbl was not used"), std::string::npos) << warning;
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

TEST(LabelNames, PrefersTheTableOfTheSameName) {
  const TemporaryFolder folder;
  const auto file = write_labels_file(folder);
  write_text(folder / "other.ctbl", "1 femur 10 20 30 255\n");
  write_text(folder / "another.tsv", "value\tname\n1\ttibia\n");
  EXPECT_EQ(read_labels(file)->unnamed.size(), 3u) << "two that may be meant";
  write_text(folder / "labels.json", R"({"1": "liver", "2": "spleen", "3": "kidney"})");
  const auto labels = read_labels(file);
  ASSERT_TRUE(labels);
  EXPECT_EQ(labels->labels.segments[0].name, "liver");
  EXPECT_TRUE(labels->unnamed.empty());
}

TEST(LabelNames, AMaskIsCalledAfterItsFile) {
  for (const auto& [name, expected] : {std::pair{"femur_left.nrrd", "femur_left"},
                                       {"vertebrae_L5.seg.nrrd", "vertebrae_L5"},
                                       {"Left kidney.NII.GZ", "Left kidney"},
                                       {"sub-01_liver_mask.nii", "liver"},
                                       {"DOE^CANARY.nii.gz", ""},
                                       {"labels.nii.gz", ""},
                                       {"seg_01.mha", ""},
                                       {"1.nrrd", ""},
                                       {"Segmentation-label.nrrd", ""},
                                       {"\xff.nrrd", ""}})
    EXPECT_EQ(volume_io::name_of_mask(name).name, expected) << name;

  const TemporaryFolder folder;
  const char* header =
      "NRRD0004\ntype: uint8\ndimension: 3\nspace: LPS\nsizes: 2 1 1\n"
      "space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\nencoding: ascii\n\n";
  const auto mask = read_labels(write_text(folder / "femur_left.nrrd", std::string(header) + "0 7\n"));
  ASSERT_TRUE(mask) << mask.error().message();
  EXPECT_EQ(mask->labels.segments.at(0).name, "femur_left");
  EXPECT_TRUE(mask->unnamed.empty());
  // ambiguous with two labels
  const auto two = read_labels(write_text(folder / "knee_left.nrrd", std::string(header) + "1 2\n"));
  EXPECT_EQ(two->unnamed.size(), 2u);
}

}  // namespace
}  // namespace palpate
