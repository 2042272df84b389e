#include <fcntl.h>
#include <gmock/gmock.h>
#include <sys/file.h>
#include <unistd.h>

#include <atomic>
#include <chrono>

#include "base/test_files.h"
#include "catalog/test_server.h"
#include "palpate/catalog/catalog.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::bytes_of_file;
using test::ScopedEnvironment;
using test::TemporaryFolder;
using test::write_text;
using testing::HasSubstr;

// a home folder of its own, without any data
class FetchTest : public testing::Test {
 protected:
  std::vector<std::string> warnings_;
  Warn warn_ = [this](const std::string& message) { warnings_.push_back(message); };
  TemporaryFolder user_;
  ScopedEnvironment xdg_{"XDG_DATA_HOME", user_.path().c_str()};
};

// the atlas from a local mirror; its files come from the folder in PALPATE_DATA
class FetchAtlasTest : public FetchTest {
 protected:
  void SetUp() override {
    PALPATE_SHARED_FILE(atlas, "knee_spl/seg.nrrd");
    ASSERT_TRUE(server_.running()) << "needs python3";
    fs::create_directories(served_ / "Data");
    for (const char* name : {"seg.nrrd", "knee.ctbl"})
      fs::copy_file(atlas.parent_path() / name, served_ / "Data" / name);
    ::setenv("PALPATE_DATA", "", 1);
  }
  Result<LocalData> get(const std::string& behaviour) {
    FetchOptions options;
    options.mirror = server_.url(behaviour);
    return fetch("knee-atlas", options, {}, warn_);
  }

  TemporaryFolder served_;
  test::TestServer server_{served_.path()};
  ScopedEnvironment list_{"PALPATE_DATA", std::getenv("PALPATE_DATA")};  // restored at the end
  fs::path folder_ = user_ / "palpate/knee-atlas";
};

TEST_F(FetchAtlasTest, WithoutItsImage) {
  const auto data = get("ok/");
  ASSERT_TRUE(data) << data.error().message();
  EXPECT_EQ(data->labels, folder_ / "seg.nrrd");
  EXPECT_EQ(data->names, folder_ / "knee.ctbl");
  EXPECT_FALSE(data->scan);
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_THAT(warnings_[0], testing::AllOf(HasSubstr("I.nrrd"), HasSubstr("404")));

  // present from now on, without a server
  const auto again = locate("knee-atlas");
  ASSERT_TRUE(again) << again.error().message();
  EXPECT_EQ(again->labels, data->labels);
}

TEST_F(FetchAtlasTest, ThroughABadConnection) {
  const auto data = get("cut-200000");
  ASSERT_TRUE(data) << data.error().message();
  EXPECT_EQ(bytes_of_file(data->labels), bytes_of_file(served_ / "Data/seg.nrrd"));
}

TEST_F(FetchAtlasTest, AnotherFileUnderItsName) {
  const auto data = get("corrupt");
  ASSERT_FALSE(data);
  EXPECT_EQ(data.error().kind, ErrorKind::kUnavailable);
  EXPECT_THAT(data.error().what, HasSubstr("SHA-256"));
  EXPECT_FALSE(fs::exists(folder_));
}

TEST_F(FetchAtlasTest, WrongImageIsLeftOut) {
  write_text(served_ / "Data/I.nrrd", "another image");
  const auto data = get("ok");
  ASSERT_TRUE(data) << data.error().message();
  EXPECT_FALSE(data->scan);
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_THAT(warnings_[0], HasSubstr("3a6b7473737508b70fdc2c1dd57e2c122ff37795"));
  EXPECT_FALSE(fs::exists(folder_ / "I.nrrd"));
}

TEST_F(FetchAtlasTest, DamagedCopyIsReplaced) {
  write_text(folder_ / "seg.nrrd", "damaged");
  const auto data = get("ok");
  ASSERT_TRUE(data) << data.error().message();
  EXPECT_EQ(fs::file_size(folder_ / "seg.nrrd"), 466251u);
}

