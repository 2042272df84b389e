#include "palpate/catalog/catalog.h"

#include <gmock/gmock.h>

#include <set>

#include "base/test_files.h"
#include "catalog/test_server.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::bytes_of_file;
using test::ScopedEnvironment;
using test::TemporaryFolder;
using test::write_text;
using testing::ElementsAre;
using testing::HasSubstr;

TEST(Catalog, EntriesAreComplete) {
  std::set<std::string> names;
  for (const auto& entry : catalog()) {
    SCOPED_TRACE(entry.name);
    EXPECT_TRUE(names.insert(entry.name).second);
    EXPECT_FALSE(entry.summary.empty());
    EXPECT_FALSE(entry.licence.empty());
    EXPECT_EQ(entry.home.empty(), entry.source == DataSource::kGenerated);
    for (const auto& file : entry.files) {
      // downloads can be verified, over a trusted connection
      EXPECT_EQ(!file.remote.empty(), entry.source == DataSource::kFetched) << file.name;
      if (file.remote.empty()) continue;
      EXPECT_TRUE(entry.home.starts_with("https://"));
      EXPECT_TRUE(file.sha256.size() == 64 || file.git_blob.size() == 40) << file.name;
    }
    EXPECT_EQ(entry.files.front().role, DataRole::kLabels);
    EXPECT_TRUE(entry.files.front().required);
    EXPECT_EQ(*find_entry(entry.name), &entry);
  }
  EXPECT_THAT(names, ElementsAre("abdominal-wall", "gland-phantom", "head", "knee-atlas", "knee-phantom",
                                 "palpation-block", "palpation-dome", "shell-phantom", "skull-phantom",
                                 "temporal-bone"));
}

TEST(Catalog, UnknownNameListsTheKnownOnes) {
  for (const auto& error : {find_entry("knee").error(), locate("knee").error(), fetch("knee", {}).error()}) {
    EXPECT_EQ(error.kind, ErrorKind::kBadInput);
    EXPECT_THAT(error.remedy,
                HasSubstr("knee-phantom, shell-phantom, skull-phantom, gland-phantom, "
                          "palpation-block, palpation-dome, abdominal-wall, temporal-bone, knee-atlas, "
                          "head"));
  }
}

TEST(Catalog, PhantomsWithParametersAreFoundByTheirName) {
  EXPECT_EQ((*find_entry("knee-phantom:side=right"))->name, "knee-phantom");
  EXPECT_FALSE(find_entry("knee-atlas:side=right").ok()) << "an atlas has no parameters";
  for (const auto& error :
       {locate("knee-phantom:sde=right").error(), fetch("knee-phantom:sde=right", {}).error()}) {
    EXPECT_EQ(error.kind, ErrorKind::kBadInput);
    EXPECT_THAT(error.what, HasSubstr("no key `sde`"));
  }
}

TEST(Catalog, FoldersInOrder) {
  const ScopedEnvironment data("PALPATE_DATA", "/a:/b/c::/d"), xdg("XDG_DATA_HOME", "/x");
  EXPECT_THAT(data_folders(), ElementsAre("/a", "/b/c", "/d", "/x/palpate", "/usr/share/mricron/templates"));
}

TEST(Catalog, UserDataFolder) {
  const ScopedEnvironment home("HOME", "/home/somebody");
  {
    const ScopedEnvironment xdg("XDG_DATA_HOME", nullptr);
    EXPECT_EQ(user_data_folder(), "/home/somebody/.local/share/palpate");
  }
  const ScopedEnvironment relative("XDG_DATA_HOME", "here");
  EXPECT_EQ(user_data_folder(), "/home/somebody/.local/share/palpate");
}

// only the data folders that the test creates
class LocateTest : public testing::Test {
 protected:
  TemporaryFolder user_, data_;
  ScopedEnvironment xdg_{"XDG_DATA_HOME", user_.path().c_str()};
  ScopedEnvironment list_{"PALPATE_DATA", data_.path().c_str()};
};

TEST_F(LocateTest, ReportsHowToFetchAbsentData) {
  const auto data = locate("knee-atlas");
  ASSERT_FALSE(data);
  EXPECT_EQ(data.error().kind, ErrorKind::kUnavailable);
  EXPECT_THAT(data.error().remedy, HasSubstr("palpate data fetch knee-atlas"));
}

