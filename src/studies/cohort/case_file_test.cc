#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

#include "base/test_folder.h"
#include "palpate/base/file.h"
#include "palpate/cohort/case.h"
#include "palpate/cohort/cohort_table.h"

namespace palpate {
namespace {

CaseResult example_result() {
  CaseResult result;
  result.key = "0123abcd";
  result.dims = {40, 50, 60};
  result.spacing_mm = {0.5, 0.6, 1.0 / 3};
  StructureResult femur;
  femur.name = "femur";
  femur.volume_mm3 = 12345.678901;
  femur.components = 2;
  femur.gaps = 3;
  femur.touchable = true;
  femur.held_s = 0.7;
  femur.mean_force_N = 1.0 / 3;
  femur.peak_force_N = 2;
  result.structures = {femur};
  result.structures.push_back({});
  result.structures.back().name = "label 7";
  result.palpated = 1;
  result.held = 1;
  result.largest_force_N = 2;
  result.ticks = 4000;
  result.run_hash = 0xfedcba9876543210u;
  result.notes = {"a note", "another"};
  return result;
}

TEST(CaseFile, ComesBackToTheLastBit) {
  const CaseResult result = example_result();
  const std::string text = case_json(result);
  const auto back = parse_case_json(text);
  ASSERT_TRUE(back);
  EXPECT_EQ(case_json(*back), text);
  EXPECT_EQ(back->structures[0].mean_force_N, 1.0 / 3);
  EXPECT_TRUE(std::isnan(back->structures[1].held_s));
  EXPECT_EQ(back->run_hash, result.run_hash);
  EXPECT_EQ(back->spacing_mm[2], 1.0 / 3);
}

TEST(CaseFile, BelievesNothing) {
  const std::string text = case_json(example_result());
  for (std::size_t end = 0; end + 2 < text.size(); ++end)
    ASSERT_FALSE(parse_case_json(text.substr(0, end))) << end;
  constexpr unsigned kSeed = 20;
  std::mt19937 random(kSeed);
  for (int round = 0; round < 3000; ++round) {
    std::string spoilt = text;
    for (int n = 0; n < 3; ++n) spoilt[random() % spoilt.size()] = static_cast<char>(random());
    // a result or an error, without a crash
    (void)parse_case_json(spoilt).has_value();
  }
  for (const char* other : {"", "[]", "null", "{}", "{\"key\": 3}"}) EXPECT_FALSE(parse_case_json(other));
}

TEST(CaseFile, ItsKeyFollowsFilesRowAndProgram) {
  const test::TemporaryFolder folder;
  const auto file = folder / "a.nrrd";
  ASSERT_TRUE(write_file(file, "voxels"));
  CohortCase one;
  one.target = file.string();
  const auto key = [&] {
    const auto made = case_key(one, "1.0");
    EXPECT_TRUE(made);
    return made ? *made : "";
  };
  const std::string first = key();
  EXPECT_EQ(first.size(), 64u);
  EXPECT_EQ(key(), first);
  // name and line of the case do not affect its key
  one.name = "other";
  one.line = 9;
  EXPECT_EQ(key(), first);
  EXPECT_NE(*case_key(one, "1.1"), first);
  ASSERT_TRUE(write_file(file, "voxelz"));
  EXPECT_NE(key(), first);
  ASSERT_TRUE(write_file(file, "voxels"));
  EXPECT_EQ(key(), first);
  // a colour table next to it names its labels
  ASSERT_TRUE(write_file(folder / "a.json", "{}"));
  EXPECT_NE(key(), first);
  one.seed = 0;
  const std::string seeded = key();
  one.seed = 1;
  EXPECT_NE(key(), seeded);
  one.target = (folder / "missing.nrrd").string();
  EXPECT_FALSE(case_key(one, "1.0"));
  one = {};
  one.target = "knee-phantom:seed=1";
  const std::string phantom = key();
  one.target = "knee-phantom:seed=2";
  EXPECT_NE(key(), phantom);
}

TEST(CaseFile, ItsKeyFollowsRolesNamesTablesAndHeadersData) {
  const test::TemporaryFolder folder;
  for (const char* each : {"data", "other"}) std::filesystem::create_directory(folder / each);
  const auto put = [&](const std::string& name, const std::string& text) {
    ASSERT_TRUE(write_file(folder / name, text));
  };
  put("data/a.nii", "voxels");
  put("data/b.nii", "voxels");
  CohortCase one;
  one.target = (folder / "data/a.nii").string();
  const auto key = [&] {
    const auto made = case_key(one, "1.0");
    EXPECT_TRUE(made);
    return made ? *made : "";
  };
  const std::string first = key();
  // a renamed file may rename a structure; the same file in another folder does not change the key
  one.target = (folder / "data/b.nii").string();
  EXPECT_NE(key(), first);
  put("other/a.nii", "voxels");
  one.target = (folder / "other/a.nii").string();
  EXPECT_EQ(key(), first);
  // the role of the file
  one.segmentation = folder / "data/b.nii";
  const std::string segmented = key();
  one.target = (folder / "data/b.nii").string();
  one.segmentation = folder / "other/a.nii";
  EXPECT_NE(key(), segmented);
  // a single table names the labels; with a second one neither is read
  one = {};
  one.target = (folder / "data/a.nii").string();
  put("data/anything.ctbl", "1 femur 1 2 3 255\n");
  const std::string named = key();
  EXPECT_NE(named, first);
  put("data/anything.ctbl", "1 tibia 1 2 3 255\n");
  EXPECT_NE(key(), named);
  put("data/second.tsv", "value\tname\n");
  const std::string two = key();
  EXPECT_NE(two, named);
  // the content of the cohort's own table does not enter the key, only its presence
  one.table = folder / "data/second.tsv";
  const std::string own = key();
  put("data/second.tsv", "study\na.nii\nb.nii\n");
  EXPECT_EQ(key(), own);
  // data files of a header, whatever their names
  for (const auto& [header, line] :
       {std::pair("data/h.nhdr", "NRRD0004\n# x\ndata file: v o x.bin\n\n"),
        std::pair("data/h.mhd", "NDims = 3\r\nElementDataFile = v o x.bin\r\n")}) {
    put(header, line);
    one = {};
    one.target = (folder / header).string();
    const std::string missing = key();
    put("data/v o x.bin", "1");
    const std::string there = key();
    EXPECT_NE(there, missing) << header;
    put("data/v o x.bin", "2");
    EXPECT_NE(key(), there) << header;
    std::filesystem::remove(folder / "data/v o x.bin");
  }
}

TEST(CaseFile, NamesOfFilesAreTakenOutOfTexts) {
  CohortCase one;
  one.target = "/data/DOE^CANARY/scan of doe.nii.gz";
  one.segmentation = "seg/canary_labels.seg.nrrd";
  for (const std::string text :
       {"/data/DOE^CANARY/scan of doe.nii.gz: is damaged",
        "scan of doe.nii.gz and seg/canary_labels.seg.nrrd do not lie together",
        "the folder DOE^CANARY has none", "canary_labels has no voxel", "\"canary_labels.seg\": unknown",
        // names of unrelated files
        "cannot write /srv/Jane van Canary/out of doe/x.png", "canary.raw is missing", "(canary/7)",
        "'C/canary.NII.GZ', damaged"}) {
    const std::string shown = without_names(text, one);
    for (const char* secret : {"DOE", "doe", "CANARY", "canary", "Canary", "Jane"})
      EXPECT_EQ(shown.find(secret), std::string::npos) << shown;
  }
  // common folder names, anatomical terms and units are kept
  for (const std::string text : {"a segmentation of data", "the voxel data end",
                                 "femur: 0.5 N/mm and 20 mm/s.", "scan and labels do not lie together"})
    EXPECT_EQ(without_names(text, one, "/home/results/femur"), text);
}

TEST(CaseFile, NamesThatScenesHeadersAndNeighboursHaveAreTakenOut) {
  const test::TemporaryFolder folder;
  std::filesystem::create_directory(folder / "study");
  const auto put = [&](const std::string& name, const std::string& text) {
    ASSERT_TRUE(write_file(folder / name, text));
  };
  put("study/scene.toml", "title = \"a scene\"\nlabels = \"zebra quagga.nhdr\"\n");
  put("study/zebra quagga.nhdr", "NRRD0004\ntype: uint8\ndata file: okapi gnu\n\n");
  put("study/eland\nkudu.ctbl", "nothing");
  CohortCase one;
  one.target = (folder / "study/scene.toml").string();
  for (const std::string text :
       {"its data file okapi gnu is missing", "zebra quagga.nhdr: no such file", "'zebra quagga' is damaged",
        "eland\\u000akudu.ctbl is not one of labels and passed over", "eland\nkudu has 3 words",
        "impala cannot be written"}) {
    const std::string shown = without_names(text, one, folder / "impala");
    for (const char* secret : {"zebra", "quagga", "okapi", "gnu", "eland", "kudu", "impala"})
      EXPECT_EQ(shown.find(secret), std::string::npos) << shown;
  }
  // names in a scene that cannot be parsed are removed as well
  put("study/scene.toml", "no such key = 3\nlabels = \"hartebeest\"\n[broken\n");
  EXPECT_EQ(without_names("'hartebeest' is no volume", one).find("hartebeest"), std::string::npos);
}

}  // namespace
}  // namespace palpate