TEST_F(FetchAtlasTest, AlreadyInADataFolderFetchesNothing) {
  const TemporaryFolder elsewhere;
  fs::create_directories(elsewhere / "knee_spl");
  for (const char* name : {"seg.nrrd", "knee.ctbl"})
    fs::copy_file(served_ / "Data" / name, elsewhere / "knee_spl" / name);
  const ScopedEnvironment list("PALPATE_DATA", elsewhere.path().c_str());
  const auto data = get("missing");
  ASSERT_TRUE(data) << data.error().message();
  EXPECT_EQ(data->labels, elsewhere / "knee_spl/seg.nrrd");
  EXPECT_FALSE(fs::exists(folder_));
}

TEST_F(FetchAtlasTest, FolderThatCannotBeMade) {
  write_text(user_ / "palpate", "a file in the way");
  const auto data = get("ok");
  ASSERT_FALSE(data);
  EXPECT_EQ(data.error().kind, ErrorKind::kOutput);
}

TEST_F(FetchTest, PhantomIsGeneratedAndFound) {
  const ScopedEnvironment list("PALPATE_DATA", "");
  FetchOptions options;
  options.voxel_mm = 2.5;
  const auto data = fetch("knee-phantom", options, {}, warn_);
  ASSERT_TRUE(data) << data.error().message();
  const auto labels = read_labels(data->labels);
  ASSERT_TRUE(labels) << labels.error().message();
  EXPECT_NE(labels->labels.find("femur"), nullptr);
  const auto scan = read_header(*data->scan);
  ASSERT_TRUE(scan);
  EXPECT_TRUE(scan->geometry.same_grid(labels->header.geometry));
  EXPECT_NEAR(scan->geometry.min_spacing_mm(), 2.5, 1e-9);
  EXPECT_EQ(locate("knee-phantom")->labels, data->labels);

  // repeated: nothing to do; with another voxel size: both files are replaced, and nothing else is left
  const auto written = fs::last_write_time(data->labels);
  ASSERT_TRUE(fetch("knee-phantom", options));
  EXPECT_EQ(fs::last_write_time(data->labels), written);
  options.voxel_mm = 3.0;
  ASSERT_TRUE(fetch("knee-phantom", options));
  EXPECT_NEAR(read_header(data->labels)->geometry.min_spacing_mm(), 3.0, 1e-9);
  EXPECT_NEAR(read_header(*data->scan)->geometry.min_spacing_mm(), 3.0, 1e-9);
  EXPECT_EQ(std::distance(fs::directory_iterator(data->labels.parent_path()), fs::directory_iterator()), 2);
}

TEST_F(FetchTest, PhantomsWithParametersHaveFilesOfTheirOwn) {
  const ScopedEnvironment list("PALPATE_DATA", "");
  const TemporaryFolder into;
  FetchOptions options;
  options.into = into.path();
  options.voxel_mm = 3;
  ASSERT_TRUE(fetch("knee-phantom", options));
  options.voxel_mm.reset();
  const auto right = fetch("knee-phantom:spacing=3,side=right", options);
  ASSERT_TRUE(right) << right.error().message();
  EXPECT_EQ(right->labels, into / "knee-phantom_side=right,spacing=3.seg.nrrd");
  EXPECT_EQ(right->scan, into / "knee-phantom_side=right,spacing=3.nrrd");
  // any spelling of the parameters refers to this phantom, which is not generated again
  const auto written = fs::last_write_time(right->labels);
  const auto again = fetch("knee-phantom:side=right,spacing=3.0", options);
  ASSERT_TRUE(again) << again.error().message();
  EXPECT_EQ(again->labels, right->labels);
  EXPECT_EQ(fs::last_write_time(right->labels), written);
  // found in the user's folder, and is distinct from the knee without parameters
  EXPECT_EQ(locate("knee-phantom:side=right,spacing=3").error().kind, ErrorKind::kUnavailable);
  ASSERT_TRUE(fetch("knee-phantom:side=right,spacing=3", {}));
  EXPECT_EQ(locate("knee-phantom:spacing=3,side=right")->labels.filename(), right->labels.filename());
  EXPECT_FALSE(locate("knee-phantom").ok());
  // a name that is too long for a file name
  const auto many = fetch(
      "knee-phantom:spacing=3,missing=anterior_cruciate_ligament+femoral_cartilage+fibular_collateral_"
      "ligament+"
      "lateral_meniscus+lateral_tibial_cartilage+medial_meniscus+medial_tibial_cartilage+patellar_cartilage+"
      "patellar_ligament+posterior_cruciate_ligament+tibial_collateral_ligament",
      options);
  ASSERT_TRUE(many) << many.error().message();
  EXPECT_TRUE(many->labels.filename().string().starts_with("knee-phantom_"));
  EXPECT_EQ(read_labels(many->labels)->labels.segments.size(), 4u);
}