TEST_F(LocateTest, PhantomInEachPlace) {
  for (const fs::path& folder : {data_ / "knee-phantom", data_.path(), user_ / "palpate/knee-phantom"}) {
    SCOPED_TRACE(folder);
    write_text(folder / "knee-phantom.seg.nrrd", "labels");
    EXPECT_FALSE(locate("knee-phantom").ok()) << "its image is missing";
    write_text(folder / "knee-phantom.nrrd", "image");
    const auto data = locate("knee-phantom");
    ASSERT_TRUE(data) << data.error().message();
    EXPECT_EQ(data->labels, folder / "knee-phantom.seg.nrrd");
    EXPECT_EQ(data->scan, folder / "knee-phantom.nrrd");
    EXPECT_FALSE(data->names);
    fs::remove_all(folder);
    fs::create_directories(data_.path());
  }
}

TEST_F(LocateTest, WrongContentNamesBothHashes) {
  write_text(data_ / "knee_spl/seg.nrrd", "not the atlas");
  write_text(data_ / "knee_spl/knee.ctbl", "");
  const auto data = locate("knee-atlas");
  ASSERT_FALSE(data);
  EXPECT_EQ(data.error().kind, ErrorKind::kBadInput);
  // `printf 'not the atlas' | sha256sum`
  EXPECT_THAT(data.error().what,
              HasSubstr("1aa68f2acc83e55094dc24005b30e197328978bfc92f2fffdf7caebad546977e"));
  EXPECT_THAT(data.error().what,
              HasSubstr("7b1eba4d06a24d8d769fe0342bf57042d6a6d3afb67da04f2749f62007670091"));
  EXPECT_THAT(data.error().where, HasSubstr("seg.nrrd"));
}

TEST_F(LocateTest, HeadFromAnyFolderGetsItsNamesAsATable) {
  write_text(data_ / "head/aal.nii.gz", "labels");
  write_text(data_ / "head/ch2.nii.gz", "image");
  write_text(data_ / "head/aal.nii.txt", "1 Precentral_L 2001\r\n");
  const auto data = locate("head");
  ASSERT_TRUE(data) << data.error().message();
  EXPECT_EQ(data->labels, data_ / "head/aal.nii.gz");
  ASSERT_TRUE(data->names);
  EXPECT_EQ(*data->names, user_ / "palpate/head/names.tsv");
  EXPECT_EQ(bytes_of_file(*data->names), "value\tname\n1\tPrecentral_L\n");
}

TEST_F(LocateTest, InstalledHead) {
  if (!fs::exists("/usr/share/mricron/templates/aal.nii.gz")) {
    if (test::in_ci()) FAIL() << "the package mricron-data is not installed";
    GTEST_SKIP() << "needs the package mricron-data";
  }
  const auto data = locate("head");
  ASSERT_TRUE(data) << data.error().message();
  EXPECT_EQ(data->scan, "/usr/share/mricron/templates/ch2.nii.gz");
  const std::string names = bytes_of_file(*data->names);
  EXPECT_EQ(std::count(names.begin(), names.end(), '\n'), 117);  // a heading and 116 labels
  EXPECT_THAT(names, HasSubstr("\n116\tVermis_10\n"));
}

TEST(Catalog, AtlasInSharedData) {
  PALPATE_SHARED_FILE(atlas, "knee_spl/seg.nrrd");
  for (const fs::path& list : {atlas.parent_path().parent_path(), atlas.parent_path()}) {
    const ScopedEnvironment data_list("PALPATE_DATA", list.c_str());
    const auto data = locate("knee-atlas");
    ASSERT_TRUE(data) << data.error().message();
    EXPECT_EQ(data->labels, atlas);
    EXPECT_EQ(data->names, atlas.parent_path() / "knee.ctbl");
  }
}

TEST(Catalog, DamagedCopyBeforeAGoodOneIsPassedOver) {
  PALPATE_SHARED_FILE(atlas, "knee_spl/seg.nrrd");
  const TemporaryFolder damaged;
  write_text(damaged / "knee_spl/seg.nrrd", "not the atlas");
  write_text(damaged / "knee_spl/knee.ctbl", "");
  const std::string both = damaged.path().string() + ":" + atlas.parent_path().parent_path().string();
  const ScopedEnvironment list("PALPATE_DATA", both.c_str());
  const auto data = locate("knee-atlas");
  ASSERT_TRUE(data) << data.error().message();
  EXPECT_EQ(data->labels, atlas);
}

}  // namespace
}  // namespace palpate