TEST_F(FetchTest, VoxelsOfAPhantomWithParametersAreAmongThem) {
  FetchOptions options;
  options.voxel_mm = 2;
  const auto data = fetch("knee-phantom:side=right", options);
  ASSERT_FALSE(data);
  EXPECT_EQ(data.error().kind, ErrorKind::kUsage);
  EXPECT_THAT(data.error().remedy, HasSubstr("spacing=0.4"));
}

TEST_F(FetchTest, InterruptedPhantomLeavesNothing) {
  const std::atomic<bool> stop{true};
  const TemporaryFolder into;
  FetchOptions options;
  options.into = into.path();
  options.voxel_mm = 3.0;
  const auto data = fetch("knee-phantom", options, Progress({}, &stop));
  ASSERT_FALSE(data);
  EXPECT_EQ(data.error().kind, ErrorKind::kInterrupted);
  EXPECT_TRUE(fs::is_empty(into.path()));
}

TEST_F(FetchTest, RemovesFilesOfKilledRuns) {
  const TemporaryFolder into;
  const auto left = [&](const char* name, std::time_t age_s) {
    const fs::path made = into.path() / name;
    fs::create_directories(made);
    write_text(made / "labels.seg.nrrd", "half");
    fs::last_write_time(made, fs::file_time_type::clock::now() - std::chrono::seconds(age_s));
    return made;
  };
  const fs::path killed = left(".palpate-a1B2c3", 3600), started_now = left(".palpate-d4E5f6", 0),
                 lives = left(".palpate-g7H8i9", 3600), somebodys = left(".palpate-of-somebody", 3600);
  const int lock = ::open(lives.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  ASSERT_EQ(::flock(lock, LOCK_EX | LOCK_NB), 0);
  FetchOptions options;
  options.into = into.path();
  options.voxel_mm = 3;
  ASSERT_TRUE(fetch("knee-phantom", options));
  EXPECT_FALSE(fs::exists(killed));
  EXPECT_TRUE(fs::exists(started_now)) << "it may not have locked its folder yet";
  EXPECT_TRUE(fs::exists(lives));
  EXPECT_TRUE(fs::exists(somebodys)) << "no folder of ours is called so";
  ::close(lock);
}

TEST_F(FetchTest, PackageIsPointedTo) {
  const TemporaryFolder data;
  const ScopedEnvironment list("PALPATE_DATA", data.path().c_str());
  write_text(data / "head/aal.nii.gz", "labels");
  write_text(data / "head/ch2.nii.gz", "image");
  write_text(data / "head/aal.nii.txt", "1 A 1\n");
  const auto here = fetch("head", {});
  ASSERT_TRUE(here) << here.error().message();
  EXPECT_EQ(here->labels, data / "head/aal.nii.gz");
  // neither in a data folder nor installed
  if (fs::exists("/usr/share/mricron/templates/aal.nii.gz")) return;
  fs::remove(data / "head/aal.nii.gz");
  EXPECT_THAT(fetch("head", {}).error().remedy, HasSubstr("mricron-data"));
}

TEST_F(FetchTest, WrongOptions) {
  FetchOptions options;
  const auto kind = [&] {
    const auto data = fetch("knee-phantom", options);
    return data ? std::optional<ErrorKind>() : data.error().kind;
  };
  for (const double voxel : {0.1, 3.1, -1.0, std::nan("")}) {
    options.voxel_mm = voxel;
    EXPECT_EQ(kind(), ErrorKind::kUsage) << voxel;
  }
  options = {};
  options.mirror = "ftp://example.org";
  EXPECT_EQ(kind(), ErrorKind::kUsage);
  options = {};
  options.attempts = 0;
  EXPECT_EQ(kind(), ErrorKind::kUsage);
}

}  // namespace
}  // namespace palpate
